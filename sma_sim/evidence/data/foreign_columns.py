"""Columns of other people's tables: which of them is likely one of ours, and in which unit."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping, Sequence
from difflib import SequenceMatcher
from typing import Any

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
    'percent': '%',
    'degC': 'C',
    '°C': 'C',
    'celsius': 'C',
    'kelvin': 'K',
    'µm': 'um',
    'Ohm': 'ohm',
    'degrees': 'deg',
    'sec': 's',
    'second': 's',
    'seconds': 's',
    'min': 'min',
    'minutes': 'min',
    '°': 'deg',
    'watt': 'W',
    'Watt': 'W',
}
WORDS = {
    't': 'time',
    'temperature': 'T',
    'temp': 'T',
    'force': 'F',
    'load': 'F',
    'heating': 'J',
    'angle': 'alpha',
    'ambient': 'T_E',
    'room': 'T_E',
    't_ambient': 'T_E',
    't_room': 'T_E',
    't_e': 'T_E',
}
LIKE = 0.75  # of two names, from which on one is proposed for the other


def unit_of(name: str) -> str:
    """The unit of one of our columns."""
    unit = name.rpartition('_')[2]
    return unit if unit in UNITS else '-'


def likely_column(name: str, header: Sequence[str]) -> tuple[str, str]:
    """The column of a file that is most likely one of ours, and its unit; an empty name where none is like it."""
    units = UNITS[unit_of(name)]
    ours, stem = next(iter(units)), name.removesuffix(f'_{unit_of(name)}')
    if name in header:
        return name, ours
    found = [(likeness(stem, *stem_and_unit(column), units), column) for column in header]
    (like, unit), column = max(found, key=lambda one: one[0][0], default=((0.0, ''), ''))
    return (column, unit or ours) if like >= LIKE else ('', ours)


def hint_for(name: str, header: Sequence[str], own: Collection[str], with_map: bool) -> str:
    """What to do with a file that has no column of ours of this name, but one that may be it; `own`: names of ours.

    `with_map`: the command takes a map of columns.
    """
    column, unit = likely_column(name, [other for other in header if other not in own])
    if not column:
        return ''
    scale, offset = UNITS[unit_of(name)][unit]
    in_map = f'name it in a map: {map_line(name, column, unit)}'
    if (scale, offset) == (1.0, 0.0):
        return f' (rename {column}, or {in_map})' if with_map else f' (rename {column}; the unit is part of the name)'
    if with_map:
        return f' ({column} is in {unit}: {in_map})'
    how = f'multiplied by {scale:.10g}' if not offset else f'plus {offset:g}'
    return f' ({column} is in {unit}: expected {name}, which is {column} {how})'


def map_line(name: str, column: str, unit: str) -> str:
    """A line of a map that takes one of our columns from a foreign one in a unit."""
    scale, offset = UNITS[unit_of(name)][unit]
    number = f'scale: {scale:.10g}' if not offset else f'offset: {offset:g}'
    return f'{name}: {{column: {in_yaml(column)}, {number}}}'


def in_yaml(column: str) -> str:
    """The name of a column as a map has it."""
    return column if re.fullmatch(r'[\w%/.-]+', column) else json.dumps(column, ensure_ascii=False)


def hint_for_all(names: Sequence[str], header: Sequence[str], own: Collection[str]) -> str:
    """The lines of a map for several of our columns, as far as others are like them."""
    others = [other for other in header if other not in own]
    found = {name: likely_column(name, others) for name in names if name not in header}
    lines = [map_line(name, column, unit) for name, (column, unit) in found.items() if column]
    return f'; likely lines of a map: {"; ".join(lines)}' if lines else ''


def declared_unit(column: str) -> str:
    """The unit that a foreign column has in its name, apart from it by a bracket, a space or an underscore; empty: none."""
    unit = stem_and_unit(column)[1]
    return unit if re.search(r'[\s_\[(/][^\s_\[\]()/]+[\])]?$', column.strip()) else ''


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
