"""What an effect is: one small file that declares it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from sma_sim.model.effects.ports import CHANNELS, PORT_NAMES
from sma_sim.model.effects.scope import EVERYWHERE, SEPARATOR, Scope, scopes_at
from sma_sim.model.errors import UserError
from sma_sim.model.nearest import suggestion
from sma_sim.model.parameters import Parameter, fault_of
from sma_sim.model.structures.module import STRUCTURE as MODULE
from sma_sim.model.structures.structure import Structure

CHAIN = {
    'actuation': ('gain', 'deadband', 'saturation', 'lag'),
    'wire_strain': ('', 'series'),
    'sensing': ('misalignment', 'gain', 'bias', 'lag', 'delay', 'noise'),
}
TRIED = ('everywhere', 'single wire', 'timed', 'never')
NEEDS = ('coordinate', 'joint', 'spring', 'stiffness', 'gravity')


@dataclass(frozen=True)
class EffectChoice:
    """An effect as it is to act: `values` of parameters by name (SI), the others at their defaults; `scope`: in which part.

    ``sma_sim.effects.gravity(g_y=-9.81)`` makes one.
    """

    effect: Effect
    values: Mapping[str, float]
    scope: str = ''

    @property
    def name(self) -> str:
        """NAME, or NAME@SCOPE."""
        return f'{self.effect.name}{SEPARATOR}{self.scope}' if self.scope else self.effect.name

    def __repr__(self) -> str:
        given = [*([f'scope={self.scope!r}'] if self.scope else []), *(f'{n}={v:g}' for n, v in self.values.items())]
        return f'{self.effect.name}({", ".join(given)})'


@dataclass(frozen=True, repr=False)
class Effect:
    """A physical effect, declared as data. Called, it says how it is to act: ``effect(k=2.0)``, an `EffectChoice`.

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
    needs : tuple of str
        What of a structure an effect on structure_force needs (NEEDS), in place of naming coordinates; it acts on every
        structure that has it. Kernels are then of one coordinate, ``s.q`` and its rate ``s.dq``, return one number, and
        the extra states are there once for each: with 'coordinate' in all, with 'joint' in those that a joint or a rail
        guides, with 'spring' in those of them that a spring of their own holds, its force and stiffness being ``s.f`` and
        ``s.k``. With 'stiffness' or 'gravity' the kernel is of all coordinates at once: ``s.q``, ``s.dq`` and the extra
        states have them by name, and the structure's function of that name is its last argument.
    by_channel : bool
        On sensing: one parameter for each channel, with its name, that the kernel sees as ``p.own``.
    systems : tuple of str
        The systems in which the effect has a meaning, in others it is left out; none are all with enough `wires` and with
        what it `needs`.
    wires : int
        How many wires it needs.
    tried : str
        Where a diagnosis looks for it, of where it acts: 'everywhere', on structures with a 'single wire', whose strain and
        stress an antagonist does not hide, where runs are 'timed', as what depends on speed, or 'never', as what belongs to
        a bench and is part of a model that says so.
    gradual : bool
        Whether it spreads the transformation over a range of temperatures: at a set stress and temperature samples then
        change smoothly with every parameter, while a sharp transformation passes them one by one.
    energy : str
        How the effect enters the energy balance.
    description, signature : str
        Remarks, and the trace that the effect leaves in measurements.
    confused_with : tuple of str
        What leaves nearly the same trace: effects, parameters by their full names, or the 'delay' of the recording.
    same_as : str
        What is identical in the equations, so that no measurement distinguishes it, in words.
    title, general_title : str
        A short phrase that completes "the model lacks ..."; the default is the name. The second is for structures that are
        no beam.
    scope, structure : Scope, Structure
        Not for effect files: where an effect that is named NAME@SCOPE acts, and on what.

    Raises
    ------
    UserError
        For a port, a stage or a need that there is not, and for parameters that contradict themselves.
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
    needs: tuple[str, ...] = ()
    by_channel: bool = False
    systems: tuple[str, ...] = ()
    wires: int = 1
    tried: str = 'everywhere'
    gradual: bool = False
    energy: str = ''
    description: str = ''
    signature: str = ''
    confused_with: tuple[str, ...] = ()
    same_as: str = ''
    title: str = ''
    general_title: str = ''
    scope: Scope = EVERYWHERE
    structure: Structure = field(default=MODULE, repr=False, hash=False)

    def __post_init__(self) -> None:
        if fault := self._fault():
            raise UserError(f'effect {self.name!r}: {fault}')

    def _fault(self) -> str:
        """What is wrong with the declaration, '' for nothing."""
        if self.port not in PORT_NAMES:
            return f'port {self.port!r}; expected one of {", ".join(PORT_NAMES)}'
        if self.tried not in TRIED:
            return f'tried {self.tried!r}; expected one of {", ".join(TRIED)}'
        if self.states and (self.rate is None or len(self.scale) != len(self.states)):
            return 'states need a rate and one scale each'
        for need in self.needs:
            if need not in NEEDS or self.port != 'structure_force':
                return f'needs {need!r} on {self.port}; expected some of {", ".join(NEEDS)}, on structure_force only'
        stages = CHAIN.get(self.port)
        if stages and self.stage not in stages:
            return f'stage {self.stage!r}; expected one of {", ".join(stages)}'
        return next(filter(None, map(fault_of, self.parameters)), '')

    def __call__(self, *, scope: str = '', **values: float) -> EffectChoice:
        """The effect at these values of its parameters (SI), all others at their defaults; `scope`: in one part only.

        Raises UserError for a parameter that it does not have.
        """
        names = [parameter.name for parameter in self.parameters]
        for name in values:
            if name not in names:
                known = ', '.join(f'{p.name} [{p.unit}]' for p in self.parameters)
                raise UserError(f'effect {self.name} has no parameter {name}{suggestion(name, names)}; it has {known}')
        return EffectChoice(self, values, scope)

    def __repr__(self) -> str:
        return f'Effect({self.name}: {self.equation})'

    @property
    def plain_name(self) -> str:
        """The name without the scope."""
        return self.name.partition(SEPARATOR)[0]

    @property
    def scopes(self) -> tuple[Scope, ...]:
        """The parts of its places in which it can act alone."""
        return scopes_at(self.port, self.channels, bool(self.states), self.structure)

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
