"""A model with terms of an equation added, their coefficients and shapes fitted together with its own parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import FreeParameter
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.evidence.model_selection.tempered_likelihood import tempered_minimum
from sma_sim.evidence.symbolic_regression.term_fits import TermFit
from sma_sim.evidence.symbolic_regression.universal_term import universal_term
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
POSITIVE_GRIDS = ('width', 'wavenumber', 'time_constant', 'frequency', 'fixed')  # shapes that are fitted as logarithms
MAX_COEFFICIENT_RATIO = 20.0  # to the linear estimate: beyond it the regression did not see the term
PRIOR_WIDTH = 0.15  # of a shape, as a fraction of its realistic range: a step of the grid


@dataclass(frozen=True)
class AugmentedFit:
    """A fit with a formula of some terms at one location, their values as fitted."""

    fitted: FitResult
    terms: tuple[TermFit, ...]

    @property
    def name(self) -> str:
        """Location and terms."""
        return f'{self.terms[0].location.name}: {" + ".join(fit.term.name for fit in self.terms)}'


def free_parameters_of(fit: TermFit, effect: str) -> list[FreeParameter]:
    """The coefficient and the shapes of a term, their priors centred at the linear estimate."""
    size, ratio = abs(fit.coefficient), MAX_COEFFICIENT_RATIO
    free = [FreeParameter(f'effects.{effect}.c', fit.coefficient, size, -ratio, ratio, False, '')]
    for k, (shape, value, (low, high)) in enumerate(zip(fit.term.shapes, fit.shapes, fit.limits, strict=True)):
        name = f'effects.{effect}.q_{k}'
        if shape.grid in POSITIVE_GRIDS:
            free.append(FreeParameter(name, value, 0.5, 2.0 * np.log(low / value), 2.0 * np.log(high / value), True, ''))
        else:
            scale = PRIOR_WIDTH * (high - low)
            free.append(FreeParameter(name, value, scale, (low - value) / scale, (high - value) / scale, False, ''))
    return free


def augmented_problem(base: FitResult, terms: tuple[TermFit, ...]) -> tuple[Problem, Vector]:
    """The problem with the terms, and where to start."""
    config, free = base.problem.config, list(base.problem.free)
    for copy, fit in enumerate(terms):
        effect = universal_term(fit.location.hook, bool(fit.term.rate), config.structure, copy)
        config = with_effect(config, effect.found, effect.values(fit.location, fit.term, fit.coefficient, fit.shapes))
        free += free_parameters_of(fit, effect.found.effect.name)
    at = len(base.problem.free)
    z = np.concatenate([base.z[:at], np.zeros(len(free) - at), base.z[at:]])
    return replace(base.problem, config=config, free=tuple(free)), z


def fit_with_terms(
    base: FitResult, tempering: float, terms: tuple[TermFit, ...], context: SearchContext
) -> AugmentedFit | None:
    """The fit with the terms, at a factor on the noise variance; None where the model cannot be run."""
    problem, z = augmented_problem(base, terms)
    try:
        fitted = tempered_minimum(problem, z, tempering, context)
    except SimulationError:
        return None
    values, refitted = fitted.values, []
    for copy, fit in enumerate(terms):
        effect = universal_term(fit.location.hook, bool(fit.term.rate), problem.config.structure, copy)
        prefix = f'effects.{effect.found.effect.name}'
        shapes = tuple(values[f'{prefix}.q_{k}'] for k in range(len(fit.shapes)))
        refitted.append(replace(fit, coefficient=values[f'{prefix}.c'], shapes=shapes))
    return AugmentedFit(fitted, tuple(refitted))
