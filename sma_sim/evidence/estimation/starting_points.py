"""Where the minimisations of a fit start."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.levenberg_marquardt import feasible, start_point
from sma_sim.evidence.estimation.problem import Problem

Vector = NDArray[np.float64]
SPREAD = 0.25  # of further starts, in standard deviations of the priors
TRIES = 20  # for a further start at which every run can be made


def starting_points(problem: Problem, shown: Mapping[str, float], count: int, seed: int, pool: Executor) -> list[Vector]:
    """The middle of the priors, what the curves have `shown` if that is elsewhere, then random points around the middle.

    Every run can be made at the others.
    """
    points = [start_point(problem)]
    random = np.random.default_rng(seed)
    guesses = (SPREAD * random.normal(size=len(points[0])) for _ in range(TRIES * (count - 1)))
    for guess in chain(point_of(problem, shown), guesses):
        if len(points) == count:
            break
        point = start_point(problem, guess)
        if feasible(problem, point, pool):
            points.append(point)
    return points


def point_of(problem: Problem, shown: Mapping[str, float]) -> list[Vector]:
    """The point at which parameters have the values that were `shown`; none where that is hardly beside the middle."""
    point = np.zeros(len(start_point(problem)))
    for k, free in enumerate(problem.free):
        if free.name in shown:
            point[k] = free.coordinate(shown[free.name])
    return [point] if np.any(np.abs(point) > SPREAD) else []
