"""Where beam, plate and wires are in a pose, for pictures: x along the straight beam, y across it [m]."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.parameters import BeamConstants

OVERHANG = 1.4  # half the plate's drawn length over half the wires' distance

Line = NDArray[np.float64]


class Shape(NamedTuple):
    """Lines (k, 2): the beam's axis, the plate, and each wire from its clamp to the plate."""

    beam: Line
    plate: Line
    wires: tuple[Line, Line]


def shape_of(U_x: float, U_y: float, alpha: float, b: BeamConstants, points: int = 61) -> Shape:
    """The module in a pose [m, m, rad]: the cubic that a cantilever with this tip takes, and what hangs on it.

    A positive angle leans towards wire 1 (EB-B2a).
    """
    s = np.linspace(0.0, 1.0, points)
    across = U_y * (3 * s**2 - 2 * s**3) + alpha * b.L * (s**3 - s**2)
    tip = np.array([b.L + U_x, U_y])
    along_plate = np.array([-math.sin(alpha), math.cos(alpha)])
    half = 0.5 * b.W
    wires = [np.array([[0.0, side * half], tip + side * half * along_plate]) for side in (1.0, -1.0)]
    plate = np.array([tip - OVERHANG * half * along_plate, tip + OVERHANG * half * along_plate])
    return Shape(np.column_stack([s * (b.L + U_x), across]), plate, (wires[0], wires[1]))
