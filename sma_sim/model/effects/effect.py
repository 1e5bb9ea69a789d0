"""What an effect is: one small file that declares it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sma_sim.model.effects.ports import CHANNELS, PORT_NAMES
from sma_sim.model.parameters import Parameter

CHAIN = {
    'actuation': ('gain', 'deadband', 'saturation', 'lag'),
    'wire_strain': ('', 'series'),
    'sensing': ('misalignment', 'gain', 'bias', 'lag', 'delay', 'noise'),
}
SYSTEMS = ('module', 'wire')


@dataclass(frozen=True)
class Effect:
    """A physical effect, declared as data.

    `kernel(s, w, p)` returns what the effect adds at its port (on actuation and sensing: the value passed on), as
    a float or a tuple; `s` is a `State`, `w` the wire's constants (the beam's for structure_force), `p` the
    effect's parameters by name. With extra states the signature is ``kernel(s, w, p, m)`` where `m` has them by
    name; `rate` gives their derivatives and `start` their first values (default 0). `scale` is the size of an
    extra state, for the error control (relative to its channel on sensing). `channels` are those that a sensing
    effect acts on, `systems` those in which the effect has a meaning (in others it is left out). `energy` says how the
    effect enters the energy balance, `signature` what it leaves in measurements, and `confused_with` names what leaves
    nearly the same: effects, parameters by their full names, or 'delay' of the recording. `same_as` says in words what the
    equations make the same, so that no measurement tells them apart. `title` is a short phrase that completes "the model
    lacks ..."; without one the name with spaces serves.
    """

    name: str
    port: str
    equation: str
    source: str
    parameters: tuple[Parameter, ...]
    kernel: Callable[..., Any]
    states: tuple[str, ...] = ()
    scale: tuple[float, ...] = ()
    rate: Callable[..., Any] | None = None
    start: Callable[..., Any] | None = None
    stage: str = ''
    channels: tuple[str, ...] = CHANNELS
    systems: tuple[str, ...] = SYSTEMS
    energy: str = ''
    description: str = ''
    signature: str = ''
    confused_with: tuple[str, ...] = ()
    same_as: str = ''
    title: str = ''

    def __post_init__(self) -> None:
        if self.port not in PORT_NAMES:
            raise ValueError(f'effect {self.name!r}: port {self.port!r}; expected one of {", ".join(PORT_NAMES)}')
        if self.states and (self.rate is None or len(self.scale) != len(self.states)):
            raise ValueError(f'effect {self.name!r}: states need a rate and one scale each')
        stages = CHAIN.get(self.port)
        if stages and self.stage not in stages:
            raise ValueError(f'effect {self.name!r}: stage {self.stage!r}; expected one of {", ".join(stages)}')

    @property
    def phrase(self) -> str:
        """What a sentence calls the effect."""
        return self.title or self.name.replace('_', ' ')

    @property
    def place(self) -> tuple[int, int]:
        """Port and place in the port's chain: the order in which effects act."""
        stages = CHAIN.get(self.port, ('',))
        return PORT_NAMES.index(self.port), stages.index(self.stage) if self.stage in stages else 0
