"""Files as loggers, instruments and programs write them: read as the plain table is, or refused with the cure."""

import gzip
import re

import numpy as np
import pytest
from test_table_formats import COUNT, POSITION, POWER, TIME, check_plain, table

from sma_sim.evidence.data.recordings import read_recording
from sma_sim.model.errors import UserError

PLAIN = table(TIME, POWER, POSITION)
BODY = PLAIN.partition('\n')[2]
ROWS = BODY.splitlines()
FOREIGN = 'time_s: Time\nJ_W: Power\nposition_m: Way\n'
LABVIEW = """LabVIEW Measurement
Writer_Version\t2
Separator\tTab
Decimal_Separator\t{decimal}
Multi_Headings\tNo
Date\t2026/07/31
Time\t21:16:09{decimal}1234
***End_of_Header***

Channels\t2\t\t
Samples\t200\t200\t
X_Dimension\tTime\tTime\t
X0\t0{decimal}0E+0\t0{decimal}0E+0\t
Delta_X\t0{decimal}05\t0{decimal}05\t
***End_of_Header***\t\t\t
Time\tPower\tWay\tComment
"""
CAMPBELL = '"TOA5","bench","CR1000","1234"\n"TIMESTAMP","RECORD","J_W","position_m"\n"TS","RN","W","m"\n"","","Smp","Smp"\n'
CATMAN = """CATMAN ASCII EXPORT
Date: 31.07.2026
Time  1 - default sample rate\tPower\tWay
SR=20 HZ\tSR=20 HZ\tSR=20 HZ
SG/none\tVoltage\tVoltage
CH=0 IO=1\tCH=1 IO=2\tCH=2 IO=3
[s]\tW\tm
"""
KEYSIGHT = """Instrument,34972A,MY49012345
Channel,Function,Range,Resolution,Gain,Offset,Label
101,DCV,10,5.5,1,0,Power
102,DCV,1,5.5,1,0,Way
Total Channels:,2

Scan,Time,101 (VDC),Alarm 101,102 (VDC),Alarm 102
"""
DIADEM = """DIAdem TDM export
Group;bench 3
Channel name;Time;Power;Way
Unit;s;W;m
Data type;DT_DOUBLE;DT_DOUBLE;DT_DOUBLE
Length;200;200;200
"""
FLUKE = 'Fluke 289,Serial 12345\nSession: Recording 3,,\nReading,Start Time,Average,Description\n'


def over_midnight(_, t, p, x):
    return f'{"23:59" if t < 5 else "00:00"}:{(55 + t) % 60:06.3f},{p},{x:.12f}'


def rows(form):
    return ''.join(form(*one) + '\n' for one in zip(range(COUNT), TIME, POWER, POSITION, strict=True))


def cells(separator, decimal='.', end=''):
    return rows(lambda _, t, p, x: f'{t:.6f}{separator}{p:.3f}{separator}{x:.15f}{end}'.replace('.', decimal))


def with_cell(word):
    return '\n'.join([PLAIN.split('\n')[0], *ROWS[:50], ROWS[50].rpartition(',')[0] + f',{word}', *ROWS[51:], ''])


