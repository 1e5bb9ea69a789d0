"""The least-squares problem of a fit: its unknowns, and at a point its residuals, cost, derivatives and normal equations.

The Jacobian of thirty runs would not fit into memory at once: each run's part is added to the normal equations as it
arrives. The prior, one in every coordinate, keeps them well conditioned.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from functools import partial
from math import exp
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.executors import PickledConfig, in_turn, workers_of
from sma_sim.evidence.estimation.free_parameters import FreeParameter
from sma_sim.evidence.estimation.recording_differences import LATE_COMMANDS, RecordingDifference
from sma_sim.evidence.estimation.residuals import LATENESS, FitData, Nuisance, residuals_of_all, with_states
from sma_sim.evidence.estimation.run_tangents import TangentTask, linearized_by_tangents, tangents_apply
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.config import Config
from sma_sim.model.effects.ports import PORT_NAMES, SENSING
from sma_sim.solver.beginning import Beginning
from sma_sim.solver.sensitivities import DELTA
from sma_sim.solver.simulate import SimulationError

Reduced = TypeVar('Reduced')
QuadraticModel = tuple[float, Vector, Matrix]  # cost, gradient, Gauss-Newton Hessian
DEFAULT_STEP = 0.02  # of differences, in standard deviations of the priors
MIN_STEP, MAX_STEP = 1e-6, 0.02  # of differences, in standard deviations of the priors
MAX_RUN_STEP = 0.005  # of a start: a MAS wire leaves the neighbourhood of sigma_A at once, so curvature is high there
CURVATURE = 4.0  # each derivative relative to the one before, in z
SOLVER_ERROR = 40.0  # of a sample, in units of its noise and of solver.rtol (docs/explanation/calibration.md)
DELAY = FreeParameter('delay', 0.0, 0.05, -10.0, 100.0, False, 's')
START = FreeParameter('start', 0.5, 0.5, -1.0, 1.0, False, '-')
AMBIENT = FreeParameter('ambient', 0.0, 1.0, -5.0, 5.0, False, 'K')  # in standard deviations of the recording's prior
# What is left of a motion before a recording (`Beginning`), in standard deviations of the recording's prior.
WARMTH = FreeParameter('warmth', 0.0, 1.0, 0.0, 6.0, False, '-')
MOTION = FreeParameter('motion', 0.0, 1.0, -6.0, 6.0, False, '-')  # of each further kind, by the name of that
MEDIAN_WARMTH = 0.6745  # of its prior, half a normal one
SWITCH = FreeParameter('switch', 0.5, 0.288675, -1.73, 1.73, False, '-')  # uniform in the interval: its mean and std
POWER = FreeParameter('power', 0.0, 0.288675, -1.73, 1.73, False, '-')  # of a rounding step, uniform in it
FACTOR = FreeParameter('factor', 0.0, 1.0, -5.0, 5.0, False, '-')  # its logarithm, in stds of its prior, by its parameter
HUBER_CORNER = 3.0  # residual, in units of the noise, from which a robust loss grows linearly


@dataclass(frozen=True)
class Problem:
    """Runs and the parameters that are free; with `delay` [s] given the delay is not.

    `nominal_effects`: names of effects that the model has from the start of a search, which are no findings.

    The unknowns z (n,): free parameters, delay, then per run its starts (one per wire), switching fractions and, where these
    are not known, its ambient temperature, its powers, parameters that vary and what is left of a motion before it.
    `differences`: what was found to differ between the recordings.
    `tempering`: overdispersion k of a model that is known to be wrong; the priors count k^2 times, as if squares were less.
    `delay_range`: of the delay, in z. `material`: of the wires, as it was given, for which values are plausible.
    """

    config: Config
    runs: tuple[FitData, ...]
    free: tuple[FreeParameter, ...]
    robust: bool = False
    delay: float | None = None
    nominal_effects: tuple[str, ...] = ()
    differences: tuple[RecordingDifference, ...] = ()
    tempering: float = 1.0
    delay_range: tuple[float, float] = (DELAY.low, DELAY.high)
    material: str = ''

    @property
    def shared(self) -> tuple[FreeParameter, ...]:
        """The unknowns of all runs together."""
        if self.delay is not None:
            return self.free
        low, high = self.delay_range
        return (*self.free, replace(DELAY, low=low, high=high))

    def own(self, run: FitData) -> tuple[FreeParameter, ...]:
        """The unknowns of one run."""
        at_rest = (START,) * run.starts + (SWITCH,) * run.groups + (AMBIENT,) * (run.ambient_std > 0.0)
        at_rest += (POWER,) * len(run.rounded_to) + tuple(map(factor_of, run.varied))
        kinds = (kind for kind, stds in self.beginning_std(run).parts.items() for _ in stds)
        return at_rest + tuple(WARMTH if kind == WARMTH.name else replace(MOTION, name=kind) for kind in kinds)

    def beginning_std(self, run: FitData) -> Beginning:
        """The priors of what is left of a motion before a run, of the states of this model's effects too: of the last of its
        own unknowns, in the order of their `values`."""
        return run.beginning_std if run.beginning_std.is_at_rest else with_states(run, self.config)

    def places(self, run: FitData, unknown: FreeParameter) -> list[int]:
        """Where the unknowns of a kind are among those of one run, after the shared ones."""
        return [len(self.shared) + k for k, one in enumerate(self.own(run)) if one.name == unknown.name]

    @property
    def unknowns(self) -> tuple[FreeParameter, ...]:
        """All unknowns in the order of z."""
        return self.shared + tuple(unknown for run in self.runs for unknown in self.own(run))

    def indices(self) -> list[NDArray[np.int64]]:
        """Per run, the indices of its unknowns in z: the shared ones, then its own."""
        shared, found, at = np.arange(len(self.shared)), [], len(self.shared)
        for run in self.runs:
            count = len(self.own(run))
            found.append(np.concatenate([shared, np.arange(at, at + count)]))
            at += count
        return found

    def limits(self) -> tuple[Vector, Vector]:
        """Bounds of z."""
        unknowns = self.unknowns
        return np.array([unknown.low for unknown in unknowns]), np.array([unknown.high for unknown in unknowns])

    def values(self, z: Vector) -> dict[str, float]:
        """The free parameters by name (SI)."""
        return {free.name: free.value(float(x)) for free, x in zip(self.free, z, strict=False)}

    def fitted(self, z: Vector) -> Config:
        """The configuration with the free parameters at z."""
        return self.config.variant(self.values(z))

    def nuisance(self, run: FitData, part: Vector) -> Nuisance:
        """What z says about one run; `part` are its unknowns."""
        shared = len(self.shared)
        first, last = shared + run.starts, shared + run.starts + run.groups
        start = tuple(START.value(float(x)) for x in part[shared:first])
        switches = tuple(SWITCH.value(float(x)) for x in part[first:last])
        end = last + (run.ambient_std > 0.0)
        ambient = run.ambient_std * float(part[last:end].sum())
        known, end = end, end + len(run.rounded_to)
        steps = zip(part[known:end].tolist(), run.rounded_to.tolist(), strict=True)
        powers = tuple(POWER.value(x) * step for x, step in steps)
        varied, end = part[end : end + len(run.varied)].tolist(), end + len(run.varied)
        factors = tuple((name, exp(std * x)) for (name, std), x in zip(run.varied.items(), varied, strict=True))
        beginning = run.known_beginning
        if run.is_in_motion:
            stds = self.beginning_std(run)
            beginning = stds.with_values(std * x for std, x in zip(stds.values, part[end:].tolist(), strict=True))
        delay = 0.0 if run.is_quasi_static else self.delay_at(part)
        return Nuisance(delay, start, switches, run.is_quasi_static, ambient, beginning, powers, factors)

    def delay_at(self, z: Vector) -> float:
        """The delay [s]."""
        return self.delay if self.delay is not None else DELAY.value(float(z[len(self.free)]))

    def weighted(self, factor: float) -> Problem:
        """The same with all weights multiplied."""
        return replace(self, runs=tuple(replace(run, weight=factor * run.weight) for run in self.runs))

    @property
    def has_tangents(self) -> bool:
        """Whether all runs have tangents, as far as their structures say."""
        return all(tangents_apply(self.config, run) for run in self.runs)

    @property
    def samples(self) -> int:
        """Measured values that count."""
        return sum(run.samples for run in self.runs)

    @property
    def derivative_bytes(self) -> int:
        """What the derivatives of all runs take in memory."""
        return sum(8 * len(at) * run.measured.size for run, at in zip(self.runs, self.indices(), strict=True))

    @property
    def is_isobaric(self) -> bool:
        """Whether all runs are isobaric tests, whose strain was measured."""
        return all(run.is_quasi_static and 'strain' in run.channels for run in self.runs)

    def at_tolerance(self, rtol: float) -> Problem:
        """The same with another solver.rtol."""
        return replace(self, config=self.config.variant({'solver.rtol': rtol}))


def factor_of(parameter: str) -> FreeParameter:
    """The unknown by which a parameter is another one in a recording."""
    return replace(FACTOR, name=f'{FACTOR.name} of {parameter}')


def values_in_order(known: Sequence[FreeParameter], values: Vector, asked: Sequence[FreeParameter]) -> Vector:
    """The values (n,) of some unknowns of one run, from those of other ones; 0 of what is not among them."""
    return np.append(values, 0.0)[places_among(known, asked)]


def places_among(known: Sequence[FreeParameter], asked: Sequence[FreeParameter]) -> list[int]:
    """Where unknowns of one run are among other ones, the first of a kind where the first of that is; behind all of what is
    not among them."""
    by_kind = {one.name: iter([k for k, other in enumerate(known) if other.name == one.name]) for one in known}
    return [next(by_kind.get(one.name, iter(())), len(known)) for one in asked]


def with_own_unknowns(problem: Problem, z: Vector, other: Problem) -> Vector:
    """The point z of a problem as another one has it, whose runs, the same, have other unknowns of their own: what is new at
    0. Commands that may be late are so by half of what is possible there, which the delay makes up for."""
    later = LATE_COMMANDS in other.differences, LATE_COMMANDS in problem.differences
    found = np.concatenate([z[: len(problem.shared)], own_values(problem, z, other)])
    if later[0] != later[1]:
        found[[k for k, one in enumerate(other.unknowns) if one.name == SWITCH.name]] = 0.0
        if problem.delay is None:
            found[len(problem.free)] += (0.5 if later[0] else -0.5) * LATENESS / DELAY.scale
    return found


def own_values(problem: Problem, z: Vector, other: Problem) -> Vector:
    """What z says of each run alone, as another problem of the same runs has it: what is new at 0."""
    pairs, shared = zip(problem.runs, problem.indices(), other.runs, strict=True), len(problem.shared)
    own = [values_in_order(problem.own(run), z[at[shared:]], other.own(there)) for run, at, there in pairs]
    return np.concatenate([np.zeros(0), *own])


def with_difference(problem: Problem, z: Vector, difference: RecordingDifference) -> tuple[Problem, Vector]:
    """The problem whose recordings differ in one thing more, and z with its unknowns at 0."""
    runs = tuple(difference.in_run(run) for run in problem.runs)
    differing = replace(problem, runs=runs, differences=(*problem.differences, difference))
    return differing, with_own_unknowns(problem, z, differing)


@dataclass(frozen=True)
class EvaluationTask:
    """One run at several points: configurations and nuisances."""

    run: FitData
    points: tuple[tuple[PickledConfig, Nuisance], ...]


def evaluate(task: EvaluationTask) -> list[Matrix | None]:
    """Weighted residuals (channels, k) at each point; None where the model cannot be run."""
    return reduced_at_points(task, lambda residuals: residuals)


def reduced_at_points(task: EvaluationTask, reduce: Callable[[Matrix], Reduced]) -> list[Reduced | None]:
    """What `reduce` makes of the weighted residuals (channels, k) at each point; None where the model cannot be run.

    Points that differ in what sensors show alone share a run.
    """
    alike = defaultdict[Any, list[int]](list)
    for k, (pickled, nuisance) in enumerate(task.points):
        alike[what_runs(pickled.config), nuisance].append(k)
    found: list[Reduced | None] = [None] * len(task.points)
    for (_, nuisance), points in alike.items():
        try:
            models = [task.points[k][0].model(task.run.bench, factors=nuisance.factors) for k in points]
            for k, residuals in zip(points, residuals_of_all(models, task.run, nuisance), strict=True):
                found[k] = reduce(residuals) if np.isfinite(residuals).all() else None
        except SimulationError:
            continue
    return found


def what_runs(config: Config) -> Hashable:
    """What makes the run of a configuration: all but effects that only show, unless they move the states of a sensor."""
    effects = [active.effect for active in config.effects]
    has_memory = any(effect.port == PORT_NAMES[SENSING] and effect.states for effect in effects)
    acting = (active for active in config.effects if has_memory or not active.effect.only_shows)
    return config.simulated_kinetics, tuple(config.parameters.items()), tuple(acting)


@dataclass(frozen=True)
class LinearizedRun:
    """One run linearised: residuals (channels, k) and their derivatives (unknowns of the run, channels, k) in z.

    `indices`: where the run's unknowns are in z. `correction` (channels, k): what the residuals are more than those of a run
    under the smoothed command; None where that is not smoothed.
    """

    indices: NDArray[np.int64]
    residuals: Matrix
    jacobian: NDArray[np.float64]
    correction: Matrix | None = None


def near(problem: Problem, corrections: Sequence[Matrix | None]) -> Problem:
    """The problem near a point at which its runs have these corrections (`LinearizedRun`): all runs under smoothed commands,
    for a part of the time."""
    if all(one is None for one in corrections):
        return problem
    pairs = zip(problem.runs, corrections, strict=True)
    return replace(problem, runs=tuple(replace(run, correction=correction) for run, correction in pairs))


def near_point(problem: Problem, z: Vector, executor: Executor) -> Problem:
    """The problem near z (`near`), by one run row by row and one under the smoothed command of each that may be smoothed."""
    zero = [None if run.leeway is None else np.zeros_like(run.measured) for run in problem.runs]
    if all(one is None for one in zero):
        return problem
    pairs = zip(residuals_at(problem, z, executor), residuals_at(near(problem, zero), z, executor), strict=True)
    return near(problem, [None if exact is None or smooth is None else exact - smooth for exact, smooth in pairs])


def residuals_at(problem: Problem, z: Vector, executor: Executor) -> list[Matrix | None]:
    """Weighted residuals of every run."""
    return list(residuals_under(problem, z, [problem.fitted(z)], executor)[0])


def residuals_under(
    problem: Problem, z: Vector, configs: Sequence[Config], executor: Executor
) -> list[tuple[Matrix | None, ...]]:
    """By configuration, the weighted residuals of every run with what z says of the runs."""
    pickled = [PickledConfig(config) for config in configs]
    count = min(len(configs), pieces_by_run(problem, executor))
    submitted = []
    for run, indices in zip(problem.runs, problem.indices(), strict=True):
        nuisance = problem.nuisance(run, z[indices])
        points = [(config, nuisance) for config in pickled]
        tasks = [EvaluationTask(run, tuple(points[k::count])) for k in range(count)]
        submitted.append([executor.submit(evaluate, task) for task in tasks])
    return list(zip(*(gathered(futures, len(configs)) for futures in submitted), strict=True))


def pieces_by_run(problem: Problem, executor: Executor) -> int:
    """Into how many tasks the points of one run are dealt out, so that all workers are busy."""
    return max(1, -(-2 * workers_of(executor) // len(problem.runs)))


def change_of(shown: Sequence[Matrix | None], base: Sequence[Matrix | None]) -> Vector | None:
    """The change (N,) of the residuals of all runs from those of a base; None where a run of either cannot be made."""
    pairs = zip(shown, base, strict=True)
    changes = [(there - here).ravel() for there, here in pairs if there is not None and here is not None]
    return np.concatenate(changes) if len(changes) == len(base) else None


def linearize(
    problem: Problem, z: Vector, executor: Executor, steps: Vector | None = None, central: bool = False
) -> list[LinearizedRun]:
    """Every run linearised at z: by tangents of its run, where it has none by differences. Raises SimulationError.

    Differences are one-sided or `central`; `steps` (n,) are theirs (None: DEFAULT_STEP). Bounds are kept.
    """
    return list(linearized_in_turn(problem, z, executor, steps, central))


def linearized_in_turn(
    problem: Problem, z: Vector, executor: Executor, steps: Vector | None = None, central: bool = False
) -> Iterator[LinearizedRun]:
    """As `linearize`, one run after the other: derivatives of many runs would not fit into the memory at once."""
    return reduced_in_turn(problem, z, executor, unreduced, steps, central)


def unreduced(_: FitData, run: LinearizedRun) -> LinearizedRun:
    """All of it."""
    return run


def reduced_in_turn(
    problem: Problem,
    z: Vector,
    executor: Executor,
    reduce: Callable[[FitData, LinearizedRun], Reduced],
    steps: Vector | None = None,
    central: bool = False,
) -> Iterator[Reduced]:
    """What `reduce`, which can be sent to another process, makes of every run linearised at z, one after the other.

    It is called where the run is made: derivatives of a run take megabytes, which would travel and wait.
    """
    indices, config = problem.indices(), PickledConfig(problem.fitted(z))
    has_tangents = [tangents_apply(config.config, run) for run in problem.runs]
    points = z + DELTA * np.eye(len(problem.free), len(z))  # each free parameter in turn moved, which all runs share
    moved = [PickledConfig(problem.fitted(point)) for point in points] if any(has_tangents) else []
    tasks = [
        (at, tangent_task(problem, z, run, at, config, moved))
        for run, at, applies in zip(problem.runs, indices, has_tangents, strict=True)
        if applies
    ]
    by_tangents = in_turn(executor, partial(reduced_by_tangents, reduce=reduce), tasks)
    for run, at, applies in zip(problem.runs, indices, has_tangents, strict=True):
        found = next(by_tangents) if applies else None
        if found is not None:
            yield found
        else:
            own = replace(problem, runs=(run,))
            (other,) = linearize_by_differences(own, z[at], executor, steps if steps is None else steps[at], central)
            yield reduce(run, replace(other, indices=at))


def reduced_by_tangents(
    job: tuple[NDArray[np.int64], TangentTask], reduce: Callable[[FitData, LinearizedRun], Reduced]
) -> Reduced | None:
    """What `reduce` makes of a run linearised by its tangents, its unknowns at these indices; None where it has none."""
    at, task = job
    found = linearized_by_tangents(task)
    return None if found is None else reduce(task.run, LinearizedRun(at, *found))


def tangent_task(
    problem: Problem,
    z: Vector,
    run: FitData,
    indices: NDArray[np.int64],
    config: PickledConfig,
    moved: Sequence[PickledConfig],
) -> TangentTask:
    """What linearises one run at z, `config` being that at z, and `moved` those beside it."""
    part, (low, high), free = z[indices], problem.limits(), len(problem.free)
    nuisances = [problem.nuisance(run, at) for at in part + DELTA * np.eye(len(part))]
    configs = (*moved, *[config] * (len(part) - free))
    return TangentTask(
        run,
        (config, problem.nuisance(run, part)),
        tuple(zip(configs, nuisances, strict=True)),
        free if problem.delay is None else -1,
        DELAY.scale,
        tuple(np.flatnonzero(low[indices] == high[indices]).tolist()),
        differences_apart(problem, part, run),
    )


def differences_apart(
    problem: Problem, part: Vector, run: FitData
) -> tuple[tuple[int, float, PickledConfig, Nuisance], ...]:
    """Unknowns without tangents, and how far each is moved to where.

    They are parameters of effects at their lower bounds, where a tangent may see nothing of an effect that is switched off.
    """
    steps = {
        j: min(part[j] + DEFAULT_STEP, free.high) if part[j] < free.high else free.low  # bounds may be close
        for j, free in enumerate(problem.free)
        if free.name.startswith('effects.') and free.low < free.high and part[j] < free.low + DEFAULT_STEP
    }
    found = []
    for j, there in steps.items():
        at = part.copy()
        at[j] = there
        found.append((j, float(at[j] - part[j]), PickledConfig(problem.fitted(at)), problem.nuisance(run, at)))
    return tuple(found)


def linearize_by_differences(
    problem: Problem, z: Vector, executor: Executor, steps: Vector | None = None, central: bool = False
) -> list[LinearizedRun]:
    """Every run linearised at z by one-sided (or central) differences; bounds are kept. Raises SimulationError.

    `steps` (n,) are those of the differences (None: DEFAULT_STEP).
    """
    low, high = problem.limits()
    steps = np.full(len(z), DEFAULT_STEP) if steps is None else steps
    pieces = pieces_by_run(problem, executor)
    submitted = []
    for run, indices in zip(problem.runs, problem.indices(), strict=True):
        part = z[indices]
        moves = difference_points(part, low[indices], high[indices], steps[indices], central)
        points = [(PickledConfig(problem.fitted(at)), problem.nuisance(run, at)) for at in [part, *(at for _, at in moves)]]
        chunks = [points[k::pieces] for k in range(pieces)]
        futures = [executor.submit(evaluate, EvaluationTask(run, tuple(chunk))) for chunk in chunks if chunk]
        submitted.append((run, indices, moves, futures, len(points)))
    return [
        assembled(run, z[indices], indices, moves, gathered(futures, count))
        for run, indices, moves, futures, count in submitted
    ]


def gathered(futures: Sequence[Future[list[Matrix | None]]], count: int) -> list[Matrix | None]:
    """Results of dealt-out points in their order."""
    found: list[Matrix | None] = [None] * count
    for k, future in enumerate(futures):
        found[k :: len(futures)] = future.result()
    return found


def difference_points(part: Vector, low: Vector, high: Vector, steps: Vector, central: bool) -> list[tuple[int, Vector]]:
    """Which unknown is moved, and to where."""
    moves = []
    for j in range(len(part)):
        for sign in (1.0, -1.0) if central else (1.0,) if part[j] + steps[j] <= high[j] else (-1.0,):
            at = part.copy()
            at[j] = min(max(part[j] + sign * steps[j], low[j]), high[j])
            if at[j] != part[j]:
                moves.append((j, at))
    return moves


def own_derivatives(
    problem: Problem, z: Vector, own: Sequence[int], base: Sequence[Matrix | None], executor: Executor
) -> list[NDArray[np.float64] | None]:
    """By run, the derivatives (own, channels, k) at z in free parameters, by differences away from their upper bounds;
    `base`: the residuals there. Zero where the model cannot be run beside z, None where not at z.
    """
    high = problem.limits()[1]
    steps = [DEFAULT_STEP if z[k] + DEFAULT_STEP <= high[k] else -DEFAULT_STEP for k in own]
    moved = [z + step * (np.arange(len(z)) == k) for k, step in zip(own, steps, strict=True)]
    responses = residuals_under(problem, z, [problem.fitted(at) for at in moved], executor)
    found: list[NDArray[np.float64] | None] = []
    for j, here in enumerate(base):
        if here is None:
            found.append(None)
            continue
        rows = np.zeros((len(own), *here.shape))
        for row, k, at, there in zip(rows, own, moved, (response[j] for response in responses), strict=True):
            row[:] = 0.0 if there is None else (there - here) / (at[k] - z[k])
        found.append(rows)
    return found


def assembled(
    run: FitData,
    part: Vector,
    indices: NDArray[np.int64],
    moves: Sequence[tuple[int, Vector]],
    found: Sequence[Matrix | None],
) -> LinearizedRun:
    """Difference quotients from the residuals at the points of one run."""
    base = found[0]
    if base is None:
        raise SimulationError(f'{run.name}: the model cannot be run with these parameters')
    ends: list[list[tuple[float, Matrix]]] = [[] for _ in part]
    for (j, at), residuals in zip(moves, found[1:], strict=True):
        if residuals is not None:
            ends[j].append((float(at[j] - part[j]), residuals))
    jacobian = np.zeros((len(part), *base.shape))
    for j, sides in enumerate(ends):
        if len(sides) == 2:
            jacobian[j] = (sides[0][1] - sides[1][1]) / (sides[0][0] - sides[1][0])
        elif sides:
            jacobian[j] = (sides[0][1] - base) / sides[0][0]
    return LinearizedRun(indices, base, jacobian)


def start_point(problem: Problem, guess: Vector | None = None) -> Vector:
    """A point at the middle of the priors, within the bounds."""
    low, high = problem.limits()
    middle = [MEDIAN_WARMTH if one.name == WARMTH.name else 0.0 for one in problem.unknowns]
    return np.clip(middle if guess is None else guess, low, high)


def at_defaults(problem: Problem) -> Vector:
    """The middle of all priors, with the effects that were added at their defaults: where a fit begins that asks for them.

    Their shapes have several optima; from the model without them the way may lead to a worse one.
    """
    added = [one.effect for one in problem.config.effects if one.effect.name not in problem.nominal_effects]
    defaults = {f'effects.{effect.name}.{p.name}': p.default for effect in added for p in effect.parameters}
    return with_values(problem, start_point(problem), defaults)


def with_values(problem: Problem, z: Vector, values: Mapping[str, float]) -> Vector:
    """A point z (n,) with free parameters at some values (SI), by name, or at the bounds beyond which these lie."""
    found = z.copy()
    for k, free in enumerate(problem.free):
        if free.name in values:
            found[k] = np.clip(free.coordinate(values[free.name]), free.low, free.high)
    return found


@dataclass(frozen=True)
class NormalEquations:
    """One run's part of the normal equations: cost (half the sum of squares), gradient, Gauss-Newton Hessian.

    `indices`: where the run's unknowns are in z; `correction`: as of a LinearizedRun.
    """

    indices: NDArray[np.int64]
    cost: float
    gradient: Vector
    hessian: Matrix
    correction: Matrix | None = None


def robust_cost(residuals: Matrix, robust: bool) -> float:
    """Half the sum of squares, or of Huber's function with its corner at HUBER_CORNER."""
    if not robust:
        return 0.5 * float(np.vdot(residuals, residuals))
    size = np.abs(residuals)
    return float(np.where(size <= HUBER_CORNER, 0.5 * size**2, HUBER_CORNER * (size - 0.5 * HUBER_CORNER)).sum())


