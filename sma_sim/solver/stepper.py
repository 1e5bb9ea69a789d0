"""The adaptive, L-stable stepper: one Rosenbrock step, its error, its dense output."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.layout import Evaluation, InputPoint, System, SystemState
from sma_sim.model.system import EVERYTHING, depends_on, update_flow
from sma_sim.solver.linear import factorise, solve_factorised
from sma_sim.solver.rosenbrock import RODAS4P2

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Integers = NDArray[np.int64]

A, C, NODES, D, H = RODAS4P2.a, RODAS4P2.C, RODAS4P2.c, RODAS4P2.d, RODAS4P2.H
GAMMA, STAGES, ORDER = RODAS4P2.gamma, 6, RODAS4P2.order
TIME_STEP = 1e-7  # for the partial derivative of the flow in time [s]


class Work(NamedTuple):
    """Scratch memory of a run with n states. Each purpose has an evaluation of its own, so that none loses another's."""

    jacobian: Matrix  # (n, n)
    matrix: Matrix  # (n, n)
    pivot: Integers  # (n,)
    first: Evaluation  # at the beginning of the step
    stage: Evaluation  # at a stage of the step, or beside its beginning for a difference
    guard: Evaluation  # where guards are evaluated
    sample: Evaluation  # where a sample is taken
    f_t: Vector  # (n,) partial derivative of the flow in time
    y_stage: Vector
    u: Vector  # input at the time of an evaluation
    stages: Matrix  # (6, n)
    y_new: Vector
    y_dense: Vector
    k: Matrix  # (2, n) coefficients of the dense output
    increment: Vector  # (n,) difference steps of the Jacobian
    weight: Vector  # (n,) error scale of every state, times rtol


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
    for j in range(n):
        changed = depends_on(j, state, p)
        if changed != EVERYTHING:
            copy_evaluation(w.first, w.stage)
        kept = y[j]
        y[j] = kept + w.increment[j]
        step = y[j] - kept
        update_flow(t, state, InputPoint(w.u, segment.du), p, w.stage, changed)
        y[j] = kept
        inverse = 1.0 / step
        for i in range(n):
            w.jacobian[i, j] = (f_stage[i] - f[i]) * inverse
    if segment.moving:
        flow_at(t + TIME_STEP, state, segment, p, w, w.stage)
        for i in range(n):
            w.f_t[i] = (f_stage[i] - f[i]) / TIME_STEP


def copy_evaluation(source: Evaluation, target: Evaluation) -> None:
    """Copy an evaluation of the flow into another."""
    copy_into(target.dy, source.dy)
    for i in range(np.uint64(source.obs.shape[0])):
        for k in range(np.uint64(source.obs.shape[1])):
            target.obs[i, k] = source.obs[i, k]


def copy_into(y: Vector, new: Vector) -> None:
    """Copy `new` into `y`."""
    for i in range(np.uint64(y.shape[0])):
        y[i] = new[i]


def rosenbrock_step(step: Step, state: SystemState, segment: Segment, p: System, w: Work) -> float:
    """Try a step from the linearized state; the result is in ``w.y_new``.

    Returns the error in units of the tolerance (root mean square over the states), inf when the step failed.
    """
    t, h, y = step.t, step.h, state.y
    n = np.uint64(y.shape[0])  # unsigned, as in solver.linear
    for i in range(n):
        for j in range(n):
            w.matrix[i, j] = -w.jacobian[i, j]
        w.matrix[i, i] += 1.0 / (h * GAMMA)
    if not factorise(w.matrix, w.pivot):
        return np.inf
    for stage in range(STAGES):
        if stage == 0:
            for i in range(n):
                w.stages[0, i] = w.first.dy[i]
        else:
            stage_state(stage, y, w)
            flow_at(t + NODES[stage] * h, with_smooth(w.y_stage, state), segment, p, w, w.stage)
            for i in range(n):
                w.stages[stage, i] = w.stage.dy[i]
            for i in range(n):
                total = 0.0
                for j in range(stage):
                    total += C[stage, j] * w.stages[j, i]
                w.stages[stage, i] += total / h
        if segment.moving:
            for i in range(n):
                w.stages[stage, i] += h * D[stage] * w.f_t[i]
        solve_factorised(w.matrix, w.pivot, w.stages[stage])
    return finish_step(w)


def stage_state(stage: int, y: Vector, w: Work) -> None:
    """The state at which a stage evaluates the flow, into ``w.y_stage``."""
    n = np.uint64(y.shape[0])  # unsigned, as in solver.linear
    if stage == STAGES - 1:
        for i in range(n):
            w.y_stage[i] += w.stages[stage - 1, i]
        return
    for i in range(n):
        total = y[i]
        for j in range(stage):
            total += A[stage, j] * w.stages[j, i]
        w.y_stage[i] = total


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


def prepare_dense(w: Work) -> None:
    """Coefficients of the dense output of the step just made."""
    for m in range(2):
        for i in range(np.uint64(w.k.shape[1])):
            total = 0.0
            for j in range(STAGES - 1):
                total += H[m, j] * w.stages[j, i]
            w.k[m, i] = total


def dense(theta: float, y: Vector, w: Work) -> None:
    """The state at fraction theta of the step, into ``w.y_dense``."""
    rest = 1.0 - theta
    for i in range(np.uint64(y.shape[0])):
        w.y_dense[i] = rest * y[i] + theta * (w.y_new[i] + rest * (w.k[0, i] + theta * w.k[1, i]))
