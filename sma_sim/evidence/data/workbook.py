"""Files of tables as text: their encoding, and Excel workbooks as CSV, where openpyxl is installed."""

from __future__ import annotations

import csv
import io
import warnings
import zlib
from codecs import BOM_UTF16_BE, BOM_UTF16_LE, getincrementaldecoder
from collections.abc import Iterable
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import IO, Any
from zipfile import BadZipFile

from sma_sim.evidence.data.stated_units import in_yaml
from sma_sim.model.errors import UserError
from sma_sim.model.nearest import suggestion

SUFFIX = '.xlsx'
WINDOWS = 'cp1252'  # an encoding of western letters, in which loggers write degrees and micrometres
PIECE = 1 << 20  # bytes that are decoded at once to tell the encoding: bounds the memory
# What broken workbooks make openpyxl, and the parsers of ZIP and XML below it, stumble over.
BROKEN = (BadZipFile, zlib.error, OSError, EOFError, NotImplementedError, SyntaxError, LookupError, TypeError, ValueError)


def open_text(path: Path, sheet: str = '') -> IO[str]:
    """A table as text: the file itself, or the `sheet` of a workbook, its only one if none is named.

    Raises UserError and OSError.
    """
    if path.suffix.lower() != SUFFIX:
        return path.open(encoding=encoding_of(path))
    return io.StringIO(workbook_text(path, path.stat().st_mtime_ns, sheet))


def encoding_of(path: Path) -> str:
    """UTF-16 where a mark says so, UTF-8, or the letters of Windows where a file has others, and none of UTF-8 before."""
    return encoding_of_version(path, path.stat().st_mtime_ns, path.stat().st_size)


@lru_cache(maxsize=1)
def encoding_of_version(path: Path, changed: int, size: int) -> str:
    """The encoding of a file that was last `changed` [ns] and has a `size` [B]: all of it is decoded, in pieces."""
    decoder, is_ascii = getincrementaldecoder('utf-8')(), True
    with path.open('rb') as raw:
        block = raw.read(PIECE)
        if block[:2] in (BOM_UTF16_LE, BOM_UTF16_BE):
            return 'utf-16'
        try:
            while block:
                is_ascii &= decoder.decode(block).removeprefix('\ufeff').isascii()
                block = raw.read(PIECE)
        except UnicodeDecodeError as error:
            return WINDOWS if is_ascii and error.object[: error.start].isascii() else 'utf-8-sig'
    return 'utf-8-sig'


@lru_cache(maxsize=1)
def workbook_text(path: Path, changed: int, sheet: str = '') -> str:
    """The `sheet` of a workbook that was last `changed` [ns], its only one if none is named, as text of CSV.

    Raises UserError and OSError.
    """
    try:
        import openpyxl
    except ImportError as error:
        raise UserError(
            f'{path} is an Excel workbook, which needs a package: pip install openpyxl, or save the sheet as CSV'
        ) from error
    content = io.BytesIO(path.read_bytes())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', UserWarning)  # of styles and extensions, which hold no numbers
            book = openpyxl.load_workbook(content, read_only=True, data_only=True)
            titles = [one.title for one in book.worksheets]
            sheets = {
                one.title: text_of_rows(one.iter_rows(values_only=True))
                for one in book.worksheets
                if sheet in ('', one.title)
            }
    except BROKEN as error:
        raise UserError(f'{path} is no Excel workbook: {error}; save the sheet as CSV') from error
    if sheet and not sheets:
        raise UserError(f'{path} has no sheet {sheet!r}{suggestion(sheet, titles)}; its sheets are {quoted(titles)}')
    full = {title: text for title, text in sheets.items() if text}
    if len(full) > 1:
        raise UserError(
            f'{path} has several sheets, {quoted(full)}; expected one: name that of the recording in a map (--map), '
            f'sheet: {in_yaml(next(iter(full)))}, or several in a list, or save it as CSV'
        )
    return next(iter(full.values()), '')


def quoted(titles: Iterable[str]) -> str:
    """Titles of sheets, which may have commas in them."""
    return ', '.join(map(repr, titles))


def text_of_rows(rows: Iterable[tuple[Any, ...]]) -> str:
    """Rows of cells as text, without those that are empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    for row in rows:
        if any(cell is not None for cell in row):
            writer.writerow([cell.isoformat(' ') if isinstance(cell, datetime) else cell for cell in row])
    return text.getvalue()
