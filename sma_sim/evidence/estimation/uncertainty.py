"""How well the data of a fit determine its parameters, and what they do not determine.

Intervals come from the data alone: the priors of the parameters are widened to the bounds of the fit before. The
covariance is H^-1 S H^-1 with the Hessian H and the larger of two estimates of the covariance S of the scores: that of
residuals which scatter and stay correlated as those of their run and channel do (overdispersion; white noise of the stated
size where the model is right), and the long-run covariance of the scores themselves, which sees correlation between
channels too. docs/explanation/calibration.md derives it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, qr

from sma_sim.evidence.estimation.fit_result import OtherStart
from sma_sim.evidence.estimation.free_parameters import BOUND_STDS, FreeParameter
from sma_sim.evidence.estimation.overdispersion import autocorrelation_time
from sma_sim.evidence.estimation.problem import (
    AMBIENT,
    WARMTH,
    LinearizedRun,
    NormalEquations,
    Problem,
    accumulated,
    costs_at,
    measured_steps,
    normal_equations,
    reduced_in_turn,
    robust_weights,
)
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.covariance import ParameterCovariance
from sma_sim.solver.simulate import SimulationError

Reduced = TypeVar('Reduced')
JACOBIAN_RTOL = 1e-7  # of the simulations whose differences make the Jacobian
PRIOR_INFORMATION = 1.0  # eigenvalue below which data say less of a direction than its prior
MIN_COMPONENT = 0.15  # relative to the largest: smaller ones are left out of the sentence on a direction
MIN_BLOCK, MIN_BLOCKS = 10, 10  # samples of a block; a run has at least so many blocks
MOST_SCORES = 500  # about so many of a recording are kept: neighbours of a longer one, far fewer than a block, are added up
GAUSS_95 = 1.959964
RISES_BY = 0.25  # part of what derivatives say, by which the cost rises at the end of an interval at least: a valley bends
MAX_DOUBLINGS = 30  # of an interval at whose ends it does not: from rounding to the bounds of a fit
UNKNOWN_STD = 1e3  # of a coordinate of which data say nothing
RULED_OUT = 0.5 * GAUSS_95**2  # log odds: what costs less lies within a 95 % interval
ROUNDING = 1e-15  # of a precision in units of its own diagonal: a smaller eigenvalue is rounding error


@dataclass(frozen=True, repr=False)
class Interval:
    """A parameter with its 95 % interval.

    Attributes
    ----------
    name, value, unit
        The parameter and its fitted value (SI) in its unit.
    low, high
        Ends of the interval, in the same unit; no bound of the fit is passed by it.
    std
        Standard deviation, of the logarithm if `log` (`std_unit`); `std_of_value` is in the unit of the value.
    log
        Whether the parameter was fitted as its logarithm.
    seen
        Whether the data determine it; else `low` and `high` are not what data say but how far the fit could go.
    """

    name: str
    value: float
    std: float
    low: float
    high: float
    log: bool
    seen: bool
    unit: str

    @property
    def std_of_value(self) -> float:
        """The standard deviation of the value itself, in its unit: of a logarithm to first order."""
        return abs(self.value) * self.std if self.log else self.std

    @property
    def std_unit(self) -> str:
        """The unit of `std`."""
        return 'of the logarithm' if self.log else self.unit

    def __repr__(self) -> str:
        unit = f' {self.unit}'.removesuffix(' -')
        seen = '' if self.seen else '; not determined'
        return f'<Interval: {self.name} {self.value:.5g}{unit}, 95 % {self.low:.5g} to {self.high:.5g}{unit}{seen}>'


@dataclass(frozen=True)
class Direction:
    """A combination of parameters: `weights` by name, of unit length in prior standard deviations, known to `std`."""

    weights: Mapping[str, float]
    std: float


@dataclass(frozen=True)
class Uncertainty:
    """Intervals, directions (best known first), and what the data do not determine, in words.

    `correlation` (p, p) in the order of `intervals`; `correlation_time`: by channel, by how many samples residuals
    are correlated (1: white); `delay_std` [s]. `ambient`: by recording, by how much its ambient temperature is above that of
    the first one, where they differ. All of them together can hardly be told from parameters. `warmth`: by recording, how
    warm its wires were at its beginning, where that is not at rest. `delay`: its interval, where it was fitted.
    """

    intervals: tuple[Interval, ...]
    directions: tuple[Direction, ...]
    unseen: tuple[str, ...]
    correlation: tuple[tuple[float, ...], ...]
    correlation_time: Mapping[str, float]
    delay_std: float
    ambient: Mapping[str, AmbientDifference] = field(default_factory=dict)
    warmth: Mapping[str, tuple[Warmth, ...]] = field(default_factory=dict)
    delay: Interval | None = None


@dataclass(frozen=True)
class AmbientDifference:
    """By how much an ambient temperature is above that of the first recording [K], and its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Warmth:
    """By how much a wire is warmer than the ambient when a recording begins [K], and its 95 % interval."""

    value: float
    low: float
    high: float


