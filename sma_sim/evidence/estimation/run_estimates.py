"""What each recording by itself says of every fitted parameter, and whether the recordings agree.

Each recording is linearized once, at the optimum of all. One parameter at a time may then have a value of its own in every
recording, while all recordings share the other parameters and determine them together; initial states are eliminated.
Whether the values of a parameter differ by more than they are uncertain is Cochran's Q, generalised to estimates that are
correlated through what they share. Beside that stands what a recording says alone, with all parameters its own: a
Gauss-Newton step from the optimum of all. docs/explanation/calibration.md derives it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from sma_sim.evidence.estimation.chi_square import chi_square_tail
from sma_sim.evidence.estimation.free_parameters import BOUND_STDS, FreeParameter
from sma_sim.evidence.estimation.problem import LinearizedRun, Problem, normal_equations, robust_weights
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.estimation.uncertainty import GAUSS_95, channel_overdispersion, inverse_of_precision
from sma_sim.model.arrays import Matrix, Vector

DISAGREE = 0.01  # chance, over all parameters, below which recordings do not agree
MIN_COMPARED_RUNS = 2
WEAK = BOUND_STDS**-2.0  # information of the priors, as in the intervals
BOUND_TOLERANCE = 1e-6
MIN_P = 1e-16  # smaller ones are not told apart in words


@dataclass(frozen=True)
class RunEstimate:
    """A parameter in one recording (SI).

    `value` where all recordings share the other parameters, `std` the standard error of its difference from what all say
    together, `deviation` that difference over it; not `seen` where this recording does not determine it. `value_alone` and
    `std_alone` where the recording has all parameters for itself, held by their priors.
    """

    run: str
    value: float
    std: float
    deviation: float
    seen: bool
    value_alone: float
    std_alone: float


@dataclass(frozen=True)
class ParameterByRun:
    """A parameter in every recording. `p`: how likely so much spread is if all have the same value; NaN for fewer than two.

    `Q`: Cochran's, `dof`: one less than the recordings that determine the parameter.
    """

    name: str
    unit: str
    value: float
    runs: tuple[RunEstimate, ...]
    Q: float
    dof: int
    p: float

    @property
    def outlier(self) -> RunEstimate:
        """The recording that deviates most from the others."""
        return max(self.runs, key=lambda run: abs(run.deviation) if run.seen else -1.0)


@dataclass(frozen=True)
class ReducedRun:
    """A recording's information (s, s) and gradient (s,) on the shared unknowns, its own eliminated, over its noise."""

    name: str
    information: Matrix
    gradient: Vector

    def alone(self, z: Vector) -> tuple[Vector, Vector]:
        """The shared unknowns (s,) as this recording alone has them, held by the priors, and their standard errors."""
        covariance = inverse_of_precision(self.information + np.eye(len(self.gradient)))
        shared = z[: len(self.gradient)]
        return shared - covariance @ (self.gradient + shared), np.sqrt(np.diag(covariance))


def estimates_by_run(problem: Problem, z: Vector, reduced: Sequence[ReducedRun]) -> tuple[ParameterByRun, ...]:
    """Every shared unknown of a problem in each of its recordings, reduced at the optimum z (n,); empty for a single one."""
    if len(reduced) < MIN_COMPARED_RUNS:
        return ()
    names, alone = [run.name for run in reduced], [run.alone(z) for run in reduced]
    found = []
    for k, unknown in enumerate(problem.shared):
        by_itself = [shown_value(unknown, float(value[k]), float(std[k])) for value, std in alone]
        found.append(parameter_by_run(unknown, float(z[k]), names, own_values(k, z, reduced), by_itself))
    return tuple(found)


@dataclass(frozen=True)
class Optimum:
    """Where a fit has ended: its unknowns z (n,), their bounds, how many of them are shared, and whether it is robust."""

    z: Vector
    low: Vector
    high: Vector
    shared: int
    robust: bool

    @classmethod
    def of(cls, problem: Problem, z: Vector) -> Self:
        """That of a problem."""
        return cls(z, *problem.limits(), len(problem.shared), problem.robust)


