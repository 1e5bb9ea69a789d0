"""The true robot behind a challenge: a model with MAS kinetics, hidden effects, and what its sensors do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sma_sim.challenge.truth import Truth
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.solver.inputs import Input
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import simulate, uninterrupted

REST_DURATION = 20.0  # [s] without power before a run
ROBOT_RTOL = 1e-6
MAX_STEP = 0.25  # [s]: no step passes over what happens at a time
MAX_ANGLE, MAX_WIRE_TEMPERATURE = 0.8, 500.0  # [rad], [K]: beyond, the robot would be broken
DEGREE = float(np.pi / 180.0)
NOISE_STD: Mapping[str, float] = {'U_x': 2e-6, 'U_y': 1e-5, 'alpha': 0.02 * DEGREE, 'F_1': 0.05, 'F_2': 0.05}


class BrokenRobot(UserError):
    """A robot that cannot do a run: it finds no equilibrium, bends too far or gets too hot."""


@dataclass(frozen=True)
class Hidden:
    """A truth and the values of its parameters."""

    truth: Truth
    values: Mapping[str, float]


@dataclass(frozen=True)
class Robot:
    """Parameters by full name, and the hidden effects."""

    parameters: Mapping[str, float]
    hidden: tuple[Hidden, ...] = ()

    def without(self, hidden: Hidden) -> Robot:
        """The robot without one of its hidden effects."""
        return replace(self, hidden=tuple(other for other in self.hidden if other is not hidden))

    @property
    def model(self) -> Model:
        """What is simulated; sensors come after it."""
        active = tuple(effect for hidden in self.hidden for effect in hidden.truth.active(hidden.values))
        return Model(Config({**self.parameters, 'solver.rtol': ROBOT_RTOL}, 'module', 'mas', active))

    def measure(self, source: Input, rate: float) -> tuple[Vector, dict[str, Vector]]:
        """Times (k,) [s] of the samples, and the channels (k,) of NOISE_STD without noise, SI units.

        `source` begins at 0; the robot rests without power before. Raises BrokenRobot.
        """
        rest = source.values[:1] * (0.0, 1.0)
        whole = Input(np.r_[-REST_DURATION, source.times], np.vstack([rest, source.values]), source.linear, source.names)
        before, after = round(REST_DURATION * rate), int(np.ceil(source.times[-1] * rate - 1e-9))
        time = np.arange(-before, after) / rate
        run = uninterrupted(simulate(self.model, whole, time, max_step=MAX_STEP))
        if not run.completed:
            raise BrokenRobot(f'the run ended at {run.end:g} s: {run.reason}')
        angle, temperature = np.abs(run['alpha_rad']).max(), max(run['T_1_K'].max(), run['T_2_K'].max())
        if angle > MAX_ANGLE or temperature > MAX_WIRE_TEMPERATURE:
            raise BrokenRobot(f'it bends beyond {MAX_ANGLE} rad or gets hotter than {MAX_WIRE_TEMPERATURE} K')
        channels = {name: run[CHANNEL_COLUMNS[name]] for name in NOISE_STD}
        for hidden in self.hidden:
            if hidden.truth.sensor is not None:
                channels |= hidden.truth.sensor(time, channels, hidden.values)
        return time[before:], {name: values[before:] for name, values in channels.items()}
