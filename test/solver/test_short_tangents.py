"""Tangents of runs so short that plain Python makes them: over jumps and rows of the input, from moved starts."""

from dataclasses import replace

import numpy as np
import pytest
from systems import active

from sma_sim import Config, Input, Model, default_parameters, module_input, simulate, wire_input
from sma_sim.solver.sensitivities import Neighbour, direct_states, padded, shifts_of_rows, simulate_with_tangents
from sma_sim.solver.simulate import copy_of_run, new_run, new_work

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
    found = simulate_with_tangents(model, source, times, start, channels, beside)
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


def test_a_sample_at_a_row_has_the_slopes_after_it_whichever_samples_come_before():
    """The strain goes back from there on, and the wire is heated no more."""
    config, channels, row = configuration('hybrid'), ('stress', 'T'), RAMP.times[1]
    model = Model(config)
    start = new_run(model, RAMP.values[0], new_work(model))
    alone, after_others = (
        simulate_with_tangents(model, RAMP, np.array(times), start, channels, (Neighbour(),)).slopes[:, -1]
        for times in ([row], [0.3 * row, row - 1e-4, row])
    )
    plain = run_at(config, RAMP, np.array([row, row + 1e-6]), channels)
    after = [(plain[column][1] - plain[column][0]) / 1e-6 for column in plain.columns]
    assert (alone == after_others).all() and alone == pytest.approx(after, rel=1e-2)


def with_clock(rate):
    """A wire seen by a clock that gains so many seconds in one."""
    return Config(configuration('hybrid').parameters, 'wire', 'hybrid', (active('clock_skew', rate=rate),))


def test_a_clock_that_gains_is_counted_from_the_beginning_of_the_run():
    """What it shows at t was seen at (1 - rate) t."""
    channels, times, source = ('stress', 'T'), np.linspace(0.0, 0.2, 9), replace(RAMP, times=RAMP.times + 5.0)
    model = Model(with_clock(0.2))
    start = new_run(model, source.values[0], new_work(model))
    faster = Neighbour(model=Model(with_clock(0.2 + DELTA)))
    found = simulate_with_tangents(model, source, 5.0 + times, start, channels, (faster,))
    for c, column in enumerate(('stress_Pa', 'T_K')):
        seen, later, earlier = (
            run_at(configuration('hybrid'), RAMP, (0.8 + by) * times, channels)[column] for by in (0.0, -1e-4, 1e-4)
        )
        assert found.trajectory[column] == pytest.approx(seen, rel=1e-4)
        by_rate = (later - earlier) / 2e-4
        assert np.median(np.abs(found.tangents[0, c] - by_rate)) < 1e-3 * np.abs(by_rate).max() > 0.0


def test_shifts_of_rows_are_derivatives_of_their_times():
    beside = [Neighbour(), Neighbour(source=times_moved(PULSE, 1, 3.0 * DELTA)), Neighbour(source=PULSE)]
    shifts = shifts_of_rows(PULSE, beside, DELTA)
    assert shifts.times.shape[1] == padded(3) == 8 and padded(8) == 8 and padded(9) == 16
    assert shifts.times[:, 1] == pytest.approx([0.0, 3.0, 0.0], abs=1e-6) and not shifts.times[:, [0, 2, 3]].any()
    assert len(shifts.values) == 0 == len(shifts.held_until(4).values) and shifts.held_until(4).times.shape == (4, 8)
    for size, same in ((0.5e-4, True), (1.5e-4, False)):  # of a difference between rows that are taken for the same
        near = shifts_of_rows(PULSE, [Neighbour(source=replace(PULSE, values=PULSE.values * (1.0 + size)))], DELTA)
        assert (near is not None) == same
    other = replace(PULSE, values=PULSE.values + 0.1)
    assert shifts_of_rows(PULSE, [Neighbour(source=other)], DELTA) is None
    fewer = module_input([0.0, 0.1], [14.0, -9.0])
    assert shifts_of_rows(PULSE, [Neighbour(source=fewer)], DELTA) is None


