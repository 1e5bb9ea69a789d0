"""Tangents of runs so short that plain Python makes them: over jumps and rows of the input, from moved starts."""

from dataclasses import replace

import numpy as np
import pytest

from sma_sim import Config, Model, default_parameters, module_input, simulate, wire_input
from sma_sim.solver.sensitivities import Neighbour, direct_states, padded, row_shifts, simulate_with_tangents
from sma_sim.solver.simulate import new_run, new_work

DELTA, STEP, RTOL = 1e-6, 1e-3, 1e-6
RAMP = wire_input([0.0, 0.1, 0.2], [0.0195, 0.024, 0.022], [0.0, 0.3, 0.0])
NAMES = ('wire.E_A', 'wire.sigma_MW0', 'wire.c_V')
PULSE = module_input([0.0, 0.05, 0.1], [14.0, -14.0, -14.0])


def configuration(kinetics):
    given = {'solver.rtol': RTOL, 'initial.x_M_1': 0.2}
    return Config(default_parameters() | given, 'wire', kinetics)


def times_moved(source, row, by):
    times = source.times.copy()
    times[row] += by
    return replace(source, times=times)


def with_parameter(config, name, by):
    """The configuration with a parameter larger by a part."""
    return replace(config, parameters={**config.parameters, name: config.parameters[name] * (1.0 + by)})


def run_at(config, source, times, channels):
    model = Model(config)
    start = new_run(model, source.values[0], new_work(model))
    return simulate(model, source, times, initial_state=start, channels=channels)


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
def test_tangents_of_a_short_run_are_those_of_differences(kinetics):
    source, channels = RAMP, ('stress', 'T', 'R')
    config, times = configuration(kinetics), np.linspace(0.0, source.times[-1], 23)
    model = Model(config)
    start = new_run(model, source.values[0], new_work(model))
    beside = []
    for name in NAMES:
        other = Model(with_parameter(config, name, DELTA))
        beside.append(Neighbour(other, new_run(other, source.values[0], new_work(other))))
    found = simulate_with_tangents(model, source, times, start, channels, beside, DELTA)
    plain = run_at(config, source, times, channels)
    assert found.trajectory.completed and found.tangents.shape == (len(NAMES), len(channels), 23)
    before = tuple(jump for jump in plain.jumps if jump.t < source.times[-1])
    assert found.trajectory.jumps == before and (kinetics == 'mas' or len(before) >= 2)
    columns = list(plain.columns)
    assert all((found.trajectory[column] == plain[column]).all() for column in columns)
    for j, name in enumerate(NAMES):
        ends = [run_at(with_parameter(config, name, sign * STEP), source, times, channels) for sign in (1.0, -1.0)]
        for c, column in enumerate(columns):
            expected = (ends[0][column] - ends[1][column]) / (2.0 * STEP)
            size = np.sqrt(np.mean(expected**2)) + 1e-3 * np.abs(plain[column]).max()
            assert np.sqrt(np.mean((found.tangents[j, c] - expected) ** 2)) < 0.01 * size, (name, column)
    inner = slice(1, -1)
    ahead, behind = (run_at(config, source, times[inner] + h, channels) for h in (1e-6, -1e-6))
    for c, column in enumerate(columns):
        slope = (ahead[column] - behind[column]) / 2e-6
        smooth = np.abs(found.slopes[c][inner] - slope) < 0.02 * np.abs(slope).max()
        assert smooth.mean() > 0.9  # not where a row begins
    before = run_at(config, source, times[-1:] - 1e-4, channels)['T_K']
    assert found.slopes[channels.index('T')][-1] == pytest.approx((plain['T_K'][-1:] - before)[0] / 1e-4, rel=1e-3)


def test_shifts_of_rows_are_derivatives_of_their_times():
    beside = [Neighbour(), Neighbour(source=times_moved(PULSE, 1, 3.0 * DELTA)), Neighbour(source=PULSE)]
    shifts = row_shifts(PULSE, beside, DELTA)
    assert shifts.shape[1] == padded(3) == 8 and padded(8) == 8 and padded(9) == 16
    assert shifts[:, 1] == pytest.approx([0.0, 3.0, 0.0], abs=1e-6) and not shifts[:, [0, 2, 3]].any()
    other = replace(PULSE, values=PULSE.values + 0.1)
    assert row_shifts(PULSE, [Neighbour(source=other)], DELTA) is None
    fewer = module_input([0.0, 0.1], [14.0, -9.0])
    assert row_shifts(PULSE, [Neighbour(source=fewer)], DELTA) is None


@pytest.mark.parametrize('system', ['module', 'wire', 'lever', 'wire_under_load_at_T'])
def test_states_that_sensors_show_as_they_are(system):
    model = Model(Config(system=system))
    p, channels = model.compiled, model.structure.channels
    found = dict(zip(channels, direct_states(model, np.arange(len(channels))).tolist(), strict=True))
    for k, coordinate in enumerate(model.structure.coordinate_names):
        assert found.pop(coordinate) == k
    for i, suffix in enumerate(model.structure.wire_suffixes):
        if p.imposed_T < 0:
            assert found.pop(f'T{suffix}') == p.first_T + i
    assert set(found.values()) == {-1} and len(found) >= 2 * p.wires - 1
