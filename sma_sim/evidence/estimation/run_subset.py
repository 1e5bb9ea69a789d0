"""Searches on a part of many runs: what is far from the optimum does not need them all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.problem import Problem

Vector = NDArray[np.float64]
MOST = 8  # runs of a search; with more, the rest joins when its best is refined


def part_of(problem: Problem) -> Problem:
    """The problem on at most MOST of its runs, spread over all."""
    return replace(problem, runs=tuple(problem.runs[k] for k in kept(problem)))


def of_part(problem: Problem, z: Vector) -> Vector:
    """The unknowns of the part, from those of all runs."""
    return z[places(problem)]


def of_all(problem: Problem, z: Vector, part: Vector) -> Vector:
    """The unknowns of all runs: those of the part, and of the other runs what they are in z."""
    found = z.copy()
    found[places(problem)] = part
    return found


def kept(problem: Problem) -> NDArray[np.int64]:
    """Which runs are in the part."""
    count = len(problem.runs)
    return np.unique(np.round(np.linspace(0, count - 1, min(count, MOST))).astype(np.int64))


def places(problem: Problem) -> NDArray[np.int64]:
    """Where the unknowns of the part are among all."""
    shared, own = len(problem.shared), problem.places()
    return np.concatenate([np.arange(shared), *(own[k][shared:] for k in kept(problem))])
