"""What every term of every port could explain of residuals: weak-form regression on responses of the simulator.

A column of the regression is the change of all predicted channels by a finite amount of a term, less what the fitted
parameters, starts and delay absorb of it (as in the screening of effects). No measurement is differentiated. Shapes
(thresholds, widths, time constants) are those of a grid; they are fitted later, with the parameters of the model.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from math import inf

import numpy as np

from sma_sim.evidence.estimation.executors import run_in_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.problem import (
    LinearizedRun,
    Problem,
    change_of,
    linearize,
    measured_steps,
    near,
    residuals_under,
)
from sma_sim.evidence.estimation.projection import Projection
from sma_sim.evidence.estimation.search_context import SearchContext, Stop
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.evidence.symbolic_regression.locations import EVERY_WIRE, Location, locations_for
from sma_sim.evidence.symbolic_regression.response_basis import by_combination, by_product, follows_slow_states
from sma_sim.evidence.symbolic_regression.terms import ShapeParameter, Term
from sma_sim.evidence.symbolic_regression.universal_term import universal_term
from sma_sim.evidence.symbolic_regression.visited_states import ModelRuns, VisitedStates, term_values
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config

RESPONSE_RTOL = 1e-4  # solver.rtol of the responses: both sides of each difference have it
TRIED = 0.1  # of a small but visible quantity: over all of it responses bend, where parameters absorb most of what is linear
AT_ONCE = 64  # responses that are projected
EXACT_TERMS = 100  # of the best whose own responses are simulated: combinations, and responses that are not linear, misorder
# Cost grows with their product.
THRESHOLDS_PER_RANGE, INSTANTS_PER_RUN, TIME_CONSTANTS_PER_RUN, MAX_FREQUENCIES = 9, 19, 7, 6
WIDTH_FRACTIONS = (0.06, 0.15, 0.35)  # of the visited range
PERIODS_PER_RANGE = np.arange(1.5, 10.1, 0.5)  # within the visited range
PHASES = (0.0, 0.25 * math.pi, 0.5 * math.pi, 0.75 * math.pi)
MIN_PERIODS = 2.0  # within a run, of an oscillation: what did not come again may be anything that happened once
MAX_PERIODS = 60.0  # of those that are tried
MIN_TIME_CONSTANT = 0.01  # fraction of a run
MIN_RELATIVE_RANGE = 1e-6  # range of a variable, relative to its size, below which it counts as constant
TRIMMED_PERCENT = 1.0  # of the samples, at either end of a range


@dataclass(frozen=True)
class TermTrial:
    """A term with its shapes and a trial value of its coefficient."""

    term: Term
    shapes: tuple[float, ...]
    coefficient: float


@dataclass(frozen=True)
class TermFit:
    """One term at one location with its `shapes` and `coefficient`; `error_reduction`: of the squared residuals.

    `limits`: the realistic range of each shape; `tried`: the coefficient with which its response was simulated.
    """

    location: Location
    term: Term
    shapes: tuple[float, ...]
    coefficient: float
    error_reduction: float
    limits: tuple[tuple[float, float], ...]
    tried: float = 0.0

    @property
    def trial(self) -> TermTrial:
        """What is simulated of it: what was found where that is less than was tried, as over more a response may bend."""
        return TermTrial(self.term, self.shapes, min(self.tried, self.coefficient, key=abs))


class LinearizedFit:
    """A fitted problem, linearized, to whose residuals terms are fitted."""

    def __init__(self, problem: Problem, z: Vector, pool: Executor) -> None:
        self._problem, self._z, self._pool = problem, z, pool
        self.runs = ModelRuns(problem, z)
        self.linear = linearize(problem, z, pool, measured_steps(problem, z, pool), central=True)
        self.projection = Projection(self.linear, len(z))
        self.projected_residuals = self.projection(self.projection.residuals)
        self._nearby = near(problem, [run.correction for run in self.linear])
        self._config = problem.at_tolerance(RESPONSE_RTOL).fitted(z)
        (self._nominal,) = residuals_under(self._nearby, z, [self._config], pool)
        self._frequencies = peak_frequencies(problem, self.linear)

    def ranges(self, location: Location) -> VisitedRanges:
        """What the grids at a location are made of."""
        length = max(float(run.time[-1]) for run in self._problem.runs)
        return VisitedRanges(self.runs.visited(location), length, self._frequencies)

    @property
    def locations(self) -> tuple[Location, ...]:
        """The locations at which a term may act."""
        channels = tuple(dict.fromkeys(name for run in self._problem.runs for name in run.channels))
        return locations_for(self._config, channels)

    def responses(self, location: Location, trials: Sequence[TermTrial]) -> list[Vector | None]:
        """The change of all residuals by each trial at a location, (N,); None where it cannot be run.

        What cannot be run with one sign may be with the other, whose change is turned round: friction that drives diverges.
        """
        responses = self._changes(location, trials)
        lost = [k for k, response in enumerate(responses) if response is None]
        turned = self._changes(location, [replace(trials[k], coefficient=-trials[k].coefficient) for k in lost])
        for k, response in zip(lost, turned, strict=True):
            responses[k] = None if response is None else -response
        return responses

    def _changes(self, location: Location, trials: Sequence[TermTrial]) -> list[Vector | None]:
        """The change of all residuals by each trial as it is."""
        configs = list[Config]()
        for trial in trials:
            universal = universal_term(location.hook, bool(trial.term.rate), self._config.structure)
            values = universal.values(location, trial.term, trial.coefficient, trial.shapes)
            configs.append(with_effect(self._config, universal.effect, values))
        return [change_of(shown, self._nominal) for shown in residuals_under(self._nearby, self._z, configs, self._pool)]


def sum_of(responses: Sequence[Vector | None]) -> Vector | None:
    """The response to all of some trials at once; None where one of them cannot be run."""
    known = [response for response in responses if response is not None]
    return np.sum(known, axis=0) if len(known) == len(responses) else None


def fit_terms_at(linearized: LinearizedFit, group: Sequence[Location], stop: Stop, timed: bool) -> list[TermFit]:
    """The best shapes of every term at a group of locations; that of every wire is the sum of all. None after a stop."""
    if stop.is_set():
        return []
    ranges = linearized.ranges(group[-1])
    trials = [
        TermTrial(term, shapes, TRIED * group[0].probe / size)
        for term in group[0].terms
        if timed or 't' not in term.variables
        for shapes in shape_grid(term, ranges)
        if 0.0 < (size := max(float(np.sqrt(np.mean(term_values(term, shapes, one) ** 2))) for one in ranges.visited)) < inf
    ]
    responses = [responses_at(linearized, location, trials) for location in group if location.component != EVERY_WIRE]
    if len(responses) < len(group):
        responses.append([sum_of(of_trial) for of_trial in zip(*responses, strict=True)])
    best: dict[tuple[str, str], TermFit] = {}
    for location, of_trials in zip(group, responses, strict=True):
        for fit in term_fits(linearized, location, trials, of_trials):
            key = location.name, fit.term.name
            if fit.error_reduction > (best[key].error_reduction if key in best else 0.0):
                best[key] = fit
    return [replace(fit, limits=tuple(grid_of(shape, ranges)[1] for shape in fit.term.shapes)) for fit in best.values()]


def responses_at(linearized: LinearizedFit, location: Location, trials: Sequence[TermTrial]) -> list[Vector | None]:
    """The responses to all trials at a location, most of them combinations of the others, or products with one."""

    def simulated(chosen: Sequence[int]) -> list[Vector | None]:
        return linearized.responses(location, [trials[k] for k in chosen])

    columns = [along(trial, linearized.ranges(location).visited) for trial in trials]
    if location.hook != 'sensing':
        return by_combination(simulated, columns)
    visited = linearized.runs.visited(location, every_sample=True)
    channels = [len(run.residuals) for run in linearized.linear]
    return by_product(simulated, columns, [along(trial, visited, channels) for trial in trials])


def along(trial: TermTrial, visited: Sequence[VisitedStates], times: Sequence[int] = ()) -> Vector | None:
    """A trial along all runs, that of each run so many `times` (once without); None where that does not tell what it is in
    between."""
    if not follows_slow_states(trial.term):
        return None
    values = [trial.coefficient * term_values(trial.term, trial.shapes, states) for states in visited]
    return np.concatenate(list(map(np.tile, values, times or [1] * len(values))))


def term_fits(
    linearized: LinearizedFit, location: Location, trials: Sequence[TermTrial], responses: Sequence[Vector | None]
) -> list[TermFit]:
    """The least-squares coefficients of terms by their responses to trials; of those that the channels see."""
    known, found = [k for k, response in enumerate(responses) if response is not None], list[TermFit]()
    for first in range(0, len(known), AT_ONCE):
        some = known[first : first + AT_ONCE]
        rows = np.array([responses[k] for k in some])
        scores, sizes = linearized.projection.products(rows, linearized.projected_residuals)
        for k, score, size in zip(some, scores.tolist(), sizes.tolist(), strict=True):
            if size == size:
                trial = trials[k]
                coefficient, gain = -trial.coefficient * score / size, score**2 / size
                found.append(TermFit(location, trial.term, trial.shapes, coefficient, gain, (), trial.coefficient))
    return found


def location_groups(locations: Sequence[Location]) -> list[list[Location]]:
    """Locations whose terms share responses: the wires and, last, every wire together; all others alone."""
    every = [location for location in locations if location.component == EVERY_WIRE]
    groups = [[*(location for location in locations if location.name in one.ports), one] for one in every]
    grouped = {location.name for group in groups for location in group}
    return [*([location] for location in locations if location.name not in grouped), *groups]


def terms_at(
    fit: FitResult, overdispersion: float, context: SearchContext, hooks: Collection[str] = (), timed: bool = True
) -> list[TermFit]:
    """All terms at all locations (of these hooks) on a model where it lies, the largest error reduction first, of squares
    over those that an overdispersion lets count; those so far after a stop; `timed`: also functions of time. Raises
    SimulationError.

    Two groups at once: while the terms of one are fitted, the responses of the other are simulated.
    """
    linearized = LinearizedFit(fit.problem.weighted(1.0 / overdispersion), fit.z, context.pool)
    groups = [group for group in location_groups(linearized.locations) if not hooks or group[0].hook in hooks]
    jobs = [partial(fit_terms_at, linearized, group, context.stop, timed) for group in groups]
    fits = ordered(fit for found in run_in_threads(jobs, context.stop, at_once=2) for fit in found)
    if context.stop.is_set():
        return fits
    return ordered(with_own_responses(linearized, fits[:EXACT_TERMS]) + fits[EXACT_TERMS:])


def ordered(fits: Iterable[TermFit]) -> list[TermFit]:
    """The largest error reduction first."""
    return sorted(fits, key=lambda fit: -fit.error_reduction)


def with_own_responses(linearized: LinearizedFit, fits: Sequence[TermFit]) -> list[TermFit]:
    """The same terms, each by its own response, simulated rather than combined of others'; what sensors show is exact."""
    own, found = dict[tuple[str, TermTrial], Vector | None](), []
    for location in (one for one in linearized.locations if one.hook != 'sensing'):
        trials = list(dict.fromkeys(fit.trial for fit in fits if location.name in fit.location.ports))
        responses = linearized.responses(location, trials)
        own |= {(location.name, trial): response for trial, response in zip(trials, responses, strict=True)}
    for fit in fits:
        whole = sum_of([own.get((name, fit.trial)) for name in fit.location.ports])
        exact = term_fits(linearized, fit.location, [fit.trial], [whole])
        found.append(replace(exact[0], limits=fit.limits) if exact else fit)
    return found


