"""Events, in plain Python: which guard is crossed first, when a wire waits, which modes admit a start."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_step_control import new_state

from sma_sim import Config, Model
from sma_sim.model.layout import O_S_A, O_S_M, O_SIGMA, O_X, InputPoint, SystemState
from sma_sim.solver import events, first_start
from sma_sim.solver import integrate as integration
from sma_sim.solver.equilibrium import (
    at_transformation_stress,
    forget_pose,
    move_to_admitted,
    run_to_end,
    start_on_hysteresis_edge,
)
from sma_sim.solver.integrate import (
    C_DWELL,
    C_LAST_JUMP,
    N_CHATTER,
    NO_JUMP,
    of_wire,
)
from sma_sim.solver.simulate import new_work
from sma_sim.solver.stepper import Step


def found_crossing(monkeypatch, guard, end=1.0, h=0.1, which=0):
    """Where `crossing` finds a guard violated that is a function of the fraction of a step; at which fractions it looked."""
    looked = []

    def guard_at(theta, *_):
        looked.append(theta)
        return guard(theta)

    monkeypatch.setattr(events, 'guard_at', guard_at)
    monkeypatch.setattr(events, 'guard', lambda which, *_: guard(0.0) + events.TOLERANCE[which])
    work = SimpleNamespace(first=SimpleNamespace(obs=None))
    edge = next(k for k, row in enumerate(events.EDGE_TABLE) if row[2] == which)
    return events.crossing(edge, 0, end, Step(3.0, h), None, None, None, work), looked


@pytest.mark.parametrize(
    ('guard', 'root'),
    [
        (lambda s: s - 0.3, 0.3),
        (lambda s: (s - 0.3) * np.exp(9.0 * s), 0.3),
        (lambda s: s**9 - 1e-4, 1e-4 ** (1 / 9)),
        (lambda s: np.tanh(40.0 * (s - 0.71)), 0.71),
    ],
)
def test_a_crossing_is_found_from_the_violated_side(monkeypatch, guard, root):
    for end in (1.0, 0.8):
        found, looked = found_crossing(monkeypatch, guard, end)
        assert found == pytest.approx(root, abs=1e-11) and guard(found) > 0.0 and len(looked) <= events.BISECTIONS
        assert looked[0] == end and all(0.0 < theta <= end for theta in looked)
    assert found_crossing(monkeypatch, lambda s: 0.1 + s)[0] == 0.0  # violated from the beginning
    assert len(found_crossing(monkeypatch, lambda s: np.sin(s - 1.0 / np.pi))[1]) < 10  # smooth ones take a few looks
    jump, _ = found_crossing(monkeypatch, lambda s: 1.0 if s > 0.37 else -1.0)
    assert jump == pytest.approx(0.37, abs=1e-10) and jump > 0.37


def jumps_of(monkeypatch, guards, h=0.01, last_jump=-1.0, dwell=0.0, mas=False):
    """`first_jump` of a step from time 0 where the guards of the wires are functions of its fraction; where it evaluated."""
    evaluated, run = [], new_state(len(guards))
    for i in range(len(guards)):
        run.control[of_wire(i, C_LAST_JUMP)], run.control[of_wire(i, C_DWELL)] = last_jump, dwell
    monkeypatch.setattr(integration, 'evaluate_guards', lambda theta, *_: evaluated.append(theta))
    monkeypatch.setattr(integration, 'violated_edge', lambda i, *_: 0 if guards[i](evaluated[-1]) > 0.0 else -1)
    monkeypatch.setattr(integration, 'prepare_dense', lambda _: None)

    def crossing(edge, i, end, *_):
        evaluated.append(0.123)
        inside = np.linspace(0.0, end, 10001)
        return inside[np.argmax(guards[i](inside) > 0.0)]

    monkeypatch.setattr(integration, 'crossing', crossing)
    work = SimpleNamespace(guard=SimpleNamespace(obs=None))
    found = integration.first_jump(Step(0.0, h), run, None, SimpleNamespace(mas=mas, wires=len(guards)), work)
    return found, evaluated, run


def test_the_first_of_several_jumps_is_taken(monkeypatch):
    """Guards that are crossed to and fro within a long step too; without a jump the last evaluation is of the step's end."""
    later, sooner, never = (lambda s: s - 0.7), (lambda s: s - 0.4), (lambda s: s - 2.0)
    assert jumps_of(monkeypatch, [later, sooner])[0] == pytest.approx(0.4, abs=1e-3)
    assert jumps_of(monkeypatch, [sooner, never])[0] == pytest.approx(0.4, abs=1e-3)
    found, evaluated, _ = jumps_of(monkeypatch, [never, never])
    assert found == NO_JUMP and evaluated[-1] == 1.0
    hump = lambda s: 0.1 - np.abs(s - 0.45)  # noqa: E731
    assert jumps_of(monkeypatch, [hump], h=2.1e-3)[0] == pytest.approx(0.35, abs=1e-3)
    assert jumps_of(monkeypatch, [hump], h=2e-3)[0] == NO_JUMP
    assert jumps_of(monkeypatch, [sooner], mas=True)[0] == NO_JUMP


