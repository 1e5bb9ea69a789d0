"""Several damages at once, changed bytes, any table: a message, or recordings that are right."""

import numpy as np
import pytest
from corrupted import COUNT, HEADER, ROWS, TEXT, TRUTH, check_truth, read, write
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_recordings import text_of

from sma_sim.model.errors import UserError


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
