"""Refits: a candidate effect fitted together with the model's own parameters, from what the screening found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.executors import run_in_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import cost_at, minimize, with_early_stopping
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.run_subset import from_subset, run_subset, to_subset
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import ADDED_EFFECT, FROM_PRIORS, WEAKLY_DAMPED, StopCriteria
from sma_sim.evidence.model_selection.candidates import Candidate
from sma_sim.evidence.model_selection.criteria import CRITERIA, unexplained_above
from sma_sim.evidence.model_selection.restricted import is_plausible_fit
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.model_selection.sketches import at_defaults, at_prior_means, sketched, with_candidate
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]


def cannot_reach(target: float, max_iterations: int, costs: Sequence[float]) -> bool:
    """Whether a cost that falls as slowly as in the last of at most `max_iterations` cannot come down to `target`."""
    before, last = costs[-2:]
    return (before - last) * (max_iterations - len(costs) + 1) < last - target


def cost_with(error: float, problem: Problem, z: Vector) -> float:
    """The cost of a fit that leaves this error over noise, with the prior of one at z."""
    return 0.5 * (problem.samples * error**2 + problem.tempering**2 * float(z @ z))


def refit(
    problem: Problem, z: Vector, context: SearchContext, criteria: StopCriteria = ADDED_EFFECT, target: float = math.inf
) -> FitResult | None:
    """The optimum near z, or where the cost fell too slowly to reach `target`; None where the model cannot be run there."""
    lost = partial(cannot_reach, target, criteria.max_iterations)
    try:
        return minimize(problem, z, criteria, with_early_stopping(context, lost))
    except SimulationError:
        return None


def on_all_runs(
    base: FitResult, candidates: Sequence[ScreeningResult], rough: Sequence[FitResult | None], most: int | None,
    context: SearchContext,
) -> list[FitResult | None]:  # fmt: skip
    """The `most` best fits to a subset of the runs continued on all of them, None for the others."""
    found: list[FitResult | None] = [None] * len(candidates)
    best = sorted_by_cost(rough)[:most]
    jobs = []
    for k, fit in best:
        problem, z = with_candidate(base, candidates[k])
        jobs.append(partial(refit, problem, from_subset(problem, z, fit.z), context))
    for (k, _), refitted in zip(best, run_in_threads(jobs, context.stop), strict=True):
        found[k] = refitted
    return found


def best_refits(
    base: FitResult, candidates: Sequence[ScreeningResult], context: SearchContext, most: int | None = None,
    below: float = math.inf,
) -> list[FitResult | None]:  # fmt: skip
    """By candidate, its refit; None for those whose sketches lie too far behind the best, or not `below` a part of the cost.

    The best by their sketches are refitted from where those end, and given up if they cannot come down to the best so far.
    As long as none leaves only noise, those near the best are also refitted from the middle of all priors with weak damping,
    unless the base leaves so little that its parameters cannot be far off; of one wire, whose runs cost little, all sketches
    near it are, with the effects at their defaults. Of many runs only a subset is fitted at first; `most` candidates are
    then refitted to all.
    """
    subset = run_subset(base.problem)
    if len(subset.runs) < len(base.problem.runs):
        few = replace(base, problem=subset, z=to_subset(base.problem, base.z))
        return on_all_runs(base, candidates, best_refits(few, candidates, context, below=below), most, context)
    limit = below * cost_at(base.problem, base.z, context.pool)
    sketches = best_sketches(base, candidates, limit, context)
    ahead = [(k, fit) for k, fit in sorted_by_cost(sketches) if fit.cost <= limit][: CRITERIA.refitted_candidates]
    led = dict(ahead)
    first = CRITERIA.first_refits
    middle = [with_candidate(at_prior_means(base), screened) for screened in candidates]
    best: list[FitResult | None] = [None] * len(candidates)
    cheap = base.problem.config.structure.structure.wires == 1
    astray = base.is_bent or base.error > unexplained_above(base.problem.span)
    retried = ahead[: CRITERIA.retried_refits] if astray else []
    again, near = (FROM_PRIORS, list(enumerate(sketches))) if cheap else (WEAKLY_DAMPED, retried)
    for criteria, which in ((ADDED_EFFECT, ahead[:first]), (ADDED_EFFECT, ahead[first:]), (again, near)):
        target = least_plausible_cost(best, candidates)
        once_more, reached = criteria is again, min(target, least_plausible_cost(sketches, candidates))
        chosen = [
            k for k, sketch in which
            if sketch is not None and (may_decide(best[k] or sketch, target) if once_more else is_near(sketch, reached))
        ]  # fmt: skip
        starts = [middle[k] if once_more else (led[k].problem, led[k].z) for k in chosen]
        # a fit from far away may fall slowly for a while before it falls below all others
        jobs = [
            partial(refit, problem, at_defaults(problem), context, criteria) if criteria is FROM_PRIORS
            else partial(refit, problem, z, context, criteria, target)
            for problem, z in starts
        ]  # fmt: skip
        for k, found in zip(chosen, run_in_threads(jobs, context.stop), strict=True):
            best[k] = min((fit for fit in (best[k], found) if fit), key=lambda fit: fit.cost, default=None)
    return best


def best_sketches(
    base: FitResult, candidates: Sequence[ScreeningResult], limit: float, context: SearchContext
) -> list[FitResult | None]:  # fmt: skip
    """By candidate, its best sketch. The first ones tell which cost the others must come down to for a refit."""
    first = CRITERIA.first_refits
    ahead = [fits[0] if fits else None for fits in sketched(base, candidates[:first], context, limit)]
    if len(candidates) <= first:
        return ahead
    target = min(limit, CRITERIA.retry_cost_ratio * least_plausible_cost(ahead, candidates[:first]))
    return ahead + [fits[0] if fits else None for fits in sketched(base, candidates[first:], context, target)]


def sorted_by_cost(fits: Sequence[FitResult | None]) -> list[tuple[int, FitResult]]:
    """The fits that were made with their places, the best first."""
    return sorted(((k, fit) for k, fit in enumerate(fits) if fit is not None), key=lambda pair: pair[1].cost)


def at_finite_step(candidate: Candidate, screened: ScreeningResult | None) -> ScreeningResult:
    """A candidate with its strengths at least a probe's step from neutral, on the side that the screening found, if any."""
    family = candidate.families[len(candidate.families) // 2]
    values = dict(family[0].shape) | (dict(screened.values) if screened else {})
    for probe in family:
        away = values.get(probe.parameter, probe.neutral) - probe.neutral
        if away == 0.0 or (away * probe.step > 0.0 and abs(away) < abs(probe.step)):
            values[probe.parameter] = probe.neutral + probe.step
    family_p = screened.family_p if screened else 1.0
    return ScreeningResult(candidate, screened.gain if screened else 0.0, values, family_p)


def least_plausible_cost(fits: Sequence[FitResult | None], candidates: Sequence[ScreeningResult]) -> float:
    """Of the fits with plausible values; inf without any."""
    return min(
        (fit.cost for fit, screened in zip(fits, candidates, strict=True)
         if fit is not None and is_plausible_fit(fit, screened.candidate.found)), default=math.inf,
    )  # fmt: skip


def may_decide(fit: FitResult | None, target: float) -> bool:
    """Whether another minimisation may decide between a candidate and the best, which does not explain all."""
    explained = fit is not None and target <= 0.5 * CRITERIA.other_kinetics_above**2 * fit.problem.samples
    return fit is not None and not explained and is_near(fit, target)


def is_near(fit: FitResult, target: float) -> bool:
    """Whether a fit is not too far behind for another to decide."""
    return fit.cost <= CRITERIA.retry_cost_ratio * target
