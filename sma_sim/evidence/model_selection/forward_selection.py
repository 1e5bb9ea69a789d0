"""Forward selection of missing effects: screen, refit, judge on runs left out in turn, accept the best, go on.

What later effects say of earlier ones is asked in the end (`backward_elimination`). The held-out runs are not read here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event

from sma_sim.evidence.estimation.levenberg_marquardt import FIRST
from sma_sim.evidence.model_selection.candidates import candidates_for
from sma_sim.evidence.model_selection.refit import (
    EXPLAINED,
    FitResult,
    bayesian_gain,
    best_refits,
    further_in,
    other_kinetics,
    plausible,
    quick_refits,
    refit,
    standard_errors,
    validated,
    within,
)
from sma_sim.evidence.model_selection.score_tests import Screened, screen
from sma_sim.model.effects.discovery import FoundEffect

LEAST_REDUCTION = 0.03  # part of the cross-validated error (of the noise, below it) that an accepted effect takes away
SAME = 0.01  # relative difference of cross-validated errors within which two effects explain alike
SURE_REDUCTION = (
    0.25  # of the cross-validated error and of the fitted squares: needs no further proof, chance does not do both
)
SIGNIFICANT = 0.05  # chance that the best of all candidates gains as much from residuals without any of them
SURVIVORS, FINALISTS = 8, 4  # candidates that are refitted, and cross-validated
LEAST_GAIN = 0.1  # of the best's: a candidate that gains less is not refitted
UNEXPLAINED = 1.3  # error over noise above which something is missing that no accepted effect explains
WORTH = 0.02  # part of the squares that the best must foretell to explain, for a refit to be worth its time
LEAST_PART = 0.4  # of the fitted squares: the noise is reached from an error of 1.3 or more
MOST_EFFECTS = 4
LEADS = 2  # that are tried beside another effect
WELL = 1.01  # error over noise below which the other kinetics are not tried

OnProgress = Callable[[str], None]


@dataclass(frozen=True)
class CandidateFit:
    """A candidate after its refit: how it compares with the model without it.

    `ratio`: cross-validated error with over without (the fitted error, which is less, where it is `hopeless`); `fall`: by
    how much it falls, in parts of the error or of the noise, whichever is larger; `part`: of the fitted squares that it
    explains; `family_p` of the screening; `indistinguishable`: others that explain as well.
    """

    found: FoundEffect
    fitted: FitResult
    delta_bic: float
    ratio: float
    fall: float
    part: float
    family_p: float
    plausible: bool
    std: dict[str, float]
    indistinguishable: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.found.effect.name

    @property
    def hopeless(self) -> bool:
        """Whether its fitted error is beyond another's on runs left out, so that it was not cross-validated."""
        return len(self.fitted.problem.runs) > 1 and math.isnan(self.fitted.validated)

    @property
    def acceptable(self) -> bool:
        """Whether it explains enough, by more than chance, with realistic values."""
        return self.convincing and self.plausible

    @property
    def convincing(self) -> bool:
        """Whether it explains enough or all, whatever its values."""
        return self.enough or self.explains_all

    @property
    def explains_all(self) -> bool:
        """Whether it leaves but noise where much was left without it, all fitted runs together.

        A run may go beyond what the others tell, who then foretell it badly with the right effect too.
        """
        return self.fitted.error <= EXPLAINED and self.part >= LEAST_PART

    @property
    def enough(self) -> bool:
        """Whether runs left out are foretold better by enough, and by more than chance."""
        return self.fall >= LEAST_REDUCTION and self.not_chance

    @property
    def not_chance(self) -> bool:
        """Whether the score test says so, or the runs do by themselves, fitted and left out.

        A model that is far off foretells better with anything that holds it back; then the fitted runs are hardly helped.
        """
        return self.family_p <= SIGNIFICANT or (self.fall >= SURE_REDUCTION and self.part >= SURE_REDUCTION)


@dataclass(frozen=True)
class SelectionStep:
    """One round of the selection: the model it began with, all that was screened, what was tried, what was accepted.

    `after`: the model with the accepted effect, whose kinetics suit it better; `stopped`: it was not brought to
    its end, so that nothing could be accepted. `only_together`: accepted for what it explains beside the next one.
    """

    base: FitResult
    screened: tuple[Screened, ...]
    tried: tuple[CandidateFit, ...]
    accepted: CandidateFit | None
    after: FitResult | None = None
    stopped: bool = False
    only_together: bool = False


