"""Tables as loggers write them: each gives the recording of the plain table, or one message with the cure."""

import sys
from datetime import datetime, timedelta
from zipfile import ZipFile

import numpy as np
import pytest

from sma_sim.evidence.data.recordings import read_recording
from sma_sim.evidence.data.sources import recordings_in
from sma_sim.evidence.data.workbook import workbook_text
from sma_sim.model.errors import UserError
from sma_sim.solver.inputs import inputs_at

COUNT = 200
TIME = 0.05 * np.arange(COUNT)
POWER = np.where((TIME > 2.0) & (TIME < 6.0), 1.2, 0.0)
POSITION = 4e-4 + 1e-3 * np.sin(0.7 * TIME) ** 2
NAMES = ('time_s', 'J_W', 'position_m')


def table(*columns, header=NAMES, separator=',', decimal='.', above='', below=''):
    rows = [
        separator.join(f'{one:.12g}' if not isinstance(one, str) else one for one in row)
        for row in zip(*columns, strict=True)
    ]
    return above + separator.join(header) + '\n' + below + ''.join(f'{row}\n'.replace('.', decimal) for row in rows)


def read(tmp_path, text, mapping='', name='run.csv'):
    path, way = tmp_path / name, tmp_path / 'map.yaml'
    path.write_text(text, encoding='utf-8')
    way.write_text(f'system: slider\n{mapping}')
    return read_recording(path, 'slider', 298.0, way)


def check_plain(recordings, *said, skipped=0, atol=1e-9):
    (recording,) = recordings
    assert np.allclose(recording.time - recording.time[0], TIME[skipped:] - TIME[skipped], rtol=0.0, atol=atol)
    assert np.allclose(recording.channels['position'], POSITION[skipped:], rtol=1e-9)
    power = inputs_at(recording.source, recording.time)['J_W']
    assert np.allclose(power, POWER[skipped:], rtol=1e-9)
    for words in said:
        assert words in ' | '.join(recording.notes)


def refused(tmp_path, text, mapping, *said):
    with pytest.raises(UserError) as caught:
        read(tmp_path, text, mapping)
    assert '\n' not in str(caught.value)
    for words in said:
        assert words in str(caught.value)


@pytest.mark.parametrize(
    ('separator', 'word'), [(';', 'semicolons'), ('\t', 'tabs'), ('|', 'bars'), (' ', 'spaces'), ('   ', 'spaces')]
)
@pytest.mark.parametrize('decimal', ['.', ','])
def test_separators_and_decimal_commas(tmp_path, separator, word, decimal):
    text = table(TIME, POWER, POSITION, separator=separator, decimal=decimal)
    said = [f'separated by {word}', *(['decimals have commas'] if decimal == ',' else [])]
    check_plain(read(tmp_path, text), *said)


def test_a_comma_that_may_be_a_thousands_separator_is_refused(tmp_path):
    text = 'time_s;J_W;position_m\n0;0;1,234\n1;0;1,235\n2;1;1,236\n'
    refused(tmp_path, text, '', '1,234', 'separator of thousands', 'write them so')


@pytest.mark.parametrize(('cell', 'decimal'), [('1.234', ','), ('1.234,5', ','), ('1,234.5', '.')])
def test_separators_of_thousands_among_decimals_are_refused(tmp_path, cell, decimal):
    text = table(TIME, POWER, POSITION, separator=';', decimal=decimal) + f'10;0;{cell}\n'
    refused(tmp_path, text, '', f'row {COUNT + 2}, column position_m', repr(cell))


def test_decimal_commas_between_commas_are_refused(tmp_path):
    refused(tmp_path, table(TIME, POWER, POSITION, decimal=','), '', 'decimals need points')


def test_comments_and_a_header_in_one(tmp_path):
    text = table(TIME, POWER, POSITION, above='# bench 3\n\n# operator: x\n').replace('\n1,', '\n# halved\n1,')
    check_plain(read(tmp_path, text), 'are comments')
    check_plain(read(tmp_path, table(TIME, POWER, POSITION, above='# ')), 'are comments')
    spaced = table(TIME, POWER, POSITION, above='# ', separator=' ')
    check_plain(read(tmp_path, spaced), 'separated by spaces')


@pytest.mark.parametrize('sign', ['# ', '// ', '% '])
def test_signs_of_comments(tmp_path, sign):
    check_plain(read(tmp_path, table(TIME, POWER, POSITION, above=f'{sign}bench 3\n')), 'are comments')
    check_plain(read(tmp_path, table(TIME, POWER, POSITION, header=('%time', *NAMES[1:])), "time_s: '%time'\n"))


