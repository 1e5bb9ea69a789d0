"""Units that a table states for the columns that are taken of it: ours, or converted by a map, or refused."""

from __future__ import annotations

from collections.abc import Mapping
from math import prod
from pathlib import Path

import numpy as np

from sma_sim.evidence.data.column_map import Origin
from sma_sim.evidence.data.foreign_columns import likely_line
from sma_sim.evidence.data.stated_units import (
    AMPERES,
    SCALES,
    UNITS,
    VOLTS,
    map_line,
    product_line,
    stated_factor,
    stated_unit,
    unit_of,
)
from sma_sim.evidence.data.table_format import TableFormat
from sma_sim.model.errors import UserError

ROUNDED = 1e-2  # of a scale in a map: people write 4.45 for a pound, 9.8 for a kilogram
INSIST = ' (scale: 1 where that is no unit)'


def check_stated_units(path: Path, written: TableFormat, origins: Mapping[str, Origin]) -> list[str]:
    """Notes on columns without a unit, and on those of which a map says another scale than that of their unit.

    Raises UserError where a table states another unit than ours, and no map converts.
    """
    assumed, overridden = list[str](), list[str]()
    for name, entry in origins.items():
        if entry.column is None or entry.nanosec is not None or entry.pace is not None:
            continue
        if entry.times is not None:
            check_product(path, name, entry, written.units)
            continue
        unit, where = stated_unit(name, entry.column, written.units)
        known = UNITS[unit_of(name)].get(unit)
        if not unit and entry.column != name and not entry.converts:
            ours = unit_of(name)
            assumed.append(f'{entry.column!r} {"as a fraction" if ours == "-" else f"in {ours}"}')
        elif known and entry.has_unit and not is_conversion(entry, known):
            overridden.append(f'{entry.column} ({unit})')
        elif unit and known != (1.0, 0.0) and not entry.has_unit and not entry.converts:
            cure = map_line(name, entry.column, unit)
            if unit in VOLTS or unit in AMPERES:
                cure = likely_line(name, [other for other in written.header if other not in origins]) or cure
            raise UserError(
                f'{path}, column {entry.column}: {where} says {unit}, expected {unit_of(name)} for {name}; a map (--map) '
                f'can convert: {cure}{INSIST if where == "its name" else ""}'
            )
    notes = [f'no unit stated: {", ".join(assumed)} assumed'] if assumed else []
    return notes + ([f'the map converts other than from the unit stated: {", ".join(overridden)}'] if overridden else [])


def is_conversion(entry: Origin, known: tuple[float, float]) -> bool:
    """Whether a map converts by a known scale and offset, but for the sign and for the zero of a sensor."""
    offset = entry.offset if known[1] else 0.0
    return bool(np.allclose((abs(entry.scale), offset), known, rtol=ROUNDED))


def check_product(path: Path, name: str, entry: Origin, row: Mapping[str, str]) -> None:
    """Raise UserError where a table states units whose product is not ours, and the map says no scale."""
    if entry.has_unit or entry.column is None or entry.times is None:
        return
    powers = {entry.times: 1.0, entry.column: entry.exponent}
    stated = {column: found for column in powers for found in (stated_factor(column, row),) if found[0]}
    scales = [SCALES.get(unit, np.nan) ** powers[column] for column, (unit, _) in stated.items()]
    if (scale := prod(scales)) == 1.0:
        return
    unit, where = next(one for one in stated.values() if SCALES.get(one[0]) != 1.0)
    line = product_line(name, entry.column, entry.times, None if np.isnan(scale) else scale, entry.exponent)
    raise UserError(f'{path}: {where} says {unit}, and {name} is a product without a scale; say one in the map: {line}')
