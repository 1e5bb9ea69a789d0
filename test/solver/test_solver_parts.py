"""Samples, inputs, starts and fixed steps by themselves, in plain Python: against differences and against each other."""

import re
from dataclasses import replace

import numpy as np
import pytest
from systems import WHOLE_ROWS, active, make_model

from sma_sim import Config, Input, Model, UserError, module_input, simulate, wire_input
from sma_sim.compiler.structure_kernels import check_agreement
from sma_sim.model.automaton import INNER
from sma_sim.model.layout import O_DL, O_DX, O_F, O_J, O_LENGTH, O_SIGMA, O_V, O_X, SystemState
from sma_sim.model.program_parameters import DEFAULTS
from sma_sim.model.structures.discovery import StructureError, package_structures
from sma_sim.model.structures.structure import numbers, record
from sma_sim.solver import simulate as simulation
from sma_sim.solver.clock import held_until
from sma_sim.solver.columns import named_columns, new_samples, places, sample_columns, sampled_numbers
from sma_sim.solver.effect_table import channel_scales, own_scratch, state_scales
from sma_sim.solver.events import remember_fraction
from sma_sim.solver.fixed_rate import FixedRateRun, simulate_fixed_rate
from sma_sim.solver.inputs import segments
from sma_sim.solver.integrate import C_KEPT_UNTIL, C_LAST_JUMP, C_TIME, C_WINDOW, PER_WIRE, WIRE_COLUMNS, observe, of_wire
from sma_sim.solver.linear import DENSE, eliminate, elimination, solve_eliminated
from sma_sim.solver.model import inertia_of
from sma_sim.solver.sampling import needed_for, sample_numbers
from sma_sim.solver.series import elimination_of
from sma_sim.solver.simulate import new_run, new_work, stall_step
from sma_sim.solver.stepper import Segment
from sma_sim.solver.wire_columns import heating_of_wire, strains_from_pose

MOVING = sorted(name for name, found in package_structures().items() if found.coordinates)


def moved_state(model, seed=1, size=0.3):
    """A state of a structure at an angle and moving, with heated wires that are half martensite; its input."""
    random, p = np.random.default_rng(seed), model.compiled
    y = size * model.scales * random.uniform(-1.0, 1.0, len(model.scales))
    y[p.first_T : p.first_T + p.wires] = random.uniform(310.0, 350.0, p.wires)
    if p.mas:
        y[p.first_x : p.first_x + p.wires] = 0.5
    u = np.append(np.zeros(len(model.structure.input_columns) - 1), 298.0)
    return SystemState(y, np.full(p.wires, 3), random.uniform(0.3, 0.7, p.wires)), u


def row_of(model, state, u):
    """A whole row of samples, and the forces and slopes that it was made from."""
    work, row = new_work(model), np.zeros(sample_columns(model.structure).size)
    observe(0.0, state, Segment(0.0, 1.0, u, np.zeros(len(u)), False), model.compiled, work, row)
    return row, work.sample.obs


def lengths_at(model, pose):
    """Lengths of all wires at a pose, segment by segment."""
    structure = model.structure.segment or model.structure
    made = record('Pose', structure.coordinate_names)
    parts = np.asarray(pose).reshape(-1, len(structure.coordinates))
    constants = structure.constants_of(model.config.parameters)
    return np.concatenate([numbers(structure.lengths(made(*part), constants)) for part in parts])


@pytest.mark.parametrize('name', MOVING)
def test_forces_on_coordinates_are_the_work_of_the_wires(name):
    """tau = -J^T F: what the wires do along a small displacement of each coordinate, by differences of their lengths."""
    model = Model(Config(system=name))
    state, u = moved_state(model)
    row, obs = row_of(model, state, u)
    where, n = sample_columns(model.structure), model.compiled.coordinates
    shown = dict(zip(WIRE_COLUMNS, row[where.wires].reshape(model.wires, PER_WIRE).T, strict=True))
    found = {'x_M': O_X, 'F': O_F, 'length': O_LENGTH, 'v': O_V, 'sigma': O_SIGMA, 'dx_M': O_DX, 'J': O_J}
    assert all((shown[column] == obs[:, at]).all() for column, at in found.items())
    first_T, forces = model.compiled.first_T, shown['F']
    assert (shown['T'] == state.y[first_T : first_T + model.wires]).all() and (shown['mode'] == state.mode).all()
    assert (forces == obs[:, O_F]).all() and forces.all()
    for j in range(n):
        step = 1e-4 * model.scales[j] * (np.arange(n) == j)
        slopes = (lengths_at(model, row[where.pose] + step) - lengths_at(model, row[where.pose] - step)) / (2.0 * step[j])
        assert row[where.tau][j] == pytest.approx(-slopes @ forces, rel=1e-5, abs=1e-6 * np.abs(forces).sum() * 1e-3)
    assert (row[where.rates] == state.y[n : 2 * n]).all() and np.abs(obs[:, O_DL:]).max() > 0.0


