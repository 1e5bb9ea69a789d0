"""What the page of `sma-sim explore` offers: controls of every structure, commands, curves reduced to pixels."""

import json

import numpy as np
import pytest

from sma_sim.explore.command import command_from, first_command, input_of
from sma_sim.explore.controls import controls_of
from sma_sim.explore.decimation import decimated, where_it_moves
from sma_sim.explore.packing import Numbers
from sma_sim.explore.runs import LOOP_SAMPLES, command_loop, run_of
from sma_sim.model.config import Config
from sma_sim.model.effects.discovery import find_effects
from sma_sim.model.errors import UserError
from sma_sim.model.structures.discovery import package_structures


def test_decimation_keeps_every_pixel():
    """Of each column of pixels the first, last, least and greatest sample; all of few samples."""
    rng = np.random.default_rng(3)
    time, values = np.sort(rng.uniform(0.0, 10.0, 20_000)), rng.standard_normal(20_000)
    values[rng.integers(0, 20_000, 50)] = np.nan
    at, known = decimated(time, values, 300), np.flatnonzero(np.isfinite(values))
    assert len(at) <= 4 * 300 and (np.diff(at) > 0).all() and np.isfinite(values[at]).all()
    ends = time[known[0]], time[known[-1]]
    columns = np.minimum((300 * (time - ends[0]) / (ends[1] - ends[0])).astype(int), 299)
    for column in range(300):
        every, kept = (values[indices[columns[indices] == column]] for indices in (known, at))
        assert [every[0], every[-1], every.min(), every.max()] == [kept[0], kept[-1], kept.min(), kept.max()]
    assert decimated(time[:100], values[:100], 300).tolist() == [k for k in range(100) if np.isfinite(values[k])]


def test_a_loop_is_sampled_where_it_moves():
    """A jump between two rests, at once in one column and gradual in another: no stretch of the way is left out."""
    time = np.linspace(0.0, 100.0, 20_001)
    jump, slow = np.clip((time - 50.0) / 0.5, 0.0, 1.0), np.minimum(time, 60.0)
    at = where_it_moves([jump, slow, np.full(20_001, 3.0), np.full(20_001, np.nan)], 500)
    assert at[0] == 0 and at[-1] == 20_000 and (np.diff(at) > 0).all() and 300 < len(at) <= 500
    way = np.abs(np.diff(jump[at])) + np.abs(np.diff(slow[at])) / 60.0
    assert way.max() < 0.02
    assert where_it_moves([jump[:100]], 500).tolist() == list(range(100)) and len(where_it_moves([time[:0]], 500)) == 0
    assert len(where_it_moves([np.zeros(20_001)], 500)) <= 500


def test_the_loop_of_the_command_is_over_the_heating_that_changes():
    """Of three bundles the second is heated."""
    config = Config(system='spatial')
    rows = [[0.0, 0.0, 0.0, 0.0], [2.0, 0.0, 9.0, 0.0], [20.0, 0.0, 0.0, 0.0], [30.0, 0.0, 0.0, 0.0]]
    run = run_of(config, command_from({**first_command(config).as_data(), 'rows': rows}, config.structure))
    numbers = Numbers()
    (loop,) = command_loop(run, numbers)
    assert loop['x'] == 'J_2 [W]' and loop['y'].endswith('[deg]')
    first, count = loop['curves'][0]['x']
    drawn = np.frombuffer(b''.join(numbers._parts))[first : first + count]
    assert set(drawn) == {0.0, 9.0} and len(drawn) <= LOOP_SAMPLES


@pytest.mark.parametrize('system', list(package_structures()))
def test_every_structure_has_controls_and_a_command_that_moves_it(system):
    config = Config(system=system)
    structure, first = config.structure, first_command(config)
    source = input_of(first, config)
    assert source.names == structure.input_columns and np.ptp(source.values, axis=0).max() > 0.0
    assert command_from(json.loads(json.dumps(first.as_data())), structure) == first
    run = run_of(config, first).columns
    assert max(np.ptp(run[name]) for name in run if name.startswith('x_M')) > 0.1, 'no wire transforms'
    controls = controls_of(config, find_effects())
    for group in [*controls['groups'], *controls['effects']]:
        for one in group['parameters']:
            value = one['value']
            assert one['least'] <= one['low'] <= one['high'] <= one['most'], one
            assert value is None or one['low'] <= value <= one['high'], one
            assert one['meaning'] and one['unit'], one
    assert controls['effects'] and all(effect['equation'] for effect in controls['effects'])


def test_commands_are_what_they_say():
    config = Config()
    first = first_command(config).as_data()

    def values(**changed):
        return input_of(command_from({**first, **changed}, config.structure), config).values[:, 0]

    swing = values(kind='sine', amplitude=3.0, offset=1.0, period=10.0)
    assert abs(swing.max() - 4.0) < 0.01 and abs(swing.min() + 2.0) < 0.01
    file = {'kind': 'file', 'name': 'mine.csv'}
    assert values(**file, text='time_s,J_eq_W\n0,0\n10,3\n20,0\n').tolist() == [0.0, 3.0, 0.0]
    wrong = {
        'time_s\n1\n': 'J_eq_W',
        'time_s,J_eq_W\n0,1\n': 'two rows',
        'time_s,J_eq_W\n0,a\n1,2\n': 'mine.csv',
        '': 'mine.csv',
    }
    for text, said in wrong.items():
        with pytest.raises(UserError, match=said):
            values(**file, text=text)
    with pytest.raises(UserError, match='row 3'):
        values(rows=[[0.0, 0.0], [2.0, 1.0], [1.0, 0.0]])
