"""What the flow is made of: the system, its state vector, and what is found on the way from state to rates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.effects.ports import EffectTable
from sma_sim.model.parameters import WireConstants

Modes = NDArray[np.int64]

# Columns of `obs`, a row per wire: what the flow finds on its way; O_RATIO is l0 deps/dl, 1 of a straight wire; from O_DL
# on dl/dq, one column for each coordinate of the wire's segment.
O_LENGTH, O_V, O_EPS, O_DEPS, O_RATIO, O_J, O_X, O_STRAIN, O_SIGMA, O_S_A, O_S_M, O_DX, O_F, O_DL = range(14)
RANGE = 4  # numbers that say which segments of a series are evaluated (`StructureTable.effects`)


class SystemState(NamedTuple):
    """The state of a system: `y` (n,) changes with the flow, the other two (wires,) only where the hybrid model jumps.

    `x_frozen` is x_M in modes 1 to 3, and in modes 4 and 5 the value from which an implicit x_M is solved for.
    """

    y: Vector
    mode: Modes
    x_frozen: Vector


class InputPoint(NamedTuple):
    """The input of a system at one time, and its slope [1/s]: what is imposed, heating, and T_E in the end."""

    u: Vector
    du: Vector


class Evaluation(NamedTuple):
    """What one evaluation of the flow leaves behind: dy/dt (n,), what is found on the way (wires, O_DL + coordinates of one
    segment)."""

    dy: Vector
    obs: Matrix


class StructureTable(NamedTuple):
    """The structure as the compiled flow reads it.

    The first three are addresses of native kernels: `kinematics_at` writes length, strain with its O_RATIO and dl/dq of each
    wire into `obs`, `speeds_at` their rates, `motion_at` the rates of coordinates and velocities into `dy`. They read
    `constants`: the structure's own, the scales and the inertia of its coordinates (n,) each, l0. `effects` takes what is
    imposed (drives,), how many effects act on the structure, and the generalised forces of each (n,); for segments in series
    then the first and behind the last of those whose wires and forces are evaluated, the same of those whose accelerations
    are, and the generalised forces (n,).
    """

    kinematics_at: int
    speeds_at: int
    motion_at: int
    constants: Vector
    effects: Vector


class System(NamedTuple):
    """Everything that the flow needs and that does not change during a run.

    The state vector has the coordinates, their rates, the temperature of every wire; for the MAS model x_M of every wire;
    then the extra states of the active effects.
    """

    coordinates: int  # n; none where strain is imposed on a wire
    segments: int  # equal ones in series
    wires: int
    drives: int  # leading entries of the input that are no heating
    antagonistic: bool  # one command heats either wire of a pair
    mas: bool  # else the hybrid model
    first_T: int  # index of T_1 in y
    first_x: int  # index of x_M of wire 1 in y (MAS)
    channels: int  # of sensors
    wire: WireConstants
    coiled: bool  # the strain of the wires is one of shear, which does not lengthen them
    structure: StructureTable
    effects: EffectTable
    imposed_T: int  # which of the drives is the temperature of wire 1, before all others'; -1: they have a heat balance
