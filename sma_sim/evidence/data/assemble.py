"""From the columns of one file to its recordings: one for each session in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.cleaning import gap_notes, held, outliers, rate_note
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS, CHANNELS_OF, INPUT_COLUMNS, NEEDED_COLUMNS, Recording, Vector
from sma_sim.evidence.data.sessions import (
    Rows,
    changes_of,
    first_known,
    group_starts,
    kept_rows,
    last_of_groups,
    ordered_sessions,
)
from sma_sim.evidence.data.units import check_duration, check_unit, slow_sampling
from sma_sim.model.errors import UserError
from sma_sim.solver.inputs import Input

COMMAND = {'module': 'J_eq_W', 'wire': 'J_W'}
INFINITE = 1e100  # no unit makes so much of anything
EPOCH = 1e6  # [s] a first time beyond this is a date
FEWEST = 2  # samples of a session


class NothingMeasuredError(UserError):
    """A file that says what was commanded, and holds no measurement."""


@dataclass(frozen=True)
class Place:
    """Which file is read, as which system, and the ambient temperature [K] where the file does not tell.

    `stamped` says that the command has stamps of its own, as in a bag; `namespace` whose topics are read from a bag.
    """

    path: Path
    system: str
    T_E: float
    stamped: bool = False
    namespace: str | None = None


def recordings_of(place: Place, name: str, columns: dict[str, Vector], notes: list[str]) -> tuple[Recording, ...]:
    """The sessions of a file, `columns` (k,) by the names of the file contract (emptied on the way). Raises UserError."""
    check_needed(place, columns)
    columns_at_known_times(place, columns, notes)
    take_out_infinities(columns, notes)
    sampled = sampled_rows(place.system, columns)
    if not sampled.any():
        measurable = ', '.join(CHANNEL_COLUMNS[channel] for channel in CHANNELS_OF[place.system])
        raise NothingMeasuredError(f'{place.path}: nothing measured in it; expected some of the columns {measurable}')
    sessions, more = ordered_sessions(place.path, columns['time_s'], sampled)
    notes += more
    found = [session for session in sessions if sampled[session].sum() >= FEWEST]
    if len(found) < len(sessions):
        notes.append(f'{len(sessions) - len(found)} sessions with fewer than {FEWEST} measured rows: dropped')
    if not found:
        raise UserError(f'{place.path}: expected at least {FEWEST} measured rows, got {int(sampled.sum())}')
    if len(found) == 1:
        return (one_recording(place, name, taken(columns, found[0], last=True), notes),)
    return tuple(
        one_recording(place, f'{name}#{number}', taken(columns, session, number == len(found)), notes)
        for number, session in enumerate(found, start=1)
    )


def check_needed(place: Place, columns: Mapping[str, Vector]) -> None:
    """Raise UserError where time or command is missing."""
    missing = [name for name in NEEDED_COLUMNS[place.system] if name not in columns]
    if missing:
        raise UserError(f'{place.path} has no {", ".join(missing)}; expected the recording of a {place.system}')


def columns_at_known_times(place: Place, columns: dict[str, Vector], notes: list[str]) -> None:
    """Leave out the rows without a finite time."""
    known = np.abs(columns['time_s']) < INFINITE
    if known.all():
        return
    if not known.any():
        raise UserError(f'{place.path}, column time_s: expected seconds, got no number')
    notes.append(f'{int((~known).sum())} rows without a time: dropped')
    for name in columns:
        columns[name] = columns[name][known]


def take_out_infinities(columns: dict[str, Vector], notes: list[str]) -> None:
    """NaN for what no sensor could mean, in place."""
    for name, values in columns.items():
        infinite = np.abs(values) >= INFINITE
        if infinite.any():
            notes.append(f'{name}: {int(infinite.sum())} infinite values: taken as missing')
            values[infinite] = np.nan


def sampled_rows(system: str, columns: Mapping[str, Vector]) -> NDArray[np.bool_]:
    """Which rows hold a measured cell."""
    sampled = np.zeros(len(columns['time_s']), dtype=bool)
    for channel in CHANNELS_OF[system]:
        if CHANNEL_COLUMNS[channel] in columns:
            sampled |= np.isfinite(columns[CHANNEL_COLUMNS[channel]])
    return sampled


def taken(columns: dict[str, Vector], rows: Rows, last: bool) -> dict[str, Vector]:
    """The rows of every column; the last taker empties `columns`, so that they are not in memory twice."""
    return {name: (columns.pop(name) if last else columns[name])[rows] for name in list(columns)}


def one_recording(place: Place, name: str, columns: dict[str, Vector], notes: list[str]) -> Recording:
    """One session, its times in order. Raises UserError."""
    notes = list(notes)
    fill_inputs(place, columns, notes)
    sampled = sampled_rows(place.system, columns)
    command = columns[COMMAND[place.system]]
    changes, told = changes_of(columns['time_s'], command, sampled)
    exact = place.stamped or bool(told.all())
    if not exact:
        notes.append(sampled_note(told))
    merge_equal_times(columns, notes)
    if len(columns['time_s']) < FEWEST:
        only = columns['time_s'][0]
        raise UserError(f'{place.path}, column time_s: expected times that increase, got {only:g} in every row')
    check_duration(place.path, columns['time_s'])
    if abs(columns['time_s'][0]) > EPOCH:
        notes.append(f'time is counted from the first row, {columns["time_s"][0]:.3f} s')
        changes = changes - columns['time_s'][0]
        columns['time_s'] = columns['time_s'] - columns['time_s'][0]
    source = source_of(place, columns)
    time, channels = measured(place, columns, notes)
    if len(time) < FEWEST or not channels:
        raise UserError(f'{place.path}: expected at least {FEWEST} measured rows after the first command, got {len(time)}')
    if place.system == 'module':
        notes += slow_sampling(time)
    known = () if exact else tuple(changes[told].tolist())
    return Recording(name, place.system, time, channels, source, exact, tuple(notes), known)


def sampled_note(told: NDArray[np.bool_]) -> str:
    """What is said of changes of the command, of which some (or none) tell when they were."""
    if not told.any():
        return 'the command was sampled with the measurement: each change is uncertain within its interval'
    return f'{int((~told).sum())} of {len(told)} changes of the command were only sampled: uncertain within their interval'


def fill_inputs(place: Place, columns: dict[str, Vector], notes: list[str]) -> None:
    """Inputs without gaps: held values hold, strain runs on between its rows, what is not recorded is said."""
    rows = len(columns['time_s'])
    if 'J_W' in INPUT_COLUMNS[place.system] and 'J_W' not in columns:
        notes.append('J_W is not recorded: taken as 0')
        columns['J_W'] = np.zeros(rows)
    if 'T_E_K' not in columns or not np.isfinite(columns['T_E_K']).any():
        notes.append(f'T_E_K is not recorded: taken as {place.T_E:g} K')
        columns['T_E_K'] = np.full(rows, place.T_E)
    first = 0
    for name in INPUT_COLUMNS[place.system][1:]:
        values = columns[name]
        how = 'interpolated' if name == 'strain' else 'the value before holds'
        empty = int(np.isnan(values).sum())
        if name in ('strain', 'T_E_K'):
            take_out_spikes(name, columns['time_s'], values, how, notes)
        columns[name], unknown = held(values)
        if name == 'strain':
            columns[name] = between(columns['time_s'], values)
        if name == 'T_E_K' and unknown:
            columns[name][:unknown], unknown = columns[name][unknown], 0
        if empty > unknown:
            notes.append(f'{name}: {empty - unknown} rows without a value: {how}')
        first = max(first, unknown)
    leave_out_start(place, columns, first, notes)
    for name in INPUT_COLUMNS[place.system][1:]:
        check_unit(place.path, name, columns[name])
    if 'J_W' in columns and (columns['J_W'] < 0.0).any():
        notes.append(f'J_W: slightly negative values, {columns["J_W"].min():.3g} W at the least: taken as 0')
        columns['J_W'] = np.maximum(columns['J_W'], 0.0)


def take_out_spikes(name: str, time: Vector, values: Vector, how: str, notes: list[str]) -> None:
    """NaN for outliers in the values (k,), changed in place."""
    wrong = outliers(time, values)
    if wrong.any():
        notes.append(f'{name}: {int(wrong.sum())} outliers, the first at {time[np.argmax(wrong)]:.6g} s: {how}')
        values[wrong] = np.nan


def between(time: Vector, values: Vector) -> Vector:
    """Gaps (NaN) in values (k,) at time (k,) filled linearly, but not before the first."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    return np.interp(time, time[known], values[known])


