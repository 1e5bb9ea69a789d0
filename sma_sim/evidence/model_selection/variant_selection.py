"""Variants beside the effects: does a listed effect in another form explain more than the effects, or as much with fewer?

The effects are tried first. Where one of them leaves only noise, it is taken: no variant can predict better by more than its
freedom. Else the variants are screened on the model without any of them, the best are refitted and cross-validated, and the
search goes on from the best one. What it ends with replaces the effects if it has fewer of them and predicts as well, or as
many and predicts better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.executors import run_in_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import ADDED_EFFECT, FROM_PRIORS
from sma_sim.evidence.model_selection.candidate_fit import CandidateFit, SelectionStep, best_acceptable, ordered_by_error
from sma_sim.evidence.model_selection.candidates import candidates_for
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.evidence.model_selection.forward_selection import judged_fits, select_forward
from sma_sim.evidence.model_selection.kinetics_choice import is_as_good
from sma_sim.evidence.model_selection.refit import refit
from sma_sim.evidence.model_selection.score_tests import ScreeningResult, screen
from sma_sim.evidence.model_selection.sketches import at_prior_means, with_candidate
from sma_sim.evidence.model_selection.variants import variants_of

Steps = tuple[SelectionStep, ...]
Vector = NDArray[np.float64]


def select_with_variants(nominal: FitResult, context: SearchContext) -> Steps:
    """The steps of the search among the effects; or among their variants too, where these explain better or more simply."""
    steps = select_forward(nominal, context)
    if nominal.problem.config.system != 'module' or not asks_for_variants(nominal, steps) or context.stop.is_set():
        return steps
    first = variant_step(steps, context)
    best = first.accepted
    if best is None or not best.found.effect.scope.name or not may_replace(best, nominal, steps):
        return steps
    errors = f'{best.fit.error:.2f} fitted, {best.fit.prediction_error:.2f} on runs left out'
    context.on_progress(f'accepted {best.name}: error over noise {errors}')
    others: Steps = (SelectionStep(best.fit, (), (), None),)
    if leaves_something(best.fit):
        others = select_forward(best.fit, context)[: CRITERIA.max_effects - 1]
    path = (replace(first, after=best.fit), *others)
    return path if not context.stop.is_set() and replaces(path, steps, nominal) else steps


def asks_for_variants(nominal: FitResult, steps: Steps) -> bool:
    """Whether the effects leave more than noise, or several of them were needed."""
    last = last_fit(nominal, steps)
    if not steps or steps[-1].stopped or nominal.error <= CRITERIA.noise_only:
        return False
    return number_of_effects(nominal, last) > 1 or leaves_something(last)


def leaves_something(fit: FitResult) -> bool:
    """Whether a model leaves anything that another could be seen to explain better."""
    return fit.error > CRITERIA.other_kinetics_above or fit.prediction_error > CRITERIA.variants_above


def variant_step(steps: Steps, context: SearchContext) -> SelectionStep:
    """The first step among the effects and the variants that the score test prefers to their effects."""
    first = steps[0]
    base, problem = first.base, first.base.problem
    channels = {name for run in problem.runs for name in run.channels}
    variants = variants_of(candidates_for(problem.config, context.folders), channels)
    context.on_progress(f'screening {len(variants)} variants of effects')
    screened = screen(problem, base.z, variants, context.pool, context.seed)
    chosen = promising_variants(screened, first.screened)
    if not chosen or context.stop.is_set():
        return replace(first, accepted=None)
    fits = [*first.candidate_fits, *variant_fits(steps, chosen, context)]
    ordered = ordered_by_error(fits)
    return SelectionStep(
        base, (*first.screened, *screened), ordered, best_acceptable(ordered), stopped=context.stop.is_set()
    )


def promising_variants(variants: Sequence[ScreeningResult], effects: Sequence[ScreeningResult]) -> list[ScreeningResult]:
    """The variants to refit: the best, of those that gain more than their effects do."""
    of_effect = {result.candidate.name: result.gain for result in effects}
    better = [one for one in variants if one.gain > of_effect.get(one.candidate.found.effect.plain_name, 0.0)]
    least = CRITERIA.min_relative_gain * max((result.gain for result in (*variants, *effects)), default=0.0)
    return [result for result in better if result.gain >= least][: CRITERIA.refitted_variants]


def variant_fits(steps: Steps, chosen: Sequence[ScreeningResult], context: SearchContext) -> list[CandidateFit]:
    """Variants refitted, those of them cross-validated that fit better than one effect alone."""
    base = steps[0].base
    context.on_progress(f'refitting with {", ".join(result.candidate.name for result in chosen)}')
    limit = min((candidate.fit.error for candidate in steps[0].candidate_fits if candidate.plausible), default=base.error)
    refits = refitted_variants(steps, chosen, context)
    pairs = [(one, fit) for one, fit in zip(chosen, refits, strict=True) if fit is not None and fit.error <= limit]
    return judged_fits(base, pairs, CRITERIA.cross_validated_variants, context)


def refitted_variants(steps: Steps, chosen: Sequence[ScreeningResult], context: SearchContext) -> list[FitResult | None]:
    """The best fit of each variant: from the model without it, and from where the model is with the effects instead.

    These bend it less than what it lacks without any; where they leave much, from the middle of all priors.
    """
    base, last = steps[0].base, last_fit(steps[0].base, steps)
    starts = [with_candidate(base, result) for result in chosen]
    target = min((candidate.fit.cost for candidate in steps[0].candidate_fits if candidate.plausible), default=np.inf)
    helped = last.error <= CRITERIA.unexplained and last.problem.config.model == base.problem.config.model
    jobs = []
    for k, (problem, z) in enumerate(starts):
        other = with_parameters_of(last, base, z) if helped else with_candidate(at_prior_means(base), chosen[k])[1]
        jobs.append(partial(refit, problem, z, context, ADDED_EFFECT, target))
        jobs.append(partial(refit, problem, other, context, ADDED_EFFECT if helped else FROM_PRIORS, target))
    found = run_in_threads(jobs, context.stop)
    pairs = [[fit for fit in found[k : k + 2] if fit is not None] for k in range(0, len(found), 2)]
    return [min(fits, key=lambda fit: fit.cost, default=None) for fits in pairs]


def with_parameters_of(last: FitResult, base: FitResult, z: Vector) -> Vector:
    """A start with the parameters and starts of another model of the same runs; what it does not have stays as it is."""
    start, count = z.copy(), len(base.problem.free)
    values = dict(zip([p.name for p in last.problem.free], last.z, strict=False))
    start[:count] = [values.get(p.name, x) for p, x in zip(base.problem.free, z, strict=False)]
    own = len(base.z) - count
    start[len(z) - own :] = last.z[len(last.z) - own :]
    return start


def last_fit(nominal: FitResult, steps: Steps) -> FitResult:
    """The model to which some steps lead."""
    return next((step.after for step in reversed(steps) if step.after is not None), nominal)


def number_of_effects(nominal: FitResult, last: FitResult) -> int:
    """How many were added."""
    return len(last.effects) - len(nominal.effects)


def may_replace(best: CandidateFit, nominal: FitResult, steps: Steps) -> bool:
    """Whether a variant alone is a better beginning than the first effect, or as good as all effects together."""
    first = next((step.after for step in steps if step.after is not None), nominal)
    last = last_fit(nominal, steps)
    as_good = number_of_effects(nominal, last) > 1 and is_as_good(best.fit, last)
    return as_good or predicts_better(best.fit, first, CRITERIA.same_error)


def replaces(path: Steps, steps: Steps, nominal: FitResult) -> bool:
    """Whether steps with a variant end better than those without: fewer effects predict as well, or as many better."""
    new, old = last_fit(nominal, path), last_fit(nominal, steps)
    more = number_of_effects(nominal, new) - number_of_effects(nominal, old)
    if more < 0:
        return is_as_good(new, old)
    return predicts_better(new, old, CRITERIA.same_error if more == 0 else CRITERIA.min_error_reduction)


def predicts_better(fit: FitResult, other: FitResult, margin: float) -> bool:
    """Whether a model predicts better by a margin, and fits no worse."""
    return fit.prediction_error < (1.0 - margin) * other.prediction_error and fit.error <= other.error
