"""Refits: a candidate effect fitted together with the model's own parameters, from what the screening found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from threading import Event

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.calibrate import run_in_threads
from sma_sim.evidence.estimation.cross_validation import cross_validated_error
from sma_sim.evidence.estimation.free_parameters import (
    FreeParameter,
    declared_parameters,
    default_names,
    free_parameter,
    values_of,
)
from sma_sim.evidence.estimation.levenberg_marquardt import (
    FIRST,
    LIGHTER,
    EarlyStopping,
    Stop,
    StopCriteria,
    accumulated,
    cost_at,
    minimize,
    normal_parts,
)
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.run_subset import of_all, of_part, part_of
from sma_sim.evidence.model_selection.candidates import Candidate, is_plausible, realistic_range
from sma_sim.evidence.model_selection.score_tests import Screened
from sma_sim.model.config import Config
from sma_sim.model.effects.discovery import ActiveEffect, FoundEffect
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
JOIN = StopCriteria(most=12, damping=10.0, enough=0.3, gain=1e-3, near=False)  # with a new effect, from the fit without
AHEAD = 2  # candidates that are refitted before the others, to the end
NEAR = 2.0  # of the least cost: others do not come down to it on a third way
EXPLAINED = 1.1  # error over noise of the fitted runs below which nothing more is looked for in them


@dataclass(frozen=True)
class FitResult:
    """A model at the optimum of its (thinned) training runs; `validated` is its error on runs left out in turn."""

    problem: Problem
    z: Vector
    cost: float
    validated: float = float('nan')

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the active effects, in the order in which they came."""
        return tuple(one.found.effect.name for one in self.problem.config.effects)

    @property
    def squares(self) -> float:
        """Sum of the squared residuals over noise, prior left out."""
        return max(2.0 * self.cost - float(self.z @ self.z), 0.0)

    @property
    def error(self) -> float:
        """sqrt of the mean square of the residuals over noise."""
        return float(np.sqrt(self.squares / self.problem.samples))

    @property
    def values(self) -> dict[str, float]:
        """The free parameters by name (SI)."""
        return self.problem.values(self.z)

    def values_of(self, effect: str) -> dict[str, float]:
        """The fitted parameters of one effect, by their short names."""
        prefix = f'effects.{effect}.'
        return {name.removeprefix(prefix): value for name, value in self.values.items() if name.startswith(prefix)}


def with_candidate(base: FitResult, screened: Screened) -> tuple[Problem, Vector]:
    """The problem with one more effect, and where to start: the fit without it and what the screening found."""
    found = screened.candidate.found
    effect, problem = found.effect, base.problem
    neutral = tuple(p.default if p.neutral is None else float(p.neutral) for p in effect.parameters)
    config = replace(problem.config, effects=(*problem.config.effects, ActiveEffect(found, neutral)))
    declared = declared_parameters(config)
    new, start = [], []
    for p, resting in zip(effect.parameters, neutral, strict=True):
        if p.name in screened.values:
            name = f'effects.{effect.name}.{p.name}'
            one = free_parameter(name, resting, declared[name])
            new.append(one)
            start.append(float(np.clip(one.coordinate(screened.values[p.name]), one.low, one.high)))
    at = len(problem.free)
    return (
        replace(problem, config=config, free=(*problem.free, *new)),
        np.concatenate([base.z[:at], start, base.z[at:]]),
    )


def out_of_reach(most: int, bar: float, costs: Sequence[float]) -> bool:
    """Whether a cost that falls as slowly as in the last of at most `most` steps cannot come down to `bar`."""
    before, last = costs[-2:]
    return (before - last) * (most - len(costs) + 1) < last - bar


def refit(
    problem: Problem, z: Vector, pool: Executor, stop: Stop, effort: StopCriteria = JOIN, bar: float = math.inf
) -> FitResult | None:
    """The optimum near z, or where the cost fell too slowly to reach `bar`; None where the model cannot be run there."""
    watch = EarlyStopping(stop, partial(out_of_reach, effort.most, bar))
    try:
        found = minimize(problem, z, pool, effort, watch, watch.progress)
    except SimulationError:
        return None
    return FitResult(problem, found.z, found.cost)