def test_a_wire_that_has_just_jumped_waits(monkeypatch):
    """Where its wait ends within the step the jump is at its end; else there is none, and the flow is that of the end."""
    sooner = lambda s: s - 0.4  # noqa: E731
    for dwell, expected in ((0.0039, 0.4), (0.0041, 1.0), (0.0099, 1.0), (0.0101, NO_JUMP)):
        found, evaluated, run = jumps_of(monkeypatch, [sooner], last_jump=0.0, dwell=dwell)
        assert found == pytest.approx(expected, abs=1e-3) and (run.count[N_CHATTER] > 0) == (expected != 0.4)
        assert expected != NO_JUMP or evaluated[-1] == 1.0
    assert jumps_of(monkeypatch, [sooner], last_jump=0.0041)[0] == 1.0  # it cannot be before the last


def at_rest(mode, x, sigma, s_A=2e8, s_M=1e8):
    """A state of wires and what the flow finds there."""
    obs = np.zeros((len(mode), 16))
    obs[:, O_X], obs[:, O_SIGMA], obs[:, O_S_A], obs[:, O_S_M] = x, sigma, s_A, s_M
    return SystemState(np.ones(4), np.array(mode), np.array(x, dtype=float)), obs


def test_a_start_moves_wires_to_modes_that_admit_them():
    p = SimpleNamespace(wires=1, wire=SimpleNamespace(dsigma=1e7), coordinates=2)
    for mode, x, sigma, moved, new_mode, new_x in (
        (4, 0.4, 2e8, False, 4, 0.4),
        (4, -0.1, 2e8, True, 3, 0.0),
        (5, 1.1, 1e8, True, 3, 1.0),
        (3, 0.4, 1.5e8, False, 3, 0.4),
        (3, 0.4, 2.1e8, True, 4, 0.4),
        (3, 0.4, 0.9e8, True, 5, 0.4),
        (3, 1.0, 2.1e8, False, 3, 1.0),
        (3, 0.0, 0.9e8, False, 3, 0.0),
        (3, 0.4, 2e8 + 1e-2, False, 3, 0.4),
        (3, 0.4, 1e8 - 1e-2, False, 3, 0.4),
        (4, 0.0, 2e8, False, 4, 0.0),
        (5, 1.0, 1e8, False, 5, 1.0),
        (3, 0.4, 2e8 + 2e-2, True, 4, 0.4),
        (3, 0.4, 1e8 - 2e-2, True, 5, 0.4),
    ):
        state, obs = at_rest([mode], [x], [sigma])
        assert move_to_admitted(state, p, obs) == moved and state.mode[0] == new_mode
        assert (new_mode != 3 or not moved) or state.x_frozen[0] == new_x
    two, obs = at_rest([3, 3], [0.4, 0.4], [1.5e8, 2.1e8])
    p.wires = 2
    assert move_to_admitted(two, p, obs) and two.mode.tolist() == [3, 4]
    state, _ = at_rest([3, 5], [0.4, 0.6], [0.0, 0.0])
    assert run_to_end(state, p) and state.mode.tolist() == [3, 3] and state.x_frozen.tolist() == [0.4, 0.0]
    assert not run_to_end(state, p)
    state, obs = at_rest([4, 5], [0.4, 0.6], [2e8, 1e8])
    assert run_to_end(state, p) and state.x_frozen.tolist() == [1.0, 0.6]
    for modes, sigma, on_edge in (
        ((4, 5), (2e8, 1e8), True),
        ((4, 5), (2e8 + 20.0, 1e8), False),
        ((4, 5), (2e8, 1e8 - 20.0), False),
        ((4, 5), (2e8 + 10.0, 1e8), True),
        ((4, 5), (2e8, 1e8 + 20.0), False),
        ((3, 1), (0.0, 0.0), True),
    ):
        state, obs = at_rest(modes, [0.4, 0.6], sigma)
        assert at_transformation_stress(state, p, obs) == on_edge
    forget_pose(state, p, obs)
    assert state.y.tolist() == [0.0, 0.0, 1.0, 1.0] and obs[:, O_X].tolist() == [0.4, 0.6] and not obs[:, O_SIGMA].any()


def test_progress_of_a_compilation_is_told_in_quarters(monkeypatch):
    said, now = [], [0.0]
    monkeypatch.setattr(first_start.time, 'monotonic', lambda: now[0])
    monkeypatch.setattr(first_start, 'reachable', lambda *_: range(80))
    one = first_start.Compilation(said.append, ('entry',))
    first_start.on_compiled.append(one)
    for k in range(80):
        now[0] = 0.5 * (k + 1)
        one(1)
    one(20)
    assert said[0] == 'compiling the equations: about 45 s on this machine'  # 10 of 100 in 5 s
    assert said[1:3] == [f'compiling the equations: {k} % done, about {(100 - k) // 2} s left' for k in (35, 60)]
    assert said[-1] == 'compiled in 40 s' and one not in first_start.on_compiled and len(said) == 4


def test_wires_that_have_no_equilibrium_are_put_on_the_nearer_edge():
    """From wherever a search got lost: to austenite those that were asked for more martensite than can be, and back."""
    model = Model(Config(system='lever'))
    p, work, u = model.compiled, new_work(model), np.array([0.0, 298.0])
    for requested, modes in (([0.9, 0.1], [5, 4]), ([0.1, 0.9], [4, 5]), ([0.9, 0.9], [5, 5]), ([0.1, np.nan], [4, 4])):
        y = np.concatenate([[3.0, 0.0], [298.0] * 2])
        state = SystemState(y, np.array([3, 3]), np.array(requested))
        start_on_hysteresis_edge(state, InputPoint(u, np.zeros(2)), np.array(requested), p, work)
        assert state.mode.tolist() == modes and state.y[0] == pytest.approx(0.0, abs=1e-9)
