"""Single samples that are far off, and a noise that is stated wrong: what the scatter of residuals about themselves says.

A model that lacks something, or whose parameters are not fitted yet, leaves residuals that are smooth from sample to sample:
differences of a high order leave their noise alone, and a median of neighbours their course.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import log, sqrt

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from sma_sim.evidence.data.noise import DIFFERENCE_ORDER, difference_scale
from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.recordings import NEGLIGIBLE_FRACTION, value_range
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.evidence.search.refine import WINDOW
from sma_sim.evidence.search.score import SPARSITY
from sma_sim.evidence.set_up.faults import Fault

Vector = NDArray[np.float64]
Rows = NDArray[np.float64]
Mask = NDArray[np.bool_]
ORDERS = (3, 4, 5)  # of differences: white noise has the same size by all of them, what moves has not
SCATTER = 2.0  # times 1/samples: the variance of the log of a scale by differences of these orders
MOST_STDS = 3.0  # by which two estimates of one number differ
NEIGHBOURS = 8  # of a sample, half of them on either side, that tell where it should be
STANDS_OUT = 2.0  # times its size: what a single sample adds to differences of third order (1, 3, 3, 1), noise against it
MAD = 1.4826  # standard deviation of normal noise over its median absolute deviation
LONGEST = 3  # samples next to each other: what lasts longer moves
MOST = 0.1  # of the samples of a run: more are no outliers


def outliers(problem: Problem, residuals: Sequence[Rows]) -> list[Fault]:
    """By channel, the samples that are far from where their neighbours in the residuals say: by so much that chance among
    all samples, and any motion that neighbours share, is out of the question by the odds of Occam's window."""
    found = []
    for channel in dict.fromkeys(name for run in problem.runs for name in run.channels):
        rows, samples = dict[str, tuple[int, ...]](), 0
        for run, left in zip(problem.runs, residuals, strict=True):
            if channel in run.channels:
                k = run.channels.index(channel)
                known = np.flatnonzero(run.weight[k])
                samples += len(known)
                own = isolated(run.time[known], left[k][known])
                own &= stands_out(run, known, run.measured[k] * run.weight[k], own)
                wrong = known[own]
                rows |= {run.name: tuple(wrong.tolist())} if len(wrong) else {}
        if rows:
            share = sum(map(len, rows.values())) / samples
            found.append(Fault('outliers', (channel,), recordings=tuple(rows), rows=rows, share=share))
    return found


def isolated(time: Vector, values: Vector) -> Mask:
    """Which of the values (k,), in units of the stated noise, are outliers."""
    none, half = np.zeros(len(values), dtype=bool), NEIGHBOURS // 2
    scale = difference_scale(time, values)
    if scale is None or len(values) <= NEIGHBOURS:
        return none
    limit = chance_limit(len(values))
    if np.abs(np.diff(values, n=DIFFERENCE_ORDER)).max() < STANDS_OUT * limit * max(1.0, scale):
        return none  # no sample stands out of its neighbours
    windows = sliding_window_view(np.pad(values, half, mode='reflect'), NEIGHBOURS + 1)
    around = np.delete(windows, half, axis=1)
    middle = np.median(around, axis=1)
    spread = np.maximum(MAD * np.median(np.abs(around - middle[:, None]), axis=1), max(1.0, scale))
    found = np.abs(values - middle) > limit * spread
    starts = np.flatnonzero(np.diff(found.astype(int), prepend=0) == 1)
    ends = np.flatnonzero(np.diff(found.astype(int), append=0) == -1)
    for first, last in zip(starts, ends, strict=True):
        found[first : last + 1] &= last - first < LONGEST
    return found if found.mean() <= MOST else none