def robust_weights(residuals: Matrix) -> Matrix:
    """Square roots of the weights that make Huber's function a weighted sum of squares."""
    return np.sqrt(np.minimum(1.0, HUBER_CORNER / np.maximum(np.abs(residuals), 1e-300)))


def normal_equations(linear: LinearizedRun, robust: bool) -> NormalEquations:
    """The normal equations of one run."""
    jacobian = linear.jacobian.reshape(len(linear.indices), linear.residuals.size)
    residuals = linear.residuals.ravel()
    cost = robust_cost(residuals, robust)
    if robust:
        weights = robust_weights(residuals)
        jacobian, residuals = jacobian * weights, residuals * weights
    return NormalEquations(linear.indices, cost, jacobian @ residuals, jacobian @ jacobian.T, linear.correction)


def accumulated(parts: Iterable[NormalEquations], z: Vector, tempering: float) -> QuadraticModel:
    """Cost, gradient and Hessian of all runs and of the prior, a standard normal one in z; `tempering` as in a Problem."""
    prior = tempering**2
    cost, gradient, hessian = 0.5 * prior * float(z @ z), prior * z, prior * np.eye(len(z))
    for part in parts:
        cost += part.cost
        gradient[part.indices] += part.gradient
        hessian[np.ix_(part.indices, part.indices)] += part.hessian
    return cost, gradient, hessian


