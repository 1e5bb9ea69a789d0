"""The stepper: order, event times, hard cases, reasons for an end."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from flows import active, make_model

from sma_sim import Input, find_effects, module_input, simulate, wire_input
from sma_sim.model.automaton import EDGES, INNER
from sma_sim.model.errors import UserError
from sma_sim.model.material import sigma_A
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.inputs import input_between, segments
from sma_sim.solver.rosenbrock import RODAS4P2


@pytest.mark.parametrize(
    ('kind', 'x_M', 'strain', 'J'),
    [('hybrid', 0.0, (0.0, 0.0), 0.3), ('mas', 0.0, (0.0, 0.0), 0.3), ('hybrid', 0.5, (0.04, 0.06), 0.0)],
    ids=['heating', 'heating-mas', 'through-an-event'],
)
def test_measured_order(kind, x_M, strain, J):
    """With steps of fixed length the error falls with their fourth power, events located or not."""
    source = wire_input([0.0, 1.0], strain, J=J)
    steps = np.array([0.08, 0.04, 0.02])

    def end(rtol, step):
        model = make_model('wire', kind, solver__rtol=rtol, initial__x_M_1=x_M)
        return simulate(model, source, np.array([1.0]), max_step=step)['T_K'][0]

    errors = np.abs([end(1e-1, step) - end(1e-11, np.inf) for step in steps])
    orders = np.diff(np.log(errors)) / np.diff(np.log(steps))
    assert (np.abs(orders - RODAS4P2.order) < 0.3).all(), (errors, orders)


def test_error_follows_the_tolerance():
    source = module_input([0, 5, 20], [12, -8, 0])
    times = np.arange(0.0, 20.0, 0.1)
    exact = simulate(make_model(solver__rtol=1e-9), source, times)['alpha_rad']
    runs = [simulate(make_model(solver__rtol=rtol), source, times) for rtol in (1e-3, 1e-5, 1e-7)]
    errors = [np.abs(run['alpha_rad'] - exact).max() for run in runs]
    assert errors[0] > 5 * errors[1] > 25 * errors[2]


def test_dense_output_between_steps():
    """Few steps, many samples: the samples are as exact as the steps (a cooling wire, in closed form)."""
    warm = Input(np.array([0.0, 0.5, 3.0]), np.array([[0, 0.3, 298.0], [0, 0, 298], [0, 0, 298]]), (True, False, False))
    model = make_model('wire', 'hybrid', initial__x_M_1=0.0)
    times = np.arange(0.5, 3.0, 0.01)
    run = simulate(model, warm, times)
    w = model.compiled.wire
    T = run['T_K']
    # austenite at zero strain: (rho c_V + T d sigma_T^2) Om dT/dt = -lambda A_s (T - T_E), in closed form for t(T)
    a, b = w.volume * w.rho * w.c_V, w.volume * w.d * w.sigma_T**2
    t = -((a + b * 298.0) * np.log((T - 298.0) / (T[0] - 298.0)) + b * (T - T[0])) / (w.lambda_ * w.surface)
    slope = w.lambda_ * w.surface * (T - 298.0) / (a + b * T)
    assert np.abs((times - 0.5 - t) * slope).max() < 2e-3
    assert run.steps < len(times) / 3


def test_event_time_in_closed_form():
    """A cold wire is drawn at constant rate: its stress reaches sigma_A(T_E) at eps = sigma_A/E_A."""
    model = make_model('wire', 'hybrid', initial__x_M_1=0.0)
    w = model.compiled.wire
    run = simulate(model, wire_input([0.0, 10.0], [0.0, 0.02]), np.array([10.0]))
    first = run.jumps[0]
    assert (first.source, first.target, first.guard) == (1, 4, 'sigma > sigma_A')
    assert first.t == pytest.approx(sigma_A(298.0, w) / w.E_A / 0.002, rel=1e-9)


def test_event_times_converge_with_the_tolerance():
    source = module_input([0, 5, 20], [12, -8, 0])

    def jumps(rtol):
        return np.array([jump.t for jump in simulate(make_model(solver__rtol=rtol), source, np.array([0.0])).jumps])

    exact, tolerances = jumps(1e-10), 10.0 ** -np.arange(4, 9)
    errors = [np.abs(jumps(rtol) - exact).max() for rtol in tolerances]
    order = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert order > 0.6 and errors[-1] < 1e-7, (errors, order)


def test_guard_crossed_to_and_fro_within_a_step():
    """Wire 2 transforms for 0.1 s only, near the end of a long quiet stretch: no tolerance may step over that."""
    times = [
        0,
        5.38237517,
        9.58753958,
        27.32753845,
        29.37149281,
        37.22498928,
        40.15974847,
        52.3999174,
        55.14444864,
        58.2390028,
        61.51808289,
        70,
    ]
    J_eq = [
        -6.5048683,
        9.73446432,
        7.37845141,
        -11.19555755,
        9.19046804,
        9.93753326,
        -9.66522649,
        3.80843996,
        -9.09769135,
        -7.69521864,
        -0.17982734,
        0,
    ]
    for rtol in (1e-4, 1e-5, 1e-9):
        log = simulate(make_model(solver__rtol=rtol), module_input(times, J_eq), np.array([0.0])).jumps
        short = [(jump.source, jump.target) for jump in log if jump.wire == 2 and 59.0 < jump.t < 59.2]
        assert short == [(3, 4), (4, 3)], (rtol, short)


def test_log_of_jumps_explains_the_modes():
    source = module_input([0, 5, 20, 30], [12, -8, 4, 0])
    times = np.arange(0.0, 30.0, 0.01)
    run = simulate(make_model(), source, times)
    assert [jump.j for jump in run.jumps] == list(range(len(run.jumps)))
    assert (np.diff([jump.t for jump in run.jumps]) >= 0.0).all()
    edges = {(edge.source, edge.target) for edge in EDGES}
    for wire in (1, 2):
        mode, own = INNER, [jump for jump in run.jumps if jump.wire == wire]
        seen = run[f'mode_{wire}']
        for before, after in zip([-1.0, *[j.t for j in own]], [*[j.t for j in own], 31.0], strict=True):
            inside = (times > before) & (times < after)
            assert (seen[inside] == mode).all()
            if after < 31.0:
                jump = next(j for j in own if j.t == after and j.source == mode)
                assert (jump.source, jump.target) in edges
                mode = jump.target


def test_two_wires_switch_together():
    """Both wires see the same: warmed and cooled from outside, they jump at one instant and the beam stays straight."""
    hot = module_input([0, 20, 40, 60], [0, 0, 0, 0], T_E=np.array([298.0, 330.0, 298.0, 298.0]))
    run = simulate(make_model(), hot, np.arange(0.0, 60.0, 0.1))
    assert run.completed and len(run.jumps) >= 4
    assert np.abs(run['alpha_rad']).max() < 1e-9
    assert run['x_M_1'] == pytest.approx(run['x_M_2'], abs=1e-9)
    assert run['x_M_1'].min() < 0.5 and run['x_M_1'].max() > 0.54


def test_hours_without_power_take_few_steps():
    run = simulate(make_model(), module_input([0, 10, 4 * 3600.0], [10, 0, 0]), np.array([4 * 3600.0]))
    assert run.completed and run.steps < 600


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_microsecond_pulses(kind):
    edges = np.concatenate([[k * 0.1, k * 0.1 + 1e-6] for k in range(50)])
    run = simulate(make_model(model=kind), module_input([*edges, 6.0], [30.0, 0.0] * 50 + [0.0]), np.array([0.0, 6.0]))
    assert run.completed and np.isfinite(run['alpha_rad']).all()
    assert run.steps < 50 * 200


def test_fast_switching_ends():
    """A command that turns round at 200 Hz keeps the wires at their guards."""
    times = np.arange(0.0, 4.0, 0.0025)
    run = simulate(make_model(), module_input(times, np.where(np.arange(len(times)) % 2, 15.0, -15.0)), np.array([3.9]))
    assert run.completed and np.isfinite(run['alpha_rad']).all()


def test_ringing_across_a_guard_ends():
    """A nearly undamped beam rings across the guards of both wires."""
    model = make_model(beam__b_x=1e-3, beam__b_y=1e-3, plate__m_H=0.2)
    run = simulate(model, module_input([0, 0.5, 1, 5], [30, -30, 20, 0]), np.arange(0.0, 5.0, 0.01))
    assert run.completed and np.isfinite(run['U_y_m']).all()


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
@pytest.mark.parametrize('effects', [[], ['beam_creep', 'driver_lag']], ids=['bare', 'with-states'])
def test_a_run_is_continued_where_it_ended(kind, effects):
    """Cut at a row of its input, and gone on from there, it is the same run to the last bit."""
    model = make_model(model=kind, effects=[active(name) for name in effects])
    whole = module_input([0.0, 3.0, 5.0, 9.0, 15.0], [12.0, -8.0, 15.0, 0.0, 0.0])
    times = np.linspace(0.0, 15.0, 200)
    once = simulate(model, whole, times)
    first = simulate(model, input_between(whole, 0.0, 5.0), times[times < 5.0])
    kept = first.state.state.y.copy()
    second = simulate(model, input_between(whole, 5.0, 15.0), times[times >= 5.0], initial_state=first.state)
    assert (first.state.state.y == kept).all()
    assert len(first.jumps) + len(second.jumps) == len(once.jumps)
    for name, column in once.columns.items():
        assert (np.concatenate([first[name], second[name]]) == column).all(), name
    assert first.steps + second.steps == once.steps


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
@pytest.mark.parametrize('begin', [-100.0, 0.0, 100.0])
def test_a_run_does_not_depend_on_the_clock_of_its_input(kind, begin):
    """Neither from rest nor where it goes on, also at an earlier time than the one before it ended at."""
    model, later = make_model(model=kind), np.linspace(0.0, 12.0, 100)
    heated, rest = module_input([3.0, 5.0, 11.0], [0.0, 12.0, -8.0]), module_input([11.0, 17.0, 23.0], [-8.0, 0.0, 0.0])
    first = simulate(model, heated, 3.0 + later[later < 8.0])
    again = simulate(model, replace(heated, times=heated.times - 3.0 + begin), begin + later[later < 8.0])
    once = simulate(model, rest, 11.0 + later, initial_state=first)
    second = simulate(model, replace(rest, times=rest.times - 11.0 + begin), begin + later, initial_state=first)
    assert len(once.jumps) == len(second.jumps) and len(first.jumps) == len(again.jumps)
    for name, column in once.columns.items():
        assert second[name] == pytest.approx(column, abs=1e-5 * np.ptp(column)), name
        assert again[name] == pytest.approx(first[name], abs=1e-5 * np.ptp(first[name])), name


@pytest.mark.parametrize(
    ('name', 'begin', 'message'),
    [
        ('ambient_drift', 0.0, 'initial_state ended at 2 s and the input begins at 0 s, but ambient_drift depends on time'),
        ('ambient_drift', 2.0, ''),
        ('clock_skew', 2.0, 'initial_state: clock_skew acts on the time since the beginning of a recording'),
    ],
)
def test_effects_of_time_go_on_where_the_run_ended(name, begin, message):
    model = make_model(effects=[active(name)])
    first = simulate(model, module_input([0.0, 2.0], [12.0, 0.0]), 10.0)
    rest = module_input([begin, begin + 1.0], [5.0, 0.0])
    with pytest.raises(UserError, match=message) if message else nullcontext():
        assert simulate(model, rest, 10.0, initial_state=first).completed


def test_a_state_of_another_model_is_refused():
    first = simulate(make_model(), module_input([0.0, 1.0], [12.0, 0.0]), 10)
    with pytest.raises(UserError, match='initial_state: expected a state of 1 value.s., as this model has; got 8'):
        simulate(make_model('wire', 'hybrid'), wire_input([0.0, 1.0], 0.04), 10, initial_state=first.state)
    older = first.state._replace(control=first.state.control[1:])
    with pytest.raises(UserError, match='initial_state: it was saved by another version of sma_sim'):
        simulate(make_model(), module_input([0.0, 1.0], [12.0, 0.0]), 10, initial_state=older)


def test_step_limit_is_a_reason():
    run = simulate(make_model(), module_input([0, 100], [10, 10]), np.arange(0.0, 100.0), max_steps=20)
    assert not run.completed and run.reason == 'step limit reached' and len(run.time) < 100


def test_step_underflow_is_a_reason():
    run = simulate(make_model(), module_input([0, 1], [1e300, 0]), np.array([0.0, 1.0]))
    assert not run.completed
    assert run.reason.startswith('step size underflow'), run.reason


def test_parameters_that_leave_no_heat_capacity_are_named():
    """Martensite stiffer than austenite: rho c_V + T (1/E_M - 1/E_A) sigma_T^2 falls to zero where austenite is heated."""
    odd = {'wire__E_A': 16e9, 'wire__E_M': 20e9, 'wire__sigma_T': 22e6, 'wire__c_V': 254.0, 'wire__T0': 298.0}
    model = make_model('wire', initial__x_M_1=0.0, **odd)
    w = model.compiled.wire
    critical = -w.rho * w.c_V / (w.d * w.sigma_T**2)
    run = simulate(model, wire_input([0.0, 30.0], [0.0, 0.0], 2.0, 298.0), 10.0)
    assert not run.completed and 298.0 < critical < 400.0
    assert run.reason.startswith('the heat capacity of wire 1 has come down to nothing'), run.reason
    assert float(run.reason.split(' at ')[1].split()[0]) == pytest.approx(critical, abs=2.0)
    assert 'wire.c_V' in run.reason and 'wire.E_M' in run.reason


def test_ramp_is_split_where_it_crosses_zero():
    times, values, slopes = segments(module_input([0, 4, 8], [2, -6, -6], linear=True))
    assert times == pytest.approx([0, 1, 4, 8]) and values[1, 0] == 0.0
    assert slopes[:, 0] == pytest.approx([-2, -2, 0, 0])


def test_ramps_agree_with_many_steps():
    ramp = simulate(make_model(), module_input([0, 10, 20], [0, 10, -10], linear=True), np.arange(0.0, 20.0, 0.5))
    fine = np.linspace(0.0, 20.0, 8001)
    stairs = module_input(fine, np.interp(fine + 0.00125, [0, 10, 20], [0, 10, -10]))
    assert ramp['alpha_rad'] == pytest.approx(simulate(make_model(), stairs, ramp.time)['alpha_rad'], abs=2e-5)


def test_time_dependent_effect_keeps_its_order(tmp_path):
    """An effect that reads the time is integrated as exactly as the rest."""
    (tmp_path / 'breath.py').write_text(
        'import math\nfrom sma_sim import Effect, Parameter\n'
        "EFFECT = Effect(name='breath', port='wire_heat', equation='Q = q sin(5 t)', source='a test',\n"
        "    parameters=(Parameter('q', 0.05, 'W', (0.0, 1.0), 'amplitude', '', 0.0, (0.01, 0.1)),),\n"
        '    kernel=lambda s, w, p: p.q * math.sin(5.0 * s.t))\n'
    )
    breath = active('breath', found=find_effects([tmp_path]))
    source, times = module_input([0, 10], [5, 5]), np.arange(0.0, 10.0, 0.1)
    coarse = simulate(make_model(effects=[breath]), source, times)
    fine = simulate(make_model(effects=[breath], solver__rtol=1e-9), source, times)
    assert coarse['T_1_K'] == pytest.approx(fine['T_1_K'], abs=5e-3)
    assert np.degrees(coarse['alpha_rad']) == pytest.approx(np.degrees(fine['alpha_rad']), abs=1e-3)


def test_start_that_no_mode_admits_is_moved_and_said():
    run = simulate(make_model(initial__x_M_1=0.1), module_input([0, 1], [0, 0]), np.array([0.0]))
    assert 'initial.x_M_1 = 0.1 is not admitted at rest' in run.notes[0]
    assert run['x_M_1'][0] > 0.5


def test_a_run_whose_time_restarts_goes_on_as_if_it_had_not():
    """Jumps included: the wire is heated from cold, and cools again."""
    model = make_model("module", "hybrid")
    runs = [FixedRateRun(model, 1000.0, np.array([0.0, 298.0])) for _ in range(2)]
    for number, J_eq in enumerate((12.0, 12.0, 0.0, 0.0, 12.0)):
        for run in runs:
            run.step(np.array([J_eq, 298.0]), 700)
        if number == 2:
            runs[1].restart_clock(np.array([J_eq, 298.0]))
            assert runs[1].time == 0.0 and runs[1].sample == pytest.approx(runs[0].sample, rel=1e-9, abs=1e-12, nan_ok=True)
    assert runs[0].time == 3.5 and runs[1].time == 1.4 and len(runs[0].take_jumps()) == len(runs[1].take_jumps())
    assert runs[1].sample == pytest.approx(runs[0].sample, rel=1e-6, abs=1e-12, nan_ok=True)
