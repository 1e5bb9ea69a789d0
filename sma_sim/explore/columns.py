"""Which columns of foreign CSV files are which: what the page offers, guesses, and writes as a column map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import yaml

from sma_sim.evidence.data.column_map import ColumnMap, Origin, read_column_map
from sma_sim.evidence.data.foreign_columns import likely_column
from sma_sim.evidence.data.recording import NEEDED_COLUMNS
from sma_sim.evidence.data.rosbag.bag_files import is_bag
from sma_sim.evidence.data.sources import COLUMNS_BY_SYSTEM, recordings_in
from sma_sim.evidence.data.stated_units import UNITS, unit_of
from sma_sim.evidence.data.tables import read_header
from sma_sim.explore.request_values import number, text
from sma_sim.model.errors import UserError
from sma_sim.model.structures.discovery import known_structures
from sma_sim.workflow.data_request import DataRequest

MEANINGS = {
    'time': 'time',
    'J': 'electric power',
    'T_E': 'temperature of the surroundings',
    'T': 'temperature of wire',
    'F': 'force of bundle',
    'R': 'electrical resistance of wire',
    'stress': 'stress',
    'strain': 'strain',
}


def choices(request: DataRequest, system: str) -> dict[str, Any]:
    """The columns of the first CSV file among recordings, and for each of ours what was chosen, or a guess, for JSON.

    ``columns`` is empty where there is nothing to choose: bags have topics, and a map may say more. Raises UserError.
    """
    files = [file for path in request.data for file in recordings_in(path) if not is_bag(file)]
    mapping = read_column_map(request.map, COLUMNS_BY_SYSTEM) if request.map else ColumnMap()
    header = list(dict.fromkeys(name for name in read_header(files[0]) if name)) if files and is_simple(mapping) else []
    ours = []
    for name in dict.fromkeys(COLUMNS_BY_SYSTEM[system]):
        origin = mapping.origins.get(name)
        choice = guess(name, header) if origin is None else chosen(name, origin)
        about = {'name': name, 'meaning': meaning_of(name, system), 'needed': name in NEEDED_COLUMNS[system]}
        ours.append(about | {'units': list(UNITS[unit_of(name)])} | choice)
    return {'file': files[0].name if files else '', 'columns': header, 'ours': ours}


def meaning_of(name: str, system: str) -> str:
    """What one of our columns holds, in words."""
    structure = known_structures()[system]
    for one in structure.coordinates:
        if name == one.column and one.description:
            return one.description
    for drive in structure.drives:
        if name == drive.column and drive.description:
            return drive.description
    what, _, wire = name.removesuffix(f'_{unit_of(name)}').partition('_')
    return f'{MEANINGS.get("T_E" if name == "T_E_K" else what, what)} {wire if wire.isdigit() else ""}'.strip()


def is_simple(mapping: ColumnMap) -> bool:
    """Whether a map says no more than columns, units and factors."""
    plain = all(
        len(origin.columns) == 1
        and not origin.where
        and origin.pace is None
        and origin.exponent == 1.0
        and not any(origin.unknown)
        for origin in mapping.origins.values()
    )
    return plain and not any((mapping.tests, mapping.independent_after, mapping.nuisances, mapping.sheets, mapping.names))


def choice(column: str, unit: str, factor: float = 1.0) -> dict[str, Any]:
    """A choice for JSON: the values of the column are `factor` times the unit."""
    return {'column': column, 'unit': unit, 'factor': factor}


def chosen(name: str, origin: Origin) -> dict[str, Any]:
    """What a map says of one of our columns, as a unit and a factor."""
    units, column = UNITS[unit_of(name)], origin.column or ''
    for unit, (scale, offset) in units.items():
        if origin.offset == offset and (offset or origin.scale == scale):
            return choice(column, unit, origin.scale / scale)
    return choice(column, next(iter(units)), origin.scale)


def guess(name: str, header: Sequence[str]) -> dict[str, Any]:
    """The column of a file that is most likely one of ours; an empty name where none is like it, or in a known unit."""
    column, unit = likely_column(name, header)
    return choice(column, unit) if unit in UNITS[unit_of(name)] else choice('', unit_of(name))


def map_text(given: Any, request: DataRequest, system: str) -> str:
    """The choices of the page as a column map: by our name, ``column``, ``unit`` and ``factor``. Raises UserError."""
    offered = [one['name'] for one in choices(request, system)['ours']]
    if not isinstance(given, dict) or not set(given) <= set(offered):
        raise UserError(f'columns: expected choices for some of {", ".join(offered)}')
    if missing := [name for name in NEEDED_COLUMNS[system] if name not in given]:
        raise UserError(f'{missing[0]}: choose its column; {" and ".join(NEEDED_COLUMNS[system])} are required')
    lines = {name: line_of(name, entry) for name, entry in given.items()}
    content = yaml.safe_dump({'system': system} | lines, sort_keys=False, allow_unicode=True)
    return f'# Columns as they were chosen on the page of sma-sim explore.\n{content}'


def line_of(name: str, entry: Any) -> dict[str, Any]:
    """One choice as a line of a map. Raises UserError."""
    if not isinstance(entry, dict):
        raise UserError(f'{name}: expected a column, a unit and a factor')
    column, unit = text(entry.get('column'), f'{name}, column'), text(entry.get('unit'), f'{name}, unit')
    units, factor = UNITS[unit_of(name)], number(entry.get('factor', 1.0), f'{name}, factor')
    if unit not in units or factor == 0.0:
        raise UserError(f'{name}: expected one of the units {", ".join(units)} and a factor other than 0')
    scale, offset = units[unit]
    return {'column': column, 'scale': factor * scale, 'offset': offset}