def on_all_runs(
    base: FitResult, candidates: Sequence[Screened], rough: Sequence[FitResult | None], most: int | None, pool: Executor,
    stop: Event,
) -> list[FitResult | None]:  # fmt: skip
    """The `most` best fits to a part of the runs continued on all of them, None for the others."""
    found: list[FitResult | None] = [None] * len(candidates)
    best = sorted(((one, k) for k, one in enumerate(rough) if one is not None), key=lambda pair: pair[0].cost)[:most]
    jobs = []
    for one, k in best:
        problem, z = with_candidate(base, candidates[k])
        jobs.append(partial(refit, problem, of_all(problem, z, one.z), pool, stop))
    for (_, k), fitted in zip(best, run_in_threads(jobs, stop) if jobs else [], strict=True):
        found[k] = fitted
    return found


def best_refits(
    base: FitResult, candidates: Sequence[Screened], pool: Executor, stop: Event, most: int | None = None
) -> list[FitResult | None]:
    """By candidate, as screened, the best of its refits: from the fit without the effect, and from the middle of all priors.

    A model that lacks an effect bends its other parameters far from their values; the way back is not always downhill. From
    the middle it goes down with much damping, and, where the best is near, with little, as either can end in a valley that
    the other passes by. Candidates that cannot come down to the best that was found before give up. Of many runs only a part
    is fitted at first; `most` candidates are then refitted to all.
    """
    part = part_of(base.problem)
    if len(part.runs) < len(base.problem.runs):
        few = replace(base, problem=part, z=of_part(base.problem, base.z))
        return on_all_runs(base, candidates, best_refits(few, candidates, pool, stop), most, pool, stop)
    joint = [with_candidate(base, one) for one in candidates]
    middle = [(problem, from_the_middle(base, z)) for problem, z in joint]
    best: list[FitResult | None] = [None] * len(joint)
    every = range(len(joint))
    for starts, effort, which in ((joint, JOIN, every[:AHEAD]), (joint, JOIN, every[AHEAD:]), (middle, FIRST, every),
                                  (middle, LIGHTER, every)):  # fmt: skip
        bar = least_cost(best, candidates)
        chosen = [k for k in which if effort is not LIGHTER or is_near(best[k], bar)]
        jobs = [partial(refit, *starts[k], pool, stop, effort, bar) for k in chosen]
        for k, found in zip(chosen, run_in_threads(jobs, stop) if jobs else [], strict=True):
            best[k] = min((one for one in (best[k], found) if one), key=lambda one: one.cost, default=None)
    return best