@pytest.mark.parametrize('name', sorted(package_structures()))
def test_columns_are_found_under_their_names(name):
    """In whole rows and among sampled numbers; numbers that go up tell where each was taken from."""
    structure = package_structures()[name]
    where, everything = sample_columns(structure), sampled_numbers(None, structure)
    whole, some = places(structure, WHOLE_ROWS), places(structure, everything)
    assert (
        list(whole) == list(some) == list(structure.sampled_columns[: len(some)])
        and list(some.values()) == everything.tolist()
    )
    assert len(set(whole.values())) == len(whole) and max(whole.values()) < where.size
    for i, suffix in enumerate(structure.wire_suffixes):
        first = where.wires.start + i * PER_WIRE
        assert whole[f'x_M{suffix}'] == first + WIRE_COLUMNS.index('x_M')
        assert whole[f'mode{suffix}'] == first + WIRE_COLUMNS.index('mode')
    for k, column in enumerate(structure.channel_columns):
        assert whole[column] == where.sensed.start + k
    rows = np.arange(2.0 * where.size).reshape(2, -1)
    columns, resistances = named_columns(structure, rows, WHOLE_ROWS)
    assert set(columns) | set(resistances) == set(whole) and len(resistances) == structure.wires
    assert all((column == rows[:, whole[key]]).all() for key, column in {**columns, **resistances}.items())
    assert new_samples(3, WHOLE_ROWS, structure).shape == (3, where.size)
    assert new_samples(3, everything, structure).shape == (3, len(everything))


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
@pytest.mark.parametrize(
    'effect', ['', 'thermal_expansion', 'smooth_transformation', 'guide_friction', 'sensor_lag', 'gravity']
)
def test_samples_leave_nothing_behind(kind, effect):
    """Each number alone with scratch memory of its own: nothing is left there from an evaluation of the whole flow."""
    model = make_model('module', kind, [active(effect)] if effect else [])
    state, u = moved_state(model)
    row, _ = row_of(model, state, u)
    segment = Segment(0.0, 1.0, u, np.zeros(2), False)
    whole = places(model.structure, WHOLE_ROWS)
    for column, number in places(model.structure, sampled_numbers(None, model.structure)).items():
        numbers_asked, found = np.array([number]), np.zeros(1)
        p = own_scratch(model.compiled)
        sample_numbers(0.0, state, segment, p, new_work(model), numbers_asked, needed_for(numbers_asked, p), found)
        assert found[0] == pytest.approx(row[whole[column]], rel=1e-12), column


@pytest.mark.parametrize(('first', 'last'), [(-1e-300, 1.0), (1.0, -1e-300), (1e-300, -1.0), (-1.0, 1e-300)])
def test_a_ramp_that_all_but_begins_or_ends_at_zero_is_not_split(first, last):
    """The crossing is a row's own time within rounding: a stretch without length would have no slope."""
    times, values, slopes = segments(module_input([1.0, 2.0, 3.0], [first, last, last], linear=True))
    assert (np.diff(times) > 0.0).all() and np.isfinite(slopes).all() and times[0] == 1.0 and times[-1] == 3.0
    assert values[0, 0] == first and slopes[0] == pytest.approx([last - first, 0.0], abs=1e-12)


def test_inputs_that_are_none():
    """Arrays that do not belong together, times that do not increase, numbers that are none."""
    times, values = np.array([0.0, 1.0]), np.zeros((2, 2))
    assert Input(times, values, (False, False)).names == ()
    for wrong in (
        (times, values[:, :1]),
        (times, values[:1]),
        (times[None, :], values),
        (times[:0], values[:0]),
        (np.zeros(2), values),
        (times[::-1], values),
        (np.array([0.0, np.inf]), values),
        (times, values + np.nan),
    ):
        with pytest.raises(ValueError, match='input: '):
            Input(*wrong, (False, False))


