"""The answer of a search: the models that have weight, and with which probability each component is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sma_sim.evidence.search.beam import Book
from sma_sim.evidence.search.refine import TIE, WINDOW, Model

EVEN = 0.5  # probability above which something is said


@dataclass(frozen=True)
class Posterior:
    """The models within Occam's window of the best, the heaviest first, with their weights, which sum to 1.

    `none`: that the nominal model lacks nothing; `unlisted`: that it lacks something which is no listed effect: a term of an
    equation, or what shows in the residuals only; `effects`: of every listed effect, or effect in a scope, that it is there.
    `overdispersion`: that of the score.
    """

    models: tuple[Model, ...]
    weights: tuple[float, ...]
    none: float
    unlisted: float
    effects: Mapping[str, float]
    overdispersion: float

    @property
    def best(self) -> Model:
        """The heaviest model."""
        return self.models[0]

    def rivals(self, among: Sequence[Model], of: Model) -> list[Model]:
        """The models that are tied with one."""
        k = self.overdispersion
        return [model for model in among if model.names != of.names and of.score(k) - model.score(k) <= TIE]


def posterior_of(book: Book) -> Posterior:
    """Weights and probabilities of all models that were fitted."""
    k, ranked = book.overdispersion, book.ranked()
    scores = np.array([model.score(k) for model in ranked])
    inside = scores >= scores[0] - WINDOW
    weights = np.exp(scores[inside] - scores[0])
    weights = weights / weights.sum()
    models = [model for model, kept in zip(ranked, inside, strict=True) if kept]
    effects: dict[str, float] = {}
    none = unlisted = 0.0
    for model, weight in zip(models, weights.tolist(), strict=True):
        found = [one for one in model.components if not one.is_difference]
        beside = 1.0 if any(one.is_formula for one in found) else model.unlisted
        unlisted += weight * beside
        none += 0.0 if found else weight * (1.0 - beside)
        for name in {one.name for one in found if not one.is_formula}:
            effects[name] = min(1.0, effects.get(name, 0.0) + weight)
    ordered = dict(sorted(effects.items(), key=lambda item: -item[1]))
    return Posterior(tuple(models), tuple(weights.tolist()), min(1.0, none), min(1.0, unlisted), ordered, k)