NAMED = 'columns: [Time, Power, Way]\n' + FOREIGN
READ = {  # content, map, what is said
    'no header': (BODY, 'columns: [time_s, J_W, position_m]\n', ''),
    'no header, foreign names': (BODY, NAMED, ''),
    'no header, a column without a name': (
        rows(lambda k, t, p, x: f'{t:.6f},{k},{p:.3f},{x:.15f}'),
        'columns: [Time, "", Power, Way]\n' + FOREIGN,
        '',
    ),
    'no header, decimal commas between tabs': (cells('\t', ','), NAMED, 'decimals have commas'),
    'no header, decimal commas between spaces': (cells('  ', ','), NAMED, 'separated by spaces'),
    'no header, dates': (
        rows(lambda _, t, p, x: f'2026-07-31 21:16:{9 + t:05.2f},{p},{x:.15f}'),
        NAMED,
        'counted from the first row',
    ),
    'no header, comments': ('# bench 3\n' + BODY.replace('\n1,', '\n# halved\n1,'), NAMED, 'are comments'),
    'no header, a row of units': (
        's;W;mm\n' + rows(lambda _, t, p, x: f'{t};{p};{1e3 * x:.12f}'),
        'columns: [Time, Power, Way]\ntime_s: Time\nJ_W: Power\nposition_m: {column: Way, scale: 0.001}\n',
        'the row of units',
    ),
    'no header, a gap in the first rows': (BODY.replace('\n0.05,0,', '\n0.05,,'), NAMED, 'J_W: 1 row without a value'),
    'no header below a description': ('Bench 3\nMass: 12 g\n\n' + BODY, NAMED, "2 lines above the numbers are no table"),
    'names of a map in place of others': ('Zeit,Leistung,Weg\n' + BODY, NAMED, "among them 'Zeit Leistung Weg'"),
    'names of a map that the table has': (PLAIN, 'columns: [time_s, J_W, position_m]\n', ''),
    'no header in a campaign': (
        BODY,
        'tests: [{files: "*.csv", columns: [Time, Power, Way]}]\n' + FOREIGN,
        '',
    ),
    'labview': (LABVIEW.format(decimal='.') + cells('\t', end='\t'), FOREIGN, '14 lines above'),
    'labview with decimal commas': (LABVIEW.format(decimal=',') + cells('\t', ',', '\t'), FOREIGN, 'decimals have commas'),
    'tdms exported': ('Time;Power;Way\n\n' + cells(';', ','), FOREIGN, 'separated by semicolons'),
    'campbell': (
        CAMPBELL + rows(lambda k, t, p, x: f'"2026-07-31 21:16:{9 + t:05.2f}",{k},{p},{x:.15f}'),
        'time_s: TIMESTAMP\n',
        'row of units',
    ),
    'serial line of a microcontroller': ('Ready.\nzero: 12\n' + PLAIN, '', '2 lines above'),
    'one line': ('Ready.\n' + PLAIN, '', '1 line above the numbers is no table'),
    'block of a spreadsheet': ('Test:,bench 3,\nDate:,31.07.2026,\nMass,12,g\n,,\n' + PLAIN, '', '3 lines above'),
    'narrow block': ('Report\nSample,12\nRate,20\nLoad,3\n\n' + PLAIN, '', '4 lines above'),
    'block with semicolons': ('Test;3;\nDate;31.07.2026;\nTime;Power;Way\n' + cells(';', ','), FOREIGN, '2 lines above'),
    'keysight': (
        'x-axis,1,2\nsecond,Volt,Volt\n' + rows(lambda _, t, p, x: f'{t},{p / 8},{x / 2:.15f}'),
        'time_s: x-axis\nJ_W: {column: 1, scale: 8}\nposition_m: {column: 2, scale: 2}\n',
        'row of units',
    ),
    'matlab writetable': (PLAIN.replace('\n0.05,0,', '\n0.05,NaN,'), '', 'J_W: 1 row without a value'),
    'pandas index': (',time_s,J_W,position_m\n' + rows(lambda k, t, p, x: f'{k},{t:.12g},{p},{x:.15f}'), '', ''),
    'byte order mark': ('\ufeff' + PLAIN, '', ''),
    'utf-16': (PLAIN.encode('utf-16'), '', ''),
    'utf-16 with tabs': ('\ufeff'.encode('utf-16-be') + PLAIN.replace(',', '\t').encode('utf-16-be'), '', 'tabs'),
    'windows': (PLAIN.replace('\n', '\r\n'), '', ''),
    'old macintosh': (PLAIN.replace('\n', '\r'), '', ''),
    'nanoseconds since 1970': (
        't,J_W,position_m\n' + rows(lambda k, _, p, x: f'{1669882837000000000 + 50000000 * k},{p},{x:.15f}'),
        'time_s: {column: t, scale: 1.0e-9}\n',
        'counted from the first row',
    ),
    'milliseconds since 1970': (
        't,J_W,position_m\n' + rows(lambda k, _, p, x: f'{1669882837000 + 50 * k},{p},{x:.15f}'),
        'time_s: {column: t, scale: 1.0e-3}\n',
        'counted from the first row',
    ),
    'counter of 16 bit': (
        'ms,J_W,position_m\n' + rows(lambda k, _, p, x: f'{(60_000 + 50 * k) % 65536},{p},{x:.15f}'),
        'time_s: {column: ms, scale: 0.001}\n',
        '16-bit counter',
    ),
    'trailing commas': (PLAIN.partition('\n')[0] + '\n' + BODY.replace('\n', ',\n'), '', ''),
    'trailing commas in all rows': (PLAIN.replace('\n', ',,\n'), '', ''),
    'trailing semicolons': ('time_s;J_W;position_m;\n' + cells(';', ',', ';'), '', 'decimals have commas'),
    'units in brackets': (
        'Time [s],Power [W],Way (mm)\n' + rows(lambda _, t, p, x: f'{t},{p},{1e3 * x:.15f}'),
        'time_s: "Time [s]"\nJ_W: "Power [W]"\nposition_m: {column: "Way (mm)", scale: 0.001}\n',
        '',
    ),
    'spaces after commas': (PLAIN.replace(',', ', '), '', ''),
    'quoted numbers': ('"time_s","J_W","position_m"\n' + rows(lambda _, t, p, x: f'"{t}","{p}","{x:.15f}"'), '', ''),
    'plotjuggler': (
        '__time,/cmd/J,/slider/x\n' + rows(lambda _, t, p, x: f'{1669882837 + t:.6f},{p},{x:.15f}'),
        'time_s: __time\nJ_W: /cmd/J\nposition_m: /slider/x\n',
        'counted from the first row',
    ),
    'time zone': (
        'time,J_W,position_m\n' + rows(lambda _, t, p, x: f'2026-07-31T21:16:{9 + t:05.2f}+0200,{p},{x:.15f}'),
        'time_s: time\n',
        'counted from the first row',
    ),
    'fixed width': (
        f'{"time_s":>12}{"J_W":>12}{"position_m":>20}\n' + rows(lambda _, t, p, x: f'{t:12.4f}{p:12.4f}{x:20.15f}'),
        '',
        'separated by spaces',
    ),
    'plus signs': (PLAIN.partition('\n')[0] + '\n' + rows(lambda _, t, p, x: f'+{t},+{p},+{x:.15f}'), '', ''),
    'line ends of three systems': (
        ''.join(line + ('\n', '\r\n', '\r')[k % 3] for k, line in enumerate(PLAIN.splitlines())),
        '',
        '',
    ),
    'carriage returns doubled': (PLAIN.replace('\n', '\r\r\n'), '', ''),
    'mark, quotes and a row of units with degrees': (
        '\ufeff"Time";"Power";"Way";"Temp"\r\n"[s]";"[W]";"[mm]";"[°C]"\r\n'
        + rows(lambda k, t, p, x: f'{t};{p};{1e3 * x:.15f};{20 + 0.01 * k:.2f}'.replace('.', ',')),
        'time_s: Time\nJ_W: Power\nposition_m: {column: Way, scale: 0.001}\nT_K: {column: Temp, offset: 273.15}\n',
        'row of units',
    ),
    'a line end in a quoted name': ('"Time\n(s)",J_W,position_m\n' + BODY, 'time_s: Time (s)\n', ''),
    'quotes in a quoted name': ('"time ""raw""",J_W,position_m\n' + BODY, 'time_s: time "raw"\n', ''),
    'seconds since 1970': (
        PLAIN.partition('\n')[0] + '\n' + rows(lambda _, t, p, x: f'{1e9 + t:.2f},{p},{x:.15f}'),
        '',
        'counted from the first row, 1000000000.000 s',
    ),
    'means below the table': (PLAIN + ',0.5,0.0011\n', '', '1 row without a time: dropped'),
    'newest row first': (PLAIN.partition('\n')[0] + '\n' + '\n'.join(ROWS[::-1]) + '\n', '', 'sorted'),
    'line at the end': (PLAIN + '\nEnd of data\n', '', 'last line is incomplete'),
    'each row twice': (PLAIN.partition('\n')[0] + '\n' + ''.join(2 * f'{row}\n' for row in ROWS), '', 'repeat the time'),
    'labview without a column of time, its interval in the map': (
        LABVIEW.format(decimal='.') + rows(lambda _, t, p, x: f'\t{p:.3f}\t{x:.15f}\t'),
        'time_s: {interval: 0.05}\nJ_W: Power\nposition_m: Way\n',
        '14 lines above',
    ),
    'catman': (
        CATMAN + rows(lambda _, t, p, x: f'{t:.3f}\t{p}\t{x:.15f}'),
        'time_s: Time  1 - default sample rate\nJ_W: Power\nposition_m: Way\n',
        "5 lines above the numbers are no table, among them 'SR=20 HZ SR=20 HZ SR=20 HZ'",
    ),
    'keysight benchlink': (
        KEYSIGHT
        + rows(
            lambda k, t, p, x: (
                f'{k + 1},07/31/2026 21:16:{int(9 + t):02d}:{round(1000 * (t % 1)):03d},{p:+.6E},0,{x:+.12E},0'
            )
        ),
        'time_s: Time\nJ_W: {column: 101 (VDC), scale: 1}\nposition_m: {column: 102 (VDC), scale: 1}\n',
        'columns not used: Scan, Alarm 101',
    ),
    'diadem': (
        DIADEM + rows(lambda k, t, p, x: f'{k + 1};{t:.3f};{p};{x:.15f}'.replace('.', ',')),
        FOREIGN,
        'the row of units is no sample; 4 lines above',
    ),
    'units in words': (
        'Time;Power;Way\nSekunden;Watt;Meter\n' + rows(lambda _, t, p, x: f'{t:.2f};{p};{x:.12f}'),
        FOREIGN,
        'the row of units is no sample',
    ),
    'times of day over midnight': ('Time,Power,Way\n' + rows(over_midnight), FOREIGN, 'starts again after 86400 s'),
    'a date beside times of day': (
        'Date,Time,Power,Way\n' + rows(lambda *one: f'2026-07-{31 if one[1] < 5 else 1},{over_midnight(*one)}'),
        FOREIGN,
        'columns not used: Date',
    ),
    'times of day with halves': (
        'Time,Power,Way\n'
        + rows(lambda _, t, p, x: f'{12 if t < 5 else 1}:{"59" if t < 5 else "00"}:{(55 + t) % 60:06.3f} PM,{p},{x:.12f}'),
        FOREIGN,
        '',
    ),
    'days before months': (
        'time;J_W;position_m\n'
        + rows(lambda _, t, p, x: f'31.07.2026 21:16:{9 + t:06.3f};{p};{x:.12f}'.replace('.', ',').replace(',07,', '.07.')),
        'time_s: time\n',
        'counted from the first row',
    ),
    'months before days': (
        'time,J_W,position_m\n' + rows(lambda _, t, p, x: f'7/31/2026 21:16:{9 + t:06.3f},{p},{x:.12f}'),
        'time_s: time\n',
        'counted from the first row',
    ),
    'slashes after the year': (
        'time,J_W,position_m\n' + rows(lambda _, t, p, x: f'2026/07/31 21:16:{9 + t:06.3f},{p},{x:.12f}'),
        'time_s: time\n',
        'counted from the first row',
    ),
    'durations of pandas': (
        'time,J_W,position_m\n' + rows(lambda _, t, p, x: f'0 days 00:00:{t:09.6f},{p},{x:.12f}'),
        'time_s: time\n',
        '',
    ),
    'months before days, told after midnight': (
        'time,J_W,position_m\n'
        + rows(lambda _, t, p, x: f'{"12/12" if t < 5 else "12/13"}/2026 {over_midnight(_, t, p, x)}'),
        'time_s: time\n',
        'counted from the first row',
    ),
    'matlab datetime': (
        'Time,J_W,position_m\n' + rows(lambda _, t, p, x: f'31-Jul-2026 21:16:{9 + t:06.3f},{p},{x:.12f}'),
        'time_s: Time\n',
        'counted from the first row',
    ),
    'matlab timetable': (
        'Time,J_W,position_m\n' + rows(lambda _, t, p, x: f'{t:.12g} sec,{p},{x:.12f}'),
        'time_s: Time\n',
        '',
    ),
    'matlab duration': (
        'Time,J_W,position_m\n' + rows(lambda _, t, p, x: f'00:00:{t:06.3f},{p},{x:.12f}'),
        'time_s: Time\n',
        '',
    ),
    'clock set back in autumn': (
        'Time,Power,Way\n' + rows(lambda k, t, p, x: f'2026-10-25 02:{59 * (t < 5):02d}:{(55 + t) % 60:06.3f},{p},{x:.12f}'),
        FOREIGN,
        'the clock is set by an hour',
    ),
    'clock set forward in spring': (
        'Time,Power,Way\n'
        + rows(lambda k, t, p, x: f'2026-03-29 {"01:59" if t < 5 else "03:00"}:{(55 + t) % 60:06.3f},{p},{x:.12f}'),
        FOREIGN,
        'the clock is set by an hour',
    ),
    'millis in seconds': (
        's,J_W,position_m\n' + rows(lambda k, _, p, x: f'{(2**32 - 2000 + 50 * k) % 2**32 / 1000:.3f},{p},{x:.12f}'),
        'time_s: s\n',
        'counted on',
    ),
    'micros in seconds': (
        's,J_W,position_m\n' + rows(lambda k, _, p, x: f'{(2**32 - 2000000 + 50000 * k) % 2**32 / 1e6:.6f},{p},{x:.12f}'),
        'time_s: s\n',
        'counted on',
    ),
    'milliseconds of 16 bit in seconds': (
        's,J_W,position_m\n' + rows(lambda k, _, p, x: f'{(60000 + 50 * k) % 65536 / 1000:.3f},{p},{x:.12f}'),
        'time_s: s\n',
        'starts again after 65.536 s',
    ),
    'seconds of the minute': (
        's,J_W,position_m\n' + rows(lambda _, t, p, x: f'{(55 + t) % 60:.3f},{p},{x:.12f}'),
        'time_s: s\n',
        'starts again after 60 s',
    ),
    'one time for each channel': (
        'Time,Power,Time,Way\n' + rows(lambda _, t, p, x: f'{t:.2f},{p},{t:.2f},{x:.12f}'),
        FOREIGN,
        '',
    ),
    'letters of windows far below': (
        PLAIN.encode() + b'#\n' * 600_000 + b'# 25 \xb0C\n',
        '',
        'letters are those of Windows',
    ),
    'a comma behind the last name': (PLAIN.replace('\n', ',\n', 1), '', ''),
    'letters of windows': (
        'time_s;J_W;position_m;T [°C]\n'.encode('cp1252') + cells(';', end=';20.5').encode(),
        '',
        'letters are those of Windows',
    ),
    'rows without a time': (
        'J_W,position_m\n' + rows(lambda _, t, p, x: f'{p},{x:.12f}'),
        'time_s: {interval: 0.05}\n',
        '',
    ),
    'numbers of rows': (
        'sample,J_W,position_m\n' + rows(lambda k, _, p, x: f'{k},{p},{x:.12f}'),
        'time_s: {column: sample, scale: 0.05}\n',
        '',
    ),
    'column on': ('time_s,on,position_m\n' + BODY, 'J_W: {column: "on"}\n', ''),
}

