"""Tangents of a run: how its states and samples change with unknowns, integrated beside it (forward sensitivities).

Along a run y(t) the tangent s of an unknown z solves the linear equation

    ds/dt = f_y s + f_x r + f_z,        s+ = s- + (f- - f+) dt*/dz  at a jump,  dt*/dz = -(g_y s + g_x r + g_z)/(dg/dt)

with r the tangents of the frozen fractions x_M and g the guard that is crossed at t* (Hairer, Norsett, Wanner, Solving ODEs
I, section I.14; Rozenvasser 1967 for the jumps). Each step of the run is made by the same Rosenbrock method with the inverse
that solves its equations. Its derivatives are found at the beginning, the middle and the end of the step and interpolated
between: those in the states once for all unknowns, those in an unknown by one evaluation of the flow with it moved.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sma_sim.compiler.pinned_systems import record_at
from sma_sim.model.arrays import Matrix
from sma_sim.model.automaton import INNER
from sma_sim.model.layout import O_DX, O_X, Evaluation, System, SystemState
from sma_sim.model.system import EVERYTHING, guard, update_flow
from sma_sim.solver.events import EDGE_TABLE, remember_fraction, violated_edge
from sma_sim.solver.integrate import (
    C_H,
    C_TIME,
    COMPLETED,
    InputStretches,
    Limits,
    Log,
    Run,
    first_step,
    jump_now,
    keep_heat,
    next_step,
    stretch,
)
from sma_sim.solver.sampling import needed_for, sample_numbers
from sma_sim.solver.stepper import (
    GAMMA,
    NODES,
    STAGES,
    TIME_STEP,
    A,
    C,
    D,
    H,
    Segment,
    Step,
    dense,
    differentiate_in_time,
    flow_at,
    input_at,
    prepare_dense,
    prepare_solutions,
    with_smooth,
)
from sma_sim.solver.tangent_algebra import (
    add_combination,
    add_flow,
    add_product,
    copy_matrix,
    interpolate,
    interpolation,
    solve_for_all,
)
from sma_sim.solver.tangent_nodes import (
    FIRST,
    LAST,
    MIDDLE,
    Tangents,
    by_sensor,
    input_beside,
    keep_last,
    linearize_node,
    move_along,
    unknown_columns,
)
from sma_sim.solver.work import Work, copy_evaluation, copy_into

SLOPE_STEP = 1e-4  # of a step, for the slope of what is sampled
BEGINNING = (-3.0, 4.0, -1.0)  # weights of the nodes in the derivative at the beginning, times the length of the step


class PartOfStep(NamedTuple):
    """The first `part` of a step, up to the time `end` [s]: all of it, or up to a jump."""

    step: Step
    part: float
    end: float


def follow(stretches: InputStretches, run: Run, p: System, w: Work, limits: Limits, log: Log, a: Tangents) -> int:
    """Run over all stretches of the input with tangents; the reason for the end."""
    for k in range(stretches.times.shape[0] - 1):
        segment = stretch(k, stretches)
        status = follow_segment(k, run, segment, p, w, limits, log, a)
        if status != COMPLETED:
            return status
    k, t_end = log.written[0], stretches.times[stretches.times.shape[0] - 1]
    run.control[C_TIME] = t_end
    while k < log.times.shape[0] and log.times[k] <= t_end:
        sample_last(k, log, a)
        k += 1
    log.written[0] = k
    return COMPLETED


def follow_segment(row: int, run: Run, segment: Segment, p: System, w: Work, limits: Limits, log: Log, a: Tangents) -> int:
    """Integrate one stretch of the input with tangents; the reason for its end."""
    t, y = segment.t_0, run.state.y
    run.control[C_H] = min(run.control[C_H], first_step(run, segment, p))
    keep_heat(run, segment, p, w)
    a.row[0] = row
    for j in range(a.shift.shape[0]):
        a.shift[j] = a.row_shift[row, j]
    restart(t, False, run, segment, p, w, log, a)
    while t < segment.t_end:
        begin_step(t, run.state, segment, p, w, a)
        status, step, theta, t_new = next_step(t, run, segment, p, w, limits)
        if status != COMPLETED:
            return status
        made = PartOfStep(step, min(theta, 1.0), t_new)
        remember = theta > 1.0 and not p.mas
        if made.part > 0.0:
            follow_step(made, run.state, segment, p, w, a)
            sample_step(made, run.state, segment, p, w, log, a)
            copy_into(y, a.y[LAST])
            copy_matrix(a.s, a.new)
        if remember:
            remember_fraction(run.state, p, w.guard.obs)
        moved, t = t_new > t, t_new
        if theta <= 1.0:
            restart(t, moved, run, segment, p, w, log, a)
        else:
            keep_last(a)
    return COMPLETED


def restart(t: float, located: bool, run: Run, segment: Segment, p: System, w: Work, log: Log, a: Tangents) -> None:
    """Take the jumps that are due at time t, and carry the tangents over them or over a row of the input.

    `located`: a guard was crossed here, unless no jump is due; else what changes, changes at the row's time. Jumps that
    follow at once on others are as much later as these.
    """
    copy_into(a.x_frozen, run.state.x_frozen)
    for i in range(p.wires):
        a.mode[i] = run.state.mode[i]
    if jump_now(t, run, segment, p, w, log):
        for i in range(p.wires):
            if run.state.mode[i] != a.mode[i]:
                carry_over(i, t, located, run, segment, p, w, a)
                located = False
    linearize_node(FIRST, t, run.state, segment, p, w, a)
    for i in range(a.s.shape[0]):
        for j in range(a.s.shape[1]):
            a.s[i, j] += (a.dy[LAST, i] - a.dy[FIRST, i]) * a.shift[j]
    unknown_columns(FIRST, t, run.state, segment, p, w, a)


def carry_over(i: int, t: float, located: bool, run: Run, segment: Segment, p: System, w: Work, a: Tangents) -> None:
    """How much later a jump of wire `i` takes place, when `located`, and its tangents of the frozen fraction."""
    before = SystemState(run.state.y, a.mode, a.x_frozen)
    edge = violated_edge(i, before, p, w.first.obs)
    which = EDGE_TABLE[edge, 2]
    here, x, rate = guard(which, i, p, w.first.obs), w.first.obs[i, O_X], a.obs[LAST, i, O_DX]  # before, also of a row
    slope = 0.0
    if located:
        for k in range(a.moved.shape[0]):
            a.moved[k] = before.y[k] + TIME_STEP * w.first.dy[k]
        flow_at(t + TIME_STEP, with_smooth(a.moved, before), segment, p, w, w.stage)
        slope = (guard(which, i, p, w.stage.obs) - here) / TIME_STEP
    input_at(t, segment, w.u)
    for j in range(a.systems.shape[0]):
        moved = record_at(a.systems[j], p)
        update_flow(t, move_along(j, before, a), input_beside(j, t, segment, w, a), moved, w.stage, EVERYTHING)
        there = guard(which, i, moved, w.stage.obs)
        if located:
            later = -(there - here) / (a.delta * slope)
            a.shift[j] = later if np.isfinite(later) else 0.0
        a.r[i, j] = (w.stage.obs[i, O_X] - x) / a.delta + rate * a.shift[j] if run.state.mode[i] == INNER else 0.0


def begin_step(t: float, state: SystemState, segment: Segment, p: System, w: Work, a: Tangents) -> None:
    """Linearise the run where the last step left it, as `solver.stepper.linearize_flow` does.

    The flow is differentiated in time by two evaluations that begin with the same x_M: the one at the end of the last step
    began with an older one, and where x_M is an implicit function its rounding, over so short a time, is a large derivative.
    """
    n = a.y.shape[1]
    if segment.moving:
        flow_at(t, state, segment, p, w, w.first)
    else:
        copy_evaluation(Evaluation(a.dy[FIRST], a.obs[FIRST]), w.first)
    for i in range(n):
        for j in range(n):
            w.jacobian[i, j] = a.by_state[FIRST, i, j]
    differentiate_in_time(t, state, segment, p, w)
    input_at(t, segment, w.u)


def follow_step(made: PartOfStep, state: SystemState, segment: Segment, p: System, w: Work, a: Tangents) -> None:
    """Make a step of the tangents of a run."""
    step, part = made.step, made.part
    h = part * step.h
    prepare_dense(w)
    if part < 1.0:
        prepare_solutions(1.0 / (h * GAMMA), p, w)
    for node in (MIDDLE, LAST):
        theta = 0.5 * part * node
        if theta < 1.0:
            dense(theta, state.y, w)
            copy_into(a.y[node], w.y_dense)
        else:
            copy_into(a.y[node], w.y_new)
        at = with_smooth(a.y[node], state)
        linearize_node(node, step.t + theta * step.h, at, segment, p, w, a)
        unknown_columns(node, step.t + theta * step.h, at, segment, p, w, a)
    tangent_step(h, p.coordinates, w, a)


def tangent_step(h: float, coordinates: int, w: Work, a: Tangents) -> None:
    """One step of all tangents by the method of the run, with its equations in ``w.matrix``, into ``a.new``."""
    n, rhs = a.s.shape[0], a.rhs
    interpolate(BEGINNING, a.by_state, n, a.matrix)
    interpolate(BEGINNING, a.by_unknown, n, a.slope)
    add_flow(a.matrix, a.s, a.r, a.slope)
    for stage in range(STAGES):
        copy_matrix(a.stage, a.s)
        add_combination(1.0, A, stage, stage, a.stages, a.stage)
        weights = interpolation(NODES[stage])
        interpolate(weights, a.by_state, n, a.matrix)
        interpolate(weights, a.by_unknown, n, rhs)
        add_flow(a.matrix, a.stage, a.r, rhs)
        add_combination(1.0 / h, C, stage, stage, a.stages, rhs)
        for i in range(n):
            add_product(D[stage], a.slope[i], rhs[i])
        solve_for_all(w.matrix, rhs, a.stages[stage], coordinates)
    for i in range(a.s.shape[0]):
        for j in range(a.s.shape[1]):
            a.new[i, j] = a.stage[i, j] + a.stages[STAGES - 1, i, j]


def sample_step(made: PartOfStep, state: SystemState, segment: Segment, p: System, w: Work, log: Log, a: Tangents) -> None:
    """Write the samples, with their tangents and slopes, that fall into the part of a step that was made."""
    step, k = made.step, log.written[0]
    if k >= log.times.shape[0] or log.times[k] >= made.end:
        return
    for m in range(2):
        for i in range(a.s.shape[0]):
            for j in range(a.s.shape[1]):
                a.dense[m, i, j] = 0.0
        add_combination(1.0, H, m, STAGES - 1, a.stages, a.dense[m])
    needed = needed_for(a.numbers, p)
    while k < log.times.shape[0] and log.times[k] < made.end:
        theta = (log.times[k] - step.t) / step.h
        for c in range(a.slopes.shape[1]):
            a.slopes[k, c] = 0.0
        for sign in (-1.0, 1.0, 0.0):
            dense(theta + sign * SLOPE_STEP, state.y, w)
            t = log.times[k] + sign * SLOPE_STEP * step.h
            sample_numbers(t, with_smooth(w.y_dense, state), segment, p, w, a.numbers, needed, log.samples[k])
            for c in range(a.slopes.shape[1]):
                a.slopes[k, c] += 0.5 * sign * log.samples[k, c] / (SLOPE_STEP * step.h)
        sample_row(k, theta / made.part, a)
        for c in range(a.slopes.shape[1]):
            if a.timed[c] != 0:
                by_sensor(c, log.times[k], Evaluation(w.y_dense, w.sample.obs), p, w, a, a.rhs[0])
                add_product(1.0, a.rhs[0], a.samples[k, c])
        k += 1
    log.written[0] = k


def sample_row(k: int, theta: float, a: Tangents) -> None:
    """The tangents of sample `k` at a fraction of the part of a step that was made."""
    rest, weights = 1.0 - theta, interpolation(theta)
    for i in range(a.s.shape[0]):
        for j in range(a.s.shape[1]):
            bent = a.dense[0, i, j] + theta * a.dense[1, i, j]
            a.stage[i, j] = rest * a.s[i, j] + theta * (a.new[i, j] + rest * bent)
    show(k, weights, a.stage, a)


def show(k: int, weights: tuple[float, float, float], s: Matrix, a: Tangents) -> None:
    """The tangents of sample `k` where those of the states are `s`; `weights` are of the nodes."""
    n = s.shape[0]
    for c in range(a.slopes.shape[1]):
        row, at = a.samples[k, c], a.direct[c]
        if at >= 0:
            copy_into(row, s[at])
            continue
        for j in range(row.shape[0]):
            row[j] = 0.0
        for node in range(3):
            add_product(weights[node], a.by_unknown[node, n + c], row)
            for m in range(n):
                add_product(weights[node] * a.by_state[node, n + c, m], s[m], row)
            for m in range(a.r.shape[0]):
                add_product(weights[node] * a.by_state[node, n + c, n + m], a.r[m], row)


def sample_last(k: int, log: Log, a: Tangents) -> None:
    """Sample `k` at the end of the run, which is that of the last step."""
    n = a.s.shape[0]
    for c in range(a.slopes.shape[1]):
        log.samples[k, c], a.slopes[k, c] = a.shown[LAST, c], 0.0
        for i in range(n):
            a.slopes[k, c] += a.by_state[LAST, n + c, i] * a.dy[LAST, i]
    show(k, interpolation(1.0), a.s, a)
    for c in range(a.slopes.shape[1]):
        if a.timed[c] != 0:
            add_product(1.0, a.sensed[LAST, c], a.samples[k, c])
