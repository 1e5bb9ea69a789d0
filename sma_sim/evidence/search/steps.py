"""The way from the nominal model to the best one, a component at a time, with what competed at each step."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import log

import numpy as np

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import FreeParameter
from sma_sim.evidence.estimation.plausibility import is_plausible
from sma_sim.evidence.estimation.problem import NormalEquations, accumulated
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.uncertainty import inverse_of_precision
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.search.beam import Book
from sma_sim.evidence.search.components import Component
from sma_sim.evidence.search.posterior import Posterior
from sma_sim.evidence.search.refine import Model, without
from sma_sim.model.effects.effect import Effect
from sma_sim.model.renamed import renamed

SHOWN = 8  # candidates of a step that are reported


@renamed(found='effect')
@dataclass(frozen=True)
class CandidateFit:
    """A listed effect beside the base of a step, fitted.

    `log_odds`: of the model with it against the base, priors included; `error_ratio`: fitted error with over without;
    `delta_bic`: with - without; `plausible`: whether its values are realistic; `std`: standard errors by full name (SI);
    `indistinguishable`: other candidates of the step whose odds are much the same.
    """

    effect: Effect
    fit: FitResult
    log_odds: float
    error_ratio: float
    delta_bic: float
    plausible: bool
    std: Mapping[str, float]
    indistinguishable: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name


@dataclass(frozen=True)
class SelectionStep:
    """The base of a step, the best of what was fitted beside it, what was taken (if anything), and the model with that."""

    base: FitResult
    candidate_fits: tuple[CandidateFit, ...]
    accepted: CandidateFit | None
    after: FitResult | None = None


def path_to(best: Model, book: Book, context: SearchContext) -> list[Model]:
    """Models with ever more components, from none to the best one: at each step the one that scores best is left."""
    path, k = [best], book.overdispersion
    while path[0].components:
        fewer = [
            model for component in path[0].components
            if (model := book.find(path[0].names - {component.name})) is not None
        ]  # fmt: skip
        if not fewer:
            found = [without(path[0], one, context) for one in path[0].components if not one.is_difference]
            fewer = book.add(found)
        path.insert(0, max(fewer, key=lambda model: model.score(k)) if fewer else book.ranked(0)[0])
    return path


def steps_along(path: Sequence[Model], book: Book, posterior: Posterior) -> tuple[SelectionStep, ...]:
    """The steps of a path; the last one takes nothing."""
    steps = []
    for model, after in zip(path, [*path[1:], None], strict=True):
        beside = [one for one in book.ranked(len(model.components) + 1) if model.names < one.names]
        by_name = {added(one, model).effect: one for one in reversed(beside) if is_listed(one, model)}
        listed = sorted(by_name.values(), key=lambda one: -one.score(posterior.overdispersion))
        taken = after if after is not None and is_listed(after, model) else None
        if taken is not None:
            listed = [one for one in listed if one.names != taken.names]
        chosen = [*([taken] if taken else []), *listed[: SHOWN - (taken is not None)]]
        tied = [[added(rival, model) for rival in posterior.rivals(chosen, one)] for one in chosen]
        if taken is not None:
            tied[0] = in_place_of(added(taken, model), path[-1], book, posterior)
        fits = [candidate_fit(one, model, rivals, posterior) for one, rivals in zip(chosen, tied, strict=True)]
        steps.append(SelectionStep(
            model.fit, tuple(fits), fits[0] if taken else None, None if after is None else after.fit
        ))  # fmt: skip
    return tuple(steps)


def in_place_of(component: Component, best: Model, book: Book, posterior: Posterior) -> list[Component]:
    """The listed effects that explain as well in place of one, beside all others of the best model: those that are tied with
    it, and those for which data speak no less, however much less probable their priors make them."""
    exchanged = [one for one in book.ranked(len(best.components)) if best.names - one.names == {component.name}]
    as_close = [one for one in exchanged if one.fit.squares <= best.fit.squares]
    tied = [*posterior.rivals(exchanged, best), *as_close]
    found = {one.effect: one for one in (added(model, best) for model in tied)}
    return [one for one in found.values() if not (one.is_formula or one.is_difference)]


def added(model: Model, base: Model) -> Component:
    """The component that a model has beside a base."""
    return next(one for one in model.components if one.name not in base.names)


def is_listed(model: Model, base: Model) -> bool:
    """Whether what a model has beside a base is a listed effect."""
    component = added(model, base)
    return not component.is_formula and not component.is_difference


def candidate_fit(model: Model, base: Model, rivals: Sequence[Component], posterior: Posterior) -> CandidateFit:
    """A model with one effect more compared with its base; `rivals` explain as well."""
    component, k = added(model, base), posterior.overdispersion
    assert isinstance(component.start, ScreeningResult)
    found = component.start.candidate.effect
    more = len(model.fit.problem.free) - len(base.fit.problem.free)
    delta_bic = 2.0 * (model.fit.cost - base.fit.cost) / k**2 + more * log(model.fit.problem.samples)
    return CandidateFit(
        found, model.fit, model.score(k) - base.score(k), model.fit.error / base.fit.error, delta_bic,
        is_plausible(found, model.fit.values_of(found.name)), standard_errors(model.fit, model.evidence.parts, k),
        tuple(dict.fromkeys(one.effect for one in rivals if one.effect)),
    )  # fmt: skip


def standard_errors(fit: FitResult, parts: Iterable[NormalEquations], k: float) -> dict[str, float]:
    """Standard deviations of the free parameters (SI) under an overdispersion k, from the normal equations of the runs; they
    are large where data tell nothing."""
    _, _, hessian = accumulated(parts, fit.z, k)
    std = k * np.sqrt(np.diag(inverse_of_precision(hessian)))
    return {p.name: std_of_value(p, float(z), float(s)) for p, z, s in zip(fit.problem.free, fit.z, std, strict=False)}


def std_of_value(parameter: FreeParameter, z: float, std: float) -> float:
    """A standard deviation in z as one of the value (SI)."""
    return (parameter.value(z) if parameter.log else 1.0) * parameter.scale * std
