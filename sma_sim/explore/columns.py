"""Which columns of foreign CSV files are which: what the page offers, guesses, and writes as a column map."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from difflib import SequenceMatcher
from typing import Any

import yaml

from sma_sim.evidence.data.column_map import ColumnMap, Origin, read_column_map
from sma_sim.evidence.data.recording import NEEDED_COLUMNS
from sma_sim.evidence.data.rosbag.raw_messages import is_bag
from sma_sim.evidence.data.sources import COLUMNS_BY_SYSTEM, recordings_in
from sma_sim.evidence.data.tables import read_header
from sma_sim.explore.request_values import number, text
from sma_sim.model.errors import UserError
from sma_sim.model.structures.discovery import known_structures
from sma_sim.workflow.data_request import DataRequest

# By the unit of our column: the units in which people record it, each with scale and offset to ours.
UNITS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    's': {'s': (1.0, 0.0), 'ms': (1e-3, 0.0), 'us': (1e-6, 0.0), 'min': (60.0, 0.0)},
    'm': {'m': (1.0, 0.0), 'mm': (1e-3, 0.0), 'cm': (1e-2, 0.0), 'um': (1e-6, 0.0)},
    'rad': {'rad': (1.0, 0.0), 'deg': (0.017453292519943295, 0.0), 'mrad': (1e-3, 0.0)},
    'N': {'N': (1.0, 0.0), 'mN': (1e-3, 0.0), 'kN': (1e3, 0.0), 'g': (9.80665e-3, 0.0), 'kg': (9.80665, 0.0)},
    'K': {'K': (1.0, 0.0), 'C': (1.0, 273.15)},
    'W': {'W': (1.0, 0.0), 'mW': (1e-3, 0.0)},
    'Pa': {'Pa': (1.0, 0.0), 'kPa': (1e3, 0.0), 'MPa': (1e6, 0.0), 'GPa': (1e9, 0.0)},
    'ohm': {'ohm': (1.0, 0.0), 'mohm': (1e-3, 0.0)},
    '-': {'-': (1.0, 0.0), '%': (1e-2, 0.0)},
}
SPELLINGS = {
    'percent': '%', 'degC': 'C', '°C': 'C', 'celsius': 'C', 'kelvin': 'K', 'µm': 'um', 'Ohm': 'ohm', 'degrees': 'deg',
    'sec': 's', 'seconds': 's', 'min': 'min', 'minutes': 'min', '°': 'deg',
}  # fmt: skip
WORDS = {
    't': 'time', 'temperature': 'T', 'temp': 'T', 'force': 'F', 'load': 'F', 'heating': 'J', 'angle': 'alpha',
    'ambient': 'T_E', 'room': 'T_E', 't_ambient': 'T_E', 't_room': 'T_E', 't_e': 'T_E',
}  # fmt: skip
MEANINGS = {
    'time': 'time', 'J': 'electric power', 'T_E': 'temperature of the surroundings', 'T': 'temperature of wire',
    'F': 'force of bundle', 'R': 'electrical resistance of wire', 'stress': 'stress', 'strain': 'strain',
}  # fmt: skip
LIKE = 0.75  # of two names, from which on one is proposed for the other


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
        origin.column and origin.pace is None and origin.exponent == 1.0 and not any(origin.unknown)
        for origin in mapping.origins.values()
    )
    return plain and not (mapping.tests or mapping.independent_after or mapping.nuisances)


def unit_of(name: str) -> str:
    """The unit of one of our columns."""
    unit = name.rpartition('_')[2]
    return unit if unit in UNITS else '-'


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
    """The column of a file that is most likely one of ours; an empty name where none is like it."""
    units = UNITS[unit_of(name)]
    ours, stem = next(iter(units)), name.removesuffix(f'_{unit_of(name)}')
    if name in header:
        return choice(name, ours)
    found = [(likeness(stem, *stem_and_unit(column), units), column) for column in header]
    (like, unit), column = max(found, key=lambda one: one[0][0], default=((0.0, ''), ''))
    return choice(column, unit or ours) if like >= LIKE else choice('', ours)


def stem_and_unit(column: str) -> tuple[str, str]:
    """A foreign column without its unit, and the unit, empty where it has none."""
    found = re.fullmatch(r'(.+?)[\s_]*[\[(/]?\s*([^\s_\[\]()/]+)[\])]?', column.strip())
    if found is None:
        return column, ''
    unit = SPELLINGS.get(found.group(2), found.group(2))
    return (found.group(1), unit) if any(unit in units for units in UNITS.values()) else (column, '')


def likeness(stem: str, other: str, unit: str, units: Mapping[str, Any]) -> tuple[float, str]:
    """How alike two names are, 0 to 1, and the unit; 0 for a unit of something else."""
    if unit and unit not in units:
        return 0.0, ''
    ways = ((stem, other), (usual(stem), usual(other)))
    plain = [[re.sub(r'[\W_]+', '', word).lower() for word in pair] for pair in ways]
    return max(SequenceMatcher(None, one, two).ratio() for one, two in plain), unit


def usual(word: str) -> str:
    """A name as we write it, where people have another word for it, perhaps with the number of a wire behind it."""
    found = re.fullmatch(r'(.*?)[\s_]*(\d*)', word)
    name, wire = found.groups() if found else (word, '')
    if 'power' in name.lower() or name == 'J_eq':
        return 'J' + wire
    return WORDS.get(name if len(name) == 1 else name.lower(), name) + wire


def map_text(given: Any, request: DataRequest, system: str) -> str:
    """The choices of the page as a column map: by our name, ``column``, ``unit`` and ``factor``. Raises UserError."""
    offered = [one['name'] for one in choices(request, system)['ours']]
    if not isinstance(given, dict) or not set(given) <= set(offered):
        raise UserError(f'columns: expected choices for some of {", ".join(offered)}')
    if missing := [name for name in NEEDED_COLUMNS[system] if name not in given]:
        raise UserError(f'{missing[0]}: choose its column; {" and ".join(NEEDED_COLUMNS[system])} are a must')
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
