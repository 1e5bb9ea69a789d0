"""The squared error of a channel, split by every way to sort its samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.residual_analysis.compare import Comparison
from sma_sim.evidence.residual_analysis.strata import Dimension, dimensions, part_of_run
from sma_sim.model.arrays import Vector


@dataclass(frozen=True)
class Share:
    """One class: its share of the squared error and of the samples (`time`), RMSE and bias (SI), normalized RMSE."""

    label: str
    error: float
    time: float
    rmse: float
    bias: float
    over_noise: float


@dataclass(frozen=True)
class Split:
    """A channel split by one dimension."""

    channel: str
    by: str
    shares: tuple[Share, ...]


@dataclass(frozen=True)
class ChannelSamples:
    """All samples (n,) of a channel: residual (SI), residual over noise, run, time in the run [0, 1], index."""

    channel: str
    residual: Vector
    scaled: Vector
    run: NDArray[np.int64]
    part: Vector
    index: NDArray[np.int64]


def samples_of(comparison: Comparison, channel: str) -> ChannelSamples:
    """The samples of a channel; `index` (n,) is where each is in the runs joined."""
    residual, scaled, part, number = [], [], [], []
    for k, run in enumerate(comparison.runs):
        of_run = run.residual(channel) if channel in run.measured else np.full(len(run.time), np.nan)
        residual.append(of_run)
        scaled.append(of_run / run.noise.get(channel, np.nan))
        part.append(part_of_run(run))
        number.append(np.full(len(run.time), k))
    joined = np.concatenate(residual)
    index = np.flatnonzero(np.isfinite(joined))
    return ChannelSamples(
        channel,
        joined[index],
        np.concatenate(scaled)[index],
        np.concatenate(number)[index],
        np.concatenate(part)[index],
        index,
    )


def all_splits(comparison: Comparison) -> tuple[Split, ...]:
    """Every channel by every dimension."""
    ways, every = dimensions(comparison), [samples_of(comparison, channel) for channel in comparison.channels]
    return tuple(split_by(samples, way) for samples in every for way in ways)


def split_by(samples: ChannelSamples, way: Dimension) -> Split:
    """One channel by one dimension."""
    classes = np.concatenate(way.classes)[samples.index]
    total = float(np.sum(samples.scaled**2))
    shares = []
    for k, label in enumerate(way.labels):
        inside = classes == k
        if not inside.any():
            continue
        residual, scaled = samples.residual[inside], samples.scaled[inside]
        error = float(np.sum(scaled**2))
        shares.append(
            Share(
                label,
                error / total if total > 0.0 else 0.0,
                float(inside.mean()),
                float(np.sqrt(np.mean(residual**2))),
                float(residual.mean()),
                float(np.sqrt(np.mean(scaled**2))),
            )
        )
    return Split(samples.channel, way.name, tuple(shares))
