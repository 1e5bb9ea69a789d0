"""Units that a table states, in names and in rows of units: converted by a map, or refused by every reader."""

import numpy as np
import pytest
from test_table_formats import POSITION, POWER, TIME, check_plain, read, refused, table

from sma_sim.cli.main import main
from sma_sim.evidence.data.foreign_columns import hint_for_all, likely_line
from sma_sim.evidence.data.recordings import read_dataset, read_recording
from sma_sim.evidence.data.stated_units import in_yaml
from sma_sim.evidence.data.time_formats import seconds_reader
from sma_sim.model.errors import UserError
from sma_sim.model.expected_units import mismatch_of


@pytest.mark.parametrize(
    ('words', 'row'),
    [
        (('simulate', '--system', 'slider', '--input', 'CSV', '--out', 'OUT.csv'), '[s],[mW],[m]'),
        (('simulate', '--system', 'slider', '--input', 'CSV', '--out', 'OUT.csv'), '[ms],[W],[m]'),
        (('play', 'CSV'), 's,mW,m'),
        (('bag', 'convert', 'CSV', 'OUT.mcap'), '[s],[W],[mm]'),
    ],
)
def test_every_reader_refuses_a_row_of_other_units(tmp_path, capsys, words, row):
    path = tmp_path / 'run.csv'
    path.write_text(table(TIME, POWER, POSITION, below=f'{row}\n'))
    assert main([word.replace('CSV', str(path)).replace('OUT', str(tmp_path / 'out')) for word in words]) == 2
    unit = next(one.strip('[]') for one in row.split(',') if one.strip('[]') not in ('s', 'W', 'm'))
    assert f'the row of units says {unit}, expected ' in (said := capsys.readouterr().err) and 'multiply by 0.001' in said


NAMES_WITH_UNITS = [  # of ours, of the file, what a map says beside its column
    ('F_N', 'Force [lbf]', 'scale: 4.448221615'),
    ('F_N', 'force_gf', 'scale: 0.00980665'),
    ('F_N', 'load kgf', 'scale: 9.80665'),
    ('F_N', 'Force (cN)', 'scale: 0.01'),
    ('F_N', 'force_V', 'scale: FACTOR'),
    ('F_N', 'Load cell (counts)', 'scale: FACTOR'),
    ('position_m', 'position_in', 'scale: 0.0254'),
    ('position_m', 'Stroke [inch]', 'scale: 0.0254'),
    ('position_m', 'Position [μm]', 'scale: 1e-06'),
    ('time_s', 'clock [h]', 'scale: 3600'),
    ('time_s', 'Time (msec)', 'scale: 0.001'),
    ('time_s', 'Time (µs)', 'scale: 1e-06'),
    ('time_s', 'millis', 'scale: 0.001'),
    ('J_W', 'heater [kW]', 'scale: 1000'),
    ('J_W', 'heater [%]', 'scale: WATTS_AT_1_PERCENT'),
    ('J_W', 'heater [duty]', 'scale: FACTOR'),
    ('J_W', 'power_duty', 'scale: FACTOR'),
    ('T_K', 'Temperature [℃]', 'offset: 273.15'),
    ('T_K', 'temperature_F', 'scale: 0.5555555556, offset: 255.3722222'),
    ('R_ohm', 'R_kohm', 'scale: 1000'),
]


@pytest.mark.parametrize(('name', 'column', 'how'), NAMES_WITH_UNITS)
def test_a_unit_in_a_name_is_converted_or_refused(tmp_path, name, column, how):
    ours = {'time_s': TIME, 'J_W': POWER, 'position_m': POSITION}
    text = table(*({name: TIME} | ours).values(), header=[column if one == name else one for one in {name: 0} | ours])
    line = f'{name}: {{column: {in_yaml(column)}, {how}}}'
    refused(tmp_path, text, f'{name}: {in_yaml(column)}\n', 'its name says', line, '(scale: 1 where that is no unit)')


def test_what_a_map_says_wins(tmp_path):
    text = table(TIME, POWER, 1.0 + TIME, POSITION, header=('time_s', 'J_W', 'F_g', 'position_m'))
    (recording,) = read(tmp_path, text, 'F_N: {column: F_g, scale: 1}\n')
    assert recording.channels['F'][0] == 1.0
    assert 'the map converts other than from the unit stated: F_g (g)' in recording.notes
    text = table(TIME, POWER, 300.0 + TIME, POSITION, header=('time_s', 'J_W', 'T_C', 'position_m'))
    (recording,) = read(tmp_path, text, 'T_K: {column: T_C, scale: 1, offset: 0}\n')
    assert recording.channels['T'][0] == 300.0