REFUSED = {  # content, map, what is said
    'days or months': (
        'time,J_W,position_m\n' + rows(lambda _, t, p, x: f'07/08/2026 21:16:{9 + t:06.3f},{p},{x:.12f}'),
        'time_s: time\n',
        'nobody can tell the day from the month',
    ),
    'minutes and seconds': (
        'time,J_W,position_m\n' + rows(lambda _, t, p, x: f'{int(t // 60):02d}:{t % 60:06.3f},{p},{x:.12f}'),
        'time_s: time\n',
        "got '00:00.000'; of dates and times of day 2026-07-31 21:16:09.05 and 21:16:09.05 are read",
    ),
    'no time at all': (
        'Power,Way\n' + rows(lambda _, t, p, x: f'{p},{x:.9f}'),
        'J_W: Power\nposition_m: Way\n',
        'if no column holds the time and rows are regular, a map says so: time_s: {interval: SECONDS}',
    ),
    'an interval of nothing': (
        BODY,
        'time_s: {interval: 0}\n',
        'time_s: expected {interval: SECONDS} between rows, more than 0',
    ),
    'fast counter of 16 bit': (
        'us,J_W,position_m\n' + rows(lambda k, _, p, x: f'{(60_000 + 50_000 * k) % 65536},{p},{x:.12f}'),
        'time_s: {column: us, scale: 1.0e-6}\n',
        'time is a 16-bit counter that starts again every few rows',
    ),
    'two times that differ': (
        'Time,Power,Time,Way\n' + rows(lambda _, t, p, x: f'{t:.2f},{p},{t + 0.01:.2f},{x:.12f}'),
        FOREIGN,
        'has column Time more than once, with different cells: rename all but one',
    ),
    'switch in words of yaml': (PLAIN.replace('J_W', 'on'), 'J_W: on\n', 'YAML reads on, off, yes and no so; quote it'),
    'nanoseconds in a foreign column': (
        't,J_W,position_m\n' + rows(lambda k, _, p, x: f'{1669882837000000000 + 50000000 * k},{p},{x:.9f}'),
        'time_s: t\n',
        'time_s: {column: t, scale: 1e-09}',
    ),
    'fluke': (
        FLUKE + rows(lambda k, t, _, x: f'{k + 1},31/07/2026 21:16:{9 + t:06.3f},{x:.6f} V,Interval'),
        'time_s: Start Time\nposition_m: Average\nJ_W: {value: 0.0}\n',
        "row 4, column Average: expected a number, got '0.000400 V'; write the number alone",
    ),
    'lost bytes of a serial line': (
        'ms,J_W,position_m\n'
        + rows(lambda k, _, p, x: f'{1000 + 50 * k},{p}' if k == 77 else f'{1000 + 50 * k},{p},{x:.9f}'),
        'time_s: {column: ms, scale: 0.001}\n',
        'row 79, column position_m: expected a number',
    ),
    'picoscope': (
        'Time,A,B\n(ms),(V),(m)\n\n' + BODY,
        'time_s: Time\nJ_W: A\nposition_m: B\n',
        'says ms, expected s for time_s; a map (--map) can convert: time_s: {column: Time, scale: 0.001}',
    ),
    'labels in each row': (rows(lambda _, t, p, x: f'time:{t:.3f}\tJ:{p}\tx:{x:.9f}'), '', 'write the names of the columns'),
    'stamps of a serial monitor': (
        rows(lambda _, t, p, x: f'21:16:{9 + t:06.3f} -> {p},{x:.9f}'),
        '',
        'write the names of the columns',
    ),
    'no header': (
        BODY,
        '',
        'row 1: expected the names of the columns, got numbers: 0, 0, 0.0004; write the names of the columns above them, or '
        'in a map (--map), from left to right: columns: [NAME_1, NAME_2, NAME_3]',
    ),
    'no header, decimal commas and dates': (
        rows(lambda _, t, p, x: f'2026-07-31 21:16:{9 + t:06.3f};{p:.3f};{x:.9f}'.replace('.', ',')),
        '',
        'or in a map (--map), from left to right: columns: [NAME_1, NAME_2, NAME_3]',
    ),
    'no header, decimal commas between spaces': (cells(' ', ','), '', 'columns: [NAME_1, NAME_2, NAME_3]'),
    'no header, many columns': (rows(lambda *_: '0,1,2,3,4,5,6'), '', 'columns: [NAME_1, NAME_2, ...]'),
    'no header below a description': (
        'Bench 3\n' + BODY,
        '',
        'if no line has the names of the columns, write them above the numbers, or in a map (--map), from left to right',
    ),
    'fewer names in a map than columns': (
        BODY,
        'columns: [time_s, J_W]\n',
        "has no rows of 2 numbers, as many as columns of the map has names: time_s, J_W; its first line is '0,0,0.0004'",
    ),
    'more names in a map than columns': (BODY, 'columns: [time_s, J_W, position_m, T_K]\n', 'has no rows of 4 numbers'),
    'names in a map in another order': (
        PLAIN,
        'columns: [J_W, time_s, position_m]\n',
        'names of its own, time_s, J_W, position_m, in another order than columns of the map, J_W, time_s, position_m',
    ),
    'names in a map in another order than in a comment': (
        '# ' + PLAIN,
        'columns: [time_s, position_m, J_W]\n',
        'names of its own, time_s, J_W, position_m, in another order',
    ),
    'no names in a map': (
        BODY,
        'columns: time_s\n',
        "columns: expected the names of all columns from left to right, such as",
    ),
    'a number in a map': (BODY, 'columns: [time_s, 1, position_m]\n', "got ['time_s', 1, 'position_m']"),
    'a name twice in a map': (BODY, 'columns: [a, a, position_m]\n', 'columns: a is there twice'),
    'a unit in a name of a map': (
        BODY,
        'columns: [time_s, J_W, x_mm]\nposition_m: x_mm\n',
        'column x_mm: its name says mm, expected m',
    ),
    'tektronix': (
        'Record Length,2.5e3,,0,0.1,0.2\n' + rows(lambda _, t, p, x: f',,,{t},{p},{x:.9f}'),
        '',
        'write the names of the columns',
    ),
    'rigol': (
        'X,CH1,CH2,Start,Increment\nSequence,Volt,Volt,0.0e+00,5.0e-02\n' + rows(lambda k, _, p, x: f'{k},{p},{x:.9f},,'),
        'time_s: X\nJ_W: CH1\nposition_m: CH2\n',
        "row 2, column X: expected a number, got 'Sequence'; leave the cell empty where nothing was",
    ),
    'two tables': (
        'Results 1\n,"Load","Way"\n,"(N)","(mm)"\n1,10.5,2.3\n\n"Time","Way","Power"\n"(s)","(mm)","(W)"\n' + BODY,
        FOREIGN,
        'has numbers above the names Time, Way, Power too: save each table in a file',
    ),
    'header again': (PLAIN + PLAIN, '', f"row {COUNT + 2}, column time_s: expected a number, got 'time_s'; the names"),
    'index of dates': (
        ',J_W,position_m\n' + rows(lambda _, t, p, x: f'2026-07-31 21:16:{9 + t:09.6f},{p},{x:.9f}'),
        '',
        'its first column has no name: write time_s above it',
    ),
    'dates without fractions': (
        'time,J_W,position_m\n' + rows(lambda _, t, p, x: f'2026-07-31 21:16:{int(9 + t):02d},{p},{x:.9f}'),
        'time_s: time\n',
        f'got 10 times in {COUNT} rows: record or export it with its fractions of a second',
    ),
    'milliseconds since 1970 as seconds': (
        PLAIN.partition('\n')[0] + '\n' + rows(lambda k, _, p, x: f'{1669882837000 + 50 * k},{p},{x:.9f}'),
        '',
        'looks like milliseconds; a map (--map) can convert: time_s: {column: time_s, scale: 0.001}',
    ),
    'nanoseconds since 1970 as seconds': (
        PLAIN.partition('\n')[0] + '\n' + rows(lambda k, _, p, x: f'{1669882837000000000 + 50000000 * k},{p},{x:.9f}'),
        '',
        'looks like nanoseconds; a map (--map) can convert: time_s: {column: time_s, scale: 1e-09}',
    ),
    'days of a spreadsheet': (
        PLAIN.partition('\n')[0] + '\n' + rows(lambda _, t, p, x: f'{46234.8862 + t / 86400:.12f},{p},{x:.9f}'),
        '',
        'looks like days, as spreadsheets count them; a map (--map) can convert: time_s: {column: time_s, scale: 86400}',
    ),
    'days or months after midnight': (
        'time,J_W,position_m\n' + rows(lambda *one: f'07/0{7 if one[1] < 5 else 8}/2026 {over_midnight(*one)}'),
        'time_s: time\n',
        'nobody can tell the day from the month',
    ),
    'days of a spreadsheet, two minutes': (
        PLAIN.partition('\n')[0] + '\n' + rows(lambda _, t, p, x: f'{46234.88 + 12 * t / 86400:.12f},{p},{x:.9f}'),
        '',
        'looks like days, as spreadsheets count them; a map (--map) can convert: time_s: {column: time_s, scale: 86400}',
    ),
    'milliseconds in a map without scale': (
        PLAIN.replace('time_s', 't_ms'),
        'time_s: t_ms\n',
        'its name says ms, expected s for time_s; a map (--map) can convert',
    ),
    'millimetres in a map without scale': (
        PLAIN.replace('position_m', 'x [mm]'),
        'position_m: x [mm]\n',
        'can convert: position_m: {column: "x [mm]", scale: 0.001}',
    ),
    'a column twice': (PLAIN.replace('position_m', 'position_m,position_m'), '', 'column position_m more than once'),
    'separators of thousands in quotes': (
        PLAIN.partition('\n')[0] + '\n' + rows(lambda _, t, p, x: f'"{1000 + t:,.2f}",{p},{x:.9f}'),
        '',
        "got '1,000.00'; write the number alone, without a unit or separators of thousands",
    ),
    'apostrophes between thousands': (
        'time_s;J_W;position_m\n' + rows(lambda _, t, p, x: f"1'{t:06.2f};{p};{x:.9f}"),
        '',
        'or separators of thousands',
    ),
    'points between thousands': (
        'time_s;J_W;position_m\n' + rows(lambda _, t, p, x: f'1.{200 + int(t)},{t % 1:.2f};{p};{x:.9f}'.replace('0.', '0,')),
        '',
        'or separators of thousands',
    ),
    'points between thousands of whole numbers': (
        't;J_W;x\n' + rows(lambda k, _, p, x: f'{1000 + 50 * k:,};{int(p)};{int(1e9 * x)}'.replace(',', '.')),
        'time_s: {column: t, scale: 0.001}\nposition_m: {column: x, scale: 1.0e-9}\n',
        '1.000 has a decimal point or a separator of thousands',
    ),
    'spaces between thousands': (
        'time_s;J_W;position_m\n' + rows(lambda _, t, p, x: f'1\u00a0{200 + t:.2f};{p};{x:.9f}'.replace('.', ',')),
        '',
        'or separators of thousands',
    ),
    'labview without a column of time': (
        LABVIEW.format(decimal='.') + rows(lambda _, t, p, x: f'\t{p:.3f}\t{x:.9f}\t'),
        FOREIGN,
        'column Time: expected seconds, got no number; if rows are regular, a map says how far apart they are: time_s',
    ),
    'statistics below the table': (PLAIN + 'Mean,0.5,0.001\nMax,2,0.002\n', '', 'or delete a row that is no sample'),
    'remarks below the table': (PLAIN + '\nOperator: A. B.\nMax;0.1\n', '', "expected a number, got 'Operator: A. B.'"),
    'stamps of single precision': (
        PLAIN.partition('\n')[0] + '\n' + rows(lambda _, t, p, x: f'{np.float32(1e9 + t):.2f},{p},{x:.9f}'),
        '',
        'record or export it with its fractions of a second',
    ),
    'per cent in cells': (PLAIN.replace('1.2', '1.2%'), '', 'write the number alone, without a unit'),
    'minus sign of typesetters': (PLAIN.replace(',0,', ',\u22120,'), '', 'expected a number'),
    'units in cells': (
        PLAIN.partition('\n')[0] + '\n' + rows(lambda _, t, p, x: f'{t} s,{p} W,{x:.9f} m'),
        '',
        'write the number alone, without a unit',
    ),
    'foreign names': (
        'Time [s],Power [W],Position [mm]\n' + BODY,
        '',
        'J_W: {column: "Power [W]", scale: 1}; position_m: {column: "Position [mm]", scale: 0.001}',
    ),
    'number of the sample': (PLAIN.replace('time_s', 'sample'), '', 'a map, --map, says which column is which'),
    'overload of a multimeter': (with_cell('OVLD'), '', 'leave the cell empty where nothing was measured'),
    'decimal commas in quotes': (
        PLAIN.partition('\n')[0] + '\n' + rows(lambda _, t, p, x: f'"{t}","{p}","{x:.9f}"'.replace('.', ',')),
        '',
        'column',
    ),
    'tdms': (b'TDSm\x0e\0\0\0' + bytes(range(256)), '', 'not a CSV file: it is binary; export the table as CSV in UTF-8'),
    'gzip': (gzip.compress(PLAIN.encode()), '', 'is packed: unpack it'),
    'zip': (b'PK\x03\x04' + bytes(200), '', 'is packed: unpack it'),
    'row names of R': (
        PLAIN.partition('\n')[0] + '\n' + rows(lambda k, *one: f'{k},{one[0]},{one[1]},{one[2]:.9f}'),
        '',
        'as R',
    ),
    'a word of a logger': (PLAIN + 'WARN: timeout,,\n', '', 'delete a row that is no sample'),
    'a formula that failed': (with_cell('#DIV/0!'), '', 'a formula of a spreadsheet failed there'),
    'bytes that are 0': (PLAIN + '\0\0,0,0\n', '', 'the file was not written to its end'),
    'a clock that was set': (
        PLAIN.partition('\n')[0] + '\n' + rows(lambda _, t, p, x: f'{t + 1.785e9 * (t > 1):.2f},{p},{x:.9f}'),
        '',
        'got 1 s and then 1785000001.05 s: the clock was set there; delete the 21 rows before',
    ),
    'power of the other sign': (
        PLAIN.partition('\n')[0] + '\n' + rows(lambda _, t, p, x: f'{t:.2f},{-p},{x:.9f}'),
        '',
        'which looks like the wrong sign; a map (--map) can convert: J_W: {column: J_W, scale: -1}',
    ),
    'a mark of missing samples': (
        PLAIN.partition('\n')[0] + '\n' + rows(lambda k, t, p, x: f'{t:.2f},{p},{-999 if k % 5 == 0 else x:.9f}'),
        '',
        '-999 in 40 rows is no value in m, all others are; where it stands for none, leave these cells empty',
    ),
    'old workbook': (b'\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1' + bytes(500), '', 'not a CSV file: it is binary'),
    'json': ('{"time_s":0,"J_W":0,"position_m":0.0004}\n' * COUNT, '', 'it is HTML or JSON; export the table as CSV'),
    'html': ('<html><table><tr><td>time_s</td></tr></table></html>\n', '', 'it is HTML or JSON; export the table as CSV'),
}


