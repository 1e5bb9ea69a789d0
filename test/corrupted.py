"""A recording to be corrupted, and what a reader must make of it: a repair that is said and right, or a message."""

import numpy as np
import pytest
from made_recordings import RATE, cells_of, module_columns, text_of

from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.evidence.data.recordings import read_recording
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
