"""What the flow is made of: the system, its state vector, and what is found on the way from state to rates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.effects.ports import EffectTable
from sma_sim.model.parameters import BeamConstants, WireConstants

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Modes = NDArray[np.int64]

# Columns of `obs`, a row per wire: what the flow finds on its way.
O_LENGTH, O_V, O_EPS, O_DEPS, O_J, O_X, O_STRAIN, O_SIGMA, O_S_A, O_S_M, O_DX, O_F, O_DL, O_SIZE = (
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 15,
)  # fmt: skip


class SystemState(NamedTuple):
    """The state of a system: `y` (n,) changes with the flow, the other two (wires,) only where the hybrid model jumps.

    `x_frozen` is x_M in modes 1 to 3, and in modes 4 and 5 the value from which an implicit x_M is solved for.
    """

    y: Vector
    mode: Modes
    x_frozen: Vector


class InputPoint(NamedTuple):
    """The input of a system at one time, and its slope [1/s]: module (J_eq, T_E), wire (strain, J, T_E)."""

    u: Vector
    du: Vector


class Evaluation(NamedTuple):
    """What one evaluation of the flow leaves behind: dy/dt (n,), and what is found on the way (wires, O_SIZE)."""

    dy: Vector
    obs: Matrix


class System(NamedTuple):
    """Everything that the flow needs and that does not change during a run."""

    module: bool  # else a single wire on a test bench
    mas: bool  # else the hybrid model
    wires: int
    first_T: int  # index of T_1 in y
    first_x: int  # index of x_M of wire 1 in y (MAS)
    wire: WireConstants
    beam: BeamConstants
    effects: EffectTable