def written(tmp_path, content, mapping):
    path, way = tmp_path / 'run.csv', tmp_path / 'map.yaml'
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    way.write_text(f'system: slider\n{mapping}')
    return read_recording(path, 'slider', 298.0, way)


@pytest.mark.parametrize('kind', READ)
def test_is_read_as_the_plain_table(tmp_path, kind):
    content, mapping, said = READ[kind]
    check_plain(written(tmp_path, content, mapping), said, atol=1e-6)


@pytest.mark.parametrize('kind', REFUSED)
def test_is_refused_with_the_cure(tmp_path, kind):
    content, mapping, said = REFUSED[kind]
    with pytest.raises(UserError) as caught:
        written(tmp_path, content, mapping)
    message = str(caught.value)
    assert said in message
    assert message.isprintable()
    assert len(message) < 600


@pytest.mark.parametrize('word', ['NaN', '-nan', 'NA', 'N/A', '#N/A', '#NV', 'null', 'None', '<NA>', '-1.#IND', '1.#QNAN'])
def test_words_for_missing_values(tmp_path, word):
    (recording,) = written(tmp_path, with_cell(word), '')
    known = np.isfinite(recording.channels['position'])
    assert np.allclose(recording.time[known], np.delete(TIME, 50))
    assert np.allclose(recording.channels['position'][known], np.delete(POSITION, 50))