def reduced_runs(
    problem: Problem, z: Vector, executor: Executor, reduce: Callable[[FitData, LinearizedRun], Reduced]
) -> list[Reduced]:
    """What `reduce`, which can be sent to another process, makes of every recording, linearized at z.

    At a tolerance as intervals need it, or at that of the fit.

    A model at the edge of what can be run may run at one tolerance only. Raises SimulationError where it runs at neither.
    """

    def reduced(at: Problem) -> list[Reduced]:
        return list(reduced_in_turn(at, z, executor, reduce, measured_steps(at, z, executor), central=True))

    try:
        return reduced(problem.at_tolerance(JACOBIAN_RTOL))
    except SimulationError:
        return reduced(problem)


@dataclass(frozen=True)
class RunInformation:
    """What one recording says of its unknowns (n,), without their derivatives, which take more memory.

    `by_channel` (channels, n, n): Gauss-Newton Hessians; `overdispersion` (channels,): of the residuals; `scores` (n, k):
    derivatives of the cost of each `together` neighbouring instants; `correlation_times`: of the residuals by channel
    [samples].
    """

    equations: NormalEquations
    by_channel: NDArray[np.float64]
    overdispersion: Vector
    scores: Matrix
    correlation_times: Mapping[str, float]
    together: int = 1


