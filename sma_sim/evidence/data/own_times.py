"""Columns of a table that were sampled at times of their own, as where a logger writes channels of two rates side by side.

A table of two rates has a column of time for each, and the shorter ones end early. Read by the time of the other rate, a
channel would be compressed or stretched.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from sma_sim.evidence.data.column_map import Origin, column_in_si
from sma_sim.evidence.data.stated_units import in_yaml, map_line, stem_and_unit
from sma_sim.model.arrays import Mask, Vector
from sma_sim.model.errors import UserError

MIN_BLOCKS = 10  # of samples, each with times of its own
MAX_ROWS_OF_BLOCK = 5  # on average, fewer than a session has
Columns = dict[str, Vector]


def check_times(
    path: Path,
    origins: Mapping[str, Origin],
    cells: Mapping[str, Vector],
    unused: Iterable[str],
    read: Callable[[str], Vector | None],
) -> None:
    """Raise UserError where a column has values in exactly the rows of one that grows all along and is not taken, a time of
    its own, and not in those of the time that is.

    `cells` (k,) are what is taken of the file; `read` returns an `unused` column (k,), None for one that is no numbers.
    """
    time = origins['time_s'].column
    if time is None:
        return
    rows = np.isfinite(cells[time])
    apart = {
        name: known
        for name, entry in origins.items()
        if name != 'time_s' and entry.column is not None and not entry.where and entry.time is None
        if not np.array_equal(known := np.isfinite(cells[entry.column]), rows)
        if known.any() and known[: known.sum()].all()
    }
    for other in unused if apart else ():
        values = read(other)
        if values is None:
            continue
        known = np.isfinite(values)
        if not (np.diff(values[known]) > 0.0).all() or np.array_equal(values[known], cells[time][known]):
            continue
        for name in (one for one, of_values in apart.items() if np.array_equal(of_values, known)):
            column, rows_of = origins[name].column, int(known.sum())
            where = f'{path}, column {column}: has values in {rows_of} rows, as {other} has, not in those of {time}'
            raise UserError(f'{where}: {which_time(name, str(column), other, time)}')


def check_blocks(
    path: Path,
    origins: Mapping[str, Origin],
    cells: Mapping[str, Vector],
    unused: Iterable[str],
    read: Callable[[str], Vector | None],
) -> None:
    """Raise UserError where the time counts within blocks of samples only, each of which begins at the same value.

    A block has no more than a few rows, or another column, not taken, says when each began, in its first row. `cells` and
    `read` as in `check_times`.
    """
    time = origins['time_s'].column
    if time is None:
        return
    rows = np.isfinite(cells[time])
    values = cells[time][rows]
    begins = np.diff(values, prepend=np.inf) < 0.0
    if begins.sum() < MIN_BLOCKS or np.ptp(values[begins]) > 0.0:
        return
    clock = next((name for name in unused if says_when(read(name), rows, begins)), None)
    count = int(begins.sum())
    if clock is None and len(values) > MAX_ROWS_OF_BLOCK * count:
        return
    cure = 'if rows are regular, a map says how far apart they are: time_s: {interval: SECONDS}'
    if clock is not None:
        line = map_line('time_s', clock, stem_and_unit(clock)[1])
        cure = f'{clock} has a later value in the first row of each: is it their time? Say so in a map: {line}'
    raise UserError(
        f'{path}, column {time}: starts again at {values[0]:g} {count - 1} times in {len(values)} rows, as the time within '
        f'blocks of samples does; {cure}'
    )


def says_when(values: Vector | None, rows: Mask, begins: Mask) -> bool:
    """Whether a column has values, which grow, in the `rows` (k,) with a time that begin a block, and in no others."""
    if values is None:
        return False
    known = np.isfinite(values)
    return bool(np.array_equal(known[rows], begins) and (np.diff(values[known & rows]) > 0.0).all())


def check_other_clock(
    path: Path,
    origins: Mapping[str, Origin],
    cells: Mapping[str, Vector],
    unused: Iterable[str],
    read: Callable[[str], Vector | None],
    header: Sequence[str],
    measured: Iterable[str],
) -> None:
    """Raise UserError where a `measured` column stands behind another time, by its name, than that which is taken."""
    time = origins['time_s'].column
    for other in unused if time is not None else ():
        if without_number(other) != without_number(str(time)) or (values := read(other)) is None:
            continue
        known = np.isfinite(values) & np.isfinite(cells[str(time)])
        if not (np.diff(values[known]) > 0.0).all() or np.allclose(values[known], cells[str(time)][known], rtol=1e-12):
            continue
        behind = header[header.index(other) :]
        for name in (one for one in measured if one in origins and origins[one].time is None):
            if (column := origins[name].column) in behind:
                where = f'{path}, column {column}: {other}, before it, is another clock than {time}'
                raise UserError(f'{where}: {which_time(name, str(column), other, str(time))}')


def which_time(name: str, column: str, other: str, time: str) -> str:
    """What to ask and to do where a column may have another time than the one that is taken."""
    line = f'{name}: {{column: {in_yaml(column)}, time: {in_yaml(other)}}}'
    return f'is {other} its time? Say so in a map, {line}, or say time: {time}'


def without_number(name: str) -> str:
    """The name of a column without the number at its end, by which a program tells it from another of its name."""
    return re.sub(r'[\W_]*\d+$', '', name)


def at_own_times(
    path: Path, origins: Mapping[str, Origin], cells: Mapping[str, Vector], columns: Columns, measured: Iterable[str]
) -> Columns:
    """The columns by the names of the contract, those with a time of their own in rows of their own, in the order of time.

    Raises UserError for columns that are not `measured`, and where times go back: sessions cannot be told apart then.
    """
    time = origins['time_s']
    own = {name: entry.time for name, entry in origins.items() if entry.time not in (None, time.column)}
    if not own:
        return columns
    if wrong := [name for name in own if name not in set(measured)]:
        raise UserError(f'{path}: time belongs to measured columns, {", ".join(measured)}, not to {wrong[0]}')
    parts = [{name: values for name, values in columns.items() if name not in own}]
    for other in dict.fromkeys(own.values()):
        at = column_in_si(replace(time, column=other), cells, len(columns['time_s']))
        parts.append({'time_s': at} | {name: columns[name] for name, of in own.items() if of == other})
    parts = [{name: values[np.isfinite(part['time_s'])] for name, values in part.items()} for part in parts]
    for part in parts:
        if (np.diff(part['time_s']) < 0.0).any():
            raise UserError(f'{path}: times go back; expected one session where columns have a time of their own')
    counts = [len(part['time_s']) for part in parts]
    order = np.argsort(np.concatenate([part['time_s'] for part in parts]), kind='stable')
    return {
        name: np.concatenate([part.get(name, np.full(n, np.nan)) for part, n in zip(parts, counts, strict=True)])[order]
        for name in columns
    }
