"""Where the squared error of a channel concentrates: a search over conditions, and how certain that is.

A region is a conjunction of conditions. It is searched greedily for the largest share of the squared error minus share
of the samples (weighted relative accuracy, Klosgen 1996). Blocks of a run, longer than its residuals are correlated,
are drawn again for the interval of the share. The search is repeated with the blocks of the squared error in random
order, where they have nothing to do with the conditions: how often that finds as much is the p-value, selection
included. It is repeated on random halves of the blocks too: the part of them that finds the same region again says how
certain its borders are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.overdispersion import autocorrelation_time
from sma_sim.evidence.residual_analysis.error_by_stratum import ChannelSamples
from sma_sim.evidence.residual_analysis.strata import Classes, Dimension
from sma_sim.model.arrays import Mask, Matrix, Vector

MIN_GAIN = 0.03  # a condition must add as much of share minus share of the samples
MIN_COVERAGE = 0.02  # of the samples: smaller regions are not reported
MAX_CONDITIONS = 3  # more of them nobody can read in a sentence
MAX_SEARCH_SAMPLES = 4_000  # of a search; more are thinned
MAX_BLOCKS_PER_RUN, MIN_BLOCKS_PER_RUN = 60, 8  # of the bootstrap
BOOTSTRAP_DRAWS, RANDOM_HALVES, PERMUTATIONS = 1000, 40, 99  # intervals to 1 %, replication to 8 %, p-values to 0.01
MIN_OVERLAP = 0.5  # overlap, by squared error, at which a half's region counts as the same


@dataclass(frozen=True)
class Condition:
    """A class of a dimension, or neighbouring bands of it joined: (n,) samples of it are in `mask`."""

    way: Dimension
    first: int
    last: int
    mask: Mask

    @property
    def words(self) -> str:
        """In words."""
        return self.way.words(self.first, self.last)


@dataclass(frozen=True)
class Conditions:
    """Conditions of one class or of joined bands, and their masks as the rows of a matrix (conditions, n)."""

    single: tuple[Condition, ...]
    matrix: NDArray[np.float32]


@dataclass(frozen=True)
class Region:
    """Samples (n,) that satisfy all conditions; `quality`: share of the squared error minus share of the samples."""

    conditions: tuple[Condition, ...]
    mask: Mask
    quality: float


@dataclass(frozen=True)
class RegionCertainty:
    """95 % interval of a region's share, and of the ratio of its later to its earlier mean squared error (over its runs).

    `p`: how likely a search finds as much where there is nothing; `again`: part of random halves of the data in which
    it finds the region again.
    """

    low: float
    high: float
    p: float
    again: float
    trend: tuple[float, float, float]


def conditions_of(ways: Sequence[Dimension], samples: ChannelSamples) -> Conditions:
    """All single conditions: classes, and joined bands where classes have an order."""
    found = []
    for way in ways:
        classes = np.concatenate(way.classes)[samples.index]
        count = len(way.labels)
        for first in range(count):
            for last in range(first, count) if way.edges else (first,):
                mask = (classes >= first) & (classes <= last)
                if last - first < count - 1 and mask.any():
                    found.append(Condition(way, first, last, mask))
    matrix = np.array([condition.mask for condition in found], dtype=np.float32).reshape(len(found), len(samples.index))
    return Conditions(tuple(found), matrix)


def thinned(samples: ChannelSamples) -> ChannelSamples:
    """Every so many samples, at most MAX_SAMPLES."""
    every = -(-len(samples.index) // MAX_SEARCH_SAMPLES)
    names = ('residual', 'scaled', 'run', 'part', 'index')
    return ChannelSamples(samples.channel, *(getattr(samples, name)[::every] for name in names))


def find_region(conditions: Conditions, error: Vector, time: Vector) -> Region | None:
    """The region with the largest share of `error` minus share of `time`, (n,) weights that sum to 1; None for none."""
    return find_regions(conditions, error[None], time[None])[0]


def find_regions(conditions: Conditions, errors: Matrix, times: Matrix) -> list[Region | None]:
    """`find_region` of every row of `errors` and `times` (d, n), all at once: products of matrices."""
    if not conditions.single:
        return [None] * len(errors)
    excess, weight = (errors - times).astype(np.float32), np.broadcast_to(times, errors.shape).astype(np.float32)
    searching, quality = np.arange(len(errors)), np.zeros(len(errors))
    chosen: list[list[Condition]] = [[] for _ in searching]
    for _ in range(MAX_CONDITIONS):
        gains = np.where(weight @ conditions.matrix.T >= MIN_COVERAGE, excess @ conditions.matrix.T, -np.inf)
        best = np.argmax(gains, axis=1)
        gain = gains[np.arange(len(best)), best]
        better = gain > quality[searching] + MIN_GAIN
        searching, best = searching[better], best[better]
        quality[searching] = gain[better]
        for row, condition in zip(searching, best, strict=True):
            chosen[row].append(conditions.single[condition])
        inside = conditions.matrix[best]
        excess, weight = excess[better] * inside, weight[better] * inside
    return [
        Region(tuple(found), np.logical_and.reduce([one.mask for one in found]), float(of_row)) if found else None
        for found, of_row in zip(chosen, quality, strict=True)
    ]


def blocks_of(samples: ChannelSamples) -> Classes:
    """The block of every sample (n,): stretches of a run that are longer than its residuals are correlated."""
    block, used = np.zeros(len(samples.index), dtype=np.int64), 0
    for run in np.unique(samples.run):
        at = np.flatnonzero(samples.run == run)
        time = autocorrelation_time(samples.scaled[at] - samples.scaled[at].mean())
        count = int(np.clip(len(at) / (4.0 * time), MIN_BLOCKS_PER_RUN, MAX_BLOCKS_PER_RUN))
        block[at] = used + np.arange(len(at)) * count // len(at)
        used += count
    return block


def assess_region(
    region: Region, conditions: Conditions, samples: ChannelSamples, error: Vector, left: Mask
) -> RegionCertainty:
    """How certain a region is; `error` (n,) are the squared errors that were searched, `left` (n,) the samples of them."""
    block = blocks_of(samples)
    count = int(block.max()) + 1
    random = np.random.default_rng(0)
    inside = np.bincount(block, error * region.mask, count)
    total = np.bincount(block, error, count)
    draws = random.multinomial(count, np.full(count, 1.0 / count), BOOTSTRAP_DRAWS)
    shares = (draws @ inside) / np.maximum(draws @ total, 1e-300)
    late = samples.part > 0.5
    low, high = np.quantile(shares, (0.025, 0.975))
    return RegionCertainty(
        float(low),
        float(high),
        permutation_p_value(region, conditions, error, left, block),
        replication_rate(region, conditions, error, block),
        trend(region.mask & late, region.mask & ~late, error, block, draws),
    )


def trend(late: Mask, early: Mask, error: Vector, block: Classes, draws: Classes) -> tuple[float, float, float]:
    """Mean squared error late over early: its value and 95 % interval; NaN where there is no early error."""
    count = draws.shape[1]
    sums = [np.bincount(block, weight, count) for mask in (late, early) for weight in (error * mask, 1.0 * mask)]
    if sums[1].sum() == 0.0 or sums[2].sum() == 0.0:
        return float('nan'), float('nan'), float('nan')

    def ratio(weights: Classes) -> Vector:
        above = (weights @ sums[0]) * (weights @ sums[3])
        below = (weights @ sums[1]) * (weights @ sums[2])
        return np.divide(above, below, out=np.where(above > 0.0, np.inf, 0.0), where=below > 0.0)

    low, high = np.quantile(ratio(draws), (0.025, 0.975), method='inverted_cdf')  # no difference of two infinite ones
    return float(ratio(np.ones((1, count), dtype=np.int64))[0]), float(low), float(high)


def permutation_p_value(region: Region, conditions: Conditions, error: Vector, left: Mask, block: Classes) -> float:
    """The p-value of a region: how often blocks of the squared error in random order concentrate as much."""
    random, within = np.random.default_rng(5), error[left]
    blocks = np.split(within, np.flatnonzero(np.diff(block[left])) + 1)
    mixed = np.zeros((PERMUTATIONS, len(error)))
    mixed[:, left] = [np.concatenate([blocks[k] for k in random.permutation(len(blocks))]) for _ in mixed]
    found = find_regions(conditions, mixed / within.sum(), (left / left.sum())[None])
    as_much = sum(one is not None and one.quality >= region.quality for one in found)
    return (1 + as_much) / (1 + PERMUTATIONS)


def replication_rate(region: Region, conditions: Conditions, error: Vector, block: Classes) -> float:
    """In which part of random halves of the blocks the search finds a region that overlaps with this one."""
    random, count = np.random.default_rng(1), int(block.max()) + 1
    taken = np.array([np.isin(block, random.permutation(count)[: count // 2]) for _ in range(RANDOM_HALVES)])
    weight = taken * error
    taken, weight = taken[weight.any(axis=1)], weight[weight.any(axis=1)]
    again = 0
    for found in find_regions(conditions, shares(weight), shares(taken)):
        if found is not None:
            both, either = error[found.mask & region.mask].sum(), error[found.mask | region.mask].sum()
            again += int(both > MIN_OVERLAP * either)
    return again / RANDOM_HALVES


def shares(weights: Matrix | NDArray[np.bool_]) -> Matrix:
    """Rows (d, n) that sum to 1."""
    found: Matrix = weights / weights.sum(axis=1, keepdims=True)
    return found
