"""The adaptive, L-stable stepper: one Rosenbrock step, its error, its dense output."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.layout import System
from sma_sim.model.system import flow
from sma_sim.solver.linear import factorise, solve_factorised
from sma_sim.solver.rosenbrock import RODAS4P2

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Integers = NDArray[np.int64]

A, C, NODES, D, H = RODAS4P2.a, RODAS4P2.C, RODAS4P2.c, RODAS4P2.d, RODAS4P2.H
GAMMA, STAGES, ORDER = RODAS4P2.gamma, 6, RODAS4P2.order
TIME_STEP = 1e-7  # for the partial derivative of the flow in time [s]


class Work(NamedTuple):
    """Scratch memory of a run with n states."""

    jacobian: Matrix  # (n, n)
    matrix: Matrix  # (n, n)
    pivot: Integers  # (n,)
    f: Vector  # (n,) flow at the beginning of the step
    f_t: Vector  # (n,) its partial derivative in time
    f_stage: Vector
    y_stage: Vector
    u: Vector  # input at the time of a stage
    stages: Matrix  # (6, n)
    y_new: Vector
    y_dense: Vector
    k: Matrix  # (2, n) coefficients of the dense output
    increment: Vector  # (n,) difference steps of the Jacobian
    weight: Vector  # (n,) error scale of every state, times rtol
    obs: Matrix  # (wires, O_SIZE)
    obs_jacobian: Matrix


class Segment(NamedTuple):
    """A stretch of the input: u = u_0 + du (t - t_0), constant modes."""

    t_0: float
    u_0: Vector
    du: Vector
    moving: bool  # whether the flow depends on time explicitly


def input_at(t: float, segment: Segment, u: Vector) -> None:
    """The input at time t."""
    for j in range(u.shape[0]):
        u[j] = segment.u_0[j] + segment.du[j] * (t - segment.t_0)


def flow_at(
    t: float, y: Vector, segment: Segment, mode: Integers, x_frozen: Vector, p: System, w: Work, dy: Vector, obs: Matrix
) -> None:
    """The flow at time t under the input of the segment."""
    input_at(t, segment, w.u)
    flow(t, y, w.u, segment.du, mode, x_frozen, p, dy, obs)


def linearize(t: float, y: Vector, segment: Segment, mode: Integers, x_frozen: Vector, p: System, w: Work) -> None:
    """The flow, its Jacobian (forward differences) and its time derivative at (t, y)."""
    n = np.uint64(y.shape[0])  # unsigned, as in solver.linear
    flow_at(t, y, segment, mode, x_frozen, p, w, w.f, w.obs)
    for j in range(n):
        kept = y[j]
        y[j] = kept + w.increment[j]
        step = y[j] - kept
        flow(t, y, w.u, segment.du, mode, x_frozen, p, w.f_stage, w.obs_jacobian)
        y[j] = kept
        inverse = 1.0 / step
        for i in range(n):
            w.jacobian[i, j] = (w.f_stage[i] - w.f[i]) * inverse
    if segment.moving:
        flow_at(t + TIME_STEP, y, segment, mode, x_frozen, p, w, w.f_stage, w.obs_jacobian)
        for i in range(n):
            w.f_t[i] = (w.f_stage[i] - w.f[i]) / TIME_STEP


def rosenbrock_step(
    t: float, h: float, y: Vector, segment: Segment, mode: Integers, x_frozen: Vector, p: System, w: Work
) -> float:
    """Try a step of length h from the linearised state; the result is in ``w.y_new``.

    Returns the error in units of the tolerance (root mean square over the states), inf when the step failed.
    """
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
                w.stages[0, i] = w.f[i]
        else:
            stage_state(stage, y, w)
            flow_at(t + NODES[stage] * h, w.y_stage, segment, mode, x_frozen, p, w, w.f_stage, w.obs_jacobian)
            for i in range(n):
                w.stages[stage, i] = w.f_stage[i]
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
