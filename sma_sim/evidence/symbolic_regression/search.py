"""The search for the equation of what is missing: try all terms, fit the best, try again where those fits lead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from sma_sim.evidence.estimation.calibrate import run_in_threads
from sma_sim.evidence.model_selection.forward_selection import SearchContext
from sma_sim.evidence.model_selection.refit import FitResult
from sma_sim.evidence.model_selection.tempered_likelihood import overdispersion, tempered
from sma_sim.evidence.symbolic_regression.augmented_fit import AugmentedFit, grow
from sma_sim.evidence.symbolic_regression.term_fits import LinearizedFit, TermFit, everywhere

FIRST, PER_PLACE = 9, 2  # terms that are fitted after the first look, and of one place
AGAIN, SWAPPED = 2, 6  # fits from which it goes on, and terms that are tried in place of theirs
CLOSE = 1.5  # times the least error: fits beyond it are not gone on from
WELL = 1.03  # error over noise below which nothing is exchanged
WARMER = 4.0  # times k at which terms are exchanged
PAIRED = 3  # second terms that are tried
ENOUGH = 1.1  # error over noise below which no second term is looked for


def search(bare: FitResult, place: SearchContext) -> list[AugmentedFit]:
    """Fits with an equation, the best first; `bare` is the fit without. Raises SimulationError."""
    soft, k = tempered(bare, place.pool, place.stop)
    place.on_progress('trying the terms of an equation at every port')
    guesses = everywhere(LinearizedFit(soft.problem.weighted(1.0 / k), soft.z, place.pool))
    found = fitted_with(soft, k, [(one,) for one in spread_out(guesses, FIRST)], place)
    for again in leading(found):
        if again.fitted.error > WELL and not place.stop.is_set():
            found += exchanged(soft, again, place)
    found.sort(key=lambda one: one.fitted.cost)
    if found and found[0].fitted.error > ENOUGH and not place.stop.is_set():
        found += paired(soft, found[0], place)
        found.sort(key=lambda one: one.fitted.cost)
    return found


def spread_out(guesses: Sequence[TermFit], most: int) -> list[TermFit]:
    """The best, not too many of one place."""
    chosen: list[TermFit] = []
    for one in guesses:
        if sum(other.place == one.place for other in chosen) < PER_PLACE:
            chosen.append(one)
    return chosen[:most]


def fitted_with(
    base: FitResult, k: float, formulas: Sequence[tuple[TermFit, ...]], place: SearchContext
) -> list[AugmentedFit]:
    """Fits with each of some formulas."""
    if not formulas:
        return []
    jobs = [partial(grow, base, k, guesses, place.pool, place.stop) for guesses in formulas]
    return [one for one in run_in_threads(jobs, place.stop) if one is not None]


def leading(found: Sequence[AugmentedFit]) -> list[AugmentedFit]:
    """The best fits of different ports from which it goes on."""
    chosen: list[AugmentedFit] = []
    for one in sorted(found, key=lambda one: one.fitted.cost):
        new = all(one.guesses[0].place.hook != other.guesses[0].place.hook for other in chosen)
        if new and len(chosen) < AGAIN and one.fitted.error <= CLOSE * (chosen or [one])[0].fitted.error:
            chosen.append(one)
    return chosen


def without_terms(soft: FitResult, grown: AugmentedFit) -> FitResult:
    """The model without the terms, its parameters where the fit with them has left them."""
    n, more = len(soft.problem.free), len(grown.fitted.problem.free)
    return replace(soft, z=np.concatenate([grown.fitted.z[:n], grown.fitted.z[more:]]))


def exchanged(soft: FitResult, grown: AugmentedFit, place: SearchContext) -> list[AugmentedFit]:
    """Fits with other terms of its port in place of those of a fit.

    All terms are tried again on the model without any, but with the parameters that the fit has led to: they are nearer
    to the true ones than those of a fit without a term.
    """
    place.on_progress(f'{grown.name}: error over noise {grown.fitted.error:.2f}; trying others in its place')
    k = overdispersion(grown.fitted.problem, grown.fitted.z, place.pool)
    base = without_terms(soft, grown)
    bench = LinearizedFit(base.problem.weighted(1.0 / k), base.z, place.pool)
    guesses = spread_out(everywhere(bench, (grown.guesses[0].place.hook,)), SWAPPED)
    return fitted_with(base, WARMER * k, [(one,) for one in guesses], place)


def paired(soft: FitResult, grown: AugmentedFit, place: SearchContext) -> list[AugmentedFit]:
    """Fits with a second term at the same place, those that could add most to a fit."""
    place.on_progress(f'{grown.name}: error over noise {grown.fitted.error:.2f}; trying second terms')
    k = overdispersion(grown.fitted.problem, grown.fitted.z, place.pool)
    bench = LinearizedFit(grown.fitted.problem.weighted(1.0 / k), grown.fitted.z, place.pool)
    first = grown.guesses[0]
    same = [one for one in everywhere(bench, (first.place.hook,)) if one.place == first.place][:PAIRED]
    return fitted_with(without_terms(soft, grown), k, [(*grown.guesses, one) for one in same], place)
