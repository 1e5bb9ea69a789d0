"""Forward selection of missing effects: screen, refit, cross-validate, accept the best, go on.

What later effects say of earlier ones is asked in the end (`backward_elimination`). The held-out runs are not read here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from sma_sim.evidence.estimation.cross_validation import cross_validated
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import cost_at
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.candidate_fit import (
    CandidateFit,
    SelectionStep,
    best_acceptable,
    candidate_fit,
    ordered_by_error,
)
from sma_sim.evidence.model_selection.candidates import Candidate, candidates_for
from sma_sim.evidence.model_selection.criteria import CRITERIA, fits_all, unexplained_above
from sma_sim.evidence.model_selection.differing_recordings import differing_fit
from sma_sim.evidence.model_selection.kinetics_choice import better_kinetics, is_as_good
from sma_sim.evidence.model_selection.nominal_fit import report_model
from sma_sim.evidence.model_selection.refit import at_finite_step, best_refits, cost_with, refit
from sma_sim.evidence.model_selection.restricted import is_plausible_fit, within_realistic_range, without_effect
from sma_sim.evidence.model_selection.score_tests import ScreeningResult, screen
from sma_sim.evidence.model_selection.tempered_likelihood import tempered
from sma_sim.evidence.model_selection.variants import variants_of
from sma_sim.model.effects.discovery import FoundEffect


def select_forward(
    nominal: FitResult, context: SearchContext, unlisted_explains: Callable[[FitResult], bool] | None = None,
    over_floor: bool = False,
) -> tuple[SelectionStep, ...]:  # fmt: skip
    """Steps until nothing more is gained; the last one accepts nothing (unless stopped or full).

    `unlisted_explains`: whether a law that is not listed explains alone, beside a base, all that effects do not. It is asked
    before effects are put together (`points_beyond_library`); then no effect is accepted, nor is a further one that adds
    little where such laws are sought. `over_floor`: whether errors are over what repeats differ by, which is not sharp as
    noise is: less than that asks for no effect at all, and nothing speaks for values that are not realistic.
    """
    base, steps = nominal, list[SelectionStep]()
    if over_floor and base.error <= 1.0 and not base.is_bent:
        return (SelectionStep(base, (), (), None),)
    while not context.stop.is_set() and len(steps) < CRITERIA.max_effects:
        step = selection_step(base, context)
        if unlisted_explains and steps and adds_little(step):
            step = replace(step, accepted=None)
        steps[-1:] = [replace(last, after=step.base) for last in steps[-1:]]
        first = [*steps, step][0]
        if unlisted_explains and points_beyond_library(step, len(steps)) and unlisted_explains(first.base):
            steps = [replace(first, accepted=None, after=None)]
            break
        full = len(steps) + 2 > CRITERIA.max_effects
        steps += [step] if step.accepted is not None or full else pair_steps(step, context)
        accepted = steps[-1].accepted
        if accepted is None:
            break
        base = tempered_again(accepted.fit, context)
        errors = f'{base.error:.2f} fitted, {base.prediction_error:.2f} on runs left out'
        context.on_progress(f'accepted {accepted.name}: error over noise {errors}')
        report_model('accepted', base, context)
        steps[-1] = replace(steps[-1], after=base)
        if not (leaves_something(base) or base.is_bent):
            steps.append(SelectionStep(base, (), (), None))
            break
    found = with_another_lead(steps, base, context, unlisted_explains)
    return found if over_floor else with_unrealistic_values(found, context)


def adds_little(step: SelectionStep) -> bool:
    """Whether a further effect takes away little of the little that is left, and leaves more than noise: it may imitate what
    is not listed, which is sought beside the others then."""  # fmt: skip
    if step.accepted is None:
        return False
    before, after = step.base.error, step.accepted.fit.error
    return before <= CRITERIA.unexplained and after > max(CRITERIA.noise_only, (1.0 - CRITERIA.min_named_reduction) * before)


def points_beyond_library(step: SelectionStep, accepted_before: int) -> bool:
    """Whether a step leaves so much, for all that listed effects do, that a law which is not listed may explain it alone.

    It leaves what no model of the system may leave, and is no longer the first one, or accepts nothing, or lies too far
    behind an effect with unrealistic values to decide: that one imitates.
    """
    last = step.base if step.accepted is None else step.accepted.fit
    if step.stopped or last.error <= unexplained_above(step.base.problem.span):
        return False
    imitating = min((one.fit.cost for one in step.candidate_fits if not one.plausible), default=math.inf)
    return accepted_before > 0 or step.accepted is None or last.cost > CRITERIA.retry_cost_ratio * imitating


def tempered_again(fit: FitResult, context: SearchContext) -> FitResult:
    """An accepted fit with the overdispersion that it leaves, cross-validated with that."""
    found = tempered(fit, context)
    return found if found is fit else cross_validated(found, context)


def selection_step(base: FitResult, context: SearchContext, limit: float = math.inf) -> SelectionStep:
    """Screen all candidates, refit the best, and see whether one is to be accepted.

    Where what differs between the recordings explains them, that joins the base. `limit`: the cost that sketches must not
    exceed.
    """
    candidates = candidates_for(base.problem.config, context.folders)
    context.on_progress(f'screening {len(candidates)} effects')
    screened = screen(base.problem, base.z, candidates, context.pool, context.seed)
    if context.stop.is_set():
        return SelectionStep(base, screened, (), None, stopped=True)
    promising = most_promising(screened)
    step = SelectionStep(base, screened, (), None)
    if base.effects and base.error <= 1.0:  # less than noise: nothing in the fitted runs asks for another effect
        return step
    if promising and promising[0].gain >= least_gain(base):
        step = step_with(base, screened, promising, context, limit=limit)
    differing = differing_fit(base, base if step.accepted is None else step.accepted.fit, context)
    if differing is not None:
        return selection_step(differing, context, limit)
    return with_further_candidates(step, candidates, context)


def least_gain(base: FitResult) -> float:
    """What a candidate must promise to take away from the squares for a refit to be worth its time."""
    if base.is_bent:
        return 2.0 * CRITERIA.decisive_log_odds
    return CRITERIA.min_explained_by_screening * max(base.squares, base.problem.samples)


def most_promising(screened: Sequence[ScreeningResult]) -> list[ScreeningResult]:
    """Those to try: the best, and what gains a fraction of that."""
    least = CRITERIA.min_relative_gain * screened[0].gain if screened else 0.0
    return [result for result in screened if result.gain >= least][: CRITERIA.sketched_candidates]


def step_with(
    base: FitResult, screened: tuple[ScreeningResult, ...], chosen: Sequence[ScreeningResult], context: SearchContext,
    start: FitResult | None = None, limit: float = math.inf,
) -> SelectionStep:  # fmt: skip
    """The step that refits some candidates and accepts the best of them, or none.

    `start`: the model without them as it lies where they begin, if not at the base. `limit`: the cost that their sketches
    must not exceed.
    """
    context.on_progress(f'refitting with {", ".join(result.candidate.name for result in chosen)}')
    start = base if start is None else start
    refits = best_refits(start, chosen, context, CRITERIA.cross_validated_candidates, limit / start.cost)
    pairs = [(result, fit) for result, fit in zip(chosen, refits, strict=True) if fit is not None]
    fits = judged_fits(base, pairs, CRITERIA.cross_validated_candidates, context)
    if context.stop.is_set():
        return SelectionStep(base, screened, (), None, stopped=True)
    ordered = ordered_by_error(fits)
    return SelectionStep(base, screened, ordered, best_acceptable(ordered))


def judged_fits(
    base: FitResult, pairs: Sequence[tuple[ScreeningResult, FitResult]], most: int, context: SearchContext
) -> list[CandidateFit]:
    """Refits compared with the base: the best by their cost, at most so many, cross-validated and with realistic values."""
    fits: list[CandidateFit] = []
    for result, fit in sorted(pairs, key=lambda pair: pair[1].cost)[:most]:
        best = min((other.fit.prediction_error for other in fits if other.acceptable), default=math.inf)
        if not context.stop.is_set():
            fits.append(cross_validated_candidate(base, result, fit, context, best))
    return with_realistic_values(base, in_better_kinetics(base, fits, context), context)


def with_further_candidates(first: SelectionStep, candidates: Sequence[Candidate], context: SearchContext) -> SelectionStep:
    """A step that leaves more than noise, with variants of the effects, and with what the score test passed over.

    A biased model may lie such that the right effect gains nothing to first order, and yet leads downhill. If the step has
    accepted one, all are screened where that has led, nearer to the true parameters; as long as a better one is found.
    """
    step = first
    while True:
        again = further_step(step, candidates, context)
        if again.accepted is None or (step.accepted is not None and again.accepted.name == step.accepted.name):
            return again
        step = again


def further_step(first: SelectionStep, candidates: Sequence[Candidate], context: SearchContext) -> SelectionStep:
    """A step with more candidates: what leads from where its accepted effect has led, or from the base."""
    base, accepted = first.base, first.accepted
    last = base if accepted is None else accepted.fit
    if first.stopped or context.stop.is_set() or not (leaves_something(last) or last.is_bent):
        return first
    variants: tuple[Candidate, ...] = ()
    if context.variants:
        variants = variants_of(candidates, {name for run in base.problem.runs for name in run.channels})
    start, trials = base if accepted is None else without_accepted(accepted, context), list[ScreeningResult]()
    if not math.isfinite(start.cost):
        start = base  # the model does not run there without its effect
    if variants or accepted is not None:
        context.on_progress(f'screening {len(candidates)} effects and {len(variants)} variants')
        screened = screen(start.problem, start.z, [*candidates, *variants], context.pool, context.seed)
        trials += promising_further(screened, first, least_gain(base))
    if accepted is None and (base.is_bent or base.error > unexplained_above(base.problem.span)):
        trials += passed_over(first, candidates)
    if not trials:
        return first
    enough = (1.0 if base.is_bent else 1.0 - CRITERIA.strong_error_reduction) * base.cost
    limit = enough if accepted is None else CRITERIA.sketch_cost_ratio * accepted.fit.cost
    again = step_with(base, first.screened, trials, context, start, limit)
    if context.stop.is_set():
        return replace(first, stopped=accepted is None)
    ordered = ordered_by_error([*first.candidate_fits, *again.candidate_fits])
    return SelectionStep(base, first.screened, ordered, best_acceptable(ordered))


def without_accepted(accepted: CandidateFit, context: SearchContext) -> FitResult:
    """The model without an accepted effect, its other parameters where the fit with it has led."""
    problem, z = without_effect(accepted.fit, accepted.name)
    return FitResult(problem, z, cost_at(problem, z, context.pool))


def leaves_something(fit: FitResult) -> bool:
    """Whether a model leaves anything that another could be seen to explain better."""
    return fit.error > CRITERIA.other_kinetics_above or fit.prediction_error > CRITERIA.variants_above


def promising_further(screened: Sequence[ScreeningResult], first: SelectionStep, least: float) -> list[ScreeningResult]:
    """Of what a step has not refitted, the variants that gain more than their effects do and at least so much; effects too
    where one was accepted: what explains more than that one is as significant as it is."""  # fmt: skip
    gains, known = {result.candidate.name: result.gain for result in screened}, {fit.name for fit in first.candidate_fits}
    least = max(least, CRITERIA.min_relative_gain * max(gains.values(), default=0.0))
    found = []
    for result in screened:
        effect = result.candidate.found.effect
        is_better = result.gain > gains.get(effect.plain_name, 0.0) if effect.scope.name else first.accepted is not None
        if is_better and result.gain >= least and effect.name not in known:
            found.append(result if first.accepted is None else replace(result, family_p=first.accepted.family_p))
    return found[: CRITERIA.sketched_candidates]


def passed_over(first: SelectionStep, candidates: Sequence[Candidate]) -> list[ScreeningResult]:
    """The candidates that a step has not tried, at a finite step from neutral."""
    screened = {result.candidate.name: result for result in first.screened}
    tried = {result.candidate.name for result in most_promising(first.screened)} if first.candidate_fits else set()
    return [at_finite_step(one, screened.get(one.name)) for one in candidates if one.name not in tried]


def cross_validated_candidate(
    base: FitResult, screened: ScreeningResult, fit: FitResult, context: SearchContext, best: float = math.inf
) -> CandidateFit:
    """A refitted candidate, cross-validated if that could bring it near the `best` cross-validated error so far.

    Runs that are left out are predicted no better than they can be fitted.
    """
    found = screened.candidate.found
    if fit.error <= (1.0 + CRITERIA.same_error) * best:
        context.on_progress(f'cross-validating {found.effect.name}')
        fit = cross_validated(fit, context)
    report_model('candidate', fit, context)
    return candidate_fit(base, found, fit, screened.family_p, context)


def in_better_kinetics(base: FitResult, fits: Sequence[CandidateFit], context: SearchContext) -> list[CandidateFit]:
    """All of them with the kinetics that suit them better, where those suit the best of them better.

    Rivals are to be compared with the kinetics that the model is left with: with others their values and errors are biased.
    """
    chosen = best_acceptable(fits)
    other = None if chosen is None else better_kinetics(chosen.fit, context)
    if chosen is None or other is None or other is chosen.fit:
        return list(fits)
    found = []
    for candidate in fits:
        fit = other if candidate is chosen else candidate.fit
        if candidate is not chosen and not candidate.not_cross_validated:
            fit = better_kinetics(candidate.fit, context, (1.0 + CRITERIA.same_error) * other.cost)
        unchanged = fit is candidate.fit
        found.append(candidate if unchanged else candidate_fit(base, candidate.found, fit, candidate.family_p, context))
    return found


def with_realistic_values(base: FitResult, fits: Sequence[CandidateFit], context: SearchContext) -> list[CandidateFit]:
    """The same, with other values where only unrealistic ones keep the best of them from being accepted.

    A nominal model that lacks an effect may prefer the wrong kinetics, which bend the values of the right effect; and data
    that determine a value badly do not insist on the one that fits best.
    """
    best = min((candidate.fit.prediction_error for candidate in fits if candidate.acceptable), default=math.inf)
    found = []
    for candidate in fits:
        if not candidate.plausible and candidate.convincing and candidate.fit.prediction_error < best:
            other = realistic_fit(candidate.fit, candidate.found, context)
            if other is not None:
                candidate = candidate_fit(base, candidate.found, other, candidate.family_p, context)
        found.append(candidate)
    return found


def realistic_fit(fit: FitResult, found: FoundEffect, context: SearchContext) -> FitResult | None:
    """A fit that explains as well, with the effect's values in their realistic ranges; None where there is none."""
    context.on_progress(f'{found.effect.name} fits with values that are not realistic: trying others')
    free = better_kinetics(fit, context)
    if is_plausible_fit(free, found) or context.stop.is_set():
        return free
    bounded = refit(*within_realistic_range(free, found), context)
    if bounded is None:
        return None
    bounded = cross_validated(bounded, context)
    return bounded if is_as_good(bounded, free) and not context.stop.is_set() else None


