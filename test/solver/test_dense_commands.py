"""Runs and their tangents under commands that change at every moment: at the errors of runs with few, in fewer steps."""

from dataclasses import replace

import numpy as np
import pytest
from closed_loops import closed_loop
from systems import active, make_model

from sma_sim import module_input, simulate
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.discovery import ActiveEffect, package_effects
from sma_sim.model.parameters import wire_constants
from sma_sim.model.structures.discovery import package_structures
from sma_sim.solver import smoothed_input
from sma_sim.solver.inputs import input_between, segments
from sma_sim.solver.sensitivities import Neighbour, simulate_with_tangents
from sma_sim.solver.simulate import new_run, new_work
from sma_sim.solver.smoothed_input import TEMPERATURE_SCALE, Leeway, Shifts, heating_of_wires, passed_before, smoothed

DURATION, DELTA = 20.0, 1e-6
ROWS = 50 * DURATION
TIMES = np.linspace(0.0, DURATION, 467)  # most within rows
CASES = [('module', 'hybrid'), ('module', 'mas'), ('lever', 'hybrid'), ('lever', 'mas'), ('spatial', 'hybrid')]


def exact(model, source):
    return simulate(precise(model), source, TIMES)


def precise(model, rtol=1e-8):
    config = model.config
    return type(model)(replace(config, parameters={**config.parameters, 'solver.rtol': rtol}))


def errors(model, run, other):
    """The largest differences of the coordinates, and of the temperatures, over their scales."""
    coordinates = [c.column for c in model.structure.coordinates]
    temperatures = [f'T{suffix}_K' for suffix in model.structure.wire_suffixes]
    pose = [np.abs(run[name] - other[name]).max() / scale for name, scale in zip(coordinates, model.scales, strict=False)]
    return max(pose), max(np.abs(run[name] - other[name]).max() / TEMPERATURE_SCALE for name in temperatures)


def assert_exact(model, source):
    """Temperatures to 3e-4 K, coordinates to 5e-4 of their scales: for the module's U_x, which needs most steps, 2e-8 m."""
    run = simulate(model, source, TIMES)
    pose, temperature = errors(model, run, exact(model, source))
    assert run.completed and pose < 5e-4 and temperature < 1e-5
    return run


@pytest.mark.parametrize(('system', 'kind'), CASES)
def test_a_closed_loop_is_as_exact_as_other_runs(system, kind):
    model = make_model(system, kind)
    source = closed_loop(model, DURATION, 0)
    assert assert_exact(model, source).steps < 2.0 * ROWS


def test_a_command_that_is_mostly_noise_takes_few_trials():
    """A MAS wire begins to transform within most rows: rejected steps show the order of that."""
    model = make_model('module', 'mas')
    run = assert_exact(model, closed_loop(model, DURATION, 0, per_scale=100.0))
    assert run.steps < 3.0 * ROWS and run.rejected < 0.9 * ROWS


@pytest.mark.parametrize('name', ['driver_lag', 'driver_deadband', 'resistance_feedback'])
def test_a_driver_sees_every_row(name):
    model = make_model('module', 'hybrid', [active(name)])
    assert_exact(model, closed_loop(make_model(), DURATION, 1))


@pytest.mark.parametrize('rtol', [1e-5, 1e-4])
@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
@pytest.mark.parametrize('friction', [active('guide_friction', mu=0.1, v_s=4e-5), active('joint_friction')])
def test_forces_between_rows_are_exact_where_friction_adjusts_a_rate_at_once(friction, kind, rtol):
    """With each row the rates settle within microseconds: both ends of it may be exact, and what lies between not."""
    times = np.arange(0.0, DURATION, 0.2)
    noise = 0.02 * np.random.default_rng(3).standard_normal(len(times))
    source = module_input([*times, DURATION], [*(3.0 * np.sin(0.27 * times + 1.0) + noise), 0.0])
    model = precise(make_model('module', kind, [friction]), rtol)
    run, other = (simulate(one, source, np.arange(0.0, DURATION, 0.05)) for one in (model, precise(model)))
    for name, scale in (('U_y_m', 1e-3), ('F_1_N', 10.0), ('F_2_N', 10.0)):
        assert np.sqrt(np.mean((run[name] - other[name]) ** 2)) < 10.0 * rtol * scale


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_a_dense_run_in_parts_is_the_whole_to_the_last_bit(kind):
    model = make_model('module', kind)
    source = closed_loop(model, DURATION, 0)
    whole, cut = simulate(model, source, TIMES), float(source.times[403])
    k = int(np.searchsorted(TIMES, cut))
    first = simulate(model, input_between(source, 0.0, cut), TIMES[:k])
    rest = simulate(model, input_between(source, cut, DURATION), TIMES[k:], initial_state=first.state)
    for name in whole.columns:
        assert np.array_equal(np.concatenate([first[name], rest[name]]), whole[name])


