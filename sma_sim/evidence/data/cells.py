"""The numbers of a CSV file, read in pieces: memory for the result and one piece, whatever the file's size."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.table_format import BLOCK_SIZE, MAX_LINE_LENGTH, MISSING_CELLS, TableFormat
from sma_sim.evidence.data.workbook import SUFFIX, open_text
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError


@dataclass(frozen=True)
class CellLayout:
    """Where to look: `names` of the columns to read, their `indices` in a row, and how the file is written.

    Columns in `full` must hold finite numbers; others may have gaps. A `tolerant` reader leaves out a last line that is
    cut, and lets infinity pass: whoever asks for that looks at the numbers again. `conversions`: by column, what makes a
    number of a cell that is text (ValueError where it cannot).
    """

    path: Path
    names: Sequence[str]
    indices: Sequence[int]
    format: TableFormat
    full: Sequence[str] = ()
    tolerant: bool = False
    conversions: Mapping[str, Callable[[str], float]] = field(default_factory=dict)

    @property
    def width(self) -> int:
        """How many cells a row has."""
        return len(self.format.header)

    @property
    def least_width(self) -> int:
        """How many cells a row has without those at its end that no column has a name for."""
        return max((k for k, name in enumerate(self.format.header, start=1) if name), default=1)


def read_cells(layout: CellLayout) -> tuple[dict[str, Vector], bool]:
    """The columns, (k,) each and NaN at gaps, and whether a cut last line was left out. Raises UserError."""
    path = layout.path
    try:
        table = [np.empty(max_row_count(path, layout.format.sheet)) for _ in layout.names]
        count, line, cut = 0, layout.format.lines_before + 1, False
        for text, last in text_blocks(path, layout.format):
            if last and layout.tolerant:
                text, cut = without_cut_line(text, layout.least_width)
            block = parsed_block(text, line, layout)
            for column, values in zip(table, block.T, strict=True):
                column[count : count + len(block)] = values
            count, line = count + len(block), line + text.count('\n')
    except OSError as error:
        raise UserError(f'cannot read {path}: {error.strerror}') from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise UserError(f'{path} is not a CSV file: {error}') from error
    if count == 0:
        raise UserError(f'{path} has a header but no {"complete " if cut else ""}rows')
    return {name: column[:count] for name, column in zip(layout.names, table, strict=True)}, cut


def max_row_count(path: Path, sheet: str) -> int:
    """At least as many as the file has rows; without decoding it, if it is text."""
    if path.suffix.lower() == SUFFIX:
        with open_text(path, sheet) as file:
            return sum(1 for _ in file)
    ends = 1
    with path.open('rb') as raw:
        while piece := raw.read(BLOCK_SIZE):
            ends += piece.count(b'\n') + piece.count(b'\r') - piece.count(b'\r\n')
    return ends


def text_blocks(path: Path, written: TableFormat) -> Iterator[tuple[str, bool]]:
    """Whole lines after the header as plain CSV, about BLOCK_SIZE characters at a time, and whether they are the last."""
    with open_text(path, written.sheet) as file:
        for _ in range(written.lines_before):
            file.readline(MAX_LINE_LENGTH)
        text = read_lines(file, path)
        while text:
            following = read_lines(file, path)
            yield written.plain(text), not following
            text = following


def read_lines(file: IO[str], path: Path) -> str:
    """The next whole lines. Raises UserError for what is no text, or no lines."""
    try:
        text = file.read(BLOCK_SIZE)
        rest = '' if text.endswith('\n') else file.readline(MAX_LINE_LENGTH)
    except UnicodeDecodeError as error:
        raise UserError(f'{path} is not a CSV file: {error}') from error
    if len(rest) == MAX_LINE_LENGTH:
        raise UserError(f'{path} is not a CSV file: it has a line of more than {MAX_LINE_LENGTH} characters')
    return text + rest


def without_cut_line(text: str, width: int) -> tuple[str, bool]:
    """The text without its last line if that has no end or too few cells."""
    body = text.rstrip('\n')
    start = body.rfind('\n') + 1
    if body and (body == text or body.count(',', start) < width - 1):
        return text[:start], True
    return text, False


def parsed_block(text: str, line: int, layout: CellLayout) -> NDArray[np.float64]:
    """The cells to read (rows, columns) of whole lines, the first of which is `line` of the file. Raises UserError."""
    if not text.strip():
        return np.empty((0, len(layout.names)))
    block = parsed_at_once(text, layout)
    full = [k for k, name in enumerate(layout.names) if name in layout.full]
    if block is None or not np.isfinite(block[:, full]).all() or not layout.tolerant and np.isinf(block).any():
        return parsed_by_cell(text, line, layout)
    return block


def parsed_at_once(text: str, layout: CellLayout) -> NDArray[np.float64] | None:
    """The fast way; None where a line does not look as it should."""
    while '\n\n' in text:
        text = text.replace('\n\n', '\n')
    text = text.strip('\n') + '\n'
    if '"' in text or not has_width(text, layout.width):
        return None
    for before, after in ((',,', ',nan,'), (',,', ',nan,'), (',\n', ',nan\n'), ('\n,', '\nnan,')):
        text = text.replace(before, after)
    if text.startswith(','):
        text = 'nan' + text
    places = dict(zip(layout.names, layout.indices, strict=True))
    converters: dict[int | str, Callable[[str], Any]] = {places[name]: make for name, make in layout.conversions.items()}
    try:
        block: NDArray[np.float64] = np.loadtxt(
            io.StringIO(text),
            delimiter=',',
            usecols=layout.indices,
            ndmin=2,
            comments=None,
            converters=converters,
            encoding='utf-8',
        )
    except ValueError:
        return None
    return block


def has_width(text: str, width: int) -> bool:
    """Whether every line has `width` cells: numpy would not mind one more, such as a decimal comma makes."""
    raw = np.frombuffer(text.encode(), np.uint8)
    commas = np.searchsorted(np.flatnonzero(raw == ord(',')), np.flatnonzero(raw == ord('\n')))
    return bool((np.diff(commas, prepend=0) == width - 1).all())


def parsed_by_cell(text: str, line: int, layout: CellLayout) -> NDArray[np.float64]:
    """The slow way, which names the cell that is wrong. Raises UserError."""
    rows = []
    for number, row in enumerate(csv.reader(text.split('\n')), start=line):
        if len(row) <= 1 and not ''.join(row).strip():
            continue
        one_more = len(row) == layout.width + 1
        if len(row) > layout.width and ''.join(row[layout.width :]).strip():
            raise UserError(
                f'{layout.path}, row {number}: expected {layout.width} cells as in the header, got {len(row)} '
                f'(decimals need points, not commas{"; or a name is missing, as R leaves out the first" * one_more})'
            )
        rows.append(
            [cell_number(row, index, name, number, layout) for name, index in zip(layout.names, layout.indices, strict=True)]
        )
    return np.array(rows, float).reshape(-1, len(layout.names))


def cell_number(row: Sequence[str], index: int, name: str, number: int, layout: CellLayout) -> float:
    """The number in one cell, NaN at a gap. Raises UserError."""
    cell = row[index].strip() if index < len(row) else ''
    if index < len(row) and name not in layout.full and cell.lower() in MISSING_CELLS:
        return float('nan')
    try:
        value = layout.conversions.get(name, float)('x' if '_' in cell and name not in layout.conversions else cell)
    except ValueError:
        value = float('nan')
    if np.isnan(value) or np.isinf(value) and not layout.tolerant:
        cure = cure_of(cell, name, layout.tolerant)
        if name in layout.full and cell.lower() in MISSING_CELLS:
            cure = '; write the number that holds there, or delete the row'
        got = repr(layout.format.as_written(cell[:40]) or 'nothing') + cure
        decimals = ' with a decimal comma, as the file has them' if layout.format.decimal_comma else ''
        raise UserError(f'{layout.path}, row {number}, column {name}: expected a number{decimals}, got {got}')
    return value


def cure_of(cell: str, name: str, dates: bool) -> str:
    """What to do with a cell that is no number; `dates`: the reader takes them."""
    if cell == name:
        return '; the names of the columns again: split the file there'
    if cell.startswith('#'):
        return '; leave the cell empty: a formula of a spreadsheet failed there'
    if '\0' in cell:
        return '; delete the bytes that are 0: the file was not written to its end'
    if re.search(r'\d:\d', cell) and not dates:
        return '; write seconds: dates and times of day are read in recordings only'
    if re.search(r'\d:\d', cell):
        return '; of dates and times of day 2026-07-31 21:16:09.05 and 21:16:09.05 are read'
    if any(sign.isdigit() for sign in cell):
        return '; write the number alone, without a unit or separators of thousands'
    return '; leave the cell empty where nothing was measured, or delete a row that is no sample'