def test_steps_of_an_imposed_strain_are_those_one_by_one():
    """Samples stand in the order of the steps, and as many are counted as steps that their number divides."""
    model, u = (
        make_model('wire'),
        np.array([[0.021, 0.1, 298.0], [0.022, 0.1, 298.0], [0.021, 0.0, 298.0], [0.023, 0.0, 298.0]]),
    )
    one, all_at_once, seldom = (FixedRateRun(model, 100.0, np.array([0.02, 0.0, 298.0])) for _ in range(3))
    rows = new_samples(4, WHOLE_ROWS, model.structure)
    assert all_at_once.advance(u, 1, rows) == 4 and all_at_once.time == 0.04
    for k, row in enumerate(u):
        one.step(row)
        assert (one.sample == rows[k]).all() and one.shown('stress') == one.sample[sample_columns(model.structure).sensed][0]
    few = new_samples(4, WHOLE_ROWS, model.structure)
    assert seldom.advance(u, 2, few) == 2 and (few[:2] == rows[1::2]).all() and np.isnan(few[2:]).all()
    strain = rows[:, sample_columns(model.structure).wires][:, WIRE_COLUMNS.index('length')] / model.compiled.wire.l0 - 1.0
    assert strain == pytest.approx(u[:, 0], abs=1e-12)  # reached at the end of each step


def test_a_clock_that_is_set_back_shows_the_same():
    model = make_model('module')
    run = FixedRateRun(model, 1000.0, np.array([0.0, 298.0]))
    run.step(np.array([20.0, 298.0]), 8)
    shown, jumped = run.sample.copy(), run.run.control.copy()
    run.restart_clock(np.array([20.0, 298.0]))
    assert run.time == 0.0 and (run.sample == shown).all()
    jumped[[C_TIME, C_WINDOW, C_KEPT_UNTIL, of_wire(0, C_LAST_JUMP), of_wire(1, C_LAST_JUMP)]] -= 0.008  # all that is a time
    assert run.run.control == pytest.approx(jumped)


def test_samples_of_fixed_steps_stand_at_whole_steps():
    model = make_model('wire')
    source = Input(
        np.array([1.0, 1.06, 1.1]), np.array([[0.02, 0.1, 298.0], [0.02, 0.0, 298.0], [0.02, 0.0, 298.0]]), (False,) * 3
    )
    told = []
    run = simulate_fixed_rate(model, source, 100.0, 50.0, told.append)
    assert run.completed and run.time == pytest.approx([1.0, 1.02, 1.04, 1.06, 1.08, 1.1]) and told[-1] == 1.0
    heated = np.diff(run['T_K'])
    assert len(heated) == 5 and (heated[:3] > 0.0).all() and (heated[3:] < 0.0).all() and run.steps >= 10


def test_sizes_of_states_follow_the_structure():
    """30 K, a tenth of martensite, and for rates the speed of undamped vibrations of the size of their coordinate."""
    for kind, extra in (('hybrid', []), ('mas', [0.1])):
        assert make_model('wire', kind).scales.tolist() == [30.0, *extra]
    for name in MOVING:
        model = Model(Config(system=name))
        n, own = model.compiled.coordinates, model.structure
        assert model.scales[2 * n : 2 * n + model.wires].tolist() == [30.0] * model.wires
        if own.forces is None or own.inertia is None or own.drives:
            continue
        pose = record('Pose', own.coordinate_names)
        for j, coordinate in enumerate(own.coordinates):
            if coordinate.rate_scale is None:
                size = coordinate.size(model.constants)
                ends = [
                    numbers(own.forces(pose(*(s * size * (np.arange(n) == j))), pose(*np.zeros(n)), model.constants))[j]
                    for s in (0.0, 1.0)
                ]
                stiffness = abs(ends[1] - ends[0]) / size
                frequency = np.sqrt(stiffness / numbers(own.inertia(model.constants))[j])
                assert model.scales[n + j] == pytest.approx(size * max(1.0, frequency))


