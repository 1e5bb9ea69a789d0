"""Jumps of the automaton: which guard is violated, when it was crossed, and what the jump changes."""

from __future__ import annotations

import numpy as np

from sma_sim.model.arrays import Matrix
from sma_sim.model.automaton import EDGES, GUARD_NAMES, TO_AUSTENITE, TO_MARTENSITE, frozen_fraction
from sma_sim.model.layout import O_X, InputPoint, System, SystemState
from sma_sim.model.system import guard, update_guards
from sma_sim.solver.stepper import Segment, Step, dense, flow_at, input_at, with_smooth
from sma_sim.solver.work import Work

EDGE_TABLE = np.array(EDGES, dtype=np.int64)
# Violations below these are rounding: relative to dsigma, in x_M, and in 1/s.
TOLERANCE = np.array([1e-9, 1e-9, 1e-12, 1e-12, 1e-9, 1e-9])
assert len(TOLERANCE) == len(GUARD_NAMES)
BISECTIONS = 60


def violated_edge(i: int, state: SystemState, p: System, obs: Matrix) -> int:
    """The first edge of wire `i` whose guard is violated, or -1."""
    for edge in range(EDGE_TABLE.shape[0]):
        if EDGE_TABLE[edge, 0] == state.mode[i]:
            which = EDGE_TABLE[edge, 2]
            if guard(which, i, p, obs) > TOLERANCE[which]:
                return edge
    return -1


def crossing(edge: int, i: int, end: float, step: Step, state: SystemState, segment: Segment, p: System, w: Work) -> float:
    """The fraction of the step, up to `end`, at which the guard of `edge` is first violated, on the violated side.

    Regula falsi (Illinois) on the dense output, in a bracket that always shrinks.
    """
    which = EDGE_TABLE[edge, 2]
    low, high = 0.0, end
    g_low = guard(which, i, p, w.first.obs) - TOLERANCE[which]
    if g_low > 0.0:
        return 0.0
    g_high = guard_at(end, which, i, step, state, segment, p, w)
    side = 0
    for _ in range(BISECTIONS):
        if high - low < 1e-14 or (high - low) * step.h < 1e-13 * (1.0 + abs(step.t)):
            break
        theta = (low * g_high - high * g_low) / (g_high - g_low)
        if not low < theta < high:
            theta = 0.5 * (low + high)
        g = guard_at(theta, which, i, step, state, segment, p, w)
        if g > 0.0:
            high, g_high = theta, g
            if side == 1:
                g_low *= 0.5
            side = 1
            if g < 1e-3 * TOLERANCE[which]:
                break
        else:
            low, g_low = theta, g
            if side == -1:
                g_high *= 0.5
            side = -1
    return high


def guard_at(
    theta: float, which: int, i: int, step: Step, state: SystemState, segment: Segment, p: System, w: Work
) -> float:
    """Value of a guard, less its tolerance, at a fraction of the step."""
    evaluate_guards(theta, step, state, segment, p, w)
    return guard(which, i, p, w.guard.obs) - TOLERANCE[which]


def evaluate_guards(theta: float, step: Step, state: SystemState, segment: Segment, p: System, w: Work) -> None:
    """Evaluate what guards read at a fraction of the step just made, at its end the whole flow, into ``w.guard``."""
    if theta < 1.0:
        dense(theta, state.y, w)
        t = step.t + theta * step.h
        input_at(t, segment, w.u)
        update_guards(t, with_smooth(w.y_dense, state), InputPoint(w.u, segment.du), p, w.guard)
    else:
        flow_at(step.t + step.h, with_smooth(w.y_new, state), segment, p, w, w.guard)


def jump(edge: int, i: int, state: SystemState, obs: Matrix) -> None:
    """Take an edge: the new mode, and x_M frozen at its value."""
    state.mode[i] = EDGE_TABLE[edge, 1]
    state.x_frozen[i] = frozen_fraction(state.mode[i], obs[i, O_X])


def remember_fraction(state: SystemState, p: System, obs: Matrix) -> None:
    """In modes 4 and 5 keep x_M at hand: the first guess where it is an implicit function."""
    if not p.mas:
        for i in range(p.wires):
            if state.mode[i] == TO_MARTENSITE or state.mode[i] == TO_AUSTENITE:
                state.x_frozen[i] = obs[i, O_X]
