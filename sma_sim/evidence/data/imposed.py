"""What was imposed on a wire, beside the noise of the sensor that measured it.

A wire feels the load, not the noise of the load cell. Taken as an input, that noise drives the wire through small loops, in
which a hysteresis stays behind: the errors do not average out.
"""

from __future__ import annotations

from math import sqrt
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from sma_sim.evidence.data.noise import difference_scale
from sma_sim.model.arrays import Vector

NOISY = 1.0 / 3.0  # of all steps go back: half as many as those of white noise (Bienayme 1874), far more than of a motion
FEW_BACK = 3.0  # steps that go back: so few may be turns of a motion
MIN_ROWS = 20  # fewer tell nothing of noise
STDS = 3.0  # by which von Neumann's ratio of white noise may be less than 2
FAR = 5.0  # standard deviations from the line: no noise of two rows side by side; of a single row, which cannot be told
PAIR = 1.0  # von Neumann's ratio of two equal rows among zeros: where less than it passes, even a single row is a motion
BEND_OF_NOISE = 2.319  # median of the absolute second difference where white noise turns back, in its standard deviations
TURNS = 20  # around rows, of which the noise there is the median: half may be turns of a motion


class Imposed(NamedTuple):
    """What was imposed (k,), the standard deviation of the noise that it was measured with, and what that leaves unknown.

    `single`: rows that were taken as noise and lie farther from their neighbours than noise does.
    """

    values: Vector
    noise: float = 0.0
    error: float = 0.0
    single: tuple[int, ...] = ()


def without_noise(values: Vector) -> Imposed:
    """Measured values (k,), NaN where missing, of what was imposed, without white noise.

    A constant where that leaves noise only; else the line with corners that leaves no more, each stretch halved while it
    does. As they are where they seldom turn back: rows that move a wire on in one way are not to be smoothed.
    """
    known = np.isfinite(values)
    given = values[known]
    if len(given) < MIN_ROWS or turning_part(given) < NOISY:
        return Imposed(values, error=noise_between_steps(given))
    std = noise_of_turns(given)
    found = values.copy()
    found[known], numbers = fewest_corners(given, std)
    rest = given - found[known]
    noise = float(np.std(rest))
    single = np.flatnonzero(known)[np.abs(rest) > FAR * std]
    return Imposed(found, noise, noise * sqrt(numbers / len(given)), tuple(single.tolist()))


def turning_part(values: Vector) -> float:
    """The part of the steps of values (k,) that go back; equal neighbours count once."""
    steps = np.diff(values)
    steps = steps[steps != 0.0]
    return float(np.mean(steps[1:] * steps[:-1] < 0.0)) if len(steps) > 1 else 0.0


def noise_between_steps(values: Vector) -> float:
    """The standard deviation of noise on values (k,) that is less than most of their steps, by how many of these go back.

    No more than what third differences leave, by which all noise is seen, and steps that differ as well. 0 where no more go
    back than the values turn: what moves on in one way is known as it is.
    """
    steps = np.abs(np.diff(values[np.append(True, np.diff(values) != 0.0)]))
    back = 0.5 * turning_part(values)  # a step that goes back is one of two that turn
    rough = difference_scale(np.arange(float(len(values))), values)
    if rough is None or back * len(steps) < FEW_BACK:
        return 0.0
    return min(rough, float(np.median(steps)) / (sqrt(2.0) * NormalDist().inv_cdf(1.0 - back)))


def noise_of_turns(values: Vector) -> Vector:
    """The standard deviation of white noise on values (k,) around each row, by how far they go where they turn back.

    A motion passes in one way, however fast it is, and counts nothing; its own turns are fewer than those of noise. No less
    than in all of them: what is noise elsewhere is no motion where it is quiet.
    """
    rows = np.flatnonzero(np.append(True, np.diff(values) != 0.0))
    steps = np.diff(values[rows])
    turns = np.flatnonzero(steps[1:] * steps[:-1] < 0.0)
    bends = np.abs(np.diff(steps))[turns]
    count = min(TURNS, len(turns))
    medians = np.median(np.lib.stride_tricks.sliding_window_view(bends, count), axis=1)
    first = np.searchsorted(rows[turns + 1], np.arange(len(values))) - count // 2
    around = medians[np.clip(first, 0, len(medians) - 1)]
    std: Vector = np.maximum(around, np.median(bends)) / BEND_OF_NOISE
    return std


def fewest_corners(values: Vector, std: Vector) -> tuple[Vector, int]:
    """A constant or a polyline through values (k,) that leaves noise of `std` (k,), and of how many numbers it is made.

    Of the variance of the noise it keeps so many of k parts (least squares).
    """
    if is_noise(values - values.mean(), std):
        return np.full(len(values), values.mean()), 1
    corners = np.array([0, len(values) - 1])
    while True:
        line = polyline(values, corners)
        halved = [
            (first + last) // 2
            for first, last in zip(corners[:-1], corners[1:], strict=True)
            if last - first > 1 and not is_noise((values - line)[first : last + 1], std[first : last + 1])
        ]
        if not halved:
            return line, len(corners)
        corners = np.union1d(corners, halved)


def is_noise(rest: Vector, std: Vector) -> bool:
    """Whether a rest (m,) is white noise of standard deviations `std` (m,), beside single rows that are far.

    The ratio of the squares of its steps to its own (von Neumann 1941) is then 2 with a standard deviation of 2/sqrt(m), and
    less where neighbours agree. Few rows may have any ratio: none of them is far then, since a stretch has become so short
    where something moves; of more, no two side by side on one side.
    """
    squares = float(rest @ rest)
    if squares == 0.0:
        return True
    least = 2.0 - STDS * 2.0 / sqrt(len(rest))
    side = np.sign(rest) * (np.abs(rest) > FAR * std)
    moves = (side[1:] * side[:-1] > 0.0).any() if least > PAIR else side.any()
    return not moves and float(np.sum(np.diff(rest) ** 2)) / squares >= least


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