def test_heating_of_each_wire_of_a_bundle():
    """Of an antagonistic pair each sign heats one; the bundle's power is shared by its wires."""
    J = np.array([-6.0, 0.0, 12.0])
    module, wire = Config(), Config(system='wire')
    shared = module.parameters['wire.n']
    assert heating_of_wire(module, {'J_eq_W': J}, 0).tolist() == [0.0, 0.0, 12.0 / shared]
    assert heating_of_wire(module, {'J_eq_W': J}, 1).tolist() == [6.0 / shared, 0.0, 0.0]
    assert heating_of_wire(wire, {'J_W': J}, 0) is J


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_a_requested_fraction_that_is_admitted_is_that_of_the_start(kind):
    """Those between the two at which the stress lies on an edge of the hysteresis; each wire for itself."""
    model, u = make_model('module', kind), np.array([7.0, 305.0])
    p = model.compiled
    edges = [new_run(model, u, new_work(model), (part, part)).state.x_frozen[0] for part in (0.0, 1.0)]
    low, high = min(edges), max(edges)
    assert 0.0 < high - low < 1.0
    for part in (0.3, 0.8):
        requested = low + (high - low) * np.array([part, 1.0 - part])
        initial = dict(zip(('initial.x_M_1', 'initial.x_M_2'), requested.tolist(), strict=True))
        asked = Model(replace(model.config, parameters={**model.config.parameters, **initial}))
        run = new_run(asked, u, new_work(asked))
        assert run.state.x_frozen == pytest.approx(requested, abs=1e-12) and (run.state.mode == INNER).all()
        assert run.state.y[p.first_T : p.first_T + 2].tolist() == [305.0, 305.0] and not run.state.y[3:6].any()
        assert not p.mas or run.state.y[p.first_x : p.first_x + 2].tolist() == run.state.x_frozen.tolist()
        within = new_run(model, u, new_work(model), parts=[(x - edges[0]) / (edges[1] - edges[0]) for x in requested])
        assert within.state.x_frozen == pytest.approx(requested, abs=1e-9) and (within.state.mode == INNER).all()
        assert within.state.y == pytest.approx(run.state.y, rel=1e-9, abs=1e-12)


def test_elimination_of_whole_numbers():
    """Factors of one and of zero are factors too; what has no entry stays as it was."""
    J = -np.array([[2.0, 1.0, 0.0], [2.0, 3.0, 4.0], [4.0, 0.0, 7.0]])
    e = elimination(J != 0.0, np.arange(3), np.zeros(0, dtype=bool))
    A, x = np.full((3, 3), np.nan), np.array([1.0, 2.0, 3.0])
    assert eliminate(J, 0.0, A, e)
    solve_eliminated(A, e, x)
    assert x == pytest.approx(np.linalg.solve(-J, [1.0, 2.0, 3.0])) and np.isnan(A[0, 2])


def test_wires_have_commands_and_ambient_temperatures_of_one_value_or_many():
    source = wire_input([0.0, 1.0], [0.0, 0.02], J=[0.5, 0.0], T_E=300.0)
    assert source.values.tolist() == [[0.0, 0.5, 300.0], [0.02, 0.0, 300.0]] and source.linear == (True, False, False)
    heated = module_input([0.0, 1.0], [3.0, 0.0], T_E=[290.0, 310.0], linear=True)
    assert heated.values.tolist() == [[3.0, 290.0], [0.0, 310.0]] and heated.linear == (True, False)


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_segments_on_which_an_effect_acts_are_eliminated_as_dense_ones(kind):
    """Whatever its port: an effect may let a segment depend on any other."""
    for effect in ('', 'thermal_expansion', 'sensor_lag', 'driver_lag'):
        effects = (active(effect),) if effect else ()
        model = Model(Config({'stack.modules': 2.0}, 'stack', kind, effects))
        found = elimination_of(model.compiled, model.structure, len(model.scales))
        assert (found is DENSE) == bool(effect)
        assert effect or sorted(found.order.tolist()) == list(range(len(model.scales)))