@pytest.mark.parametrize('names', [('position[0]', '/cmd/J', '__time'), ('Way (wire 1)', 'P_1', 't'), ('F_2', 'U_x', 't')])
def test_names_without_a_unit_are_noted(tmp_path, names):
    position, power, time = names
    text = table(TIME, POWER, POSITION, header=(time, power, position))
    mapping = f'time_s: {{column: {time}, scale: 1}}\nJ_W: {power}\nposition_m: "{position}"\n'
    check_plain(read(tmp_path, text, mapping), f'no unit stated: {time!r} in s, {power!r} in W, {position!r} in m assumed')


def test_a_strain_without_a_unit_is_a_fraction(tmp_path):
    (tmp_path / 'pull.csv').write_text(table(TIME, POSITION, 1e8 + TIME, header=('Tiempo', 'Deformación', 'stress_Pa')))
    (tmp_path / 'map.yaml').write_text('time_s: Tiempo\nstrain: Deformación\n')
    (pull,) = read_recording(tmp_path / 'pull.csv', 'wire', 298.0, tmp_path / 'map.yaml')
    assert "no unit stated: 'Tiempo' in s, 'Deformación' as a fraction assumed" in pull.notes


@pytest.mark.parametrize(
    ('voltage', 'current', 'scale'),
    [('voltage_V', 'current_mA', 'scale: 0.001'), ('U [mV]', 'I [mA]', 'scale: 1e-06'), ('duty [%]', 'U_V', 'scale: 0.01')],
)
def test_the_names_of_a_product_state_its_scale(tmp_path, voltage, current, scale):
    text = table(TIME, POWER, 0.0 * TIME + 1.0, POSITION, header=('time_s', voltage, current, 'position_m'))
    cure = f'J_W: {{column: {in_yaml(voltage)}, times: {in_yaml(current)}, {scale}}}'
    refused(
        tmp_path, text, f'J_W: {{column: {in_yaml(voltage)}, times: {in_yaml(current)}}}\n', 'is a product without', cure
    )
    assert len(read(tmp_path, text, f'{cure}\n')) == 1


@pytest.mark.parametrize(
    ('name', 'header', 'line'),
    [
        ('J_W', ['power_supply_V', 'current_A'], '{column: power_supply_V, times: current_A}'),
        ('J_W', ['voltage_V', 'current_mA'], '{column: voltage_V, times: current_mA, scale: 0.001}'),
        ('J_W', ['fan_power', 'heater'], '{column: heater, scale: 1}'),
        ('J_W', ['Time(sec)', 'PWM(%)'], '{column: PWM(%), scale: WATTS_AT_1_PERCENT}'),
        ('J_W', ['heater duty [%]', 'fan PWM (%)'], '{column: "heater duty [%]", scale: WATTS_AT_1_PERCENT}'),
        ('J_eq_W', ['pwm'], '{column: pwm, scale: FACTOR}'),
        ('J_2_W', ['pwm1 (%)', 'pwm2 (%)'], '{column: pwm2 (%), scale: WATTS_AT_1_PERCENT}'),
        ('J_W', ['PWM(%)', 'power_W'], '{column: power_W, scale: 1}'),
        ('J_W', ['PWM(%)', 'voltage_V', 'current_A'], '{column: voltage_V, times: current_A}'),
        ('J_W', ['duty_1', 'duty_2'], ''),
        ('J_W', ['pwm_us'], ''),
        ('J_W', ['power_limit_W', 'heater_W'], '{column: heater_W, scale: 1}'),
        ('J_W', ['set_power', 'power'], '{column: power, scale: 1}'),
        ('position_m', ['position_setpoint', 'position'], '{column: position, scale: 1}'),
        ('T_K', ['t', 'T'], '{column: T, scale: 1}'),
        ('time_s', ['T', 't'], '{column: t, scale: 1}'),
        ('T_K', ['t', 'x'], ''),
        ('F_N', ['C', 'F'], '{column: F, scale: 1}'),
        ('alpha_rad', ['angle_rev'], '{column: angle_rev, scale: 6.283185307}'),
        ('alpha_rad', ['angle_raw'], '{column: angle_raw, scale: FACTOR}'),
        ('stress_Pa', ['Stress [ksi]'], '{column: "Stress [ksi]", scale: 6894757.293}'),
        ('stress_Pa', ['Stress (bar)'], '{column: Stress (bar), scale: 100000}'),
        ('time_s', ['%time'], '{column: "%time", scale: 1}'),
        ('time_s', ['X_Value'], '{column: X_Value, scale: 1}'),
    ],
)
def test_the_likely_line_of_a_map(name, header, line):
    assert likely_line(name, header) == (f'{name}: {line}' if line else '')


