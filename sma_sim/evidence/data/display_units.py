"""Units in which people read the channels: degrees, millimetres, MPa."""

from __future__ import annotations

import math

from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.model.parameters import ZERO_CELSIUS as ZERO_CELSIUS

BY_SUFFIX = {  # of a column: the unit, and what an SI value is multiplied by
    'm': ('mm', 1e3),
    'rad': ('deg', 180.0 / math.pi),
    'N': ('N', 1.0),
    'K': ('K', 1.0),
    'Pa': ('MPa', 1e-6),
    'ohm': ('ohm', 1.0),
}


class DisplayUnits(dict[str, tuple[str, float]]):
    """Units by channel; those of a structure's coordinates by the unit of their column."""

    def __missing__(self, channel: str) -> tuple[str, float]:
        column = CHANNEL_COLUMNS[channel]
        suffix = column.removeprefix(channel).removeprefix('_')
        return BY_SUFFIX.get(suffix, (suffix, 1.0)) if suffix else ('%', 100.0)


# By channel: the unit, and what an SI value is multiplied by.
DISPLAY_UNITS = DisplayUnits({'U_x': ('um', 1e6)})


def in_display_unit(channel: str, value: float) -> str:
    """A value (SI) as people read it, such as `0.31 deg`."""
    unit, factor = DISPLAY_UNITS[channel]
    return f'{factor * value:.3g} {unit}'
