"""Text in numbers, wrong columns, units and separators, garbage: a message that a person can act on."""

import numpy as np
import pytest
from corrupted import HEADER, ROWS, TEXT, TRUTH, check_truth, notes_of, read, refused, repaired, with_cell, write
from made_recordings import cells_of, text_of


@pytest.mark.parametrize('column', HEADER)
@pytest.mark.parametrize('cell', ['warm', '1.2.3', '0x', '1,5', '12 V', '1_000', '#REF!'])
def test_text_in_numbers(tmp_path, column, cell):
    row = 100 + HEADER.index(column)
    message = refused(write(tmp_path, with_cell(row, column, f'"{cell}"')), f'row {row + 2}, column {column}')
    assert repr(cell) in message


@pytest.mark.parametrize('column', HEADER)
def test_decimal_comma_shifts_no_cells(tmp_path, column):
    refused(write(tmp_path, with_cell(50, column, '1,5')), 'row 52', 'decimals need points')


@pytest.mark.parametrize('column', HEADER)
def test_missing_column(tmp_path, column):
    place = HEADER.index(column)
    content = text_of(HEADER[:place] + HEADER[place + 1 :], [row[:place] + row[place + 1 :] for row in ROWS])
    if column in ('time_s', 'J_eq_W'):
        refused(write(tmp_path, content), f'has no column {column}')
    elif column == 'T_E_K':
        repaired(tmp_path, content, 'T_E_K is not recorded: taken as 298 K')
    else:
        repaired(tmp_path, content, 'not measured: ' + column.rsplit('_', 1)[0], kept=0.85)


@pytest.mark.parametrize('column', HEADER)
def test_doubled_column(tmp_path, column):
    content = text_of([*HEADER, column], [[*row, '1'] for row in ROWS])
    refused(write(tmp_path, content), f'column {column} more than once')


@pytest.mark.parametrize(
    ('column', 'scale', 'offset', 'looks'),
    [
        ('alpha_rad', 180.0 / np.pi, 0.0, 'degrees'),
        ('T_1_K', 1.0, -273.15, 'degrees Celsius'),
        ('T_2_K', 1.0, -273.15, 'degrees Celsius'),
        ('T_E_K', 1.0, -273.15, 'degrees Celsius'),
        ('U_y_m', 1e3, 0.0, 'millimetres'),
        ('U_x_m', 1e6, 0.0, 'millimetres'),
        ('J_eq_W', 1e3, 0.0, 'milliwatts'),
        ('time_s', 1e9, 0.0, 'nanoseconds'),
        ('T_1_K', 1e3, 0.0, 'another unit'),
    ],
)
def test_wrong_units(tmp_path, column, scale, offset, looks):
    header, rows = cells_of(TRUTH | {column: TRUTH[column] * scale + offset})
    refused(write(tmp_path, text_of(header, rows)), f'column {column}', looks, 'a map (--map) can convert')


def test_milliseconds_are_suspected(tmp_path):
    header, rows = cells_of(TRUTH | {'time_s': TRUTH['time_s'] * 1e3})
    assert 'a sample every 20 s: is time_s in seconds?' in notes_of(read(write(tmp_path, text_of(header, rows))))


def test_nothing_measured_after_the_first_command(tmp_path):
    rows = [[str(k), '' if k < 8 else '1', '298', '0.01' if k < 8 else ''] for k in range(10)]
    refused(write(tmp_path, text_of([*HEADER[:3], 'alpha_rad'], rows)), 'measured rows after the first command')


@pytest.mark.parametrize(('sign', 'word'), [(';', 'semicolons'), ('\t', 'tabs'), ('|', 'bars')])
@pytest.mark.parametrize('decimal', ['.', ','])
def test_separators(tmp_path, sign, word, decimal):
    rows = [[cell.replace('.', decimal) for cell in row] for row in ROWS]
    repaired(tmp_path, text_of(HEADER, rows, sign), f'cells are separated by {word}', kept=1.0)