def test_all_columns_of_a_table_are_proposed():
    lines = hint_for_all(['J_W', 'T_K'], ['Temperature [degF]', 'Power (W)'], ())
    assert lines == (
        '; likely lines of a map: J_W: {column: Power (W), scale: 1}; '
        'T_K: {column: "Temperature [degF]", scale: 0.5555555556, offset: 255.3722222}'
    )


UNITS_BESIDE = {  # text of a table whose position is in mm, by where it says so
    'labview': 'Reader_Version\t2\nY_Unit_Label\tW\tmm\n***End***\nTime\tPower\tWay\n{0}',
    'label below': 'Time\tPower\tWay\nDatum\t1.1.2026\t\nEinheit\tW\tmm\n{0}',
    'line above': 's\tW\tmm\nTime\tPower\tWay\n{0}',
    'comments above': '# s\tW\tmm\n# Time\tPower\tWay\n{0}',
    'comments below': '# Time\tPower\tWay\n# s\tW\tmm\n{0}',
    'comment above names': '# s\tW\tmm\nTime\tPower\tWay\n{0}',
    'small words': 'Time\tPower\tWay\nseconds\twatts\tmillimeters\n{0}',
    'capitals': 'Time\tPower\tWay\nS\tW\tMM\n{0}',
    'line breaks in quotes': '"Time\n[s]"\t"Power\n[W]"\tWay\ns\tW\tmm\n{0}',
}


@pytest.mark.parametrize('where', UNITS_BESIDE)
def test_units_around_the_names(tmp_path, where):
    text = UNITS_BESIDE[where].format(table(TIME, POWER, 1e3 * POSITION, separator='\t').partition('\n')[2])
    time, power = ('"Time [s]"', '"Power [W]"') if 'quotes' in where else ('Time', 'Power')
    mapping = f'time_s: {time}\nJ_W: {power}\nposition_m: '
    refused(tmp_path, text, f'{mapping}Way\n', 'says mm, expected m for position_m', '{column: Way, scale: 0.001}')
    check_plain(read(tmp_path, text, f'{mapping}{{column: Way, scale: 0.001}}\n'))


def test_an_unknown_unit_without_brackets_needs_a_factor(tmp_path):
    text = table(TIME, POWER, POSITION, below='s,W,fathom\n')
    refused(tmp_path, text, '', 'the row of units says fathom', 'position_m: {column: position_m, scale: FACTOR}')
    check_plain(read(tmp_path, table(TIME, POWER, POSITION, below='double,double,double\n')))


@pytest.mark.parametrize('above', ['logger v1\n', 'Date\t2026\t\n***End***\t\t\n'])
def test_names_above_rows_with_text(tmp_path, above):
    words = ['start' if time == 0.0 else '' for time in TIME]
    names = ('time_s', 'comment', 'J_W', 'position_m')
    for text in (words, ['IDLE'] * len(TIME)):
        check_plain(read(tmp_path, table(TIME, text, POWER, POSITION, header=names, separator='\t', above=above)))


@pytest.mark.parametrize(
    ('time', 'unit', 'how'),
    [
        (1e3 * np.arange(20_000), 'milliseconds (scale: 0.001, a sample every 1 s) or microseconds (scale: 1e-06', 'FACTOR'),
        (5e4 * np.arange(400), 'microseconds', '1e-06'),
        (1.785e12 + 1000.0 * np.arange(400), 'milliseconds', '0.001'),
        (46234.88 + np.arange(400) / 86400.0, 'days', '86400'),
        (740198.88 + 0.05 * np.arange(4000) / 86400.0, 'days', '86400'),
    ],
)
def test_times_that_are_no_seconds(time, unit, how):
    mismatch = mismatch_of('time_s', time)
    assert unit in mismatch.words and mismatch.conversion == f'scale: {how}'
    if how == '86400':
        assert mismatch_of('time_s', 86400.0 * time) is None


def test_the_time_is_no_temperature(tmp_path):
    text = table(TIME, POWER, POSITION, TIME, header=('t', 'P', 'x', 'T'))
    mapping = 'time_s: t\nJ_W: P\nposition_m: x\nT_K: {column: t, offset: 273.15}\n'
    refused(tmp_path, text, mapping, 'column t: taken for time_s and for T_K')


