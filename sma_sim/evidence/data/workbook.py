"""Excel workbooks as text of CSV; openpyxl reads them where it is installed."""

from __future__ import annotations

import csv
import io
import zlib
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterable
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import IO, Any
from zipfile import BadZipFile

from sma_sim.model.errors import UserError

SUFFIX = '.xlsx'
# What broken workbooks make openpyxl, and the parsers of ZIP and XML below it, stumble over.
BROKEN = (BadZipFile, zlib.error, OSError, EOFError, NotImplementedError, SyntaxError, LookupError, TypeError, ValueError)


def open_text(path: Path) -> IO[str]:
    """A table as text: the file itself, or the sheet of a workbook. Raises UserError and OSError."""
    if path.suffix.lower() != SUFFIX:
        with path.open('rb') as raw:
            marked = raw.read(2) in (BOM_UTF16_LE, BOM_UTF16_BE)
        return path.open(encoding='utf-16' if marked else 'utf-8-sig')
    return io.StringIO(workbook_text(path, path.stat().st_mtime_ns))


@lru_cache(maxsize=1)
def workbook_text(path: Path, changed: int) -> str:
    """The only sheet of a workbook that was last `changed` [ns] as text of CSV. Raises UserError and OSError."""
    try:
        import openpyxl
    except ImportError as error:
        raise UserError(
            f'{path} is an Excel workbook, which needs a package: pip install openpyxl, or save the sheet as CSV'
        ) from error
    content = io.BytesIO(path.read_bytes())
    try:
        book = openpyxl.load_workbook(content, read_only=True, data_only=True)
        sheets = {sheet.title: text_of_rows(sheet.iter_rows(values_only=True)) for sheet in book.worksheets}
    except BROKEN as error:
        raise UserError(f'{path} is no Excel workbook: {error}; save the sheet as CSV') from error
    full = {title: text for title, text in sheets.items() if text}
    if len(full) > 1:
        raise UserError(f'{path} has several sheets, {", ".join(full)}; expected one: save that of the recording as CSV')
    return next(iter(full.values()), '')


def text_of_rows(rows: Iterable[tuple[Any, ...]]) -> str:
    """Rows of cells as text, without those that are empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    for row in rows:
        if any(cell is not None for cell in row):
            writer.writerow([cell.isoformat(' ') if isinstance(cell, datetime) else cell for cell in row])
    return text.getvalue()
