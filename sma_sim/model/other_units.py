"""Units other than SI, which data sheets and drawings have: in them, declared numbers are not what equations take."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

OTHER_UNITS: Mapping[str, Mapping[str, float]] = {  # by SI unit
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


def si_unit(unit: str) -> str:
    """A unit with SI units in place of others; itself where all of it is SI."""
    meant = {other: si for si, others in OTHER_UNITS.items() for other in others}
    return PART.sub(lambda part: part[0].replace(part[1], meant.get(part[1], part[1]), 1), unit)