def test_few_rows_are_not_crossed_in_one_step():
    """A row that heats a wire by much is followed by short steps, and so is one long before the next."""
    model = make_model()
    for times in ([0.0, 5.0, 5.02, 10.0], [0.0, 4.0, 8.0, 10.0]):
        source = module_input(times, [0.0, 9.0, -9.0, -9.0])
        assert simulate(model, source, 100.0).steps > 100


# The input of tangents


def tolerance(model):
    return smoothed_input.SMOOTHED * model.config.parameters['solver.rtol'] * TEMPERATURE_SCALE


def smoothed_at(model, source, shifts=None):
    return smoothed(model, source, float(source.times[-1]), shifts=shifts)


def test_stretches_keep_mean_and_first_moment_of_every_wire():
    model = make_model(solver__rtol=1e-4)
    source = closed_loop(model, DURATION, 0)
    found, (times, values, _) = smoothed_at(model, source), segments(source)
    heating, wire = heating_of_wires(values, 2, True), model.wire
    assert len(found.times) < 0.5 * len(times) and found.times[0] == times[0] and found.times[-1] == times[-1]
    first = np.searchsorted(times, found.times)
    assert np.array_equal(times[first], found.times)
    capacity = wire.n * wire.volume * wire.rho * wire.c_V
    for k in range(len(first) - 1):
        rows, t = slice(first[k], first[k + 1]), times[first[k] : first[k + 1] + 1] - times[first[k]]
        line, slope = found.values[k, :2], found.slopes[k, :2]
        assert (line >= 0.0).all() and (line + slope * t[-1] >= 0.0).all()
        passed = np.cumsum(heating[rows, :2] * np.diff(t)[:, None], axis=0)
        ahead = np.vstack([np.zeros(2), passed - line * t[1:, None] - 0.5 * slope * t[1:, None] ** 2])
        assert np.abs(ahead).max() / capacity <= tolerance(model) * (1.0 + 1e-9)
        assert np.abs(ahead[-1]).max() < 1e-12
        # int E dt over rows of constant power: E is a parabola in each, E'' = -slope
        h = np.diff(t)[:, None]
        area = (0.5 * (ahead[:-1] + ahead[1:]) * h + slope * h**3 / 12.0).sum(axis=0)
        assert np.abs(area).max() < 1e-12


def test_what_cannot_be_smoothed_stays():
    """Few rows, a threshold of a heating that depends on the wire, lines, precise runs; a linear driver may have states."""
    model = make_model(solver__rtol=1e-4)
    source = closed_loop(model, 5.0, 0)
    assert smoothed_at(model, source) is not None
    assert smoothed_at(precise(model), source) is None
    assert smoothed_at(model, module_input([0.0, 1.0, 5.0], [0.0, 9.0, -9.0])) is None
    assert smoothed_at(model, replace(source, linear=(True, False))) is None
    lagging, on_wire = ['driver_lag', 'power_scale'], ['driver_deadband', 'resistance_feedback']
    for effects, kept in ((on_wire, True), (['driver_deadband'], False), (lagging, False), (['gravity'], False)):
        other = make_model('module', 'hybrid', [active(name) for name in effects], solver__rtol=1e-4)
        assert (smoothed_at(other, source) is None) == kept, effects
    limited = make_model('module', 'hybrid', [active('driver_lag', rise=0.5)], solver__rtol=1e-4)
    assert smoothed_at(limited, source) is None


def test_shifts_of_rows_are_shifts_of_moments():
    """Against the lines through rows that are moved indeed, within the same stretches."""
    model = make_model(solver__rtol=1e-4)
    source = closed_loop(model, 5.0, 0)
    times = segments(source)[0]
    shift = np.zeros((len(times), 8))
    shift[1:-1, 3] = np.random.default_rng(2).uniform(0.0, 0.02, len(times) - 2)
    found = smoothed_at(model, source, Shifts(shift, *np.zeros((2, len(times), 8, 2))))
    k = int(np.argmax(np.diff(np.searchsorted(times, found.times))))
    rows = np.arange(*np.searchsorted(times, found.times[k : k + 2]))
    heating = heating_of_wires(segments(source)[1], 2, True)
    rise, length = heating[rows] - heating[rows - 1], found.times[k + 1] - found.times[k]
    impulses, about = -shift[rows, 3, None] * rise, (times[rows] - found.times[k])[:, None]
    value, slope = found.value_shifts[k, 3], found.slope_shifts[k, 3]
    assert value * length + 0.5 * slope * length**2 == pytest.approx(impulses.sum(axis=0), abs=1e-12)
    assert 0.5 * value * length**2 + slope * length**3 / 3.0 == pytest.approx((impulses * about).sum(axis=0), abs=1e-12)
    assert not found.value_shifts[:, :3].any() and not found.value_shifts[:, 4:].any()


