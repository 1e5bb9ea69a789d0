"""A fit: one record from the optimizer to the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan, sqrt

from sma_sim.evidence.estimation.problem import Problem
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config


@dataclass(frozen=True)
class OtherStart:
    """Where another start led: its cost above that of the one taken, its parameters (SI), whether it is the same optimum.

    `log_odds` against it: the excess over the overdispersion of what the best leaves.
    """

    excess: float
    values: Mapping[str, float]
    same: bool
    log_odds: float = nan


@dataclass(frozen=True)
class FitResult:
    """A problem at its optimum z (n,), as `minimize` leaves it.

    `cost`: half the sum of the squared residuals over noise, prior included. `other_starts`: of a search from several.
    """

    problem: Problem
    z: Vector
    cost: float
    iterations: int = 0
    converged: bool = True
    other_starts: tuple[OtherStart, ...] = ()

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the active effects, in the order in which they were added; not those of the nominal model."""
        names = (active.effect.name for active in self.problem.config.effects)
        return tuple(name for name in names if name not in self.problem.nominal_effects)

    @property
    def differences(self) -> tuple[str, ...]:
        """In what the recordings differ, in words."""
        return tuple(one.words for one in self.problem.differences)

    @property
    def squares(self) -> float:
        """Sum of the squared residuals over noise, without the prior's part of the cost."""
        return max(2.0 * self.cost - self.problem.tempering**2 * float(self.z @ self.z), 0.0)

    @property
    def error(self) -> float:
        """Root mean square of the residuals over noise."""
        return sqrt(self.squares / self.problem.samples)

    @property
    def config(self) -> Config:
        """The configuration with the fitted parameters."""
        return self.problem.fitted(self.z)

    @property
    def delay(self) -> float:
        """The fitted delay of the measurement [s]."""
        return self.problem.delay_at(self.z)

    @property
    def values(self) -> dict[str, float]:
        """The free parameters by name (SI)."""
        return self.problem.values(self.z)

    def values_of(self, effect: str) -> dict[str, float]:
        """The fitted parameters of one effect, by their short names (SI)."""
        prefix = f'effects.{effect}.'
        return {name.removeprefix(prefix): value for name, value in self.values.items() if name.startswith(prefix)}

    def seen_values_of(self, effect: str) -> dict[str, float]:
        """Of what shows in a recording: the rest, such as the bias of a channel that is not there, has its prior."""
        measured = {channel for run in self.problem.runs for channel in run.channels}
        found = {one.effect.name: one.effect for one in self.problem.config.effects}[effect]
        return {name: value for name, value in self.values_of(effect).items() if found.is_seen(name, measured)}