def cost_at(problem: Problem, z: Vector, executor: Executor) -> float:
    """The cost with the prior; inf where the model cannot be run."""
    return costs_at(problem, [z], executor)[0]


def costs_at(problem: Problem, points: Sequence[Vector], executor: Executor) -> list[float]:
    """The cost at each of several points (n,); inf where the model cannot be run."""
    configs = [PickledConfig(problem.fitted(z)) for z in points]
    tasks = [
        EvaluationTask(run, tuple((config, problem.nuisance(run, z[at])) for config, z in zip(configs, points, strict=True)))
        for run, at in zip(problem.runs, problem.indices(), strict=True)
    ]
    priors = [0.5 * problem.tempering**2 * float(z @ z) for z in points]
    by_run = in_turn(executor, partial(run_costs, robust=problem.robust), tasks)  # residuals would not fit into the memory
    return list(np.sum([priors, *by_run], axis=0).tolist())


def run_costs(task: EvaluationTask, robust: bool) -> list[float]:
    """The cost of one run at each point; inf where the model cannot be run."""
    costs = reduced_at_points(task, partial(robust_cost, robust=robust))  # residuals of all points would fill the memory
    return [np.inf if cost is None else cost for cost in costs]


def cost_of(problem: Problem, by_run: Sequence[Matrix | None], z: Vector) -> float:
    """The cost of the residuals of all runs and of the prior; inf where a run could not be made."""
    total = 0.5 * problem.tempering**2 * float(z @ z)
    for residuals in by_run:
        if residuals is None:
            return np.inf
        total += robust_cost(residuals, problem.robust)
    return total


