"""Why a run ends and where it starts, at the limits of each reason; what is shown of wires that all but rest."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq
from systems import WHOLE_ROWS, active, evaluate, make_model
from test_stack import stack

import sma_sim
from sma_sim import Config, Effect, Input, Model, Parameter, module_input, simulate
from sma_sim.compiler.compile import package_compiler
from sma_sim.model.automaton import AUSTENITE, INNER, MARTENSITE
from sma_sim.model.layout import O_DX, O_EPS, O_LENGTH, O_S_A, O_S_M, O_SIGMA, O_X, Evaluation, InputPoint, SystemState
from sma_sim.model.material import compliance, sigma_A, sigma_M
from sma_sim.model.structures.discovery import package_structures
from sma_sim.model.system import EVERYTHING, update_flow
from sma_sim.solver import simulate as simulation
from sma_sim.solver.beginning import Beginning
from sma_sim.solver.columns import places, sample_columns, sampled_numbers
from sma_sim.solver.effect_table import channel_scales, own_scratch
from sma_sim.solver.end_of_run import notes_on_start, stop_reason
from sma_sim.solver.fixed_rate import FixedRateRun, simulate_fixed_rate
from sma_sim.solver.integrate import (
    COMPLETED,
    RATE_NOT_FINITE,
    STALLED,
    STEP_LIMIT,
    STEP_UNDERFLOW,
    integrate,
    observe,
)
from sma_sim.solver.model import new_findings
from sma_sim.solver.sampling import needed_for, sample_numbers
from sma_sim.solver.simulate import SimulationError, check_start, new_run, new_work
from sma_sim.solver.stepper import Segment


def started(model, u=(0.0, 298.0)):
    return new_run(model, np.array(u), new_work(model))


@pytest.mark.parametrize('system', ['module', 'lever'])
def test_a_coordinate_beyond_its_limit_ends_a_run_with_that_reason(system):
    model = Model(Config(system=system))
    bounded = [(j, one) for j, one in enumerate(model.structure.coordinates) if np.isfinite(one.limit)]
    assert bounded
    for j, coordinate in bounded:
        for sign in (1.0, -1.0):
            run = started(model)
            run.state.y[j] = 0.999 * sign * coordinate.limit
            assert stop_reason(STEP_LIMIT, model, run) == 'step limit reached'
            run.state.y[j] = 1.001 * sign * coordinate.limit
            said = stop_reason(STEP_LIMIT, model, run)
            assert 'has lost its stability' in said and f'{coordinate.name} has come to {run.state.y[j]:.3g} ' in said
            assert stop_reason(COMPLETED, model, run) == 'end of the input'


@pytest.mark.parametrize('status', [STALLED, STEP_UNDERFLOW, RATE_NOT_FINITE])
def test_a_hysteresis_of_less_than_a_tenth_of_a_megapascal_is_named(status):
    for dsigma, named in ((0.9e5, True), (1.1e5, False)):
        model = make_model('wire', 'mas', wire__dsigma=f'{dsigma} Pa')
        said = stop_reason(status, model, started(model, (0.02, 0.0, 298.0)))
        assert ('the hysteresis of wire 1 is only 9e+04 Pa high' in said) == named
        assert said.startswith('stalled') == (status == STALLED)
    hybrid = make_model('wire', wire__dsigma='9e4 Pa')
    assert 'hysteresis' not in stop_reason(status, hybrid, started(hybrid, (0.02, 0.0, 298.0)))


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_a_wire_with_less_than_a_tenth_of_its_heat_capacity_is_named(kind):
    """rho c_V + T (1/E_M - 1/E_A) sigma_T^2 (1 - x_M), at the temperature at which a tenth is left; the second wire."""
    model = make_model('module', kind, wire__E_A=16e9, wire__E_M=20e9, wire__sigma_T=22e6, wire__c_V=254.0)
    p, w, x = model.compiled, model.compiled.wire, 0.25
    critical = -0.9 * w.rho * w.c_V / (w.d * w.sigma_T**2 * (1.0 - x))
    for part, named in ((0.999, False), (1.001, True)):
        run = started(model)
        run.state.y[p.first_T + 1] = part * critical
        run.state.x_frozen[:] = x
        if p.mas:
            run.state.y[p.first_x : p.first_x + 2] = x
        said = stop_reason(STEP_UNDERFLOW, model, run)
        assert said.startswith(f'the heat capacity of wire 2 has come down to nothing at {part * critical:.1f} K') == named
        assert 'heat capacity' not in stop_reason(STEP_LIMIT, model, run)


def test_a_reason_is_found_without_a_warning_where_rates_are_not_finite(recwarn):
    model = make_model('wire', 'mas')
    for x in (np.inf, np.nan):
        run = started(model, (0.02, 0.0, 298.0))
        run.state.y[model.compiled.first_x] = x
        assert stop_reason(RATE_NOT_FINITE, model, run)
    assert not recwarn.list


@pytest.mark.parametrize(
    'declared',
    [
        {'kernel': lambda s, w, p: math.nan},
        {'kernel': lambda s, w, p: p.k * np.sqrt(310.0 - s.T)},
        {'kernel': lambda s, w, p, m: p.k * m.a, 'states': ('a',), 'scale': (1.0,), 'rate': lambda s, w, p, m: math.nan},
    ],
)
def test_an_effect_that_is_no_number_is_named(declared):
    k = Parameter('k', 1e-3, 'W/K', (0.0, 1.0), 'rate', neutral=0.0)
    fin = Effect(name='fin', port='wire_heat', equation='Q', source='a test', parameters=(k,), **declared)
    command = module_input([0.0, 2.0, 15.0], [0.0, 10.0, 10.0])
    run = simulate(Model(Config(effects=[sma_sim.effects.gravity(), fin()])), command, 4.0)
    assert not run.completed and 'effect fin returns none' in run.reason and 'gravity' not in run.reason


def test_stresses_without_a_barrier_between_phases_are_named():
    """eps_T + (1/E_M - 1/E_A) sigma is not positive: far below zero stress, where martensite is the softer one."""
    model = make_model('wire', 'mas')
    w, run = model.compiled.wire, started(model, (0.02, 0.0, 298.0))
    for name, half in (('sigma_M', -0.5 * w.dsigma), ('sigma_A', 0.5 * w.dsigma)):
        limit = brentq(lambda T, half=half: w.eps_T + w.d * (w.sigma_MW0 + w.sigma_T * (T - w.T0) + half), -1e5, 300.0)
        run.state.y[0] = limit + 0.1
        assert f'{name} of wire 1' not in stop_reason(RATE_NOT_FINITE, model, run)
        run.state.y[0] = limit - 0.1
        assert f'{name} of wire 1 has come to -' in stop_reason(RATE_NOT_FINITE, model, run)


def test_wires_that_do_not_fit_are_told_by_their_strain():
    """More than 5 % too long or 30 % too short; of several the one that is worst."""
    model = Model(Config(system='lever'))
    found = new_findings(model.compiled)
    found[:, O_LENGTH] = 0.123
    for fits, wrong in (((0.29, -0.04), None), ((-0.049, 0.0), None), ((0.01, 0.31), 2), ((-0.051, 0.02), 1)):
        found[:, O_EPS] = fits
        if wrong is None:
            check_start(model, found)
            continue
        with pytest.raises(SimulationError, match=f'a wire is strained by {100.0 * fits[wrong - 1]:.0f} % at rest'):
            check_start(model, found)


def test_a_start_that_was_moved_is_said_of_that_wire_alone():
    model = make_model('module', initial__x_M_1=0.55, initial__x_M_2=0.56)
    run = started(model)
    run.state.x_frozen[:] = 0.55, 0.57
    assert notes_on_start(model, run) == ('initial.x_M_2 = 0.56 is not admitted at rest; the run starts at 0.57',)
    run.state.x_frozen[:] = 0.55 + 1e-10, 0.56
    assert notes_on_start(model, run) == ()
    assert notes_on_start(make_model('module'), run) == ()


@pytest.mark.parametrize(('part', 'x'), [(-0.01, 0.0), (0.0, 0.3), (0.5, 0.3), (1.0, 0.3), (1.01, 1.0)])
def test_a_wire_under_a_load_starts_where_its_stress_admits(part, x):
    """At sigma_M + part (sigma_A - sigma_M): within with the fraction that was asked for, beyond it in one phase."""
    model = Model(Config({'initial.x_M_1': 0.3}, 'wire_under_load'))
    names, w, T = model.structure.input_columns, model.compiled.wire, 330.0
    sigma = sigma_M(T, w) + (1e-6 + part * (1.0 - 2e-6)) * (sigma_A(T, w) - sigma_M(T, w))
    run = started(model, [{'stress_Pa': sigma, 'T_E_K': T}.get(name, 0.0) for name in names])
    assert run.state.x_frozen[0] == x and run.state.y[model.compiled.first_T] == T
    assert run.state.mode[0] == {0.0: AUSTENITE, 0.3: INNER, 1.0: MARTENSITE}[x]
    assert run.state.y[0] == pytest.approx(compliance(x, w) * sigma + w.eps_T * x, rel=1e-8)


@pytest.mark.parametrize(('rate', 'mode'), [(1.5e-5, 4), (0.7e-5, 3), (-0.7e-5, 3), (-1.5e-5, 5)])
def test_wires_that_transform_by_less_than_a_percent_in_a_quarter_of_an_hour_rest(rate, mode):
    """Whether all columns are sampled or the mode alone."""
    model = make_model('wire', 'mas')
    p, y = model.compiled, np.array([298.0, 0.4])

    def excess(strain):
        u = np.array([strain, 0.0, 298.0])
        return evaluate(model, y, u, np.zeros(3), np.array([3]), np.array([0.4])).obs[0, O_DX] - rate

    middle = 0.4 * p.wire.eps_T + compliance(0.4, p.wire) * 0.5 * (sigma_A(298.0, p.wire) + sigma_M(298.0, p.wire))
    u = np.array([brentq(excess, middle - 2e-3, middle + 2e-3, xtol=1e-16), 0.0, 298.0])
    state, segment = SystemState(y, np.array([3]), np.array([0.4])), Segment(0.0, 1.0, u, np.zeros(3), False)
    row = np.zeros(sample_columns(model.structure).size)
    observe(0.0, state, segment, own_scratch(p), new_work(model), row)
    numbers = sampled_numbers(None, model.structure)
    some = np.zeros(len(numbers))
    sample_numbers(0.0, state, segment, own_scratch(p), new_work(model), numbers, needed_for(numbers, p), some)
    assert row[places(model.structure, WHOLE_ROWS)['mode']] == mode == some[places(model.structure, numbers)['mode']]


def test_a_usual_change_of_each_channel():
    """10 N, 30 K, 100 MPa, 1 ohm, by which errors of lagging sensors are weighed."""
    for system, usual in (('module', [10.0] * 2 + [30.0] * 2 + [1.0] * 2), ('wire', [1e8, 30.0, 1.0])):
        structure = package_structures()[system]
        assert channel_scales(structure)[len(structure.coordinates) :] == usual


def test_several_fixed_steps_at_once_show_the_last():
    model, u = make_model('module'), np.array([12.0, 298.0])
    once, one_by_one = (FixedRateRun(model, 1000.0, u) for _ in range(2))
    once.step(u, 5)
    for _ in range(5):
        one_by_one.step(u)
    assert (once.sample == one_by_one.sample).all() and once.time == one_by_one.time == 0.005
    shown = once.sample.copy()
    once.step(u, 4, every=10)
    assert (once.sample == shown).all() and once.time == 0.009
    once.step(u, 1, every=10)
    one_by_one.step(u, 5)
    assert (once.sample == one_by_one.sample).all() and (once.sample != shown).any()


@pytest.mark.parametrize(
    'given',
    [{'stack__g_x': 3.0, 'stack__g_y': -9.0}, {'stack__g_x': -9.81}, {'initial__x_M_1': 0.9, 'initial__x_M_2': 0.1}],
    ids=['aslant', 'hanging', 'bent'],
)
def test_a_series_starts_at_rest_whatever_bends_it(given):
    """Nothing accelerates; wires transform, or back, that were asked for more martensite than any pose admits."""
    model = stack(2, **given)
    p, u = model.compiled, np.array([0.0, 0.0, 298.0])
    run, still = new_run(model, u, new_work(model)), Evaluation(np.zeros(len(model.scales)), new_findings(p))
    update_flow(0.0, run.state, InputPoint(u, np.zeros(3)), p, still, EVERYTHING)
    assert np.abs(still.dy / model.scales).max() < 1e-6 and not run.state.y[6:12].any() and run.state.y[:6].any()
    expected = still.obs[:, O_S_A].copy()
    if 'initial__x_M_1' in given:
        expected[0] = still.obs[0, O_S_M]
    assert still.obs[:, O_SIGMA] == pytest.approx(expected, abs=1e-6 * p.wire.dsigma)
    assert (still.obs[:, O_X] == run.state.x_frozen).all() and (
        (run.state.x_frozen > 0.4) & (run.state.x_frozen < 0.6)
    ).all()


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
@pytest.mark.parametrize('system', ['module', 'lever', 'slider', 'stack'])
def test_a_run_may_begin_in_motion(system, kind):
    """Wires that are warm, one on sigma_M as when it is heated, the others on sigma_A as when they cool; the pose is not
    where forces balance, and moves. With nothing left of a motion, the pose is that at rest. It comes to rest in the end.
    States of effects are as far from their first values as is said, of those that change the stress of wires too."""
    effects = [active(name) for name in ('driver_lag', 'functional_fatigue', 'sensor_lag')]
    model = Model(Config(system=system, effects=effects).variant(kinetics=kind))
    p, n = model.compiled, model.compiled.coordinates
    u, warm = np.array([*np.zeros(len(model.structure.input_columns) - 1), 298.0]), 20.0 + np.arange(p.wires)
    parts = (1.0, *np.zeros(p.wires - 1))
    still = new_run(model, u, new_work(model), parts, Beginning(tuple(warm), (0.0,) * n, (0.0,) * n)).state
    moved = 0.05 * np.array(channel_scales(model.structure)[:n])
    states = {'functional_fatigue': tuple(0.5 + np.arange(p.wires)), 'sensor_lag': tuple(moved)}
    left = Beginning(tuple(warm), tuple(moved), tuple(2.0 * moved), tuple(states.items()))
    run = new_run(model, u, new_work(model), parts, left)
    y = run.state.y
    assert y[p.first_T : p.first_T + p.wires] == pytest.approx(298.0 + warm)
    assert y[:n] == pytest.approx(still.y[:n] + moved) and y[n : 2 * n] == pytest.approx(2.0 * moved)
    first = [*np.zeros(p.wires), *states['functional_fatigue'], *(y[:n] + moved)]
    assert y[-len(first) :] == pytest.approx(first)
    cold = new_run(model, u, new_work(model), parts, Beginning((0.0,) * p.wires, (0.0,) * n, (0.0,) * n)).state
    assert cold.y[:n] == pytest.approx(new_run(model, u, new_work(model), parts).state.y[:n])
    found = Evaluation(np.zeros_like(y), new_findings(p))
    update_flow(0.0, run.state, InputPoint(u, np.zeros(len(u))), p, found, EVERYTHING)
    edge = np.where(np.array(parts) > 0.0, found.obs[:, O_S_M], found.obs[:, O_S_A])
    inside = (run.state.x_frozen > 0.0) & (run.state.x_frozen < 1.0)
    assert inside.any() or system == 'slider'
    assert found.obs[inside, O_SIGMA] == pytest.approx(edge[inside], abs=1e-6 * p.wire.dsigma)
    source = Input(np.array([0.0, 60.0]), np.array([u, u]), (False,) * len(u), model.structure.input_columns)
    end = simulate(model, source, 10.0, initial_state=run)
    assert end.completed and np.abs(end.state.state.y[p.first_T : p.first_T + p.wires] - 298.0).max() < 0.1


def test_fixed_steps_that_cannot_be_made_are_said():
    """With the time until which there are samples; a command that no step can follow."""
    model, wild = make_model('module'), np.array([1e300, 298.0])
    run = FixedRateRun(model, 1000.0, np.array([0.0, 298.0]))
    run.step(np.array([0.0, 298.0]), 3)
    with pytest.raises(SimulationError, match='the run ended after 0.003 s: step size underflow'):
        run.step(wild)
    source = module_input([0.0, 0.003, 0.006], [0.0, 1e300, 0.0])
    found = simulate_fixed_rate(model, source, 1000.0, 1000.0)
    assert 'step size underflow' in found.reason and not found.completed


def test_jumps_of_a_stretched_wire_are_taken_once():
    run = FixedRateRun(make_model('wire'), 100.0, np.array([0.02, 0.0, 298.0]))
    seen = []
    for strain in (0.03, 0.04, 0.03, 0.02, 0.01):
        run.step(np.array([strain, 0.0, 298.0]))
        seen.append([(jump.source, jump.target, jump.j) for jump in run.take_jumps()])
        assert run.take_jumps() == ()
    assert seen[0][0] == (3, 4, 0) and [jump[:2] for jumps in seen for jump in jumps] == [(3, 4), (4, 3), (3, 5)]


def test_what_bounds_a_run(monkeypatch):
    """Steps that are kept short do not look stalled by that: a tenth of the longest is enough."""
    model, source, seen = make_model('module'), module_input([0.0, 0.01], [0.0, 0.0]), []
    usual = package_compiler()

    def integrated(*given):
        seen.append(given[4])
        return usual.function(integrate)(*given)

    compiler = SimpleNamespace(function=lambda python: integrated if python is integrate else usual.function(python))
    monkeypatch.setattr(simulation, 'package_compiler', lambda: compiler)
    simulate(model, source, 100.0)
    simulate(model, source, 100.0, max_step=2e-6, max_steps=7)
    assert [(limits.max_step, limits.max_steps) for limits in seen] == [(np.inf, 10_000_000), (2e-6, 7)]
    assert [limits.stall_step for limits in seen] == pytest.approx([1e-6, 2e-7])


def test_what_is_imposed_may_come_in_any_order(interpreted):
    """A load and a temperature: as the package has them, and the temperature first."""
    usual = package_structures()['wire_under_load_at_T']
    drives = usual.drives
    turned = replace(usual, name='turned', drives=drives[::-1])
    times, given = np.array([0.0, 5.0, 10.0]), {'stress': [1e8, 1.5e8, 1.2e8], 'T': [330.0, 300.0, 350.0]}

    def run(found):
        model = Model(Config(own_structure=found, system=found.name))
        columns = [given[drive.name] for drive in found.drives]
        rows = np.column_stack([*columns, np.zeros(3), np.full(3, 298.0)])
        source = Input(times, rows, (True, True, False, False), found.input_columns)
        return simulate(model, source, 2.0)

    one, other = interpreted(run, usual), interpreted(run, turned)
    assert one.completed and len(one.jumps) > 1 and other.jumps == one.jumps
    assert list(one.columns) == list(other.columns) and np.ptp(one['strain']) > 0.01
    assert all((one[column] == other[column]).all() for column in one.columns)


def test_segments_without_weight_start_as_modules_of_their_own():
    """Whatever is asked of the others; of one that nothing is asked of too."""
    asked = {'initial.x_M_1': 0.9, 'initial.x_M_2': 0.1, 'initial.x_M_3': 0.55, 'initial.x_M_4': 0.56}
    pairs = [{f'initial.x_M_{i + 1}': x for i, x in enumerate(list(asked.values())[k : k + 2])} for k in (0, 2)]
    whole = new_run(stack(2, **asked), np.array([0.0, 0.0, 298.0]), new_work(stack(2, **asked))).state
    for k, given in enumerate(pairs):
        one = started(Model(Config(given))).state
        assert whole.x_frozen[2 * k : 2 * k + 2] == pytest.approx(one.x_frozen, abs=1e-9)
        assert whole.mode[2 * k : 2 * k + 2].tolist() == one.mode.tolist()
        assert whole.y[3 * k : 3 * k + 3] == pytest.approx(one.y[:3], rel=1e-7, abs=1e-12)
