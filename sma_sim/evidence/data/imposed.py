"""What was imposed on a wire, beside the noise of the sensor that measured it.

A wire feels the load, not the noise of the load cell. Taken as an input, that noise drives the wire through small loops, in
which a hysteresis stays behind: the errors do not average out.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

Vector = NDArray[np.float64]
NOISY = 1.0 / 3.0  # of all steps go back: half as many as those of white noise (Bienayme 1874), far more than of a motion
MIN_ROWS = 20  # fewer tell nothing of noise
STDS = 3.0  # by which von Neumann's ratio of white noise may be less than 2


class Imposed(NamedTuple):
    """What was imposed (k,), the standard deviation of the noise that it was measured with, and what that leaves unknown."""

    values: Vector
    noise: float = 0.0
    error: float = 0.0


def without_noise(values: Vector) -> Imposed:
    """Measured values (k,), NaN where missing, of what was imposed, without white noise.

    A constant where that leaves noise only; else the line with corners that leaves no more, each stretch halved while it
    does. As they are where they seldom turn back: rows that move a wire on in one way are not to be smoothed.
    """
    known = np.isfinite(values)
    given = values[known]
    if len(given) < MIN_ROWS or turning_part(given) < NOISY:
        return Imposed(values)
    found = values.copy()
    found[known], numbers = fewest_corners(given)
    noise = float(np.std(given - found[known]))
    return Imposed(found, noise, noise * sqrt(numbers / len(given)))


def turning_part(values: Vector) -> float:
    """The part of the steps of values (k,) that go back; equal neighbours count once."""
    steps = np.diff(values)
    steps = steps[steps != 0.0]
    return float(np.mean(steps[1:] * steps[:-1] < 0.0)) if len(steps) > 1 else 0.0


def fewest_corners(values: Vector) -> tuple[Vector, int]:
    """A constant or a polyline through values (k,) that leaves white noise, and of how many numbers it is made.

    Of the variance of the noise it keeps so many of k parts (least squares).
    """
    if is_noise(values - values.mean()):
        return np.full(len(values), values.mean()), 1
    corners = np.array([0, len(values) - 1])
    while True:
        line = polyline(values, corners)
        halved = [
            (first + last) // 2
            for first, last in zip(corners[:-1], corners[1:], strict=True)
            if not is_noise((values - line)[first : last + 1])
        ]
        if not halved:
            return line, len(corners)
        corners = np.union1d(corners, halved)


def is_noise(rest: Vector) -> bool:
    """Whether a rest (m,) is white noise.

    The ratio of the squares of its steps to its own (von Neumann 1941) is then 2 with a standard deviation of 2/sqrt(m), and
    less where neighbours agree.
    """
    squares = float(rest @ rest)
    return squares == 0.0 or float(np.sum(np.diff(rest) ** 2)) / squares >= 2.0 - STDS * 2.0 / sqrt(len(rest))


def polyline(values: Vector, corners: NDArray[np.int64]) -> Vector:
    """The continuous line of least squares with corners at these rows (m,), at all rows (k,)."""
    rows = np.arange(len(values))
    stretch = np.clip(np.searchsorted(corners, rows, side='right') - 1, 0, len(corners) - 2)
    after = (rows - corners[stretch]) / (corners[stretch + 1] - corners[stretch])
    count, weights = len(corners), (1.0 - after, after)
    diagonal, right = np.zeros(count), np.zeros(count)
    for k, weight in enumerate(weights):
        diagonal += np.bincount(stretch + k, weights=weight**2, minlength=count)
        right += np.bincount(stretch + k, weights=weight * values, minlength=count)
    beside = np.bincount(stretch + 1, weights=weights[0] * weights[1], minlength=count)
    heights = solveh_banded(np.vstack([beside, diagonal]), right)
    found: Vector = heights[stretch] * weights[0] + heights[stretch + 1] * weights[1]
    return found