def pair_steps(first: SelectionStep, context: SearchContext) -> tuple[SelectionStep, ...]:
    """A step that accepts nothing; or its best candidate and the next step, if what that accepts explains beside it.

    Where two effects are missing, a model with one of them is still biased by the other, and may predict no better than
    with none. Both are judged together, by what they predict, without a score test. Which candidate is right shows only
    then, so that a second one is tried where the first does not lead to the noise.
    """
    significant = [c for c in first.candidate_fits if c.plausible and c.family_p <= CRITERIA.significance]
    if first.stopped or first.base.error <= unexplained_above(first.base.problem.span):
        return (first,)
    steps: tuple[SelectionStep, ...] = (first,)
    best, stopped = (1.0 - CRITERIA.strong_error_reduction) * first.base.prediction_error, False
    for candidate in sorted(significant, key=lambda c: c.fit.cost)[: CRITERIA.pair_candidates]:
        context.on_progress(f'{candidate.name} may explain beside another effect')
        fitted = CRITERIA.sketch_cost_ratio * cost_with(best, candidate.fit.problem, candidate.fit.z)
        second = selection_step(candidate.fit, context, fitted)  # runs are not predicted better than fitted
        stopped = stopped or second.stopped
        if second.accepted is not None and second.accepted.fit.prediction_error <= best:
            best = second.accepted.fit.prediction_error
            steps = (replace(first, accepted=candidate, after=candidate.fit, only_together=True), second)
        if stopped or min(best, candidate.fit.error) <= CRITERIA.noise_only:
            break
    return steps if len(steps) > 1 else (replace(first, stopped=stopped),)


