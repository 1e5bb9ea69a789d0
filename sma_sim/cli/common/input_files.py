"""The input of a run from a CSV file or a bag."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sma_sim.evidence.data.rosbag.raw_messages import is_bag
from sma_sim.evidence.data.rosbag.reader import read_bag
from sma_sim.evidence.data.tables import Vector, read_columns
from sma_sim.model.errors import UserError
from sma_sim.solver.inputs import Input


def read_module_input(path: Path, T_E: float, linear: bool, namespace: str | None = None) -> Input:
    """Command (and ambient temperature, if given) of a module, from a CSV file or a bag."""
    columns = read_bag(path, namespace) if is_bag(path) else read_columns(path, ('time_s', 'J_eq_W'), ('T_E_K',))
    ambient = ambient_of(path, columns, T_E)
    return Input(increasing(path, columns['time_s']), np.column_stack([columns['J_eq_W'], ambient]), (linear, False))


def read_wire_input(path: Path, T_E: float, linear: bool) -> Input:
    """Strain, heating and ambient temperature of a wire."""
    columns = read_columns(path, ('time_s', 'strain'), ('J_W', 'T_E_K'))
    time = increasing(path, columns['time_s'])
    heating = columns.get('J_W', np.zeros(len(time)))
    if (heating < 0.0).any():
        raise UserError(f'{path}, column J_W: heating cannot be negative, got {heating.min():g} W')
    strain = columns['strain']
    if np.abs(strain).max() > 0.5:
        raise UserError(f'{path}, column strain: expected a fraction such as 0.05, got {strain[np.abs(strain).argmax()]:g}')
    return Input(time, np.column_stack([strain, heating, ambient_of(path, columns, T_E)]), (True, linear, False))


def ambient_of(path: Path, columns: dict[str, Vector], T_E: float) -> Vector:
    """Ambient temperature: the column, or `T_E` where there is none. Raises UserError."""
    ambient = columns.get('T_E_K', np.full(len(columns['time_s']), T_E))
    if (ambient <= 1.0).any() or (ambient > 2000.0).any():
        wrong = ambient[np.argmax((ambient <= 1.0) | (ambient > 2000.0))]
        raise UserError(f'{path}, column T_E_K: expected kelvin between 1 and 2000, got {wrong:g}')
    return ambient


def increasing(path: Path, time: Vector) -> Vector:
    """The times, if there are two and each is later than the one before. Raises UserError."""
    if len(time) < 2:
        raise UserError(f'{path}: expected at least two rows, the last one gives the end of the run')
    steps = np.diff(time)
    if (steps <= 0.0).any():
        at = int(np.argmax(steps <= 0.0))
        raise UserError(
            f'{path}, row {at + 3}, column time_s: expected more than {time[at]:g} s of the row before, '
            f'got {time[at + 1]:g} s'
        )
    return time
