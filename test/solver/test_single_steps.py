"""Single steps against the textbook's form of the method, and what runs make of them: lengths, guards, samples."""

import numpy as np
import pytest
from systems import active, make_model, new_log, random_state
from test_order import untransformed
from test_stack import stack

from sma_sim import Input, module_input, wire_input
from sma_sim.model.automaton import EDGES
from sma_sim.model.layout import Evaluation, SystemState
from sma_sim.model.system import guard
from sma_sim.solver import integrate as integration
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.effect_table import own_scratch
from sma_sim.solver.events import evaluate_guards
from sma_sim.solver.inputs import segments
from sma_sim.solver.integrate import InputStretches, Limits
from sma_sim.solver.model import new_findings
from sma_sim.solver.rosenbrock import RODAS4P2
from sma_sim.solver.simulate import new_run, new_work
from sma_sim.solver.stepper import Segment, Step, dense, flow_at, linearize_flow, prepare_dense, rosenbrock_step

T, H = 2.25, 0.004  # time and length of a step
MODELS = {
    'wire': lambda: make_model('wire', 'hybrid'),
    'wire, mas': lambda: make_model('wire', 'mas', wire__V_L=2e-27, wire__omega_x=0.3, wire__dsigma=2e8),
    'module': lambda: make_model('module', 'hybrid', [active('natural_convection'), active('beam_creep')]),
    'module, mas': lambda: make_model('module', 'mas'),
    'stack': lambda: stack(2),
}


def beginning(name):
    """A model, a state of it, and a stretch of input on which everything moves."""
    model, random = MODELS[name](), np.random.default_rng(5)
    if name.startswith(('wire', 'module')):
        found = random_state(model, random, mode=4 if name == 'wire' else 3)
        state, u = SystemState(found.y, found.mode, found.x_frozen), found.u
    else:
        u = np.array([6.0, -4.0, 298.0])
        state = new_run(model, u, new_work(model)).state
        state.y[:] += 0.02 * model.scales * random.uniform(-1.0, 1.0, len(state.y))
    segment = Segment(2.0, 3.0, u, 0.02 * np.arange(1.0, len(u) + 1.0), True)
    return model, state, segment


def made_step(model, state, segment, h=H):
    """Scratch memory after a step from the state, and its error."""
    p, work = own_scratch(model.compiled), new_work(model)
    linearize_flow(T, state, segment, p, work, False)
    error = rosenbrock_step(Step(T, h), state, segment, p, work)
    prepare_dense(work)
    return p, work, error


def textbook_step(model, state, segment, work, theta):
    """The state at a fraction of a step and the error of each state: Hairer and Wanner, equations IV.7.4."""
    alpha, _, Gamma = untransformed(RODAS4P2)
    n, J, k = len(state.y), work.jacobian, np.zeros((6, len(state.y)))
    for i in range(6):
        found = Evaluation(np.zeros(n), new_findings(model.compiled))
        at = SystemState(state.y + alpha[i] @ k, state.mode, state.x_frozen)
        flow_at(T + alpha[i].sum() * H, at, segment, own_scratch(model.compiled), new_work(model), found)
        right = H * found.dy + Gamma[i].sum() * H**2 * work.f_t + H * J @ (Gamma[i, :i] @ k[:i])
        k[i] = np.linalg.solve(np.eye(n) - H * RODAS4P2.gamma * J, right)
    whole = RODAS4P2.a[5] + np.eye(6)[5]
    weights = theta * whole + theta * (1.0 - theta) * (RODAS4P2.H[0] + theta * RODAS4P2.H[1])
    return state.y + weights @ Gamma @ k, Gamma[5] @ k


@pytest.mark.parametrize('name', MODELS)
def test_a_step_is_that_of_the_textbook(name):
    """With dense equations and with those that are eliminated in order, under an input that moves."""
    model, state, segment = beginning(name)
    before = state.y.copy()
    _, work, error = made_step(model, state, segment)
    assert (state.y == before).all() and work.f_t.any()
    for theta in (1.0, 0.3, 0.8):
        y, errors = textbook_step(model, state, segment, work, theta)
        dense(theta, state.y, work)
        assert work.y_dense / model.scales == pytest.approx(y / model.scales, rel=1e-9, abs=1e-11)
        assert theta < 1.0 or (work.y_dense == work.y_new).all()
    assert np.abs((y - before) / model.scales).max() > 1e-4
    rtol = model.config.parameters['solver.rtol']
    assert error == pytest.approx(np.sqrt(np.mean((errors / (rtol * model.scales)) ** 2)), rel=1e-5)


def test_a_step_whose_equations_have_no_solution_has_failed():
    for name in ('module', 'stack'):
        model, state, segment = beginning(name)
        p, work, error = made_step(model, state, segment)
        assert np.isfinite(error)
        work.jacobian[-1, -1] = np.nan
        assert rosenbrock_step(Step(T, H), state, segment, p, work) == np.inf
        work.jacobian[-1, -1] = 0.0
        state.y[-1] = np.nan
        assert rosenbrock_step(Step(T, H), state, segment, p, work) == np.inf


