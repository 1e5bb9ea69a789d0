"""What the panels of a run show: which columns go together, their labels with units, colours and factors."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sma_sim.report.palette import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY

FREEZING = 273.15


class Panel(NamedTuple):
    """What one panel shows: its axis label, and columns with label, colour, factor and offset."""

    label: str
    curves: Sequence[tuple[str, str, str, float, float]]


Curve = tuple[str, str, str, float, float]
COLOURS = (RED, BLUE, GREEN, ORANGE, PURPLE, SKY)  # of wires, one after another; grey is the ambient temperature
FIRST = ('alpha_rad', 'U_y_m', 'U_x_m')  # coordinates that come before others
OF_WIRES = {  # by the name of a column with the number of a wire in it: axis label, label, factor and offset
    r'T_(\d+)_K': ('T [deg C]', 'wire', 1.0, -FREEZING),
    r'F_(\d+)_N': ('force [N]', 'bundle', 1.0, 0.0),
    r'R_(\d+)_ohm': ('R [ohm]', 'wire', 1.0, 0.0),
    r'x_M_(\d+)': ('x_M [-]', 'wire', 1.0, 0.0),
    r'J_(\d+)_W': ('J [W]', 'bundle', 1.0, 0.0),
    r'J_eq_(\d+)_W': ('J_eq [W]', 'pair', 1.0, 0.0),
}
SINGLE: Mapping[str, tuple[str, Curve]] = {  # others: axis label and curve
    'T_K': ('T [deg C]', ('T_K', 'wire', RED, 1.0, -FREEZING)),
    'T_E_K': ('T [deg C]', ('T_E_K', 'ambient', GREY, 1.0, -FREEZING)),
    'stress_Pa': ('stress [MPa]', ('stress_Pa', 'stress', BLUE, 1e-6, 0.0)),
    'R_ohm': ('R [ohm]', ('R_ohm', 'wire', BLUE, 1.0, 0.0)),
    'F_N': ('force [N]', ('F_N', 'bundle', BLUE, 1.0, 0.0)),
    'x_M': ('x_M [-]', ('x_M', 'wire', BLUE, 1.0, 0.0)),
    'strain': ('strain [%]', ('strain', 'strain', BLUE, 100.0, 0.0)),
    'J_eq_W': ('J_eq [W]', ('J_eq_W', 'J_eq', ORANGE, 1.0, 0.0)),
    'J_W': ('J [W]', ('J_W', 'J of one wire', ORANGE, 1.0, 0.0)),
}
ORDER = (
    'T [deg C]',
    'force [N]',
    'stress [MPa]',
    'R [ohm]',
    'x_M [-]',
    'strain [%]',
    'J_eq [W]',
    'J [W]',
)  # after the coordinates
WITH_LEGEND = ('T [deg C]', 'force [N]', 'R [ohm]', 'x_M [-]')
MODE_COLUMN, COORDINATE, HEATING = r'mode(?:_(\d+))?', r'(.+)_(m|rad)', r'J(_\w+)?_W'
UNITS = {'m': ('mm', 1e3), 'rad': ('deg', 180.0 / np.pi)}


def is_drawn(name: str) -> bool:
    """Whether a column can be drawn."""
    return curve_of(name) is not None or re.fullmatch(MODE_COLUMN, name) is not None


def is_held(name: str) -> bool:
    """Whether a column holds until its next row."""
    return name == 'T_E_K' or re.fullmatch(HEATING, name) is not None


def curve_of(name: str) -> tuple[str, Curve] | None:
    """The axis label of a column's panel, and its curve."""
    if name in SINGLE:
        return SINGLE[name]
    for pattern, (axis, label, factor, offset) in OF_WIRES.items():
        if found := re.fullmatch(pattern, name):
            number = int(found.group(1))
            return axis, (name, f'{label} {number}', COLOURS[(number - 1) % len(COLOURS)], factor, offset)
    if found := re.fullmatch(COORDINATE, name):
        coordinate, (unit, factor) = found.group(1), UNITS[found.group(2)]
        return f'{coordinate} [{unit}]', (name, coordinate, GREEN if name == 'U_x_m' else BLUE, factor, 0.0)
    return None


def panels_of(names: Iterable[str]) -> list[Panel]:
    """The panels of some columns: coordinates first, the heating last."""
    curves: dict[str, list[Curve]] = {}
    given = list(names)
    for name in [*(name for name in FIRST if name in given), *(name for name in given if name not in FIRST)]:
        if (found := curve_of(name)) is not None:
            curves.setdefault(found[0], []).append(found[1])
    coordinates = [label for label in curves if label not in ORDER]
    return [
        Panel(label, sorted(curves[label], key=lambda curve: curve[0] == 'T_E_K'))
        for label in (*coordinates, *ORDER)
        if label in curves
    ]
