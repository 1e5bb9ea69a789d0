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
from sma_sim.evidence.estimation.free_parameters import declared_parameters, free_parameter
from sma_sim.evidence.estimation.levenberg_marquardt import cost_at, minimize, with_early_stopping
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.run_subset import from_subset, run_subset, to_subset
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import ADDED_EFFECT, FROM_PRIORS, WEAKLY_DAMPED, StopCriteria
from sma_sim.evidence.model_selection.candidates import Candidate
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.evidence.model_selection.restricted import is_plausible_fit
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]


def with_candidate(base: FitResult, screened: ScreeningResult) -> tuple[Problem, Vector]:
    """The problem with one more effect, and where to start: the fit without it and what the screening found."""
    found = screened.candidate.found
    effect, problem = found.effect, base.problem
    neutral = tuple(p.default if p.neutral is None else float(p.neutral) for p in effect.parameters)
    config = replace(problem.config, effects=(*problem.config.effects, ActiveEffect(found, neutral)))
    declared = declared_parameters(config)
    new, start = [], []
    for p, value in zip(effect.parameters, neutral, strict=True):
        if p.name in screened.values:
            name = f'effects.{effect.name}.{p.name}'
            free = free_parameter(name, value, declared[name])
            new.append(free)
            start.append(float(np.clip(free.coordinate(screened.values[p.name]), free.low, free.high)))
    at = len(problem.free)
    return (
        replace(problem, config=config, free=(*problem.free, *new)),
        np.concatenate([base.z[:at], start, base.z[at:]]),
    )


def cannot_reach(target: float, max_iterations: int, costs: Sequence[float]) -> bool:
    """Whether a cost that falls as slowly as in the last of at most `max_iterations` cannot come down to `target`."""
    before, last = costs[-2:]
    return (before - last) * (max_iterations - len(costs) + 1) < last - target


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
    best = sorted(((fit, k) for k, fit in enumerate(rough) if fit is not None), key=lambda pair: pair[0].cost)[:most]
    jobs = []
    for fit, k in best:
        problem, z = with_candidate(base, candidates[k])
        jobs.append(partial(refit, problem, from_subset(problem, z, fit.z), context))
    for (_, k), refitted in zip(best, run_in_threads(jobs, context.stop), strict=True):
        found[k] = refitted
    return found


def best_refits(
    base: FitResult, candidates: Sequence[ScreeningResult], context: SearchContext, most: int | None = None
) -> list[FitResult | None]:
    """By candidate, as screened, the best of its refits: from the fit without the effect, and from the middle of all priors.

    A model that lacks an effect bends its other parameters far from their values; the way back is not always downhill. From
    the middle it goes down with strong damping and, where the best is near, with weak damping too, as either can end in a
    valley that the other passes by. Candidates that cannot come down to the best so far are given up. Of many runs only a
    subset is fitted at first; `most` candidates are then refitted to all.
    """
    subset = run_subset(base.problem)
    if len(subset.runs) < len(base.problem.runs):
        few = replace(base, problem=subset, z=to_subset(base.problem, base.z))
        return on_all_runs(base, candidates, best_refits(few, candidates, context), most, context)
    joint = [with_candidate(base, screened) for screened in candidates]
    middle = [(problem, at_prior_means(base, z)) for problem, z in joint]
    every, first = range(len(joint)), CRITERIA.first_refits
    best: list[FitResult | None] = [None] * len(joint)
    for starts, criteria, which in (
        (joint, ADDED_EFFECT, every[:first]), (joint, ADDED_EFFECT, every[first:]),
        (middle, FROM_PRIORS, every), (middle, WEAKLY_DAMPED, every),
    ):  # fmt: skip
        target = least_plausible_cost(best, candidates)
        chosen = [k for k in which if criteria is not WEAKLY_DAMPED or may_decide(best[k], target)]
        jobs = [partial(refit, *starts[k], context, criteria, target) for k in chosen]
        for k, found in zip(chosen, run_in_threads(jobs, context.stop), strict=True):
            best[k] = min((fit for fit in (best[k], found) if fit), key=lambda fit: fit.cost, default=None)
    return best


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


def quick_refits(
    base: FitResult, candidates: Sequence[ScreeningResult], reduction: float, context: SearchContext
) -> list[ScreeningResult]:
    """The candidates that take this fraction of the cost away (of a subset of many runs), best first, where they end."""
    few = replace(base, problem=run_subset(base.problem), z=to_subset(base.problem, base.z))
    target = (1.0 - reduction) * cost_at(few.problem, few.z, context.pool)
    jobs = [partial(refit, *with_candidate(few, start), context, ADDED_EFFECT, target) for start in candidates]
    fits = zip(candidates, run_in_threads(jobs, context.stop), strict=True)
    reached = [(start, fit) for start, fit in fits if fit is not None and fit.cost <= target]
    reached.sort(key=lambda pair: pair[1].cost)
    return [replace(start, values=fit.values_of(start.candidate.name)) for start, fit in reached]


def least_plausible_cost(fits: Sequence[FitResult | None], candidates: Sequence[ScreeningResult]) -> float:
    """Of the fits with plausible values; inf without any."""
    return min(
        (fit.cost for fit, screened in zip(fits, candidates, strict=True)
         if fit is not None and is_plausible_fit(fit, screened.candidate.found)), default=math.inf,
    )  # fmt: skip


def may_decide(fit: FitResult | None, target: float) -> bool:
    """Whether another minimisation may decide between a candidate and the best, or none explains what is there."""
    if fit is None or fit.cost <= CRITERIA.retry_cost_ratio * target:
        return True
    return target > 0.5 * CRITERIA.noise_only**2 * fit.problem.samples


def at_prior_means(base: FitResult, z: Vector) -> Vector:
    """All model parameters at the middle of their priors; the new effect and what belongs to runs as they are."""
    middle = z.copy()
    middle[: len(base.problem.free)] = 0.0
    return middle
