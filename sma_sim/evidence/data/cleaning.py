"""What is missing or wrong in the columns of one session: gaps, outliers, held inputs; each repair makes a note."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.noise import Vector, estimate_noise
from sma_sim.evidence.data.sessions import are_regular

Mask = NDArray[np.bool_]
NEIGHBOURS_PER_SIDE = 4  # enough that two adjacent outliers do not hide each other
OUTLIER_RANGES = 6.0  # an outlier is farther from its neighbours than so many times their own range
OUTLIER_NOISE_STDS = 10.0  # ... and farther than so many standard deviations of the noise
OUTLIER_SPAN_FRACTION = 0.01  # ... and farther than this part of what the channel spans
MAX_PASSES = 3  # an outlier may hide another one until it is taken out
MIN_SATURATED = 3.0  # a sensor at its end shows one value for so many times as long as ...
USUAL_LENGTHS = 0.95  # ... this quantile of how long other values last
SLOPE_LEVELS = 3  # different values before and after it, by which the signal runs into it
PASSED_STEPS = 4.0  # of the resolution, by which the signal would have passed its end: a round peak has two
ROWS_PER_BLOCK = 1 << 16  # bounds the memory for the neighbours of each row


def outliers(time: Vector, values: Vector) -> Mask:
    """Which of the values (k,), NaN where missing, are spikes that no wire or beam could make; `time` (k,) [s].

    A sample counts when it lies outside the range of its eight neighbours (the farthest one on each side left out, so that
    two spikes do not hide each other) by six times that range, ten times the noise and 1 % of what the channel spans.
    A step, a kink and a decay with a half-life of a sample keep neighbours in between and pass.
    """
    wrong = np.zeros(len(values), dtype=bool)
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < 5 * NEIGHBOURS_PER_SIDE:
        return wrong
    noise = estimate_noise(time, values)
    low, high = np.percentile(values[known], [1.0, 99.0])
    floor = max(OUTLIER_NOISE_STDS * noise.std if noise else 0.0, OUTLIER_SPAN_FRACTION * float(high - low))
    if noise:
        floor = max(floor, 2.0 * noise.step)
    for _ in range(MAX_PASSES):
        found = known[spikes(values[known], floor)]
        if len(found) == 0:
            break
        wrong[found] = True
        known = known[~wrong[known]]
    return wrong


def spikes(values: Vector, floor: float) -> Mask:
    """Which of the values (k,) stand out of their neighbours by more than `floor` and six times their range."""
    count, width = len(values), 2 * NEIGHBOURS_PER_SIDE + 1
    found = np.zeros(count, dtype=bool)
    if count < width:
        return found
    for start in range(0, count, ROWS_PER_BLOCK):
        rows = np.arange(start, min(start + ROWS_PER_BLOCK, count))
        first = np.clip(rows - NEIGHBOURS_PER_SIDE, 0, count - width)
        index = first[:, None] + np.arange(width - 1)
        index += index >= rows[:, None]  # all but the row itself
        around = np.sort(values[index], axis=1)
        low, high = around[:, 1], around[:, -2]
        beyond = np.maximum(values[rows] - high, low - values[rows])
        found[rows] = beyond > np.maximum(OUTLIER_RANGES * (high - low), floor)
    return found


def saturated(time: Vector, values: Vector) -> Mask:
    """Which of the values (k,), NaN where missing, are those of a sensor at the end of its range; `time` (k,) [s].

    Its largest or smallest value, repeated for longer than others, which the samples before and after run into so steeply
    that, going on, they would have passed it by many steps of the resolution. What comes to rest slows down before, and a
    peak is round. Not 0, which a wire that is slack shows.
    """
    found = np.zeros(len(values), dtype=bool)
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < 5 * NEIGHBOURS_PER_SIDE:
        return found
    time, values = time[known], values[known]
    starts = np.flatnonzero(np.append(True, np.diff(values) != 0.0))
    lengths, levels = np.diff(np.append(starts, len(values))), values[starts]
    resolution = float(np.min(np.diff(np.unique(values)), initial=np.inf))
    for sign in (1.0, -1.0):
        top = float((sign * levels).max())
        if top == 0.0:
            continue
        at_top = sign * levels == top
        usual = float(np.quantile(lengths[~at_top], USUAL_LENGTHS)) if not at_top.all() else np.inf
        for k in np.flatnonzero(at_top & (lengths >= MIN_SATURATED * usual)):
            before, after = k - SLOPE_LEVELS, k + SLOPE_LEVELS
            if before < 0 or after >= len(levels):
                continue
            first, last = starts[k], starts[k] + lengths[k] - 1
            passed = []
            for level, away in ((before, time[first] - time[starts[before]]), (after, time[starts[after]] - time[last])):
                ahead = min(1.0, 0.5 * (time[last] - time[first]) / away)  # no further than the slope is known for
                passed.append(ahead * (top - sign * levels[level]))
            if min(passed) > PASSED_STEPS * resolution:
                found[known] |= sign * values >= top
    return found


def forward_filled(values: Vector) -> tuple[Vector, int]:
    """Gaps (NaN) filled with the value before, and how many rows before the first value are left."""
    known = np.isfinite(values)
    if known.all():
        return values, 0
    first = int(np.argmax(known)) if known.any() else len(values)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), 0))
    return values[last], first


def gap_notes(time: Vector, channels: Mapping[str, Vector]) -> list[str]:
    """Samples that are missing in each channel's own grid; channels with the same gaps share a note."""
    same: dict[tuple[int, int, float, float], list[str]] = {}
    for name, values in channels.items():
        times = times_with_values(time, values)
        steps = np.diff(times)
        usual = float(np.median(steps)) if len(steps) else 0.0
        at = np.flatnonzero(steps > 1.5 * usual)
        if len(at) == 0 or 2 * len(at) > len(steps) or not are_regular(steps[steps <= 1.5 * usual]):
            continue
        missing = int(np.rint(steps[at] / usual - 1.0).sum())
        longest = int(np.argmax(steps))
        key = (missing, len(at), float(steps[longest]), float(times[longest]))
        same.setdefault(key, []).append(name)
    return [
        f'{", ".join(names)}: {missing} samples missing in {gaps} gaps, the longest of {longest:.3g} s from {start:.6g} s on'
        for (missing, gaps, longest, start), names in same.items()
    ]


def times_with_values(time: Vector, values: Vector) -> Vector:
    """The times at which there is a value."""
    known = np.isfinite(values)
    return time if known.all() else time[known]


def rate_note(time: Vector, channels: Mapping[str, Vector]) -> list[str]:
    """One note where channels have different rates."""
    rates: dict[str, float] = {}
    for name, values in channels.items():
        times = times_with_values(time, values)
        if len(times) > 2:
            rates[name] = 1.0 / float(np.median(np.diff(times)))
    if not rates or max(rates.values()) < 1.1 * min(rates.values()):
        return []
    return ['channels have different rates: ' + ', '.join(f'{name} {rate:.3g} Hz' for name, rate in rates.items())]
