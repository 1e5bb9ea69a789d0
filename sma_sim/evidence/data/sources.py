"""Which files hold recordings, and the columns of one of them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sma_sim.evidence.data.assemble import NothingMeasuredError
from sma_sim.evidence.data.cells import CellLayout, read_cells, text_blocks
from sma_sim.evidence.data.column_map import ColumnMap, Origin, column_in_si, column_origins
from sma_sim.evidence.data.foreign_columns import hint_for, hint_for_all, likely_column
from sma_sim.evidence.data.own_times import at_own_times, check_blocks, check_other_clock, check_times
from sma_sim.evidence.data.recording import ESTIMATE_COLUMN, HIDDEN_COLUMN, NEEDED_COLUMNS, STD_SUFFIX, OfSystems
from sma_sim.evidence.data.rosbag.bag_files import is_bag
from sma_sim.evidence.data.rosbag.commands import CommandLimits
from sma_sim.evidence.data.rosbag.interface import interface_of, measured_decoders
from sma_sim.evidence.data.stated_units import in_yaml, stated_unit, unit_of
from sma_sim.evidence.data.table_format import COLUMNS, TableFormat, cells_of_line, is_number, is_sample, table_format
from sma_sim.evidence.data.table_units import check_stated_units
from sma_sim.evidence.data.tables import MAX_NAMES
from sma_sim.evidence.data.time_formats import counted_on, reader_of_column, without_clock_change, without_period
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.model.shown import listed
from sma_sim.model.structures.discovery import known_structures
from sma_sim.model.structures.structure import shared_temperature

REGULAR_ROWS = 'if no column holds the time and rows are regular, a map says so: time_s: {interval: SECONDS}'
MAX_UNNAMED = 6  # columns that a message numbers one by one
META_FILE = 'meta.json'
TABLE_SUFFIXES, TEXT_SUFFIXES = ('.csv', '.tsv', '.xlsx'), ('.txt', '.dat', '.lvm', '.asc')
COLUMNS_BY_SYSTEM = OfSystems(lambda structure: ('time_s', *structure.input_columns, *structure.channel_columns))
SAMPLE_IN_NAME = re.compile(r'(?:^|[\s:>])[-+]?\d*[.]\d+$')  # no name of a column ends so
Columns = dict[str, Vector]


def recordings_in(path: Path) -> list[Path]:
    """The recordings that a path stands for: itself, or all in a folder, by name. Raises UserError."""
    try:
        if is_bag(path) or not path.is_dir():
            return [path]
        found = sorted(entry for entry in path.iterdir() if is_table(entry) or is_bag(entry))
    except OSError as error:
        raise UserError(f'cannot read {path}: {error.strerror}') from error
    if not found:
        raise UserError(
            f'{path} holds no recording; expected CSV files (also .txt, .tsv, .xlsx), .mcap or .db3 files, or folders with '
            'metadata.yaml'
        )
    return found


def is_table(path: Path) -> bool:
    """Whether a file in a folder holds a table; text may also be notes of a person."""
    suffix = path.suffix.lower()
    if suffix in TEXT_SUFFIXES and path.is_file():
        try:
            written = table_format(path)
            block, _ = next(text_blocks(path, written), ('', True))
        except (UserError, OSError, UnicodeDecodeError):
            return False
        line = next((one for one in block.split('\n') if one.strip()), '')
        cells = cells_of_line(line, ',')
        return len(cells) == len(written.header) > 1 and any(is_number(cell) for cell in cells)
    return suffix in TABLE_SUFFIXES and not path.name.startswith('~$')  # which is how Excel marks a file that it has open


def read_source(
    path: Path, system: str, mapping: ColumnMap, namespace: str | None, limits: CommandLimits, sheet: str = ''
) -> tuple[Columns, list[str]]:
    """The columns (k,) of a file by the names of the file contract, and what was noted; `sheet`: that of a workbook.

    Raises UserError.
    """
    if is_bag(path):
        return read_bag_source(path, system, mapping, namespace, limits)
    return read_csv_source(path, system, mapping, sheet)


def read_bag_source(
    path: Path, system: str, mapping: ColumnMap, namespace: str | None, limits: CommandLimits
) -> tuple[Columns, list[str]]:
    """The columns of a bag."""
    from sma_sim.evidence.data.rosbag.reader import columns_of_bag, joints_in
    from sma_sim.evidence.data.rosbag.salvage import open_bag  # only here: tables need no library of bags

    bag = open_bag(path)
    notes = [] if bag.whole else ['the bag breaks off: read as far as it goes']
    found = columns_of_bag(bag, namespace, known_structures()[system], limits, notes)
    rows = len(found['time_s'])
    origins = column_origins(path, mapping, COLUMNS_BY_SYSTEM[system], list(found))
    if chosen := [name for name, entry in origins.items() if entry.where]:
        raise UserError(f'the map {mapping.path}, {chosen[0]}, where: bags have topics; only CSV files are long tables')
    columns = {name: column_in_si(entry, found, rows) for name, entry in origins.items()}
    structure = known_structures()[system]
    if not any(np.isfinite(columns[name]).any() for name in structure.channel_columns if name in columns):
        joints, got = ', '.join(interface_of(structure).joints), ', '.join(joints_in(bag, namespace))
        expected = (
            f'joint_states of the joints {joints}' if joints else ', '.join(measured_decoders(interface_of(structure)))
        )
        raise NothingMeasuredError(
            f'{path}: nothing measured in it; expected messages {expected}, got {got or "none"}; name them so where they '
            f'are published, or export the bag as CSV and name its columns in a map (--map)'
        )
    return columns | noise_of_rows(path, system, origins, found), notes


def read_csv_source(path: Path, system: str, mapping: ColumnMap, sheet: str = '') -> tuple[Columns, list[str]]:
    """The columns of a CSV file."""
    if not path.is_dir() and path.exists() and not path.is_file():
        raise UserError(f'{path} is no regular file: expected CSV or a bag')
    written = table_format(path, mapping.columns, sheet, mapping.names)
    header = written.header
    check_header(path, written)
    imposed = [drive.column for drive in known_structures()[system].drives]
    shared = {name: Origin(column) for name, column in shared_temperature(imposed, header).items()}
    origins = shared | column_origins(path, mapping, COLUMNS_BY_SYSTEM[system], header)
    check_complete(path, system, header, origins)
    check_clock(path, header, origins['time_s'])
    check_long_table(path, origins)
    needed = list(dict.fromkeys(column for entry in origins.values() for column in (*entry.columns, *dict(entry.where))))
    indices = [header.index(name) for name in needed]
    labels = row_labels(path, origins)
    conversions: dict[str, Callable[[str], float]] = {name: partial(label_index, known) for name, known in labels.items()}
    time = origins['time_s'].column
    reader = None if time is None else reader_of_column(path, written, header.index(time))
    notes = written.notes()
    in_units = {name: entry for name, entry in origins.items() if reader is None or name != 'time_s'}  # dates are in none
    notes += check_stated_units(path, written, in_units)
    if time is not None and reader is not None:
        if origins['time_s'].converts:
            raise UserError(f'{path}, column {time}: dates need no scale; name the column in the map alone: time_s: {time}')
        conversions |= dict.fromkeys([time, *(entry.time for entry in origins.values() if entry.time)], reader)
    layout = CellLayout(path, needed, indices, written, tolerant=True, conversions=conversions)
    cells, cut = read_cells(layout)
    check_doubled(layout, cells)
    notes += ['the last line is incomplete (cut, or without a line end): dropped'] if cut else []
    unused = [name for name in header if name and name not in needed and not HIDDEN_COLUMN.fullmatch(name)]
    if unused:
        notes.append(f'columns not used: {listed(unused, MAX_NAMES)}')
    if time is not None:
        notes += time_counted_on(path, cells[time], reader is not None)
        stated = reader is not None or time == 'time_s' or stated_unit('time_s', time, written.units)[0]
        if not stated and not origins['time_s'].converts and (np.diff(cells[time]) == 1.0).all():
            notes.append(
                f'{time} goes on by 1 from row to row, taken as 1 s: if it numbers the rows, a map says how long one lasts'
            )
    check_blocks(path, origins, cells, unused, partial(numbers_in, layout))
    if unused:
        check_times(path, origins, cells, unused, partial(numbers_in, layout))
        measured = known_structures()[system].channel_columns
        check_other_clock(path, origins, cells, unused, partial(numbers_in, layout), header, measured)
    rows = len(next(iter(cells.values())))
    users = [entry.column for entry in origins.values()]
    columns = {name: column_in_si(entry, cells, rows) for name, entry in origins.items()}
    columns |= noise_of_rows(path, system, origins, cells)
    if (period := without_period(columns['time_s'])) and time is not None:
        notes.append(f'time starts again after {period:g} s, as a clock without a date or a counter does: counted on')
    for name, entry in origins.items():
        for other, cell in entry.where:
            kept = cells[other] == labels[other].index(plain_label(cell))
            if not kept.any():
                raise UserError(f'{path}: no row has {other} {cell}, which the map {mapping.path} names for {name}')
            columns[name] = np.where(kept, columns[name], np.nan)
    for name, entry in origins.items():
        if users.count(entry.column) > 1 and columns[name] is cells.get(entry.column or ''):
            columns[name] = columns[name].copy()  # two columns of one origin must not share repairs
    return at_own_times(path, origins, cells, columns, known_structures()[system].channel_columns), notes


def noise_of_rows(path: Path, system: str, origins: Mapping[str, Origin], cells: Columns) -> Columns:
    """By column of the contract with `STD_SUFFIX`, the noise (k,) of its rows [SI], where a map names a column of it.

    Raises UserError for what is not measured, and for a noise that is not positive.
    """
    channels, found = known_structures()[system].channel_columns, Columns()
    for name, entry in origins.items():
        if (entry.std is not None or entry.relative_std) and name not in channels:
            raise UserError(f'{path}: std and relative_std belong to measured columns, {", ".join(channels)}, not to {name}')
        if entry.std is None:
            continue
        if (wrong := np.flatnonzero(cells[entry.std] <= 0.0)).size:
            value = cells[entry.std][wrong[0]]
            raise UserError(
                f'{path}, column {entry.std}: expected standard deviations above 0, or empty cells, got {value:g}'
            )
        found[name + STD_SUFFIX] = abs(entry.scale) * cells[entry.std]
    return found


def time_counted_on(path: Path, values: Vector, is_clock: bool) -> list[str]:
    """Count on in place where the counter or the clock of a file (k,) does not go on, and say so. Raises UserError."""
    if is_clock:
        return ['the clock is set by an hour, as in spring or autumn: counted on'] if without_clock_change(values) else []
    bits = counted_on(path, values)
    if bits:
        return [f'the {bits}-bit counter of time starts again at 0: counted on']
    return []


def check_doubled(layout: CellLayout, cells: Mapping[str, Vector]) -> None:
    """Raise UserError where a file has a column more than once, with other numbers."""
    header = layout.format.header
    for name in layout.names:
        for index in (k for k, other in enumerate(header) if other == name and k != header.index(name)):
            if not is_column(layout, name, index, cells[name]):
                raise UserError(f'{layout.path} has column {name} more than once, with different cells: rename all but one')


def is_column(layout: CellLayout, name: str, index: int, values: Vector) -> bool:
    """Whether the column at an index has these values (k,)."""
    found = numbers_in(layout, name, index)
    return found is not None and np.array_equal(found, values, equal_nan=True)


def numbers_in(layout: CellLayout, name: str, index: int | None = None) -> Vector | None:
    """The column of a name, or at an index, (k,); None where it holds something else than numbers."""
    at = layout.format.header.index(name) if index is None else index
    try:
        return read_cells(replace(layout, names=[name], indices=[at]))[0][name]
    except UserError:
        return None


def check_header(path: Path, written: TableFormat) -> None:
    """Raise UserError for a file without names, and NothingMeasuredError for one of estimates."""
    header = written.header
    if is_sample(header, len(header), written.separator):
        raise UserError(
            f'{path}, row {written.lines_before}: expected the names of the columns, got numbers: {", ".join(header)[:60]}; '
            f'write the names of the columns above them, or {names_in_map(len(header))}'
        )
    if estimated := [name for name in header if ESTIMATE_COLUMN.fullmatch(name)]:
        raise NothingMeasuredError(
            f'{path}: nothing measured in it; column {estimated[0]} says that sma-sim observe estimated its temperatures '
            'and stresses; expected the recording itself'
        )


def names_in_map(count: int = 0) -> str:
    """How a map names the columns of a table without a header, where they are known to be so many."""
    names = [f'NAME_{k}' for k in range(1, count + 1)] if 0 < count <= MAX_UNNAMED else ['NAME_1', 'NAME_2', '...']
    return f'in a map (--map), from left to right: {COLUMNS}: [{", ".join(names)}]'


def check_clock(path: Path, header: Sequence[str], time: Origin) -> None:
    """Raise UserError where a stamp has two columns, seconds and nanoseconds, and only one is taken."""
    found = re.fullmatch(r'(.*?)(n(?:ano)?)?(secs?)', time.column or '')
    if found is None or time.nanosec is not None:
        return
    stem = found.group(1)
    halves = [name for name in header if re.fullmatch(re.escape(stem) + '(n(?:ano)?)?secs?', name)]
    whole = [name for name in halves if re.fullmatch(re.escape(stem) + 'secs?', name)]
    if len(halves) == 2 and len(whole) == 1:
        (rest,) = set(halves) - set(whole)
        raise UserError(
            f'{path}: time is in two columns, {whole[0]} and {rest}, of which only {time.column} is taken; '
            f'say in a map: time_s: {{column: {whole[0]}, nanosec: {rest}}}'
        )


def check_long_table(path: Path, origins: Mapping[str, Origin]) -> None:
    """Raise UserError where one column of a file is taken for two quantities: in a long table, rows tell them apart."""
    taken: dict[tuple[Any, ...], str] = {}
    for name, entry in origins.items():
        other = taken.setdefault((entry.column, entry.where, entry.times, entry.exponent, entry.pace), name)
        if entry.column is not None and unit_of(other) != unit_of(name):
            raise UserError(
                f'{path}, column {entry.column}: taken for {other} and for {name}, expected one of them; in a long table a '
                f'map says which rows hold which: {name}: {{column: {in_yaml(entry.column)}, where: {{COLUMN: CELL}}}}'
            )


def row_labels(path: Path, origins: Mapping[str, Origin]) -> dict[str, list[str]]:
    """By column that tells the rows of a long table apart, the cells that the map names. Raises UserError."""
    labels: dict[str, list[str]] = {}
    for name, entry in origins.items():
        for column, cell in entry.where:
            if any(column in one.columns for one in origins.values()):
                raise UserError(f'{path}, column {column}: tells the rows of {name} apart, and is taken as numbers too')
            labels.setdefault(column, []).append(plain_label(cell))
    return labels


def label_index(labels: Sequence[str], cell: str) -> float:
    """Which of the labels a cell is, NaN for another."""
    label = plain_label(cell)
    return float(labels.index(label)) if label in labels else float('nan')


def plain_label(cell: str) -> str:
    """A cell as it is compared: 1.0 is 1."""
    return f'{float(cell):.17g}' if is_number(cell) else cell.strip()


def check_complete(path: Path, system: str, header: Sequence[str], origins: Mapping[str, Any]) -> None:
    """Raise UserError where time or command is missing."""
    missing = [name for name in NEEDED_COLUMNS[system] if name not in origins]
    if not missing:
        check_measured(path, system, header, origins)
        return
    hint = ''
    known = known_structures()
    others = [
        other
        for other, names in NEEDED_COLUMNS.items()
        if other != system and known[other].has_own_columns and set(names) <= set(header)
    ]
    if others:
        other = max(others, key=lambda name: len(set(COLUMNS_BY_SYSTEM[name]) & set(header)))
        hint = f' (it has {NEEDED_COLUMNS[other][1]}: is it the recording of a {other}? say --system {other})'
    hint = hint or hint_for(missing[0], header, COLUMNS_BY_SYSTEM[system], with_map=True)
    rest = [] if others else [*missing[1:], *optional_columns(system, origins)]
    more = hint_for_all(rest, header, COLUMNS_BY_SYSTEM[system])
    if not hint and any(SAMPLE_IN_NAME.search(name) for name in header):
        hint = ' (its first row looks like samples: write the names of the columns above them)'
    if not hint and not header[0]:
        hint = f' (its first column has no name: write {missing[0]} above it if that is what it holds)'
    if not hint and sum(map(bool, header)) == 1:
        hint = f' (if no line has the names of the columns, write them above the numbers, or {names_in_map()})'
    columns = listed((name or '(no name)' for name in header), MAX_NAMES)
    hint = hint or ' (a map, --map, says which column is which)'
    more += f'; {REGULAR_ROWS}' if 'time_s' in missing and not likely_column('time_s', header)[0] else ''
    raise UserError(f'{path} has no column {", ".join(missing)}{hint}{more}; its columns are {columns}')


def check_measured(path: Path, system: str, header: Sequence[str], origins: Mapping[str, Any]) -> None:
    """Raise NothingMeasuredError where no measured column is there, but some that may be."""
    channels = known_structures()[system].channel_columns
    lines = '' if any(name in origins for name in channels) else hint_for_all(channels, header, COLUMNS_BY_SYSTEM[system])
    if lines:
        raise NothingMeasuredError(
            f'{path}: nothing measured in it; expected some of the columns {", ".join(channels)}{lines}'
        )


def optional_columns(system: str, origins: Mapping[str, Any]) -> list[str]:
    """Inputs that may be left out, and the measured columns where a file has none of them."""
    structure = known_structures()[system]
    inputs = [name for name in structure.input_columns if name not in (*origins, *NEEDED_COLUMNS[system])]
    measured = any(name in origins for name in structure.channel_columns)
    return inputs if measured else [*inputs, *structure.channel_columns]


def read_noise_file(folder: Path, channels: Sequence[str]) -> dict[str, float]:
    """`noise_std` of the folder's meta.json by channel, empty where there is none. Raises UserError."""
    path = folder / META_FILE
    if not path.is_file():
        return {}
    try:
        meta = json.loads(path.read_text(encoding='utf-8-sig'))
    except OSError as error:
        raise UserError(f'cannot read {path}: {error.strerror}') from error
    except (ValueError, RecursionError) as error:
        raise UserError(f'{path} is not JSON: {error}') from error
    given = meta.get('noise_std', {}) if isinstance(meta, dict) else None
    if not isinstance(given, dict):
        raise UserError(f'{path}: expected {{"noise_std": {{"alpha": 0.0003}}}}')
    return checked_noise(given.items(), f'{path}, noise_std', channels)


def checked_noise(given: Iterable[tuple[str, Any]], where: str, channels: Sequence[str]) -> dict[str, float]:
    """Noise by channel; the case of the names does not matter. Raises UserError."""
    names = {channel.lower(): channel for channel in channels}
    checked = {}
    for name, value in given:
        if str(name).lower() not in names:
            raise UserError(f'{where}: unknown channel {name}; expected some of {", ".join(channels)}')
        good = isinstance(value, int | float) and not isinstance(value, bool) and 0.0 < value < float('inf')
        if not good:
            raise UserError(f'{where}, {name}: expected a positive standard deviation in SI units, got {value!r}')
        checked[names[name.lower()]] = float(value)
    return checked