def test_a_decimal_comma_in_a_comment_is_none_of_the_numbers(tmp_path):
    (recording,) = read(tmp_path, table(TIME, POWER, POSITION, separator='\t', above='# gain 0,5 at 1,234 rpm\n'))
    check_plain([recording], 'separated by tabs')
    assert 'decimals have commas' not in ' | '.join(recording.notes)


def test_row_numbers_count_every_line(tmp_path):
    text = table(TIME, POWER, POSITION, above='# one\n# two\n', below='s,W,m\n') + '10,0,warm\n'
    refused(tmp_path, text, '', f'row {COUNT + 5}, column position_m')


@pytest.mark.parametrize('units', ['[s],[W],[m]', 's,W,m', '(s),(W),(m)', 'sec,W,'])
def test_a_row_of_units(tmp_path, units):
    check_plain(read(tmp_path, table(TIME, POWER, POSITION, below=f'{units}\n')), 'the row of units is no sample')


def test_a_row_of_units_that_contradicts_the_names(tmp_path):
    text = table(TIME, POWER, 1e3 * POSITION, below='[s],[W],[mm]\n')
    refused(tmp_path, text, '', 'says mm, expected m', 'position_m: {column: position_m, scale: 0.001}')
    check_plain(read(tmp_path, text, 'position_m: {column: position_m, scale: 0.001}\n'))


@pytest.mark.parametrize('form', ['{:%Y-%m-%d %H:%M:%S.%f}', '{:%Y-%m-%dT%H:%M:%S.%f}Z', '{:%Y-%m-%dT%H:%M:%S.%f}+02:00'])
@pytest.mark.parametrize('separator', [',', ';'])
def test_dates(tmp_path, form, separator):
    start = datetime(2026, 7, 31, 23, 59, 58)
    dates = [form.format(start + timedelta(seconds=float(time))) for time in TIME]
    dates[0] = dates[0].replace('.000000', '')
    text = table(dates, POWER, POSITION, header=('time', *NAMES[1:]), separator=separator)
    check_plain(read(tmp_path, text, 'time_s: time\n'), atol=5e-7)
    refused(tmp_path, text, 'time_s: {column: time, scale: 0.001}\n', 'dates need no scale')


def test_dates_in_another_order_are_refused(tmp_path):
    dates = [f'01/02/2026 10:00:{int(time):02d}' for time in TIME]
    refused(tmp_path, table(dates, POWER, POSITION), '', 'column time_s', 'write dates as 2026-07-31')


@pytest.mark.parametrize(
    ('start', 'scale'), [(2**32 - 3e6, 1e-6), (2**32 - 2.5e9, 1e-9), (2**32 - 1e3, 1e-3), (2**31 - 1e3, 1e-3)]
)
def test_a_counter_of_32_bit_starts_again(tmp_path, start, scale):
    counts = np.rint(start + TIME / scale) % 2**32
    counts = counts - 2**32 * (counts >= 2**31) if start < 2**31 and scale == 1e-3 else counts
    text = table([f'{int(one)}' for one in counts], POWER, POSITION, header=('count', *NAMES[1:]))
    check_plain(
        read(tmp_path, text, f'time_s: {{column: count, scale: {scale}}}\n'), 'counter of time starts again', atol=1e-6
    )


def test_a_clock_that_restarts_is_no_counter(tmp_path):
    counts = np.concatenate([4_000_000_000 + 50_000 * np.arange(100), 50_000 * np.arange(100)])
    text = table([f'{one}' for one in counts], POWER, POSITION, header=('count', *NAMES[1:]))
    assert len(read(tmp_path, text, 'time_s: {column: count, scale: 1.0e-6}\n')) == 2


@pytest.mark.parametrize(
    ('entry', 'first', 'second'),
    [
        ('{column: a, times: b}', 12.0 * (POWER > 0), 0.1 * np.ones(COUNT)),
        ('{column: b, exponent: 2, times: a}', 4.8 * np.ones(COUNT), 0.5 * (POWER > 0)),
        ('{column: a, times: b, scale: 0.01}', 20.0 * (POWER > 0), 6.0 * np.ones(COUNT)),
    ],
    ids=['U and I', 'R and I^2', 'duty and supply'],
)
def test_power_as_a_product(tmp_path, entry, first, second):
    text = table(TIME, first, second, POSITION, header=('time_s', 'a', 'b', 'position_m'))
    check_plain(read(tmp_path, text, f'J_W: {entry}\n'))
    refused(tmp_path, text, 'J_W: {column: a, scale: b}\n', 'a product of two columns', '{column: a, times: b}')
    refused(tmp_path, text, 'J_W: {column: a, times: c}\n', 'no column c')


