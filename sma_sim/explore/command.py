"""What is imposed on the model while no recording is looked at: steps, a sine, or a file."""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sma_sim.evidence.data.tables import read_columns
from sma_sim.explore.request_values import number
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.parameters import wire_constants
from sma_sim.model.structures.structure import Structure
from sma_sim.solver.inputs import Input

KINDS = ('steps', 'sine', 'file')
SINE_POINTS = 64  # per period
MAX_ROWS, LONGEST, MAX_TEXT = 20_000, 1e6, 20_000_000  # rows, [s], characters of a file
WARMING = 60.0  # [K] by which the first command heats a wire in the end
# From and to, of a first command: from hardly strained to strained, which is downwards for a coil; hot wires last.
DRIVEN = {'strain': (0.0, 0.06), 'stress_Pa': (20e6, 200e6), 'crosshead_m': (0.04, -0.05), 'T_K': (298.0, 398.0)}
FALLBACK_DRIVE = (0.0, 1.0)
WIRE_NUMBER = re.compile(r'_\d+(?=_)')


@dataclass(frozen=True)
class Command:
    """A command as the page edits it, and as a session keeps it.

    Attributes
    ----------
    kind : str
        One of KINDS.
    duration : float
        Length [s]; of steps the time of the last row, of a file that of the file.
    rows : tuple
        Steps: a time [s] and a value of every column; heating holds until the next row, what else is imposed is linear.
    column, offset, amplitude, period : str, float, float, float
        Sine: which column, its mean, amplitude and period [s]. The other columns stay as in the first of the rows.
    name, text : str
        File: its name, and its content as CSV.
    """

    kind: str
    duration: float
    rows: tuple[tuple[float, ...], ...]
    column: str
    offset: float
    amplitude: float
    period: float
    name: str = ''
    text: str = ''

    def as_data(self) -> dict[str, Any]:
        """For JSON."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


def columns_of(structure: Structure) -> tuple[str, ...]:
    """The columns that a command says: all inputs but the ambient temperature, which is a parameter."""
    return structure.input_columns[:-1]


def first_command(config: Config) -> Command:
    """A command that shows the motion: one bundle is heated, then the other; what is imposed goes up and down."""
    structure, columns = config.structure, columns_of(config.structure)
    drives = [drive.column for drive in structure.drives]
    signs = (0.0, 1.0, 0.0, -1.0, 0.0, 0.0)
    times = (0.0, 5.0, 25.0, 45.0, 65.0, 100.0)
    power = heating_of(config)
    levels = (0.0, 0.5, 1.0, 0.5, 0.0, 0.0)
    rows = []
    for k, (time, sign) in enumerate(zip(times, signs, strict=True)):
        row = [time]
        for name in columns:
            if name in drives:
                low, high = driven_range(name)
                level = levels[k] if name == drives[-1] else 1.0
                row.append(low + level * (high - low))
            else:
                row.append(power * heated_part(columns.index(name), sign, structure) if not drives else 0.0)
        rows.append(tuple(row))
    sine = columns[len(drives) - 1 if drives else 0]
    low, high = driven_range(sine) if drives else ((-power if structure.antagonistic else 0.0), power)
    return Command('steps', times[-1], tuple(rows), sine, 0.5 * (low + high), 0.5 * abs(high - low), 40.0)


def driven_range(column: str) -> tuple[float, float]:
    """From where to where a first command goes in a column of what is imposed, one of a wire with its number too."""
    return DRIVEN.get(WIRE_NUMBER.sub('', column), FALLBACK_DRIVE)


def heated_part(number: int, sign: float, structure: Structure) -> float:
    """Of the full power, what a first command gives to a bundle: to the first, then to the second; a pair has both."""
    if structure.antagonistic:
        return sign if number == 0 else 0.0
    return max(sign, 0.0) if number == 0 else max(-sign, 0.0) if number == 1 else 0.0


def heating_of(config: Config) -> float:
    """Power [W] that warms the wires of a bundle by WARMING in the end, to two digits."""
    wire = wire_constants(config.parameters)
    power = wire.lambda_ * wire.surface * wire.n * WARMING
    return float(f'{power:.2g}') if power > 0.0 else 1.0


def command_from(data: Any, structure: Structure) -> Command:
    """A command from JSON. Raises UserError for what is none."""
    columns = columns_of(structure)
    if not isinstance(data, dict) or data.get('kind') not in KINDS:
        raise UserError(f'command: expected kind to be one of {", ".join(KINDS)}')
    numbers = {name: number(data.get(name), f'command, {name}') for name in ('duration', 'offset', 'amplitude', 'period')}
    if not 0.0 < numbers['duration'] <= LONGEST:
        raise UserError(f'command: expected a duration above 0 and at most {LONGEST:g} s, got {numbers["duration"]:g} s')
    if not numbers['period'] > 0.0 or numbers['duration'] / numbers['period'] * SINE_POINTS > MAX_ROWS:
        raise UserError(
            f'command: expected a period above 0 with at most {MAX_ROWS // SINE_POINTS} periods in all, '
            f'got {numbers["period"]:g} s in {numbers["duration"]:g} s'
        )
    rows, column, texts = data.get('rows'), data.get('column'), (data.get('name', ''), data.get('text', ''))
    if not isinstance(rows, list | tuple) or not 2 <= len(rows) <= MAX_ROWS:
        raise UserError(f'command: expected 2 to {MAX_ROWS} rows of steps; the last one gives the end')
    if column not in columns:
        raise UserError(f'command: expected column to be one of {", ".join(columns)}, got {column!r}')
    if not all(isinstance(text, str) for text in texts) or len(texts[1]) > MAX_TEXT:
        raise UserError(f'command: expected the name and the text of a file, at most {MAX_TEXT // 1_000_000} MB')
    return Command(
        data['kind'],
        rows=tuple(row_from(row, columns) for row in rows),
        column=str(column),
        name=texts[0],
        text=texts[1],
        **numbers,
    )


def row_from(row: Any, columns: Sequence[str]) -> tuple[float, ...]:
    """A row of steps. Raises UserError."""
    if not isinstance(row, list | tuple) or len(row) != 1 + len(columns):
        raise UserError(f'command: expected rows of time_s, {", ".join(columns)}')
    return tuple(number(value, f'command, {name}') for value, name in zip(row, ('time_s', *columns), strict=True))


def input_of(command: Command, config: Config) -> Input:
    """The input that a command means, at the ambient temperature of the parameters. Raises UserError."""
    structure = config.structure
    columns, names = columns_of(structure), structure.input_columns
    linear = [name in [drive.column for drive in structure.drives] for name in columns]
    T_E = config.parameters['environment.T_E']
    if command.kind == 'file':
        return input_from_text(command, names, linear, T_E)
    if command.kind == 'steps':
        table = np.array(command.rows)
        times, values = table[:, 0], table[:, 1:]
    else:
        count = math.ceil(SINE_POINTS * command.duration / command.period) + 1
        times = np.linspace(0.0, command.duration, max(count, 2))
        values = np.repeat([command.rows[0][1:]], len(times), axis=0).astype(float)
        swing = np.sin(2.0 * np.pi * times / command.period)
        with np.errstate(over='ignore'):  # what is not finite is refused as an input
            values[:, columns.index(command.column)] = command.offset + command.amplitude * swing
        linear = [name == command.column or each for name, each in zip(columns, linear, strict=True)]
    check_heating(dict(zip(columns, values.T, strict=True)), structure)
    if len(times) > 1 and (np.diff(times) <= 0.0).any():
        at = int(np.argmax(np.diff(times) <= 0.0))
        raise UserError(f'command: row {at + 2} is at {times[at + 1]:g} s: expected more than the {times[at]:g} s before it')
    return Input(times, np.column_stack([values, np.full(len(times), T_E)]), (*linear, False), names)


def check_heating(columns: Mapping[str, Vector], structure: Structure) -> None:
    """Raise UserError for a heating that cannot be."""
    for name in (f'{command}_W' for command in structure.commands):
        if not structure.antagonistic and name in columns and (columns[name] < 0.0).any():
            raise UserError(f'command, {name}: heating cannot be negative, got {columns[name].min():g} W')


def input_from_text(command: Command, names: Sequence[str], linear: Sequence[bool], T_E: float) -> Input:
    """The input in a CSV file. Raises UserError."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'command.csv'
        path.write_text(command.text, encoding='utf-8')
        try:
            found = read_columns(path, ('time_s', *names[: max(1, sum(linear))]), names)
        except UserError as error:
            raise UserError(str(error).replace(str(path), command.name or 'the file')) from error
    rows = len(found['time_s'])
    if rows < 2:
        raise UserError(f'{command.name}: expected at least two rows; the last one gives the end')
    values = [found.get(name, np.full(rows, T_E if name == names[-1] else 0.0)) for name in names]
    return Input(found['time_s'], np.column_stack(values), (*linear, False), tuple(names))
