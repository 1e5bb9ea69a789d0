"""CSV files with units in their headers, read with messages that a person can act on, written whole or not at all."""

from __future__ import annotations

import csv
import io
import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.errors import UserError

Vector = NDArray[np.float64]
FORMAT = '%.17g'  # reads back to the same double
ROWS_AT_ONCE = 100_000


def read_columns(
    path: Path, required: Sequence[str], optional: Sequence[str] = (), with_gaps: Sequence[str] = ()
) -> dict[str, Vector]:
    """The named columns of a CSV file, (k,) each; all of their cells must be finite numbers. Raises UserError.

    `with_gaps` are optional too, and may have cells that are empty or NaN: they are NaN in the result.
    """
    header = read_header(path)
    missing = [name for name in required if name not in header]
    if missing:
        close = get_close_matches(missing[0], header, n=1, cutoff=0.5)
        hint = f' (rename {close[0]}; the unit is part of the name)' if close else ''
        raise UserError(f'{path} has no column {", ".join(missing)}{hint}; its columns are {", ".join(header)}')
    wanted = [name for name in (*required, *optional, *with_gaps) if name in header]
    doubled = [name for name in wanted if header.count(name) > 1]
    if doubled:
        raise UserError(f'{path} has column {doubled[0]} more than once')
    places = [header.index(name) for name in wanted]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', UserWarning)  # of an empty table: said below
            table = np.loadtxt(
                path, delimiter=',', skiprows=1, usecols=places, ndmin=2, encoding='utf-8', comments=None,
                converters={place: number_or_gap for name, place in zip(wanted, places, strict=True) if name in with_gaps},
            )  # fmt: skip
    except (ValueError, OSError):
        table = None
    full = [k for k, name in enumerate(wanted) if name not in with_gaps]
    if table is None or len(table) and not np.isfinite(table[:, full]).all():
        raise UserError(first_wrong_cell(path, wanted, places, with_gaps))
    if len(table) == 0:
        raise UserError(f'{path} has a header but no rows')
    return {name: table[:, k].copy() for k, name in enumerate(wanted)}


def read_header(path: Path) -> list[str]:
    """The names in the first line."""
    try:
        with path.open(newline='', encoding='utf-8-sig') as file:
            line = file.readline(1_000_000)
    except OSError as error:
        raise UserError(f'cannot read {path}: {error.strerror}') from error
    except UnicodeDecodeError as error:
        raise UserError(f'{path} is not a CSV file: {error}') from error
    if not line.strip():
        raise UserError(f'{path} is empty: expected a header and at least one row')
    return [name.strip() for name in next(csv.reader([line]))]


def number_or_gap(cell: str) -> float:
    """The finite number in a cell, NaN where it is empty or says so itself."""
    number = float(cell) if cell.strip() else float('nan')
    if np.isinf(number):
        raise ValueError(cell)
    return number


def first_wrong_cell(path: Path, names: Sequence[str], places: Sequence[int], with_gaps: Sequence[str] = ()) -> str:
    """What to say of the first cell that is not a finite number (nor a gap where one may be)."""
    try:
        with path.open(newline='', encoding='utf-8') as file:
            for number, row in enumerate(csv.reader(file), start=1):
                if number == 1 or not row:
                    continue
                for name, place in zip(names, places, strict=True):
                    cell = row[place].strip() if place < len(row) else ''
                    gap = name in with_gaps and place < len(row) and cell.lower() in ('', 'nan')
                    if not (gap or is_finite_number(cell)):
                        return f'{path}, row {number}, column {name}: expected a number, got {cell or "nothing"!r}'
    except (UnicodeDecodeError, csv.Error) as error:
        return f'{path} is not a CSV file: {error}'
    except OSError as error:
        return f'cannot read {path}: {error.strerror}'
    return f'{path} is not a CSV file with commas between its cells'


def is_finite_number(cell: str) -> bool:
    """Whether a cell reads as a finite number."""
    try:
        return bool(np.isfinite(float(cell)))
    except ValueError:
        return False


def write_columns(path: Path, columns: Mapping[str, Vector]) -> None:
    """Write a CSV file of numbers, whole or not at all; NaN leaves a cell empty. Raises UserError."""
    table = np.column_stack(list(columns.values()))

    def fill(file: Any) -> None:
        file.write(','.join(columns) + '\n')
        for first in range(0, len(table), ROWS_AT_ONCE):
            text = io.StringIO()
            np.savetxt(text, table[first : first + ROWS_AT_ONCE], fmt=FORMAT, delimiter=',')
            file.write(text.getvalue().replace('nan', ''))

    write_whole(path, fill)


def write_rows(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a CSV file of any cells, whole or not at all. Raises UserError."""

    def fill(file: Any) -> None:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)

    write_whole(path, fill)


def check_writable(path: Path) -> None:
    """Raise UserError, before any long work, where a file could not be written."""
    if path.is_dir():
        raise UserError(f'cannot write {path}: it is a folder')
    if not os.access(path.parent, os.W_OK):
        reason = 'no permission' if path.parent.exists() else f'there is no folder {path.parent}'
        raise UserError(f'cannot write {path}: {reason}')


def write_whole(path: Path, fill: Any) -> None:
    """Let `fill` write a text file under a temporary name, then rename it. Raises UserError."""
    temporary = path.with_name(f'.{path.name}.{os.getpid()}.part')
    try:
        with temporary.open('w', newline='', encoding='utf-8') as file:
            fill(file)
        temporary.replace(path)
    except OSError as error:
        raise UserError(f'cannot write {path}: {error.strerror}') from error
    finally:
        temporary.unlink(missing_ok=True)
