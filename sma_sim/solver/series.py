"""Segments in series: a Jacobian that evaluates one segment at a time, and an order of elimination with little fill.

A segment's wires depend on nothing but the segment, and its acceleration on that, its neighbours, and the rates of all
segments before it (`Structure.accelerations`). A column of the Jacobian so costs the evaluation of one segment.
Coordinates are eliminated first, temperatures next, and last the rates, from the end of the series to its base: what the
rates near the base do to all segments beyond then brings no fill.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.layout import RANGE, InputPoint, System, SystemState
from sma_sim.model.structures.structure import Structure
from sma_sim.model.system import (
    LENGTHS,
    PER_WIRE_BITS,
    RATES_1,
    SPEEDS,
    STRESS_1,
    depends_on,
    kinematics,
    motion,
    speeds,
    stress_and_force,
    wire_rates,
)
from sma_sim.solver.linear import DENSE, Elimination, elimination
from sma_sim.solver.work import Work, copy_evaluation

Flags = NDArray[np.bool_]
TRIED_STATES = 3  # in which it is seen what depends on what


def linearize_segments(state: SystemState, point: InputPoint, p: System, w: Work) -> None:
    """The Jacobian at a state whose flow is ``w.first``, by forward differences; entries outside the pattern stay zero."""
    n, own, wires, last = p.coordinates, p.coordinates // p.segments, p.wires // p.segments, p.segments
    reach = w.elimination.reach
    copy_evaluation(w.first, w.stage)
    motion(state.y, point.u, p, w.stage.dy, w.stage.obs)  # leaves the forces on all segments
    for k in range(p.segments):
        near = min(k + 2, last)
        for c in range(own):
            difference(own * k + c, k, near, state, point, p, w)
            difference(n + own * k + c, k, last if reach[c] != 0 else near, state, point, p, w)
        for i in range(wires * k, wires * (k + 1)):
            difference(p.first_T + i, k, near, state, point, p, w)
            if p.mas:
                difference(p.first_x + i, k, near, state, point, p, w)
    ask(0, last, 0, last, p)


def difference(j: int, k: int, last: int, state: SystemState, point: InputPoint, p: System, w: Work) -> None:
    """Column `j` of the Jacobian, of a state of segment `k`, on which accelerations of segments up to `last` depend."""
    y, found, n, own, wires = state.y, w.stage, p.coordinates, p.coordinates // p.segments, p.wires // p.segments
    forces, first = p.structure.effects, p.structure.effects.shape[0] - n + own * k
    for c in range(own):
        w.y_stage[c] = forces[first + c]
    ask(k, k + 1, max(k - 1, 0), last, p)
    kept = y[j]
    y[j] = kept + w.increment[j]
    step = y[j] - kept
    update_segment(k, depends_on(j, state, p), state, point, p, w)
    y[j] = kept
    inverse = 1.0 / step
    for i in range(own * k, own * (k + 1)):
        w.jacobian[i, j] = (found.dy[i] - w.first.dy[i]) * inverse
    for i in range(n + own * max(k - 1, 0), n + own * last):
        w.jacobian[i, j] = (found.dy[i] - w.first.dy[i]) * inverse
    for i in range(wires * k, wires * (k + 1)):
        for row in range(p.first_T + i, p.first_T + i + (p.wires + 1 if p.mas else 1), p.wires):
            w.jacobian[row, j] = (found.dy[row] - w.first.dy[row]) * inverse
            found.dy[row] = w.first.dy[row]
        for column in range(found.obs.shape[1]):
            found.obs[i, column] = w.first.obs[i, column]
    for c in range(own):
        forces[first + c] = w.y_stage[c]


def update_segment(k: int, changed: int, state: SystemState, point: InputPoint, p: System, w: Work) -> None:
    """What `changed` says of the flow of segment `k`, into ``w.stage``, and the accelerations that are asked for."""
    y, obs, dy, wires = state.y, w.stage.obs, w.stage.dy, p.wires // p.segments
    if changed & LENGTHS:
        kinematics(y, point, p, obs)
    if changed & SPEEDS:
        speeds(y, p, obs)
    for i in range(wires * k, wires * (k + 1)):
        if changed & (STRESS_1 << PER_WIRE_BITS * i):
            stress_and_force(i, state, p, obs)
        if changed & (RATES_1 << PER_WIRE_BITS * i):
            wire_rates(i, state, point, p, dy, obs)
    motion(y, point.u, p, dy, obs)


def ask(first: int, last: int, first_moved: int, last_moved: int, p: System) -> None:
    """Say of which segments wires and forces are evaluated, and of which the accelerations."""
    effects = p.structure.effects
    at = effects.shape[0] - p.coordinates - RANGE
    effects[at], effects[at + 1], effects[at + 2], effects[at + 3] = first, last, first_moved, last_moved


def elimination_of(p: System, structure: Structure, states: int) -> Elimination:
    """How the equations of a step are eliminated; as dense ones but for segments in series on which no effect acts."""
    if p.segments == 1 or p.effects.port_start[-1] > 0:
        return DENSE
    n, reach = p.coordinates, far_rates(structure)
    rates = np.arange(n, 2 * n).reshape(p.segments, -1)[::-1].ravel()
    order = np.concatenate([np.arange(n), np.arange(p.first_T, states), rates])
    return elimination(jacobian_pattern(p, reach, states), order, reach)


def far_rates(structure: Structure) -> Flags:
    """Which rates of a segment's coordinates (own,) accelerate segments beyond the next one: tried in some states."""
    assert structure.segment is not None and structure.accelerations is not None
    sizes, random = [c.size(structure.default_constants) for c in structure.segment.coordinates], np.random.default_rng(0)
    found = np.zeros(len(sizes), dtype=bool)
    for _ in range(TRIED_STATES):
        q, v, f = (random.uniform(0.5, 1.5, (3, len(sizes))) * sizes for _ in range(3))
        before = structure.accelerations(2, q, v, f, structure.default_constants)
        for c in range(len(sizes)):
            changed = v.copy()
            changed[0, c] *= 2.0
            found[c] |= structure.accelerations(2, q, changed, f, structure.default_constants) != before
    return found


def jacobian_pattern(p: System, reach: Flags, states: int) -> Flags:
    """Which entries of the Jacobian (states, states) may differ from zero, with the diagonal; `reach` as `far_rates`."""
    n, wires = p.coordinates, p.wires
    of = np.concatenate(
        [np.repeat(np.arange(p.segments), n // p.segments)] * 2
        + [np.repeat(np.arange(p.segments), wires // p.segments)] * (2 if p.mas else 1)
    )
    rows, columns = of[:, None], of[None, :]
    rate = (np.arange(states) >= n) & (np.arange(states) < 2 * n)
    far = np.concatenate([np.zeros(n, dtype=bool), np.tile(reach, p.segments), np.zeros(states - 2 * n, dtype=bool)])
    wire = np.concatenate([np.full(2 * n, -1), *[np.arange(wires)] * (2 if p.mas else 1)])
    pattern: Flags = np.eye(states, dtype=bool)
    pattern |= (wire[:, None] >= 0) & (rows == columns) & ((wire[None, :] < 0) | (wire[:, None] == wire[None, :]))
    pattern |= rate[:, None] & (np.abs(rows - columns) <= 1)
    pattern |= rate[:, None] & far[None, :] & (columns < rows)
    pattern[np.arange(n), n + np.arange(n)] = True
    return pattern