def test_fractions_are_remembered_where_they_follow_from_the_stress():
    model = make_model('module')
    obs = np.zeros((2, O_DL))
    obs[:, O_X] = 0.3, 0.6
    for modes, kept in (((4, 3), [0.3, 0.8]), ((1, 5), [0.8, 0.6]), ((2, 3), [0.8, 0.8]), ((5, 4), [0.3, 0.6])):
        state = SystemState(np.zeros(8), np.array(modes), np.full(2, 0.8))
        remember_fraction(state, model.compiled, obs)
        assert state.x_frozen.tolist() == kept
    remember_fraction(state, make_model('module', 'mas').compiled, np.zeros_like(obs))
    assert state.x_frozen.tolist() == kept


@pytest.mark.parametrize('system', ['module', 'wire', 'lever', 'spatial'])
def test_what_lags_behind_a_sensor_has_the_size_of_what_it_shows(system):
    """A coordinate and a temperature that are shown late are controlled as they are themselves."""
    model = Model(Config(system=system, effects=(active('sensor_lag'),)))
    p, channels = model.compiled, model.structure.channels
    sizes = dict(zip(channels, channel_scales(model.structure), strict=True))
    for i, suffix in enumerate(model.structure.wire_suffixes):
        assert sizes[f'T{suffix}'] == model.scales[p.first_T + i]
    for coordinate in model.structure.coordinates:
        assert sizes[coordinate.name] == coordinate.sensor_size(model.structure.default_constants)
    lagging = model.scales[p.first_T + p.wires :]
    assert len(lagging) == len(state_scales(active('sensor_lag').effect, model.structure)) > 0


def test_jumps_of_fixed_steps_are_taken_once():
    """Those since they were asked for last, as the run of many steps at once has them."""
    model = make_model('module')
    run, whole = (FixedRateRun(model, 1000.0, np.array([0.0, 298.0])) for _ in range(2))
    run.step(np.array([15.0, 298.0]), 400)
    taken = run.take_jumps()
    assert taken and run.take_jumps() == ()
    run.step(np.array([-15.0, 298.0]), 400)
    whole.step(np.array([15.0, 298.0]), 400)
    assert whole.take_jumps() == taken and all(0.0 < jump.t <= 0.4 for jump in taken)
    later = run.take_jumps()
    assert later and all(0.4 <= jump.t <= 0.8 for jump in later)


@pytest.mark.parametrize('name', [name for name in MOVING if package_structures()[name].lengths])
def test_a_wrong_gradient_is_told_by_its_wire_and_coordinate(name):
    """Right ones pass; one that is off by a thousandth, anywhere, does not."""
    structure = package_structures()[name]
    structure = structure.segment or structure
    constants, n = structure.default_constants, len(structure.coordinates)
    scales = np.array([coordinate.size(constants) for coordinate in structure.coordinates])

    def slopes(q, p, off=None):
        made, pose = type(q), np.array(q)
        found = np.zeros((structure.wires, n))
        for j in range(n):
            for weight, k in ((45.0 / 60.0, 1), (-9.0 / 60.0, 2), (1.0 / 60.0, 3)):
                step = 0.01 * k * scales[j] * (np.arange(n) == j)
                ahead, behind = (np.array(numbers(structure.lengths(made(*(pose + s * step)), p))) for s in (1.0, -1.0))
                found[:, j] += weight * (ahead - behind) / (0.01 * scales[j])
        if off is not None:
            found[off] += 1e-3 * np.abs(found).max()
        return tuple(found.ravel())

    check_agreement(replace(structure, gradients=slopes))
    for i in range(structure.wires):
        for j in range(n):
            wrong = replace(structure, gradients=lambda q, p, off=(i, j): slopes(q, p, off))
            with pytest.raises(StructureError, match=f'for wire {i + 1} in {structure.coordinate_names[j]}'):
                check_agreement(wrong)


def test_errors_are_weighed_by_the_tolerance_and_the_sizes_of_states():
    """Difference steps too, and what counts as stalled: the step that a method of fourth order makes at a tolerance."""
    for rtol, shorter in ((1e-4, 1.0), (1e-2, 1.0), (1e-4 / 16.0, 0.5)):
        model = make_model('module', 'mas', solver__rtol=rtol * DEFAULTS['solver.rtol'].default / 1e-4)
        work = new_work(model)
        assert work.weight == pytest.approx(model.config.parameters['solver.rtol'] * model.scales)
        assert work.increment == pytest.approx(1e-7 * model.scales)
        assert stall_step(model) == pytest.approx(1e-6 * shorter)


