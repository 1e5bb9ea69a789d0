"""Backward elimination: accepted effects compared again, beside those that came after them.

An effect is accepted while others are still missing, which bend the model. What later ones made superfluous is dropped, and
what explains better beside them, or as well with fewer parameters, replaces it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.cross_validation import cross_validated
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.candidate_fit import (
    CandidateFit,
    SelectionStep,
    best_acceptable,
    candidate_fit,
    gain_beyond_temperature,
    is_blurred,
    ordered_by_error,
)
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.evidence.model_selection.forward_selection import with_realistic_values
from sma_sim.evidence.model_selection.kinetics_choice import is_as_good
from sma_sim.evidence.model_selection.refit import refit
from sma_sim.evidence.model_selection.restricted import without_effect

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class EliminationStep(SelectionStep):
    """Like a selection step: the base is the model without `effect`, the candidates are what could replace it."""

    effect: str = ''


def eliminate_backward(
    last: FitResult, steps: Sequence[SelectionStep], context: SearchContext
) -> tuple[FitResult, tuple[EliminationStep, ...]]:
    """The model whose effects, but the last one, were compared again beside the others; and those comparisons."""
    eliminations: list[EliminationStep] = []
    accepted = {step.accepted.name: step for step in steps if step.accepted is not None}
    for effect in [name for name in last.effects[:-1] if name in accepted]:
        fewer = refit(*without_effect(last, effect), context)
        if fewer is None:
            continue
        fewer = cross_validated(fewer, context)
        if context.stop.is_set():
            break
        if is_as_good(fewer, last) or is_blurred(gain_beyond_temperature(fewer, last)):
            context.on_progress(f'{effect} explains nothing more beside the others: dropped')
            last = fewer
            continue
        again = elimination_step(effect, fewer, last, accepted[effect], context)
        if context.stop.is_set():
            break
        eliminations.append(again)
        last = last if again.after is None else again.after
    return last, tuple(eliminations)


def elimination_step(
    effect: str, fewer: FitResult, last: FitResult, first: SelectionStep, context: SearchContext
) -> EliminationStep:
    """The candidates of the step that accepted an effect, each instead of it in the last model; `fewer` has none of them."""
    context.on_progress(f'{effect} and its rivals beside the others')
    fits = []
    for rival in first.candidate_fits:
        fit: FitResult | None = last
        if rival.name != effect:
            there = rival.found.effect.plain_name in other_effects(last, effect)
            fit = None if there else refitted_rival(*with_rival(last, effect, rival), last, context)
        if fit is not None:
            fits.append(candidate_fit(fewer, rival.found, fit, rival.family_p, context))
    ordered = ordered_by_error(with_realistic_values(fewer, fits, context))
    best = best_replacement(effect, ordered)
    if best.name != effect:
        context.on_progress(f'{best.name} replaces {effect}: error over noise {best.fit.error:.2f} fitted')
    return EliminationStep(fewer, (), ordered, best, best.fit, effect=effect)


def other_effects(fit: FitResult, effect: str) -> set[str]:
    """The effects of a model beside one of them, in whatever scope: no effect acts in two scopes at once."""
    found = [active.found.effect for active in fit.problem.config.effects]
    return {other.plain_name for other in found if other.name != effect}


def best_replacement(effect: str, fits: Sequence[CandidateFit]) -> CandidateFit:
    """The best candidate, if it predicts as well as the effect that is there; else that."""
    (own,) = (candidate for candidate in fits if candidate.name == effect)
    best, limit = best_acceptable(fits), (1.0 + CRITERIA.same_error) * own.fit.prediction_error
    return own if best is None or best.fit.prediction_error > limit else best


def refitted_rival(problem: Problem, z: Vector, last: FitResult, context: SearchContext) -> FitResult | None:
    """A rival refitted, and cross-validated if that could bring it near the last model."""
    found = refit(problem, z, context, target=(1.0 + CRITERIA.same_error) * last.cost)
    near = found is not None and found.error <= (1.0 + CRITERIA.same_error) * last.prediction_error
    return cross_validated(found, context) if found is not None and near else found


def with_rival(fit: FitResult, effect: str, rival: CandidateFit) -> tuple[Problem, Vector]:
    """The problem with a rival instead of one of its effects, at the values that it had by itself."""
    problem, z = without_effect(fit, effect)
    source, prefix, at = rival.fit, f'effects.{rival.name}.', len(problem.free)
    new = [(p, x) for p, x in zip(source.problem.free, source.z, strict=False) if p.name.startswith(prefix)]
    (active,) = (a for a in source.problem.config.effects if a.found.effect.name == rival.name)
    effects = list(problem.config.effects)
    names = [one.found.effect.name for one in fit.problem.config.effects]
    effects.insert(names.index(effect), active)
    config = replace(problem.config, effects=tuple(effects))
    free = (*problem.free, *(p for p, _ in new))
    return replace(problem, config=config, free=free), np.concatenate([z[:at], [x for _, x in new], z[at:]])
