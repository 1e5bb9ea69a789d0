"""Units in which people read the channels: degrees, millimetres, MPa."""

from __future__ import annotations

import math
from collections.abc import Mapping

ZERO_CELSIUS = 273.15  # [K]

# By channel: the unit, and what an SI value is multiplied by.
DISPLAY_UNITS: Mapping[str, tuple[str, float]] = {
    'U_x': ('um', 1e6), 'U_y': ('mm', 1e3), 'alpha': ('deg', 180.0 / math.pi), 'F_1': ('N', 1.0), 'F_2': ('N', 1.0),
    'T_1': ('K', 1.0), 'T_2': ('K', 1.0), 'stress': ('MPa', 1e-6), 'T': ('K', 1.0),
}  # fmt: skip


def in_display_unit(channel: str, value: float) -> str:
    """A value (SI) as people read it, such as `0.31 deg`."""
    unit, factor = DISPLAY_UNITS[channel]
    return f'{factor * value:.3g} {unit}'
