"""Quasi-static tests in which a temperature goes up and down: their two ways, and how steep strain is over temperature."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import Recording

Vector = NDArray[np.float64]
GRID = 200  # temperatures to which one way is interpolated
SMOOTHED = 0.02  # part of the temperatures over which the slope is taken
ACCURACY = 0.5  # [K] to which a thermocouple on a specimen, and its gradients, let its temperature be known
Way = tuple[Vector, Vector]


def both_ways(T: Vector, values: Vector) -> tuple[Way, Way] | None:
    """Heating and cooling, (temperatures, values) each; None where there is one of them only.

    A test is split where its temperature turns.
    """
    inner = [at for at in (int(np.argmax(T)), int(np.argmin(T))) if 0.1 * len(T) < at < 0.9 * len(T)]
    if not inner:
        return None
    first, second = ((T[part], values[part]) for part in (slice(0, inner[0] + 1), slice(inner[0], None)))
    return (first, second) if T[inner[0]] > 0.5 * (T[0] + T[-1]) else (second, first)


def smoothed_way(T: Vector, values: Vector) -> tuple[Vector, Vector, Vector]:
    """One way on a grid of temperatures: these, the values smoothed, their slope."""
    order = np.argsort(T, kind='stable')
    grid = np.linspace(T.min(), T.max(), GRID)
    width = max(2, int(SMOOTHED * GRID))
    at = np.pad(np.interp(grid, T[order], values[order]), width, mode='edge')
    smooth = np.convolve(at, np.ones(2 * width + 1) / (2 * width + 1), 'valid')
    return grid, smooth, np.gradient(smooth, grid)


def error_by_temperature(recording: Recording, channel: str, drive: int) -> float | None:
    """RMS error of a channel through a temperature known to ACCURACY, in its unit; `drive`: which column of the input it is.

    None where the test does not go both ways.
    """
    values = np.asarray(recording.channels[channel], float)
    known = np.isfinite(values)
    source = recording.source
    T = np.interp(recording.time, source.times, np.asarray(source.values, float)[:, drive])[known]
    ways = both_ways(T, values[known]) if known.sum() > GRID // 10 else None
    if ways is None:
        return None
    squares = []
    for way_T, way_values in ways:
        grid, _, slope = smoothed_way(way_T, way_values)
        squares.append(np.interp(way_T, grid, slope) ** 2)
    return float(ACCURACY * np.sqrt(np.mean(np.concatenate(squares))))