def test_shifts_of_powers_and_of_the_room_are_those_of_the_lines_through_them():
    """Of the wire that is heated, and for as long as the last values are held."""
    model = make_model(solver__rtol=1e-4)
    source = closed_loop(model, 5.0, 0)
    times, values, _ = segments(source)
    change = np.random.default_rng(3).uniform(0.5, 1.0, values.shape)
    shifts = Shifts(np.zeros((len(times), 8)), *np.zeros((2, *values.shape[:1], 8, 2)))
    shifts.values[:, 5] = change
    found = smoothed(model, source, float(times[-1]) + 3.0, shifts=shifts)
    first, heating = np.searchsorted(times, found.times[:-1]), heating_of_wires(values, 2, True)
    by_wire = np.column_stack([change[:, 0] * (heating[:, 0] > 0), -change[:, 0] * (heating[:, 1] > 0), change[:, 1]])
    for k in range(len(first) - 1):
        rows, lengths = slice(first[k], first[k + 1]), np.diff(times[first[k] : first[k + 1] + 1])
        middles, length = times[rows] + 0.5 * lengths - found.times[k], lengths.sum()
        value, slope, brought = found.value_shifts[k, 5], found.slope_shifts[k, 5], by_wire[rows] * lengths[:, None]
        assert value * length + 0.5 * slope * length**2 == pytest.approx(brought.sum(axis=0), abs=1e-12)
        moment = 0.5 * value * length**2 + slope * length**3 / 3.0
        assert moment == pytest.approx((brought * middles[:, None]).sum(axis=0), abs=1e-12)
    assert found.value_shifts[-1, 5] == pytest.approx(by_wire[-1]) and not found.slope_shifts[-1].any()
    assert not found.value_shifts[:, :5].any() and not found.value_shifts[:, 6:].any()


# Tangents


def tangents_of(model, source, names, channels, *moved_inputs):
    def started(one):
        return new_run(one, np.asarray(source.values[0]), new_work(one))

    def moved(name):
        known = model.config.parameters | {
            f'effects.{one.effect.name}.{short}': value
            for one in model.config.effects for short, value in one.by_short_name.items()
        }  # fmt: skip
        other = type(model)(model.config.variant({name: known[name] * (1.0 + DELTA)}))
        return Neighbour(other, started(other))

    beside = [moved(name) for name in names]
    beside += [Neighbour(None, new_run(model, other.values[0], new_work(model)), other) for other in moved_inputs]
    return simulate_with_tangents(model, source, TIMES, started(model), channels, beside)


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_tangents_of_a_closed_loop(kind, monkeypatch):
    """Of parameters, of the power, of the ambient temperature, and of the moments at which the command had changed; the run
    differs by no more than is allowed."""
    model = make_model('module', kind, solver__rtol=1e-4 if kind == 'hybrid' else 3e-5)
    source = closed_loop(model, DURATION, 0)
    later = source.times + DELTA * np.r_[0.0, np.full(len(source.times) - 2, 0.01), 0.0]
    names, channels = ('wire.E_A', 'wire.c_V', 'wire.lambda', 'beam.E'), ('U_y', 'alpha', 'F_1', 'T_2')
    changes = [1.0 + np.array([1.0, 0.0]) * DELTA, 1.0 + np.array([0.0, 0.01]) * DELTA]
    inputs = [replace(source, values=source.values * change) for change in changes] + [replace(source, times=later)]
    found = tangents_of(model, source, names, channels, *inputs)
    monkeypatch.setattr(smoothed_input, 'SMOOTHED', 0.0)
    row_by_row = tangents_of(model, source, names, channels, *inputs)
    assert found.trajectory.steps < 0.8 * row_by_row.trajectory.steps
    size = np.sqrt((row_by_row.tangents**2).mean(axis=2))
    size[:-1] = size[:-1].max(axis=0)
    error = np.sqrt(((found.tangents - row_by_row.tangents) ** 2).mean(axis=2)) / size
    assert (error[:-1] < 2e-3).all() and (error[-1] < 0.1).all()  # what shifts rows acts by impulses