def test_overload_by_scpi_is_missing(tmp_path):
    (recording,) = written(tmp_path, with_cell('9.9E+37'), '')
    assert np.isnan(recording.channels['position'][recording.time == TIME[50]]).all()
    assert '1 infinite values: taken as missing' in ' '.join(recording.notes)


def test_numbers_of_rows_as_times_are_said(tmp_path):
    content = 'sample,J_W,position_m\n' + rows(lambda k, _, p, x: f'{k},{p},{x:.12f}')
    (recording,) = written(tmp_path, content, 'time_s: sample\n')
    assert 'if it numbers the rows, a map says how long one lasts' in ' '.join(recording.notes)


def test_sessions_of_a_minute_are_no_clock(tmp_path):
    times = np.tile(np.arange(0.0, 60.0, 0.5), 2)
    content = 'time_s,J_W,position_m\n' + ''.join(f'{t},0,{1e-3 * np.sin(t):.9f}\n' for t in times)
    assert len(written(tmp_path, content, '')) == 2


TWO_RATES = 'Time,Power,Way,{second},Temp\n' + rows(
    lambda k, t, p, x: f'{t},{p},{x:.12f},' + (f'{TIME[5 * k] + 0.01:.2f},{20 + k}' if 5 * k < COUNT else ',')
)


