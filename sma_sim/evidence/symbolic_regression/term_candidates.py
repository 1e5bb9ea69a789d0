"""A term of an equation as an effect that a model may lack, and with the values that a fit of that model has found."""

from __future__ import annotations

from dataclasses import replace

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.model_selection.candidates import Candidate
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.symbolic_regression.formula import Formula
from sma_sim.evidence.symbolic_regression.term_fits import TermFit
from sma_sim.evidence.symbolic_regression.universal_term import universal_term
from sma_sim.model.structures.discovery import FoundStructure


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
    return ScreeningResult(Candidate(found, ()), fit.error_reduction, {name: values[name] for name in declared})


def as_fitted(fit: TermFit, effect: str, fitted: FitResult) -> TermFit:
    """A term with the values that a fit has found, in which `effect` is the term."""
    values = fitted.values_of(effect)
    shapes = tuple(values[f'q_{k}'] for k in range(len(fit.shapes)))
    return replace(fit, coefficient=values['c'], shapes=shapes)