def leave_out_start(place: Place, columns: dict[str, Vector], first: int, notes: list[str]) -> None:
    """Without a command nobody knows what the robot was told: leave out the rows before the first."""
    if first == 0:
        return
    if first >= len(columns['time_s']) - 1:
        raise UserError(f'{place.path}: expected a command before the last row, got {first} rows without one')
    notes.append(f'{first} rows before the first command: left out')
    for name in columns:
        columns[name] = columns[name][first:]


def merge_equal_times(columns: dict[str, Vector], notes: list[str]) -> None:
    """One row for each time: the last input, the first measured value of each channel."""
    starts = group_starts(columns['time_s'])
    if starts is None:
        return
    more = 0
    for name, values in columns.items():
        if name in CHANNEL_COLUMNS.values():
            columns[name], dropped = first_known(values, starts)
            more = max(more, dropped)
        else:
            columns[name] = last_of_groups(values, starts)
    if more:
        notes.append(f'{more} samples repeat the time of the one before: dropped')


def source_of(place: Place, columns: Mapping[str, Vector]) -> Input:
    """The input: all rows where strain runs on, else those that tell when something changed."""
    names = INPUT_COLUMNS[place.system][1:]
    keep: NDArray[np.bool_] | slice = slice(None)
    if place.system == 'module':
        keep = kept_rows([columns[name] for name in names])
    values = np.column_stack([columns[name][keep] for name in names])
    return Input(columns['time_s'][keep], values, tuple(name == 'strain' for name in names))


def measured(place: Place, columns: dict[str, Vector], notes: list[str]) -> tuple[Vector, dict[str, Vector]]:
    """Times and channels of the rows that hold a measurement, outliers taken out."""
    names = {CHANNEL_COLUMNS[channel]: channel for channel in CHANNELS_OF[place.system]}
    sampled = sampled_rows(place.system, columns)
    time = columns['time_s'][sampled] if not sampled.all() else columns['time_s']
    channels: dict[str, Vector] = {}
    for name, channel in names.items():
        values = columns.pop(name, np.empty(0))
        if not np.isfinite(values).any():
            continue
        channels[channel] = values = values[sampled] if not sampled.all() else values
        take_out_spikes(name, time, values, 'taken as missing', notes)
        check_unit(place.path, name, values)
    notes += gap_notes(time, channels) + rate_note(time, channels)
    missing = [channel for channel in CHANNELS_OF[place.system] if channel not in channels]
    if missing:
        notes.append(f'not measured: {", ".join(missing)}')
    return time, channels