@pytest.mark.parametrize('name', ['wire', 'module', 'stack'])
@pytest.mark.parametrize('theta', [0.4, 1.0])
def test_guards_within_a_step_are_those_of_its_dense_output(name, theta):
    model, state, segment = beginning(name)
    p, work, _ = made_step(model, state, segment)
    dense(theta, state.y, work)
    there = SystemState(work.y_dense.copy(), state.mode, state.x_frozen)
    whole = Evaluation(np.zeros(len(state.y)), new_findings(p))
    flow_at(T + theta * H, there, segment, own_scratch(model.compiled), new_work(model), whole)
    evaluate_guards(theta, Step(T, H), state, segment, p, work)
    for i in range(p.wires):
        for edge in EDGES:
            if edge.source == state.mode[i]:
                assert guard(edge.guard, i, p, work.guard.obs) == pytest.approx(
                    guard(edge.guard, i, p, whole.obs), rel=1e-12
                )
    assert theta < 1.0 or (work.guard.dy == whole.dy).all()


def followed(monkeypatch, model, source, times=(), limits=Limits(np.inf, 100_000, 0.0)):  # noqa: B008
    """A run in plain Python: which steps are tried (t, h, error), its log, and the run."""
    steps, make = [], rosenbrock_step

    def noted(step, *rest):
        steps.append((step.t, step.h, make(step, *rest)))
        return steps[-1][-1]

    monkeypatch.setattr(integration, 'rosenbrock_step', noted)
    stretches, work = InputStretches(*segments(source), model.uses_time), new_work(model)
    run, log = new_run(model, stretches.values[0], work), new_log(sample_columns(model.structure), times)
    status = integration.integrate(stretches, run, own_scratch(model.compiled), work, limits, log)
    assert status == integration.COMPLETED
    return np.array(steps), log, run


STRETCHED = wire_input([0.0, 0.1, 0.2], [0.0195, 0.024, 0.022], [0.0, 0.3, 0.0])


def test_steps_begin_short_and_grow_by_a_limited_factor(monkeypatch):
    """1 ms at the start, 5 ms as a wire begins to transform, 10 ms after a row; then five times the last."""
    steps, log, _ = followed(monkeypatch, make_model('wire'), STRETCHED)
    t, h, error = steps.T
    assert h[:4] == pytest.approx([1e-3, 5e-3, 25e-3, 70e-3]) and h[4:6] == pytest.approx([10e-3, 50e-3])
    assert log.jumps[:4, 2].tolist() == [3, 5, 2, 7] and log.jumps[1, 0] == 0.1 and log.jumps[3, 0] == 0.2
    assert t[6] == log.jumps[2, 0] and h[6:8] == pytest.approx([5e-3, 25e-3]) and t[-1] + h[-1] == pytest.approx(0.2)
    assert (error < 1.0).all() and (np.diff(t) <= h[:-1] * (1.0 + 1e-9)).all()


def test_steps_of_kinetics_without_jumps_grow_more_slowly(monkeypatch):
    """Two and a half times, as nothing announces a front."""
    model = make_model('wire', 'mas')
    steps, log, run = followed(monkeypatch, model, wire_input([0.0, 0.5], [0.0, 0.0]))
    growth = steps[1:, 1] / steps[:-1, 1]
    assert steps[0, 1] == 1e-3 and growth[:4] == pytest.approx([2.5] * 4) and not run.count[integration.N_JUMPS]
    limited, _, _ = followed(monkeypatch, model, wire_input([0.0, 0.5], [0.0, 0.0]), limits=Limits(0.003, 1000, 0.0))
    assert limited[:, 1].max() == 0.003 and len(limited) > 150


def test_where_only_the_input_moves_a_stretch_begins_with_three_tenths_of_it(monkeypatch):
    """Of a wire at imposed temperature; a stretch that is too short for that begins with 10 ms as any other."""
    model = make_model('wire_at_T')
    names = model.structure.input_columns
    rows = {'strain': [0.01] * 4, 'T_K': [300.0, 301.0, 302.0, 302.5]}
    values = np.column_stack([rows.get(name, [298.0 if name == 'T_E_K' else 0.0] * 4) for name in names])
    linear = tuple(name in rows for name in names)
    steps, _, run = followed(monkeypatch, model, Input(np.array([0.0, 10.0, 20.0, 20.015]), values, linear, names))
    first = {begin: steps[steps[:, 0] == begin][0, 1] for begin in (10.0, 20.0)}
    assert run.state.y[0] == pytest.approx(302.5) and first == pytest.approx({10.0: 3.0, 20.0: 0.0075})


def ready_to_jump(mode, y=(0.0195, 0.0)):
    """A wire that was stretched at a rate, in a mode that its flow violates; its run, and what `jump_now` takes."""
    model, u = make_model('wire'), np.array([y[0], 0.0, 298.0])
    work = new_work(model)
    run, log = new_run(model, u, work), new_log(sample_columns(model.structure))
    run.state.mode[0], run.state.x_frozen[0], run.control[integration.C_H] = mode, 0.2, 1.0
    segment = Segment(0.0, 1.0, u, np.array([y[1], 0.0, 0.0]), True)
    return run, log, lambda t: integration.jump_now(t, run, segment, own_scratch(model.compiled), work, log)


