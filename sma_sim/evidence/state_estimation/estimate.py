"""What an observer says of the wires at one time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


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