def with_another_lead(
    steps: Sequence[SelectionStep], last: FitResult, context: SearchContext,
    unlisted_explains: Callable[[FitResult], bool] | None = None,
) -> tuple[SelectionStep, ...]:  # fmt: skip
    """The steps; or another effect of the first one and a further effect, which leave only noise.

    Asked where the steps do not, and the two must fit better by more than chance; and where the first of them accepted a
    variant that leaves more, and they must not fit worse by more than chance. What imitates two effects, mostly a variant,
    explains more than either does alone. A law that is not listed and explains all alone is one cause less.
    """
    accepted = steps[0].accepted if steps else None
    noise = fits_all(unexplained_above(last.problem.span))
    variant = accepted is not None and accepted.is_variant
    if accepted is None or (accepted.fit if variant else last).error <= noise:
        return tuple(steps)
    most = last.cost + (CRITERIA.decisive_log_odds if variant else -CRITERIA.decisive_log_odds)
    leads = [one for one in steps[0].candidate_fits if one is not accepted and one.acceptable and not one.is_variant]
    if leads and last.error > noise and unlisted_explains and unlisted_explains(steps[0].base):
        return tuple(steps)
    for lead in sorted(leads, key=lambda one: one.fit.cost)[: CRITERIA.pair_candidates]:
        if context.stop.is_set():
            break
        context.on_progress(f'{lead.name} may explain all beside another effect')
        limit = CRITERIA.sketch_cost_ratio * cost_with(noise, lead.fit.problem, lead.fit.z)
        second = selection_step(lead.fit, replace(context, variants=False), limit)
        found = last if second.accepted is None else second.accepted.fit
        if found is not last and found.error <= noise and found.cost <= most:
            after = tempered_again(found, context)
            pair = replace(steps[0], accepted=lead, after=lead.fit), replace(second, after=after)
            return (*pair, SelectionStep(after, (), (), None))
    return tuple(steps)


def with_unrealistic_values(steps: tuple[SelectionStep, ...], context: SearchContext) -> tuple[SelectionStep, ...]:
    """The steps; or the effect of the first one that alone leaves only noise, though its values are not realistic.

    Taken where the steps leave more, and fit worse by odds that outweigh the literature, from which the ranges are. Runs
    that were left out must say so too, which a single run cannot.
    """
    if not steps or context.stop.is_set():
        return steps
    last = steps[-1].base if steps[-1].accepted is None else steps[-1].accepted.fit
    most = last.cost - 2.0 * CRITERIA.decisive_log_odds
    found = [
        one for one in steps[0].candidate_fits
        if not one.plausible and one.convincing and one.fit.cost <= most
        and one.fit.error <= CRITERIA.variants_above and one.fit.cross_validated_error <= CRITERIA.variants_above
    ]  # fmt: skip
    if not found or not leaves_something(last):
        return steps
    best = min(found, key=lambda one: one.fit.cost)
    context.on_progress(f'{best.name} alone explains all, with values that are not realistic')
    after = tempered_again(best.fit, context)
    return replace(steps[0], accepted=best, after=after, only_together=False), SelectionStep(after, (), (), None)