def further_in(candidate: Candidate, screened: Screened | None) -> Screened:
    """A candidate with its strengths at least a probe's step from nothing, to the side that the screening found, if any."""
    family = candidate.families[len(candidate.families) // 2]
    values = dict(family[0].shape) | (dict(screened.values) if screened else {})
    for probe in family:
        away = values.get(probe.parameter, probe.neutral) - probe.neutral
        if away == 0.0 or (away * probe.step > 0.0 and abs(away) < abs(probe.step)):
            values[probe.parameter] = probe.neutral + probe.step
    chance = screened.family_p if screened else 1.0
    return Screened(candidate, screened.gain if screened else 0.0, values, chance)


def quick_refits(
    base: FitResult, candidates: Sequence[Screened], fall: float, pool: Executor, stop: Event
) -> list[Screened]:  # fmt: skip
    """The candidates that take this part of the cost away (of a part of many runs), best first, where they end."""
    few = replace(base, problem=part_of(base.problem), z=of_part(base.problem, base.z))
    bar = (1.0 - fall) * cost_at(few.problem, few.z, pool)
    jobs = [partial(refit, *with_candidate(few, one), pool, stop, JOIN, bar) for one in candidates]
    fits = run_in_threads(jobs, stop) if jobs else []
    down = [(one, fit) for one, fit in zip(candidates, fits, strict=True) if fit is not None and fit.cost <= bar]
    down.sort(key=lambda pair: pair[1].cost)
    return [replace(one, values=fit.values_of(one.candidate.name)) for one, fit in down]


def least_cost(fits: Sequence[FitResult | None], candidates: Sequence[Screened]) -> float:
    """Of those with plausible values; inf without any."""
    return min(
        (one.cost for one, screened in zip(fits, candidates, strict=True)
         if one is not None and plausible(one, screened.candidate.found)), default=math.inf,
    )  # fmt: skip


def is_near(one: FitResult | None, bar: float) -> bool:
    """Whether another way down may decide between a candidate and the best, or none explains what is there."""
    return one is None or one.cost <= NEAR * bar or bar > 0.5 * EXPLAINED**2 * one.problem.samples


def from_the_middle(base: FitResult, z: Vector) -> Vector:
    """All model parameters at the middle of their priors; the new effect and what belongs to runs as they are."""
    fresh = z.copy()
    fresh[: len(base.problem.free)] = 0.0
    return fresh


def validated(one: FitResult, pool: Executor, stop: Event) -> FitResult:
    """With its error on runs left out in turn (NaN for a single run, and where that was stopped)."""
    try:
        error = cross_validated_error(one.problem, one.z, pool, stop) if not stop.is_set() else float('nan')
    except SimulationError:
        error = float('inf')
    return replace(one, validated=float('nan') if stop.is_set() else error)


def within(one: FitResult, found: FoundEffect) -> tuple[Problem, Vector]:
    """The problem with the parameters of one effect kept in their realistic ranges, and the nearest point there."""
    ranges = {f'effects.{found.effect.name}.{p.name}': realistic_range(p) for p in found.effect.parameters}
    free = tuple(limited(p, ranges.get(p.name)) for p in one.problem.free)
    problem = replace(one.problem, free=free)
    return problem, np.clip(one.z, *problem.limits())


def limited(free: FreeParameter, between: tuple[float, float] | None) -> FreeParameter:
    """A free parameter with narrower bounds (SI), if any; a logarithmic one has no coordinate of zero."""
    if between is None:
        return free
    low, high = (free.coordinate(value) if value > 0.0 or not free.log else free.low for value in between)
    return replace(free, low=max(free.low, low), high=min(free.high, high))


def without(one: FitResult, effect: str) -> tuple[Problem, Vector]:
    """The problem without one of its effects, and the rest of z as it was."""
    prefix = f'effects.{effect}.'
    kept = [k for k, p in enumerate(one.problem.free) if not p.name.startswith(prefix)]
    free = tuple(one.problem.free[k] for k in kept)
    config: Config = one.problem.config
    fewer = tuple(active for active in config.effects if active.found.effect.name != effect)
    problem = replace(one.problem, config=replace(config, effects=fewer), free=free)
    rest = np.arange(len(one.problem.free), len(one.z))
    return problem, one.z[[*kept, *rest]]


def other_kinetics(one: FitResult) -> tuple[Problem, Vector]:
    """The same problem with the other model of kinetics, and z carried over by name."""
    problem = one.problem
    model = 'mas' if problem.config.model == 'hybrid' else 'hybrid'
    config = replace(problem.config, model=model)
    names = [*default_names(config), *(p.name for p in problem.free if p.name.startswith('effects.'))]
    known = dict(zip([p.name for p in problem.free], zip(problem.free, one.z, strict=False), strict=True))
    declared, values = declared_parameters(config), values_of(config)
    free = [known[name][0] if name in known else free_parameter(name, values[name], declared[name]) for name in names]
    start = [float(known[name][1]) if name in known else 0.0 for name in names]
    return replace(problem, config=config, free=tuple(free)), np.array([*start, *one.z[len(problem.free) :]])


def standard_errors(one: FitResult, pool: Executor) -> dict[str, float]:
    """Standard deviations of the free parameters (SI) from the Hessian, widened by the size of the residuals."""
    _, _, hessian = accumulated(normal_parts(one.problem, one.z, pool), one.z)
    spread = np.sqrt(np.diag(np.linalg.inv(hessian))) * max(1.0, one.error)
    return {p.name: spread_of(p, float(z), float(s)) for p, z, s in zip(one.problem.free, one.z, spread, strict=False)}


def spread_of(parameter: FreeParameter, z: float, std: float) -> float:
    """A standard deviation in z as one of the value (SI)."""
    return (parameter.value(z) if parameter.log else 1.0) * parameter.scale * std


def plausible(one: FitResult, found: FoundEffect) -> bool:
    """Whether the fitted values of an effect lie in their realistic ranges."""
    return is_plausible(found, one.values_of(found.effect.name))


def bayesian_gain(base: FitResult, one: FitResult) -> float:
    """Difference of the Bayesian information criterion, with minus without: negative is better."""
    more = len(one.problem.free) - len(base.problem.free)
    return 2.0 * (one.cost - base.cost) + more * float(np.log(one.problem.samples))
