"""Units that a table states, in the name of a column or in a row of units, and what converts them to ours."""

from __future__ import annotations

import json
import math
import re
import unicodedata
from collections.abc import Mapping

import yaml

# By the unit of our column: the units in which people record it, each with scale and offset to ours.
UNITS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    's': {
        's': (1.0, 0.0),
        'ms': (1e-3, 0.0),
        'us': (1e-6, 0.0),
        'ns': (1e-9, 0.0),
        'min': (60.0, 0.0),
        'h': (3600.0, 0.0),
        'd': (86400.0, 0.0),
    },
    'm': {
        'm': (1.0, 0.0),
        'mm': (1e-3, 0.0),
        'cm': (1e-2, 0.0),
        'um': (1e-6, 0.0),
        'nm': (1e-9, 0.0),
        'in': (0.0254, 0.0),
        'mil': (2.54e-5, 0.0),
    },
    'rad': {
        'rad': (1.0, 0.0),
        'deg': (0.017453292519943295, 0.0),
        'mrad': (1e-3, 0.0),
        'rev': (2.0 * math.pi, 0.0),
        'gon': (math.pi / 200.0, 0.0),
    },
    'N': {
        'N': (1.0, 0.0),
        'mN': (1e-3, 0.0),
        'cN': (1e-2, 0.0),
        'kN': (1e3, 0.0),
        'g': (9.80665e-3, 0.0),
        'kg': (9.80665, 0.0),
        'lbf': (4.4482216152605, 0.0),
    },
    'K': {'K': (1.0, 0.0), 'C': (1.0, 273.15), 'F': (5.0 / 9.0, 459.67 * 5.0 / 9.0), 'mK': (1e-3, 0.0)},
    'W': {'W': (1.0, 0.0), 'mW': (1e-3, 0.0), 'kW': (1e3, 0.0)},
    'Pa': {
        'Pa': (1.0, 0.0),
        'kPa': (1e3, 0.0),
        'MPa': (1e6, 0.0),
        'GPa': (1e9, 0.0),
        'bar': (1e5, 0.0),
        'psi': (6894.757293168361, 0.0),
        'ksi': (6894757.293168361, 0.0),
    },
    'ohm': {'ohm': (1.0, 0.0), 'mohm': (1e-3, 0.0), 'kohm': (1e3, 0.0)},
    '-': {'-': (1.0, 0.0), '%': (1e-2, 0.0), '‰': (1e-3, 0.0), 'ue': (1e-6, 0.0)},
}
VOLTS, AMPERES = {'V': 1.0, 'mV': 1e-3, 'kV': 1e3}, {'A': 1.0, 'mA': 1e-3}  # units of what a power is the product of
SCALES = {unit: scale for units in UNITS.values() for unit, (scale, _) in units.items()} | VOLTS | AMPERES
SPELLINGS = {  # in small letters
    'percent': '%',
    'pct': '%',
    'mm/mm': '-',
    'm/m': '-',
    'in/in': '-',
    'microstrain': 'ue',
    'ustrain': 'ue',
    'uε': 'ue',
    'degc': 'C',
    '°c': 'C',
    'celsius': 'C',
    'degf': 'F',
    '°f': 'F',
    'fahrenheit': 'F',
    'kelvin': 'K',
    'inch': 'in',
    'inches': 'in',
    'meter': 'm',
    'meters': 'm',
    'metres': 'm',
    'millimeter': 'mm',
    'millimeters': 'mm',
    'millimetres': 'mm',
    'micron': 'um',
    'microns': 'um',
    '°': 'deg',
    'degree': 'deg',
    'degrees': 'deg',
    'radian': 'rad',
    'radians': 'rad',
    'turn': 'rev',
    'turns': 'rev',
    'revolutions': 'rev',
    'grad': 'gon',
    'sec': 's',
    'secs': 's',
    'second': 's',
    'seconds': 's',
    'sekunden': 's',
    'msec': 'ms',
    'millis': 'ms',
    'milliseconds': 'ms',
    'usec': 'us',
    'micros': 'us',
    'microseconds': 'us',
    'nsec': 'ns',
    'nanoseconds': 'ns',
    'minutes': 'min',
    'hour': 'h',
    'hours': 'h',
    'hr': 'h',
    'days': 'd',
    'newton': 'N',
    'newtons': 'N',
    'gf': 'g',
    'grams': 'g',
    'kgf': 'kg',
    'lb': 'lbf',
    'lbs': 'lbf',
    'watt': 'W',
    'watts': 'W',
    'pascal': 'Pa',
    'n/mm2': 'MPa',
    'n/mm^2': 'MPa',
    'ω': 'ohm',
    'mω': 'mohm',
    'kω': 'kohm',
    'volt': 'V',
    'volts': 'V',
    'vdc': 'V',
    'ampere': 'A',
    'amperes': 'A',
    'amps': 'A',
}
BY_SMALL_LETTERS = {unit.lower(): unit for unit in reversed(list(SCALES))}  # of a unit in wrong capitals, such as MM
# Ends of names that are units, and as well say which wire, which place, or which of several values a column holds.
LABELS = frozenset(['A', 'C', 'F', 'K', 'N', 'W', 'd', 'g', 'h', 'm', 's', 'in', 'min', 'bar', 'psi', 'rad', 'rev', '-'])
# Ends of names of numbers that are in no unit.
NUMBERS = frozenset(['raw', 'adc', 'count', 'counts', 'tick', 'ticks', 'duty', 'pwm', 'px', 'pixel', 'pixels'])
BRACKETS = re.compile(r'[\[({]([^\[\](){}]*)[\])}]')