def test_other_separators(tmp_path):
    repaired(tmp_path, text_of(HEADER, ROWS, ' '), 'cells are separated by spaces', kept=1.0)
    refused(write(tmp_path, text_of([f'{k}' for k in range(10)], ROWS)), 'expected the names of the columns')
    refused(write(tmp_path, text_of(HEADER, ROWS).replace('\n', '\n', 1).replace(',', ';').replace(';', ',', 9)), 'row 2')


@pytest.mark.parametrize(
    'change',
    [
        lambda text: text.replace('\n', '\r\n').encode(),
        lambda text: text.replace('\n', '\r').encode(),
        lambda text: b'\xef\xbb\xbf' + text.encode(),
        lambda text: b'\xef\xbb\xbf' + text.replace('\n', '\r\n').encode(),
        lambda text: text.replace(',', ', ').encode(),
        lambda text: text.replace('\n', '\n\n').encode(),
        lambda text: text.replace('\n', '\n \n').encode(),
        lambda text: (text + '\n\n\n').encode(),
        lambda text: ('"' + text[:-1].replace(',', '","').replace('\n', '"\n"') + '"\n').encode(),
        lambda text: text.replace('\n', ',\n').encode(),
        lambda text: text.replace('\n', ',good\n').replace('good', 'remark', 1).encode(),
    ],
    ids=['windows', 'old mac', 'mark', 'both', 'spaces', 'blank lines', 'spaced lines', 'end', 'quotes', 'commas', 'text'],
)
def test_other_spellings(tmp_path, change):
    recordings = read(write(tmp_path, change(TEXT)))
    check_truth(recordings, kept=1.0)


@pytest.mark.parametrize('seed', range(40))
def test_garbage(tmp_path, seed):
    random = np.random.default_rng(seed)
    refused(write(tmp_path, random.bytes(int(10 ** random.uniform(0.0, 5.0)))))


@pytest.mark.parametrize('seed', range(20))
def test_garbage_after_a_good_header(tmp_path, seed):
    random = np.random.default_rng(seed)
    refused(write(tmp_path, (TEXT[:5000]).encode() + random.bytes(3000) + b'\n'))


@pytest.mark.parametrize(
    'content',
    [
        b'',
        b'\n',
        b'   \n',
        b'\xef\xbb\xbf',
        b'\x00' * 100,
        TEXT.encode('utf-16-le'),
        TEXT.encode('utf-32'),
        b'\x1f\x8b\x08\x00' * 50,
        b'\x89PNG\r\n\x1a\n' * 20,
        b'PK\x03\x04' * 20,
        b'{"time_s": [0, 1]}',
        b'time_s,J_eq_W,alpha_rad\n',
        b',' * 1000,
        b'time_s,J_eq_W,alpha_rad\n0,0,0\n',
        b'time_s,J_eq_W,alpha_rad\n' + b'1' * 3_000_000,
        b'a' * 3_000_000,
        b'time_s,J_eq_W,alpha_rad\n"0,0,0\n1,0,0\n',
        b'time_s,J_eq_W,alpha_rad\n0,0,0\n0,0,0\n0,0,0\n',
        b'time_s,J_eq_W,alpha_rad\n,0,0\n,0,0\n',
        b'time_s,J_eq_W,alpha_rad\n0,,0\n1,,0\n',
        b'time_s,J_eq_W\n0,0\n1,0\n',
        b'time_s,J_eq_W,alpha_rad\n0,0,\n1,0,\n',
        b'time_s,J_eq_W,alpha_rad\n0,0,inf\n1,0,inf\n',
        b'time_s,strain,J_W\n0,0,0\n1,0,0\n',
        b'time_s,J_eq_W,alpha_rad\n\x00,0,0\n1,0,0\n',
        b'time_s,J_eq_W,T_1_K\n0,0,-5\n1,0,-5\n',
        b'time_s,J_eq_W,alpha_rad\ninf,0,0\ninf,0,0\n',
    ],
)
def test_hopeless(tmp_path, content):
    refused(write(tmp_path, content))
