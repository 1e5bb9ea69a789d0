"""Why two effects cannot be told apart: how similar their responses are, once each was fitted with everything else."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from math import isnan

import numpy as np

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.problem import residuals_at
from sma_sim.evidence.search.steps import SelectionStep
from sma_sim.model.arrays import Vector
from sma_sim.model.effects.effect import Effect


@dataclass(frozen=True)
class Confounding:
    """An effect beside the accepted one.

    `cosine`: of what the two refitted models change in the channels (over noise) against the model without either, that is
    of the responses with all that the fit can absorb taken out; NaN where one changes nothing. `rms_difference`: root mean
    square of the difference of the two refitted models, over noise. `known`: the effects list each other as confused.
    """

    name: str
    cosine: float
    rms_difference: float
    known: bool

    def __str__(self) -> str:
        words = f'fitted with everything else, it and {self.name} differ by {self.rms_difference:.2g} times the noise'
        if self.cosine == self.cosine:
            words += f', and what they explain has the same shape (cosine {self.cosine:.3f})'
        return words + ('; their equations leave nearly the same signature' if self.known else '')


def confoundings(step: SelectionStep, pool: Executor) -> tuple[Confounding, ...]:
    """The accepted effect of a step beside all that explain as well."""
    accepted = step.accepted
    if accepted is None or not accepted.indistinguishable:
        return ()
    base, first = response(step.base, pool), response(accepted.fit, pool)
    found = []
    for other in step.candidate_fits:
        if other.name in accepted.indistinguishable:
            second = response(other.fit, pool)
            rms_difference = float(np.sqrt(np.mean((first - second) ** 2)))
            known = accepted.name in other.effect.confused_with or other.name in accepted.effect.confused_with
            found.append(Confounding(other.name, cosine(first - base, second - base), rms_difference, known))
    return tuple(found)


@dataclass(frozen=True)
class SimilarEffect:
    """A listed effect whose response, refitted with everything else, is most like that of another explanation."""

    effect: Effect
    cosine: float


def most_similar(fit: FitResult, first: SelectionStep, pool: Executor) -> SimilarEffect | None:
    """Of the candidates of a step, the one with the signature that is most like that of a fit to the same runs."""
    base, proposed = response(first.base, pool), response(fit, pool)
    others = [(candidate.effect, response(candidate.fit, pool)) for candidate in first.candidate_fits]
    found = [
        SimilarEffect(effect, cosine(proposed - base, other - base))
        for effect, other in others
        if base.shape == proposed.shape == other.shape  # else a run could not be made
    ]
    return max((one for one in found if not isnan(one.cosine)), key=lambda one: one.cosine, default=None)


def response(fit: FitResult, pool: Executor) -> Vector:
    """What the model shows in all runs, over noise, but for what was measured (which is the same for all models)."""
    shown = residuals_at(fit.problem, fit.z, pool)
    return np.concatenate([residuals.ravel() for residuals in shown if residuals is not None])


def cosine(a: Vector, b: Vector) -> float:
    """Cosine of the angle between two changes."""
    sizes = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / sizes if sizes > 0.0 else float('nan')
