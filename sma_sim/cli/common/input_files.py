"""The input of a run from a CSV file or a bag."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sma_sim.evidence.data.rosbag.raw_messages import is_bag
from sma_sim.evidence.data.rosbag.reader import read_bag
from sma_sim.evidence.data.tables import Vector, read_columns
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.structures.structure import Structure
from sma_sim.solver.inputs import Input

LARGEST_STRAIN = 0.5  # beyond it the column is in percent


def read_input_file(path: Path, config: Config, linear: bool, namespace: str | None = None) -> Input:
    """What is imposed, heating and ambient temperature, from a CSV file or a bag; `linear`: heating between rows."""
    T_E = config.parameters['environment.T_E']
    return read_structure_input(path, config.structure.structure, T_E, linear, namespace)


def read_structure_input(path: Path, structure: Structure, T_E: float, linear: bool, namespace: str | None = None) -> Input:
    """As `read_input_file`, of a structure; `T_E` [K] where the file tells none. Raises UserError."""
    needed, names = structure.needed_columns, structure.input_columns
    others = tuple(name for name in names if name not in needed)
    columns = read_bag(path, namespace, structure) if is_bag(path) else read_columns(path, ('time_s', *needed), others)
    missing = [name for name in needed if name not in columns]
    if missing:
        raise UserError(f'{path} has no {", ".join(missing)}: expected the input of system {structure.name}')
    time = increasing(path, columns['time_s'])
    imposed = names[: len(structure.drives)]
    values = [columns[name] for name in imposed]
    for name, column in zip(imposed, values, strict=True):
        top = column[np.abs(column).argmax()]
        if name == 'strain' and abs(top) > LARGEST_STRAIN:
            raise UserError(f'{path}, column strain: expected a fraction such as 0.05, got {top:g}')
    for name in names[len(imposed) : -1]:
        heating = columns.get(name, np.zeros(len(time)))
        if not structure.antagonistic and (heating < 0.0).any():
            raise UserError(f'{path}, column {name}: heating cannot be negative, got {heating.min():g} W')
        values.append(heating)
    values.append(ambient_of(path, columns, T_E))
    kinds = [True] * len(imposed) + [linear] * (len(names) - len(imposed) - 1) + [False]
    return Input(time, np.column_stack(values), tuple(kinds), names)


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
