"""A model with terms of an equation added, their coefficients and shapes fitted together with its own parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import ADDED_EFFECT
from sma_sim.evidence.model_selection.candidates import Candidate
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.model_selection.sketches import sketches_from
from sma_sim.evidence.symbolic_regression.formula import Formula
from sma_sim.evidence.symbolic_regression.term_fits import TermFit
from sma_sim.evidence.symbolic_regression.universal_term import universal_term
from sma_sim.model.structures.discovery import FoundStructure


@dataclass(frozen=True)
class AugmentedFit:
    """A fit with a formula of some terms at one location, their values as fitted."""

    fitted: FitResult
    terms: tuple[TermFit, ...]

    @property
    def name(self) -> str:
        """Location and terms."""
        return f'{self.terms[0].location.name}: {" + ".join(fit.term.name for fit in self.terms)}'


def as_candidate(fit: TermFit, on: FoundStructure, copy: int = 0) -> ScreeningResult:
    """A term as a candidate of the selection: an effect that is that term, with the coefficient and shapes that it has.

    It shares the kernels of its port (`universal_term`), so that no term compiles anything. `on`: what it acts on, `copy`:
    of several terms.
    """
    universal = universal_term(fit.location.hook, bool(fit.term.rate), on, copy)
    values = universal.values(fit.location, fit.term, fit.coefficient, fit.shapes)
    names = ['c', *(f'q_{k}' for k in range(len(fit.shapes)))]
    declared = {name: replace(p, name=name) for name, p in zip(names, Formula((fit,), on.structure).parameters, strict=True)}
    effect = universal.found.effect
    parameters = tuple(declared.get(p.name, replace(p, default=values.get(p.name, p.default))) for p in effect.parameters)
    found = replace(universal.found, effect=replace(effect, parameters=parameters), plain=universal.found)
    return ScreeningResult(Candidate(found, ()), fit.error_reduction, {name: values[name] for name in declared}, 1.0)


def sketched_formulas(
    start: FitResult, terms: Sequence[TermFit], context: SearchContext, before: tuple[TermFit, ...] = ()
) -> list[AugmentedFit]:
    """Sketches of the fits with each of some terms, beside those `before` which the start has; those that can be run."""
    candidates = [as_candidate(term, start.problem.config.structure, len(before)) for term in terms]
    sketches = sketches_from(start, ADDED_EFFECT.damping, candidates, context)
    return [
        AugmentedFit(fitted, tuple(as_fitted(term, copy, fitted) for copy, term in enumerate((*before, term))))
        for term, fitted in zip(terms, sketches, strict=True) if fitted is not None
    ]  # fmt: skip


def as_fitted(fit: TermFit, copy: int, fitted: FitResult) -> TermFit:
    """A term with the values that a fit has found."""
    universal = universal_term(fit.location.hook, bool(fit.term.rate), fitted.problem.config.structure, copy)
    values = fitted.values_of(universal.found.effect.name)
    shapes = tuple(values[f'q_{k}'] for k in range(len(fit.shapes)))
    return replace(fit, coefficient=values['c'], shapes=shapes)
