"""Where the minimisations of a fit start, and by which weights of the data they come to the whole of them."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import feasible, minimize, start_point
from sma_sim.evidence.estimation.problem import START, Problem
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import StopCriteria

Vector = NDArray[np.float64]
SPREAD = 0.25  # of further starts, in standard deviations of the priors
TRIES = 20  # for a further start at which every run can be made
START_END = 0.9  # of the way to an end of the hysteresis
# Weights of the residuals with which data take over from priors. At first these hold what would hide a wrong valley of a
# single wire, a force's zero and drift and where its runs begin, so that its parameters go where the data lead them.
GRADUALLY = (0.001, 0.01, 0.1, 1.0)


@dataclass(frozen=True)
class StartingPoint:
    """A point z (n,) and the factors of the weights with which it is minimised, one after the other."""

    z: Vector
    weights: tuple[float, ...] = (1.0,)


def starting_points(
    problem: Problem, shown: Mapping[str, float], count: int, seed: int, pool: Executor
) -> list[StartingPoint]:
    """The middle of the priors; if more are asked for, what a single wire gives reason to try, then random points.

    The curves of its tests may have `shown` parameters elsewhere. Every run can be made at all points but the first.
    """
    middle = start_point(problem)
    points, random = [StartingPoint(middle)], np.random.default_rng(seed)
    if count == 1:
        return points
    given = [*point_of(problem, shown), *points_of_single_wire(problem)]
    further = (StartingPoint(SPREAD * random.normal(size=len(middle))) for _ in range(TRIES * (count - 1)))
    for guess in chain(given, further):
        if len(points) >= max(count, 1 + len(given)):
            break
        point = StartingPoint(start_point(problem, guess.z), guess.weights)
        if feasible(problem, point.z, pool):
            points.append(point)
    return points


def point_of(problem: Problem, shown: Mapping[str, float]) -> list[StartingPoint]:
    """The point at which parameters have the values that were `shown`; none where that is hardly beside the middle."""
    point = np.zeros(len(start_point(problem)))
    for k, free in enumerate(problem.free):
        if free.name in shown:
            point[k] = free.coordinate(shown[free.name])
    return [StartingPoint(point)] if np.any(np.abs(point) > SPREAD) else []


def points_of_single_wire(problem: Problem) -> list[StartingPoint]:
    """Priors that give way gradually, and runs that begin near either end of the hysteresis; none for several wires.

    A wire at a fixed strain has a valley for either, where the zeros and drifts of its force hide that its runs begin wrong.
    """
    if any(problem.wires(run) != 1 for run in problem.runs):
        return []
    begins = [unknown is START for unknown in problem.unknowns]
    ends = [StartingPoint(np.where(begins, START_END * end, 0.0)) for end in (START.low, START.high)]
    return [StartingPoint(np.zeros(len(begins)), GRADUALLY), *ends]


def minimized_from(
    point: StartingPoint, problem: Problem, criteria: StopCriteria, context: SearchContext, label: str
) -> FitResult:
    """The optimum to which a starting point leads; iterations of all its weights."""
    z, iterations = point.z, 0
    for factor in point.weights:
        fit = minimize(problem.weighted(factor), z, criteria, context, label)
        z, iterations = fit.z, iterations + fit.iterations
    return replace(fit, problem=problem, iterations=iterations)