def test_shifts_of_rows_are_derivatives_of_their_values_at_the_same_time():
    """A row that moves along its line changes nothing; one that rises turns the lines before and after it."""
    along = replace(times_moved(RAMP, 1, DELTA), values=RAMP.values + [[0, 0, 0], [0.045 * DELTA, 0, 0], [0, 0, 0]])
    higher = replace(RAMP, values=RAMP.values + np.array([[0, 0, 0], [2e-3, 0.3, 1.0], [0, 0, 1.0]]) * DELTA)
    shifts = shifts_of_rows(RAMP, [Neighbour(source=along), Neighbour(source=higher)], DELTA)
    assert shifts.times[1, 0] == pytest.approx(1.0) and shifts.values[:1, 0] == pytest.approx(0.0)
    assert shifts.slopes[0, 0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    assert shifts.values[:, 1] == pytest.approx(np.array([[0, 0, 0], [2e-3, 0.3, 1.0], [0, 0, 1.0]]), abs=1e-6)
    assert shifts.slopes[:, 1, 0] == pytest.approx([0.02, -0.02, 0.0], abs=1e-6)
    longer = shifts.held_until(4)
    assert (longer.values[3] == shifts.values[2]).all() and not longer.times[3].any()


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
@pytest.mark.parametrize('column', [0, 1, 2])
def test_tangents_of_what_a_wire_is_given_are_those_of_differences(kinetics, column):
    """Of a strain that goes up and down in lines, of a power and of the ambient temperature, from which it begins; the last
    values are held for longer than the input."""
    config, channels, times = configuration(kinetics), ('stress', 'T'), np.linspace(0.0, 0.25, 29)
    change = np.array([[2e-4, 0.0, 2.0], [1e-4, 0.1, 2.0], [-2e-4, 0.0, 2.0]]) * (np.arange(3) == column)

    def given(part):
        return replace(RAMP, values=RAMP.values + part * change)

    def shown(part):
        held = replace(
            given(part), times=np.r_[RAMP.times, 0.25], values=np.vstack([given(part).values, given(part).values[-1:]])
        )
        return run_at(config, held, times, channels)

    model = Model(config)
    first, beside = (new_run(model, given(part).values[0], new_work(model)) for part in (0.0, DELTA))
    found = simulate_with_tangents(model, RAMP, times, first, channels, (Neighbour(None, beside, given(DELTA)),))
    ends = [shown(sign * 10.0 * STEP) for sign in (1.0, -1.0)]
    for c, name in enumerate(('stress_Pa', 'T_K')):
        expected = (ends[0][name] - ends[1][name]) / (20.0 * STEP)
        size = np.sqrt(np.mean(expected**2)) + 1e-5 * np.abs(ends[0][name]).max()
        assert np.sqrt(np.mean((found.tangents[0, c] - expected) ** 2)) < 0.01 * size, name


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


def test_tangents_of_a_wire_are_exact_where_its_run_is():
    """Ramps, a row of heating, jumps between: the difference to extrapolated ones falls with the tolerance."""
    config, channels = with_parameter(configuration('hybrid'), 'solver.rtol', 1e-8 / RTOL - 1.0), ('stress', 'T', 'R')
    model, times = Model(config), np.linspace(0.0, 0.2, 12)
    start = new_run(model, RAMP.values[0], new_work(model))
    moved = [Model(with_parameter(config, name, DELTA)) for name in NAMES]
    beside = [Neighbour(other, new_run(other, RAMP.values[0], new_work(other))) for other in moved]
    found = simulate_with_tangents(model, RAMP, times, start, channels, beside)
    assert [(jump.source, jump.target) for jump in found.trajectory.jumps] == [(3, 4), (4, 3), (3, 5)]
    for j, name in enumerate(NAMES):
        runs = {h: run_at(with_parameter(config, name, h), RAMP, times, channels) for h in (2e-4, 1e-4, -1e-4, -2e-4)}
        for c, column in enumerate(runs[1e-4].columns | runs[1e-4].resistances):
            wide, close = ((runs[h][column] - runs[-h][column]) / (2.0 * h) for h in (2e-4, 1e-4))
            expected = (4.0 * close - wide) / 3.0
            assert np.abs(found.tangents[j, c] - expected).max() < 1e-5 * np.abs(expected).max(), (name, column)


class MovedLever:
    """Short runs of the lever from a start in motion: its wires' stiffness, its start, or the time of a row is moved."""

    channels, times = ('angle', 'F_1', 'F_2', 'T_1', 'R_2'), np.linspace(0.0, 0.0551, 8)

    def __init__(self):
        self.model = Model(Config({'solver.rtol': 1e-6}, 'lever'))
        self.start = new_run(self.model, np.array([0.0, 298.0]), new_work(self.model), (0.4, 0.6))
        self.start.state.y[:] += 1e-3 * self.model.scales * [0.3, -0.9, 0.5, 0.7]

    def moved(self, what, z):
        """Model, start and input."""
        model, start, row = self.model, copy_of_run(self.model, self.start), 0.05
        if what == 'stiffness':
            model = Model(with_parameter(self.model.config, 'wire.E_A', z))
        elif what == 'start':
            start.state.y[:] += 0.1 * z * self.model.scales * [0.7, 0.5, -0.9, 0.3]
            start.state.x_frozen[:] += z * np.array([0.3, 0.7])
        else:
            row += z * 0.04
        rows = np.column_stack([[9.0, -8.0, -8.0], [298.0] * 3])
        return model, start, Input(np.array([0.0, row, 0.0551]), rows, (False, False), model.structure.input_columns)

    def samples(self, what, z):
        model, start, source = self.moved(what, z)
        run = simulate(model, source, self.times, initial_state=start, channels=self.channels)
        return np.array(list((run.columns | run.resistances).values()))


def test_tangents_of_a_structure_are_exact_where_its_run_is():
    """Over two jumps of its wires and a row of its command, from whatever is moved."""
    lever = MovedLever()
    stiffer, other, later = (lever.moved(what, DELTA) for what in ('stiffness', 'start', 'row'))
    beside = [Neighbour(model=stiffer[0]), Neighbour(initial_state=other[1]), Neighbour(source=later[2])]
    model, start, source = lever.moved('row', 0.0)
    found = simulate_with_tangents(model, source, lever.times, start, lever.channels, beside)
    assert [jump.wire for jump in found.trajectory.jumps] == [1, 2, 2] and found.trajectory.completed
    expected = np.array(
        [(lever.samples(what, 3e-4) - lever.samples(what, -3e-4)) / 6e-4 for what in ('stiffness', 'start', 'row')]
    )
    assert (np.abs(found.tangents - expected).max(axis=2) < 1e-3 * np.abs(expected).max(axis=2)).all()


def test_a_run_with_tangents_that_stops_says_why():
    """In whichever row; with what was sampled until then."""
    config, channels = configuration('hybrid'), ('stress', 'T')
    model, times = Model(config), np.linspace(0.0, 0.2, 21)
    start = new_run(model, RAMP.values[0], new_work(model))
    whole = simulate_with_tangents(model, RAMP, times, start, channels, (Neighbour(),))
    for most in (3, whole.trajectory.steps - 1):
        found = simulate_with_tangents(model, RAMP, times, start, channels, (Neighbour(),), max_steps=most)
        count = len(found.trajectory.time)
        assert found.trajectory.reason == 'step limit reached' and not found.trajectory.completed and 0 < count < 21
        assert found.trajectory.steps == most and found.tangents.shape == (1, 2, count) and found.slopes.shape == (2, count)
        assert (found.slopes == whole.slopes[:, :count]).all()
    assert whole.trajectory.completed and not whole.tangents.any() and len(whole.trajectory.time) == 21
    one_row = wire_input([0.0], [0.02])
    assert simulate_with_tangents(model, one_row, [0.0], start, channels, (Neighbour(),)) is None
