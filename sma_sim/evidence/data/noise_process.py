"""Noise that is correlated, as a filter in a sensor leaves it: an autoregressive process.

Fitted to the autocovariance by the equations of Yule and Walker (Brockwell and Davis, Time Series, 8.1). Whether it is
correlated at all is decided by the criterion of Schwarz (1978), of which order it is by that of Akaike (1974).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, sqrt

import numpy as np

from sma_sim.model.arrays import Vector

MOST_ORDER = 16
LEAST_SAMPLES = 200  # that tell a spectrum
SHORT = 8  # times its memory is a moving mean, of which a longer memory would take the gap at frequency 0 for its own
UNDAMPED = 1e-12  # least squared response, of what vibrates without end
PEAK = 1.5  # times the spectrum at frequency 0, above which chance makes none
ROUNDS = 30  # in which the spectrum at frequency 0 comes to rest
FREQUENCIES = 8192  # at which a spectrum is known


@dataclass(frozen=True)
class NoiseProcess:
    """x_t = sum of a_i x_(t-i) + e_t, in units of the stated noise.

    `coefficients` (p,) are the a_i, `innovation` is the variance of e_t, and `interval` [s] the time from t to t + 1.
    """

    coefficients: Vector
    innovation: float
    interval: float

    def spectrum(self, k: int, interval: float) -> Vector:
        """The variances (k,) of the cosine coefficients of k samples at an `interval` [s]: every so many of the process; no
        less than those of the stated noise."""
        every = max(1, round(interval / self.interval))
        covariance = np.fft.irfft(self.density(np.arange(FREQUENCIES + 1) / FREQUENCIES))[:FREQUENCIES:every]
        whole = np.fft.rfft(np.concatenate([covariance, covariance[:0:-1]])).real
        return np.maximum(np.interp(np.arange(k) / k, np.linspace(0.0, 1.0, len(whole)), whole), 1.0)

    @property
    def std(self) -> float:
        """The standard deviation of the process: the root of the mean of its spectrum."""
        return sqrt(float(np.mean(self.density((np.arange(FREQUENCIES) + 0.5) / FREQUENCIES))))

    @property
    def at_zero(self) -> float:
        """The spectrum at frequency 0."""
        return float(self.density(np.zeros(1))[0])

    @property
    def forgets(self) -> bool:
        """Whether what it was at some time is forgotten."""
        return abs(1.0 - float(np.sum(self.coefficients))) ** 2 > UNDAMPED

    @property
    def is_low_pass(self) -> bool:
        """Whether it is strongest at low frequencies, as a filter leaves noise: what peaks elsewhere vibrates."""
        return bool(self.density(np.arange(FREQUENCIES + 1) / FREQUENCIES).max() < PEAK * self.at_zero)

    def density(self, frequencies: Vector) -> Vector:
        """The spectrum (k,) at parts (k,) of the highest frequency."""
        lags = np.arange(1, len(self.coefficients) + 1)
        response = np.exp(-1j * np.pi * frequencies[:, None] * lags) @ self.coefficients
        found: Vector = self.innovation / np.maximum(np.abs(1.0 - response) ** 2, UNDAMPED)
        return found


def process_of(stretches: Sequence[Vector], interval: float, mean_over: int = 0) -> NoiseProcess | None:
    """The process of which some stretches (k,) are, sampled at an `interval` [s]; None where it is white, or where they are
    too short, or no process with a memory: a swing as long as a moving mean.

    `mean_over`: of how many samples a moving mean was taken from them. That takes S/mean_over from the autocovariance at
    every lag, S being the spectrum at frequency 0, which is given back.
    """
    n = sum(map(len, stretches))
    if n < LEAST_SAMPLES:
        return None
    most = min(MOST_ORDER, max(1, mean_over // SHORT)) if mean_over else MOST_ORDER
    covariance = np.array(
        [sum(float(one[lag:] @ one[: len(one) - lag]) for one in stretches) / n for lag in range(most + 1)]
    )
    process, before = autoregressive(covariance, n, interval), 0.0
    for _ in range(ROUNDS if mean_over else 0):
        if process is None or process.at_zero == before:
            break
        before = process.at_zero
        process = autoregressive(covariance + before / mean_over, n, interval)
    return process if process is not None and process.forgets else None


def autoregressive(covariance: Vector, n: int, interval: float) -> NoiseProcess | None:
    """The process with the autocovariance (orders + 1,) of n samples, by the recursion of Levinson and Durbin; None
    where it is white."""
    if covariance[0] <= 0.0:
        return None
    coefficients, innovation = np.zeros(0), float(covariance[0])
    white, found = n * log(innovation), list[tuple[float, NoiseProcess]]()
    for order in range(1, len(covariance)):
        reflection = float(covariance[order] - coefficients @ covariance[order - 1 : 0 : -1]) / innovation
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        innovation *= 1.0 - reflection**2
        if innovation <= 0.0:
            break
        found.append((n * log(innovation), NoiseProcess(coefficients, innovation, interval)))
    if all(squares + order * log(n) >= white for order, (squares, _) in enumerate(found, 1)):
        return None
    return min(enumerate(found, 1), key=lambda one: one[1][0] + 2.0 * one[0])[1][1]
