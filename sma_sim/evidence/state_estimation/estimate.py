"""What an observer says of a robot at one time: of its wires, and where a model of it goes on from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.arrays import Vector
from sma_sim.solver.integrate import Run
from sma_sim.solver.model import Model


@dataclass(frozen=True)
class Estimate:
    """The wires of a robot at one time: mean and covariance.

    Attributes
    ----------
    time : float
        When [s].
    T, x_M, stress : array
        (wires,): temperatures [K], martensite fractions, stresses [Pa].
    modes : array of int
        (wires,): modes of the hybrid automaton, 1 to 5; of MAS kinetics those that they look like.
    covariance : array
        (3 wires, 3 wires): of T of all wires, then x_M, then stress.
    strain : array
        (wires,): strains of the wires [-], which the pose tells.
    inconsistency : float
        Running mean of the squared innovations over their variances: about 1 where the robot does what the filter expects,
        with the errors that it allows for; much more where it does not.
    """

    time: float
    T: Vector
    x_M: Vector
    stress: Vector
    modes: NDArray[np.int64]
    covariance: NDArray[np.float64]
    strain: Vector
    inconsistency: float

    @property
    def mean(self) -> Vector:
        """T of all wires, then x_M, then stress (3 wires,)."""
        return np.concatenate([self.T, self.x_M, self.stress])

    @property
    def std(self) -> Vector:
        """Standard deviations of `mean` (3 wires,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def T_std(self) -> Vector:
        """Standard deviations of the temperatures (wires,) [K]."""
        return self.std[: len(self.T)]

    @property
    def x_M_std(self) -> Vector:
        """Standard deviations of the fractions (wires,)."""
        return self.std[len(self.T) : 2 * len(self.T)]

    @property
    def stress_std(self) -> Vector:
        """Standard deviations of the stresses (wires,) [Pa]."""
        return self.std[2 * len(self.T) :]


@dataclass(frozen=True)
class RobotState:
    """Where a prediction of a robot begins.

    Attributes
    ----------
    time : float
        When [s].
    model : Model
        The model that is predicted with.
    run : Run
        Its state, which is not to be changed.
    gains : array
        (wires,): so many times the commanded heating reaches each wire.
    T_E : float
        Ambient temperature [K].
    offsets : array
        (channels,): what the robot shows more than the model (SI).
    T_std, stress_std : array
        (wires,): standard deviations of temperatures [K] and stresses [Pa].
    """

    time: float
    model: Model
    run: Run
    gains: Vector
    T_E: float
    offsets: Vector
    T_std: Vector
    stress_std: Vector
