"""What an effect is: one small file that declares it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from sma_sim.model.effects.ports import CHANNELS, PORT_NAMES
from sma_sim.model.effects.scope import EVERYWHERE, SEPARATOR, Scope, scopes_at
from sma_sim.model.parameters import Parameter

CHAIN = {
    'actuation': ('gain', 'deadband', 'saturation', 'lag'),
    'wire_strain': ('', 'series'),
    'sensing': ('misalignment', 'gain', 'bias', 'lag', 'delay', 'noise'),
}


@dataclass(frozen=True)
class Effect:
    """A physical effect, declared as data.

    Attributes
    ----------
    name, port : str
        The effect's name, and the port at which it acts.
    equation, source : str
        The equation in one line, and where it comes from.
    parameters : tuple of Parameter
        With unit, bounds, neutral value and realistic range.
    kernel : callable
        ``kernel(s, w, p)`` returns what the effect adds at its port (on actuation and sensing: the value passed on), as a
        float or a tuple; `s` is a `State`, `w` the wire's constants (the beam's for structure_force), `p` the effect's
        parameters by name. With extra states it is ``kernel(s, w, p, m)``, where `m` has them by name.
    states, scale : tuple
        Names of the extra states, and their sizes for the error control (relative to its channel on sensing).
    rate, start : callable, optional
        The derivatives of the extra states, and their first values (default 0).
    stage : str
        Position in the chain of the ports that have one (`CHAIN`).
    channels : tuple of str
        The channels that a sensing effect acts on.
    systems : tuple of str
        The systems in which the effect has a meaning, in others it is left out; none are all with enough `wires`.
    wires : int
        How many wires it needs.
    energy : str
        How the effect enters the energy balance.
    description, signature : str
        Remarks, and the trace that the effect leaves in measurements.
    confused_with : tuple of str
        What leaves nearly the same trace: effects, parameters by their full names, or the 'delay' of the recording.
    same_as : str
        What is identical in the equations, so that no measurement distinguishes it, in words.
    title : str
        A short phrase that completes "the model lacks ..."; the default is the name.
    scope : Scope
        Not for effect files: where an effect that is named NAME@SCOPE acts.
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
    systems: tuple[str, ...] = ()
    wires: int = 1
    energy: str = ''
    description: str = ''
    signature: str = ''
    confused_with: tuple[str, ...] = ()
    same_as: str = ''
    title: str = ''
    scope: Scope = EVERYWHERE

    def __post_init__(self) -> None:
        if self.port not in PORT_NAMES:
            raise ValueError(f'effect {self.name!r}: port {self.port!r}; expected one of {", ".join(PORT_NAMES)}')
        if self.states and (self.rate is None or len(self.scale) != len(self.states)):
            raise ValueError(f'effect {self.name!r}: states need a rate and one scale each')
        stages = CHAIN.get(self.port)
        if stages and self.stage not in stages:
            raise ValueError(f'effect {self.name!r}: stage {self.stage!r}; expected one of {", ".join(stages)}')

    @property
    def plain_name(self) -> str:
        """The name without the scope."""
        return self.name.partition(SEPARATOR)[0]

    @property
    def scopes(self) -> tuple[Scope, ...]:
        """The parts of its places in which it can act alone."""
        return scopes_at(self.port, self.channels, bool(self.states))

    def in_scope(self, scope: Scope) -> Effect:
        """The same effect in one of its `scopes`."""
        return replace(
            self, name=f'{self.name}{SEPARATOR}{scope.name}', scope=scope, title=f'{self.phrase}, {scope.words}',
            channels=(scope.channel,) if scope.channel else self.channels,
        )  # fmt: skip

    @property
    def phrase(self) -> str:
        """What a sentence calls the effect."""
        return self.title or self.name.replace('_', ' ')

    @property
    def order(self) -> tuple[int, int]:
        """Number of the port, and of the stage in its chain: effects act in this order."""
        stages = CHAIN.get(self.port, ('',))
        return PORT_NAMES.index(self.port), stages.index(self.stage) if self.stage in stages else 0
