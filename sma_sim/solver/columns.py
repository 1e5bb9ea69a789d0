"""Samples by the names of the file contract."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.effects.ports import CHANNELS, MODULE_CHANNELS
from sma_sim.model.errors import UserError
from sma_sim.solver.integrate import PER_WIRE, SAMPLE_SIZE, Y_SENSED, Y_WIRE

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
CHANNEL_COLUMN_NAMES = ('U_x_m', 'U_y_m', 'alpha_rad', 'F_1_N', 'F_2_N', 'T_1_K', 'T_2_K', 'stress_Pa', 'T_K')


def channel_indices(channels: Sequence[str] | None, system: str) -> NDArray[np.int64]:
    """Indices of sensor channels of a system, none of them for all columns. Raises UserError."""
    known = CHANNELS[:MODULE_CHANNELS] if system == 'module' else CHANNELS[MODULE_CHANNELS:]
    for name in channels or ():
        if name not in known:
            raise UserError(f'the model of system {system!r} has no channel {name!r}; expected some of {", ".join(known)}')
    return np.array([CHANNELS.index(name) for name in channels or ()], dtype=np.int64)


def new_samples(count: int, channels: NDArray[np.int64]) -> Matrix:
    """Room for samples, (count, columns): of these channels, or whole rows where there are none; NaN until written."""
    return np.full((count, len(channels) or SAMPLE_SIZE), np.nan)


def named_columns(system: str, samples: Matrix, channels: NDArray[np.int64]) -> dict[str, Vector]:
    """Samples, of all columns or of some channels, by the names of the file contract."""

    def wire(i: int, column: int) -> Vector:
        return samples[:, Y_WIRE + i * PER_WIRE + column]

    if len(channels):
        return {CHANNEL_COLUMN_NAMES[channel]: samples[:, k] for k, channel in enumerate(channels)}
    if system == 'wire':
        return {
            'stress_Pa': samples[:, Y_SENSED + 7], 'T_K': samples[:, Y_SENSED + 8],
            'x_M': wire(0, 1), 'mode': wire(0, 7),
        }  # fmt: skip
    columns = {name: samples[:, Y_SENSED + k] for k, name in enumerate(CHANNEL_COLUMN_NAMES[:MODULE_CHANNELS])}
    for column, name in ((1, 'x_M'), (7, 'mode')):
        columns |= {f'{name}_{i + 1}': wire(i, column) for i in range(2)}
    return columns
