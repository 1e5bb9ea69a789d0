"""Times as loggers write them: dates, times of day, counters that start again, clocks that are set by an hour."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from functools import partial
from pathlib import Path

import numpy as np

from sma_sim.evidence.data.cells import text_blocks
from sma_sim.evidence.data.sessions import are_regular
from sma_sim.evidence.data.table_format import TableFormat, cells_of_line
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError

EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
DAYS = r'(?:(\d+) days?,? )?'  # as pandas and Python write durations
CLOCK = re.compile(DAYS + r'(\d+):(\d\d):(\d\d)(?:[.,:](\d+))?(?: ?([AaPp][Mm]))?\s*(?:Z|UTC|([-+])(\d\d):?(\d\d))?')
YEAR_FIRST = re.compile(r'(\d{4})[-/](\d\d)[-/](\d\d)[T ]+(\d.*)')
YEAR_LAST = re.compile(r'(\d\d?)([./-])(\d\d?)\2(\d{4}),?[T ]+(\d.*)')
WITH_MONTH = re.compile(r'(\d\d?)[- ]([A-Za-z]{3})[- ](\d{4})[T ]+(\d.*)')
DURATION = re.compile(r'(\S+) (ms|sec|min|hr)')  # as MATLAB writes the times of a timetable
DURATION_UNITS = {'ms': 1e-3, 'sec': 1.0, 'min': 60.0, 'hr': 3600.0}
MONTHS = ('jan', 'feb', 'mar', 'apr', 'may', 'jun', 'jul', 'aug', 'sep', 'oct', 'nov', 'dec')
MAX_MONTH = 12
NOON = 12  # [h] from which a clock of half days counts again
HOUR, HALF_DAY, DAY = 3600.0, 43_200.0, 86_400.0  # [s]
BITS = (16, 32)  # of counters: of Arduino's and of PLCs' clocks
# [s] after which seconds may start again: those of clocks without a date, and of counters of milli-, micro-, nanoseconds.
PERIODS = (60.0, HOUR, HALF_DAY, DAY, *(2.0**bits * unit for bits in BITS for unit in (1e-3, 1e-6, 1e-9)))
MAX_WRAP_STEPS = 10.0  # usual steps that pass while a counter starts again
FAST_STEP = 0.1  # of the range of a counter: with longer steps it may have started again more than once between two
CLOCK_SET_STEPS = 2.0  # usual steps that pass while a clock is set


def seconds_reader(cell: str) -> Callable[[str], float] | None:
    """What makes seconds of the cells of a column that begins with this one; None where that is no date and no time of day.

    Raises ValueError for a date of which nobody can tell the day from the month.
    """
    text = cell.strip()
    if YEAR_FIRST.fullmatch(text):
        return seconds_of(YEAR_FIRST, 0, 1, 2)
    if WITH_MONTH.fullmatch(text):
        return seconds_of(WITH_MONTH, 2, 1, 0)
    if found := YEAR_LAST.fullmatch(text):
        first, sign, second = found.group(1), found.group(2), found.group(3)
        if sign != '.' and max(int(first), int(second)) <= MAX_MONTH and first != second:
            raise ValueError(text)
        day_first = sign == '.' or int(second) <= MAX_MONTH
        seconds = seconds_of(YEAR_LAST, 3, 2 if day_first else 0, 0 if day_first else 2)
        return seconds if day_and_month(text) > 1 or sign == '.' else partial(seconds_of_equal, seconds)
    if CLOCK.fullmatch(text):
        return lambda one: float('nan') if is_empty(one) else seconds_of_clock(one)
    return seconds_of_duration if DURATION.fullmatch(text) else None


def day_and_month(cell: str) -> int:
    """How many numbers the day and the month of a date are before its year, 0 where it is none: 7/7 is one number."""
    found = YEAR_LAST.fullmatch(cell.strip())
    return len({int(found[1]), int(found[3])}) if found else 0


def seconds_of_equal(seconds: Callable[[str], float], cell: str) -> float:
    """The seconds of a date whose day and month are one number, as those before. Raises ValueError for another."""
    if day_and_month(cell) > 1:
        raise ValueError(cell)
    return seconds(cell)


def seconds_of(form: re.Pattern[str], year: int, month: int, day: int) -> Callable[[str], float]:
    """What makes seconds since 1970 of a date with a time, UTC where it has no zone; where its form has year, month, day."""

    def seconds(cell: str) -> float:
        if is_empty(cell):
            return float('nan')
        found = form.fullmatch(cell.strip())
        if found is None:
            raise ValueError(cell)
        parts = found.groups()
        number = MONTHS.index(parts[month].lower()) + 1 if parts[month].isalpha() else int(parts[month])
        when = datetime(int(parts[year]), number, int(parts[day]), tzinfo=timezone.utc)
        return (when - EPOCH).total_seconds() + seconds_of_clock(parts[-1])

    return seconds


def seconds_of_clock(text: str) -> float:
    """Seconds of a time of day since midnight UTC, or of a duration in hours, minutes and seconds. Raises ValueError."""
    found = CLOCK.fullmatch(text.strip())
    if found is None:
        raise ValueError(text)
    days, hours, minutes, seconds, fraction, half, sign, zone_hours, zone_minutes = found.groups()
    hour = int(hours) if half is None else int(hours) % NOON + (NOON if half.lower() == 'pm' else 0)
    clock = timedelta(days=int(days or 0), hours=hour, minutes=int(minutes), seconds=int(seconds))
    if sign:
        zone = timedelta(hours=int(zone_hours), minutes=int(zone_minutes))
        clock += -zone if sign == '+' else zone
    return clock.total_seconds() + float(f'0.{fraction or 0}')


def seconds_of_duration(cell: str) -> float:
    """Seconds of a number with its unit. Raises ValueError."""
    found = DURATION.fullmatch(cell.strip())
    if found is None:
        return float(cell or 'nan')
    return float(found.group(1)) * DURATION_UNITS[found.group(2)]


def is_empty(cell: str) -> bool:
    """Whether a cell has no time."""
    return cell.strip().lower() in ('', 'nan', 'nat')


def reader_of_column(path: Path, written: TableFormat, index: int) -> Callable[[str], float] | None:
    """What makes seconds of the cells of a column; None where its first cell is a number. Raises UserError."""
    text = next(text_blocks(path, written), ('', True))[0]
    rows = (cells_of_line(line, ',') for line in text.split('\n') if line.strip())
    cells = (written.as_written(row[index]) for row in rows if index < len(row))
    cell = next(cells, None)
    if cell is None:
        return None
    if day_and_month(cell) == 1:
        cell = next((one for one in cells if day_and_month(one) > 1), cell)
    try:
        reader = seconds_reader(cell)
    except ValueError as error:
        raise UserError(
            f'{path}, column {written.header[index]}: nobody can tell the day from the month in {cell!r}; write dates as '
            f'2026-07-31 21:16:09.05'
        ) from error
    return None if reader is None else lambda one: reader(written.as_written(one))


def counted_on(path: Path, values: Vector) -> int:
    """Count on in place where a counter (k,) starts again at 0; how many bits it has, 0 where none starts again.

    Raises UserError where it may have started again more than once between two rows.
    """
    rows = np.flatnonzero(np.isfinite(values))
    known = values[rows]
    if len(known) < 3 or (known != np.floor(known)).any():
        return 0
    steps = np.diff(known)
    for bits in BITS:
        counts = 2.0**bits
        least = 0.0 if known.min() >= 0.0 else -0.5 * counts  # of a counter with a sign
        if known.min() < least or known.max() >= least + counts:
            continue
        back = steps < -0.5 * counts
        if back.any() and (steps[back] + counts <= MAX_WRAP_STEPS * float(np.median(steps))).all():
            values[rows] = known + counts * np.concatenate([[0.0], np.cumsum(back)])
            return bits
        forward = steps % counts
        if (steps < 0.0).sum() > 2 and are_regular(forward) and np.median(forward) > FAST_STEP * counts:
            raise UserError(
                f'{path}: time is a {bits}-bit counter that starts again every few rows, and nobody can tell how often '
                f'between two; if rows are regular, a map says how far apart they are: time_s: {{interval: SECONDS}}'
            )
    return 0


def without_period(seconds: Vector) -> float:
    """Count on in place where a clock (k,) [s] without a date, or a counter, starts again; its period [s], 0 for none.

    A file that begins where the clock starts again may as well hold several sessions of that length: it is left.
    """
    rows = np.flatnonzero(np.isfinite(seconds))
    known = seconds[rows]
    steps = np.diff(known)
    back = steps < 0.0
    if len(known) < 3 or not back.any() or back.all():
        return 0.0
    near = MAX_WRAP_STEPS * float(np.median(steps[~back]))
    for period in PERIODS:
        ends, starts, across = known[:-1][back], known[1:][back], steps[back] + period
        is_inside = known.min() >= 0.0 and known.max() < period and MAX_WRAP_STEPS * near < period
        goes_on = (
            (across >= 0.0).all() and (across <= near).all() and (ends >= period - near).all() and (starts <= near).all()
        )
        if is_inside and goes_on and known[0] > near:
            seconds[rows] = known + period * np.concatenate([[0.0], np.cumsum(back)])
            return period
    return 0.0


def without_clock_change(seconds: Vector) -> bool:
    """Whether a clock (k,) [s] of local time was once set by an hour, on the hour; it goes on in place as before."""
    rows = np.flatnonzero(np.isfinite(seconds))
    known = seconds[rows]
    steps = np.diff(known)
    usual = float(np.median(steps)) if len(steps) else 0.0
    if usual <= 0.0:
        return False
    near = CLOCK_SET_STEPS * usual
    for by in (-HOUR, HOUR):
        rest = steps - by
        on_the_hour = HOUR - known[:-1] % HOUR <= near
        found = np.flatnonzero((rest > 0.0) & (rest <= near) & on_the_hour)
        if len(found) == 1 and near < HOUR / MAX_WRAP_STEPS:
            seconds[rows[found[0] + 1 :]] -= by
            return True
    return False
