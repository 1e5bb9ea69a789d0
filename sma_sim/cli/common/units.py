"""Numbers with the units that people have at hand, such as `98 mm` or `25 degC`, as SI values."""

from __future__ import annotations

import re
from decimal import Decimal

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.model.errors import UserError

PREFIXES = {'G': 1e9, 'M': 1e6, 'k': 1e3, '': 1.0, 'm': 1e-3, 'u': 1e-6, 'µ': 1e-6, 'μ': 1e-6}
SCALES: dict[str, dict[str, float]] = {
    'm': {f'{prefix}m': PREFIXES[prefix] for prefix in ('', 'm', 'u', 'µ', 'μ')} | {'cm': 1e-2},
    'kg': {'kg': 1.0, 'g': 1e-3, 'mg': 1e-6},
    'Pa': {f'{prefix}Pa': PREFIXES[prefix] for prefix in ('', 'k', 'M', 'G')} | {'N/mm^2': 1e6},
    'Pa/K': {'Pa/K': 1.0, 'MPa/K': 1e6, 'MPa/degC': 1e6},
    'W': {f'{prefix}W': PREFIXES[prefix] for prefix in ('', 'm', 'k')},
    'K': {'K': 1.0},
    '-': {'': 1.0},
}
CELSIUS = ('degC', '°C', 'C')
QUANTITY = re.compile(r'\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)?\s*')


def units_of(si: str) -> tuple[str, ...]:
    """The units that may be typed for a quantity whose SI unit is `si`."""
    return (*SCALES.get(si, {si: 1.0}), *(CELSIUS if si == 'K' else ()))


def typed_units(si: str) -> str:
    """The units that may be typed, in words."""
    return ', '.join(unit for unit in units_of(si) if unit.isascii() and unit)


def to_si(text: str, si: str, default_unit: str) -> float:
    """The SI value of `text`: a number with a unit, or without one in `default_unit`. Raises UserError."""
    match, units = QUANTITY.fullmatch(text), typed_units(si)
    if match is None:
        raise UserError(f'{text.strip()!r} is not a number' + (f', or a number with a unit ({units})' if units else ''))
    number, unit = Decimal(match[1]), (match[2] or default_unit)
    if unit not in units_of(si):
        raise UserError(f'unit {unit!r} is not known here: expected {units or "a number without a unit"}')
    if unit in CELSIUS and si == 'K':
        return float(number + Decimal(repr(ZERO_CELSIUS)))
    return float(number * Decimal(repr(SCALES.get(si, {si: 1.0})[unit])))  # in decimals: 0.15 mm is 1.5e-4 m


def in_unit(value: float, si: str, unit: str) -> str:
    """An SI value in another unit, as text such as `98 mm`."""
    shown = value - ZERO_CELSIUS if unit in CELSIUS and si == 'K' else value / SCALES.get(si, {si: 1.0})[unit]
    return f'{shown:.10g} {unit}'.rstrip()