@dataclass(frozen=True)
class VisitedRanges:
    """What grids are made of: the states at a location, the length of a run [s], frequencies of the residuals [Hz]."""

    visited: Sequence[VisitedStates]
    length: float
    frequencies: tuple[float, ...]
    known: dict[str, tuple[float, float]] = field(default_factory=dict, init=False, repr=False, compare=False)

    def range_of(self, variable: str) -> tuple[float, float]:
        """The values of a variable that the runs visit."""
        if variable not in self.known:
            values = np.concatenate([states.fields[variable] for states in self.visited])
            low, high = np.percentile(values, [TRIMMED_PERCENT, 100.0 - TRIMMED_PERCENT])
            self.known[variable] = float(low), float(high)
        return self.known[variable]


def grid_of(shape: ShapeParameter, ranges: VisitedRanges) -> tuple[tuple[float, ...], tuple[float, float]]:
    """The first values of a shape parameter, none of a variable that stays where it is, and its realistic range in the file:
    the values that data of these ranges can tell, with some margin."""
    length = ranges.length
    if shape.grid == 'phase':
        return PHASES, (-2.0 * math.pi, 3.0 * math.pi)
    if shape.grid == 'frequency':
        return ranges.frequencies, (MIN_PERIODS / length, 5.0 * max(ranges.frequencies, default=MAX_PERIODS / length))
    if shape.grid == 'instant':
        return tuple(np.linspace(0.0, length, INSTANTS_PER_RUN + 2)[1:-1]), (0.0, length)
    if shape.grid in ('fixed', 'time_constant'):
        times = tuple(np.geomspace(MIN_TIME_CONSTANT, 1.0, TIME_CONSTANTS_PER_RUN) * length)
        values = shape.values if shape.grid == 'fixed' else times
        return values, (0.2 * min(values), 5.0 * max(values))
    low, high = ranges.range_of(shape.of)
    width = high - low
    if width <= MIN_RELATIVE_RANGE * max(abs(low), abs(high)):
        return (), (low, high)
    if shape.grid == 'threshold':
        return tuple(np.linspace(low, high, THRESHOLDS_PER_RANGE + 2)[1:-1]), (low - 0.2 * width, high + 0.2 * width)
    if shape.grid == 'width':
        return tuple(fraction * width for fraction in WIDTH_FRACTIONS), (0.01 * width, 3.0 * width)
    return tuple(2.0 * math.pi * PERIODS_PER_RANGE / width), (0.5 * math.pi / width, 60.0 * math.pi / width)


