"""Accepted effects looked at again, beside those that came after them.

An effect is accepted while others are still missing, which bend the model. What later ones made superfluous is dropped
(backward elimination), and what explains better, or as well with fewer parameters, beside them takes its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.model_selection.forward_selection import (
    SAME,
    CandidateFit,
    SearchContext,
    SelectionStep,
    best_acceptable,
    compared,
    is_as_good,
    ordered_by_ratio,
    prediction_error,
    with_realistic_values,
)
from sma_sim.evidence.model_selection.refit import FitResult, Vector, refit, validated, without


@dataclass(frozen=True)
class EliminationStep(SelectionStep):
    """Like a round: the model without `effect`, and what was tried in its place beside all the others."""

    effect: str = ''


def eliminate_backward(
    last: FitResult, rounds: Sequence[SelectionStep], context: SearchContext
) -> tuple[FitResult, tuple[EliminationStep, ...]]:
    """The model with what its effects but the last one are worth beside the others; what was tried in their places."""
    revisions: list[EliminationStep] = []
    accepted = {one.accepted.name: one for one in rounds if one.accepted is not None}
    for effect in [name for name in last.effects[:-1] if name in accepted]:
        fewer = refit(*without(last, effect), context.pool, context.stop)
        if fewer is None:
            continue
        fewer = validated(fewer, context.pool, context.stop)
        if context.stop.is_set():
            break
        if is_as_good(fewer, last):
            context.on_progress(f'{effect} explains nothing more beside the others: dropped')
            last = fewer
            continue
        again = in_place_of(effect, fewer, last, accepted[effect], context)
        if context.stop.is_set():
            break
        revisions.append(again)
        last = last if again.after is None else again.after
    return last, tuple(revisions)


def in_place_of(
    effect: str, fewer: FitResult, last: FitResult, first: SelectionStep, context: SearchContext
) -> EliminationStep:
    """The candidates of the round that accepted an effect, each in its place in the last model; `fewer` has none of them."""
    context.on_progress(f'{effect} and its rivals beside the others')
    tried = []
    for one in first.tried:
        fitted: FitResult | None = last
        if one.name != effect:
            fitted = None if one.name in last.effects else refitted(*instead(last, effect, one), last, context)
        if fitted is not None:
            tried.append(compared(fewer, one.found, fitted, one.family_p, context))
    ordered = ordered_by_ratio(with_realistic_values(fewer, tried, context))
    best = best_in_place(effect, ordered)
    if best.name != effect:
        context.on_progress(f'{best.name} takes the place of {effect}: error over noise {best.fitted.error:.2f} fitted')
    return EliminationStep(fewer, (), ordered, best, best.fitted, effect=effect)


def best_in_place(effect: str, tried: Sequence[CandidateFit]) -> CandidateFit:
    """The choice among what was tried, if it foretells as well as the effect that is there; else that."""
    (own,) = (one for one in tried if one.name == effect)
    best = best_acceptable(tried)
    return own if best is None or prediction_error(best.fitted) > (1.0 + SAME) * prediction_error(own.fitted) else best


def refitted(problem: Problem, z: Vector, last: FitResult, context: SearchContext) -> FitResult | None:
    """A rival refitted, and cross-validated if that could bring it near the last model."""
    found = refit(problem, z, context.pool, context.stop)
    near = found is not None and found.error <= (1.0 + SAME) * prediction_error(last)
    return validated(found, context.pool, context.stop) if found is not None and near else found


def instead(one: FitResult, effect: str, rival: CandidateFit) -> tuple[Problem, Vector]:
    """The problem with a rival in the place of one of its effects, at the values that it had by itself."""
    problem, z = without(one, effect)
    source, prefix, at = rival.fitted, f'effects.{rival.name}.', len(problem.free)
    new = [(p, x) for p, x in zip(source.problem.free, source.z, strict=False) if p.name.startswith(prefix)]
    (active,) = (a for a in source.problem.config.effects if a.found.effect.name == rival.name)
    effects = list(problem.config.effects)
    effects.insert(one.effects.index(effect), active)
    config = replace(problem.config, effects=tuple(effects))
    free = (*problem.free, *(p for p, _ in new))
    return replace(problem, config=config, free=free), np.concatenate([z[:at], [x for _, x in new], z[at:]])