@pytest.mark.parametrize('names', [('stamp.sec', 'stamp.nanosec'), ('field.header.stamp.secs', 'field.header.stamp.nsecs')])
def test_seconds_and_nanoseconds(tmp_path, names):
    ticks = [divmod(1669882837 * 20 + 7 + k, 20) for k in range(COUNT)]
    sec, nanosec = [f'{one}' for one, _ in ticks], [f'{50_000_000 * rest}' for _, rest in ticks]
    text = table(sec, nanosec, POWER, POSITION, header=(*names, *NAMES[1:]))
    cure = f'time_s: {{column: {names[0]}, nanosec: {names[1]}}}'
    check_plain(read(tmp_path, text, f'{cure}\n'), atol=1e-6)
    refused(tmp_path, text, f'time_s: {{column: {names[1]}, scale: 1.0e-9}}\n', cure)
    refused(tmp_path, text, f'time_s: {names[0]}\n', cure)


@pytest.mark.parametrize('labels', [('1', '4'), ('position', 'power')])
def test_long_tables(tmp_path, labels):
    rows = [
        (label, time, value)
        for k in range(COUNT)
        for label, time, value in ((labels[1], TIME[k], POWER[k]), (labels[0], TIME[k], POSITION[k]))
    ]
    text = table(*zip(*rows, strict=True), header=('source', 'time_s', 'value'))
    where = 'J_W: {{column: value, where: {{source: {1}}}}}\nposition_m: {{column: value, where: {{source: {0}}}}}\n'
    check_plain(read(tmp_path, text, where.format(*labels)))
    refused(tmp_path, text, where.format('other', labels[1]), 'no row has source other', 'position_m')
    refused(tmp_path, text, 'J_W: value\nposition_m: value\n', 'taken for J_W and for position_m', 'where:')


def test_a_fault_of_a_spreadsheet_is_no_comment(tmp_path):
    refused(tmp_path, table(TIME, POWER, POSITION) + '#REF!,0,0\n', '', f'row {COUNT + 2}, column time_s', '#REF!')


def test_a_line_that_tells_excel_the_separator(tmp_path):
    check_plain(read(tmp_path, table(TIME, POWER, POSITION, separator=';', decimal=',', above='sep=;\n')), 'semicolons')


def test_text_in_a_folder(tmp_path):
    for name in ('a.txt', 'b.tsv', 'c.dat', 'd.csv'):
        (tmp_path / name).write_text(table(TIME, POWER, POSITION, separator='\t'))
    (tmp_path / 'README.txt').write_text('Bench 3, wire 2\nMeasured on Friday, with the new supply\n')
    (tmp_path / 'empty.txt').write_text('')
    assert [path.name for path in recordings_in(tmp_path)] == ['a.txt', 'b.tsv', 'c.dat', 'd.csv']


@pytest.mark.parametrize('dated', [False, True])
def test_workbooks(tmp_path, dated):
    openpyxl = pytest.importorskip('openpyxl')
    book, path, way = openpyxl.Workbook(), tmp_path / 'run.xlsx', tmp_path / 'map.yaml'
    book.create_sheet('empty')
    start = datetime(2026, 7, 31, 23, 59, 58)
    book.active.append(NAMES)
    for time, power, position in zip(TIME, POWER, POSITION, strict=True):
        book.active.append([start + timedelta(seconds=float(time)) if dated else float(time), float(power), float(position)])
    book.save(path)
    way.write_text('system: slider\n')
    check_plain(read_recording(path, 'slider', 298.0, way), atol=1e-6)
    path.write_bytes(b'PK no workbook')
    with pytest.raises(UserError, match='no Excel workbook.*save the sheet as CSV'):
        read_recording(path, 'slider', 298.0, way)


