"""Rows that are cut, moved, lost or repeated, cells that are missing or spikes, times that are wrong: repaired, and said."""

import numpy as np
import pytest
from corrupted import (
    COUNT,
    HEADER,
    MEASURED,
    ROWS,
    SEEDS,
    TEXT,
    TRUTH,
    check_truth,
    notes_of,
    read,
    refused,
    repaired,
    with_cell,
    write,
)
from made_recordings import RATE, cells_of, text_of

from sma_sim.evidence.data.recordings import read_recording


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


def test_spikes_of_a_command_are_repaired_and_said(tmp_path):
    """Single rows far beyond all that lasts; a short pulse of the usual size stays."""
    J = np.repeat([0.0, 1.0, 2.0, 0.5], 100)
    J[250] = 0.0
    clean, J = J.copy(), J.copy()
    J[[40, 180, 333]] = 100.0, 1000.0, 12.0
    rows = [f'{k / 10},{power},{300 + 0.01 * k}' for k, power in enumerate(J)]
    file = tmp_path / 'run.csv'
    file.write_text('\n'.join(['time_s,J_W,T_K,strain', *(f'{row},0.03' for row in rows), '']))
    (found,) = read_recording(file, 'wire', 298.0)
    assert any('3 spikes of one row, the first at 4 s' in note for note in found.notes)
    held = np.searchsorted(found.source.times, np.arange(400) / 10, side='right') - 1
    assert found.source.values[held, 1] == pytest.approx(clean)