def stands_out(run: FitData, known: NDArray[np.int64], values: Vector, wrong: Mask) -> Mask:
    """Which of the `known` samples (k,) that are far off are no answer to a change of the command.

    Just after one, at the start too, a model may be far off for a sample: it bends at the change, and a sample whose
    neighbours reach back to there is not where they say. It counts only where what was measured (`values`, in units of the
    noise) stands out by itself: from those before and after it, on the same side.
    """
    time, right = run.time[known], np.flatnonzero(~wrong)
    found = np.ones(len(known), dtype=bool)
    since = np.searchsorted(run.source.times, time, side='right')
    before = np.searchsorted(run.source.times, time[np.maximum(np.arange(len(time)) - NEIGHBOURS // 2, 0)], side='left')
    for k in np.flatnonzero(wrong & (since > before)):
        at = np.searchsorted(right, k)
        if at == 0 or at == len(right):
            found[k] = False
            continue
        low, high = sorted(values[known[right[at - 1 : at + 1]]].tolist())
        found[k] = max(values[known[k]] - high, low - values[known[k]]) > chance_limit(len(known))
    return found


def chance_limit(samples: int) -> float:
    """How far, in standard deviations, one of so many normal samples cannot be, by the odds of Occam's window."""
    return sqrt(2.0 * (log(samples) + SPARSITY + WINDOW))


def scales(problem: Problem, rows: Sequence[Rows], order: int) -> dict[str, tuple[float, int]]:
    """By channel, the size of white noise in rows (channels, k) of every run, in units of the stated noise, and the samples
    behind it."""
    squares: dict[str, float] = {}
    counts: dict[str, int] = {}
    for run, row in zip(problem.runs, rows, strict=True):
        for k, name in enumerate(run.channels):
            known = run.weight[k] > 0.0
            scale = difference_scale(run.time[known], row[k][known], order)
            if scale is not None:
                count = int(known.sum())
                squares[name] = squares.get(name, 0.0) + count * scale**2
                counts[name] = counts.get(name, 0) + count
    return {name: (sqrt(squares[name] / counts[name]), counts[name]) for name in squares}


def wrong_noise(problem: Problem, residuals: Sequence[Rows], dataset: Dataset, is_fitted: bool) -> list[Fault]:
    """The channels whose noise is stated too small, or too large, where differences of all orders agree on it.

    Too small: the samples themselves scatter as much, not only what a model leaves of them. Too large: a fit (`is_fitted`)
    leaves as little; a noise that is slow may hide from differences. Not where repeated experiments say what noise is, nor
    where none is visible.
    """
    if dataset.floor or problem.config.structure.structure.is_quasi_static:
        return []
    by_order = [scales(problem, residuals, order) for order in ORDERS]
    raw = scales(problem, [run.measured * run.weight for run in problem.runs], ORDERS[0])
    sizes = dict[str, tuple[float, int]]()
    for name, (_, count) in by_order[0].items():
        found = [scale[name][0] for scale in by_order if name in scale]
        least = float(np.exp(sqrt(2.0 * SCATTER * (WINDOW + SPARSITY) / count)))
        limit = max(CRITERIA.noise_only, least)
        if len(found) < len(ORDERS) or min(found) <= 0.0 or max(found) > limit * min(found):
            continue
        size = found[0]
        if size > limit and raw[name][0] < limit * size:
            sizes[name] = size, count
        elif size < 1.0 / limit and is_fitted and all_of(problem, residuals, name) < limit * size:
            spans = [value_range(one.channels[name]) for one in dataset.recordings if name in one.channels]
            visible = NEGLIGIBLE_FRACTION * max(spans)
            if size * dataset.noise_std[name] > visible:
                sizes[name] = size, count
    return grouped(sizes)


def all_of(problem: Problem, residuals: Sequence[Rows], channel: str) -> float:
    """Root mean square of a channel."""
    squares = count = 0.0
    for run, rows in zip(problem.runs, residuals, strict=True):
        if channel in run.channels:
            k = run.channels.index(channel)
            squares, count = squares + float(np.vdot(rows[k], rows[k])), count + np.count_nonzero(run.weight[k])
    return sqrt(squares / max(1.0, count))


def grouped(sizes: Mapping[str, tuple[float, int]]) -> list[Fault]:
    """One fault for channels that are off by the same, as far as their samples tell."""
    found = list[tuple[list[str], float, int]]()
    for name, (size, count) in sizes.items():
        for k, (names, other, behind) in enumerate(found):
            if abs(log(size / other)) < MOST_STDS * sqrt(SCATTER * (1.0 / count + 1.0 / behind)):
                mean = (count * size + behind * other) / (count + behind)
                found[k] = ([*names, name], mean, count + behind)
                break
        else:
            found.append(([name], size, count))
    return [Fault('noise', tuple(names), size) for names, size, _ in found]
