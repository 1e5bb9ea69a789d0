"""Why two effects cannot be told apart: how alike what they change is, once each was fitted with everything else."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.problem import residuals_at
from sma_sim.evidence.model_selection.forward_selection import SelectionStep
from sma_sim.evidence.model_selection.refit import FitResult
from sma_sim.model.effects.effect import Effect

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Confounding:
    """An effect beside the accepted one.

    `cosine`: of what the two refitted models change in the channels (over noise) against the model without either, that is
    of the responses with all that the fit can absorb taken out; NaN where one changes nothing. `apart`: root mean square
    of the difference of the two refitted models, over noise. `known`: the effects themselves say that they are confused.
    """

    name: str
    cosine: float
    apart: float
    known: bool

    def __str__(self) -> str:
        words = f'fitted with everything else, it and {self.name} differ by {self.apart:.2g} times the noise'
        if self.cosine == self.cosine:
            words += f', and what they explain has the same shape (cosine {self.cosine:.3f})'
        return words + ('; their equations leave nearly the same signature' if self.known else '')


def confoundings(one: SelectionStep, pool: Executor) -> tuple[Confounding, ...]:
    """The accepted effect of a round beside all that explain alike."""
    accepted = one.accepted
    if accepted is None or not accepted.indistinguishable:
        return ()
    bare, first = response(one.base, pool), response(accepted.fitted, pool)
    found = []
    for other in one.tried:
        if other.name in accepted.indistinguishable:
            second = response(other.fitted, pool)
            apart = float(np.sqrt(np.mean((first - second) ** 2)))
            known = is_known(accepted.found.effect, other.found.effect)
            found.append(Confounding(other.name, cosine(first - bare, second - bare), apart, known))
    return tuple(found)


def response(one: FitResult, pool: Executor) -> Vector:
    """What the model shows in all runs, over noise, but for what was measured (which is the same for all models)."""
    shown = residuals_at(one.problem, one.z, pool)
    return np.concatenate([residuals.ravel() for residuals in shown if residuals is not None])


def cosine(a: Vector, b: Vector) -> float:
    """Cosine of the angle between two changes."""
    sizes = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / sizes if sizes > 0.0 else float('nan')


def is_known(one: Effect, other: Effect) -> bool:
    """Whether one of two effects is said to be confused with the other."""
    return other.name in one.confused_with or one.name in other.confused_with
