"""Quasi-static tests in which a temperature goes up and down, once or in cycles: their ways, and how steep strain is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.noise import difference_scale
from sma_sim.evidence.data.recording import Recording
from sma_sim.model.arrays import Vector
from sma_sim.solver.inputs import Input

GRID = 200  # temperatures to which one way is interpolated
SMOOTHED = 0.02  # part of the temperatures over which the slope is taken
ACCURACY = 0.5  # [K] to which a thermocouple on a specimen, and its gradients, let its temperature be known
TURNED = 0.3  # of what a temperature spans, by which it has gone back where it has turned: less is a hold, or an inner loop
TURNED_STDS = 5.0  # of noise, by which a temperature that has gone back has turned
NODES = 9  # of Gauss and Hermite's rule over the noise
WHOLE = 0.5  # of what a temperature spans, on a way that may belong to a cycle
FIRST_CYCLES = 32  # of many that repeat, which a search takes: a wire learns in the first, and all take the same time
REPEATED = 0.95  # of what a drive spans, beyond which cycles only repeat what it has reached
Way = tuple[Vector, Vector]
Cycle = tuple[Way, Way]


def both_ways(T: Vector, values: Vector) -> Cycle | None:
    """Heating and cooling of the first cycle, (temperatures, values) each; None where there is one way only."""
    found = cycles(T, values)
    return found[0] if found else None


def cycles(T: Vector, values: Vector) -> list[Cycle]:
    """Heating and cooling of all cycles of a test, in the order of time; each begins with the way with which the test does.

    `T`, `values` (k,). A test is split where its temperature turns. Ways that are not WHOLE belong to no cycle.
    """
    return [((T[heating], values[heating]), (T[cooling], values[cooling])) for heating, cooling in whole_cycles(T)]


def whole_cycles(T: Vector) -> list[tuple[slice, slice]]:
    """The rows of heating and cooling of all cycles of temperatures (k,)."""
    corners = turning_rows(T)
    ways = [slice(first, last + 1) for first, last in zip(corners[:-1], corners[1:], strict=True)]
    whole = [abs(T[way.stop - 1] - T[way.start]) >= WHOLE * np.ptp(T) for way in ways]
    found, k = list[tuple[slice, slice]](), 0
    while k < len(ways) - 1:
        if whole[k] and whole[k + 1]:
            first, second = ways[k : k + 2]
            found.append((first, second) if T[first.stop - 1] > T[first.start] else (second, first))
        k += 2 if whole[k] and whole[k + 1] else 1
    return found


def turning_rows(T: Vector, back: float | None = None) -> list[int]:
    """The first row, those at which `T` (k,) turns and goes `back` by so much (TURNED of its span) at least, and the last
    row."""
    if not len(T):
        return []
    back = TURNED * float(np.ptp(T)) if back is None else back
    rows, extreme, sign = [0], 0, 0.0
    for row, value in enumerate(T.tolist()):
        beyond = value - T[extreme]
        if sign * beyond > 0.0 or (sign == 0.0 and abs(beyond) >= back > 0.0):
            sign = sign or float(np.sign(beyond))
            extreme = row
        elif sign and sign * beyond <= -back:
            rows.append(extreme)
            extreme, sign = row, -sign
    return [*rows, extreme] if extreme > rows[-1] else rows


def first_cycles(recording: Recording) -> Recording:
    """A quasi-static test up to where its cycles only repeat, after FIRST_CYCLES at least; any other recording as it is."""
    structure, source = recording.structure, recording.source
    values, count = np.asarray(source.values, float), len(structure.drives)
    is_set = structure.is_quasi_static and not np.ptp(values[:, count:], axis=0).any()  # by its drives alone
    last = last_new_row(values[:, :count]) if is_set else 0
    first = recording.time <= source.times[last]
    seen = [np.isfinite(shown[first]).any() for shown in recording.channels.values()]
    if not (last and all(seen)):
        return recording
    return replace(
        recording,
        time=recording.time[first],
        channels={name: shown[first] for name, shown in recording.channels.items()},
        source=Input(np.asarray(source.times)[: last + 1], values[: last + 1], source.linear, source.names),
        sample_std={name: std[first] for name, std in recording.sample_std.items()},
    )


def last_new_row(drives: NDArray[np.float64]) -> int:
    """The row at which the last cycle ends that does not only repeat what `drives` (k, d) did before; 0 where one of them
    moves in few cycles."""
    last = 0
    for drive in (one for one in drives.T if np.ptp(one) > 0.0):
        rows, above = turning_rows(drive), (drive - drive.min()) / np.ptp(drive)
        if len(rows) <= 2 * FIRST_CYCLES + 1:
            return 0
        reached = max(int(np.argmax(part >= REPEATED)) for part in (above, 1.0 - above))
        ways = max(2 * FIRST_CYCLES, int(np.searchsorted(rows, reached)))
        last = max(last, rows[min(ways + ways % 2, len(rows) - 1)])
    return last


def smoothed_way(T: Vector, values: Vector) -> tuple[Vector, Vector, Vector]:
    """One way on a grid of temperatures: these, the values smoothed, their slope."""
    order = np.argsort(T, kind='stable')
    grid = np.linspace(T.min(), T.max(), GRID)
    width = max(2, int(SMOOTHED * GRID))
    at = np.pad(np.interp(grid, T[order], values[order]), width, mode='edge')
    smooth = np.convolve(at, np.ones(2 * width + 1) / (2 * width + 1), 'valid')
    return grid, smooth, np.gradient(smooth, grid)


def temperature_noise(recording: Recording) -> float:
    """What the imposed temperature may be off by in each row anew [K]: the noise that is left in it, if that is known.

    Else as thermocouples let it, but no more than third differences leave: they see all noise, and steps that differ.
    """
    drive = recording.structure.imposed_temperature
    T = np.asarray(recording.source.values, float)[:, drive]
    most = difference_scale(np.arange(float(len(T))), T) or 0.0
    return recording.imposed_std.get('T_K', min(ACCURACY, most))


def temperatures_at_samples(recording: Recording, known: NDArray[np.intp]) -> Vector:
    """The imposed temperature [K] at some samples of a recording."""
    source, drive = recording.source, recording.structure.imposed_temperature
    T: Vector = np.interp(recording.time[known], source.times, np.asarray(source.values, float)[:, drive])
    return T


def slopes_over_temperature(recording: Recording, channel: str) -> Vector:
    """How steep a channel is over the imposed temperature at its samples (k,), per K; NaN outside whole cycles."""
    values = np.asarray(recording.channels[channel], float)
    known, slopes = np.flatnonzero(np.isfinite(values)), np.full(len(values), np.nan)
    T = temperatures_at_samples(recording, known)
    for way in (way for cycle in whole_cycles(T) for way in cycle) if len(known) > GRID // 10 else ():
        grid, _, slope = smoothed_way(T[way], values[known[way]])
        slopes[known[way]] = np.abs(np.interp(T[way], grid, slope))
    return slopes


def noise_over_temperature(recording: Recording, channel: str, std: float) -> Vector:
    """The standard deviation (k,) that noise of `std` [K] on the imposed temperature makes of a channel at its samples.

    That of the line through the samples of each way, over temperatures that the noise makes of one: a slope at the sample is
    none where it lies before the corner of a plateau, and a smoothed one is less than that of a steep branch.
    """
    values = np.asarray(recording.channels[channel], float)
    known, found = np.flatnonzero(np.isfinite(values)), np.zeros(len(values))
    T, (nodes, weights) = temperatures_at_samples(recording, known), np.polynomial.hermite_e.hermegauss(NODES)
    corners = turning_rows(T, TURNED_STDS * std) if std > 0.0 else []
    for first, last in zip(corners[:-1], corners[1:], strict=True):
        way = first + np.argsort(T[first : last + 1], kind='stable')
        shown = np.interp(T[way] + std * nodes[:, None], T[way], values[known[way]])
        mean = np.average(shown, axis=0, weights=weights)
        found[known[way]] = np.sqrt(np.average((shown - mean) ** 2, axis=0, weights=weights))
    return found
