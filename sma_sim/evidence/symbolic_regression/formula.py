"""A formula of one to a few terms at one place as an effect: its parameters, its equation, its file."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, replace

from sma_sim.evidence.estimation.injection_points import STIFFNESS
from sma_sim.evidence.symbolic_regression.augmented_fit import POSITIVE
from sma_sim.evidence.symbolic_regression.code_generation import common_lines, effect_of, located
from sma_sim.evidence.symbolic_regression.locations import Place
from sma_sim.evidence.symbolic_regression.term_fits import TermFit
from sma_sim.evidence.symbolic_regression.terms import Shape, Term, factor, per_unit
from sma_sim.model.effects.discovery import FoundEffect
from sma_sim.model.parameters import Parameter

SOURCE = 'proposed by sma-sim diagnose from recordings: a formula that fits, not a law that is known'
FITTED = 'fitted to recordings'
QUANTITIES = {
    'wire_heat': 'Q', 'wire_strain': 'e', 'transformation_stress': 's_A = s_M', 'actuation': 'P', 'sensing': 'shown',
}  # fmt: skip
COORDINATES = ('F_x', 'F_y', 'M', 'F')
FAR = 1e3  # bounds of a coefficient, times its value
ROUGH = 3  # digits of bounds and ranges
LONG = 60  # letters of an expression that gets a function of its own


@dataclass(frozen=True)
class Formula:
    """Terms at one place with names for their parameters: coefficients c (c_1, c_2, ...), then the shapes."""

    guesses: tuple[TermFit, ...]

    @property
    def place(self) -> Place:
        """Where it acts."""
        return self.guesses[0].place

    @property
    def terms(self) -> tuple[Term, ...]:
        """Its terms."""
        return tuple(guess.term for guess in self.guesses)

    @property
    def name(self) -> str:
        """The name of the effect."""
        return '_'.join(['proposed', self.place.name, *(term.name for term in self.terms)])

    @property
    def variables(self) -> tuple[str, ...]:
        """The states that it depends on."""
        bent = ('alpha',) if self.along_stiffness else ()
        return tuple(dict.fromkeys([*bent, *(name for term in self.terms for name in term.variables)]))

    @property
    def along_stiffness(self) -> bool:
        """Whether it is a part of the beam's stiffness."""
        return (self.place.hook, self.place.component) == ('structure_force', STIFFNESS)

    def coefficient(self, k: int) -> str:
        """The name of the coefficient of term k."""
        return 'c' if len(self.guesses) == 1 else f'c_{k + 1}'

    @property
    def names(self) -> list[dict[str, str]]:
        """Per term its shapes' names in the file, numbered where two terms share one."""
        taken: set[str] = set()
        found = []
        for term in self.terms:
            names = {}
            for shape in term.shapes:
                name, k = shape.name, 2
                while name in taken:
                    name, k = f'{shape.name}_{k}', k + 1
                taken.add(name)
                names[shape.name] = name
            found.append(names)
        return found

    def unit(self, text: str) -> str:
        """A unit in which 'unit' stands for that of the shown value."""
        return re.sub(r'\bunit\b', self.place.unit, text)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Declarations, with the values as defaults."""
        found = []
        for k, guess in enumerate(self.guesses):
            far = rounded(FAR * abs(guess.amount), ROUGH)
            unit = self.unit(per_unit(self.place.unit, guess.term.unit))
            found.append(Parameter(self.coefficient(k), rounded(guess.amount), unit, (-far, far), 'coefficient', '', 0.0))
        for guess, names in zip(self.guesses, self.names, strict=True):
            for shape, value, limits in zip(guess.term.shapes, guess.shapes, guess.limits, strict=True):
                found.append(self.declared(names[shape.name], shape, rounded(value), limits))
        return tuple(found)

    def declared(self, name: str, shape: Shape, value: float, limits: tuple[float, float]) -> Parameter:
        """One shape parameter; realistic is what these recordings could tell."""
        low, high = min(rounded(limits[0], ROUGH), value), max(rounded(limits[1], ROUGH), value)
        room = high - low
        bounds = (low / 10.0, high * 10.0) if shape.grid in POSITIVE else (low - room, high + room)
        bounds = (rounded(bounds[0], ROUGH), rounded(bounds[1], ROUGH))
        return Parameter(name, value, self.unit(shape.unit), bounds, shape.description, '', None, (low, high))

    def with_values(self, values: Mapping[str, float]) -> Formula:
        """The same with the parameters (by their names in the file) at these values."""
        guesses = []
        for k, (guess, names) in enumerate(zip(self.guesses, self.names, strict=True)):
            shapes = tuple(values[names[shape.name]] for shape in guess.term.shapes)
            guesses.append(replace(guess, amount=values[self.coefficient(k)], shapes=shapes))
        return Formula(tuple(guesses))

    @property
    def states(self) -> list[str]:
        """Per term the name of its extra state, '' for none."""
        several = sum(bool(term.rate) for term in self.terms) > 1
        return [(f'z_{k + 1}' if several else 'z') if term.rate else '' for k, term in enumerate(self.terms)]

    def text_of(self, k: int, what: str) -> str:
        """An expression of term k with the names of the file."""
        text = self.terms[k].text(what, **{shape: f'p.{name}' for shape, name in self.names[k].items()})
        return text.replace('m.z', f'm.{self.states[k]}') if self.terms[k].rate else text

    @property
    def sum(self) -> str:
        """All terms with their coefficients."""
        parts = [product(f'p.{self.coefficient(k)}', self.text_of(k, 'value')) for k in range(len(self.terms))]
        return f'({" + ".join(parts)})' if len(parts) > 1 else parts[0]

    @property
    def equation(self) -> str:
        """For people: what is added where."""
        place = self.place
        symbol = COORDINATES[place.component] if place.hook == 'structure_force' else QUANTITIES[place.hook]
        before = {'actuation': 'J + ', 'sensing': 'value + '}.get(place.hook, '')
        after = ' K q' if self.along_stiffness else ''
        rates = [f'd{state}/dt = {plain(self.text_of(k, "rate"))}' for k, state in enumerate(self.states) if state]
        where = f' ({place.description})'
        return '; '.join([f'{symbol} = {before}{plain(self.sum)}{after}', *rates]) + where

    def found(self) -> FoundEffect:
        """The effect, loaded from a folder of the user's cache."""
        return effect_of(self.name, self.text())

    def text(self, origin: str = SOURCE) -> str:
        """The effect file."""
        place = self.place
        constants = 'b' if place.hook == 'structure_force' else 'w'
        arguments = f's, {constants}, p, m' if any(self.states) else f's, {constants}, p'
        apart = place.hook == 'transformation_stress' or self.along_stiffness or len(self.sum) > LONG
        kernel = located(place, f'quantity({arguments})' if apart else self.sum, constants)
        words = f'"""{place.description.capitalize()} [{place.unit}]."""'
        body = f'\n\ndef quantity({arguments}):\n    {words}\n    return {self.sum}\n\n' if apart else ''
        lines = [
            f'name={self.name!r},', f'port={place.hook!r},', *folded('equation', self.equation), *folded('source', origin),
            'parameters=(', *(f'    {line}' for p in self.parameters for line in declaration(p)), '),',
            *self.memory_lines(arguments, constants),
            f'kernel=lambda {arguments}: {kernel},', *common_lines(place.hook, place.component),
        ]  # fmt: skip
        effect = '\n'.join(f'    {line}' for line in lines)
        imports = 'import math\n\n' if 'math.' in effect + body else ''
        head = '\n\n'.join('\n'.join(textwrap.wrap(one, 110)) for one in (place.description.capitalize() + ', proposed.',
                                                                          self.equation, origin))  # fmt: skip
        return f'"""{head}\n"""\n\n{imports}from sma_sim import Effect, Parameter\n{body}\nEFFECT = Effect(\n{effect}\n)\n'

    def memory_lines(self, arguments: str, constants: str) -> list[str]:
        """States, their scales, rates and first values."""
        kept = [k for k, state in enumerate(self.states) if state]
        if not kept:
            return []
        starts = [self.text_of(k, 'start') for k in kept]
        lines = [
            f'states=({", ".join(repr(self.states[k]) for k in kept)},),',
            f'scale=({", ".join(repr(self.terms[k].scale) for k in kept)},),',
            f'rate=lambda {arguments}: ({", ".join(self.text_of(k, "rate") for k in kept)},),',
        ]
        return lines if set(starts) == {'0.0'} else [*lines, f'start=lambda s, {constants}, p: ({", ".join(starts)},),']


def product(coefficient: str, value: str) -> str:
    """A coefficient times a value."""
    return coefficient if value == '1.0' else f'{coefficient} * {factor(value)}'


def plain(text: str) -> str:
    """An expression for people to read."""
    return re.sub(r'\b(\d+)\.0\b', r'\1', re.sub(r'\b(s|p|m|math)\.', '', text).replace(' ** ', '^'))


def declaration(p: Parameter) -> list[str]:
    """The lines that declare a parameter in the file."""
    rest = f'{p.description!r}, {FITTED!r}, {p.neutral!r}'
    end = ')' if p.realistic is None else f', {p.realistic!r})'
    return ['Parameter(', f'    {p.name!r}, {p.default!r}, {p.unit!r}, {p.bounds!r},', f'    {rest}{end},']


def folded(name: str, words: str) -> list[str]:
    """``name='words',`` on lines that are not too long."""
    if len(words) < 100:
        return [f'{name}={words!r},']
    parts = textwrap.wrap(words, 100, drop_whitespace=False)
    return [f'{name}=(', *(f'    {part!r}' for part in parts), '),']


def rounded(value: float, digits: int = 6) -> float:
    """As many digits as a file needs."""
    return float(f'{value:.{digits}g}')