@pytest.mark.parametrize('second', ['Time2', 'Time.1', 'Zeit [s]'])
def test_a_channel_of_another_rate_is_not_placed_by_the_time_of_the_others(tmp_path, second):
    """It would be over in a fifth of the time."""
    content = TWO_RATES.format(second=second)
    with pytest.raises(UserError, match=f'Temp: has values in 40 rows.*time: "?{re.escape(second)}"?}}, or say time: Time'):
        written(tmp_path, content, FOREIGN + 'T_K: {column: Temp, offset: 273.15}\n')
    way = FOREIGN + f'T_K: {{column: Temp, offset: 273.15, time: "{second}"}}\n'
    (recording,) = written(tmp_path, content, way)
    known = np.isfinite(recording.channels['T'])
    assert np.allclose(recording.time[known], TIME[::5] + 0.01)
    assert np.allclose(recording.channels['T'][known], 293.15 + np.arange(40))
    known = np.isfinite(recording.channels['position'])
    assert np.allclose(recording.time[known], TIME) and np.allclose(recording.channels['position'][known], POSITION)
    assert np.array_equal(recording.source.values[:, 0], written(tmp_path, PLAIN, '')[0].source.values[:, 0])


def test_a_channel_that_ends_early_has_the_time_of_the_others_where_a_map_says_so(tmp_path):
    way = FOREIGN + 'T_K: {column: Temp, offset: 273.15, time: Time}\n'
    (recording,) = written(tmp_path, TWO_RATES.format(second='Time2'), way)
    assert np.allclose(recording.time[np.isfinite(recording.channels['T'])], TIME[:40])


