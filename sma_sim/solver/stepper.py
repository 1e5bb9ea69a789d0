"""The adaptive, L-stable stepper: one Rosenbrock step, its error, its dense output."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.layout import Evaluation, InputPoint, System, SystemState
from sma_sim.model.system import EVERYTHING, depends_on, update_flow
from sma_sim.solver.linear import eliminate, invert_shifted, solve_eliminated, solve_shifted
from sma_sim.solver.rosenbrock import RODAS4P2, ROS34PW2
from sma_sim.solver.series import linearize_segments
from sma_sim.solver.work import Work, copy_evaluation, copy_into

A, C, NODES, D, H = RODAS4P2.a, RODAS4P2.C, RODAS4P2.c, RODAS4P2.d, RODAS4P2.H
GAMMA, STAGES, ORDER = RODAS4P2.gamma, 6, RODAS4P2.order
ROW_A, ROW_C, ROW_ERROR, ROW_GAMMA, ROW_STAGES = ROS34PW2.a, ROS34PW2.C, ROS34PW2.error, ROS34PW2.gamma, 4
OF_CUBIC = np.linalg.inv(H[:, :2])  # two stages that make a given dense output, the others being zero
TIME_STEP = 1e-7  # for the partial derivative of the flow in time [s]


class Segment(NamedTuple):
    """A stretch of the input from t_0 to t_end [s]: u = u_0 + du (t - t_0)."""

    t_0: float
    t_end: float
    u_0: Vector
    du: Vector
    moving: bool  # whether the flow depends on time explicitly


class Step(NamedTuple):
    """A step from time t, of length h [s]."""

    t: float
    h: float


def input_at(t: float, segment: Segment, u: Vector) -> None:
    """The input at time t."""
    for j in range(u.shape[0]):
        u[j] = segment.u_0[j] + segment.du[j] * (t - segment.t_0)


def with_smooth(y: Vector, state: SystemState) -> SystemState:
    """The state with `y` in place of its own smooth part."""
    return SystemState(y, state.mode, state.x_frozen)


def flow_at(t: float, state: SystemState, segment: Segment, p: System, w: Work, found: Evaluation) -> None:
    """Evaluate the flow at time t under the input of the segment."""
    input_at(t, segment, w.u)
    update_flow(t, state, InputPoint(w.u, segment.du), p, found, EVERYTHING)


def linearize_flow(t: float, state: SystemState, segment: Segment, p: System, w: Work, evaluated: bool) -> None:
    """The flow, its Jacobian (forward differences) and its time derivative at (t, y).

    `evaluated`: ``w.first`` is the flow there already. A column of the Jacobian evaluates what depends on its state.
    """
    y, f, f_stage = state.y, w.first.dy, w.stage.dy
    n = np.uint64(y.shape[0])  # unsigned, as in solver.linear
    if evaluated:
        input_at(t, segment, w.u)
    else:
        flow_at(t, state, segment, p, w, w.first)
    if w.elimination.order.shape[0] > 0:
        linearize_segments(state, InputPoint(w.u, segment.du), p, w)
    else:
        before = EVERYTHING
        for j in range(n):
            changed = depends_on(j, state, p)
            if changed != before:  # else the same is evaluated again, and nothing else was
                copy_evaluation(w.first, w.stage)
            before = changed
            kept = y[j]
            y[j] = kept + w.increment[j]
            step = y[j] - kept
            update_flow(t, state, InputPoint(w.u, segment.du), p, w.stage, changed)
            y[j] = kept
            inverse = 1.0 / step
            for i in range(n):
                w.jacobian[i, j] = (f_stage[i] - f[i]) * inverse
    differentiate_in_time(t, state, segment, p, w)


def differentiate_in_time(t: float, state: SystemState, segment: Segment, p: System, w: Work) -> None:
    """The time derivative of the flow ``w.first``, where it depends on time explicitly."""
    if segment.moving:
        flow_at(t + TIME_STEP, state, segment, p, w, w.stage)
        for i in range(np.uint64(w.f_t.shape[0])):
            w.f_t[i] = (w.stage.dy[i] - w.first.dy[i]) / TIME_STEP


def rosenbrock_step(step: Step, state: SystemState, segment: Segment, p: System, w: Work) -> float:
    """Try a step from the linearized state; the result is in ``w.y_new``.

    Returns the error in units of the tolerance (root mean square over the states), inf when the step failed.
    """
    t, h, y = step.t, step.h, state.y
    n = np.uint64(y.shape[0])  # unsigned, as in solver.linear
    if not prepare_solutions(1.0 / (h * GAMMA), p, w):
        return np.inf
    for stage in range(STAGES):
        if stage == 0:
            for i in range(n):
                w.rhs[i] = w.first.dy[i]
        else:
            stage_state(stage, y, w)
            flow_at(t + NODES[stage] * h, with_smooth(w.y_stage, state), segment, p, w, w.stage)
            for i in range(n):
                w.rhs[i] = w.stage.dy[i]
            for j in range(stage):
                part = C[stage, j] / h
                for i in range(n):
                    w.rhs[i] += part * w.stages[j, i]
        if segment.moving:
            for i in range(n):
                w.rhs[i] += h * D[stage] * w.f_t[i]
        if w.elimination.order.shape[0] > 0:
            solve_eliminated(w.matrix, w.elimination, w.rhs)
            copy_into(w.stages[stage], w.rhs)
        else:
            solve_shifted(w.matrix, w.rhs, w.stages[stage], p.coordinates)
    return finish_step(w)


def prepare_solutions(shift: float, p: System, w: Work) -> bool:
    """Leave in ``w.matrix`` what solves equations with shift I - J; False when that is singular or not finite."""
    if w.elimination.order.shape[0] > 0:
        return eliminate(w.jacobian, shift, w.matrix, w.elimination)
    return invert_shifted(w.jacobian, shift, p.coordinates, w.matrix, w.pivot)


def stage_state(stage: int, y: Vector, w: Work) -> None:
    """The state at which a stage evaluates the flow, into ``w.y_stage``."""
    n = np.uint64(y.shape[0])  # unsigned, as in solver.linear
    if stage == STAGES - 1:
        for i in range(n):
            w.y_stage[i] += w.stages[stage - 1, i]
        return
    copy_into(w.y_stage, y)
    for j in range(stage):
        for i in range(n):
            w.y_stage[i] += A[stage, j] * w.stages[j, i]


def finish_step(w: Work) -> float:
    """The new state from the last stage, and the error norm."""
    n = np.uint64(w.y_new.shape[0])
    total = 0.0
    for i in range(n):
        error = w.stages[STAGES - 1, i]
        w.y_new[i] = w.y_stage[i] + error
        ratio = error / w.weight[i]
        total += ratio * ratio
    norm = np.sqrt(total / n)
    return norm if np.isfinite(norm) else np.inf


def row_step(h: float, state: SystemState, segment: Segment, p: System, w: Work, solution: Matrix) -> float:
    """Try one step over a row of a held input from ``w.first``, with what `invert_shifted` left in `solution` lately.

    The method is of order 3 whatever that is; the result is in ``w.y_new``, and the error is returned as by
    `rosenbrock_step`.
    """
    n = np.uint64(state.y.shape[0])  # unsigned, as in solver.linear
    for stage in range(ROW_STAGES):
        if stage == 0:
            for i in range(n):
                w.rhs[i] = w.first.dy[i]
        else:
            copy_into(w.y_stage, state.y)
            for j in range(stage):
                for i in range(n):
                    w.y_stage[i] += ROW_A[stage, j] * w.stages[j, i]
            flow_at(segment.t_0, with_smooth(w.y_stage, state), segment, p, w, w.stage)
            for i in range(n):
                w.rhs[i] = w.stage.dy[i]
            for j in range(stage):
                part = ROW_C[stage, j] / h
                for i in range(n):
                    w.rhs[i] += part * w.stages[j, i]
        solve_shifted(solution, w.rhs, w.stages[stage], p.coordinates)
    total = 0.0
    for i in range(n):
        w.y_new[i] = w.y_stage[i] + w.stages[ROW_STAGES - 1, i]
        error = 0.0
        for j in range(ROW_STAGES):
            error += ROW_ERROR[j] * w.stages[j, i]
        total += (error / w.weight[i]) ** 2
    norm = np.sqrt(total / n)
    return norm if np.isfinite(norm) else np.inf


def pass_cubic(h: float, y: Vector, p: System, w: Work) -> None:
    """Let `prepare_dense` give the cubic of a step from ``w.first`` to ``w.y_new`` with the rates there, in ``w.guard``.

    Rates of coordinates are the derivatives of theirs: where a rate adjusts within microseconds, as friction lets it after a
    row, accelerations say nothing of what follows.
    """
    n = p.coordinates
    for i in range(np.uint64(y.shape[0])):
        rise = w.y_new[i] - y[i]
        k_1 = h * w.first.dy[i] - rise
        k_2 = rise - h * w.guard.dy[i] - k_1
        if n <= i < 2 * n:
            k_1, k_2 = 6.0 * (w.y_new[i - n] - y[i - n]) / h - 3.0 * (y[i] + w.y_new[i]), 0.0
        w.stages[0, i] = OF_CUBIC[0, 0] * k_1 + OF_CUBIC[0, 1] * k_2
        w.stages[1, i] = OF_CUBIC[1, 0] * k_1 + OF_CUBIC[1, 1] * k_2
        for j in range(2, STAGES - 1):
            w.stages[j, i] = 0.0


def prepare_dense(w: Work) -> None:
    """Coefficients of the dense output of the step just made."""
    for m in range(2):
        n = np.uint64(w.k.shape[1])
        for i in range(n):
            w.k[m, i] = 0.0
        for j in range(STAGES - 1):
            for i in range(n):
                w.k[m, i] += H[m, j] * w.stages[j, i]


def dense(theta: float, y: Vector, w: Work) -> None:
    """The state at fraction theta of the step, into ``w.y_dense``."""
    rest = 1.0 - theta
    for i in range(np.uint64(y.shape[0])):
        w.y_dense[i] = rest * y[i] + theta * (w.y_new[i] + rest * (w.k[0, i] + theta * w.k[1, i]))
