"""The input of a run from a CSV file or a bag."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from sma_sim.evidence.data.rosbag.bag_files import is_bag
from sma_sim.evidence.data.rosbag.commands import limits_in
from sma_sim.evidence.data.rosbag.interface import Interface, interface_of
from sma_sim.evidence.data.tables import read_columns, read_header
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.expected_units import mismatch_of
from sma_sim.model.likely_unit import kelvin_hint
from sma_sim.model.parameters import KELVIN
from sma_sim.model.structures.structure import shared_temperature
from sma_sim.solver.inputs import Input


def read_input_file(path: Path, config: Config, linear: bool, namespace: str | None = None) -> Input:
    """What is imposed, heating and ambient temperature, from a CSV file or a bag; `linear`: heating between rows."""
    structure = config.structure
    of, T_E = interface_of(structure), config.parameters['environment.T_E']
    notes: list[str] = []
    bag = None
    if is_bag(path):
        from sma_sim.evidence.data.rosbag.reader import read_bag  # only here: tables need no library of bags

        bag = read_bag(path, namespace, structure, limits_in(config.parameters), notes)
    for note in notes:
        print(f'note: {path}: {note}', file=sys.stderr)
    return read_input(path, of, T_E, linear, bag)


def read_input(path: Path, of: Interface, T_E: float, linear: bool, bag: dict[str, Vector] | None) -> Input:
    """As `read_input_file`, of an interface; `T_E` [K] where the file tells none, `bag` the columns of a bag.

    Raises UserError.
    """
    imposed, powers = tuple(of.drives.values()), of.heating_columns
    needed, names = imposed or powers, (*imposed, *powers, 'T_E_K')
    columns = bag
    if columns is None:
        shared = shared_temperature(imposed, read_header(path))
        asked = [shared.get(name, name) for name in needed]
        found = read_columns(path, tuple(dict.fromkeys(('time_s', *asked))), [name for name in names if name not in needed])
        columns = found | {name: found[column] for name, column in shared.items()}
    missing = [name for name in needed if name not in columns]
    if missing:
        raise UserError(f'{path} has no {", ".join(missing)}: expected the input of system {of.system}')
    time = increasing(path, columns['time_s'])
    values = [columns[name] for name in imposed]
    for name, column in zip(imposed, values, strict=True):
        if mismatch := mismatch_of(name, column):
            raise UserError(f'{path}, column {name}: {mismatch.words}')
    for name in powers:
        heating = columns.get(name, np.zeros(len(time)))
        if not of.signed and (heating < 0.0).any():
            raise UserError(f'{path}, column {name}: heating cannot be negative, got {heating.min():g} W')
        values.append(heating)
    values.append(ambient_of(path, columns, T_E))
    return Input(time, np.column_stack(values), (True,) * len(imposed) + (linear,) * len(powers) + (False,), names)


def ambient_of(path: Path, columns: dict[str, Vector], T_E: float) -> Vector:
    """Ambient temperature: the column, or `T_E` where there is none. Raises UserError."""
    ambient = columns.get('T_E_K', np.full(len(columns['time_s']), T_E))
    low, high = KELVIN
    wrong = ambient[(ambient < low) | (ambient > high)]
    if len(wrong):
        raise UserError(
            f'{path}, column T_E_K: expected kelvin between {low:g} and {high:g}, got {wrong[0]:g}{kelvin_hint(wrong[0])}'
        )
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