@pytest.fixture
def workbook(tmp_path):
    """Two runs and a summary, each in a sheet, with an extension that openpyxl does not know."""
    openpyxl = pytest.importorskip('openpyxl')
    book, plain, path = openpyxl.Workbook(), tmp_path / 'plain.xlsx', tmp_path / 'runs.xlsx'
    for title, sign in (('50 %, up', 1.0), ('50 %, down', -1.0)):
        sheet = book.create_sheet(title)
        for row in [NAMES, *zip(TIME.tolist(), POWER.tolist(), (sign * POSITION).tolist(), strict=True)]:
            sheet.append(row)
    book.active.title = 'Summary'
    book.active.append(['mean', 1.0])
    book.save(plain)
    extension = b'<extLst><ext uri="{00000000-0000-0000-0000-000000000000}"/></extLst></worksheet>'
    with ZipFile(plain) as archive, ZipFile(path, 'w') as extended:
        for name in archive.namelist():
            extended.writestr(name, archive.read(name).replace(b'</worksheet>', extension))
    return path


def recordings_of(workbook, mapping):
    way = workbook.parent / 'map.yaml'
    way.write_text(f'system: slider\n{mapping}')
    return read_recording(workbook, 'slider', 298.0, way)


@pytest.mark.filterwarnings('error')
def test_the_sheet_of_a_workbook(workbook):
    (up,) = recordings_of(workbook, "sheet: '50 %, up'\n")
    check_plain([up])
    assert up.name == 'runs#50 %, up'
    one, other = recordings_of(workbook, "sheet: ['50 %, up', '50 %, down']\n")
    assert (one.name, other.name) == ('runs#50 %, up', 'runs#50 %, down')
    assert (one.channels['position'] == -other.channels['position']).all()
    (down,) = recordings_of(workbook, "tests: [{files: 'runs.*', sheet: '50 %, down'}]\nsheet: '50 %, up'\n")
    assert down.name == 'runs#50 %, down'


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize(
    ('mapping', 'said'),
    [
        ('', "runs.xlsx has several sheets, 'Summary', '50 %, up', '50 %, down'; expected one: .*sheet: Summary"),
        ('sheet: 50 % up\n', "has no sheet '50 % up'; did you mean 50 %, up.*its sheets are 'Summary', '50 %, up'"),
        ('sheet: Summary\n', "sheet 'Summary': .*runs.xlsx has no column time_s"),
        ('sheet: {a: 1}\n', 'map.yaml, sheet: expected the title of a sheet or a list of titles, got'),
        ("tests: [{files: 'runs.*', sheet: true}]\n", r'tests, runs.\*, sheet: expected the title'),
    ],
    ids=['none named', 'misspelt', 'no recording', 'no title', 'no title in a test'],
)
def test_sheets_that_are_refused(workbook, mapping, said):
    with pytest.raises(UserError, match=said):
        recordings_of(workbook, mapping)


def test_broken_workbooks_are_refused_or_read(tmp_path):
    openpyxl = pytest.importorskip('openpyxl')
    book, path, random = openpyxl.Workbook(), tmp_path / 'run.xlsx', np.random.default_rng(1)
    for row in [NAMES, *zip(TIME.tolist(), POWER.tolist(), POSITION.tolist(), strict=True)]:
        book.active.append(row)
    book.save(path)
    whole, outcomes = path.read_bytes(), set()
    with ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    for k in range(120):
        broken = tmp_path / f'{k}.xlsx'
        if k % 2:
            broken.write_bytes(with_wrong_bytes(whole, random))
        else:  # a sound archive
            with ZipFile(broken, 'w') as archive:
                for name, part in parts.items():
                    archive.writestr(name, with_wrong_bytes(part, random) if random.random() < 0.5 else part)
        try:
            outcomes.add(type(workbook_text(broken, k)))
        except UserError as error:
            outcomes.add(type(error))
            assert 'save the sheet as CSV' in str(error)
    assert outcomes == {str, UserError}


def with_wrong_bytes(content, random):
    wrong = bytearray(content)
    for at in random.integers(len(wrong), size=random.integers(1, 4)):
        wrong[at] = random.integers(256)
    return bytes(wrong)


def test_workbooks_without_their_package(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'openpyxl', None)
    (tmp_path / 'run.xlsx').write_bytes(b'PK')
    with pytest.raises(UserError, match='pip install openpyxl, or save the sheet as CSV'):
        read_recording(tmp_path / 'run.xlsx', 'slider', 298.0)


def test_a_product_in_other_units_needs_a_scale(tmp_path):
    text = table(
        TIME, 6.0 * (POWER > 0), 200.0 + 0.0 * TIME, POSITION, header=('time_s', 'U', 'I', NAMES[2]), below='s,V,mA,m\n'
    )
    refused(tmp_path, text, 'J_W: {column: U, times: I}\n', 'says mA', 'times: I, scale: 0.001}')
    check_plain(read(tmp_path, text, 'J_W: {column: U, times: I, scale: 0.001}\n'))