def shape_grid(term: Term, ranges: VisitedRanges) -> list[tuple[float, ...]]:
    """All combinations of a term's shapes."""
    return list(product(*(grid_of(shape, ranges)[0] for shape in term.shapes)))


def peak_frequencies(problem: Problem, linearized: Sequence[LinearizedRun]) -> tuple[float, ...]:
    """Frequencies [Hz] of the largest peaks of the residuals' mean periodogram, all channels and runs.

    Of what came again in a run, and is sampled twice in a period at least.
    """
    longest = max(float(run.time[-1] - run.time[0]) for run in problem.runs)
    samples = max(len(run.time) for run in problem.runs)
    frequencies = np.arange(MIN_PERIODS - 0.25, min(MAX_PERIODS, 0.5 * samples) + 0.5, 0.25) / longest
    power = np.zeros(len(frequencies))
    for run, linear in zip(problem.runs, linearized, strict=True):
        transform = np.exp(-2j * math.pi * np.outer(frequencies, run.time - run.time[0]))
        for row in linear.residuals:
            power += np.abs(transform @ row) ** 2
    is_peak = (power[1:-1] >= power[:-2]) & (power[1:-1] >= power[2:])
    peaks = np.flatnonzero(is_peak) + 1
    largest = peaks[np.argsort(-power[peaks])][:MAX_FREQUENCIES]
    return tuple(float(frequencies[k]) for k in largest)
