"""In which unit a number was probably given, where in the declared one it is far from all that real robots have."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from itertools import product

from sma_sim.model.parameters import ENVIRONMENT_PARAMETERS, ZERO_CELSIUS, Parameter

OTHER_UNITS: Mapping[str, Mapping[str, float]] = {  # what data sheets and drawings have, by SI unit
    'm': {'cm': 1e-2, 'mm': 1e-3, 'um': 1e-6, 'nm': 1e-9},
    'kg': {'g': 1e-3},
    's': {'ms': 1e-3, 'us': 1e-6},
    'N': {'kN': 1e3, 'mN': 1e-3},
    'Pa': {'kPa': 1e3, 'MPa': 1e6, 'GPa': 1e9},
    'J': {'kJ': 1e3, 'mJ': 1e-3},
    'W': {'kW': 1e3, 'mW': 1e-3},
    'ohm': {'mohm': 1e-3, 'uohm': 1e-6},
    'rad': {'deg': math.pi / 180.0, 'mrad': 1e-3},
}
PART = re.compile(r'([A-Za-z]+)(?:\^([\d.]+))?')  # of a unit: a symbol and its power
SEVERAL_AT_ONCE = 2  # symbols that differ from SI, as in g/cm^3


def si_unit(unit: str) -> str:
    """A unit with SI units in place of others; itself where all of it is SI."""
    meant = {other: si for si, others in OTHER_UNITS.items() for other in others}
    return PART.sub(lambda part: part[0].replace(part[1], meant.get(part[1], part[1]), 1), unit)


def written_otherwise(unit: str) -> Iterator[tuple[int, str, float]]:
    """A unit in others than SI: how many of its symbols differ, how it is then written, and what one of it is in SI.

    Those with another first symbol come first, as prefixes are usually written.
    """
    if PART.sub('', unit).strip(' 1/()'):
        return  # no product of powers
    parts, denominator = list(PART.finditer(unit)), f'{unit}/'.index('/')
    powers = [(1.0 if part.start() < denominator else -1.0) * float(part[2] or 1.0) for part in parts]
    pattern = PART.sub(lambda part: '{}' + part[0].removeprefix(part[1]), unit)
    choices = [{part[1]: 1.0, **OTHER_UNITS.get(part[1], {})}.items() for part in parts]
    for backwards in product(*choices[::-1]):
        chosen = backwards[::-1]
        differing = sum(symbol != part[1] for part, (symbol, _) in zip(parts, chosen, strict=True))
        if 0 < differing <= SEVERAL_AT_ONCE:
            factor = math.prod(scale**power for (_, scale), power in zip(chosen, powers, strict=True))
            yield differing, pattern.format(*(symbol for symbol, _ in chosen)), factor


def met_in_practice(parameter: Parameter) -> tuple[float, float]:
    """The range of real robots, where one is known, and what the parameter is by default."""
    low, high = parameter.realistic or parameter.usual or parameter.bounds
    return (low, high) if math.isnan(parameter.default) else (min(low, parameter.default), max(high, parameter.default))


def distance(value: float, low: float, high: float) -> float:
    """By what factor a value lies outside a range, as a logarithm; infinite where it is 0 or has the other sign."""
    end = high if value > high else low
    return math.inf if value * end <= 0.0 else abs(math.log(value / end))


def likely_unit(parameter: Parameter, value: float) -> tuple[str, float]:
    """The unit in which a value was probably given, with what it is in SI; ('', value) where that is the declared one.

    It is another one if that brings the value to where real robots are (of several, nearest to the default), and the value
    is in logarithms nearer to that unit than to the declared one, in which it cannot be meant beyond its bounds.
    """
    (least, most), (low, high) = parameter.bounds, met_in_practice(parameter)
    if low <= value <= high or value in (0.0, parameter.neutral) or not math.isfinite(value):
        return '', value
    if parameter.unit == 'K':
        return ('deg C', value + ZERO_CELSIUS) if low <= value + ZERO_CELSIUS <= high else ('', value)
    others = [(1, '%', 0.01)] if parameter.unit == '-' and high <= 1.0 else written_otherwise(parameter.unit)
    found = [one for one in others if low <= one[2] * value <= high]
    if not found:
        return '', value
    wanted = abs(parameter.default) or max(abs(low), abs(high))
    _, name, factor = min(found, key=lambda one: (round(abs(math.log(one[2] * abs(value) / wanted)), 6), one[0]))
    is_allowed = least <= value <= most and distance(value, low, high) <= 0.5 * abs(math.log(factor))
    return ('', value) if is_allowed else (name, factor * value)


def unit_hint(parameter: Parameter, value: float) -> str:
    """For the end of a message: what a value is in SI if another unit was meant; '' where none is likely."""
    unit, meant = likely_unit(parameter, value)
    declared = f' {parameter.unit}'.removesuffix(' -')
    return f'\n{value:g} {unit} are {meant:g}{declared}' if unit else ''


def kelvin_hint(value: float) -> str:
    """The same of an ambient temperature."""
    return unit_hint(ENVIRONMENT_PARAMETERS[0], value)