def normal_parts(
    problem: Problem, z: Vector, executor: Executor, steps: Vector | None = None, central: bool = False
) -> Iterator[NormalEquations]:
    """The normal equations of every run at z, one after the other."""
    return reduced_in_turn(problem, z, executor, partial(equations_of_run, robust=problem.robust), steps, central)


def equations_of_run(_: FitData, linear: LinearizedRun, robust: bool) -> NormalEquations:
    """The normal equations of one run, where it is made."""
    return normal_equations(linear, robust)


def measured_steps(problem: Problem, z: Vector, executor: Executor) -> Vector | None:
    """Steps of central differences that suit the neighbourhood of z, from one-sided differences.

    None where tangents take their place.
    """
    if problem.has_tangents:
        return None
    return better_steps(problem, accumulated(normal_parts(problem, z, executor), z, problem.tempering)[2], central=True)


def better_steps(problem: Problem, hessian: Matrix, central: bool) -> Vector:
    """Difference steps from the (data's) Gauss-Newton Hessian of a linearisation.

    With e the solver's error, s the sensitivity and b the CURVATURE, one-sided differences are wrong by e/h + s b h/2,
    central ones by e/h + s b^2 h^2/6: the steps are where that is least.
    """
    error = SOLVER_ERROR * problem.config.parameters['solver.rtol']
    sensitivity = np.sqrt(np.maximum(np.diag(hessian), 1e-300) / max(1, problem.samples))
    ratio = error / sensitivity
    best = np.cbrt(3.0 * ratio / CURVATURE**2) if central else np.sqrt(2.0 * ratio / CURVATURE)
    most = np.where(np.arange(len(best)) < len(problem.shared), MAX_STEP, MAX_RUN_STEP)
    return np.clip(best, MIN_STEP, most)


def quadratic_model(problem: Problem, linear: Iterable[LinearizedRun], z: Vector) -> QuadraticModel:
    """Cost, gradient and Hessian at z from linearised runs."""
    return accumulated((normal_equations(run, problem.robust) for run in linear), z, problem.tempering)


def feasible(problem: Problem, z: Vector, executor: Executor) -> bool:
    """Whether every run can be made at z."""
    try:
        return bool(np.isfinite(cost_at(problem, z, executor)))
    except SimulationError:
        return False
