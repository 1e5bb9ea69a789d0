"""The search for the equation of what is missing: try all terms, fit the best, try again where those fits lead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from sma_sim.evidence.calibrate import together
from sma_sim.evidence.equation.growing import Grown, grow
from sma_sim.evidence.equation.trying import Bench, Guess, everywhere
from sma_sim.evidence.refit import Fitted
from sma_sim.evidence.selection import Workplace
from sma_sim.evidence.tempering import disbelief, softened

FIRST, PER_PLACE = 9, 2  # terms that are fitted after the first look, and of one place
AGAIN, SWAPPED = 2, 6  # fits from which it goes on, and terms that are tried in place of theirs
CLOSE = 1.5  # times the least error: fits beyond it are not gone on from
WELL = 1.03  # error over noise below which nothing is exchanged
WARMER = 4.0  # times k at which terms are exchanged
PAIRED = 3  # second terms that are tried
ENOUGH = 1.1  # error over noise below which no second term is looked for


def search(bare: Fitted, place: Workplace) -> list[Grown]:
    """Fits with an equation, the best first; `bare` is the fit without. Raises SimulationError."""
    soft, k = softened(bare, place.pool, place.stop)
    place.told('trying the terms of an equation at every port')
    guesses = everywhere(Bench(soft.problem.weighted(1.0 / k), soft.z, place.pool))
    found = fitted_with(soft, k, [(one,) for one in spread_out(guesses, FIRST)], place)
    for again in leading(found):
        if again.fitted.error > WELL and not place.stop.is_set():
            found += exchanged(soft, again, place)
    found.sort(key=lambda one: one.fitted.cost)
    if found and found[0].fitted.error > ENOUGH and not place.stop.is_set():
        found += paired(soft, found[0], place)
        found.sort(key=lambda one: one.fitted.cost)
    return found


def spread_out(guesses: Sequence[Guess], most: int) -> list[Guess]:
    """The best, not too many of one place."""
    chosen: list[Guess] = []
    for one in guesses:
        if sum(other.place == one.place for other in chosen) < PER_PLACE:
            chosen.append(one)
    return chosen[:most]


def fitted_with(base: Fitted, k: float, formulas: Sequence[tuple[Guess, ...]], place: Workplace) -> list[Grown]:
    """Fits with each of some formulas."""
    if not formulas:
        return []
    jobs = [partial(grow, base, k, guesses, place.pool, place.stop) for guesses in formulas]
    return [one for one in together(jobs, place.stop) if one is not None]


def leading(found: Sequence[Grown]) -> list[Grown]:
    """The best fits of different ports from which it goes on."""
    chosen: list[Grown] = []
    for one in sorted(found, key=lambda one: one.fitted.cost):
        new = all(one.guesses[0].place.hook != other.guesses[0].place.hook for other in chosen)
        if new and len(chosen) < AGAIN and one.fitted.error <= CLOSE * (chosen or [one])[0].fitted.error:
            chosen.append(one)
    return chosen


def without_terms(soft: Fitted, grown: Grown) -> Fitted:
    """The model without the terms, its parameters where the fit with them has left them."""
    n, more = len(soft.problem.free), len(grown.fitted.problem.free)
    return replace(soft, z=np.concatenate([grown.fitted.z[:n], grown.fitted.z[more:]]))


def exchanged(soft: Fitted, grown: Grown, place: Workplace) -> list[Grown]:
    """Fits with other terms of its port in place of those of a fit.

    All terms are tried again on the model without any, but with the parameters that the fit has led to: they are nearer
    to the true ones than those of a fit without a term.
    """
    place.told(f'{grown.name}: error over noise {grown.fitted.error:.2f}; trying others in its place')
    k = disbelief(grown.fitted.problem, grown.fitted.z, place.pool)
    base = without_terms(soft, grown)
    bench = Bench(base.problem.weighted(1.0 / k), base.z, place.pool)
    guesses = spread_out(everywhere(bench, (grown.guesses[0].place.hook,)), SWAPPED)
    return fitted_with(base, WARMER * k, [(one,) for one in guesses], place)


def paired(soft: Fitted, grown: Grown, place: Workplace) -> list[Grown]:
    """Fits with a second term at the same place, those that could add most to a fit."""
    place.told(f'{grown.name}: error over noise {grown.fitted.error:.2f}; trying second terms')
    k = disbelief(grown.fitted.problem, grown.fitted.z, place.pool)
    bench = Bench(grown.fitted.problem.weighted(1.0 / k), grown.fitted.z, place.pool)
    first = grown.guesses[0]
    same = [one for one in everywhere(bench, (first.place.hook,)) if one.place == first.place][:PAIRED]
    return fitted_with(without_terms(soft, grown), k, [(*grown.guesses, one) for one in same], place)
