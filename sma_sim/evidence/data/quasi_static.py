"""Quasi-static tests in which a temperature goes up and down, once or in cycles: their ways, and how steep strain is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import Recording

Vector = NDArray[np.float64]
GRID = 200  # temperatures to which one way is interpolated
SMOOTHED = 0.02  # part of the temperatures over which the slope is taken
ACCURACY = 0.5  # [K] to which a thermocouple on a specimen, and its gradients, let its temperature be known
TURNED = 0.3  # of what a temperature spans, by which it has gone back where it has turned: less is a hold, or an inner loop
WHOLE = 0.5  # of what a temperature spans, on a way that may belong to a cycle
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
    corners = turning_rows(T)
    ways = [slice(first, last + 1) for first, last in zip(corners[:-1], corners[1:], strict=True)]
    whole = [abs(T[way.stop - 1] - T[way.start]) >= WHOLE * np.ptp(T) for way in ways]
    found, k = list[Cycle](), 0
    while k < len(ways) - 1:
        if whole[k] and whole[k + 1]:
            first, second = ((T[way], values[way]) for way in ways[k : k + 2])
            found.append((first, second) if T[ways[k].stop - 1] > T[ways[k].start] else (second, first))
        k += 2 if whole[k] and whole[k + 1] else 1
    return found


def turning_rows(T: Vector) -> list[int]:
    """The first row, those at which `T` (k,) turns and goes back by TURNED of its span at least, and the last row."""
    if not len(T):
        return []
    back, rows, extreme, sign = TURNED * float(np.ptp(T)), [0], 0, 0.0
    for row, value in enumerate(T.tolist()):
        beyond = value - T[extreme]
        if sign * beyond > 0.0 or (sign == 0.0 and abs(beyond) >= back > 0.0):
            sign = sign or float(np.sign(beyond))
            extreme = row
        elif sign and sign * beyond <= -back:
            rows.append(extreme)
            extreme, sign = row, -sign
    return [*rows, extreme] if extreme > rows[-1] else rows


def smoothed_way(T: Vector, values: Vector) -> tuple[Vector, Vector, Vector]:
    """One way on a grid of temperatures: these, the values smoothed, their slope."""
    order = np.argsort(T, kind='stable')
    grid = np.linspace(T.min(), T.max(), GRID)
    width = max(2, int(SMOOTHED * GRID))
    at = np.pad(np.interp(grid, T[order], values[order]), width, mode='edge')
    smooth = np.convolve(at, np.ones(2 * width + 1) / (2 * width + 1), 'valid')
    return grid, smooth, np.gradient(smooth, grid)


def temperature_error(recording: Recording) -> float:
    """How well [K] the temperature of a specimen is known: by its thermocouple, and as far as its noise was averaged."""
    return float(np.hypot(ACCURACY, recording.imposed_std.get('T_K', 0.0)))


def error_by_temperature(recording: Recording, channel: str, drive: int) -> float | None:
    """RMS error of a channel through an imposed temperature, in its unit; `drive`: which column of the input that is.

    None where the test does not go both ways.
    """
    values = np.asarray(recording.channels[channel], float)
    known = np.isfinite(values)
    source = recording.source
    T = np.interp(recording.time, source.times, np.asarray(source.values, float)[:, drive])[known]
    found = cycles(T, values[known]) if known.sum() > GRID // 10 else []
    if not found:
        return None
    squares = []
    for way_T, way_values in (way for ways in found for way in ways):
        grid, _, slope = smoothed_way(way_T, way_values)
        squares.append(np.interp(way_T, grid, slope) ** 2)
    return float(temperature_error(recording) * np.sqrt(np.mean(np.concatenate(squares))))
