"""The answer of a search: the models that have weight, and with which probability each component is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, log, pi

import numpy as np

from sma_sim.evidence.search.beam import Book
from sma_sim.evidence.search.bounded_integral import between_bounds
from sma_sim.evidence.search.refine import TIE, WINDOW, Model
from sma_sim.evidence.search.score import log_mean

EVEN = 0.5  # probability above which something is said
LEAST_PRECISION = 1e-9  # of what data do not see, over its range


@dataclass(frozen=True)
class Posterior:
    """The models within Occam's window of the best, the heaviest first, with their weights. These sum to 1 less what effects
    have that were not fitted beside them (`not_fitted`).

    `none`: that the nominal model lacks nothing; `unlisted`: that it lacks something which is no listed effect: a term of an
    equation, or what shows in the residuals only; `effects`: of every effect of these models, or effect in a scope, that it
    is there; `other`: that any other listed effect is, which these data would hardly show. `overdispersion`: that of the
    score.
    """

    models: tuple[Model, ...]
    weights: tuple[float, ...]
    none: float
    unlisted: float
    effects: Mapping[str, float]
    overdispersion: float
    other: float = 0.0  # of files of older versions

    @property
    def best(self) -> Model:
        """The heaviest model."""
        return self.models[0]

    def rivals(self, among: Sequence[Model], of: Model) -> list[Model]:
        """The models that are tied with one."""
        k = self.overdispersion
        return [model for model in among if model.names != of.names and of.score(k) - model.score(k) <= TIE]


def posterior_of(book: Book) -> Posterior:
    """Weights and probabilities of all models that were fitted, and of those with one effect more, to first order."""
    k, ranked = book.overdispersion, book.ranked()
    models = [model for model in ranked if model.score(k) >= ranked[0].score(k) - WINDOW]
    others = [(model, *one) for model in models for one in not_fitted(model, book).items()]
    scores = np.array([*(model.score(k) for model in models), *(score for _, _, score in others)])
    weights = np.exp(scores - scores.max())
    weights = weights / weights.sum()
    effects = {one.name: 0.0 for model in models for one in model.of_robot if not one.is_formula}
    none = unlisted = other = 0.0
    every = [*((model, '') for model in models), *((model, name) for model, name, _ in others)]
    for (model, more), weight in zip(every, weights.tolist(), strict=True):
        found = model.of_robot
        beside = 1.0 if any(one.is_formula for one in found) else model.unlisted
        unlisted += weight * beside
        none += 0.0 if found or more else weight * (1.0 - beside)
        other += weight if more and more not in effects else 0.0
        for name in effects.keys() & {more, *(one.name for one in found)}:
            effects[name] = min(1.0, effects[name] + weight)
    ordered = dict(sorted(effects.items(), key=lambda item: -item[1]))
    fitted = tuple(weights[: len(models)].tolist())
    return Posterior(tuple(models), fitted, min(1.0, none), min(1.0, unlisted), ordered, k, other)


def not_fitted(model: Model, book: Book) -> dict[str, float]:
    """By effect, the score of a model with it that was not fitted: to first order, with a strength that is as probable all
    over its realistic range; of those that were sketched at most that of the last one which was fitted. What tests promise
    is beside the model where it lay then, from which its fit may have come down since."""
    known, k = book.extended.get(model.key), book.overdispersion
    if known is None:
        return {}
    fitted = {name for names, _ in book.models if names > model.names for name in names - model.names}
    tested = [one for one in known.tested if one.lines and one.candidate.name not in fitted]
    if not tested:
        return {}
    slope, curvature, most = np.concatenate([np.array(one.lines) for one in tested]).T
    precision = np.maximum(curvature / k**2, LEAST_PRECISION / most**2)
    bayes, _, _ = between_bounds(-slope / k**2, precision, np.zeros(len(most)), most)
    bayes += 0.5 * log(2.0 * pi) - np.log(most)
    by_effect = np.split(bayes, np.cumsum([len(one.lines) for one in tested])[:-1])
    last = min((one.score(k) for one in book.beside(model) if one.components[-1].name in known.tried), default=inf)
    tested_at = model.score(k) - max(0.0, known.cost - model.fit.cost) / k**2
    scores = dict[str, float]()
    for one, own in zip(tested, by_effect, strict=True):
        score = tested_at + book.catalogue.log_prior(one.candidate) + log_mean(own.tolist())
        scores[one.candidate.name] = min(score, last) if one.candidate.name in known.tried else score
    return scores