def information_of(data: FitData, run: LinearizedRun, robust: bool) -> RunInformation:
    """What a linearized recording says."""
    jacobian, residuals = run.jacobian, run.residuals
    if robust:
        weights = robust_weights(residuals)
        jacobian, residuals = jacobian * weights, residuals * weights
    scores = np.einsum('uck,ck->uk', jacobian, residuals)
    together = max(1, scores.shape[1] // MOST_SCORES)
    return RunInformation(
        normal_equations(run, robust),
        np.einsum('uck,vck->cuv', jacobian, jacobian),
        channel_overdispersion(data, residuals, len(run.indices)),
        np.add.reduceat(scores, np.arange(0, scores.shape[1], together), axis=1),
        {name: autocorrelation_time(row) for name, row in zip(data.channels, run.residuals, strict=True)},
        together,
    )


def uncertainty(problem: Problem, z: Vector, runs: Sequence[RunInformation]) -> Uncertainty:
    """Intervals of the free parameters at z, by what each recording says there."""
    times = correlation_times(runs)
    p = len(problem.free)
    regular = np.where(np.arange(len(z)) < p, BOUND_STDS**-2.0, 1.0)
    hessian, scattered, scores, said = (np.diag(regular) for _ in range(4))
    for run in runs:
        at = np.ix_(run.equations.indices, run.equations.indices)
        hessian[at] += run.by_channel.sum(axis=0)
        scattered[at] += np.einsum('c,cuv->uv', run.overdispersion, run.by_channel)
        said[at] += np.einsum('c,cuv->uv', 1.0 / run.overdispersion, run.by_channel)
        scores[at] += long_run(run.scores, max(times.values()), run.together)
    inverse = inverse_of_precision(hessian)
    covariance = inverse @ scattered @ inverse
    # overdispersion is at least 1, and variances as much as without; rounding may leave less where derivatives explode
    np.fill_diagonal(covariance, np.maximum(np.diag(covariance), np.diag(inverse)))
    variance = np.maximum(np.diag(covariance), np.diag(inverse @ scores @ inverse))
    information = np.linalg.inv(inverse_of_precision(said)[:p, :p]) - BOUND_STDS**-2.0 * np.eye(p) if p else np.zeros((0, 0))
    size, vectors = eigh(information)
    unknown = vectors[:, size < PRIOR_INFORMATION]
    std = np.sqrt(variance)
    delay = delay_interval(problem.shared[p], float(z[p]), float(std[p])) if problem.delay is None else None
    return Uncertainty(
        intervals=tuple(
            interval(free, float(z[k]), float(std[k]), seen=float(np.sum(unknown[k] ** 2)) < MIN_COMPONENT**2)
            for k, free in enumerate(problem.free)
        ),
        directions=tuple(direction(problem.free, vectors[:, k], size[k] + BOUND_STDS**-2.0) for k in reversed(range(p))),
        unseen=tuple(unidentified(problem.free, unknown)),
        correlation=tuple(tuple(row) for row in correlations(covariance[:p, :p]).tolist()),
        correlation_time=times,
        delay_std=float('nan') if delay is None else delay.std,
        ambient=ambient_differences(problem, z, (covariance, inverse @ scores @ inverse)),
        warmth=warmth_of_wires(problem, z, variance),
        delay=delay,
    )


def inverse_of_precision(precision: Matrix) -> Matrix:
    """The covariance (n, n) of a precision (n, n); of directions that data do not see it is large, and positive in spite of
    rounding errors."""
    size = 1.0 / np.sqrt(np.diag(precision))
    values, axes = eigh(np.outer(size, size) * precision)
    found: Matrix = np.outer(size, size) * ((axes / np.maximum(values, ROUNDING)) @ axes.T)
    return found


def known_ambient(problem: Problem, z: Vector, executor: Executor) -> Mapping[str, AmbientDifference]:
    """By recording, what a fit says at z of its ambient temperature. Raises SimulationError."""
    runs = reduced_runs(problem, z, executor, partial(information_of, robust=problem.robust))
    return uncertainty(problem, z, runs).ambient


def posterior_covariance(free: Sequence[FreeParameter], known: Uncertainty) -> ParameterCovariance | None:
    """What a fit leaves to know: the information behind the intervals, and that of the priors N(0, 1) of z.

    None where nothing was fitted.
    """
    if not free:
        return None
    scale = np.array([one.scale for one in free])
    std = np.nan_to_num([one.std for one in known.intervals] / scale, nan=UNKNOWN_STD, posinf=UNKNOWN_STD)
    covariance = np.nan_to_num(np.reshape(known.correlation, (len(free), len(free)))) * np.outer(std, std)
    size, vectors = eigh(covariance)
    told = np.maximum(1.0 / np.maximum(size, 1e-300) - BOUND_STDS**-2.0, 0.0)  # without what widened priors told
    matrix = (vectors / (told + 1.0)) @ vectors.T * np.outer(scale, scale)
    return ParameterCovariance(tuple(one.name for one in free), 0.5 * (matrix + matrix.T))


def ambient_differences(problem: Problem, z: Vector, covariances: tuple[Matrix, Matrix]) -> dict[str, AmbientDifference]:
    """By recording, the difference to the first; the larger variance of two estimates of the covariance of z counts."""
    scale = np.zeros((len(problem.runs), len(z)))
    for row, run, at in zip(scale, problem.runs, problem.indices(), strict=True):
        if run.ambient_std > 0.0:
            row[at[problem.places(run, AMBIENT)]] = run.ambient_std
    if not scale.any():
        return {}
    contrast = scale - scale[0]
    values = contrast @ z
    reach = GAUSS_95 * np.sqrt(np.max([np.einsum('ij,jk,ik->i', contrast, c, contrast) for c in covariances], axis=0))
    return {
        run.name: AmbientDifference(float(value), float(value - r), float(value + r))
        for run, value, r in zip(problem.runs, values, reach, strict=True)
    }


def warmth_of_wires(problem: Problem, z: Vector, variance: Vector) -> dict[str, tuple[Warmth, ...]]:
    """By recording that does not begin at rest, how warm its wires are, from the `variance` (n,) of z."""
    found = {}
    for run, at in zip(problem.runs, problem.indices(), strict=True):
        if not run.beginning_std.warmth:
            continue
        own = at[problem.places(run, WARMTH)]
        stds = np.array(run.beginning_std.warmth)
        values, reach = z[own] * stds, GAUSS_95 * np.sqrt(variance[own]) * stds
        pairs = zip(values.tolist(), reach.tolist(), strict=True)
        found[run.name] = tuple(Warmth(value, max(0.0, value - r), value + r) for value, r in pairs)
    return found


def interval(free: FreeParameter, z: float, std: float, seen: bool) -> Interval:
    """The 95 % interval of one parameter."""
    reach = GAUSS_95 * std
    seen = seen and reach <= BOUND_STDS  # wider than the fit could go: nothing is known
    low, high = (max(z - reach, free.low), min(z + reach, free.high)) if seen else (free.low, free.high)
    return Interval(free.name, free.value(z), free.scale * std, free.value(low), free.value(high), free.log, seen, free.unit)


def delay_interval(delay: FreeParameter, z: float, std: float) -> Interval:
    """The 95 % interval of the delay within its limits; nothing is known where it is as wide as these are apart."""
    reach = GAUSS_95 * std
    seen = reach <= 0.5 * (delay.high - delay.low)
    low, high = (max(z - reach, delay.low), min(z + reach, delay.high)) if seen else (delay.low, delay.high)
    ends = delay.value(low), delay.value(high)
    return Interval(delay.name, delay.value(z), delay.scale * std, *ends, delay.log, seen, delay.unit)


def checked_by_runs(
    known: Uncertainty, problem: Problem, z: Vector, runs: Sequence[RunInformation], executor: Executor
) -> Uncertainty:
    """Intervals at whose ends the cost of runs of the model has risen; they reach further where it has not.

    Derivatives are those of a point. Where the model jumps there, or only rounds differently, they are huge and an interval
    is a point too, though the recordings fit as well far beyond it. At an end, with the other unknowns held or moved along,
    the cost is to have risen by a part of what the derivatives say.
    """
    hessian = accumulated((run.equations for run in runs), z, problem.tempering)[2]
    inverse, (low, high) = inverse_of_precision(hessian), problem.limits()
    along, base = inverse / np.diag(inverse), costs_at(problem, [z], executor)[0]
    pairs = list(zip(problem.free, known.intervals, strict=True))
    first = np.array(
        [[free.coordinate(one.low) - x, free.coordinate(one.high) - x] for (free, one), x in zip(pairs, z, strict=False)]
    )
    reach = first.copy()
    open_ends = [(k, side) for k, (_, one) in enumerate(pairs) if one.seen for side in (0, 1) if first[k, side] != 0.0]
    for _ in range(MAX_DOUBLINGS if open_ends else 0):
        moves = [reach[k, side] * move for k, side in open_ends for move in (along[:, k], np.eye(len(z))[k])]
        costs = costs_at(problem, [np.clip(z + move, low, high) for move in moves], executor)
        risen = np.reshape(costs, (-1, 2)).min(axis=1) - base
        open_ends = [
            (k, side)
            for (k, side), rise in zip(open_ends, risen, strict=True)
            if rise < RISES_BY * 0.5 * first[k, side] ** 2 / inverse[k, k] and low[k] < z[k] + reach[k, side] < high[k]
        ]
        if not open_ends:
            break
        for end in open_ends:
            reach[end] *= 2.0
    return replace(
        known,
        intervals=tuple(
            one if (reach[k] == first[k]).all() else widened(one, free, z[k] + reach[k])
            for k, (free, one) in enumerate(pairs)
        ),
    )


def widened(one: Interval, free: FreeParameter, ends: Vector) -> Interval:
    """An interval between other ends (2,) in z, within the bounds."""
    low, high = np.clip(ends, free.low, free.high).tolist()
    std = free.scale * (high - low) / (2.0 * GAUSS_95)
    return replace(one, low=free.value(low), high=free.value(high), std=max(one.std, std))


def with_other_minima(known: Uncertainty, others: Sequence[OtherStart]) -> Uncertainty:
    """Intervals that hold the values of those other minima which the recordings do not rule out with 95 %."""
    near = [other.values for other in others if other.log_odds < RULED_OUT]
    widened = tuple(
        replace(one, low=min([one.low, *values]), high=max([one.high, *values]))
        for one in known.intervals
        for values in [[other[one.name] for other in near if one.name in other]]
    )
    return replace(known, intervals=widened)


def direction(free: Sequence[FreeParameter], vector: Vector, information: float) -> Direction:
    """One eigenvector with names, its largest component positive."""
    vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
    weights = {parameter.name: float(x) for parameter, x in zip(free, vector, strict=True)}
    return Direction(weights, float(max(information, 1e-12) ** -0.5))


def correlations(covariance: Matrix) -> Matrix:
    """Correlation coefficients."""
    std = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    return np.clip(covariance / np.outer(std, std), -1.0, 1.0) if len(std) else covariance


def correlation_times(runs: Sequence[RunInformation]) -> dict[str, float]:
    """By channel, the integrated autocorrelation time of the residuals in samples, the longest of all runs."""
    found: dict[str, float] = {}
    for run in runs:
        for name, time in run.correlation_times.items():
            found[name] = max(found.get(name, 1.0), time)
    return found


def long_run(scores: Matrix, time: float, together: int = 1) -> Matrix:
    """Long-run covariance of scores (n, k): Bartlett's kernel, as sums over overlapping blocks (Newey, West).

    `time` [samples] is that of the correlation; each score is the sum of so many samples `together`.
    """
    k = scores.shape[1]
    block = int(np.clip(4.0 * time / together, max(MIN_BLOCK / together, 1.0), max(k // MIN_BLOCKS, 1)))
    padded = np.concatenate([np.zeros((len(scores), block)), np.cumsum(scores, axis=1)], axis=1)
    ends = np.concatenate([padded, np.repeat(padded[:, -1:], block, axis=1)], axis=1)
    sums = ends[:, block:] - ends[:, :-block]
    found: Matrix = sums @ sums.T / block
    return found


def unidentified(free: Sequence[FreeParameter], unknown: Matrix) -> list[str]:
    """What the span of the unknown directions (p, m) means, one sentence each, with as few parameters as possible."""
    m = unknown.shape[1]
    if m == 0:
        return []
    _, _, order = qr(unknown.T, pivoting=True)
    basis = unknown @ np.linalg.inv(unknown[order[:m]])
    return [sentence(free, 0.2 * basis[:, j]) for j in range(m)]


def sentence(free: Sequence[FreeParameter], vector: Vector) -> str:
    """One unknown direction in words."""
    large = [k for k in np.argsort(-np.abs(vector)) if abs(vector[k]) > MIN_COMPONENT * np.abs(vector).max()]
    names = [free[k].name for k in large]
    if len(large) == 1:
        return f'{names[0]} has no visible effect'
    changes = [free[k].scale * vector[k] for k in large]
    if len(large) == 2 and all(free[k].log for k in large):
        ratio = changes[1] / changes[0]
        if 0.8 < abs(ratio) < 1.25:
            return f'{names[0]} and {names[1]} only as their {"ratio" if ratio > 0.0 else "product"}'
    moves = [f'{names[j]} by {moved(free[k], float(vector[k]))}' for j, k in enumerate(large)]
    return f'{", ".join(names[:-1])} and {names[-1]} only together: moving {", ".join(moves)} changes next to nothing'


def moved(free: FreeParameter, z: float) -> str:
    """How far a step in z moves a parameter."""
    return f'{100.0 * free.scale * z:+.2g} %' if free.log else f'{free.scale * z:+.2g} {free.unit}'


def channel_overdispersion(run: FitData, residuals: Matrix, unknowns: int) -> Vector:
    """k^2 (channels,) of a run: how much more the scores of each channel scatter than white noise of the stated size.

    `residuals` (channels, k) over noise, of a fit with so many unknowns. 1 where less than the noise is left.
    """
    counts = np.maximum(np.count_nonzero(run.weight, axis=1), 1)
    left = 1.0 - min(0.5, unknowns / max(1, run.samples))
    squares = np.sum(residuals**2, axis=1) / (counts * left)
    times = np.array([autocorrelation_time(row) for row in residuals])
    found: Vector = np.maximum(1.0, squares * times)
    return found