def reduced_run(at: Optimum, run: FitData, linear: LinearizedRun) -> ReducedRun:
    """One recording without the unknowns of its own, which keep their priors; those on a bound stay there."""
    part, low, high = (values[linear.indices] for values in (at.z, at.low, at.high))
    s = at.shared
    inner = np.flatnonzero((part - low > BOUND_TOLERANCE) & (high - part > BOUND_TOLERANCE))
    own, shared = inner[inner >= s], np.arange(s)
    equations = normal_equations(linear, at.robust)
    H, g = equations.hessian, equations.gradient
    gain = np.linalg.solve(H[np.ix_(own, own)] + np.eye(len(own)), H[np.ix_(own, shared)]).T
    information = H[:s, :s] - gain @ H[np.ix_(own, shared)]
    gradient = g[:s] - gain @ (g[own] + part[own])
    step = np.zeros(len(part))
    step[:s] = -np.linalg.solve(information + WEAK * np.eye(s), gradient)
    step[own] = -np.linalg.solve(H[np.ix_(own, own)] + np.eye(len(own)), g[own] + part[own]) - gain.T @ step[:s]
    left = linear.residuals + np.tensordot(step, linear.jacobian, 1)
    inflation = score_overdispersion(run, left, len(inner), at.robust)
    return ReducedRun(run.name, information / inflation, gradient / inflation)


def score_overdispersion(run: FitData, residuals: Matrix, unknowns: int, robust: bool) -> float:
    """By how much the scores of a recording, fitted by itself, scatter more than white noise: in its worst channel."""
    weights = robust_weights(residuals) if robust else 1.0
    return float(channel_overdispersion(run, residuals * weights, unknowns).max())


@dataclass(frozen=True)
class OwnValues:
    """How far a shared unknown moves in each recording (m,) that may have its own, their covariance (m, m), and the
    information (m,) of each recording where all else is known."""

    shifts: Vector
    covariance: Matrix
    information: Vector

    def differences(self) -> tuple[Vector, Vector]:
        """From the mean of all recordings, weighted by their information (m,), and the standard errors of that."""
        rows = np.eye(len(self.shifts)) - self.information / self.information.sum()
        return rows @ self.shifts, np.sqrt(np.maximum(np.diag(rows @ self.covariance @ rows.T), 1e-300))


def own_values(k: int, z: Vector, runs: Sequence[ReducedRun]) -> OwnValues:
    """The `k`-th shared unknown where every recording may have its own, and all share the others."""
    others = np.delete(np.arange(len(runs[0].gradient)), k)
    common = WEAK * np.eye(len(others)) + sum(run.information[np.ix_(others, others)] for run in runs)
    target = -WEAK * z[others] - sum(run.gradient[others] for run in runs)
    coupling = np.array([run.information[k, others] for run in runs])
    own = np.array([run.information[k, k] + WEAK for run in runs])
    gradients = np.array([run.gradient[k] for run in runs])
    covariance = np.linalg.inv(np.diag(own) - coupling @ np.linalg.solve(common, coupling.T))
    return OwnValues(covariance @ (-gradients - coupling @ np.linalg.solve(common, target)), covariance, own)


def parameter_by_run(
    unknown: FreeParameter, z: float, names: Sequence[str], own: OwnValues, alone: Sequence[tuple[float, float]]
) -> ParameterByRun:
    """One shared unknown in all recordings, and what each says `alone` (value, standard error)."""
    away, std = own.differences()
    seen = GAUSS_95 * std <= BOUND_STDS
    Q, dof = cochran(own.shifts[seen], own.covariance[np.ix_(seen, seen)]), max(0, int(seen.sum()) - 1)
    estimates = tuple(
        RunEstimate(name, *shown_value(unknown, z + a, s), a / s if known else 0.0, bool(known), *by_itself)
        for name, a, s, known, by_itself in zip(names, away.tolist(), std.tolist(), seen, alone, strict=True)
    )
    p = chi_square_tail(Q, dof)
    return ParameterByRun(unknown.name, unknown.unit, unknown.value(z), estimates, Q, dof, p)


def shown_value(unknown: FreeParameter, z: float, std: float) -> tuple[float, float]:
    """Value and standard error (SI) at a coordinate; no further away than a fit could go."""
    value = unknown.value(float(np.clip(z, unknown.low, unknown.high)))
    return value, abs(value) * unknown.scale * std if unknown.log else unknown.scale * std


def cochran(values: Vector, covariance: Matrix) -> float:
    """Cochran's Q of correlated estimates (m,): the weighted squares of their differences from the best common value."""
    if len(values) < MIN_COMPARED_RUNS:
        return 0.0
    weight = np.linalg.inv(covariance)
    total = weight.sum(axis=0)
    away = values - float(total @ values) / float(total.sum())
    return max(0.0, float(away @ weight @ away))


def disagreement(found: Sequence[ParameterByRun]) -> ParameterByRun | None:
    """The parameter on which recordings disagree most, None where they agree; chance counts over all parameters."""
    tested = [parameter for parameter in found if parameter.dof]
    worst = min(tested, key=lambda parameter: (parameter.p, -parameter.Q), default=None)
    return worst if worst is not None and worst.p * len(tested) < DISAGREE else None
