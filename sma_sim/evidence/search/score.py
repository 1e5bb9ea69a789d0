"""The score of a model: the log of its posterior probability, by Laplace's method.

In the coordinates of a fit (unknowns z with priors N(0, 1), residuals r over the noise, derivatives J) a model M has

    log p(M | y) = -S/(2 k^2) - |z|^2/2 - log det(I + J'J/k^2)/2 + log p(bounds) + log prior(M) + constant,    S = r'r

at the z that is best for k. Unknowns have bounds, at which many an optimum lies: p(bounds) is the part of the Gaussian about
that z, which may lie beyond them, that is within. k is the overdispersion: one number for all models that are compared.
1/k^2 discounts squares that say less than white noise of the stated size would let them, as the variance inflation of
quasi-likelihood does (Wedderburn 1974; Burnham and Anderson 2002). Evidence by Laplace's method: MacKay (1992), Kass and
Raftery (1995).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from math import exp, inf

import numpy as np
from scipy.fft import dct
from scipy.linalg import LinAlgError

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import bounded_step
from sma_sim.evidence.estimation.noise_at_rest import pace
from sma_sim.evidence.estimation.overdispersion import measured, overdispersion_of
from sma_sim.evidence.estimation.problem import (
    LinearizedRun,
    NormalEquations,
    Problem,
    accumulated,
    linearize,
    normal_equations,
)
from sma_sim.evidence.estimation.residuals import FitData, elapsed
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.search.bounded_integral import log_bounded_integral
from sma_sim.evidence.search.prior import SPARSITY, UNLISTED, prior_of_values
from sma_sim.model.arrays import Mask, Matrix, Vector

MAX_LOG_ODDS = 700.0  # of which exp is still a number
ROUNDING = 1e-6  # of squares, by which what derivatives promise of them is wrong at most
AMPLITUDES = np.geomspace(0.1, 1000.0, 17)  # of an unlisted function, in units of the noise
PERIODS = (2.0, 5.0, 12.0, 30.0, 80.0)  # parts of the length of a run after which it has changed
WHITE = np.array([[1.0], [1.1], [1.21]])  # variances of noise: larger ones are told (NOISE_ONLY)
MEMORIES, MORE_NOISE = (0.125, 0.25, 0.5), (0.3, 0.6, 1.0)
"""Of correlated noise, memories in parts of the means over rests that tell of it, and standard deviations in units of the
noise: of memories of 3 to 12 samples a mean of 40 left 0.8 to 0.3 of the spectrum at low frequencies."""


@dataclass(frozen=True)
class Evidence:
    """What the score of a fit needs, whatever the overdispersion, and whichever runs count.

    `z` (n,): where it ended; `low`, `high` (n,): between which bounds its prior is spread; `precision` (n,): of its normal
    prior, 1, or next to nothing where the prior is even; `parts`: squares, gradient and Hessian of every
    run; `profiled`: by run, information about zeros that were eliminated; `log_prior` of the components and of the values
    whose prior is even; `overdispersion` of its own residuals; `unlisted`: log Bayes factor of a smooth function of time in
    one channel beside this model.
    """

    z: Vector
    low: Vector
    high: Vector
    precision: Vector
    parts: tuple[NormalEquations, ...]
    profiled: tuple[Vector, ...]
    log_prior: float
    overdispersion: float
    unlisted: float
    _known: dict[tuple[float, int | None], float] = field(init=False, repr=False, compare=False, default_factory=dict)
    _gains: dict[float, float] = field(init=False, repr=False, compare=False, default_factory=dict)

    def score(self, k: float, left_out: int | None = None) -> float:
        """The log posterior under an overdispersion k, up to a constant that all models share; without one run, if any."""
        if (k, left_out) not in self._known:  # asked each time that models are put in order
            self._known[k, left_out] = self._log_posterior(k, () if left_out is None else (left_out,))
        return self._known[k, left_out]

    def log_predictive(self, k: float, runs: Collection[int]) -> float:
        """The log density of some runs as the others predict them, with parameters as uncertain as these leave them: the
        quotient of two integrals, up to a constant of these runs."""
        return self._log_posterior(k, ()) - self._log_posterior(k, runs)

    def _log_posterior(self, k: float, left_out: Collection[int]) -> float:
        """The integral of the Gaussian about the optimum, as far as it lies within bounds; -inf of derivatives that promise
        more than there are squares: those of a model that has overflowed do."""
        weight, kept = 1.0 / k**2, [run for run in range(len(self.parts)) if run not in left_out]
        squares, gradient, hessian = self._sums(kept)
        profiled = sum(float(np.log1p(weight * self.profiled[run]).sum()) for run in kept)
        total: Matrix = weight * hessian + np.diag(self.precision)
        slope = weight * gradient + self.precision * self.z
        varied = self.low < self.high
        low, high = self.low[varied] - self.z[varied], self.high[varied] - self.z[varied]
        inside = log_bounded_integral(slope[varied], total[np.ix_(varied, varied)], low, high)
        at_end = -0.5 * weight * squares - 0.5 * float(self.z @ (self.precision * self.z))
        most = -at_end - 0.5 * float(np.log(self.precision[varied]).sum())
        if inside > most + ROUNDING * abs(at_end) + 1.0:
            return -inf
        return at_end - 0.5 * profiled + inside + self.log_prior

    def gain(self, k: float) -> float:
        """What the optimum of a fit for k has before the point where it ended, to second order and within bounds; inf beyond
        all numbers."""
        if k not in self._gains:  # asked each time that models are put in order
            weight, (_, gradient, hessian) = 1.0 / k**2, self._sums(range(len(self.parts)))
            slope, low, high = weight * gradient + self.z, self.low - self.z, self.high - self.z
            try:
                step = bounded_step(slope, weight * hessian, 1.0, low, high)
            except (LinAlgError, ValueError):  # of derivatives that are not numbers
                self._gains[k] = inf
            else:
                left = slope + 0.5 * (weight * hessian @ step + step)
                self._gains[k] = max(0.0, -float(left @ step))
        return self._gains[k]

    def squares_without(self, k: float, left_out: int) -> float:
        """The squares of one run as the others predict it, to second order; its own unknowns are at their best."""
        weight, kept = 1.0 / k**2, [run for run in range(len(self.parts)) if run != left_out]
        own = np.zeros(len(self.z), dtype=bool)
        own[self.parts[left_out].indices] = True
        for run in kept:
            own[self.parts[run].indices] = False
        _, gradient, hessian = self._sums(kept)
        slope, step = weight * gradient + self.z, np.zeros(len(self.z))
        free = self._free(weight * self._sums(range(len(self.parts)))[1] + self.z)
        step[free] = -np.linalg.solve(np.eye(int(free.sum())) + weight * hessian[np.ix_(free, free)], slope[free])
        squares, gradient, hessian = self._sums([left_out])
        inner = own & free
        step[inner] = 0.0
        pull = weight * (gradient + hessian @ step) + self.z
        if inner.any():
            precision = np.eye(int(inner.sum())) + weight * hessian[np.ix_(inner, inner)]
            step[inner] = -np.linalg.solve(precision, pull[inner])
        return max(0.0, squares + 2.0 * float(gradient @ step) + float(step @ hessian @ step))

    def _free(self, slope: Vector) -> Mask:
        """Which unknowns are free to move against a slope: not those that a bound holds back."""
        held = ((self.z <= self.low) & (slope > 0.0)) | ((self.z >= self.high) & (slope < 0.0))
        free: Mask = ~(held | (self.low == self.high))
        return free

    def _sums(self, runs: Sequence[int]) -> tuple[float, Vector, Matrix]:
        """Squares, gradient and Hessian of the data of some runs, of all unknowns."""
        cost, gradient, hessian = accumulated((self.parts[run] for run in runs), np.zeros(len(self.z)), tempering=0.0)
        return 2.0 * cost, gradient, hessian


def evidence_of(fit: FitResult, log_prior: float, context: SearchContext) -> Evidence:
    """The evidence of a fit, from one linearisation where it has ended. Raises SimulationError."""
    return evidence_at(fit.problem, fit.z, linearize(fit.problem, fit.z, context.pool), log_prior)


def evidence_at(problem: Problem, z: Vector, linear: Sequence[LinearizedRun], log_prior: float) -> Evidence:
    """The evidence of a model from its linearisation at z."""
    low, high, precision, log_density = prior_of_values(problem, z)
    residuals = [run.residuals for run in linear]
    return Evidence(
        z, low, high, precision, tuple(normal_equations(run, problem.robust) for run in linear),
        profiled_information(problem), log_prior + log_density,
        overdispersion_of(problem, residuals),
        unlisted_evidence(residuals, [run.floor_shares for run in problem.runs], spectra_of_noise(problem, residuals)),
    )  # fmt: skip


def unlisted_probability(evidence: Evidence) -> float:
    """The probability that something which no list has is left beside a model."""
    odds = evidence.unlisted - SPARSITY - UNLISTED
    return 1.0 / (1.0 + exp(float(np.clip(-odds, -MAX_LOG_ODDS, MAX_LOG_ODDS))))


def probabilities(evidences: Sequence[Evidence]) -> list[float]:
    """Of several models of the same recordings, under the overdispersion of the one that leaves least."""
    k = min(evidence.overdispersion for evidence in evidences)
    scores = np.array([evidence.score(k) for evidence in evidences])
    weights = np.exp(scores - scores.max())
    return list((weights / weights.sum()).tolist())


def profiled_information(problem: Problem) -> tuple[Vector, ...]:
    """By run, the eigenvalues of the information about zeros of channels and their drifts, which are at their best, in units
    of their priors."""
    found = []
    for run in problem.runs:
        stds = zip(run.zero_std, run.drift_std, run.weight, strict=False)
        shapes = (np.array([zero * w, drift * w * elapsed(run)]) for zero, drift, w in stds if zero > 0.0 or drift > 0.0)
        eigenvalues = [np.linalg.svd(shape, compute_uv=False) ** 2 for shape in shapes]
        found.append(np.concatenate(eigenvalues) if eigenvalues else np.zeros(0))
    return tuple(found)


def spectra_of_noise(problem: Problem, residuals: Sequence[Matrix]) -> list[list[Matrix]]:
    """By run and channel, variances of the cosine coefficients of noise: (alternatives, k), or (alternatives, 1) of white
    noise, whose size is known to some per cent only.

    Of correlated noise that is its process at rest, which says little of a memory that is not far shorter than the rests
    are, and then the same with a further part that has one.
    """
    return [
        [
            rows_of_noise(run, name, len(measured(row))) if name in run.noise else WHITE
            for name, row in zip(run.channels, rows, strict=True)
        ]
        for run, rows in zip(problem.runs, residuals, strict=True)
    ]


def rows_of_noise(run: FitData, name: str, k: int) -> Matrix:
    """The alternatives (alternatives, k) of a channel whose noise is correlated."""
    interval, rows = pace(run)
    own = run.noise[name].spectrum(k, interval)
    more = [a**2 * spectrum_of(k, k / (part * rows)) for a in MORE_NOISE for part in MEMORIES]
    return np.array([own, *(own + one for one in more)])


def unlisted_evidence(
    residuals: Sequence[Matrix],
    floor_shares: Sequence[Sequence[float]] = (),
    of_noise: Sequence[Sequence[Matrix]] = (),
) -> float:
    """Log Bayes factor of an unknown smooth function of time in one channel, in all recordings, beside noise.

    `residuals`: (channels, k) of every run. `of_noise`: by run and channel, the variances of the cosine coefficients of
    its noise (`spectra_of_noise`); of alternatives the first one counts, and that which is most probable by itself.

    A Gaussian process with covariance a^2 exp(-|t - t'|/l) has nearly independent cosine coefficients d_j of variance
    a^2 s_j(l), which white noise of variance 1 adds to; averaged over amplitudes a and correlation times l, and over the
    channels. `floor_shares`: by run and channel, the part f of the variance of the noise that is what repeated experiments
    differ by. That lasts as well, so that noise alone has coefficients of variance 1 - f + f s_j(l), averaged over l.
    """
    channels = max(len(rows) for rows in residuals)
    shares = floor_shares or [[0.0] * channels] * len(residuals)
    noises = of_noise or [[np.ones((1, 1))] * channels] * len(residuals)
    factors = []
    for channel in range(channels):
        rows = [
            (of_run[channel], share[channel] if share else 0.0, noise[channel])
            for of_run, share, noise in zip(residuals, shares, noises, strict=True)
            if channel < len(of_run)
        ]
        spectra = [(dct(measured(row), norm='ortho') ** 2, share, noise) for row, share, noise in rows if np.any(row)]
        if spectra:
            lasts = any(share for _, share, _ in spectra)
            alone, beside = list[float](), list[float]()
            for lasting in PERIODS if lasts else PERIODS[:1]:  # all alike where no part of it lasts
                found = [
                    [
                        (power, (1.0 - f) * own[one % len(own)] + f * spectrum_of(len(power), lasting))
                        for power, f, own in spectra
                    ]
                    for one in range(max(len(own) for _, _, own in spectra))
                ]
                of_each = [sum(log_density(power, variance) for power, variance in of_one) for of_one in found]
                for one in sorted({0, int(np.argmax(of_each))}):
                    alone.append(of_each[one])
                    for period in PERIODS:
                        both = [(power, known, spectrum_of(len(power), period)) for power, known in found[one]]
                        beside += [
                            sum(log_density(power, known + a**2 * more) for power, known, more in both) for a in AMPLITUDES
                        ]
            factors.append(log_mean(beside) - log_mean(alone))
    return log_mean(factors) if factors else 0.0


def log_density(power: Vector, variance: Vector) -> float:
    """The log density of cosine coefficients of these variances (k,) by their squares (k,), up to a constant."""
    return -0.5 * float(np.sum(power / variance + np.log(variance)))


def spectrum_of(k: int, periods: float) -> Vector:
    """The variances (k,) of the cosine coefficients of a process of variance 1 that changes after a part of the length."""
    length = k / periods
    found: Vector = 2.0 * length / (1.0 + (length * np.pi * np.arange(k) / k) ** 2)
    return found


def log_mean(values: Sequence[float]) -> float:
    """log of the mean of exp."""
    return log_sum(values) - float(np.log(len(values)))


def log_sum(values: Sequence[float]) -> float:
    """log of the sum of exp."""
    return float(np.logaddexp.reduce(np.asarray(values, float)))
