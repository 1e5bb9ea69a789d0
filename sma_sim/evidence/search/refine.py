"""Fits of proposed models: sketched side by side, then fitted from several starts with several dampings.

The cost of a wrong start is a wrong verdict: it has valleys, and where a model that lacks an effect ends is often in none of
the true ones. Each model is fitted from where the model without the new component lies; from the middle of all priors with
what the score test found; and from the middle with every effect at its default, as a plain fit does, damped little and much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf

import numpy as np

from sma_sim.evidence.estimation.executors import run_in_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import refit
from sma_sim.evidence.estimation.problem import (
    Problem,
    at_defaults,
    own_values,
    start_point,
    with_own_unknowns,
)
from sma_sim.evidence.estimation.recording_differences import RecordingDifference
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.estimation.run_subset import on_all_runs, run_subset, to_subset
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import ADDED_EFFECT, FROM_PRIORS, SETTLED, WEAKLY_DAMPED, StopCriteria
from sma_sim.evidence.model_selection.model_changes import with_other_kinetics, without_effect
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.model_selection.sketches import at_prior_means, may_reach, sketched
from sma_sim.evidence.search.components import Component, log_prior_of
from sma_sim.evidence.search.score import Evidence, evidence_of, unlisted_probability
from sma_sim.model.arrays import Vector
from sma_sim.solver.simulate import SimulationError

SKETCHED, REFITTED, RESTARTED = 12, 5, 3  # proposals that are sketched, refitted, and fitted from further starts
SAME_VALLEY = 2.0  # costs that differ by less belong to one optimum
Start = tuple[Component, Problem, Vector, float]  # from a point, and the cost that a sketch has led to
WINDOW = 10.0  # nats behind the best beyond which a model has no weight (Occam's window; Madigan and Raftery 1994)
TIE = 5.0  # nats within which two models are said to be tied: the odds are below 150 to 1


@dataclass(frozen=True)
class Model:
    """A set of components, fitted: with what its score needs, how many of its starts led to the same optimum, and whether
    its fit has gone on to the end."""

    components: tuple[Component, ...]
    fit: FitResult
    evidence: Evidence
    starts: int = 1
    agreeing: int = 1
    is_settled: bool = False

    @property
    def names(self) -> frozenset[str]:
        """Of its components."""
        return frozenset(component.name for component in self.components)

    @property
    def of_robot(self) -> tuple[Component, ...]:
        """Its components that are of the robot: all but what differs between recordings."""
        return tuple(component for component in self.components if not component.is_difference)

    @property
    def key(self) -> tuple[frozenset[str], str]:
        """Components and kinetics."""
        return self.names, self.fit.problem.config.simulated_kinetics

    @property
    def leaves_nothing(self) -> bool:
        """Whether white noise explains what it leaves better than any smooth function does: no valley lies deeper."""
        return self.evidence.unlisted <= 0.0

    @property
    def unlisted(self) -> float:
        """The probability that something which no list has is left beside it."""
        return unlisted_probability(self.evidence)

    @property
    def lacks_unlisted(self) -> bool:
        """Whether that is more probable than not, so that an equation for it is worth its search."""
        return self.unlisted > 0.5

    def score(self, k: float, left_out: int | None = None) -> float:
        """The log posterior under an overdispersion k; without one run, if any.

        Evidence counts the optimum for k to second order. What derivatives promise beyond where a fit has ended may still be
        gained until that has gone on to the end; then it is none: where one event follows another, as transformation bands
        do, derivatives hold for steps too small to tell.
        """
        return self.evidence.score(k, left_out) - (self.evidence.gain(k) if self.is_settled else 0.0)

    def reach(self, k: float) -> float:
        """The cost from which on another model has no weight beside this one: twice the window, as volumes differ too."""
        return self.fit.cost + 2.0 * WINDOW * k**2


def model_of(components: Sequence[Component], fits: Sequence[FitResult | None], context: SearchContext) -> Model | None:
    """The best of several fits of one set of components; None where none could be made.

    A fit that ends where a component does nothing is one of the model without it.
    """
    ended = (fit for fit in fits if fit is not None and np.isfinite(fit.cost))
    whole = (fit for fit in ended if not any(component.is_absent(fit) for component in components))
    known = sorted(whole, key=lambda fit: fit.cost)
    for fit in known:
        try:
            evidence = evidence_of(fit, log_prior_of(components), context)
        except SimulationError:
            continue
        agreeing = sum(other.cost < fit.cost + SAME_VALLEY for other in known)
        return Model(tuple(components), fit, evidence, len(known), agreeing)
    return None


def better(model: Model, other: Model | None) -> Model:
    """Of two fits of one model the one of less cost, with the starts of both."""
    if other is None:
        return model
    first, second = sorted((model, other), key=lambda one: one.fit.cost)
    near = second.agreeing if second.fit.cost < first.fit.cost + SAME_VALLEY else 0
    return replace(first, starts=first.starts + second.starts, agreeing=first.agreeing + near)


def extended(
    parent: Model,
    components: Sequence[Component],
    context: SearchContext,
    reached: float = inf,
    target: float = inf,
) -> list[Model]:
    """The models with one component more, each fitted: those that sketches rank first, below the cost `reached`.

    Fits that fall too slowly to come down to the cost `target`, or near those before them, are given up; none is made where
    its sketch ended too far above (`may_reach`).
    """
    first = list[Model]()
    leading = best_by_sketch(parent.fit, components, context, reached, target)
    for group in (leading[:1], leading[1:]):  # the one after the other: what the first has reached tells which are hopeless
        limit = min([target, *(one.reach(one.evidence.overdispersion) for one in first)])
        hopeful = [start for start in group if may_reach(start[-1], limit)]
        jobs = [
            [partial(refit, problem, at, context, criteria_for(one), limit) for at in starts_of(one, problem, z)]
            for one, problem, z, _ in hopeful
        ]
        fits = iter(run_in_threads([job for of_one in jobs for job in of_one], context.stop))
        for (component, *_), of_one in zip(hopeful, jobs, strict=True):
            model = model_of((*parent.components, component), [next(fits) for _ in of_one], context)
            first += [] if model is None else [model]
    k = min((model.evidence.overdispersion for model in first), default=1.0)
    return sorted(first, key=lambda model: -model.score(k))


def further_fits(parent: Model, models: Sequence[Model], context: SearchContext, target: float = inf) -> list[Model | None]:
    """The best few of some models with one component more, fitted from the other starts, in their order, until one leaves
    nothing; not those that lie too far above the cost `target` (`may_reach`)."""
    found, fits = list[Model](), list[Model | None]()
    for model in models[:RESTARTED]:
        if context.stop.is_set() or any(one.leaves_nothing for one in (*found, model)):
            break
        if not may_reach(model.fit.cost, target):
            continue
        limit = min([target, model.fit.cost + SAME_VALLEY, *(one.fit.cost + WINDOW for one in found)])
        fits.append(model_of(model.components, restarted(parent.fit, model, limit, context), context))
        found.append(better(model, fits[-1]))
    return fits


def best_by_sketch(
    base: FitResult, components: Sequence[Component], context: SearchContext, reached: float, target: float
) -> list[Start]:
    """The components whose sketches end lowest, below a cost, and the first one, which promises most: a sketch may fail
    where a fit does not. Each with the problem and the point to start from."""
    effects = [(one, one.start) for one in components if isinstance(one.start, ScreeningResult)]
    sketches = sketched(base, [start for _, start in effects], context, min(reached, target), REFITTED)
    pairs = [(one, fit) for (one, _), fit in zip(effects, sketches, strict=True) if fit is not None and fit.cost < reached]
    ranked = sorted(pairs, key=lambda pair: pair[1].cost - pair[0].log_prior)
    first = [pair for pair in pairs[:1] if all(pair is not one for one in ranked[:REFITTED])]
    chosen: list[Start] = [(one, fit.problem, fit.z, fit.cost) for one, fit in (*ranked[:REFITTED], *first)]
    return chosen + [(one, *one.added_to(base), -inf) for one in components if one.is_difference]


def restarted(base: FitResult, model: Model, target: float, context: SearchContext) -> list[FitResult | None]:
    """Fits of a model from the other starts, given up where they fall too slowly to come down to the cost `target`."""
    component = model.components[-1]
    problem, z = component.added_to(at_prior_means(base))
    starts = [(z, WEAKLY_DAMPED)]
    if not component.is_difference:
        defaults = at_defaults(problem)
        starts += [(defaults, ADDED_EFFECT), (defaults, FROM_PRIORS)]
    return run_in_threads([partial(refit, problem, at, context, one, target) for at, one in starts], context.stop)


def from_priors(base: FitResult, model: Model, target: float, context: SearchContext) -> Model | None:
    """A model fitted from the middle of all priors, given up where that cannot come down to the cost `target`."""
    problem, _ = model.components[-1].added_to(at_prior_means(base))
    return model_of(model.components, [refit(problem, at_defaults(problem), context, FROM_PRIORS, target)], context)


def criteria_for(component: Component) -> StopCriteria:
    """How a model with one component more is fitted: beginnings have many unknowns, whose absence has bent all others."""
    return FROM_PRIORS if component.is_of_beginning else ADDED_EFFECT


def starts_of(component: Component, problem: Problem, z: Vector) -> list[Vector]:
    """Where a model with one component more is fitted from first: where it lies; of unknown beginnings also the middle of
    all priors: without them, parameters are far away."""
    return [z, start_point(problem)] if component.is_of_beginning else [z]


def in_other_kinetics(model: Model, fewer: Model | None, context: SearchContext) -> Model | None:
    """The same components with the other kinetics, from where it lies, and from the model in these that has one `fewer`;
    given up where they cannot come near."""  # fmt: skip
    problem, z = with_other_kinetics(model.fit)
    target = model.reach(model.evidence.overdispersion)
    jobs = [partial(refit, problem, z, context, criteria, target) for criteria in (ADDED_EFFECT, FROM_PRIORS)]
    if fewer is not None and model.components:
        jobs.append(partial(refit, *model.components[-1].added_to(fewer.fit), context, target=target))
    return model_of(model.components, run_in_threads(jobs, context.stop), context)


def settled(model: Model, k: float, context: SearchContext) -> Model | None:
    """The model where it is best under an overdispersion k: it is fitted again where it was fitted under another one, or not
    to the end, and would gain by that; None where a component does nothing there."""
    if model.evidence.gain(k) > SETTLED.min_decrease:
        fit = refit(replace(model.fit.problem, tempering=k), model.fit.z, context, SETTLED)
        found = model if fit is None else model_of(model.components, [fit], context)
        if found is None:
            return None
        model = found
    return replace(model, is_settled=True)


def without(model: Model, component: Component, context: SearchContext) -> Model | None:
    """The model without one of its effects, fitted again from where the whole one lies."""
    problem, z = without_effect(model.fit, component.effect)
    rest = tuple(one for one in model.components if one.name != component.name)
    return model_of(rest, [refit(problem, z, context)], context)


def without_difference(model: Model, component: Component, nominal: Problem) -> Model:
    """The model without one of the differences between its recordings, the rest of it as it was; with the runs of the
    `nominal` problem, which differ in nothing."""
    fit, problem = model.fit, model.fit.problem
    differences = tuple(one for one in problem.differences if one != component.start)
    smaller = replace(
        problem, differences=differences, runs=tuple(with_differences_in(run, differences) for run in nominal.runs)
    )
    rest = tuple(one for one in model.components if one.name != component.name)
    return replace(model, components=rest, fit=replace(fit, problem=smaller, z=with_own_unknowns(problem, fit.z, smaller)))


def on_run_subset(fit: FitResult) -> FitResult:
    """A fit on a part of many runs, on which a search is made."""
    subset = run_subset(fit.problem)
    if len(subset.runs) == len(fit.problem.runs):
        return fit
    return replace(fit, problem=subset, z=to_subset(fit.problem, fit.z))


def with_all_runs(model: Model, nominal: Sequence[FitResult], k: float, context: SearchContext) -> FitResult:
    """The fit of a model on all runs, with priors that count as an overdispersion k asks."""
    fit = model.fit
    start = next((one for one in nominal if one.problem.config.simulated_kinetics == model.key[1]), nominal[0])
    problem, z = fit.problem, fit.z
    if len(start.problem.runs) > len(problem.runs):
        problem, z = joined(fit, start)
    problem = replace(problem, tempering=k)
    if problem.runs is fit.problem.runs and k <= 1.0:
        return fit
    found = refit(problem, z, context)
    return fit if found is None or context.stop.is_set() else found


def joined(fit: FitResult, nominal: FitResult) -> tuple[Problem, Vector]:
    """The problem of a fit on all runs of a nominal one, and its start: what is of other runs is as it is there."""
    runs = tuple(with_differences_in(run, fit.problem.differences) for run in nominal.problem.runs)
    problem = replace(fit.problem, runs=runs)
    z = np.concatenate([fit.z[: len(problem.shared)], own_values(nominal.problem, nominal.z, problem)])
    return problem, on_all_runs(fit, problem, z)


def with_differences_in(run: FitData, differences: Sequence[RecordingDifference]) -> FitData:
    """A run with what differs between recordings."""
    for difference in differences:
        run = difference.in_run(run)
    return run
