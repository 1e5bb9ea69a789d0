"""Columns of other people's tables: which of them is likely one of ours, and in which unit."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from difflib import SequenceMatcher

from sma_sim.evidence.data.stated_units import (
    AMPERES,
    NUMBERS,
    SCALES,
    UNITS,
    VOLTS,
    map_line,
    product_line,
    stem_and_unit,
    unit_of,
)

WORDS = {
    't': 'time',
    'timestamp': 'time',
    'x_value': 'time',  # LabVIEW
    'P': 'J',
    'power': 'J',
    'heating': 'J',
    'heater': 'J',
    'j_eq': 'J',
    'temperature': 'T',
    'temp': 'T',
    'force': 'F',
    'load': 'F',
    'angle': 'alpha',
    'x': 'position',
    'pos': 'position',
    'stroke': 'position',
    'displacement': 'position',
    't_e': 'T_E',
}
AMBIENT = frozenset(['ambient', 'amb', 'room', 'air'])
# Words that a name may have beside that of a quantity, and those that make it a column of something else.
BESIDE = frozenset(['wire', 'sma', 'electric', 'electrical', 'heating', 'heater', 'input', 'measured', 'sensor', 'cell'])
OTHERS = frozenset(
    ['limit', 'max', 'min', 'set', 'setpoint', 'target', 'desired', 'reference', 'ref', 'nominal', 'fan', 'supply']
)
DUTY = frozenset(['pwm', 'duty'])  # words for the part of its full power that a driver gives
SYMBOL = re.compile(r'[A-Za-z]\d*')  # a name in which capitals tell time from temperature
LIKE = 0.75  # of two names, from which on one is proposed for the other


def likely_column(name: str, header: Sequence[str]) -> tuple[str, str]:
    """The column of a file that is most likely one of ours, and its unit; an empty name where none is like it."""
    ours = unit_of(name)
    if same := [column for column in header if column == name] or [one for one in header if one.lower() == name.lower()]:
        return same[0], ours
    found = [(likeness(name, column), column) for column in header]
    like, column = max(found, key=lambda one: one[0], default=(0.0, ''))
    if like >= LIKE:
        return column, stem_and_unit(column)[1] or ours
    return ('', ours) if product_of_two(name, header) else duty_column(name, header)


def likely_line(name: str, header: Sequence[str]) -> str:
    """The line of a map that takes one of our columns from what is likely it; empty where nothing is."""
    column, unit = likely_column(name, header)
    return map_line(name, column, unit) if column else product_of_two(name, header)


def product_of_two(name: str, header: Sequence[str]) -> str:
    """The line of a map that takes a power from a voltage and a current; empty where not both are there once."""
    factors = [own_factors(header, units) for units in (VOLTS, AMPERES)]
    if unit_of(name) != 'W' or any(len(columns) != 1 for columns in factors):
        return ''
    (voltage,), (current,) = factors
    scale = SCALES[stem_and_unit(voltage)[1]] * SCALES[stem_and_unit(current)[1]]
    return product_line(name, voltage, current, scale)


def duty_column(name: str, header: Sequence[str]) -> tuple[str, str]:
    """The only duty cycle that a power may be made of, and its unit; an empty name where there is none, or several."""
    ours, found = unit_of(name), list[tuple[str, str]]()
    for column in header if ours == 'W' else ():
        stem, unit, _ = stem_and_unit(column)
        words = words_of(stem.rstrip('0123456789'))
        is_of_wire = name.endswith(f'_{number_at_end(stem)}_{ours}') if number_at_end(stem) else not number_at_end(name[:-2])
        if DUTY & words and not OTHERS & words and is_of_wire and unit.lower() in ('', '%', *NUMBERS):
            found.append((column, unit or 'duty'))
    return found[0] if len(found) == 1 else ('', ours)


def number_at_end(stem: str) -> str:
    """The number at the end of a name, by which people tell wires apart; empty where there is none."""
    return stem[len(stem.rstrip('0123456789')) :]


def own_factors(header: Sequence[str], units: Collection[str]) -> list[str]:
    """The columns that state one of these units."""
    return [column for column in header if stem_and_unit(column)[1] in units]


def hint_for(name: str, header: Sequence[str], own: Collection[str], with_map: bool) -> str:
    """What to do with a file that has no column of ours of this name, but one that may be it; `own`: names of ours.

    `with_map`: the command takes a map of columns.
    """
    others = [other for other in header if other not in own]
    line = likely_line(name, others)
    if not line:
        return ''
    column, unit = likely_column(name, others)
    if not column:
        return f' (a map has the product of two: {line})' if with_map else f' (expected {name}, the product of two columns)'
    scale, offset = UNITS[unit_of(name)].get(unit, (0.0, 0.0))
    if (scale, offset) == (1.0, 0.0):
        in_map = f'name it in a map: {line}'
        return f' (rename {column}, or {in_map})' if with_map else f' (rename {column}; the unit is part of the name)'
    if with_map:
        return f' ({column} is in {unit}: name it in a map: {line})'
    how = (f'multiplied by {scale:.10g}' if scale != 1.0 else '') + (f' plus {offset:g}' if offset else '')
    return f' ({column} is in {unit}: expected {name}' + (f', which is {column} {how.strip()})' if scale else ')')


def hint_for_all(names: Sequence[str], header: Sequence[str], own: Collection[str]) -> str:
    """The lines of a map for several of our columns, as far as others are like them."""
    others = [other for other in header if other not in own]
    lines = [line for name in names if name not in header and (line := likely_line(name, others))]
    return f'; likely lines of a map: {"; ".join(lines)}' if lines else ''


def likeness(name: str, column: str) -> float:
    """How alike the names of one of our columns and of a foreign one are, 0 to 1; 0 for a unit of something else."""
    stem, (other, unit, _) = name.removesuffix(f'_{unit_of(name)}'), stem_and_unit(column)
    if unit in SCALES and unit not in UNITS[unit_of(name)] or OTHERS & words_of(other) - words_of(stem):
        return 0.0
    ways = [[re.sub(r'[\W_]+', '', word) for word in pair] for pair in ((stem, other), (usual(stem), usual(other)))]
    plain = [pair if any(map(SYMBOL.fullmatch, pair)) else [word.lower() for word in pair] for pair in ways]
    return max(SequenceMatcher(None, one, two).ratio() for one, two in plain)


def words_of(name: str) -> set[str]:
    """The words of a name, in small letters."""
    return set(re.split(r'[\W_]+', name.lower()))


def usual(word: str) -> str:
    """A name as we write it, where people have another word for it, perhaps with the number of a wire behind it."""
    found = re.fullmatch(r'(.*?)[\s_]*(\d*)', word)
    name, wire = found.groups() if found else (word, '')
    words = [one for one in re.split(r'[\W_]+', name) if one]
    if AMBIENT & words_of(name):
        return 'T_E'
    name = '_'.join([one for one in words if one.lower() not in BESIDE] or words)
    return WORDS.get(name if len(name) == 1 else name.lower(), name) + wire
