"""CSV files with units in their headers, read with messages that a person can act on, written whole or not at all."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.errors import UserError

Vector = NDArray[np.float64]


def read_columns(path: Path, required: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Vector]:
    """The named columns of a CSV file, (k,) each. Raises UserError."""
    try:
        with path.open(newline='') as file:
            rows = [row for row in csv.reader(file) if any(cell.strip() for cell in row)]
    except OSError as error:
        raise UserError(f'cannot read {path}: {error.strerror}') from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise UserError(f'{path} is not a CSV file: {error}') from error
    if len(rows) < 2:
        raise UserError(f'{path} is empty: expected a header and at least one row')
    header = [name.strip() for name in rows[0]]
    missing = [name for name in required if name not in header]
    if missing:
        raise UserError(f'{path} has no column {", ".join(missing)}; its columns are {", ".join(header)}')
    wanted = [name for name in (*required, *optional) if name in header]
    doubled = [name for name in wanted if header.count(name) > 1]
    if doubled:
        raise UserError(f'{path} has column {doubled[0]} more than once')
    return {name: _numbers(path, name, header.index(name), rows[1:]) for name in wanted}


def _numbers(path: Path, name: str, column: int, rows: list[list[str]]) -> Vector:
    values = np.empty(len(rows))
    for k, row in enumerate(rows):
        try:
            values[k] = float(row[column])
        except (ValueError, IndexError):
            given = row[column] if column < len(row) else 'nothing'
            raise UserError(f'{path}, row {k + 2}, column {name}: expected a number, got {given!r}') from None
        if not np.isfinite(values[k]):
            raise UserError(f'{path}, row {k + 2}, column {name}: {values[k]} is not a finite number')
    return values


def write_columns(path: Path, columns: Mapping[str, Vector]) -> None:
    """Write a CSV file under a temporary name, then rename it. Raises UserError."""
    temporary = path.with_name(f'.{path.name}.{os.getpid()}.part')
    whole = [name.startswith('mode') for name in columns]
    try:
        with temporary.open('w', newline='') as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            for row in zip(*columns.values(), strict=True):
                writer.writerow([int(v) if w else repr(float(v)) for v, w in zip(row, whole, strict=True)])
        temporary.replace(path)
    except OSError as error:
        raise UserError(f'cannot write {path}: {error.strerror}') from error
    finally:
        temporary.unlink(missing_ok=True)