def test_progress_is_the_share_of_rows_that_are_done(monkeypatch):
    monkeypatch.setattr(simulation, 'PIECES_AT_ONCE', 2)
    source, told = module_input(np.linspace(0.0, 0.05, 6).tolist(), [0.0, 1.0, 2.0, 3.0, 4.0, 4.0]), []
    assert simulate(make_model('module'), source, 100.0, progress=told.append).completed
    assert told == pytest.approx([2.0 / 6.0, 4.0 / 6.0, 1.0])


@pytest.mark.parametrize('name', MOVING)
def test_strains_follow_from_the_pose(name):
    model = Model(Config(system=name))
    state, u = moved_state(model)
    row, _ = row_of(model, state, u)
    where, wires = sample_columns(model.structure), model.wires
    pose = {c.column: row[where.pose][[j]] for j, c in enumerate(model.structure.coordinates)}
    lengths = row[where.wires].reshape(wires, PER_WIRE)[:, WIRE_COLUMNS.index('length')]
    strains = strains_from_pose(model.config, pose)
    assert list(strains) == [f'strain{suffix}' for suffix in model.structure.wire_suffixes]
    expected = [eps for eps, _ in model.structure.strains(lengths, model.config.parameters)]
    assert np.ravel(list(strains.values())) == pytest.approx(expected, abs=1e-12)
    if model.structure.strain is None:
        assert expected == pytest.approx(lengths / model.compiled.wire.l0 - 1.0, abs=1e-12)


def test_an_imposed_temperature_is_among_the_samples():
    model = Model(Config(system='wire_at_T'))
    state, u = (
        SystemState(np.array([321.0]), np.array([3]), np.array([0.4])),
        np.full(len(model.structure.input_columns), 0.02),
    )
    row, _ = row_of(model, state, u)
    numbers_asked, p = sampled_numbers(None, model.structure), own_scratch(model.compiled)
    found, whole = np.zeros(len(numbers_asked)), places(model.structure, WHOLE_ROWS)
    segment = Segment(0.0, 1.0, u, np.zeros(len(u)), False)
    sample_numbers(0.0, state, segment, p, new_work(model), numbers_asked, needed_for(numbers_asked, p), found)
    for column, k in places(model.structure, numbers_asked).items():
        assert found[k] == pytest.approx(row[whole[column]], rel=1e-12)
    assert found[-1] == 321.0 and found[-2] == 3.0 and found[-3] == 0.4


def test_an_inertia_that_cannot_be():
    slider, lever, module = (package_structures()[name] for name in ('slider', 'lever', 'module'))
    for structure, unit in ((slider, 'kg'), (lever, 'kg m^2')):
        assert inertia_of(replace(structure, inertia=lambda p: 1e-9), structure.default_constants) == (1e-9,)
        for wrong in (0.0, -1.0, np.inf, np.nan):
            odd = replace(structure, inertia=lambda p, wrong=wrong: wrong)
            with pytest.raises(UserError, match=re.escape(f' is {wrong:g} {unit}; expected more than 0')):
                inertia_of(odd, structure.default_constants)
    with pytest.raises(UserError, match='returns 2 number.s.; expected one for each of U_x, U_y, alpha'):
        inertia_of(replace(module, inertia=lambda p: (1.0, 1.0)), module.default_constants)


@pytest.mark.parametrize(
    ('commands', 'linear', 'ends'),
    [
        ([0.0, 5.0, 5.0], False, [0.0, 1.0, 3.0]),  # the last stretch goes on
        ([0.0, 5.0, 0.0], False, [0.0, 1.0, 2.0, 3.0]),  # what is switched off stays off
        ([0.0, 5.0, 4.0], True, [0.0, 1.0, 2.0, 3.0]),
    ],
)
def test_an_input_is_held_beyond_its_end(commands, linear, ends):
    given = segments(module_input([0.0, 1.0, 2.0], commands, linear=linear))
    assert held_until(given, np.array([0.5, 2.0])) is given and held_until(given, np.zeros(0)) is given
    times, values, slopes = held_until(given, np.array([0.5, 3.0]))
    assert times.tolist() == ends and values[:, 0].tolist() == (commands + commands[-1:])[: len(ends)]
    assert not slopes[len(ends) - 2 :].any()