@pytest.mark.parametrize(
    ('mode', 'strain', 'rate', 'target', 'first'),
    [
        (3, 0.04, 0.0, 4, 5e-3),
        (3, 0.0, 0.0, 5, 5e-3),
        (1, 0.04, 0.0, 4, 5e-3),
        (4, 0.04, -0.01, 3, 2e-2),
        (5, 0.0, 0.0, 1, 5e-3),
    ],
)
def test_a_jump_makes_the_next_step_short(mode, strain, rate, target, first):
    """5 ms where a wire begins to transform or comes to an end of it, 20 ms where it stops between."""
    run, log, jump_at = ready_to_jump(mode, (strain, rate))
    assert jump_at(0.5) and run.state.mode[0] == target and run.control[integration.C_H] == first
    assert log.jumps[0, [0, 1]].tolist() == [0.5, 0.0] and run.count[integration.N_JUMPS] == 1
    edge = EDGES[int(log.jumps[0, 2])]
    assert (edge.source, edge.target) == (mode, target)
    run.control[integration.C_H], run.state.mode[0] = 1e-4, mode
    assert not jump_at(0.5) and run.state.mode[0] == mode  # one jump at a time
    assert jump_at(0.6) and run.control[integration.C_H] == 1e-4


def test_a_wire_that_waits_jumps_when_its_time_has_come():
    run, _, jump_at = ready_to_jump(3, (0.04, 0.0))
    run.control[integration.of_wire(0, integration.C_LAST_JUMP)] = 0.25
    run.control[integration.of_wire(0, integration.C_DWELL)] = 0.5
    assert not jump_at(0.7) and not run.count[integration.N_JUMPS]
    assert jump_at(0.75) and run.state.mode[0] == 4


def test_samples_at_the_time_of_a_jump_show_what_comes_after_it(monkeypatch):
    """And those at the end of a run its last jump; none between depends on which others are asked for."""
    model, where = make_model('wire'), sample_columns(make_model('wire').structure)
    _, log, _ = followed(monkeypatch, model, STRETCHED)
    times = log.jumps[:4, 0]
    asked = np.sort(np.concatenate([times, times[1:3] - 1e-9, times[:3] + 1e-9, [0.05, 0.1101]]))
    _, shown, _ = followed(monkeypatch, model, STRETCHED, asked)
    assert (shown.jumps[:4] == log.jumps[:4]).all() and shown.written[0] == len(asked)
    modes = dict(zip(asked.tolist(), shown.samples[:, where.wires][:, integration.WIRE_COLUMNS.index('mode')], strict=True))
    for t, edge in log.jumps[:4, [0, 2]].tolist():
        assert modes[t] == EDGES[int(edge)].target
    for t, edge in log.jumps[1:3, [0, 2]].tolist():
        assert modes[t - 1e-9] == EDGES[int(edge)].source and modes[t + 1e-9] == EDGES[int(edge)].target
    for only in (0.05, 0.1101):
        _, one, _ = followed(monkeypatch, model, STRETCHED, [only])
        assert (one.samples[0] == shown.samples[asked == only][0]).all()


def test_every_step_that_is_tried_is_counted(monkeypatch):
    """Rejected ones too; none goes beyond a row of the command."""
    model, source = make_model('module'), module_input([0.0, 0.0225, 0.03], [14.0, 0.0, 0.0])
    steps, _, run = followed(monkeypatch, model, source)
    assert (steps[:, 2] > 1.0).any() and run.count[integration.N_STEPS] == len(steps)
    assert run.count[integration.N_REJECTED] == (steps[:, 2] > 1.0).sum()
    for row in (0.0225, 0.03):
        before = steps[:, 0] < row - 1e-9
        assert (steps[before, 0] + steps[before, 1] <= row + 1e-12).all()


@pytest.mark.parametrize(
    ('kind', 'effects', 'kept'), [('hybrid', (), True), ('hybrid', ('thermal_expansion',), False), ('mas', (), False)]
)
def test_the_flow_at_the_end_of_a_step_is_not_evaluated_again(monkeypatch, kind, effects, kept):
    """Where guards have been looked at there, no jump has changed it, and no effect depends on the fraction there."""
    known, linearize = {}, linearize_flow

    def noted(t, state, segment, p, w, evaluated):
        known[t] = evaluated
        linearize(t, state, segment, p, w, evaluated)

    monkeypatch.setattr(integration, 'linearize_flow', noted)
    model = make_model('wire', kind, [active(name) for name in effects])
    _, log, run = followed(monkeypatch, model, wire_input([0.0, 0.1, 0.2], [0.0195, 0.022, 0.022], [0.0, 0.3, 0.0]))
    jumps = set(log.jumps[: run.count[integration.N_JUMPS], 0])
    assert (len(jumps) > 1) == (kind == 'hybrid') and len(set(known) - jumps - {0.0, 0.1}) >= 4
    for t, evaluated in known.items():
        within = t not in (0.0, 0.1)
        expected = kind == 'hybrid' and t not in jumps and (kept or not within)
        assert evaluated == expected, t