@dataclass(frozen=True)
class SearchContext:
    """What all steps of a selection share."""

    pool: Executor
    stop: Event
    on_progress: OnProgress
    folders: tuple[Path, ...] = ()
    seed: int = 0


def prediction_error(one: FitResult) -> float:
    """The cross-validated error; the training error where there is one run only."""
    return one.validated if one.validated == one.validated else one.error


def one_step(base: FitResult, context: SearchContext) -> SelectionStep:
    """Screen all candidates, refit the best, and see whether one is to be accepted."""
    candidates = candidates_for(base.problem.config, context.folders)
    context.on_progress(f'screening {len(candidates)} effects')
    screened = screen(base.problem, base.z, candidates, context.pool, context.seed)
    if context.stop.is_set():
        return SelectionStep(base, screened, (), None, stopped=True)
    chosen = survivors(screened)
    if not chosen or chosen[0].gain < WORTH * max(base.squares, base.problem.samples):
        return SelectionStep(base, screened, (), None)
    return step_with(base, screened, chosen, context)


def survivors(screened: Sequence[Screened]) -> list[Screened]:
    """Those that are worth a refit: the best, and what gains a part of that."""
    return [one for one in screened if one.gain >= LEAST_GAIN * screened[0].gain][:SURVIVORS]


def step_with(
    base: FitResult, screened: tuple[Screened, ...], chosen: Sequence[Screened], context: SearchContext
) -> SelectionStep:
    """The round that refits some candidates and accepts the best of them, or none."""
    context.on_progress(f'refitting with {", ".join(one.candidate.name for one in chosen)}')
    refitted = best_refits(base, chosen, context.pool, context.stop, FINALISTS)
    pairs = [(one, fitted) for one, fitted in zip(chosen, refitted, strict=True) if fitted is not None]
    pairs.sort(key=lambda pair: pair[1].cost)
    tried: list[CandidateFit] = []
    for one, fitted in pairs[:FINALISTS]:
        best = min((prediction_error(other.fitted) for other in tried if other.acceptable), default=math.inf)
        if not context.stop.is_set():
            tried.append(candidate_fit(base, one, fitted, context, best))
    tried = with_realistic_values(base, in_better_kinetics(base, tried, context), context)
    if context.stop.is_set():
        return SelectionStep(base, screened, (), None, stopped=True)
    ordered = ordered_by_ratio(tried)
    return SelectionStep(base, screened, ordered, best_acceptable(ordered))


def retry_from_finite_step(first: SelectionStep, context: SearchContext) -> SelectionStep:
    """A round that accepts nothing and leaves much, with the best of those too that the score test passed over.

    A bent model may lie such that the right effect gains nothing to first order, and yet leads downhill from some way in.
    Not asked of the bare model, where descents are long and the score test has missed next to nothing.
    """
    if first.accepted is not None or first.stopped or first.base.error <= UNEXPLAINED:
        return first
    screened = {one.candidate.name: one for one in first.screened}
    seen = {one.candidate.name for one in survivors(first.screened)} if first.tried else set()
    others = [one for one in candidates_for(first.base.problem.config, context.folders) if one.name not in seen]
    context.on_progress(f'a second look at {len(others)} effects')
    starts = [further_in(one, screened.get(one.name)) for one in others]
    leads = quick_refits(first.base, starts, SURE_REDUCTION, context.pool, context.stop)[:LEADS]
    if context.stop.is_set():
        return replace(first, stopped=True)
    again = step_with(first.base, first.screened, leads, context) if leads else first
    if again.stopped or again.accepted is None:
        return replace(first, stopped=again.stopped)
    ordered = ordered_by_ratio([*again.tried, *first.tried])
    return replace(again, tried=ordered, accepted=best_acceptable(ordered))


