"""The rows of a recording in the order of time: shuffled rows, wrong stamps, clocks that go back, times that repeat."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.arrays import Mask, Vector
from sma_sim.model.errors import UserError
from sma_sim.model.shown import counted

Rows = NDArray[np.intp] | slice
# Sampling intervals: a clock that goes back by no more was adjusted; by more, another session begins.
CLOCK_STEP_INTERVALS = 10
INTERVAL_TOLERANCE = 0.25  # of the usual interval: what a regular grid may deviate by
MIN_EXACT_FRACTION = 0.25  # of the changes with exact times; with fewer, rows without measured cells have lost them
REGULAR_FRACTION = 0.95  # of the intervals within the tolerance
SHUFFLED_FRACTION = 0.02  # of the rows step back
REPEATED_FRACTION = 0.05  # of the times there twice: two recordings are mixed


def ordered_sessions(path: Path, time: Vector, sampled: Mask) -> tuple[list[Rows], list[str]]:
    """Which rows make up each session, in the order of time, and what was done to get there.

    `time` (k,) [s] is finite; `sampled` (k,) says which rows hold measured cells: the others, which only say when the
    command changed, need not keep to a regular grid. Raises UserError where two recordings seem to be mixed.
    """
    everything = slice(0, len(time))
    if not (np.diff(time) < 0.0).any():
        return [everything], []
    if is_shuffled(path, time, sampled):
        return sorted_rows(everything, time)
    right = ~wrong_stamps(time)
    if right.all():
        return split_at_clock_steps(everything, time)
    rows = np.flatnonzero(right)
    note = f'{counted(len(time) - len(rows), "row")} with a time far from that of the rows around them: dropped'
    time, sampled = time[rows], sampled[rows]
    if not (np.diff(time) < 0.0).any():
        return [rows], [note]
    sessions, notes = sorted_rows(rows, time) if is_shuffled(path, time, sampled) else split_at_clock_steps(rows, time)
    return sessions, [note, *notes]


def sorted_rows(rows: Rows, time: Vector) -> tuple[list[Rows], list[str]]:
    """One session, sorted."""
    order = np.argsort(time, kind='stable')
    moved = int((np.diff(time) < 0.0).sum())
    return [chosen_rows(rows, order)], [f'the rows were not in the order of time ({moved} steps back): sorted']


def chosen_rows(rows: Rows, chosen: NDArray[np.intp]) -> Rows:
    """Rows of a selection of rows."""
    return chosen + rows.start if isinstance(rows, slice) else rows[chosen]


def is_shuffled(path: Path, time: Vector, sampled: Mask) -> bool:
    """Whether sorting mends the rows: sorted, they are one sampling grid (nearly) without repeated times."""
    back = int((np.diff(time) < 0.0).sum())
    ordered = np.sort(time[sampled] if sampled.sum() > 2 else time)
    steps = np.diff(ordered)
    repeated = float(np.mean(steps == 0.0))
    if back > 2 and back > SHUFFLED_FRACTION * len(time):
        if repeated > REPEATED_FRACTION and back > 0.2 * len(time):
            raise UserError(
                f'{path}: time steps back {back} times in {len(time)} rows and {100.0 * repeated:.0f} % of the times are '
                f'there twice; expected one recording: are two mixed in this file?'
            )
        return repeated <= REPEATED_FRACTION
    return bool(repeated == 0.0 and steps.max() <= 1.5 * np.median(steps) and not are_interleaved(time))


def are_interleaved(time: Vector) -> bool:
    """Whether sorting would mix stretches between steps back row by row: they are periods of a clock that was set.

    Rows that are out of place lie among others here and there, not in turns with them over CLOCK_STEP_INTERVALS.
    """
    stretch = np.append(0, np.cumsum(np.diff(time) < 0.0))[np.argsort(time, kind='stable')]
    same = np.flatnonzero(np.diff(stretch, prepend=stretch[0], append=stretch[-1]) == 0)
    return bool((np.diff(same) > CLOCK_STEP_INTERVALS).any())


def are_regular(steps: Vector) -> bool:
    """Whether most steps (k,) [s] are about equal."""
    if len(steps) < 2:
        return False
    usual = np.median(steps)
    return (
        float(np.mean((steps >= (1.0 - INTERVAL_TOLERANCE) * usual) & (steps <= (1.0 + INTERVAL_TOLERANCE) * usual)))
        >= REGULAR_FRACTION
    )


def wrong_stamps(time: Vector) -> Mask:
    """Rows whose time is far from that of both neighbours, while these are in order."""
    steps = np.diff(time)
    far = CLOCK_STEP_INTERVALS * typical_step(time)
    wrong = np.zeros(len(time), dtype=bool)
    forward, after = steps[:-1], steps[1:]
    in_order = forward + after > 0.0
    near = np.abs(forward + after) <= far
    wrong[1:-1] = in_order & near & (np.abs(forward) > far) & (np.abs(after) > far)
    wrong[-1] = steps[-1] < -far
    return wrong


def typical_step(time: Vector) -> float:
    """The usual step forward [s]."""
    steps = np.diff(time)
    forward = steps[steps > 0.0]
    return float(np.median(forward)) if len(forward) else 0.0


def split_at_clock_steps(rows: Rows, time: Vector) -> tuple[list[Rows], list[str]]:
    """Sessions where the clock jumps back by much or starts again; rows dropped where it jumps back by little."""
    back = np.flatnonzero(np.diff(time) < 0.0) + 1
    far = CLOCK_STEP_INTERVALS * typical_step(time)
    starts = [0]
    for at in back:
        first, last = time[starts[-1]], time[starts[-1] : at].max()
        if last - time[at] > far or (time[at] <= first and at - starts[-1] > 1):
            starts.append(int(at))
    sessions: list[Rows] = []
    notes = [] if len(starts) == 1 else [f'time starts again {len(starts) - 1} times: taken as {len(starts)} sessions']
    for start, end in zip(starts, [*starts[1:], len(time)], strict=True):
        sessions.append(chosen_rows(rows, start + forward_rows(time[start:end], notes)))
    return sessions, notes


def forward_rows(time: Vector, notes: list[str]) -> NDArray[np.intp]:
    """The rows that are no earlier than any row before."""
    latest = np.maximum.accumulate(time)
    forward = np.flatnonzero(time >= latest)
    if len(forward) < len(time):
        notes.append(
            f'the clock jumps back by {float((latest - time).max()):.3g} s at the most: '
            f'{counted(len(time) - len(forward), "row")} dropped until it has caught up'
        )
    return forward


def group_starts(time: Vector) -> NDArray[np.intp] | None:
    """The first row of each group of rows with the same time; None where no time repeats."""
    new = np.concatenate([[True], np.diff(time) > 0.0])
    return None if new.all() else np.flatnonzero(new)


def first_finite(values: Vector, starts: NDArray[np.intp]) -> tuple[Vector, int]:
    """The first number (NaN if none) in each group of rows, and how many more there were."""
    known = np.isfinite(values)
    index = np.where(known, np.arange(len(values)), len(values) - 1)
    first = np.minimum.reduceat(index, starts)
    chosen = values[first]
    ends = np.append(starts[1:], len(values))
    chosen[~(known[first] & (first < ends))] = np.nan
    return chosen, int(known.sum() - np.isfinite(chosen).sum())


def last_of_groups(values: Vector, starts: NDArray[np.intp]) -> Vector:
    """The last value in each group of rows."""
    chosen: Vector = values[np.append(starts[1:], len(values)) - 1]
    return chosen


def command_changes(time: Vector, command: Vector, sampled: Mask) -> tuple[Vector, Mask]:
    """Times (c,) [s] of the rows at which a command [W] has changed, and whether that time is exact.

    It is when the row is one without measured cells or at the time of another, or (in a file without such rows) squeezed in
    between two of a regular grid, rather than a sample that only tells what the command was by then. Where few do, all
    are taken for samples that lost their cells. Where nothing is measured all times are exact.
    """
    changed = np.flatnonzero(np.diff(command) != 0.0) + 1
    if len(changed) == 0 or not sampled.any():
        return time[changed], np.ones(len(changed), dtype=bool)
    extra = ~sampled[changed]
    grid = np.diff(time)
    extra |= np.append(grid, np.inf)[changed] == 0.0
    extra |= grid[changed - 1] == 0.0
    if not extra.any() and are_regular(grid):
        inner = changed < len(time) - 1
        around = np.full(len(changed), np.inf)
        around[inner] = time[changed[inner] + 1] - time[changed[inner] - 1]
        extra |= around <= (1.0 + INTERVAL_TOLERANCE) * np.median(grid)
    return time[changed], extra if extra.mean() >= MIN_EXACT_FRACTION else np.zeros(len(changed), dtype=bool)


def rows_with_changes(values: Sequence[Vector]) -> Mask:
    """Rows at which held inputs change, the row before each, and both ends: all that tells when they changed."""
    changed = np.zeros(len(values[0]), dtype=bool)
    for column in values:
        changed[1:] |= np.diff(column) != 0.0
    keep = changed.copy()
    keep[:-1] |= changed[1:]
    keep[[0, -1]] = True
    return keep
