"""What an effect is: one small file that declares it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

from sma_sim.model.argument_checks import check_fields, expect
from sma_sim.model.effects.ports import CHANNELS, PORT_NAMES
from sma_sim.model.effects.scope import (
    EVERYWHERE,
    FORM_FIELDS,
    FORM_PORTS,
    OWN_COORDINATE,
    SEPARATOR,
    Scope,
    form_parameters,
    scopes_at,
)
from sma_sim.model.errors import UserError
from sma_sim.model.nearest import suggestion
from sma_sim.model.parameters import Parameter, fault_of
from sma_sim.model.renamed import itself
from sma_sim.model.structures.module import STRUCTURE as MODULE
from sma_sim.model.structures.structure import Structure

CHAIN = {
    'actuation': ('gain', 'deadband', 'saturation', 'lag'),
    'wire_strain': ('', 'series'),
    'sensing': ('misalignment', 'gain', 'bias', 'lag', 'delay', 'noise'),
}
TRIED = ('everywhere', 'single wire', 'timed', 'never')
WIRE_CHANNELS = ('F', 'T', 'R')  # kinds of channels that every wire has
NEEDS = ('coordinate', 'joint', 'spring', 'stiffness', 'gravity')


class EachBundle(NamedTuple):
    """A parameter of each bundle of a structure that has several.

    Attributes
    ----------
    parameter : Parameter
        Its declaration; that of bundle 2 is named with ``_2`` behind the name.
    first, fewest : int
        Bundles have it from number `first` on, on structures that have `fewest` of them or more.
    """

    parameter: Parameter
    first: int
    fewest: int

    def has(self, name: str) -> bool:
        """Whether a parameter of this name is that of a bundle."""
        plain, _, number = name.rpartition('_')
        return plain == self.parameter.name and number.isdigit() and int(number) >= self.first

    def numbers(self, bundles: int) -> range:
        """The numbers of the bundles that have it, of so many."""
        return range(self.first, bundles + 1) if bundles >= self.fewest else range(0)


def kind_of(channel: str) -> str:
    """The kind of a channel of a wire, such as F for F_1; '' of others."""
    kind, _, number = channel.rpartition('_')
    return kind if kind in WIRE_CHANNELS and number.isdigit() else ''


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
        values = (f'{n}={v:g}' if isinstance(v, float | int) else f'{n}={v!r}' for n, v in self.values.items())
        given = [*([f'scope={self.scope!r}'] if self.scope else []), *values]
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
    kernels : tuple of (str, callable)
        Kernels that take the place of `kernel` on some systems, by name: on those that have other coordinates.
    states, scale : tuple
        Names of the extra states, and what they usually change by (relative to its channel on sensing): for the error
        control, and for where they may be when a recording does not begin at rest.
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
        On sensing: the parameters that have the name of a channel, or of a kind of channels (``F`` for all ``F_1``,
        ``F_2``, ...), are of these channels: the kernel sees that of its own as ``p.own``, and all others by name.
    clock : callable, optional
        On sensing, in place of acting on values: ``clock(t, p)`` is the time [s] since the beginning of the run at which
        the sensors saw what is shown at t, (k,) each.
    in_space : tuple of Parameter
        Further parameters on a structure that gravity also moves along z; elsewhere kernels see their neutral values.
    each_bundle : tuple of EachBundle
        Further parameters on structures of several bundles, one for each, which the kernel of a wire sees under the plain
        name (of bundle 2 ``gain_2`` as ``p.gain``). Other wires see the parameter of that name, or without one the neutral
        value.
    systems : tuple of str
        The systems in which the effect has a meaning, in others it is left out; none are all with enough `wires` and with
        what it `needs`.
    wires : int
        How many wires it needs.
    straight : bool
        Whether it needs straight wires: what their ends, guides and lengths do, but not those of coils, which are twisted.
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
    title, general_title, single_title : str
        A short phrase that completes "the model lacks ..."; the default is the name. The second is for structures that are
        no beam, the third for those with one wire.
    scope, structure : Scope, Structure
        Not for effect files: where an effect that is named NAME@SCOPE acts, and on what.
    files : tuple of Path
        Not for effect files: those that its native code depends on, beside the package's own.
    plain : Effect, optional
        Of one in a scope, or on a structure: the effect as it is declared, whose kernels it shares.

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
    kernels: tuple[tuple[str, Callable[..., Any]], ...] = ()
    states: tuple[str, ...] = ()
    scale: tuple[float, ...] = ()
    rate: Callable[..., Any] | None = None
    start: Callable[..., Any] | None = None
    stage: str = ''
    channels: tuple[str, ...] = CHANNELS
    needs: tuple[str, ...] = ()
    by_channel: bool = False
    clock: Callable[..., Any] | None = None
    in_space: tuple[Parameter, ...] = ()
    each_bundle: tuple[EachBundle, ...] = ()
    systems: tuple[str, ...] = ()
    wires: int = 1
    straight: bool = False
    tried: str = 'everywhere'
    gradual: bool = False
    energy: str = ''
    description: str = ''
    signature: str = ''
    confused_with: tuple[str, ...] = ()
    same_as: str = ''
    title: str = ''
    general_title: str = ''
    single_title: str = ''
    scope: Scope = EVERYWHERE
    structure: Structure = MODULE
    files: tuple[Path, ...] = field(default=(), compare=False)
    plain: Effect | None = field(default=None, init=False, compare=False)
    effect = itself('effect')

    def __post_init__(self) -> None:
        expect('name', self.name, str)
        check_fields(self, f'effect {self.name!r}, ')
        if fault := self._fault():
            raise UserError(f'effect {self.name!r}: {fault}')

    def _fault(self) -> str:
        """What is wrong with the declaration, '' for nothing."""
        if not self.plain_name.isidentifier() or (self.scope == EVERYWHERE and SEPARATOR in self.name):
            return 'expected a name of letters, digits and _'
        names = [getattr(one, 'name', '') for one in self.parameters]
        if doubled := next((name for name in names if names.count(name) > 1), ''):
            return f'parameter {doubled} is there twice; give each a name of its own'
        if pointed := next((name for name in names if '.' in str(name)), ''):
            return f'parameter {pointed!r}: expected a name of letters, digits and _, without a group'
        if self.port not in PORT_NAMES:
            return f'port {self.port!r}; expected one of {", ".join(PORT_NAMES)}'
        if self.tried not in TRIED:
            return f'tried {self.tried!r}; expected one of {", ".join(TRIED)}'
        if self.states and (self.rate is None or len(self.scale) != len(self.states)):
            return 'states need a rate and one scale each'
        for need in self.needs:
            if need not in NEEDS or self.port != 'structure_force':
                return f'needs {need!r} on {self.port}; expected some of {", ".join(NEEDS)}, on structure_force only'
        stages = CHAIN.get(self.port, ('',))
        if self.stage not in stages:
            known = f'one of {", ".join(one or "none" for one in stages)}' if len(stages) > 1 else 'none'
            return f'stage {self.stage!r} on {self.port}; expected {known}'
        if self.wires < 1:
            return f'wires = {self.wires}; expected how many it needs, 1 or more'
        if not all(0.0 < scale < inf for scale in self.scale):
            return f'scale {self.scale}; expected usual changes of the states, more than 0'
        return next(filter(None, map(fault_of, self.parameters)), '')

    def __call__(self, *unnamed: object, scope: str = '', **values: float) -> EffectChoice:
        """The effect at these values of its parameters (SI), all others at their defaults; `scope`: in one part only.

        Raises UserError for a parameter that it does not have, and for values without a name.
        """
        names = [parameter.name for parameter in self.parameters]
        if unnamed:
            raise UserError(f'effect {self.name}: expected values by name ({", ".join(names)}), got {unnamed[0]!r}')
        names += [parameter.name for parameter in self.in_space]
        for name in values:
            if name not in names and not any(each.has(name) for each in self.each_bundle):
                known = ', '.join(f'{p.name} [{p.unit}]' for p in self.parameters)
                raise UserError(f'effect {self.name} has no parameter {name}{suggestion(name, names)}; it has {known}')
        return EffectChoice(self, values, scope)

    def __repr__(self) -> str:
        return f'Effect({self.name}: {self.equation})'

    def __hash__(self) -> int:
        """Of what tells effects apart nearly always: it is asked for with every model."""
        return hash(self.name)

    @property
    def is_own(self) -> bool:
        """Whether its kernel is not of this package."""
        return not str(self.kernel.__module__).startswith('sma_sim.')

    def __deepcopy__(self, memo: Any) -> Effect:
        return self  # nothing of it changes

    def derived(self, **changes: Any) -> Effect:
        """The effect in other words, on another structure or in a scope: it shares the kernels of the declared one."""
        made = replace(self, **changes)
        object.__setattr__(made, 'plain', self.plain or self)
        return made

    def of_channel(self, channel: str) -> Parameter | None:
        """The parameter of a channel, where they are `by_channel`: by its name, or by that of its kind."""
        named = {parameter.name: parameter for parameter in self.parameters}
        return named.get(channel) or named.get(kind_of(channel))

    def is_seen(self, parameter: str, measured: Collection[str]) -> bool:
        """Whether a parameter is not of a channel, or of one that is `measured`."""
        shared = not self.by_channel or any(parameter == p.name for p in self.shared_parameters)
        return shared or parameter in measured or parameter in map(kind_of, measured)

    @property
    def shared_parameters(self) -> tuple[Parameter, ...]:
        """The parameters that are of no channel, nor of a bundle."""
        if not self.by_channel:
            return self.parameters
        known = {*CHANNELS, *self.structure.channels}
        known |= {kind_of(channel) for channel in known}
        return tuple(parameter for parameter in self.parameters if parameter.name not in known)

    @property
    def plain_name(self) -> str:
        """The name without the scope."""
        return self.name.partition(SEPARATOR)[0]

    @property
    def scopes(self) -> tuple[Scope, ...]:
        """The parts of its places in which it can act alone."""
        return scopes_at(self.port, self.channels, bool(self.states), self.structure)

    @property
    def forms(self) -> tuple[Scope, ...]:
        """The other forms that its law may have, everywhere and in each of its scopes: as functions of what its kernel may
        read. Laws that have parameters of their own for bundles, and those of all coordinates at once, have none."""
        on_wires = self.port in FORM_PORTS
        on_coordinates = bool(self.needs) and not {'stiffness', 'gravity'} & {*self.needs}
        if not (on_wires or on_coordinates) or self.each_bundle or self.in_space:
            return ()
        every = FORM_FIELDS if on_wires else OWN_COORDINATE
        fields = [field for field in every if form_parameters(field, self.parameters)]
        scopes = (self.scope,) if self.scope.name else (EVERYWHERE, *self.scopes)
        return tuple(scope.of(field) for scope in scopes for field in fields if not (scope.shared or scope.field))

    def in_scope(self, scope: Scope) -> Effect:
        """The same effect in one of its `scopes`, or `forms`; one in a scope in another form there."""
        own = form_parameters(scope.field, self.parameters) if scope.field else ()
        words = scope.words.removeprefix(f'{self.scope.words}, ')
        return self.derived(
            name=f'{self.plain_name}{SEPARATOR}{scope.name}',
            scope=scope,
            title=f'{self.phrase}, {words}',
            channels=(scope.channel,) if scope.channel else self.channels,
            parameters=(*self.parameters, *own),
        )

    @property
    def phrase(self) -> str:
        """What a sentence calls the effect."""
        return self.title or self.name.replace('_', ' ')

    @property
    def only_shows(self) -> bool:
        """Whether it changes what sensors show, and neither what the robot does nor when it is seen."""
        return self.port == 'sensing' and not self.states and self.clock is None

    @property
    def order(self) -> tuple[int, int]:
        """Number of the port, and of the stage in its chain: effects act in this order."""
        stages = CHAIN.get(self.port, ('',))
        return PORT_NAMES.index(self.port), stages.index(self.stage) if self.stage in stages else 0
