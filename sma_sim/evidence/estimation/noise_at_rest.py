"""What noise is while a robot rests, whatever its model lacks.

Where what the model shows creeps at a constant speed for seconds, or stays, nothing physical makes what is left fluctuate
fast: it is the noise of the sensor. A filter there, which smooths it, makes it correlated (`NoiseProcess`), which
differences of samples do not see and a search would take for something that no list has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import log

import numpy as np

from sma_sim.evidence.data.noise_process import LEAST_SAMPLES, MOST_ORDER, NoiseProcess, process_of
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.model.arrays import Matrix, Vector

REST = 2.0  # [s]; what is slower than that is no noise
STILL = 0.3  # of the noise, by which what the model shows differs from its mean over that time at most


def noise_at_rest(problem: Problem, residuals: Sequence[Matrix]) -> dict[str, NoiseProcess]:
    """By channel whose noise at rest is correlated as a filter leaves it, its process; `residuals` (channels, k) by run.

    Not of a channel that fluctuates as others do: a robot that moves where its model rests shows in several.
    """
    stretches = dict[tuple[str, float, int], list[Vector]]()
    together = dict[str, list[Matrix]]()
    for run, left in zip(problem.runs, residuals, strict=True):
        rests = at_rest(run, left)
        for name, own in rests.items():
            stretches.setdefault((name, *pace(run)), []).extend(own)
            others = [rests[other] for other in rests if other != name]
            together.setdefault(name, []).extend(np.array(rows) for rows in zip(own, *others, strict=True))
    longest = sorted(stretches, key=lambda one: sum(map(len, stretches[one])))  # of runs at several rates that of most rest
    found = {name: process_of(stretches[name, interval, rows], interval, rows) for name, interval, rows in longest}
    low_pass = {name: one for name, one in found.items() if one is not None and one.is_low_pass}
    return {name: one for name, one in low_pass.items() if not is_shared(together[name], one)}


def is_shared(stretches: Sequence[Matrix], process: NoiseProcess) -> bool:
    """Whether the first of the channels (channels, k) of some stretches follows from the others, by the criterion of Schwarz
    (1978); samples are as many as the memory of its process leaves independent."""
    left = whole = explained = count = 0.0
    for first, *others in stretches:
        if others:
            basis = np.transpose(others)
            rest = first - basis @ np.linalg.lstsq(basis, first)[0]
            independent = len(first) * process.std**2 / process.at_zero
            left, whole = left + float(rest @ rest), whole + float(first @ first)
            explained, count = explained + len(others) * log(max(independent, 1.0)), count + independent
    return whole > 0.0 and count * log(max(left, 1e-300) / whole) + explained < 0.0


def with_noise_of(problem: Problem, processes: dict[str, NoiseProcess]) -> Problem:
    """The problem with what is known of its noise."""
    return replace(problem, runs=tuple(replace(run, noise=processes) for run in problem.runs))


def pace(run: FitData) -> tuple[float, int]:
    """The time between the samples of a run [s], and how many a rest has."""
    interval = round(float(np.median(np.diff(run.time))), 6) if len(run.time) > 1 else 0.0
    return interval, round(REST / interval) if interval > 0.0 else 0


def at_rest(run: FitData, residuals: Matrix) -> dict[str, list[Vector]]:
    """By channel, what is left in stretches of rest, without what changes more slowly than these last.

    Only of channels that are measured at every instant of the run: others are sampled at another rate.
    """
    from scipy.ndimage import maximum_filter1d, uniform_filter1d  # only here: it takes long to import

    (_, rows), whole = pace(run), [k for k, weight in enumerate(run.weight) if np.all(weight > 0.0)]
    if run.is_quasi_static or len(run.time) < LEAST_SAMPLES or rows <= MOST_ORDER or not whole:
        return {}
    shown = residuals[whole] + run.measured[whole] * run.weight[whole]
    bent = np.abs(shown - uniform_filter1d(shown, rows, axis=1))
    still = np.all(maximum_filter1d(bent, rows, axis=1) < STILL, axis=0)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
    spans = [(begin, end) for begin, end in zip(ends[::2], ends[1::2], strict=True) if end - begin > 2 * rows]
    return {
        run.channels[k]: [
            (part - uniform_filter1d(part, rows))[rows // 2 : -(rows // 2)]
            for part in (residuals[k, begin:end] for begin, end in spans)
        ]
        for k in whole
    }
