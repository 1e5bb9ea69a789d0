"""What a hidden truth is, and all there are: the effects that a challenge may hide.

Their formulas are written apart from those of `sma_sim.model.effects`, in other parametrisations where physics allows:
a diagnosis that finds them was not handed its own equations.
"""

from __future__ import annotations

import importlib
import math
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from inspect import getfile
from pathlib import Path
from types import MappingProxyType

import numpy as np

import sma_sim.challenge.truths as package
from sma_sim.model.arrays import Vector
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

Channels = Mapping[str, Vector]
Values = Mapping[str, float]
Sensor = Callable[[Vector, Channels, Values], dict[str, Vector]]
Listed = Callable[[Values, Values], dict[str, float]]


@dataclass(frozen=True)
class Truth:
    """One hidden effect.

    `library` is the name of the package's effect that it realises, '' for one that the package does not have. `port` is
    where it acts and `variables` are the states (time: `t`) that it depends on there. Each of `effects` takes those of
    `parameters` that it declares. Instead, `sensor(time, channels, values)` makes the shown channels, (k,) each, of the
    true ones, sampled at times (k,) [s]; it returns those that it changes. A parameter is drawn from its realistic range;
    `signed` names those of either sign. `T_E` is the ambient temperature [K] without which it cannot show, if there is one.
    `listed(values, parameters)` are the parameters of the package's effect that come nearest, from the truth's own and those
    of the robot by full name.
    """

    name: str
    library: str
    variables: tuple[str, ...]
    port: str
    parameters: tuple[Parameter, ...]
    effects: tuple[Effect, ...] = ()
    sensor: Sensor | None = None
    signed: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()
    T_E: float | None = None
    listed: Listed | None = None

    def active(self, values: Values) -> tuple[ActiveEffect, ...]:
        """Its effects with these values of the parameters, by name."""
        return tuple(
            ActiveEffect(replace(effect, files=self.files), tuple(values[p.name] for p in effect.parameters))
            for effect in self.effects
        )

    def draw(self, random: np.random.Generator) -> Mapping[str, float]:
        """Values in the realistic ranges: uniform in the logarithm where the range is positive."""
        values = {}
        for p in self.parameters:
            assert p.realistic is not None
            low, high = p.realistic
            value = math.exp(random.uniform(math.log(low), math.log(high))) if low > 0.0 else random.uniform(low, high)
            values[p.name] = value * float(random.choice((-1.0, 1.0))) if p.name in self.signed else value
        return MappingProxyType(values)


def simulated_truth(
    *effects: Effect,
    library: str = '',
    variables: tuple[str, ...],
    signed: tuple[str, ...] = (),
    T_E: float | None = None,
    listed: Listed | None = None,
) -> Truth:
    """A truth made of effects that are simulated, whose kernels are written in one file."""
    parameters = {p.name: p for effect in effects for p in effect.parameters}
    first = effects[0]
    return Truth(
        first.name,
        library,
        variables,
        first.port,
        tuple(parameters.values()),
        effects,
        signed=signed,
        files=(Path(getfile(first.kernel)),),
        T_E=T_E,
        listed=listed,
    )


def sensor_truth(
    name: str,
    sensor: Sensor,
    *parameters: Parameter,
    library: str = '',
    variables: tuple[str, ...],
    signed: tuple[str, ...] = (),
    listed: Listed | None = None,
) -> Truth:
    """A truth of the sensors, applied to the samples."""
    return Truth(name, library, variables, 'sensing', parameters, sensor=sensor, signed=signed, listed=listed)


def drawn_parameter(name: str, unit: str, low: float, high: float, description: str) -> Parameter:
    """A parameter of a truth with the range from which it is drawn; its default is the middle of it."""
    middle = math.sqrt(low * high) if low > 0.0 else 0.5 * (low + high)
    reach = 10.0 * max(abs(low), abs(high))
    return Parameter(name, middle, unit, (-reach, reach), description, realistic=(low, high))


@cache
def truths() -> Mapping[str, Truth]:
    """All truths by name."""
    found: dict[str, Truth] = {}
    for module in pkgutil.iter_modules(package.__path__):
        member = importlib.import_module(f'{package.__name__}.{module.name}')
        for truth in getattr(member, 'TRUTHS', None) or (member.TRUTH,):
            found[truth.name] = truth
    return MappingProxyType(found)