@pytest.mark.parametrize(
    ('first', 'second', 'scale'), [('Time', 'Time.1', 0.5), ('t1', 't2', 0.5), ('time_s', 'time_s_1', 2.0)]
)
def test_a_second_clock_of_as_many_rows(tmp_path, first, second, scale):
    text = table(TIME, POWER, scale * TIME, POSITION, header=(first, 'J_W', second, 'position_m'))
    mapping = f'time_s: {first}\n'
    cure = f'position_m: {{column: position_m, time: {second}}}'
    refused(tmp_path, text, mapping, f'{second}, before it, is another clock than {first}', cure, f'or say time: {first}')
    check_plain(read(tmp_path, text, f'{mapping}position_m: {{column: position_m, time: {first}}}\n'))
    check_plain(read(tmp_path, table(TIME, POWER, TIME, POSITION, header=(first, 'J_W', second, 'position_m')), mapping))


def test_measured_columns_and_optional_inputs_are_proposed(tmp_path):
    text = table(TIME, POWER, 1e3 * POSITION, header=('time_s', 'J_W', 'Stroke [mm]'))
    refused(tmp_path, text, '', 'nothing measured in it', 'position_m: {column: "Stroke [mm]", scale: 0.001}')
    path = tmp_path / 'wire.csv'
    path.write_text(table(TIME, POWER, POSITION, 1e8 * POSITION, header=('Time (s)', 'Power (W)', 'strain', 'Stress (MPa)')))
    with pytest.raises(
        UserError, match='J_W: {column: Power .W., scale: 1}; stress_Pa: {column: Stress .MPa., scale: 1000000}'
    ):
        read_recording(path, 'wire', 298.0)


def test_quantities_like_one_in_another_unit_are_asked_for(tmp_path):
    path, way = tmp_path / 'run.csv', tmp_path / 'map.yaml'
    path.write_text(table(TIME, POWER, 0.01 * POSITION, 1e4 * POSITION, header=('time_s', 'J_eq_W', 'Ux', 'Uy')))
    way.write_text('U_x_m: Ux\nU_y_m: Uy\n')
    with pytest.raises(UserError, match='is the same true of others. U_x_m: {column: Ux, scale: 0.001}$'):
        read_recording(path, 'module', 298.0, way)
    way.write_text('U_x_m: {column: Ux, scale: 0.001}\nU_y_m: Uy\n')
    with pytest.raises(UserError, match='U_y_m: {column: Uy, scale: 0.001}$'):
        read_recording(path, 'module', 298.0, way)


def test_dates_where_seconds_are_expected(tmp_path, capsys):
    path = tmp_path / 'run.csv'
    path.write_text('time_s,J_W\n2026-07-31 21:16:09.05,0\n2026-07-31 21:16:10.05,1\n')
    assert main(['simulate', '--system', 'slider', '--input', str(path), '--out', str(tmp_path / 'out.csv')]) == 2
    assert 'write seconds: dates and times of day are read in recordings only' in capsys.readouterr().err


def test_a_folder_of_lvm_and_packed_files(tmp_path):
    for name in ('a.csv', 'b.lvm'):
        (tmp_path / name).write_text(table(TIME, POWER, POSITION + 1e-4 * (name > 'b'), separator='\t'))
    (tmp_path / 'c.csv.gz').write_bytes(b'')
    found = read_dataset(tmp_path, 'slider', noise_std={'position': 1e-6})
    assert [one.name for one in found.recordings] == ['a', 'b']
    assert f'{tmp_path}: c.csv.gz left out: packed' in found.notes


def test_inches_in_lines_above_are_no_quotes(tmp_path):
    above = 'Wire of 5" by\nCase of 3"\n'
    check_plain(read(tmp_path, table(TIME, POWER, POSITION, above=above)), '2 lines above')


def test_a_month_that_no_row_told_is_not_guessed():
    read_seconds = seconds_reader('07/07/2026 23:59:59')
    assert read_seconds('07/07/2026 23:59:59') > 1.7e9
    with pytest.raises(ValueError, match='08'):
        read_seconds('07/08/2026 00:00:00')


def test_dates_every_second_are_no_numbers_of_rows(tmp_path):
    dates = [f'2026-07-31 21:{k // 60:02d}:{k % 60:02d}' for k in range(len(TIME))]
    (recording,) = read(tmp_path, table(dates, POWER, POSITION, header=('time', 'J_W', 'position_m')), 'time_s: time\n')
    assert not any('goes on by 1' in note or 'no unit' in note for note in recording.notes)
