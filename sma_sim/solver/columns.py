"""Samples by the names of the file contract."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.errors import UserError
from sma_sim.model.structures.structure import Structure
from sma_sim.solver.integrate import PER_WIRE, WIRE_COLUMNS

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


class SampleColumns(NamedTuple):
    """Where a whole row has what: the pose, its rates, PER_WIRE numbers of each wire, the sensors, tau; `size` in all."""

    pose: slice
    rates: slice
    wires: slice
    sensed: slice
    tau: slice
    size: int


def sample_columns(structure: Structure) -> SampleColumns:
    """Where whole rows of a structure's samples have what."""
    n, wires, channels = len(structure.coordinates), structure.wires, len(structure.channels)
    bounds = np.cumsum([0, n, n, PER_WIRE * wires, channels, n]).tolist()
    pose, rates, of_wires, sensed, tau = (slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True))
    return SampleColumns(pose, rates, of_wires, sensed, tau, bounds[-1])


def channel_indices(channels: Sequence[str] | None, structure: Structure) -> NDArray[np.int64]:
    """Numbers of sensor channels of a system, none of them for all columns. Raises UserError."""
    known = structure.channels
    for name in channels or ():
        if name not in known:
            raise UserError(
                f'the model of system {structure.name!r} has no channel {name!r}; expected some of {", ".join(known)}'
            )
    return np.array([known.index(name) for name in channels or ()], dtype=np.int64)


def new_samples(count: int, channels: NDArray[np.int64], structure: Structure) -> Matrix:
    """Room for samples, (count, columns): of these channels, or whole rows where there are none; NaN until written."""
    return np.full((count, len(channels) or sample_columns(structure).size), np.nan)


def named_columns(structure: Structure, samples: Matrix, channels: NDArray[np.int64]) -> dict[str, Vector]:
    """Samples, of all columns but resistances or of some channels, by the names of the file contract."""
    if len(channels):
        return {structure.channel_columns[channel]: samples[:, k] for k, channel in enumerate(channels)}
    where = sample_columns(structure)
    columns = {
        name: samples[:, where.sensed.start + k]
        for k, name in enumerate(structure.channel_columns) if name not in structure.resistance_columns
    }  # fmt: skip
    imposed = ('T',) if structure.imposed_temperature >= 0 else ()  # no sensor's, but people want to see it
    for name in (*imposed, 'x_M', 'mode'):
        at = where.wires.start + WIRE_COLUMNS.index(name)
        for i, suffix in enumerate(structure.wire_suffixes):
            columns[f'{name}{suffix}_K' if name == 'T' else f'{name}{suffix}'] = samples[:, at + PER_WIRE * i]
    return columns


def resistances(structure: Structure, samples: Matrix, channels: NDArray[np.int64]) -> dict[str, Vector]:
    """Resistance [ohm] of every wire by column, of whole rows; nothing of samples of some channels."""
    if len(channels):
        return {}
    first, columns = sample_columns(structure).sensed.start, structure.channel_columns
    return {name: samples[:, first + columns.index(name)] for name in structure.resistance_columns}
