"""Scratch memory of a run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sma_sim.model.arrays import Integers, Matrix, Vector
from sma_sim.model.layout import Evaluation
from sma_sim.solver.linear import Elimination


class Work(NamedTuple):
    """Scratch memory of a run with n states. Each purpose has an evaluation of its own, so that none loses another's."""

    jacobian: Matrix  # (n, n)
    matrix: Matrix  # (n, n)
    pivot: Integers  # (n,)
    elimination: Elimination  # of sparse equations; empty for dense ones
    first: Evaluation  # at the beginning of the step
    stage: Evaluation  # at a stage of the step, or beside its beginning for a difference
    guard: Evaluation  # where guards are evaluated
    sample: Evaluation  # where a sample is taken
    f_t: Vector  # (n,) partial derivative of the flow in time
    y_stage: Vector
    rhs: Vector  # (n,) of the equations of a stage
    u: Vector  # input at the time of an evaluation
    stages: Matrix  # (6, n)
    y_new: Vector
    y_dense: Vector
    k: Matrix  # (2, n) coefficients of the dense output
    increment: Vector  # (n,) difference steps of the Jacobian
    weight: Vector  # (n,) error scale of every state, times rtol


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
