"""Samples by the names of the file contract."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.errors import UserError
from sma_sim.model.nearest import suggestion
from sma_sim.model.structures.structure import WIRE_STATES, Structure
from sma_sim.solver.integrate import PER_WIRE, WIRE_COLUMNS, Run

STATE_COLUMNS = tuple(name for name, _ in WIRE_STATES)


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


def sampled_numbers(channels: Sequence[str] | None, structure: Structure) -> NDArray[np.int64]:
    """Numbers of what is sampled: sensor channels; without any all of them, then STATE_COLUMNS of every wire.

    A temperature is among these only where it is imposed: it is no sensor's then. Raises UserError.
    """
    known, wires = structure.channels, structure.wires
    for name in channels or ():
        if name not in known:
            raise UserError(
                f'the model of system {structure.name!r} has no channel {name!r}{suggestion(name, known)}; expected some of '
                f'{", ".join(known)}'
            )
    if channels:
        return np.array([known.index(name) for name in channels], dtype=np.int64)
    last = len(known) + wires * (len(STATE_COLUMNS) if structure.imposed_temperature >= 0 else STATE_COLUMNS.index('T'))
    return np.arange(last, dtype=np.int64)


def state_numbers(structure: Structure, run: Run) -> NDArray[np.int64]:
    """Numbers of the whole state of a run: its y, then the modes, then the frozen fractions."""
    y, mode, x_frozen = run.state
    first = len(structure.channels) + structure.wires * len(STATE_COLUMNS)
    return np.arange(first, first + len(y) + len(mode) + len(x_frozen), dtype=np.int64)


def new_samples(count: int, numbers: NDArray[np.int64], structure: Structure) -> Matrix:
    """Room for samples, (count, columns): of these numbers, or whole rows where there are none; NaN until written."""
    return np.full((count, len(numbers) or sample_columns(structure).size), np.nan)


def named_columns(
    structure: Structure, samples: Matrix, numbers: NDArray[np.int64]
) -> tuple[dict[str, Vector], dict[str, Vector]]:
    """Samples of these numbers, or whole rows where there are none, by the names of the file contract; resistances [ohm].

    Where these numbers are those of some channels alone, resistances are among the former, and none among the latter.
    """
    columns = {name: samples[:, at] for name, at in places(structure, numbers).items()}
    if are_channels(numbers, structure):
        return columns, {}
    return columns, {name: columns.pop(name) for name in structure.resistance_columns}


def are_channels(numbers: NDArray[np.int64], structure: Structure) -> bool:
    """Whether these are the numbers of some channels, not of everything, and samples no whole rows."""
    return len(numbers) > 0 and int(numbers.max()) < len(structure.channels)


def places(structure: Structure, numbers: NDArray[np.int64]) -> dict[str, int]:
    """Where samples of these numbers, or whole rows where there are none, have what, by column of the file contract."""
    names = structure.sampled_columns
    if len(numbers):
        return {names[number]: k for k, number in enumerate(numbers.tolist())}
    where, channels, wires = sample_columns(structure), len(structure.channels), structure.wires
    found = {names[k]: where.sensed.start + k for k in range(channels)}
    for kind, name in enumerate(STATE_COLUMNS):
        if name != 'T' or structure.imposed_temperature >= 0:
            first = where.wires.start + WIRE_COLUMNS.index(name)
            found |= {names[channels + kind * wires + i]: first + PER_WIRE * i for i in range(wires)}
    return found
