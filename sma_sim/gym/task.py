"""What an agent is to do: the robot, its target, what is observed. Of numpy alone, nothing of Gymnasium."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from sma_sim.gym.posterior import Posterior
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.nearest import suggestion
from sma_sim.model.parameters import wire_constants
from sma_sim.model.program_parameters import DEFAULTS
from sma_sim.solver.effect_table import channel_scales
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.model import Model

SETTLED = 10.0  # [s] of full heating, after which the ends of the range are read
INNER = 0.1  # of the range, which targets leave free at either end: there only full heating, or none, would do
RAMP = 1.0  # [s] in which the target goes from one level to the next
AHEAD = 0.5  # [s] by which the second target that is observed is ahead
LARGEST = 10.0  # observations are cut off here
EFFORT = 0.01  # of the reward, for full heating
RTOL = 1e-4  # of the solver: a plate rings by nanometres, which nobody observes


@dataclass(frozen=True)
class Task:
    """A coordinate follows random levels, by heating that is chosen `rate` times per second.

    Attributes
    ----------
    config : Config
        The robot.
    posterior : Posterior, optional
        From which every episode draws another robot.
    tracked : str
        Name of the coordinate; without it the last one.
    observed : tuple of str
        Channels that are measured beside it, such as ``'T_1'``.
    rate, duration : float
        Actions per second [1/s], length of an episode [s].
    hold : tuple of float
        For how long a level stays at least and at most [s].
    warming : float
        Full action warms a wire by so much in the end [K].

    At the default of ``solver.rtol`` a run has RTOL: what is observed is right to 1e-3, in a tenth of the steps where random
    actions shake a robot. Another value is kept.
    """

    config: Config
    posterior: Posterior | None = None
    tracked: str = ''
    observed: tuple[str, ...] = ()
    rate: float = 50.0
    duration: float = 20.0
    hold: tuple[float, float] = (2.0, 6.0)
    warming: float = 80.0

    def __post_init__(self) -> None:
        if self.config.parameters['solver.rtol'] == DEFAULTS['solver.rtol'].default:
            object.__setattr__(self, 'config', self.config.variant({'solver.rtol': RTOL}))
        for name in ('observed', 'hold'):  # lists may be given, but have no hash
            object.__setattr__(self, name, tuple(getattr(self, name)))
        structure, channels = self.config.structure, self.config.structure.channels
        if not structure.coordinates or structure.drives:
            raise UserError(
                f'system {structure.name} has no motion that heating controls; expected such as module or slider'
            )
        for name, known in (
            (self.tracked or structure.coordinate_names[-1], structure.coordinate_names),
            *((name, channels) for name in self.observed),
        ):
            if name not in known:
                raise UserError(
                    f'{name!r} is no channel of {structure.name}{suggestion(name, known)}; expected some of '
                    f'{", ".join(known)}'
                )
        for name, value in (('rate', self.rate), ('duration', self.duration), ('warming', self.warming)):
            if not value > 0.0:
                raise UserError(f'{name} = {value:g}: expected more than 0')
        if not 0.0 < self.hold[0] <= self.hold[1]:
            raise UserError(f'hold = {self.hold}: expected the shortest and the longest time [s] of a level')

    @property
    def steps(self) -> int:
        """Actions in an episode."""
        return max(1, round(self.duration * self.rate))

    @property
    def signed(self) -> bool:
        """Whether a command heats either of two bundles by its sign."""
        return self.config.structure.antagonistic

    @property
    def commands(self) -> int:
        """Numbers in an action, from -1 to 1."""
        return len(self.config.structure.commands)

    @property
    def size(self) -> int:
        """Numbers in an observation."""
        return 4 + self.commands + len(self.observed)

    @cached_property
    def J_max(self) -> float:
        """Heating of a full action [W]."""
        w = wire_constants(self.config.parameters)
        return w.n * w.lambda_ * w.surface * self.warming

    @cached_property
    def channel_numbers(self) -> NDArray[np.int64]:
        """Of the coordinate that is tracked, then of what else is observed."""
        structure = self.config.structure
        names = (self.tracked or structure.coordinate_names[-1], *self.observed)
        return np.array([structure.channels.index(name) for name in names], dtype=np.int64)

    @cached_property
    def span(self) -> tuple[float, float]:
        """Middle and half of the range that the coordinate has from rest to full heating."""
        ends = reachable(self)
        return 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0])

    @cached_property
    def scales(self) -> tuple[Vector, Vector]:
        """What is subtracted from the further channels, and by what they are divided then."""
        structure = self.config.structure
        sizes = channel_scales(structure)
        names = [structure.channels[k] for k in self.channel_numbers[1:]]
        first = [self.config.parameters['environment.T_E'] if name.startswith('T') else 0.0 for name in names]
        return np.array(first), np.array([sizes[k] for k in self.channel_numbers[1:]])

    def heating(self, action: Vector) -> Vector:
        """Commands [W] of actions from -1 to 1, (..., commands)."""
        cut = np.clip(action, -1.0, 1.0)
        return self.J_max * (cut if self.signed else 0.5 * (cut + 1.0))

    def target(self, random: np.random.Generator) -> Vector:
        """The target of an episode at every action and AHEAD of the last ones, within -1 and 1 of `span`."""
        count = self.steps + 1 + round(AHEAD * self.rate)
        ends = [0.0]
        while ends[-1] < count / self.rate:
            ends.append(ends[-1] + float(random.uniform(*self.hold)))
        levels = random.uniform(-1.0 + 2.0 * INNER, 1.0 - 2.0 * INNER, len(ends))
        ramp = min(RAMP, 0.5 * self.hold[0])
        times = np.column_stack([ends, np.array(ends) + ramp]).ravel()
        values = np.column_stack([np.concatenate([levels[:1], levels[:-1]]), levels]).ravel()
        found: Vector = np.interp(np.arange(count) / self.rate, times, values)
        return found

    def model(self, random: np.random.Generator) -> Model:
        """The robot of an episode."""
        if self.posterior is None:
            return nominal_model(self)
        return Model(with_parameters(self.config, self.posterior.draw(random)))

    def __hash__(self) -> int:
        """Of what tells tasks apart nearly always."""
        return hash((self.config.system, self.tracked, self.observed, self.rate, self.duration, self.warming))


def with_parameters(config: Config, values: Mapping[str, float]) -> Config:
    """The configuration with some values, those of effects too. Raises UserError."""
    return Config(
        MappingProxyType({**config.parameters, **values}),
        config.system,
        config.kinetics,
        config.effects,
        config.settings,
        config.own_structure,
        config.priors,
    )


@lru_cache(64)
def nominal_model(task: Task) -> Model:
    """The robot without any uncertainty."""
    return Model(task.config)


@lru_cache(64)
def reachable(task: Task) -> tuple[float, float]:
    """The least and the largest value of the coordinate at rest, and under full heating of each command by itself."""
    model, T_E = nominal_model(task), task.config.parameters['environment.T_E']
    seen = []
    for command in range(task.commands):
        for side in (0.0, 1.0, -1.0) if task.signed else (0.0, 1.0):
            J = [side * task.J_max * (k == command) for k in range(task.commands)]
            run = FixedRateRun(model, task.rate, np.array([*np.zeros(task.commands), T_E]))
            run.step(np.array([*J, T_E]), round(SETTLED * task.rate))
            seen.append(run.shown(model.structure.channels[task.channel_numbers[0]]))
    return min(seen), max(seen)