def test_a_command_has_no_time_of_its_own(tmp_path):
    with pytest.raises(UserError, match='time belongs to measured columns, position_m, .*not to J_W'):
        written(
            tmp_path, TWO_RATES.format(second='Time2'), FOREIGN.replace('J_W: Power', 'J_W: {column: Power, time: Time2}')
        )


def blocks(size, clock):
    """Rows in blocks whose time starts again at 0; `clock`: what the first row of each has beside."""

    def form(k, _, p, x):
        time_of_block = [f'{1000 * TIME[k]:.0f}' if k % size == 0 else ''] if clock else []
        return ','.join([f'{1e-5 * (k % size):g}', f'{p}', f'{x:.12f}', *time_of_block])

    return ','.join(['X_Value', 'J_W', 'position_m', *([clock] if clock else [])]) + '\n' + rows(form)


@pytest.mark.parametrize(
    ('size', 'clock', 'said'),
    [
        (2, 'Untitled', 'Untitled has a later value in the first row of each.*time_s: {column: Untitled, scale: FACTOR}'),
        (20, 'clock_ms', 'starts again at 0 9 times in 200 rows.*time_s: {column: clock_ms, scale: 0.001}'),
        (2, '', 'starts again at 0 99 times in 200 rows, as the time within blocks.*time_s: {interval: SECONDS}'),
    ],
)
def test_a_time_within_blocks_of_samples_is_not_the_time(tmp_path, size, clock, said):
    with pytest.raises(UserError, match=said):
        written(tmp_path, blocks(size, clock), 'time_s: {column: X_Value, scale: 1}\n')
    line = f'{{column: {clock}, scale: 0.001}}' if clock else '{interval: 0.05}'
    (recording,) = written(tmp_path, blocks(size, clock), f'time_s: {line}\n')
    assert np.allclose(recording.time, TIME[::size] if clock else TIME)


def test_sessions_with_their_number_beside_are_no_blocks(tmp_path):
    """A number of the session stands in each row."""
    content = rows(lambda k, _, p, x: f'{0.05 * (k % 20):g},{p},{x:.12f},{k // 20}')
    assert len(written(tmp_path, 'time_s,J_W,position_m,cycle\n' + content, '')) == 10
