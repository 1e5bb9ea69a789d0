"""The score of a model: the log of its posterior probability, by Laplace's method.

In the coordinates of a fit (unknowns z with priors N(0, 1), residuals r over the noise, derivatives J) a model M has

    log p(M | y) = -S/(2 k^2) - |z|^2/2 - log det(I + J'J/k^2)/2 + log prior(M) + constant,    S = r'r

at the z that is best for k. k is the overdispersion: one number for all models that are compared. 1/k^2 discounts squares
that say less than white noise of the stated size would let them, as the variance inflation of quasi-likelihood does
(Wedderburn 1974; Burnham and Anderson 2002). Evidence by Laplace's method: MacKay (1992), Kass and Raftery (1995).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log1p, pi, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import declared_parameters
from sma_sim.evidence.estimation.levenberg_marquardt import NormalEquations, normal_equations
from sma_sim.evidence.estimation.overdispersion import autocorrelation_time
from sma_sim.evidence.estimation.plausibility import realistic_range
from sma_sim.evidence.estimation.problem import LinearizedRun, Problem, linearize
from sma_sim.evidence.estimation.search_context import SearchContext

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

SPARSITY = 3.0
"""Minus the log prior probability of any one component, beside that of which one it is: a model as it is used in practice
lacks nothing that shows with a probability of about 95 %. It is the one constant that decides between a simple model and a
rich one; benchmarks/calibration.py shows what it does."""
UNLISTED = 2.0
"""Further nats against what no list has: of what has been found missing in such robots, most is known by name."""
TAIL = 0.1  # of a realistic range: literature is not sharper, and robots differ
AMPLITUDES = np.geomspace(0.1, 1000.0, 17)  # of an unlisted function, in units of the noise
PERIODS = (2.0, 5.0, 12.0, 30.0, 80.0)  # parts of the length of a run after which it has changed


@dataclass(frozen=True)
class Evidence:
    """What the score of a fit needs, whatever the overdispersion, and whichever runs count.

    `z` (n,): where it ended; `free` (n,): unknowns that no bound holds back; `width` (n,): standard deviation of the normal
    prior that is as dense as that of each unknown; `parts`: squares, gradient and Hessian of every
    run; `profiled`: by run, information about zeros that were eliminated; `log_prior` of the components; `overdispersion` of
    its own residuals; `unlisted`: log Bayes factor of a smooth function of time in one channel beside this model.
    """

    z: Vector
    free: NDArray[np.bool_]
    width: Vector
    parts: tuple[NormalEquations, ...]
    profiled: tuple[Vector, ...]
    log_prior: float
    overdispersion: float
    unlisted: float

    def score(self, k: float, left_out: int | None = None) -> float:
        """The log posterior under an overdispersion k, up to a constant that all models share; without one run, if any."""
        weight, kept = 1.0 / k**2, [run for run in range(len(self.parts)) if run != left_out]
        squares, gradient, hessian = self._sums(kept)
        profiled = sum(float(np.log1p(weight * self.profiled[run]).sum()) for run in kept)
        value = -0.5 * weight * squares - 0.5 * float(self.z @ self.z) + self._gain(weight, gradient, hessian)
        width = self.width[self.free]
        narrowed = np.eye(len(width)) + weight * hessian * np.outer(width, width)
        return value - 0.5 * float(np.linalg.slogdet(narrowed)[1]) - 0.5 * profiled + self.log_prior

    def gain(self, k: float) -> float:
        """What the optimum for k has before the point where the fit ended, to second order."""
        _, gradient, hessian = self._sums(range(len(self.parts)))
        return self._gain(1.0 / k**2, gradient, hessian)

    def _gain(self, weight: float, gradient: Vector, hessian: Matrix) -> float:
        """The same for sums of some runs, which count with a weight."""
        z = self.z[self.free]
        pull = weight * gradient + z
        return 0.5 * float(pull @ np.linalg.solve(np.eye(len(z)) + weight * hessian, pull))

    def squares_without(self, k: float, left_out: int) -> float:
        """The squares of one run as the others predict it, to second order; its own unknowns are at their best."""
        weight, kept = 1.0 / k**2, [run for run in range(len(self.parts)) if run != left_out]
        own = np.zeros(len(self.z), dtype=bool)
        own[self.parts[left_out].indices] = True
        for run in kept:
            own[self.parts[run].indices] = False
        _, gradient, hessian = self._sums(kept)
        z = self.z[self.free]
        step = -np.linalg.solve(np.eye(len(z)) + weight * hessian, weight * gradient + z)
        squares, gradient, hessian = self._sums([left_out])
        inner = own[self.free]
        step[inner] = 0.0
        pull = weight * (gradient + hessian @ step) + z
        if inner.any():
            precision = np.eye(int(inner.sum())) + weight * hessian[np.ix_(inner, inner)]
            step[inner] = -np.linalg.solve(precision, pull[inner])
        return max(0.0, squares + 2.0 * float(gradient @ step) + float(step @ hessian @ step))

    def _sums(self, runs: Sequence[int]) -> tuple[float, Vector, Matrix]:
        """Squares, gradient and Hessian of the data of some runs, of the free unknowns."""
        n = len(self.z)
        squares, gradient, hessian = 0.0, np.zeros(n), np.zeros((n, n))
        for part in (self.parts[run] for run in runs):
            squares += 2.0 * part.cost
            gradient[part.indices] += part.gradient
            hessian[np.ix_(part.indices, part.indices)] += part.hessian
        return squares, gradient[self.free], hessian[np.ix_(self.free, self.free)]


def evidence_of(fit: FitResult, log_prior: float, context: SearchContext) -> Evidence:
    """The evidence of a fit, from one linearisation where it has ended. Raises SimulationError."""
    return evidence_at(fit.problem, fit.z, linearize(fit.problem, fit.z, context.pool), log_prior)


def evidence_at(problem: Problem, z: Vector, linear: Sequence[LinearizedRun], log_prior: float) -> Evidence:
    """The evidence of a model from its linearisation at z."""
    parts = tuple(normal_equations(run, problem.robust) for run in linear)
    slope = problem.tempering**2 * z
    for part in parts:
        slope[part.indices] += part.gradient
    width, cost = realism(problem, z)
    return Evidence(
        z, off_bounds(problem, z, slope), width, parts, profiled_information(problem), log_prior - cost,
        overdispersion_of(problem, [run.residuals for run in linear]), unlisted_evidence(linear),
    )  # fmt: skip


def probabilities(evidences: Sequence[Evidence]) -> list[float]:
    """Of several models of the same recordings, under the overdispersion of the one that leaves least."""
    k = min(evidence.overdispersion for evidence in evidences)
    scores = np.array([evidence.score(k) for evidence in evidences])
    weights = np.exp(scores - scores.max())
    return list((weights / weights.sum()).tolist())


def realism(problem: Problem, z: Vector) -> tuple[Vector, float]:
    """The prior of the values of effects, in place of the normal one of a fit: even within what literature calls realistic,
    with heavy tails, so that values beyond cost nats and are not forbidden. As widths in z (n,), and that cost.

    With W the width of the range in z, d the distance beyond it and w = TAIL W the density is (1 + d/w)^-2/(W (1 + 2 TAIL)):
    in the range as dense as a normal one in its middle, of standard deviation W (1 + 2 TAIL)/sqrt(2 pi).
    """
    declared, width, cost = declared_parameters(problem.config), np.ones(len(z)), 0.0
    for j, (free, at) in enumerate(zip(problem.free, z.tolist(), strict=False)):
        between = realistic_range(declared[free.name])
        if between is None or not free.name.startswith('effects.'):
            continue
        low, high = (free.coordinate(value) if value > 0.0 or not free.log else free.low for value in between)
        width[j] = (high - low) * (1.0 + 2.0 * TAIL) / sqrt(2.0 * pi)
        cost += 2.0 * log1p(max(low - at, at - high, 0.0) / (TAIL * (high - low))) - 0.5 * at**2
    return width, cost


def off_bounds(problem: Problem, z: Vector, slope: Vector) -> NDArray[np.bool_]:
    """Which unknowns are free to move: not those that a bound holds back."""
    low, high = problem.limits()
    inside: NDArray[np.bool_] = ~(((z <= low) & (slope > 0.0)) | ((z >= high) & (slope < 0.0)) | (low == high))
    return inside


def profiled_information(problem: Problem) -> tuple[Vector, ...]:
    """By run, information about zeros of channels, which are at their best values, in units of their priors."""
    return tuple(
        np.array([std**2 * float(w @ w) for std, w in zip(run.zero_std, run.weight, strict=False) if std > 0.0])
        for run in problem.runs
    )


def overdispersion_of(problem: Problem, residuals: Sequence[Matrix]) -> float:
    """Root mean square of the residuals (channels, k) of every run times the root of their longest correlation time
    [samples], at least 1."""
    squares = sum(float(np.vdot(rows, rows)) for rows in residuals)
    longest = max(autocorrelation_time(row) for rows in residuals for row in rows)
    return max(1.0, sqrt(squares / problem.samples * longest))


def unlisted_evidence(linear: Sequence[LinearizedRun]) -> float:
    """Log Bayes factor of an unknown smooth function of time in one channel, in all recordings, beside white noise.

    A Gaussian process with covariance a^2 exp(-|t - t'|/l) has nearly independent cosine coefficients d_j of variance
    1 + a^2 s_j(l), which gives the sum over j of (d_j^2 (1 - 1/v_j) - log v_j)/2; averaged over amplitudes a and correlation
    times l, and over the channels.
    """
    channels = max(len(run.residuals) for run in linear)
    factors = []
    for channel in range(channels):
        rows = [run.residuals[channel] for run in linear if channel < len(run.residuals)]
        spectra = [dct(row, norm='ortho') ** 2 for row in rows if np.any(row)]
        if spectra:
            by_prior = [sum(log_factor(power, a, period) for power in spectra) for a in AMPLITUDES for period in PERIODS]
            factors.append(log_mean(by_prior))
    return log_mean(factors) if factors else 0.0


def log_factor(power: Vector, amplitude: float, periods: float) -> float:
    """The log Bayes factor of one row from its squared cosine coefficients (k,)."""
    k = len(power)
    frequency = np.pi * np.arange(k) / k
    length = k / periods
    variance = 1.0 + amplitude**2 * 2.0 * length / (1.0 + (length * frequency) ** 2)
    return 0.5 * float(np.sum(power * (1.0 - 1.0 / variance) - np.log(variance)))


def log_mean(values: Sequence[float]) -> float:
    """log of the mean of exp."""
    return log_sum(values) - float(np.log(len(values)))


def log_sum(values: Sequence[float]) -> float:
    """log of the sum of exp."""
    return float(np.logaddexp.reduce(np.asarray(values, float)))
