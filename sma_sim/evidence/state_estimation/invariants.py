"""Coordinates of a filter in which what no measurement tells is the same direction everywhere.

Pose and forces follow from stress and strain of the wires. With

    Theta = sigma_T (T - T_E),   xi = eps_T x_M,   S = sigma_MW0 + sigma_T (T_E - T0),   D = (1/E_M - 1/E_A)/eps_T

a wire transforms at S + Theta +- dsigma/2 (MAS7, MAS8), its strain is sigma (1/E_A + D xi) + xi (MAS3), and its heat balance

    Om rho (c_V/sigma_T) dTheta/dt = J - (lambda/sigma_T) A_s Theta + latent heat.

Robots whose sigma_T, c_V and lambda are all s times as large, or whose eps_T is, show the same with the same Theta, xi, S
and D: T - T_E is known to the common scale of those three parameters, x_M to that of eps_T. Only the latent heat, which goes
with the absolute temperature, tells the former, and only a wire that is all martensite the latter.

Measured forces tell stresses, which are sums of Theta, S and dsigma: those are coordinates as they are. Without forces,
robots show the same too whose stresses, moduli and stiffnesses are all s times as large, with Theta, S and 1/D: coordinates
are then these over dsigma, which is one of them and positive everywhere. With forces that would not do: a stress is not
linear in quotients and dsigma, so that a new run begins beside what was measured, and takes the difference for information.

In T, x_M and parameters that direction depends on the state. A filter that linearises about several states then takes the
change of the direction for information (Huang, Mourikis and Roumeliotis, Int. J. Robotics Research 29 (2010) 502); in these
coordinates there is no change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.free_parameters import FreeParameter
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.solver.propagation import DELTA, Unknowns

STRAIN = 0.1  # unit of xi
READ = tuple(f'wire.{name}' for name in ('sigma_T', 'eps_T', 'sigma_MW0', 'dsigma', 'E_A', 'E_M', 'T0'))


@dataclass(frozen=True)
class InvariantCoordinates:
    """The coordinates of a vector (n,) of all that is estimated, which begins with the `unknowns` of a propagation.

    `free`: the parameters among them; `values`: those of the others (SI). `temperatures` and `fractions` (wires,): where T
    and x_M of the wires stand, in units of `T_scale` [K] and `x_scale`. `by_dsigma`: stresses over dsigma, for robots whose
    forces are not measured.
    """

    free: Sequence[FreeParameter]
    values: Mapping[str, float]
    unknowns: Unknowns
    temperatures: NDArray[np.int64]
    fractions: NDArray[np.int64]
    T_scale: Vector
    x_scale: Vector
    by_dsigma: bool = True

    def mean(self, estimate: Vector, about: Vector, T_E: float, told: NDArray[np.bool_]) -> Vector:
        """The mean (n,) of an estimate that is linear about a vector (n,), as it is about itself.

        `T_E` [K]: what was said of it; `told` (wires,): whose x_M is part of the state, and not algebraic.
        """
        here = self._of(about, T_E, told)
        along = (self._of(about + DELTA * (estimate - about), T_E, told) - here) / DELTA
        return self._back(here + along, T_E, told)

    def covariance(self, covariance: Matrix, about: Vector, mean: Vector, T_E: float, told: NDArray[np.bool_]) -> Matrix:
        """The covariance (n, n) of such an estimate about its `mean`."""
        moved = np.linalg.solve(self._derivatives(mean, T_E, told), self._derivatives(about, T_E, told))
        return moved @ covariance @ moved.T

    def of_temperatures(self, estimate: Vector, about: Vector) -> Matrix:
        """Derivatives (wires, n) of the temperatures [K] at an estimate (n,) that is linear about a vector (n,).

        What is linear is Theta, and T - T_E is Theta over sigma_T: it is known to a part of what it is, not of what it is
        where the run is, which may be much colder.
        """
        of_rise, of_T_E, slopes = np.zeros((len(self.temperatures), len(about))), *np.zeros((2, len(about)))
        of_rise[np.arange(len(of_rise)), self.temperatures] = self.T_scale
        of_T_E[self.unknowns.T_E] = 1.0
        of_rise -= of_T_E
        for k, one in enumerate(self.free):
            sign = {'wire.sigma_T': 1.0, 'wire.dsigma': -1.0 if self.by_dsigma else 0.0}.get(one.name, 0.0)
            slopes[self.unknowns.parameters.start + k] = sign * one.scale  # of the log of sigma_T in the unit of stresses
        return of_T_E + of_rise - np.outer(of_rise @ (estimate - about), slopes)

    def _derivatives(self, at: Vector, T_E: float, told: NDArray[np.bool_]) -> Matrix:
        """Of the coordinates in the vector (n, n)."""
        here, found = self._of(at, T_E, told), np.eye(len(at))
        for j in self._read:
            beside = at.copy()
            beside[j] += DELTA
            found[:, j] = (self._of(beside, T_E, told) - here) / DELTA
        return found

    def _of(self, xi: Vector, T_E: float, told: NDArray[np.bool_]) -> Vector:
        found, w, room = xi.copy(), self._wire(xi), T_E + float(xi[self.unknowns.T_E])
        found[self.temperatures] = w['sigma_T'] / w['unit'] * (self.T_scale * xi[self.temperatures] - room)
        found[self.fractions[told]] = w['eps_T'] / STRAIN * (self.x_scale * xi[self.fractions])[told]
        replaced = {
            'wire.sigma_MW0': (w['sigma_MW0'] + w['sigma_T'] * (room - w['T0'])) / w['unit'],
            'wire.E_M': w['unit'] / STRAIN * (1.0 / w['E_M'] - 1.0 / w['E_A']) / w['eps_T'],
        }
        for name, at in self._replaced:
            found[at] = replaced[name]
        return found

    def _back(self, coordinates: Vector, T_E: float, told: NDArray[np.bool_]) -> Vector:
        """The vector (n,) at some coordinates, its parameters within their limits."""
        xi, room = coordinates.copy(), T_E + float(coordinates[self.unknowns.T_E])
        w = self._wire(xi)
        xi[self.temperatures] = (room + w['unit'] / w['sigma_T'] * coordinates[self.temperatures]) / self.T_scale
        xi[self.fractions[told]] = (STRAIN / w['eps_T'] * coordinates[self.fractions] / self.x_scale)[told]
        for name, at in self._replaced:
            of_one = self.free[at - self.unknowns.parameters.start]
            low, high = of_one.value(of_one.low), of_one.value(of_one.high)
            if name == 'wire.sigma_MW0':
                value = w['unit'] * coordinates[at] - w['sigma_T'] * (room - w['T0'])
            else:
                value = 1.0 / max(STRAIN / w['unit'] * coordinates[at] * w['eps_T'] + 1.0 / w['E_A'], 1.0 / high)
            xi[at] = of_one.coordinate(min(max(value, low), high))
        return xi

    @cached_property
    def _read(self) -> list[int]:
        """What coordinates depend on: each of the others is its own."""
        first = self.unknowns.parameters.start
        parameters = [first + k for k, one in enumerate(self.free) if one.name in READ]
        return [*self.temperatures.tolist(), *self.fractions.tolist(), *parameters, self.unknowns.T_E]

    @cached_property
    def _replaced(self) -> list[tuple[str, int]]:
        """Parameters that have another coordinate, and where they stand."""
        first = self.unknowns.parameters.start
        return [(one.name, first + k) for k, one in enumerate(self.free) if one.name in ('wire.sigma_MW0', 'wire.E_M')]

    def _wire(self, xi: Vector) -> dict[str, float]:
        """The parameters of the wire that the coordinates need, and the `unit` of stresses [Pa]."""
        values = {name: self.values[name] for name in READ}
        for one, z in zip(self.free, xi[self.unknowns.parameters].tolist(), strict=True):
            if one.name in values:
                values[one.name] = one.value(z)
        unit = (values if self.by_dsigma else self.values)['wire.dsigma']
        return {'unit': unit, **{name.removeprefix('wire.'): value for name, value in values.items()}}
