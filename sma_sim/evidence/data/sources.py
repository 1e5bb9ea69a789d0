"""Which files hold recordings, and the columns of one of them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from sma_sim.evidence.data.cells import CellLayout, Vector, read_cells
from sma_sim.evidence.data.column_map import ColumnMap, column_in_si, column_origins
from sma_sim.evidence.data.foreign_columns import hint_for
from sma_sim.evidence.data.recording import HIDDEN_COLUMN, NEEDED_COLUMNS, OfSystems
from sma_sim.evidence.data.rosbag.commands import CommandLimits
from sma_sim.evidence.data.rosbag.raw_messages import is_bag, open_bag
from sma_sim.evidence.data.rosbag.reader import read_bag
from sma_sim.evidence.data.tables import listed, read_header
from sma_sim.model.errors import UserError
from sma_sim.model.structures.discovery import known_structures

META_FILE = 'meta.json'
COLUMNS_BY_SYSTEM = OfSystems(lambda structure: ('time_s', *structure.input_columns, *structure.channel_columns))
Columns = dict[str, Vector]


def recordings_in(path: Path) -> list[Path]:
    """The recordings that a path stands for: itself, or all in a folder, by name. Raises UserError."""
    try:
        if is_bag(path) or not path.is_dir():
            return [path]
        found = sorted(entry for entry in path.iterdir() if entry.suffix.lower() == '.csv' or is_bag(entry))
    except OSError as error:
        raise UserError(f'cannot read {path}: {error.strerror}') from error
    if not found:
        raise UserError(f'{path} holds no recording; expected CSV files, .mcap or .db3 files, or folders with metadata.yaml')
    return found


def read_source(
    path: Path, system: str, mapping: ColumnMap, namespace: str | None, limits: CommandLimits
) -> tuple[Columns, list[str]]:
    """The columns (k,) of a file by the names of the file contract, and what was noted. Raises UserError."""
    if is_bag(path):
        return read_bag_source(path, system, mapping, namespace, limits)
    return read_csv_source(path, system, mapping)


def read_bag_source(
    path: Path, system: str, mapping: ColumnMap, namespace: str | None, limits: CommandLimits
) -> tuple[Columns, list[str]]:
    """The columns of a bag."""
    notes = [] if open_bag(path).whole else ['the bag breaks off: read as far as it goes']
    found = read_bag(path, namespace, known_structures()[system], limits, notes)
    rows = len(found['time_s'])
    origins = column_origins(path, mapping, COLUMNS_BY_SYSTEM[system], list(found))
    return {name: column_in_si(entry, found, rows) for name, entry in origins.items()}, notes


def read_csv_source(path: Path, system: str, mapping: ColumnMap) -> tuple[Columns, list[str]]:
    """The columns of a CSV file."""
    if not path.is_dir() and path.exists() and not path.is_file():
        raise UserError(f'{path} is no regular file: expected CSV or a bag')
    header = read_header(path)
    check_header(path, header)
    origins = column_origins(path, mapping, COLUMNS_BY_SYSTEM[system], header)
    check_complete(path, system, header, origins)
    needed = list(dict.fromkeys(entry.column for entry in origins.values() if entry.column is not None))
    doubled = [name for name in needed if header.count(name) > 1]
    if doubled:
        raise UserError(f'{path} has column {doubled[0]} more than once')
    indices = [header.index(name) for name in needed]
    cells, cut = read_cells(CellLayout(path, needed, indices, len(header), tolerant=True))
    notes = ['the last line is incomplete (cut, or without a line end): dropped'] if cut else []
    unused = [name for name in header if name and name not in needed and not HIDDEN_COLUMN.fullmatch(name)]
    if unused:
        notes.append(f'columns not used: {listed(unused)}')
    rows = len(next(iter(cells.values())))
    users = [entry.column for entry in origins.values()]
    columns = {name: column_in_si(entry, cells, rows) for name, entry in origins.items()}
    for name, entry in origins.items():
        if users.count(entry.column) > 1 and columns[name] is cells.get(entry.column or ''):
            columns[name] = columns[name].copy()  # two columns of one origin must not share repairs
    return columns, notes


def check_header(path: Path, header: Sequence[str]) -> None:
    """Raise UserError for separators other than commas, and for a file without names."""
    line = ','.join(header)
    for sign, word in ((';', 'semicolons'), ('\t', 'tabs'), ('|', 'bars')):
        if line.count(sign) > line.count(','):
            raise UserError(
                f'{path}, row 1: the cells are separated by {word}; expected commas between cells and points in decimals'
            )
    if all(is_number(name) for name in header):
        raise UserError(f'{path}, row 1: expected the names of the columns, got numbers: {line[:60]}')


def is_number(cell: str) -> bool:
    """Whether a cell reads as a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def check_complete(path: Path, system: str, header: Sequence[str], origins: Mapping[str, Any]) -> None:
    """Raise UserError where time or command is missing."""
    missing = [name for name in NEEDED_COLUMNS[system] if name not in origins]
    if not missing:
        return
    hint = ''
    others = [other for other, names in NEEDED_COLUMNS.items() if other != system and set(names) <= set(header)]
    if others:
        other = max(others, key=lambda name: len(set(COLUMNS_BY_SYSTEM[name]) & set(header)))
        hint = f' (it has {NEEDED_COLUMNS[other][1]}: is it the recording of a {other}? say --system {other})'
    hint = hint or hint_for(missing[0], header, COLUMNS_BY_SYSTEM[system], with_map=True)
    raise UserError(f'{path} has no column {", ".join(missing)}{hint}; its columns are {listed(header)}')


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
