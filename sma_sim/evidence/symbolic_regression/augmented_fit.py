"""A model with terms of an equation added, their coefficients and shapes fitted together with its own parameters."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, replace
from threading import Event

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.free_parameters import FreeParameter
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.evidence.model_selection.refit import FitResult
from sma_sim.evidence.model_selection.tempered_likelihood import tempered_minimum
from sma_sim.evidence.symbolic_regression.term_fits import TermFit
from sma_sim.evidence.symbolic_regression.universal_term import any_term
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
POSITIVE = ('width', 'waves', 'pace', 'peaks', 'fixed')  # grids of shapes that are above zero: fitted as logarithms
FAR = 20.0  # coefficients may grow to so many times the first guess


@dataclass(frozen=True)
class AugmentedFit:
    """A fit with a formula of `guesses` (terms at one place), their values as fitted."""

    fitted: FitResult
    guesses: tuple[TermFit, ...]

    @property
    def name(self) -> str:
        """Place and terms."""
        return f'{self.guesses[0].place.name}: {" + ".join(one.term.name for one in self.guesses)}'


def free_of(guess: TermFit, effect: str) -> list[FreeParameter]:
    """The coefficient and the shapes of a term, centred where the guess is."""
    amount = abs(guess.amount)
    found = [FreeParameter(f'effects.{effect}.c', guess.amount, amount, -FAR, FAR, False, '')]
    for k, (shape, value, (low, high)) in enumerate(zip(guess.term.shapes, guess.shapes, guess.limits, strict=True)):
        name = f'effects.{effect}.q_{k}'
        if shape.grid in POSITIVE:
            found.append(FreeParameter(name, value, 0.5, 2.0 * np.log(low / value), 2.0 * np.log(high / value), True, ''))
        else:
            scale = 0.15 * (high - low)
            found.append(FreeParameter(name, value, scale, (low - value) / scale, (high - value) / scale, False, ''))
    return found


def joined(base: FitResult, guesses: tuple[TermFit, ...]) -> tuple[Problem, Vector]:
    """The problem with the terms, and where to start."""
    config, free = base.problem.config, list(base.problem.free)
    for copy, guess in enumerate(guesses):
        effect = any_term(guess.place.hook, bool(guess.term.rate), copy)
        config = with_effect(config, effect.found, effect.values(guess.place, guess.term, guess.amount, guess.shapes))
        free += free_of(guess, effect.found.effect.name)
    at = len(base.problem.free)
    z = np.concatenate([base.z[:at], np.zeros(len(free) - at), base.z[at:]])
    return replace(base.problem, config=config, free=tuple(free)), z


def grow(base: FitResult, k: float, guesses: tuple[TermFit, ...], pool: Executor, stop: Event) -> AugmentedFit | None:
    """The fit with the terms; None where the model cannot be run."""
    problem, z = joined(base, guesses)
    try:
        fitted = tempered_minimum(problem, z, k, pool, stop)
    except SimulationError:
        return None
    values, found = fitted.values, []
    for copy, guess in enumerate(guesses):
        prefix = f'effects.{any_term(guess.place.hook, bool(guess.term.rate), copy).found.effect.name}'
        shapes = tuple(values[f'{prefix}.q_{i}'] for i in range(len(guess.shapes)))
        found.append(replace(guess, amount=values[f'{prefix}.c'], shapes=shapes))
    return AugmentedFit(fitted, tuple(found))
