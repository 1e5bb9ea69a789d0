"""Recordings that begin in motion, out of the valleys in which single ones of them lie.

How warm its wires are when a recording begins, how much of them is martensite and where the pose is on its way make up for
each other, in several valleys of each recording. A fit of all together, which begins with all of them alike, leaves some in
a wrong one, and parameters bend to it. Under the parameters of a fit each recording is therefore fitted alone from other
beginnings; those that cost it least are tried with all, one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from sma_sim.evidence.estimation.executors import run_in_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import refit
from sma_sim.evidence.estimation.problem import START, start_point
from sma_sim.evidence.estimation.search_context import SearchContext, silent_iteration
from sma_sim.evidence.estimation.stop_criteria import WEAKLY_DAMPED
from sma_sim.model.arrays import Vector

NEAR_END = 0.9  # of the way to an end of the hysteresis, where wires begin
APART = 0.1  # of a coordinate, by which two beginnings differ at least
ROUNDS, TRIED = 4, 6  # rounds of all recordings; beginnings that are tried with all, in each
WORTH, WORTH_A_ROUND = 0.5, 2.0  # [nats] by which the cost falls, of a beginning that is taken and before another round
ALONE = replace(WEAKLY_DAMPED, max_iterations=12, relative_decrease=0.0)
TOGETHER = replace(WEAKLY_DAMPED, min_decrease=0.1, relative_decrease=0.0)


@dataclass(frozen=True)
class OtherBeginning:
    """Unknowns z (m,) of a recording alone, the number of this, and by how much they cost it more than those of the fit."""

    more: float
    run: int
    z: Vector


def with_better_beginnings(fit: FitResult, context: SearchContext, label: str) -> FitResult:
    """A fit whose recordings begin otherwise, where that lowers its cost; the fit itself where none begins in motion."""
    moving = [k for k, run in enumerate(fit.problem.runs) if run.is_in_motion]
    named = replace(context, on_iteration=lambda _, iteration, cost: context.on_iteration(label, iteration, cost))
    for _ in range(ROUNDS if moving else 0):
        began = fit
        jobs = [partial(other_beginnings, fit, k, context) for k in moving]
        found = sorted((one for own in run_in_threads(jobs, context.stop) for one in own), key=lambda one: one.more)
        for one in found[:TRIED]:
            if context.stop.is_set():
                return fit
            z, at = fit.z.copy(), fit.problem.indices()[one.run]
            z[at[len(fit.problem.shared) :]] = one.z
            other = refit(fit.problem, z, named, TOGETHER)
            if other is not None and other.cost < fit.cost - WORTH:
                fit = replace(other, iterations=fit.iterations + other.iterations, other_starts=fit.other_starts)
        if fit.cost > began.cost - WORTH_A_ROUND:
            break
    return fit


def other_beginnings(fit: FitResult, number: int, context: SearchContext) -> list[OtherBeginning]:
    """The optima of one recording under the parameters of a fit to which its wires lead from the ends of the hysteresis."""
    problem, quiet = fit.problem, replace(context, on_iteration=silent_iteration)
    run, at = problem.runs[number], problem.indices()[number]
    alone = replace(problem, config=fit.config, runs=(run,), free=(), delay=fit.delay)
    own = fit.z[at[len(problem.shared) :]]
    here = refit(alone, own, quiet, ALONE)
    found = list[FitResult]()
    for base, ends in product((own, start_point(alone)), product((START.low, START.high), repeat=run.starts)):
        z = base.copy()
        z[: run.starts] = NEAR_END * np.array(ends)
        other = refit(alone, z, quiet, ALONE)
        if here is not None and other is not None and is_apart(other, [here, *found]):
            found.append(other)
    return [OtherBeginning(other.cost - here.cost, number, other.z) for other in found if here is not None]


def is_apart(fit: FitResult, others: Sequence[FitResult]) -> bool:
    """Whether a fit ended elsewhere than all others."""
    return all(float(np.abs(fit.z - other.z).max()) > APART for other in others)
