"""Sketches of refits: roughly where the fit with a candidate effect would end, for a twentieth of its cost.

All candidates share one linearisation of the model without them; the derivatives in a candidate's own parameters are added,
and the steps themselves correct the rest (`secant_minimum`). Only what a sketch leads near the best is refitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import inf

import numpy as np

from sma_sim.evidence.estimation.executors import run_in_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import secant_minimum
from sma_sim.evidence.estimation.problem import LinearizedRun, linearize, near, own_derivatives, places_among, residuals_at
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import ADDED_EFFECT, FROM_PRIORS, SKETCH_DECREASE
from sma_sim.evidence.model_selection.model_changes import with_candidate
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.solver.simulate import SimulationError

SKETCH_EXCESS = 16.0
"""Times the cost of its fit at which a sketch may end: of 119, 117 ended at 1.8 at most, two at 8 and 14."""


def at_prior_means(base: FitResult) -> FitResult:
    """All model parameters at the middle of their priors; what belongs to runs as it is."""
    middle = base.z.copy()
    middle[: len(base.problem.free)] = 0.0
    return replace(base, z=middle)


def sketched(
    base: FitResult,
    candidates: Sequence[ScreeningResult],
    context: SearchContext,
    target: float = inf,
    kept: int | None = None,
) -> list[FitResult | None]:
    """By candidate, the better of its sketches, from the fit without it and from the middle of all priors; None without any.

    A model that lacks an effect bends its other parameters far from their values; the way back is not always downhill.
    Sketches that fall too slowly to reach the cost `target` are given up, second ones also if they cannot come below the
    first one of their candidate, or of the candidates that lie lowest, of which so many are `kept`. Where a first one ends
    too high for a fit to reach the target (`may_reach`) there is no second one.
    """
    found = sketches_from(base, ADDED_EFFECT.damping, candidates, context, [target] * len(candidates))
    costs = [inf if fit is None else fit.cost for fit in found]
    least = sorted(costs)[:kept][-1:] if kept is not None else []
    again = [k for k, cost in enumerate(costs) if cost == inf or may_reach(cost, target)]
    targets = [min([target, costs[k], *least]) for k in again]
    some = [candidates[k] for k in again]
    second = sketches_from(at_prior_means(base), FROM_PRIORS.damping, some, context, targets) if some else []
    for k, fit in zip(again, second, strict=True):
        if fit is not None and fit.cost < costs[k]:
            found[k] = fit
    return found


def may_reach(sketch: float, target: float) -> bool:
    """Whether the fit of a model whose sketch ends at a cost may come down to a `target`."""
    return sketch <= SKETCH_EXCESS * target


def sketches_from(
    start: FitResult, damping: float, candidates: Sequence[ScreeningResult], context: SearchContext, targets: Sequence[float]
) -> list[FitResult | None]:
    """By candidate, its sketch from one point of the model without it; None where that cannot be run.

    One that falls too slowly to reach its target, a cost, is given up.
    """
    try:
        linear = linearize(start.problem, start.z, context.pool)
    except SimulationError:
        return [None] * len(candidates)
    pairs = zip(candidates, targets, strict=True)
    jobs = [partial(sketch, start, linear, (damping, target), one, context) for one, target in pairs]
    return run_in_threads(jobs, context.stop)


def sketch(
    start: FitResult,
    linear: Sequence[LinearizedRun],
    limits: tuple[float, float],
    screened: ScreeningResult,
    context: SearchContext,
) -> FitResult | None:
    """The sketch of one candidate; None where the model cannot be run at its start. `limits`: damping and target.

    What runs are more than those under smoothed commands is taken from the model without it: of 12 candidates this changes
    the cost by 3e-4 of it at the most, less than what ends a sketch.
    """
    problem, z = with_candidate(start, screened)
    first, shared = len(start.problem.free), len(start.problem.shared)
    own = range(first, len(problem.free))
    nearby = near(problem, [run.correction for run in linear])
    base = residuals_at(nearby, z, context.pool)
    derivatives = own_derivatives(nearby, z, own, base, context.pool)
    joint = []
    for j, (run, indices) in enumerate(zip(linear, problem.indices(), strict=True)):
        here, rows = base[j], derivatives[j]
        if here is None or rows is None:
            return None
        order = places_among(start.problem.own(start.problem.runs[j]), problem.own(problem.runs[j]))
        of_run = np.concatenate([run.jacobian[shared:], np.zeros((1, *here.shape))])[order]  # of new states nothing is known
        jacobian = np.concatenate([run.jacobian[:first], rows, run.jacobian[first:shared], of_run])
        joint.append(LinearizedRun(indices, here, jacobian, run.correction))
    least = SKETCH_DECREASE * min(start.cost, float(problem.samples))
    damping, target = limits
    return secant_minimum(problem, z, joint, (damping, least), context, target)
