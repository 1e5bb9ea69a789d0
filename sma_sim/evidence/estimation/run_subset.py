"""Searches on a subset of many runs: what is far from the optimum does not need them all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.problem import Problem
from sma_sim.model.arrays import Vector

MAX_SUBSET_RUNS = 8  # of a search; with more, the others join when its best is refined


def run_subset(problem: Problem) -> Problem:
    """The problem on at most MAX_SUBSET_RUNS of its runs, spread over all."""
    return replace(problem, runs=tuple(problem.runs[k] for k in chosen_runs(problem)))


def to_subset(problem: Problem, z: Vector) -> Vector:
    """The unknowns of the subset, from those of all runs."""
    return z[subset_indices(problem)]


def from_subset(problem: Problem, z: Vector, subset: Vector) -> Vector:
    """The unknowns of all runs: those of the subset, and of the other runs what they are in z."""
    found = z.copy()
    found[subset_indices(problem)] = subset
    return found


def chosen_runs(problem: Problem) -> NDArray[np.int64]:
    """Which runs are in the subset."""
    count = len(problem.runs)
    return np.unique(np.round(np.linspace(0, count - 1, min(count, MAX_SUBSET_RUNS))).astype(np.int64))


def subset_indices(problem: Problem) -> NDArray[np.int64]:
    """Indices of the subset's unknowns among all."""
    shared, own = len(problem.shared), problem.indices()
    return np.concatenate([np.arange(shared), *(own[k][shared:] for k in chosen_runs(problem))])
