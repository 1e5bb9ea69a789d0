"""A parameter sheet: what a fit says of a wire or a robot, for people and for other programs.

One line for each parameter of the model: value, 95 % interval, unit, how it is known, what it is. The suffix of the file
says the format: .csv, .md, .yaml.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import isnan
from pathlib import Path

import yaml

from sma_sim.evidence.data.tables import write_whole
from sma_sim.evidence.estimation.calibrate import Calibration
from sma_sim.evidence.estimation.free_parameters import declared_parameters
from sma_sim.model.errors import UserError

FITTED, UNDETERMINED, KEPT = 'fitted', 'not determined by these data', 'kept'
SUFFIXES = ('.yaml', '.csv', '.md')
DIGITS = 6


@dataclass(frozen=True)
class SheetRow:
    """One parameter: `value`, `low` and `high` (95 % interval, None where there is none) in `unit`, and how it is known."""

    name: str
    value: float
    low: float | None
    high: float | None
    unit: str
    status: str
    description: str


def sheet_rows(found: Calibration) -> tuple[SheetRow, ...]:
    """The parameters of a fitted model in the order of its parameter file, those of its effects last."""
    declared, values = declared_parameters(found.config), found.config.values
    intervals = {interval.name: interval for interval in found.uncertainty.intervals} if found.uncertainty else {}
    free = {parameter.name for parameter in found.free}
    rows = []
    for name, parameter in declared.items():
        if not belongs(name, found) or isnan(values[name]):
            continue
        interval = intervals.get(name)
        seen = interval is not None and interval.seen
        status = KEPT if name not in free else FITTED if seen or interval is None else UNDETERMINED
        low, high = (rounded(interval.low), rounded(interval.high)) if interval is not None and seen else (None, None)
        rows.append(SheetRow(name, rounded(values[name]), low, high, parameter.unit, status, parameter.description))
    return tuple(rows)


def belongs(name: str, found: Calibration) -> bool:
    """Whether a parameter says something of this system: those of another structure are left out."""
    structure = found.config.structure
    return name.startswith(('wire.', 'effects.')) or name in structure.declared or name in structure.fitted


def rounded(value: float) -> float:
    """A number to a few digits."""
    return float(f'{value:.{DIGITS}g}')


def sheet_text(rows: Sequence[SheetRow], suffix: str) -> str:
    """The sheet in the format of a suffix."""
    names = list(asdict(rows[0]))
    if suffix == '.csv':
        text = io.StringIO()
        writer = csv.writer(text, lineterminator='\n')
        writer.writerows([names, *(['' if cell is None else cell for cell in asdict(row).values()] for row in rows)])
        return text.getvalue()
    if suffix == '.md':
        lines = ['| parameter | value | 95 % interval | unit | status | meaning |', '|---|---|---|---|---|---|']
        for row in rows:
            interval = '' if row.low is None else f'{row.low:.5g} to {row.high:.5g}'
            lines.append(f'| `{row.name}` | {row.value:.5g} | {interval} | {row.unit} | {row.status} | {row.description} |')
        return '\n'.join(lines) + '\n'
    content = {
        row.name: {key: cell for key, cell in asdict(row).items() if key != 'name' and cell is not None} for row in rows
    }
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


def check_sheet(path: Path | None) -> None:
    """Raise UserError for a suffix that says no format."""
    if path is not None and path.suffix not in SUFFIXES:
        raise UserError(f'--sheet {path}: expected a name that ends in {", ".join(SUFFIXES)}')


def write_sheet(path: Path, found: Calibration) -> None:
    """Write the parameter sheet of a fit, whole or not at all. Raises UserError."""
    text = sheet_text(sheet_rows(found), path.suffix)
    write_whole(path, lambda file: file.write(text))
