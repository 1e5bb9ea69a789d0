"""The residual of a channel by frequency band (Welch's method)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sma_sim.evidence.residual_analysis.compare import ComparedRun
from sma_sim.model.arrays import Vector

BAND_EDGES = (0.0, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # [Hz]
MIN_SPECTRUM_SAMPLES = 16  # samples
SEGMENTS = 4  # a segment is at most this part of the run ...
MIN_SEGMENT = 256  # ... if that is as many samples


@dataclass(frozen=True)
class Band:
    """A frequency band [Hz]: its `share` of the squared error, its RMS (SI), and over what white noise has there."""

    low: float
    high: float
    share: float
    rms: float
    over_noise: float


def error_bands(runs: Sequence[ComparedRun], channel: str) -> tuple[Band, ...]:
    """The residual of a channel over some runs, split at EDGES; the offset is in the lowest band."""
    power, noise, seconds = np.zeros(len(BAND_EDGES) - 1), np.zeros(len(BAND_EDGES) - 1), 0.0
    for run in runs:
        if channel not in run.measured:
            continue
        found = power_density(run.time, run.residual(channel))
        if found is None:
            continue
        frequency, density = found
        duration, step = float(run.time[-1] - run.time[0]), frequency[1]
        band = np.clip(np.searchsorted(BAND_EDGES, frequency, side='right') - 1, 0, len(power) - 1)
        width = np.where((frequency == 0.0) | (frequency == frequency[-1]), 0.5 * step, step)
        power += duration * np.bincount(band, density * step, len(power))
        noise += duration * np.bincount(band, width, len(power)) * run.noise[channel] ** 2 / frequency[-1]
        seconds += duration
    total = power.sum()
    if seconds == 0.0 or total <= 0.0:
        return ()
    return tuple(
        Band(
            BAND_EDGES[k],
            BAND_EDGES[k + 1],
            float(power[k] / total),
            float(np.sqrt(power[k] / seconds)),
            float(np.sqrt(power[k] / noise[k])),
        )
        for k in range(len(power))
        if noise[k] > 0.0
    )


def power_density(time: Vector, residual: Vector) -> tuple[Vector, Vector] | None:
    """Frequencies [Hz] and one-sided power density of a residual (k,), gaps joined by lines; None for too few samples."""
    known = np.isfinite(residual)
    if known.sum() < MIN_SPECTRUM_SAMPLES:
        return None
    time, residual = time[known], residual[known]
    step = float(np.median(np.diff(time)))
    even = np.arange(time[0], time[-1] + 0.5 * step, step)
    length = min(len(even), max(MIN_SEGMENT, len(even) // SEGMENTS))
    return welch(np.interp(even, time, residual), 1.0 / step, length)


def welch(values: Vector, rate: float, length: int) -> tuple[Vector, Vector]:
    """Frequencies [Hz] and one-sided power density of values (k,) that are sampled at a rate [1/s].

    The mean of the periodograms of segments of a length [samples] that overlap by half, under a Hann window (Welch, IEEE
    Transactions on Audio and Electroacoustics 15, 1967). `scipy.signal.welch` does the same; to import it takes longer than
    most commands.
    """
    window = np.hanning(length + 1)[:-1]
    segments = np.lib.stride_tricks.sliding_window_view(values, length)[:: length - length // 2]
    density: Vector = np.mean(np.abs(np.fft.rfft(window * segments)) ** 2, axis=0) / (rate * (window @ window))
    density[1 : (length + 1) // 2] *= 2.0  # all but those at 0 and at half the rate have a twin at a negative frequency
    frequency: Vector = np.arange(len(density), dtype=np.float64) * (rate / length)
    return frequency, density
