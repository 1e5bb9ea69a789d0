"""Times as loggers write them: dates, and counters of 16 and 32 bit that start again."""

from __future__ import annotations

import re
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np

from sma_sim.evidence.data.cells import Vector, text_blocks
from sma_sim.evidence.data.table_format import TableFormat, cells_of_line

DATE = re.compile(r'(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d)([.]\d+)?\s*(?:Z|UTC|([-+])(\d\d):?(\d\d))?')
EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
BITS = (16, 32)  # of counters: of Arduino's and of PLCs' clocks
MAX_WRAP_STEPS = 10.0  # usual steps that pass while a counter starts again


def seconds_of_date(cell: str) -> float:
    """Seconds since 1970 of an ISO 8601 date with a time, UTC where it has no zone; NaN for an empty cell.

    Raises ValueError for anything else.
    """
    found = DATE.fullmatch(cell.strip())
    if found is None:
        if cell.strip().lower() in ('', 'nan'):
            return float('nan')
        raise ValueError(cell)
    day, clock, fraction, sign, hours, minutes = found.groups()
    when = datetime.fromisoformat(f'{day}T{clock}').replace(tzinfo=timezone.utc)
    if sign:
        zone = timedelta(hours=int(hours), minutes=int(minutes))
        when += -zone if sign == '+' else zone
    return (when - EPOCH).total_seconds() + float(fraction or 0.0)


def has_dates(path: Path, written: TableFormat, index: int) -> bool:
    """Whether the first cell of a column is a date with a time."""
    text = next(text_blocks(path, written), ('', True))[0]
    line = next((one for one in text.split('\n') if one.strip()), '')
    cells = cells_of_line(line, ',')
    return index < len(cells) and DATE.fullmatch(cells[index]) is not None


def unwrap_counter(values: Vector) -> int:
    """Count on in place where a counter (k,) starts again at 0; how many bits it has, 0 where none starts again."""
    rows = np.flatnonzero(np.isfinite(values))
    known = values[rows]
    if len(known) < 3 or (known != np.floor(known)).any():
        return 0
    steps = np.diff(known)
    for bits in BITS:
        counts = 2.0**bits
        least = 0.0 if known.min() >= 0.0 else -0.5 * counts  # of a counter with a sign
        back = steps < -0.5 * counts
        inside = known.min() >= least and known.max() < least + counts
        if inside and back.any() and (steps[back] + counts <= MAX_WRAP_STEPS * float(np.median(steps))).all():
            values[rows] = known + counts * np.concatenate([[0.0], np.cumsum(back)])
            return bits
    return 0
