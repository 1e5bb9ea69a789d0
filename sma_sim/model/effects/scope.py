"""Where an effect acts: in each wire or in one, in each coordinate or in one, through a state that wires share; and in which
form.

A scope is a mask that the compiled kernels read beside the effect's parameters: no scope compiles anything. An effect in a
scope is named NAME@SCOPE. In another form its law is multiplied by a function of one field u of the state that it reads,

    exp(form_1 tanh r + form_2 r^2/(1 + r^2)),    r = u/form_width,

which is 1 at the neutral values and never changes a sign: friction that builds up with the speed in another way, or that
differs between the two directions, still dissipates. The odd part approaches its end as tanh does, the even one as a power:
so friction that builds up as tanh(v/v_s) becomes v/sqrt(v^2 + v_s^2) to 0.5 % of itself. Of a temperature u is what it is
above that of the surroundings.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from sma_sim.model.effects.ports import S_POSE, State
from sma_sim.model.parameters import Parameter
from sma_sim.model.structures.structure import Structure

SEPARATOR = '@'
MASK_SIZE = 4
MASK_WIRE, MASK_COORDINATE, MASK_SHARED, MASK_FIELD = range(MASK_SIZE)  # where the mask has them
EVERY = -1  # wire, or coordinate
NO_FIELD = -1.0
FORM = 'form_'  # begins the name of a form, and of its parameters
OWN_COORDINATE = {'q': 'change', 'dq': 'rate'}  # fields of kernels of one coordinate: quantities; a mask counts from S_POSE
FORM_SIZE = 3  # parameters of a form, which kernels read behind the mask
FORM_PORTS = ('wire_heat', 'wire_strain', 'transformation_stress', 'wire_force')  # and what acts on each coordinate
FORM_BOUNDS, FORM_REALISTIC = (-3.0, 3.0), (-0.5, 0.5)  # of the logarithm of a law's multiple
FORM_FIELDS: Mapping[str, tuple[str, str, tuple[float, float]]] = MappingProxyType(
    {  # what a law may depend on otherwise: in words, its unit, and over how much of it
        'T': ('the temperature', 'K', (3.0, 100.0)),
        'x': ('the phase fraction', '-', (0.1, 1.0)),
        'eps': ('the strain', '-', (2e-3, 0.05)),
        'deps': ('the strain rate', '1/s', (1e-4, 0.1)),
        'sigma': ('the stress', 'Pa', (1e7, 5e8)),
        'F': ('the force', 'N', (0.3, 30.0)),
        'v': ('the speed', 'm/s', (1e-5, 1e-2)),
    }
)


@dataclass(frozen=True)
class Scope:
    """A part of the places at which an effect can act.

    `words` complete "beam creep, ..."; `wire` and `coordinate` are indices, or EVERY; the wires share the extra states where
    `shared`; `channel` is that of a sensing effect; `field`: on which its law depends in another form, '' for the law as it
    is declared.
    """

    name: str
    words: str
    wire: int = EVERY
    coordinate: int = EVERY
    shared: bool = False
    channel: str = ''
    field: str = ''

    @property
    def mask(self) -> tuple[float, float, float, float]:
        """What kernels read of it."""
        return float(self.wire), float(self.coordinate), float(self.shared), self._field_code

    @property
    def _field_code(self) -> float:
        """By which number kernels know the field."""
        if self.field in OWN_COORDINATE:
            return float(S_POSE + [*OWN_COORDINATE].index(self.field))
        return float(State._fields.index(self.field)) if self.field else NO_FIELD

    def of(self, field: str) -> Scope:
        """The same scope in another form of the law."""
        name, words = f'{FORM}{field}', f'as another function of {words_of(field)}'
        if self.name:
            name, words = f'{self.name}_{name}', f'{self.words}, {words}'
        return replace(self, name=name, words=words, field=field)


EVERYWHERE = Scope('', '')


def scopes_at(port: str, channels: tuple[str, ...], has_states: bool, structure: Structure) -> tuple[Scope, ...]:
    """The scopes on a structure of an effect on a port, which senses `channels`.

    What wires can share lies outside them: heat.
    """
    if port == 'structure_force':
        words = [coordinate.motion or coordinate.name for coordinate in structure.coordinates]
        scopes = [Scope(word, f'in {word} only', coordinate=j) for j, word in enumerate(words)]
    elif port == 'sensing':
        return tuple(Scope(name, f'in {name} only', channel=name) for name in channels)
    else:
        scopes = [Scope(f'wire_{i + 1}', f'in wire {i + 1} only', wire=i) for i in range(structure.wires)]
        if port == 'wire_heat' and has_states:
            every = 'both' if structure.wires == 2 else 'all'
            scopes.append(Scope('shared', f'through a state that {every} wires share', shared=True))
    return tuple(scopes)


def words_of(field: str) -> str:
    """What a sentence calls a field on which the law of an effect may depend in another form."""
    return FORM_FIELDS[field][0] if field in FORM_FIELDS else {'q': 'the coordinate', 'dq': 'the speed'}[field]


def law_name(name: str) -> str:
    """Of the name of an effect, NAME or NAME@SCOPE, that of the same law as it is declared."""
    plain, separator, scope = name.partition(SEPARATOR)
    place = scope.partition(FORM)[0].rstrip('_')
    return f'{plain}{separator}{place}' if place else plain


def form_parameters(field: str, declared: Iterable[Parameter]) -> tuple[Parameter, ...]:
    """The parameters of another form of a law that has the `declared` ones; none without a width.

    If one of these is a shape of the size of the field, laws differ over as much of it; fields of coordinates need that, as
    these have any unit.
    """
    shapes = [p for p in declared if p.neutral is None and p.realistic]
    if field in OWN_COORDINATE:
        alike = [p for p in shapes if p.quantity == OWN_COORDINATE[field]]
    else:
        alike = [p for p in shapes if p.unit == FORM_FIELDS[field][1] != '-']
    if len(alike) != 1 and field in OWN_COORDINATE:
        return ()
    unit, between = (alike[0].unit, alike[0].realistic) if len(alike) == 1 else FORM_FIELDS[field][1:]
    low, high = between or (1.0, 1.0)
    words = words_of(field)
    odd, even = (f'logarithm of the multiple of the law, what is {part} in {words}' for part in ('odd', 'even'))
    width = words.removeprefix('the ') + ' over which the form changes'
    return (
        Parameter('form_1', 0.0, '-', FORM_BOUNDS, odd, '', 0.0, FORM_REALISTIC),
        Parameter('form_2', 0.0, '-', FORM_BOUNDS, even, '', 0.0, FORM_REALISTIC),
        Parameter('form_width', (low * high) ** 0.5, unit, (low * 1e-2, high * 1e2), width, '', None, (low, high)),
    )
