"""How noisy a channel is, from the channel itself.

Differences of order m take away whatever moves like a polynomial of degree m - 1 within m + 1 samples and leave the
noise: for white noise of standard deviation s they have the variance s^2 binom(2 m, m) (von Neumann's successive
differences for m = 1). Their scale is taken from the smaller 80 % of them, so that kinks, steps and outliers do not
count, and corrected by what a normal distribution has in that part; then again without those beyond five of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb, sqrt
from statistics import NormalDist

import numpy as np

from sma_sim.evidence.data.recording import Recording
from sma_sim.model.arrays import Vector

DIFFERENCE_ORDER = 3  # removes motion that is quadratic within four samples
CENTRAL_FRACTION = 0.8  # of the differences: the smaller ones
MAX_DEVIATION = 5.0  # standard deviations: what is beyond is no noise
MIN_NOISE_SAMPLES = 20  # fewer give no useful standard deviation
NOISE_BLOCK_LENGTH, NOISE_BLOCKS = 20_000, 10  # of a longer record only so many stretches of so many samples are used
HELD_FRACTION = 0.3  # more equal neighbours than this: held samples or a coarse step
FEW, MANY = 3, 4  # readings of one value side by side, at most; times as many of them as chance makes
COMMON_FRACTION = 0.98  # of the samples show the resolution
FAST_STEPS = 2.0  # of the resolution between neighbours, in which the error of rounding is another one each time
COARSE_STEPS = 0.5  # below this many steps of the resolution the differences do not see the noise


@dataclass(frozen=True)
class Noise:
    """The standard deviation `std` of the noise of one channel, the smallest `step` of its numbers, the samples behind it.

    SI units; `step` is 0 where the numbers have no visible resolution. `held` says that each value is repeated: the
    sensor is slower than the recording.
    """

    std: float
    step: float
    samples: int
    held: bool = False

    @property
    def quantised(self) -> bool:
        """Whether the resolution dominates the noise."""
        return self.step > 0.0 and self.std < self.step


def estimate_noise(time: Vector, values: Vector) -> Noise | None:
    """The noise of one channel `values` (k,), NaN where missing, at `time` (k,) [s]; None for too few samples.

    Quantised numbers never have less than their rounding error, step / sqrt(12).
    """
    known = np.isfinite(values)
    time, values = representative(time[known], values[known])
    if len(values) < MIN_NOISE_SAMPLES:
        return None
    step = resolution(values)
    keep = values[1:] != values[:-1]
    held = bool(1.0 - keep.mean() > HELD_FRACTION and is_held(values)) or (step == 0.0 and is_read_twice(values))
    if held:
        fresh = np.concatenate([[True], keep])
        time, values = time[fresh], values[fresh]
    rough = difference_scale(time, values)
    if rough is None:
        return None
    std = rough if rough > COARSE_STEPS * step else max(rough, noise_of_coarse(values, step))
    return Noise(std, step, len(values), held)


def noise_of_coarse(values: Vector, step: float) -> float:
    """The noise of numbers (k,) with a coarse resolution: their rounding error; where they pass through several steps to the
    next one, so that this is white, what differences see of both, no more than what they would see everywhere."""
    rounding, fast = step / sqrt(12.0), np.abs(np.diff(values)) >= FAST_STEPS * step
    passing = np.convolve(fast, np.ones(DIFFERENCE_ORDER), 'valid') > DIFFERENCE_ORDER - 0.5
    sizes = np.abs(np.diff(values, n=DIFFERENCE_ORDER))[passing]
    if len(sizes) < MIN_NOISE_SAMPLES:
        return rounding
    seen = scale_of_smaller(sizes) / sqrt(comb(2 * DIFFERENCE_ORDER, DIFFERENCE_ORDER))
    return min(max(seen, rounding), COARSE_STEPS * step)


def representative(time: Vector, values: Vector) -> tuple[Vector, Vector]:
    """All of a short record, blocks evenly over a long one."""
    if len(values) <= NOISE_BLOCK_LENGTH * NOISE_BLOCKS:
        return time, values
    starts = np.linspace(0, len(values) - NOISE_BLOCK_LENGTH, NOISE_BLOCKS).astype(int)
    chosen = np.concatenate([np.arange(start, start + NOISE_BLOCK_LENGTH) for start in starts])
    return time[chosen], values[chosen]


def resolution(values: Vector) -> float:
    """The step on whose multiples all values lie, 0 where they have none that could matter.

    A step matters when the values take few different numbers: less than one new number for every four samples. Numbers
    that are seldom taken may lie off the grid (some loggers interpolate).
    """
    distinct, counts = np.unique(values, return_counts=True)
    order = np.argsort(counts)[::-1]
    common = np.cumsum(counts[order]) - counts[order] < COMMON_FRACTION * len(values)
    steps = np.diff(np.sort(distinct[order[common]]) if common.sum() > 1 else distinct[counts > 1])
    steps = steps[steps > 1e-12 * np.abs(distinct).max()]  # two spellings of one number
    if len(steps) == 0 or 4 * len(steps) > len(values):
        return 0.0
    return float(np.quantile(steps, 0.1))


def is_held(values: Vector) -> bool:
    """Whether equal neighbours come from a sensor that is slower than the recording, not from a coarse resolution."""
    changes = np.flatnonzero(values[1:] != values[:-1])
    if len(changes) < MIN_NOISE_SAMPLES:
        return False
    runs = np.diff(changes)
    even = np.mean(np.abs(runs - np.median(runs)) <= 1) > 0.9
    return bool(even and np.median(runs) > 1)


def is_read_twice(values: Vector) -> bool:
    """Whether a sensor of fine resolution was now and then read again before it had anything new.

    Equal neighbours are then far more than neighbours that differ by the least difference there is, as by chance they would
    not be, and few of them stand side by side, as they would at rest without noise.
    """
    apart = np.abs(np.diff(values))
    if not apart.any() or np.all(apart > 0.0):
        return False
    least = np.count_nonzero((apart > 0.0) & (apart < 1.5 * np.min(apart[apart > 0.0])))
    ends = np.flatnonzero(np.concatenate([[True], apart > 0.0, [True]]))
    again = np.diff(ends)[np.diff(ends) > 1]
    return bool(len(again) >= MIN_NOISE_SAMPLES and np.mean(again <= FEW) > 0.9 and len(again) > MANY * least)


def difference_scale(time: Vector, values: Vector, order: int = DIFFERENCE_ORDER) -> float | None:
    """Robust standard deviation of white noise on `values` (k,), all finite; None for too few differences.

    By differences of an `order`. Only stretches without a gap in `time` count.
    """
    differences = np.diff(values, n=order)
    steps = np.diff(time)
    if len(steps) >= order:
        gap = steps > 1.5 * np.median(steps)
        near = np.convolve(gap, np.ones(order), 'valid') > 0.5
        differences = differences[~near]
    if len(differences) < MIN_NOISE_SAMPLES - order:
        return None
    sizes = np.abs(differences)
    rough = scale_of_smaller(sizes)
    return scale_of_smaller(sizes[sizes <= MAX_DEVIATION * rough]) / sqrt(comb(2 * order, order))


def scale_of_smaller(sizes: Vector) -> float:
    """Standard deviation of a normal variable from the smaller ones of its absolute values (k,)."""
    count = max(int(CENTRAL_FRACTION * len(sizes)), 1)
    smaller = np.partition(sizes, count - 1)[:count]
    limit = NormalDist().inv_cdf(0.5 + 0.5 * CENTRAL_FRACTION)
    share = 1.0 - 2.0 * limit * NormalDist().pdf(limit) / CENTRAL_FRACTION  # variance within +-limit
    return float(sqrt(np.mean(smaller**2) / share))


def noise_by_channel(recordings: Sequence[Recording]) -> dict[str, Noise]:
    """The noise of every channel over several recordings, each weighted by its samples."""
    found: dict[str, list[Noise]] = {}
    for recording in recordings:
        for name, values in recording.channels.items():
            noise = estimate_noise(recording.time, values)
            rounding = recording.rounding.get(name)
            if noise is not None and rounding is not None:
                noise = replace(noise, std=rounding.noise_std, step=rounding.step)
            if noise is not None:
                found.setdefault(name, []).append(noise)
    return {name: pooled_noise(parts) for name, parts in found.items()}


def pooled_noise(parts: Sequence[Noise]) -> Noise:
    """One estimate from several."""
    samples = sum(part.samples for part in parts)
    variance = sum(part.samples * part.std**2 for part in parts) / samples
    return Noise(sqrt(variance), max(part.step for part in parts), samples, any(part.held for part in parts))
