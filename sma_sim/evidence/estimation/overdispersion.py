"""How much less correlated residuals of a wrong model say than their number and the stated noise would let them.

N residuals of size e (in units of the noise) that stay correlated over tau samples are N/tau independent ones, each as
uncertain as e, and no less than the noise that is stated: their squares count max(e, 1)^2 tau times too much (1 when the
model is right). Where e is below 1, the noise is what errors may be, as of recordings in which none is visible.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from math import inf, sqrt

import numpy as np

from sma_sim.evidence.estimation.problem import Problem, residuals_at
from sma_sim.model.arrays import Matrix, Vector

WHITE_STDS = 3.0  # standard deviations within which white noise stays in all but one of hundreds of rows


def overdispersion(problem: Problem, z: Vector, pool: Executor) -> float:
    """k of a model at z; inf where it cannot be run."""
    found = [residuals for residuals in residuals_at(problem, z, pool) if residuals is not None]
    return inf if len(found) < len(problem.runs) else overdispersion_of(problem, found)


def overdispersion_of(problem: Problem, residuals: Sequence[Matrix]) -> float:
    """k of the residuals (channels, k) of every run."""
    return overdispersion_of_rows([row for rows in residuals for row in rows], problem.samples)


def overdispersion_of_rows(rows: Sequence[Vector], samples: int) -> float:
    """k of series of residuals: their root mean square over so many samples, if above 1, times the root of their longest
    correlation time in samples."""
    squares = sum(float(row @ row) for row in rows)
    longest = max((autocorrelation_time(measured(row)) for row in rows if row.any()), default=1.0)
    return sqrt(max(squares / max(samples, 1), 1.0) * max(longest, 1.0))


def measured(residuals: Vector) -> Vector:
    """The residuals of a row where something was measured: where nothing was, as of a channel with a lower rate, they are 0,
    and would count as samples that the model explains and that part those that it does not."""
    found: Vector = residuals[residuals != 0.0]
    return found


def autocorrelation_time(series: Vector) -> float:
    """1 + 2 sum of the autocorrelation, up to where a pair of neighbours sums to what white noise may (Geyer 1992).

    Of k values of white noise each autocorrelation has the variance 1/k, and a pair twice that.
    """
    k = len(series)
    spectrum = np.abs(np.fft.rfft(series, 2 * k)) ** 2
    covariance = np.fft.irfft(spectrum)[:k]
    if covariance[0] <= 0.0:
        return 1.0
    rho = covariance[1 : k - (k - 1) % 2] / covariance[0]
    pairs = rho[0::2] + rho[1::2]
    at_noise = pairs < WHITE_STDS * np.sqrt(2.0 / k)
    end = int(np.argmax(at_noise)) if at_noise.any() else len(pairs)
    return float(1.0 + 2.0 * pairs[:end].sum())
