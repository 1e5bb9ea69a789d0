"""Corrupted recordings end in a message that a person can act on, or in a repair that is said and right."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_recordings import RATE, cells_of, module_columns, text_of

from sma_sim.evidence.recording import CHANNEL_COLUMNS
from sma_sim.evidence.recordings import read_campaign, read_recording
from sma_sim.model.errors import UserError
from sma_sim.solver.inputs import inputs_at

TRUTH = module_columns()
HEADER, ROWS = cells_of(TRUTH)
TEXT = text_of(HEADER, ROWS)
COUNT = len(ROWS)
MEASURED = HEADER[3:]
SEEDS = range(10)


def read(path):
    return read_recording(path, 'module', 298.0)


def write(tmp_path, content):
    path = tmp_path / 'run.csv'
    if isinstance(content, str):
        content = content.encode()
    path.write_bytes(content)
    return path


def check_truth(recordings, kept=0.9, begin=0.0):
    """Every value is that of the truth at its time or missing, commands too, and at least the part `kept` is there."""
    present = 0
    for recording in recordings:
        assert (np.diff(recording.time) > 0.0).all()
        index = np.rint((recording.time + begin) * RATE).astype(int)
        assert np.allclose(recording.time + begin, TRUTH['time_s'][index], atol=1e-6)
        for channel, values in recording.channels.items():
            known = np.isfinite(values)
            assert np.allclose(values[known], TRUTH[CHANNEL_COLUMNS[channel]][index[known]], rtol=1e-8), channel
            present += known.sum()
        inputs = inputs_at(recording.source, recording.time)
        assert np.array_equal(inputs['J_eq_W'], TRUTH['J_eq_W'][index])
        assert np.array_equal(inputs['T_E_K'], TRUTH['T_E_K'][index])
    assert present >= kept * COUNT * len(MEASURED)


def notes_of(recordings):
    return ' | '.join(note for recording in recordings for note in recording.notes)


def repaired(tmp_path, content, *said, kept=0.9):
    """The notes of a file that is read in spite of what is wrong with it, and rightly."""
    recordings = read(write(tmp_path, content))
    notes = notes_of(recordings)
    for words in said:
        assert words in notes
    check_truth(recordings, kept)
    return notes


def refused(path, *said):
    """The message of a file that is not read: it names the file."""
    with pytest.raises(UserError) as caught:
        read(path)
    message = str(caught.value)
    assert path.name in message and '\n' not in message
    for words in said:
        assert words in message
    return message


def with_cell(row, column, cell):
    rows = [list(cells) for cells in ROWS]
    rows[row][HEADER.index(column)] = cell
    return text_of(HEADER, rows)


def test_the_file_itself_is_fine(tmp_path):
    (recording,) = read(write(tmp_path, TEXT))
    check_truth([recording], kept=1.0)
    assert len(recording.notes) == 1 and 'sampled' in recording.notes[0]


@pytest.mark.parametrize('seed', range(40))
def test_truncated(tmp_path, seed):
    """Cut anywhere: what is there is right, and a cut number is never taken for a whole one."""
    end = int(np.random.default_rng(seed).integers(len(TEXT) // 50, len(TEXT) - 1))
    path = write(tmp_path, TEXT[:end])
    whole = TEXT[:end].count('\n') - 1
    recordings = read(path)
    check_truth(recordings, kept=whole / COUNT - 1e-9)
    assert len(recordings[0].time) == whole
    assert TEXT[end - 1] == '\n' or 'incomplete' in notes_of(recordings)


@pytest.mark.parametrize('end', [1, 5, 20, 60, len(TEXT.split('\n')[0]), len(TEXT.split('\n')[0]) + 5])
def test_truncated_in_the_beginning(tmp_path, end):
    refused(write(tmp_path, TEXT[:end]))


@pytest.mark.parametrize('seed', SEEDS)
def test_shuffled(tmp_path, seed):
    order = np.random.default_rng(seed).permutation(COUNT)
    repaired(tmp_path, text_of(HEADER, [ROWS[k] for k in order]), 'not in the order of time', kept=1.0)


@pytest.mark.parametrize('seed', SEEDS)
def test_some_rows_moved(tmp_path, seed):
    random = np.random.default_rng(seed)
    rows = list(ROWS)
    for _ in range(1 + seed):
        rows.insert(int(random.integers(0, COUNT - 1)), rows.pop(int(random.integers(0, COUNT))))
    content = text_of(HEADER, rows)
    if content != TEXT:
        repaired(tmp_path, content, 'not in the order of time', kept=1.0)


@pytest.mark.parametrize('seed', SEEDS)
def test_blocks_in_another_order(tmp_path, seed):
    cuts = np.sort(np.random.default_rng(seed).choice(np.arange(30, COUNT - 30), 3, replace=False))
    a, b, c, d = np.split(np.arange(COUNT), cuts)
    order = np.concatenate([c, a, d, b])
    repaired(tmp_path, text_of(HEADER, [ROWS[k] for k in order]), kept=0.99)


@pytest.mark.parametrize('seed', SEEDS)
def test_dropped_rows(tmp_path, seed):
    keep = np.random.default_rng(seed).random(COUNT) > 0.05
    keep[[0, -1]] = True
    changes = np.flatnonzero(np.diff(TRUTH['J_eq_W']) != 0.0) + 1
    keep[changes] = True
    content = text_of(HEADER, [row for row, good in zip(ROWS, keep, strict=True) if good])
    repaired(tmp_path, content, f'{int((~keep).sum())} samples missing', kept=keep.mean())


@pytest.mark.parametrize('seed', SEEDS)
def test_repeated_rows(tmp_path, seed):
    times = 1 + (np.random.default_rng(seed).random(COUNT) < 0.1)
    content = text_of(HEADER, [row for row, n in zip(ROWS, times, strict=True) for _ in range(n)])
    repaired(tmp_path, content, f'{int(times.sum()) - COUNT} samples repeat', kept=1.0)


@pytest.mark.parametrize('seed', SEEDS)
def test_missing_cells(tmp_path, seed):
    random = np.random.default_rng(seed)
    gaps = ['', 'nan', 'NaN', ' ']
    rows = [row[:3] + [random.choice(gaps) if random.random() < 0.05 else cell for cell in row[3:]] for row in ROWS]
    repaired(tmp_path, text_of(HEADER, rows), 'samples missing')


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('column', MEASURED)
def test_outliers(tmp_path, column, seed):
    """Single spikes, also two in a row: every one is taken out, and next to nothing else."""
    random = np.random.default_rng(seed)
    rows = [list(row) for row in ROWS]
    place = HEADER.index(column)
    span = np.ptp(TRUTH[column])
    hit = random.choice(np.arange(20, COUNT - 20, 20), 6, replace=False)
    hit = np.concatenate([hit, hit[:1] + 1])
    for k in hit:
        rows[k][place] = f'{TRUTH[column][k] + random.choice([-1.0, 1.0]) * random.uniform(8.0, 100.0) * span:.10g}'
    repaired(tmp_path, text_of(HEADER, rows), f'{column}: {len(hit)} outliers', kept=0.99)


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
        ('alpha_rad', 180.0 / np.pi, 0.0, 'degrees'), ('T_1_K', 1.0, -273.15, 'degrees Celsius'),
        ('T_2_K', 1.0, -273.15, 'degrees Celsius'), ('T_E_K', 1.0, -273.15, 'degrees Celsius'),
        ('U_y_m', 1e3, 0.0, 'millimetres'), ('U_x_m', 1e6, 0.0, 'millimetres'), ('J_eq_W', 1e3, 0.0, 'milliwatts'),
        ('time_s', 1e9, 0.0, 'nanoseconds'), ('T_1_K', 1e3, 0.0, 'another unit'),
    ],
)  # fmt: skip
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
def test_wrong_separators(tmp_path, sign, word, decimal):
    rows = [[cell.replace('.', decimal) for cell in row] for row in ROWS]
    refused(write(tmp_path, text_of(HEADER, rows, sign)), word, 'expected commas')


def test_other_separators(tmp_path):
    refused(write(tmp_path, text_of(HEADER, ROWS, ' ')), 'has no column time_s')
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
        b'', b'\n', b'   \n', b'\xef\xbb\xbf', b'\x00' * 100, TEXT.encode('utf-16'), TEXT.encode('utf-32'),
        b'\x1f\x8b\x08\x00' * 50,
        b'\x89PNG\r\n\x1a\n' * 20, b'PK\x03\x04' * 20, b'{"time_s": [0, 1]}', b'time_s,J_eq_W,alpha_rad\n', b',' * 1000,
        b'time_s,J_eq_W,alpha_rad\n0,0,0\n', b'time_s,J_eq_W,alpha_rad\n' + b'1' * 3_000_000, b'a' * 3_000_000,
        b'time_s,J_eq_W,alpha_rad\n"0,0,0\n1,0,0\n', b'time_s,J_eq_W,alpha_rad\n0,0,0\n0,0,0\n0,0,0\n',
        b'time_s,J_eq_W,alpha_rad\n,0,0\n,0,0\n', b'time_s,J_eq_W,alpha_rad\n0,,0\n1,,0\n', b'time_s,J_eq_W\n0,0\n1,0\n',
        b'time_s,J_eq_W,alpha_rad\n0,0,\n1,0,\n', b'time_s,J_eq_W,alpha_rad\n0,0,inf\n1,0,inf\n',
        b'time_s,strain,J_W\n0,0,0\n1,0,0\n',
        b'time_s,J_eq_W,alpha_rad\n\x00,0,0\n1,0,0\n', b'time_s,J_eq_W,T_1_K\n0,0,-5\n1,0,-5\n',
        b'time_s,J_eq_W,alpha_rad\ninf,0,0\ninf,0,0\n',
    ],
)  # fmt: skip
def test_hopeless(tmp_path, content):
    refused(write(tmp_path, content))


@pytest.mark.parametrize('seed', SEEDS)
def test_clock_jumps_back_a_little(tmp_path, seed):
    """The clock was set back while the samples went on: the rows until it has caught up are dropped."""
    random = np.random.default_rng(seed)
    at, back = int(random.integers(100, 500)), int(random.integers(2, 10))
    rows = [list(row) for row in ROWS]
    for k in range(at, at + back):
        rows[k][0] = f'{TRUTH["time_s"][k] - back / RATE - 0.007:.10g}'
    repaired(tmp_path, text_of(HEADER, rows), 'the clock jumps back', f'{back} rows dropped', kept=0.95)


@pytest.mark.parametrize('seed', SEEDS)
def test_wrong_stamps(tmp_path, seed):
    random = np.random.default_rng(seed)
    rows = [list(row) for row in ROWS]
    hit = random.choice(np.arange(10, COUNT - 10, 5), 3, replace=False)
    for k in hit:
        rows[k][0] = f'{TRUTH["time_s"][k] + random.choice([-1.0, 1.0]) * 10.0 ** random.uniform(1.0, 5.0):.10g}'
    repaired(tmp_path, text_of(HEADER, rows), '3 rows with a time far from', kept=0.99)


@pytest.mark.parametrize('cell', ['', 'nan', 'inf', '-inf', 'NaN', ' '])
def test_rows_without_a_time(tmp_path, cell):
    rows = [[cell, *row[1:]] if k % 50 == 7 else row for k, row in enumerate(ROWS)]
    repaired(tmp_path, text_of(HEADER, rows), '12 rows without a time: dropped', kept=0.97)


@pytest.mark.parametrize('column', ['J_eq_W', 'T_E_K'])
@pytest.mark.parametrize('cell', ['', 'nan', 'inf'])
def test_inputs_with_gaps_hold(tmp_path, column, cell):
    place = HEADER.index(column)
    same = np.concatenate([[False], np.diff(TRUTH['J_eq_W']) == 0.0])
    rows = [[*row[:place], cell, *row[place + 1 :]] if same[k] and k % 3 else row for k, row in enumerate(ROWS)]
    repaired(tmp_path, text_of(HEADER, rows), f'{column}: ', 'the value before holds', kept=1.0)


@pytest.mark.parametrize('column', MEASURED)
def test_infinite_measurements(tmp_path, column):
    repaired(tmp_path, with_cell(77, column, 'inf'), f'{column}: 1 infinite values', kept=0.99)


@pytest.mark.parametrize('sessions', [2, 3, 5])
def test_sessions_in_one_file(tmp_path, sessions):
    recordings = read(write(tmp_path, text_of(HEADER, ROWS * sessions)))
    assert [recording.name for recording in recordings] == [f'run#{k + 1}' for k in range(sessions)]
    for recording in recordings:
        check_truth([recording], kept=1.0)
        assert f'taken as {sessions} sessions' in notes_of([recording])


def test_dates_as_times(tmp_path):
    header, rows = cells_of(TRUTH)
    rows = [[f'{1.7e9 + time:.3f}', *row[1:]] for time, row in zip(TRUTH['time_s'], rows, strict=True)]
    repaired(tmp_path, text_of(header, rows), 'time is counted from the first row', kept=1.0)


def test_two_recordings_mixed(tmp_path):
    """Row by row from two robots: nothing can tell them apart."""
    rows = [row for k in range(COUNT // 2) for row in (ROWS[k], ROWS[k + COUNT // 4])]
    refused(write(tmp_path, text_of(HEADER, rows)), 'are two mixed in this file?')


def lose_rows(rows, random):
    same = np.concatenate([[False], np.diff(TRUTH['J_eq_W']) == 0.0, [True]])
    return [row for k, row in enumerate(rows) if random.random() > 0.1 or not same[min(k, COUNT)] or len(rows) != COUNT]


def repeat_rows(rows, random):
    return [row for row in rows for _ in range(1 + (random.random() < 0.02))]


def lose_cells(rows, random):
    return [row[:3] + [cell if random.random() > 0.03 else '' for cell in row[3:]] for row in rows]


def add_spikes(rows, random):
    hit = random.choice(np.arange(30, len(rows) - 30, 30), 4, replace=False)
    rows = [list(row) for row in rows]
    for k in hit:
        rows[k][5] = f'{random.choice([-1, 1]) * random.uniform(2.0, 900.0):.6g}'
    return rows


def move_rows(rows, random):
    rows = list(rows)
    for _ in range(5):
        rows.insert(int(random.integers(0, len(rows))), rows.pop(int(random.integers(0, len(rows)))))
    return rows


def shuffle_rows(rows, random):
    return [rows[k] for k in random.permutation(len(rows))]


def lose_times(rows, random):
    return [['', *row[1:]] if random.random() < 0.01 else row for row in rows]


DAMAGES = (lose_rows, repeat_rows, lose_cells, add_spikes, move_rows, lose_times, shuffle_rows)


@pytest.mark.parametrize('seed', range(60))
def test_several_damages(tmp_path, seed):
    """Two or three at once, in the order of DAMAGES: what is left is right, or the file is refused."""
    random = np.random.default_rng(seed)
    rows = [list(row) for row in ROWS]
    for k in np.sort(random.choice(len(DAMAGES), 2 + seed % 2, replace=False)):
        rows = DAMAGES[k](rows, random)
    check_truth(read(write(tmp_path, text_of(HEADER, rows))), kept=0.75)


@pytest.mark.parametrize('seed', range(60))
def test_some_bytes_changed(tmp_path, seed):
    """A changed digit cannot be seen; but nothing else than a message or recordings in order comes of any change."""
    random = np.random.default_rng(seed)
    content = bytearray(TEXT.encode())
    for at in random.integers(0, len(content), 1 + seed // 3):
        content[at] = random.choice(list(b'0123456789.,-+eE\n"; \r\x00\xff')) if seed % 2 else random.integers(0, 256)
    well_behaved(write(tmp_path, bytes(content)))


def well_behaved(path):
    """A message, or recordings whose times increase and whose input covers them."""
    try:
        recordings = read(path)
    except UserError as error:
        assert path.name in str(error)
        return
    for recording in recordings:
        assert (np.diff(recording.time) > 0.0).all() and len(recording.time) >= 2
        assert recording.source.times[0] <= recording.time[0] and recording.time[-1] <= recording.source.times[-1]
        assert not any(np.isinf(values).any() for values in recording.channels.values())


NUMBER = st.one_of(st.floats(), st.integers(-3, 3), st.sampled_from(['', 'nan', '1e', 'x', '1;2', '"']))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    header=st.lists(st.sampled_from([*HEADER, 'mode_1', '', 'x']), min_size=1, max_size=6),
    rows=st.lists(st.lists(NUMBER, min_size=0, max_size=6), max_size=30),
)
def test_any_table(tmp_path, header, rows):
    header = ['time_s', 'J_eq_W', *header]
    rows = [[str(cell) for cell in row] for row in rows]
    well_behaved(write(tmp_path, text_of(header, rows)))


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=400))
def test_any_bytes(tmp_path, content):
    well_behaved(write(tmp_path, b'time_s,J_eq_W,alpha_rad\n' + content))


def test_files_that_cannot_be_read(tmp_path, monkeypatch):
    refused(tmp_path / 'missing.csv', 'cannot read', 'No such file')
    (tmp_path / 'loop.csv').symlink_to(tmp_path / 'loop.csv')
    refused(tmp_path / 'loop.csv', 'cannot read')
    os.mkfifo(tmp_path / 'pipe.csv')
    refused(tmp_path / 'pipe.csv', 'no regular file')
    path = write(tmp_path, TEXT)

    def denied(self, *arguments, **options):
        raise PermissionError(13, 'Permission denied')

    monkeypatch.setattr(Path, 'open', denied)
    refused(path, 'cannot read', 'Permission denied')


def test_folders_without_recordings(tmp_path):
    with pytest.raises(UserError, match='holds no recording'):
        read_campaign([tmp_path], 'module', 298.0)
    with pytest.raises(UserError, match='at least one recording'):
        read_campaign([], 'module', 298.0)
    write(tmp_path, 'time_s,J_eq_W\n0,1\n1,1\n')
    with pytest.raises(UserError, match='no measurement in it'):
        read_campaign([tmp_path], 'module', 298.0)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('{', 'is not JSON'), ('[]', 'expected {"noise_std"'), ('{"noise_std": 3}', 'expected {"noise_std"'),
        ('{"noise_std": {"beta": 1}}', 'unknown channel beta'), ('{"noise_std": {"alpha": 0}}', 'expected a positive'),
        ('{"noise_std": {"alpha": -1}}', 'expected a positive'), ('{"noise_std": {"alpha": "big"}}', "got 'big'"),
        ('{"noise_std": {"alpha": NaN}}', 'expected a positive'), ('{"noise_std": {"alpha": true}}', 'expected a positive'),
        ('{"noise_std": {"alpha": Infinity}}', 'expected a positive'), ('\x00', 'is not JSON'),
        ('[' * 100000, 'is not JSON'),
    ],
)  # fmt: skip
def test_wrong_meta(tmp_path, text, words):
    write(tmp_path, TEXT)
    (tmp_path / 'meta.json').write_text(text)
    with pytest.raises(UserError) as caught:
        read_campaign([tmp_path], 'module', 298.0)
    assert words in str(caught.value) and 'meta.json' in str(caught.value)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('', 'expected lines such as'), ('- a\n', 'expected lines such as'),
        ('a: [', 'is not YAML'), ('\x00', 'is not YAML'),
        ('alpha: a\n', 'unknown column alpha (meant alpha_rad?)'), ('system: robot\n', "got 'robot'"),
        ('system: wire\n', 'is for --system wire'), ('strain: s\n', 'a module has no column strain'),
        ('alpha_rad: 3\n', 'expected {column: NAME'), ('alpha_rad: {}\n', 'expected {column: NAME'),
        ('alpha_rad: {column: a, value: 1}\n', 'expected {column: NAME'),
        ('alpha_rad: {column: a, factor: 1}\n', "unknown 'factor'"),
        ('alpha_rad: {column: a, scale: much}\n', 'scale: expected a number'),
        ('alpha_rad: {column: a, scale: 0}\n', 'other than 0'),
        ('alpha_rad: {column: a, scale: .nan}\n', 'scale: expected a number'),
        ('T_E_K: {value: true}\n', 'value: expected a number'),
        ('T_E_K: {value: 1, scale: 2}\n', 'SI units already'), ('alpha_rad: angle\n', 'run.csv has no column angle'),
        ('alpha_rad: alpha_radd\n', 'meant alpha_rad?'),
    ],
)  # fmt: skip
def test_wrong_maps(tmp_path, text, words):
    path = write(tmp_path, TEXT)
    mapping = tmp_path / 'map.yaml'
    mapping.write_text(text)
    with pytest.raises(UserError) as caught:
        read_recording(path, 'module', 298.0, mapping)
    assert words in str(caught.value) and 'map.yaml' in str(caught.value)
