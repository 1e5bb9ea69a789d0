"""The search for the equation of what is missing: regress all terms, sketch the best, exchange terms where those lead."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from math import inf

import numpy as np

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.overdispersion import overdispersion
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.tempered_likelihood import tempered_fit
from sma_sim.evidence.symbolic_regression.augmented_fit import AugmentedFit, sketched_formulas
from sma_sim.evidence.symbolic_regression.criteria import TERM_SEARCH_CRITERIA
from sma_sim.evidence.symbolic_regression.term_fits import LinearizedFit, TermFit, fit_all_terms


def search_formulas(nominal: FitResult, context: SearchContext, most: float = inf) -> list[AugmentedFit]:
    """Sketches of fits with an equation, the best first; `nominal` is the fit without. Raises SimulationError.

    `most`: the error over noise that the first sketches must come down to, to be continued.
    """
    criteria = TERM_SEARCH_CRITERIA
    base, tempering = tempered_fit(nominal, context)
    context.on_progress('fitting the terms of an equation at every port')
    terms = best_by_location(terms_at(base, tempering, context))
    fits = sketched_formulas(base, terms[: criteria.max_first_terms], context)
    fits = [fit for fit in fits if fit.fitted.error <= most]
    for lead in exchange_candidates(fits):
        if lead.fitted.error > criteria.good_fit_error and not context.stop.is_set():
            fits += with_exchanged_term(base, lead, context)
    fits.sort(key=lambda fit: fit.fitted.cost)
    if fits and fits[0].fitted.error > criteria.sufficient_error and not context.stop.is_set():
        fits += with_second_term(fits[0], context)
        fits.sort(key=lambda fit: fit.fitted.cost)
    return fits


def terms_at(fit: FitResult, tempering: float, context: SearchContext, hooks: Collection[str] = ()) -> list[TermFit]:
    """All terms (of these ports) on a model where it lies, the largest error reduction first."""
    linearized = LinearizedFit(fit.problem.weighted(1.0 / tempering), fit.z, context.pool)
    return fit_all_terms(linearized, context.stop, hooks)


def best_by_location(terms: Sequence[TermFit]) -> list[TermFit]:
    """The best terms, not too many of one location."""
    chosen: list[TermFit] = []
    for term in terms:
        if sum(other.location == term.location for other in chosen) < TERM_SEARCH_CRITERIA.max_per_location:
            chosen.append(term)
    return chosen


def exchange_candidates(fits: Sequence[AugmentedFit]) -> list[AugmentedFit]:
    """The best fits of different ports around which terms are exchanged."""
    chosen: list[AugmentedFit] = []
    for fit in sorted(fits, key=lambda fit: fit.fitted.cost):
        new_port = all(fit.terms[0].location.hook != other.terms[0].location.hook for other in chosen)
        limit = TERM_SEARCH_CRITERIA.lead_error_ratio * (chosen or [fit])[0].fitted.error
        if new_port and len(chosen) < TERM_SEARCH_CRITERIA.max_leads and fit.fitted.error <= limit:
            chosen.append(fit)
    return chosen


def without_terms(base: FitResult, fit: AugmentedFit) -> FitResult:
    """The model without the terms, its parameters where the fit with them has left them."""
    n, with_terms = len(base.problem.free), len(fit.fitted.problem.free)
    return replace(base, z=np.concatenate([fit.fitted.z[:n], fit.fitted.z[with_terms:]]))


def with_exchanged_term(base: FitResult, lead: AugmentedFit, context: SearchContext) -> list[AugmentedFit]:
    """Sketches with other terms of its port in place of those of a fit.

    All terms are regressed again on the model without any, but with the parameters that the fit has led to: they are nearer
    to the true ones than those of a fit without a term.
    """
    context.on_progress(f'{lead.name}: error over noise {lead.fitted.error:.2f}; fitting other terms in its place')
    tempering = overdispersion(lead.fitted.problem, lead.fitted.z, context.pool)
    start, at = without_terms(base, lead), lead.terms[0].location
    terms = terms_at(start, tempering, context, (at.hook,))
    others = best_by_location([term for term in terms if term.location != at])
    chosen = [term for term in terms if term.location == at or term in others]  # neighbours of the lead are not limited
    return sketched_formulas(start, chosen[: TERM_SEARCH_CRITERIA.max_exchanged], context)


def with_second_term(best: AugmentedFit, context: SearchContext) -> list[AugmentedFit]:
    """Sketches with a second term at the same location, those that could add most to a fit."""
    context.on_progress(f'{best.name}: error over noise {best.fitted.error:.2f}; fitting second terms')
    fitted, location = best.fitted, best.terms[0].location
    tempering = overdispersion(fitted.problem, fitted.z, context.pool)
    terms = [term for term in terms_at(fitted, tempering, context, (location.hook,)) if term.location == location]
    return sketched_formulas(fitted, terms[: TERM_SEARCH_CRITERIA.max_second_terms], context, best.terms)
