"""Inputs of many rows: what is joined, where a run is cut between two looks at Ctrl-C, which samples may be asked for."""

import numpy as np
import pytest
from systems import make_model

from sma_sim import Input, UserError, module_input, simulate
from sma_sim.solver.inputs import requested_times, segments
from sma_sim.solver.integrate import InputStretches, stretch
from sma_sim.solver.simulate import PIECES_AT_ONCE

ROWS = 2 * PIECES_AT_ONCE + 500
MANY = np.linspace(0.0, 9.0, ROWS)


def test_equal_rows_of_a_held_input_are_joined():
    times, values, slopes = segments(module_input([0.0, 1.0, 2.0, 3.0, 4.0], [5.0, 5.0, 5.0, -2.0, -2.0]))
    assert times.tolist() == [0.0, 3.0, 4.0] and values[:, 0].tolist() == [5.0, -2.0, -2.0] and not slopes.any()
    one = segments(module_input([0.0, 1.0], [5.0, 5.0]))
    assert one[0].tolist() == [0.0, 1.0]
    moving = segments(module_input([0.0, 1.0, 2.0], [5.0, 5.0, 5.0], T_E=[290.0, 291.0, 291.0]))
    assert moving[0].tolist() == [0.0, 1.0, 2.0]


def test_the_flow_depends_on_time_where_the_input_or_an_effect_does():
    times, values, slopes = np.array([0.0, 1.0, 2.0]), np.zeros((3, 2)), np.zeros((3, 2))
    slopes[1, 1] = 3.0
    for by_effect, expected in ((False, [False, True]), (True, [True, True])):
        of_input = InputStretches(times, values, slopes, by_effect)
        assert [bool(stretch(k, of_input).moving) for k in (0, 1)] == expected


def test_a_run_of_many_rows_is_that_of_few():
    """Rows that say the same again, with a hair's difference that keeps them from being joined."""
    hair = 1e-12 * np.arange(ROWS)
    command = np.where(MANY < 4.0, 8.0, -6.0)
    many = simulate(make_model(), Input(MANY, np.column_stack([command, 298.0 + hair]), (False, False)), 10.0)
    few = simulate(make_model(), module_input([0.0, MANY[np.argmax(MANY >= 4.0)], 9.0], [8.0, -6.0, -6.0]), 10.0)
    assert many.completed and many['alpha_rad'] == pytest.approx(few['alpha_rad'], abs=1e-5)


def test_a_run_of_many_rows_ends_where_it_cannot_go_on():
    """In the first piece, and tells how far each has come until then."""
    parts = []
    wild = Input(MANY, np.column_stack([np.where(np.arange(ROWS) % 2, 9.0, -9.0), np.full(ROWS, 298.0)]), (False, False))
    stopped = simulate(make_model(), wild, 10.0, max_steps=300, progress=parts.append)
    assert not stopped.completed and stopped.reason == 'step limit reached' and stopped.end < 4.0 and parts == []
    assert simulate(make_model(), wild, 10.0, progress=parts.append).completed
    assert len(parts) == 3 and parts[-1] == 1.0 and sorted(parts) == parts


@pytest.mark.parametrize(
    ('times', 'words'),
    [
        ([0.0, 1.0, 1.0], 'that increase, got 1 s and then 1 s'),
        ([2.0, 1.0], 'that increase, got 2 s and then 1 s'),
        ([-0.1, 1.0], 'from -0.1 to 1 s: expected times of the input, 0 to 4 s'),
        ([0.0, 4.1], 'from 0 to 4.1 s: expected times of the input, 0 to 4 s'),
        ([[0.0, 1.0]], r'times \(k,\) \[s\] that increase, got an array of shape \(1, 2\)'),
    ],
)
def test_samples_must_increase_within_the_input(times, words):
    with pytest.raises(UserError, match=f'sample_times.*{words}'):
        requested_times(module_input([0.0, 4.0], [1.0, 1.0]), np.array(times))
