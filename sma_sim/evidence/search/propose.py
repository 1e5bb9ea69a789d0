"""Proposals: which components a model may lack, by what they promise to first order at a finite step.

A score test (`score_tests`) says by how much the squares S would fall. Of the score that is S/2 less, plus the log prior:
what promises less than nothing is not tried. What has no slope at neutral (friction, slack, dead bands) is stepped to.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from math import inf

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.overdispersion import overdispersion
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.candidates import Candidate
from sma_sim.evidence.model_selection.differing_recordings import promises
from sma_sim.evidence.model_selection.score_tests import ScoreTests, ScreeningResult, at_finite_step, screen
from sma_sim.evidence.model_selection.variants import forms_of
from sma_sim.evidence.search.components import Catalogue, Component, difference_component, log_prior_of
from sma_sim.evidence.search.prior import formula_log_prior
from sma_sim.evidence.search.refine import Model
from sma_sim.evidence.symbolic_regression.formula import Formula, as_candidate
from sma_sim.evidence.symbolic_regression.term_fits import terms_at
from sma_sim.solver.simulate import SimulationError

SKETCHED_TERMS = 24  # of equations, twice as many as effects: of ten times as many as these, neighbours are alike
MARGIN = 3.0  # nats by which a fit may gain more than the first order promises: it moves shapes too


@dataclass(frozen=True)
class Proposal:
    """A component for a model, and by how much it promises to raise its score."""

    component: Component
    promise: float


@dataclass(frozen=True)
class InPlace:
    """What may stand in place of a component, and what that promises itself (`own`); 0 where nothing tells it."""

    others: Sequence[Proposal]
    own: float


def listed(tests: ScoreTests, catalogue: Catalogue, taken: Collection[str]) -> list[Proposal]:
    """Effects and their scopes by what they promise beside the fit of some score tests; those of effects `taken` left out,
    and none where the model cannot be linearised."""
    try:
        screened = tests.beside(allowed(catalogue, taken))
    except SimulationError:
        return []
    return of_effects(screened, catalogue)


def in_place(
    tests: ScoreTests, catalogue: Catalogue, component: Component, base: Model, worth: float
) -> tuple[InPlace, ...]:
    """The same in place of a component of the model whose fit was tested; `base`: the model without it. Beside what that
    leaves; and to first order where the whole model lies, which tells more where the component changes much: it is `worth`
    so many squares. None where a model cannot be linearised."""
    candidates = allowed(catalogue, {one.plain_name for one in base.components})
    try:
        screened = tests.in_place(base.fit.problem, base.fit.z, candidates)
        tangent, gain = tests.in_tangent(base.fit.problem, candidates, worth)
    except SimulationError:
        return (InPlace((), 0.0),)
    beside = of_effects(screened, catalogue)
    own = next((one.promise for one in beside if one.component.name == component.name), 0.0)
    in_tangent = InPlace(of_effects(tangent, catalogue), 0.5 * gain + component.log_prior)
    return InPlace(beside, own), in_tangent


def allowed(catalogue: Catalogue, taken: Collection[str]) -> list[Candidate]:
    """The candidates but those of some effects."""
    return [one for one in catalogue.candidates if one.effect.plain_name not in taken]


def of_effects(screened: Iterable[ScreeningResult], catalogue: Catalogue) -> list[Proposal]:
    """What candidates promise, the best first."""
    return promising(
        Proposal(component, 0.5 * result.gain + component.log_prior)
        for result in screened for component in (catalogue.component(result),)
    )  # fmt: skip


def stepped(
    catalogue: Catalogue, tried: Collection[str], taken: Collection[str], candidates: Iterable[Candidate]
) -> list[Component]:
    """Components a finite step away from neutral, of those that a score test has passed over."""
    return [
        catalogue.component(at_finite_step(one)) for one in candidates
        if one.name not in tried and one.effect.plain_name not in taken
    ]  # fmt: skip


def at_port_of(law: Component, catalogue: Catalogue, best: Model) -> list[Component]:
    """Effects, and their scopes, at the port of one of the effects of a model, a finite step away from neutral; without
    what the model has already."""
    ports = {one.effect.plain_name: one.effect.port for one in catalogue.candidates}
    others = {one.plain_name for one in best.components} - {law.plain_name}
    there = (one for one in allowed(catalogue, others) if one.effect.port == ports.get(law.plain_name))
    return [catalogue.component(at_finite_step(one)) for one in there if one.name != law.name]


def differing(base: FitResult, taken: Collection[str], context: SearchContext) -> list[Proposal]:
    """What may differ between the recordings, where these are in the order of time; of a single one, how it begins."""
    problem = base.problem
    if any(run.starts == 0 for run in problem.runs):
        return []
    found = [(difference_component(one, problem), gain) for one, gain in promises(problem, base.z, context).items()]
    return promising(
        Proposal(component, 0.5 * gain + component.log_prior) for component, gain in found if component.name not in taken
    )


def promise_of(components: Sequence[Component], base: FitResult, context: SearchContext) -> float:
    """What some effects promise beside a fit, each alone; -inf where the model cannot be linearised."""
    starts = [one.start.candidate for one in components if isinstance(one.start, ScreeningResult)]
    try:
        screened = screen(base.problem, base.z, starts, context.pool)
    except SimulationError:
        return -inf
    return sum(0.5 * result.gain for result in screened) + log_prior_of(components)


def terms(base: FitResult, context: SearchContext, timed: bool = True, first: Component | None = None) -> list[Proposal]:
    """The best terms of an equation at every place, SKETCHED_TERMS of them, or second ones where a `first` is; none where a
    model cannot be linearised.

    `timed`: also functions of time. In place of effects of the robot's states which leave nothing, one of these would have
    to go as the states do in every run.
    """
    structure = base.problem.config.structure
    known = None if first is None else first.term
    try:
        k = overdispersion(base.problem, base.z, context.pool)
        fits = terms_at(base, k, context, (known.location.hook,) if known else (), timed)
    except SimulationError:
        return []
    if known is not None:
        fits = [fit for fit in fits if fit.location == known.location and fit.term != known.term]
    places = len({fit.location.name for fit in fits})
    priors = [formula_log_prior(len(fit.location.terms), places) for fit in fits]
    promises = [0.5 * k**2 * fit.error_reduction + log_prior for fit, log_prior in zip(fits, priors, strict=True)]
    best = sorted(zip(promises, priors, fits, strict=True), key=lambda one: -one[0])[:SKETCHED_TERMS]
    return promising(
        Proposal(Component(Formula((fit,), structure).name, log_prior, candidate, fit), promise)
        for promise, log_prior, fit in best for candidate in (as_candidate(fit, structure, int(known is not None)),)
    )  # fmt: skip


def forms(model: Model, catalogue: Catalogue, context: SearchContext) -> list[tuple[Component, Component]]:
    """Of the listed effects of a model, each with another form of its law that may stand in place of it, the best first."""
    active = {one.effect.name: one.effect for one in model.fit.config.effects}
    laws = [one for one in model.components if one.effect and not one.is_formula]
    candidates = {law.name: forms_of(active[law.effect]) for law in laws}
    every = [one for some in candidates.values() for one in some]
    try:
        screened = screen(model.fit.problem, model.fit.z, every, context.pool) if every else ()
    except SimulationError:
        return []
    found = list[tuple[Component, Proposal]]()
    for law in laws:
        for result in (one for one in screened if one.candidate.effect.plain_name == law.plain_name):
            form = catalogue.form(result, law, len(candidates[law.name]), model.fit)
            found.append((law, Proposal(form, 0.5 * result.gain + form.log_prior - law.log_prior)))
    return [(law, one.component) for law, one in sorted(found, key=lambda pair: -pair[1].promise) if one.promise > -MARGIN]


def promising(proposals: Iterable[Proposal]) -> list[Proposal]:
    """Those that promise about as much as they cost, or more, the best first."""
    return sorted((one for one in proposals if one.promise > -MARGIN), key=lambda one: -one.promise)