def candidate_fit(
    base: FitResult, screened: Screened, fitted: FitResult, context: SearchContext, best: float = math.inf
) -> CandidateFit:
    """A refitted candidate, cross-validated if that could bring it near the `best` cross-validated error so far.

    Runs that are left out are foretold no better than they can be fitted.
    """
    found = screened.candidate.found
    if fitted.error <= (1.0 + SAME) * best:
        context.on_progress(f'cross-validating {found.effect.name}')
        fitted = validated(fitted, context.pool, context.stop)
    return compared(base, found, fitted, screened.family_p, context)


def compared(
    base: FitResult, found: FoundEffect, fitted: FitResult, family_p: float, context: SearchContext
) -> CandidateFit:
    """A candidate that was refitted and cross-validated beside the model without it."""
    before, after = prediction_error(base), prediction_error(fitted)
    return CandidateFit(
        found, fitted, bayesian_gain(base, fitted), after / before, (before - after) / max(before, 1.0),
        1.0 - fitted.squares / base.squares, family_p, plausible(fitted, found), standard_errors(fitted, context.pool),
    )  # fmt: skip


def in_better_kinetics(base: FitResult, tried: Sequence[CandidateFit], context: SearchContext) -> list[CandidateFit]:
    """All of them with the kinetics that suit them better, where those suit the best of them better.

    Rivals are to be compared with the kinetics that the model is left with: with others their values and errors are bent.
    """
    chosen = best_acceptable(tried)
    other = None if chosen is None else better_kinetics(chosen.fitted, context)
    if chosen is None or other is None or other is chosen.fitted:
        return list(tried)
    found = []
    for one in tried:
        fitted = other if one is chosen else one.fitted if one.hopeless else better_kinetics(one.fitted, context)
        found.append(one if fitted is one.fitted else compared(base, one.found, fitted, one.family_p, context))
    return found


def with_realistic_values(base: FitResult, tried: Sequence[CandidateFit], context: SearchContext) -> list[CandidateFit]:
    """The same, with other values where only unrealistic ones keep the best of them from being accepted.

    A bare model that lacks an effect may prefer the wrong kinetics, which bend the values of the right effect; and data that
    tell a value badly do not insist on the one that fits best.
    """
    best = min((prediction_error(one.fitted) for one in tried if one.acceptable), default=math.inf)
    found = []
    for one in tried:
        if not one.plausible and one.convincing and prediction_error(one.fitted) < best:
            other = realistic(one.fitted, one.found, context)
            one = one if other is None else compared(base, one.found, other, one.family_p, context)
        found.append(one)
    return found


def realistic(one: FitResult, found: FoundEffect, context: SearchContext) -> FitResult | None:
    """A fit that explains as well, with the effect's values in their realistic ranges; None where there is none."""
    context.on_progress(f'{found.effect.name} fits with values that are not realistic: trying others')
    free = better_kinetics(one, context)
    if plausible(free, found) or context.stop.is_set():
        return free
    bounded = refit(*within(free, found), context.pool, context.stop)
    if bounded is None:
        return None
    bounded = validated(bounded, context.pool, context.stop)
    return bounded if is_as_good(bounded, free) and not context.stop.is_set() else None


def ordered_by_ratio(tried: Sequence[CandidateFit]) -> tuple[CandidateFit, ...]:
    """Best first, each with those that explain as well."""
    return tuple(
        replace(one, indistinguishable=indistinguishable(one, tried)) for one in sorted(tried, key=lambda one: one.ratio)
    )


def indistinguishable(one: CandidateFit, tried: Sequence[CandidateFit]) -> tuple[str, ...]:
    """Other plausible candidates whose cross-validated error is within SAME."""
    error = prediction_error(one.fitted)
    return tuple(
        other.name for other in tried
        if other is not one and other.plausible and abs(prediction_error(other.fitted) - error) <= SAME * error
    )  # fmt: skip


def best_acceptable(tried: Sequence[CandidateFit]) -> CandidateFit | None:
    """The acceptable candidate with the least error; among those that explain alike the one with the fewest parameters.

    Where one leaves but noise in all fitted runs, what leaves clearly more there is out.
    """
    good = [one for one in tried if one.acceptable]
    if not good:
        return None
    least = min(good, key=lambda one: one.fitted.error)
    if least.fitted.error <= EXPLAINED:
        good = [one for one in good if not is_outdone(one, least)]
    best = min(prediction_error(one.fitted) for one in good)
    close = [one for one in good if prediction_error(one.fitted) <= (1.0 + SAME) * best]
    return min(close, key=lambda one: (len(one.fitted.problem.free), prediction_error(one.fitted)))