def unit_of(name: str) -> str:
    """The unit of one of our columns."""
    unit = name.rpartition('_')[2]
    return unit if unit in UNITS else '-'


def known_unit(word: str, loosely: bool = False) -> str:
    """A unit as we write it, empty where it is none that is known; `loosely`: in wrong capitals too."""
    plain = re.sub(r'\s', '', unicodedata.normalize('NFKC', word).replace('μ', 'u'))
    if plain in SCALES:
        return plain
    found = SPELLINGS.get(plain.lower(), '')
    return found or (BY_SMALL_LETTERS.get(plain.lower(), '') if loosely else '')


def stem_and_unit(column: str) -> tuple[str, str, bool]:
    """A foreign column without its unit, the unit, empty where it has none, and whether that can be nothing else.

    What stands in brackets at the end is a unit, known or not, unless it is a number or several words.
    """
    brackets = list(BRACKETS.finditer(column))
    known = [one for one in brackets if known_unit(one[1], loosely=True)]
    last = brackets[-1:] if brackets and brackets[-1].end() == len(column.rstrip()) else []
    for one in [*known[-1:], *last]:
        word = one[1].strip()
        unit = known_unit(word, loosely=True) or ('' if word.isdigit() or ' ' in word else word)
        if unit:
            return column[: one.start()].rstrip(' _/'), unit, True
    for apart in (r'\s_,', r'\s_,/'):
        found = re.fullmatch(rf'(.+?)[{apart}]+([^{apart}]+)', column.strip())
        stem, word = found.groups() if found else (column, '')
        if unit := known_unit(word) or (word if word.lower() in NUMBERS else ''):
            return stem, unit, unit not in LABELS
    return column, '', False


def unit_in_name(name: str, column: str) -> str:
    """The unit that a foreign column has in its name, or for a name, taken for one of ours; empty where it states none."""
    ours, (_, unit, certain) = unit_of(name), stem_and_unit(column)
    unit = unit or known_unit(column)
    return unit if certain or unit in UNITS[ours] or (ours, unit) == ('W', 'A') else ''


def stated_unit(name: str, column: str, row: Mapping[str, str]) -> tuple[str, str]:
    """The unit that a table states of a column that is taken for one of ours, and where; empty where it states none.

    `row`: the row of units, by column.
    """
    if unit := unit_in_row(column, row):
        return unit, 'the row of units'
    return ('' if column == name else unit_in_name(name, column)), 'its name'


def stated_factor(column: str, row: Mapping[str, str]) -> tuple[str, str]:
    """The unit that a table states of a column that is multiplied by another, and where; empty where it states none."""
    if unit := unit_in_row(column, row):
        return unit, 'the row of units'
    _, unit, certain = stem_and_unit(column)
    return (unit if certain or unit == 'A' else ''), f'the name of {column}'


def unit_in_row(column: str, row: Mapping[str, str]) -> str:
    """The unit that a row of units, by column, has of a column; empty where it has none."""
    given = row.get(column, '')
    return '' if given in ('', '1', '-') else known_unit(given, loosely=True) or given


def conversion(name: str, unit: str) -> str:
    """What a map says beside a column to convert it from a unit to that of one of ours."""
    scale, offset = UNITS[unit_of(name)].get(unit, (None, 0.0))
    if scale is None:
        return 'scale: WATTS_AT_1_PERCENT' if (unit_of(name), unit) == ('W', '%') else 'scale: FACTOR'
    if offset:
        return f'scale: {scale:.10g}, offset: {offset:.10g}' if scale != 1.0 else f'offset: {offset:g}'
    return f'scale: {scale:.10g}'


def map_line(name: str, column: str, unit: str) -> str:
    """A line of a map that takes one of our columns from a foreign one in a unit, known or not."""
    return f'{name}: {{column: {in_yaml(column)}, {conversion(name, unit)}}}'


def product_line(name: str, column: str, times: str, scale: float | None, exponent: float = 1.0) -> str:
    """A line of a map that takes one of our columns from two foreign ones; `scale`: None where nobody knows it."""
    power = '' if exponent == 1.0 else f', exponent: {exponent:g}'
    number = '' if scale == 1.0 else f', scale: {"FACTOR" if scale is None else format(scale, ".10g")}'
    return f'{name}: {{column: {in_yaml(column)}{power}, times: {in_yaml(times)}{number}}}'


def in_yaml(column: str) -> str:
    """The name of a column as a map has it: in quotes where YAML would read something else."""
    try:
        plain = yaml.safe_load(f'[{column}]') == [column]
    except (yaml.YAMLError, ValueError):
        plain = False
    return column if plain else json.dumps(column, ensure_ascii=False)
