"""CSV files with units in their headers, read with messages that name the cause, written completely or not at all."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sma_sim.evidence.data.cells import CellLayout, read_cells
from sma_sim.evidence.data.foreign_columns import hint_for
from sma_sim.evidence.data.stated_units import UNITS, conversion, stated_unit, unit_of
from sma_sim.evidence.data.table_format import table_format
from sma_sim.evidence.data.workbook import SUFFIX as WORKBOOK
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.model.files import whole_file
from sma_sim.model.shown import listed

NUMBER_FORMAT = '%.17g'  # reads back to the same double
ROWS_PER_WRITE = 100_000
MAX_NAMES = 40  # in a message


def read_columns(
    path: Path, required: Sequence[str], optional: Sequence[str] = (), with_gaps: Sequence[str] = ()
) -> dict[str, Vector]:
    """The named columns of a CSV file, (k,) each; all of their cells must be finite numbers. Raises UserError.

    `with_gaps` are optional too, and may have cells that are empty or NaN: they are NaN in the result.
    """
    written = table_format(path)
    header = written.header
    missing = [name for name in required if name not in header]
    if missing:
        hint = hint_for(missing[0], header, (*required, *optional, *with_gaps), with_map=False)
        raise UserError(f'{path} has no column {", ".join(missing)}{hint}; its columns are {listed(header, MAX_NAMES)}')
    present = [name for name in (*required, *optional, *with_gaps) if name in header]
    doubled = [name for name in present if header.count(name) > 1]
    if doubled:
        raise UserError(f'{path} has column {doubled[0]} more than once')
    check_row_of_units(path, present, written.units)
    indices = [header.index(name) for name in present]
    full = [name for name in present if name not in with_gaps]
    return read_cells(CellLayout(path, present, indices, written, full))[0]


def check_row_of_units(path: Path, names: Sequence[str], row: Mapping[str, str]) -> None:
    """Raise UserError where the row of units of a file says another unit than that of a column of ours."""
    for name in names:
        unit, where = stated_unit(name, name, row)
        if unit and UNITS[unit_of(name)].get(unit) != (1.0, 0.0):
            how = conversion(name, unit).replace('scale:', 'multiply by').replace('offset:', 'add')
            raise UserError(
                f'{path}, column {name}: {where} says {unit}, expected {unit_of(name)}; convert the numbers ({how}) and '
                f'that row, or correct the row alone'
            )


def read_header(path: Path) -> list[str]:
    """The names of the columns. Raises UserError."""
    return list(table_format(path).header)


def write_columns(path: Path, columns: Mapping[str, Vector]) -> None:
    """Write a CSV file of numbers, whole or not at all; NaN leaves a cell empty. Raises UserError."""
    table = np.column_stack(list(columns.values()))

    def fill(file: Any) -> None:
        file.write(','.join(columns) + '\n')
        for first in range(0, len(table), ROWS_PER_WRITE):
            text = io.StringIO()
            np.savetxt(text, table[first : first + ROWS_PER_WRITE], fmt=NUMBER_FORMAT, delimiter=',')
            file.write(text.getvalue().replace('nan', ''))

    write_whole(path, fill)


def write_rows(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a CSV file of any cells, whole or not at all. Raises UserError."""

    def fill(file: Any) -> None:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)

    write_whole(path, fill)


def check_writable(path: Path, read: Iterable[Path] = ()) -> None:
    """Raise UserError, before any long work, where a file could not be written, or is one of those that are `read`."""
    for file in read:
        if file.exists() and path.exists() and os.path.samefile(file, path):
            raise UserError(f'cannot write {path}: it is read as {file}, and would be lost; give another name')
    if path.is_dir():
        raise UserError(f'cannot write {path}: it is a folder')
    if path.suffix.lower() == WORKBOOK:
        raise UserError(f'cannot write {path}: no Excel workbook is written; expected a table as text, such as FILE.csv')
    is_replaced = path.is_file() or not path.exists()  # a device or a pipe is written to
    if not os.access(path.parent if is_replaced else path, os.W_OK):
        reason = 'no permission' if path.parent.exists() else f'there is no folder {path.parent}'
        raise UserError(f'cannot write {path}: {reason}')


def write_whole(path: Path, fill: Any) -> None:
    """Let `fill` write a text file, whole or not at all. Raises UserError."""
    with whole_file(path) as temporary, temporary.open('w', newline='', encoding='utf-8') as file:
        fill(file)