@pytest.mark.parametrize(
    ('name', 'values'), [('driver_deadband', {'J_d': 0.05}), ('driver_saturation', {'r': 2.0, 'p': 3.0}), ('both', {})]
)
def test_tangents_of_a_loop_whose_driver_is_not_linear(name, values, monkeypatch):
    """Lines are of what the driver passes on: derivatives in its own parameters and in the command come through it."""
    pair = [
        active('driver_deadband', J_d=0.05),
        active('power_gain_mismatch', ratio=1.1),
        active('driver_saturation', r=2.0),
    ]
    effects = [active(name, **values)] if values else pair
    model = make_model('module', 'mas', effects, solver__rtol=3e-5)
    source = closed_loop(make_model(), DURATION, 0)
    named = [f'effects.{one.effect.name}.{p}' for one in effects for p in one.by_short_name]
    names, channels = ['wire.lambda', *named], ('alpha', 'F_1', 'T_2')
    inputs = [replace(source, values=source.values * (1.0 + np.array([1.0, 0.0]) * DELTA))]
    inputs.append(replace(source, times=source.times + DELTA * np.r_[0.0, np.full(len(source.times) - 2, 0.01), 0.0]))
    found = tangents_of(model, source, names, channels, *inputs)
    monkeypatch.setattr(smoothed_input, 'SMOOTHED', 0.0)
    row_by_row = tangents_of(model, source, names, channels, *inputs)
    assert found.smoothed and not row_by_row.smoothed and found.trajectory.steps < 0.8 * row_by_row.trajectory.steps
    size = np.sqrt((row_by_row.tangents**2).mean(axis=2))
    assert (size > 0.0).all()
    size[:-1] = size[:-1].max(axis=0)
    error = np.sqrt(((found.tangents - row_by_row.tangents) ** 2).mean(axis=2)) / size
    assert (error[:-1] < 0.02).all() and (error[-1] < 0.1).all()  # a force where a transformation begins


def test_a_lag_and_what_depends_on_the_wire_go_before_no_lines():
    """What a driver of the command alone makes is computed beforehand; with what comes before it, only if that is so too."""
    structure, wire = package_structures()['module'], wire_constants(make_model().config.parameters)

    def passed(*effects):
        return passed_before(effects, structure, wire, 1.0)

    bent, gain = active('driver_saturation', r=2.0), active('power_gain_mismatch', ratio=1.1)
    assert passed() == 0 and passed(gain) == 0 and passed(bent) == 1 and passed(bent, gain) == 2
    assert passed(bent, active('driver_lag', tau=0.2)) == 1
    assert passed(active('driver_lag', tau=0.2, rise=1.0)) is None and passed(bent, active('resistance_feedback')) is None


def test_the_temperature_of_a_smoothed_run_differs_by_what_is_allowed():
    """|D| <= 2 max |E|/C, beside the errors of both runs."""
    model = make_model(solver__rtol=1e-4)
    source = closed_loop(model, DURATION, 0)
    found = tangents_of(model, source, ('wire.E_A',), ('T_1', 'T_2'))
    allowed = 2.0 * smoothed_input.SMOOTHED * 1e-4 * TEMPERATURE_SCALE + 2e-3
    reference = exact(model, source)
    for name in ('T_1_K', 'T_2_K'):
        difference = np.abs(found.trajectory[name] - reference[name])
        assert 1e-4 < difference.max() < allowed


@pytest.mark.parametrize('system', ['module', 'spatial', 'slider', 'wire'])
def test_every_effect_is_asked_whether_it_passed_before(system):
    """Kernels read the parameters of further bundles and of a plane, too."""
    structure = package_structures()[system]
    for found in package_effects().values():
        one = effect_on(found, structure)
        active = ActiveEffect(one, tuple(p.default for p in one.parameters))
        assert passed_before([active], structure, wire_constants(structure.default_values), 1.0) in (True, False)


def test_an_ambient_temperature_may_be_ahead_for_as_long_as_a_wire_takes_to_follow():
    """A room that is off by E [K s] brings lambda A E: what a wire holds in so many kelvin; any E where none is lost."""
    wire = wire_constants(make_model().config.parameters)
    held = 0.3 * wire.rho * wire.volume * wire.c_V
    leeway, closed = Leeway.of(wire, 0.3), Leeway.of(wire._replace(lambda_=0.0), 0.3)
    assert leeway.heat == pytest.approx(wire.n * held) and closed.heat == leeway.heat and closed.ambient == np.inf
    assert wire.lambda_ * wire.surface * leeway.ambient == pytest.approx(held)
