"""Searches on a subset of many runs: what is far from the optimum does not need them all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.model.arrays import Vector

MAX_SUBSET_RUNS = 8  # of a search; with more, the others join when its best is refined


def run_subset(problem: Problem) -> Problem:
    """The problem on at most MAX_SUBSET_RUNS of its runs, spread over all."""
    return replace(problem, runs=tuple(problem.runs[k] for k in chosen_runs(problem)))


def to_subset(problem: Problem, z: Vector) -> Vector:
    """The unknowns of the subset, from those of all runs."""
    shared, own = len(problem.shared), problem.indices()
    return np.concatenate([z[:shared], *(z[own[k][shared:]] for k in chosen_runs(problem))])


def on_all_runs(fit: FitResult, whole: Problem, z: Vector) -> Vector:
    """The unknowns of a problem with all runs, from a fit of the same parameters to some: of the other runs what they are in
    z (n,)."""
    shared, found = len(whole.shared), z.copy()
    found[:shared] = fit.z[:shared]
    known = {run.name: fit.z[at[shared:]] for run, at in zip(fit.problem.runs, fit.problem.indices(), strict=True)}
    for run, at in zip(whole.runs, whole.indices(), strict=True):
        found[at[shared:]] = known.get(run.name, found[at[shared:]])
    return found


def chosen_runs(problem: Problem) -> NDArray[np.int64]:
    """Which runs are in the subset."""
    count = len(problem.runs)
    return np.unique(np.round(np.linspace(0, count - 1, min(count, MAX_SUBSET_RUNS))).astype(np.int64))
