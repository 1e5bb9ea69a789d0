"""Noise that grows with the reading, or with its speed.

An amplifier whose gain fluctuates, a camera far from the middle of its picture, scatter by a part g of the reading y; clocks
that jitter by t scatter by t times the speed of what is read. With the noise s at rest at zero, the variance of a sample is

    v = s^2 + (g y)^2 + (t dy/dt)^2.

Divided differences of some samples beside each other take away whatever moves like a polynomial; their squares are those of
what scatters, and of the bends that changes of the command leave, which the same differences of its integral show. Reading
and speed are told from samples beside those, so that no outlier counts in both. The parts of the variance are estimated by
Fisher's scoring, none of them negative (McCullagh and Nelder, Generalized Linear Models, 8), and which of them there are by
the criterion of Schwarz (1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb, log

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from sma_sim.evidence.data.noise import MAX_DEVIATION, MIN_NOISE_SAMPLES, representative
from sma_sim.evidence.data.recording import Recording
from sma_sim.model.arrays import Mask, Matrix, Vector
from sma_sim.solver.inputs import Input

ORDER = 5  # of the differences: what swings once in ten samples leaves less than a hundredth of its size
COUNTED = comb(2 * ORDER, ORDER) ** 2 / sum(comb(2 * ORDER, k) ** 2 for k in range(2 * ORDER + 1))
"""Independent values per difference: the squares of differences of white noise beside each other are correlated."""
SMOOTHED = 0.2  # [s], in which a reading and its speed are known: what robots of wires do lasts longer
LEAST_ROWS, MOST_ROWS = 3, 25  # on each side, that tell them
GAP = 1.5  # times the usual interval: differences do not reach over it
SURPRISES = 0.002  # share of differences that are no noise: kinks and outliers, all sizes of which are alike likely ...
SURPRISING = 100.0  # up to about ten standard deviations: as dense as zero is at so many times the typical variance
NORMAL_MEDIAN = 0.4549  # of the square of a standard normal value
LEAST = 1e-6  # of the typical variance, below which no variance is: readings are rounded, in their last digit
ROUNDS = 20  # of scoring, which converges in less


@dataclass(frozen=True)
class VaryingNoise:
    """What the noise of a channel is beside that at rest at zero, of standard deviation `std` (SI): a part `growth` of the
    reading, and the speed of the reading times the `jitter` [s] of its clock."""

    std: float
    growth: float
    jitter: float

    def added(self, time: Vector, values: Vector) -> Vector:
        """The standard deviation (k,) of each sample beside that at rest at zero; NaN where none was read."""
        level, speed = smoothed(time, values)
        found: Vector = np.hypot(self.growth * level, self.jitter * speed)
        return found


def varying_noise(recordings: Sequence[Recording], channel: str, stated: float = 0.0) -> VaryingNoise | None:
    """The noise of a channel that the recordings have; None where it is the same everywhere, or nowhere more than a `stated`
    standard deviation, or where they are too short, or sampled so slowly that what the robot does looks like noise."""
    each = [differences(one, np.asarray(one.channels[channel], dtype=float)) for one in recordings]
    squares, parts = np.concatenate([one for one, _ in each]), np.concatenate([one for _, one in each])
    typical = float(np.median(squares)) / NORMAL_MEDIAN if len(squares) else 0.0
    if len(squares) < MIN_NOISE_SAMPLES or typical == 0.0:
        return None
    scale = np.maximum(parts.max(axis=0), np.finfo(float).tiny)
    parts = parts / scale
    penalty, least = 0.5 * log(COUNTED * len(squares)), max(stated**2, LEAST * typical)
    best, chosen = -np.inf, np.zeros(4)
    for more in (tuple(one) for count in range(3) for one in combinations((2, 3), count)):
        columns = [0, 1, *more]
        found = np.zeros(4)
        found[columns] = scored(squares, parts[:, columns], typical, least)
        score = COUNTED * log_likelihood(squares, np.maximum(parts @ found, least), typical) - penalty * len(more)
        if score > best:
            best, chosen = score, found
    std, _, growth, jitter = np.sqrt(chosen / scale).tolist()
    return VaryingNoise(std, growth, jitter) if growth > 0.0 or jitter > 0.0 else None


def differences(recording: Recording, values: Vector) -> tuple[Vector, Matrix]:
    """Squares (m,) of divided differences of values (k,), NaN where missing, each of which varies as a sample does, and what
    their variance has parts of, (m, 4): 1, the square of what a bend of the command leaves nearby, and those of the reading
    and of its speed."""
    known = np.isfinite(values)
    time, shown = representative(np.asarray(recording.time, dtype=float)[known], values[known])
    usual = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    half = half_window(usual)
    if len(time) <= ORDER + 2 * half or 2.0 * LEAST_ROWS * usual > SMOOTHED:
        return np.zeros(0), np.zeros((0, 4))
    near = sliding_window_view(time, ORDER + 1)
    products = [
        np.prod([(near[:, k] - near[:, j]) / usual for j in range(ORDER + 1) if j != k], axis=0) for k in range(ORDER + 1)
    ]
    factors = 1.0 / np.array(products).T
    factors /= np.sqrt(np.sum(factors**2, axis=1, keepdims=True))
    found, *bends = (
        np.einsum('mk,mk->m', factors, sliding_window_view(rows, ORDER + 1)) ** 2
        for rows in (shown, *integrals(recording.source, time))
    )
    bend = most_within(np.sum(bends, axis=0), half)
    place = np.arange(0.5 - half - 0.5 * (ORDER + 1), half + 0.5 * (ORDER + 1))
    level, speed = parabolas(time, shown, place, np.abs(place) > 0.5 * (ORDER + 1))
    inner = slice(half, len(found) - half)
    whole = np.all(np.diff(near, axis=1) < GAP * usual, axis=1)[inner]
    parts = np.stack([np.ones_like(level), bend[inner], level**2, speed**2], axis=1)
    return found[inner][whole], parts[whole]


def half_window(interval: float) -> int:
    """How many samples at an `interval` [s], on each side, tell a reading and its speed."""
    return int(np.clip(0.5 * SMOOTHED / interval, LEAST_ROWS, MOST_ROWS)) if interval > 0.0 else LEAST_ROWS


def parabolas(time: Vector, values: Vector, place: Vector, used: Mask) -> tuple[Vector, Vector]:
    """Readings and their speed (m,) in the middle of each window of samples at some `place` (p,), by parabolas of least
    squares through those that are `used`."""
    weights = np.zeros((2, len(place)))
    weights[:, used] = np.linalg.pinv(np.vander(place[used], 3, increasing=True))[:2]
    near, when = (sliding_window_view(one, len(place)) for one in (values, time))
    return near @ weights[0], (near @ weights[1]) / (when @ weights[1])


def integrals(source: Input, time: Vector) -> Matrix:
    """The integrals (columns, k) of what drives a recording, at time (k,) [s]."""
    times, values = np.asarray(source.times, dtype=float), np.asarray(source.values, dtype=float)
    steps = np.diff(times)[:, None] * np.where(source.linear, 0.5 * (values[1:] + values[:-1]), values[:-1])
    whole = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])
    within = np.clip(time, times[0], times[-1])
    after = (time > times[-1]) * (time - times[-1])
    return np.array([np.interp(within, times, one) + after * last for one, last in zip(whole.T, values[-1], strict=True)])


def most_within(values: Vector, reach: int) -> Vector:
    """The largest of the values (k,), which are not negative, as far as `reach` rows around each."""
    found: Vector = sliding_window_view(np.pad(values, reach), 2 * reach + 1).max(axis=1)
    return found


def smoothed(time: Vector, values: Vector) -> tuple[Vector, Vector]:
    """Readings (k,) and their speed, by parabolas through those beside each; NaN where none was read."""
    level, speed = np.full_like(values, np.nan), np.full_like(values, np.nan)
    known = np.isfinite(values)
    at, shown = time[known], values[known]
    half = min(half_window(float(np.median(np.diff(at))) if len(at) > 1 else 0.0), len(at) - 1)
    if half < 2:
        level[known], speed[known] = shown, 0.0
        return level, speed
    place = np.arange(-half, half + 1.0)
    at, shown = (np.pad(one, half, 'reflect', reflect_type='odd') for one in (at, shown))
    level[known], speed[known] = parabolas(at, shown, place, np.ones(len(place), dtype=bool))
    return level, speed


def scored(squares: Vector, parts: Matrix, typical: float, least: float) -> Vector:
    """By part (p,) of the variance, how much of it there is: the most likely, for squares (m,) of normal values, of which
    one varies by what is `typical` and none less than the `least`."""
    variance, found = np.full(len(squares), typical), np.zeros(parts.shape[1])
    for _ in range(ROUNDS):
        usual = (squares <= MAX_DEVIATION**2 * variance) / variance
        rows, before = parts * usual[:, None], found
        found = none_negative(rows.T @ rows, rows.T @ (squares * usual))
        variance = np.maximum(parts @ found, least)
        if np.allclose(found, before, rtol=1e-4, atol=0.0):
            break
    return found


def none_negative(matrix: Matrix, right: Vector) -> Vector:
    """The solution (p,) of normal equations, without the parts that would be negative, the most negative one first."""
    kept, found = list(range(len(right))), np.zeros(len(right))
    while kept:
        part = np.linalg.lstsq(matrix[np.ix_(kept, kept)], right[kept], rcond=None)[0]
        if np.all(part >= 0.0):
            found[kept] = part
            break
        kept.pop(int(np.argmin(part * np.sqrt(np.diag(matrix)[kept]))))
    return found


def log_likelihood(squares: Vector, variance: Vector, typical: float) -> float:
    """Of squares (m,) of normal values with these variances (m,), but for few that are surprises: outliers, of any size, for
    which no part of the variance is asked."""
    usual = log(1.0 - SURPRISES) - 0.5 * (squares / variance + np.log(variance))
    surprise = log(SURPRISES) - 0.5 * log(SURPRISING * typical)
    return float(np.sum(np.logaddexp(usual, surprise)))