def is_outdone(one: CandidateFit, best: CandidateFit) -> bool:
    """Whether the best leaves less in the fitted runs: much less, or less without foretelling those left out much worse."""
    more = one.fitted.error / best.fitted.error
    foretells = prediction_error(one.fitted) < (1.0 - LEAST_REDUCTION) * prediction_error(best.fitted)
    return more > EXPLAINED or (more > 1.0 + SAME and not foretells)


def select(base: FitResult, context: SearchContext) -> tuple[SelectionStep, ...]:
    """Rounds until nothing more is gained; the last one accepts nothing (unless stopped or full)."""
    rounds: list[SelectionStep] = []
    while not context.stop.is_set() and len(rounds) < MOST_EFFECTS:
        one = one_step(base, context)
        one = retry_from_finite_step(one, context) if rounds else one
        rounds += [one] if one.accepted is not None or len(rounds) + 2 > MOST_EFFECTS else with_another(one, context)
        accepted = rounds[-1].accepted
        if accepted is None:
            break
        fitted, left_out = accepted.fitted.error, prediction_error(accepted.fitted)
        context.on_progress(
            f'accepted {accepted.name}: error over noise {fitted:.2f} fitted, {left_out:.2f} on runs left out'
        )
        base = accepted.fitted
        rounds[-1] = replace(rounds[-1], after=base)
    return tuple(rounds)


def with_another(first: SelectionStep, context: SearchContext) -> tuple[SelectionStep, ...]:
    """A round that accepts nothing; or its best lead and the next round, if what that accepts explains beside the lead.

    Where two effects are missing, a model with one of them is still bent by the other, and may foretell no better than
    with none. Both are judged as one: by what they foretell together, without the help of a score test. Which lead is right
    shows only then, so that a second is tried where the first does not lead to the noise.
    """
    leads = [one for one in first.tried if one.plausible and one.family_p <= SIGNIFICANT]
    if first.stopped or first.base.error <= UNEXPLAINED:
        return (first,)
    rounds: tuple[SelectionStep, ...] = (first,)
    best, stopped = (1.0 - SURE_REDUCTION) * prediction_error(first.base), False
    for lead in sorted(leads, key=lambda one: one.fitted.cost)[:LEADS]:
        context.on_progress(f'{lead.name} may explain beside another effect')
        second = one_step(lead.fitted, context)
        stopped = stopped or second.stopped
        if second.accepted is not None and prediction_error(second.accepted.fitted) <= best:
            best = prediction_error(second.accepted.fitted)
            rounds = (replace(first, accepted=lead, after=lead.fitted, only_together=True), second)
        if stopped or min(best, lead.fitted.error) <= EXPLAINED:
            break
    return rounds if len(rounds) > 1 else (replace(first, stopped=stopped),)


def better_kinetics(one: FitResult, context: SearchContext) -> FitResult:
    """The same effects with the other kinetics, if they foretell better: kinetics are a choice of model, not a finding."""
    if one.error < WELL or context.stop.is_set():
        return one
    problem, z = other_kinetics(one)
    other = refit(problem, z, context.pool, context.stop, FIRST)
    if other is None or other.error > (1.0 + SAME) * one.error:
        return one
    other = validated(other, context.pool, context.stop)
    if context.stop.is_set() or prediction_error(other) >= prediction_error(one):
        return one
    context.on_progress(
        f'{other.problem.config.model} kinetics foretell better: error over noise {prediction_error(other):.2f}'
    )
    return other


def is_as_good(less: FitResult, one: FitResult) -> bool:
    """Whether a model with less freedom foretells as well without leaving more, or leaves but the same noise."""
    foretells = prediction_error(less) <= (1.0 + SAME) * prediction_error(one)
    more = less.error / one.error
    return (foretells and more <= 1.0 + LEAST_REDUCTION) or (less.error <= EXPLAINED and more <= 1.0 + SAME)
