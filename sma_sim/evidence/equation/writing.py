"""Writes the effect file of a formula."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from sma_sim.evidence.equation.places import BOTH_WIRES, STAGES, STIFFNESS, Place
from sma_sim.evidence.equation.terms import Term, per_unit
from sma_sim.model.effects.library import FoundEffect, find_effects
from sma_sim.model.effects.ports import CHANNELS
from sma_sim.solver.compile import cache_folder



def located(place: Place, value: str, constants: str = 'w') -> str:
    """What the kernel of an effect at a place returns for a value there."""
    if place.hook == 'structure_force':
        if place.component == STIFFNESS:
            b = constants
            return (
                f'({value} * {b}.k_x * s.U_x, {value} * ({b}.k_y * s.U_y - {b}.k_ya * s.alpha), '
                f'{value} * ({b}.k_a * s.alpha - {b}.k_ya * s.U_y))'
            )
        return '(' + ', '.join(value if k == place.component else '0.0' for k in range(3)) + ')'
    if place.hook == 'sensing':
        return f's.value + {value}'
    if place.component != BOTH_WIRES:
        value = f'{"s.wire" if place.component == 1 else "(1.0 - s.wire)"} * {value}'
    if place.hook == 'actuation':
        return f's.J + {value}'
    return f'({value}, {value})' if place.hook == 'transformation_stress' else value


def folder_with(name: str, text: str) -> Path:
    """A folder of the user's cache that holds one effect file with this text, and nothing else."""
    folder = cache_folder(f'formula-{sha256((name + text).encode()).hexdigest()[:20]}')
    file = folder / f'{name}.py'
    if not file.exists() or file.read_text() != text:
        partial = file.with_suffix('.part')
        partial.write_text(text)
        partial.replace(file)
    return folder


def effect_in(name: str, folder: Path) -> FoundEffect:
    """The effect of that name in a folder."""
    return find_effects([folder])[name]


def common_lines(hook: str, component: int | None = None) -> list[str]:
    """The lines of an effect that follow from its port (on sensing: from its channel)."""
    lines = [f'stage={STAGES[hook]!r},'] if hook in STAGES else []
    if hook == 'sensing' and component is not None:
        lines.append(f'channels=({CHANNELS[component]!r},),')
    if hook == 'structure_force':
        lines.append("systems=('module',),")
    return lines


def wrapped(words: str) -> str:
    """A line of a docstring, not too long."""
    return '\n'.join(textwrap.wrap(words, 110))


def names_for(terms: Sequence[Term]) -> list[dict[str, str]]:
    """Per term its shapes' names in the file, numbered where two terms share one."""
    taken: set[str] = set()
    found = []
    for term in terms:
        names = {}
        for shape in term.shapes:
            name, k = shape.name, 2
            while name in taken:
                name, k = f'{shape.name}_{k}', k + 1
            taken.add(name)
            names[shape.name] = name
        found.append(names)
    return found


@dataclass(frozen=True)
class Written:
    """One parameter of a formula as it stands in its file."""

    name: str
    value: float
    unit: str
    bounds: tuple[float, float]
    description: str
    neutral: float | None
    realistic: tuple[float, float] | None

    @property
    def line(self) -> str:
        """Its declaration."""
        return (
            f'        Parameter({self.name!r}, {self.value!r}, {self.unit!r}, {self.bounds!r}, {self.description!r}, '
            f"'', {self.neutral!r}, {self.realistic!r}),"
        )


def formula_text(
    name: str, place: Place, terms: Sequence[Term], parameters: Sequence[Written], equation: str, origin: str
) -> str:
    """The effect file of a formula; `parameters` in the order coefficients, then shapes term by term."""
    names = names_for(terms)
    constants = 'b' if place.hook == 'structure_force' else 'w'
    memory = [k for k, term in enumerate(terms) if term.rate]
    arguments = f's, {constants}, p, m' if memory else f's, {constants}, p'
    total = ' + '.join(f'p.{coefficient(k, terms)} * ({text_of(terms, names, k, "value")})' for k in range(len(terms)))
    value = f'({total})' if len(terms) > 1 else total
    if place.hook == 'transformation_stress' or place.component == STIFFNESS:
        kernel, helper = located(place, 'formula(' + arguments + ')', constants), True
    else:
        kernel, helper = located(place, value, constants), False
    head = f'"""{wrapped(f"Proposed from recordings: {place.description}.")}\n\n{wrapped(equation)}\n\n{wrapped(origin)}\n"""\n'
    body = f'\n\ndef formula({arguments}):\n    """The proposed quantity."""\n    return {value}\n' if helper else ''
    lines = [f'name={name!r},', f'port={place.hook!r},', f'equation={equation!r},', f'source={origin!r},', 'parameters=(']
    text = '\n'.join(f'    {line}' for line in lines) + '\n' + '\n'.join(one.line for one in parameters) + '\n    ),\n'
    rest = [f'kernel=lambda {arguments}: {kernel},', *memory_lines(terms, names, memory, arguments, constants), *common_lines(place.hook, place.component)]
    text += '\n'.join(f'    {line}' for line in rest)
    imports = '\nimport math\n' if 'math.' in value + ''.join(rest) else ''
    return f'{head}{imports}\nfrom sma_sim import Effect, Parameter\n{body}\nEFFECT = Effect(\n{text}\n)\n'


def coefficient(k: int, terms: Sequence[Term]) -> str:
    """The name of the coefficient of a term."""
    return 'c' if len(terms) == 1 else f'c_{k + 1}'


def memory_lines(
    terms: Sequence[Term], names: Sequence[Mapping[str, str]], memory: Sequence[int], arguments: str, constants: str
) -> list[str]:
    """States, their scales, rates and first values."""
    if not memory:
        return []
    states = ', '.join(repr(state_of(terms, k)) for k in memory)
    rates = ', '.join(text_of(terms, names, k, 'rate') for k in memory)
    starts = ', '.join(text_of(terms, names, k, 'start') for k in memory)
    lines = [f'states=({states},),', f'scale=({", ".join(repr(terms[k].scale) for k in memory)},),',
             f'rate=lambda {arguments}: ({rates},),']  # fmt: skip
    return lines if set(starts) <= set('0., ') else [*lines, f'start=lambda s, {constants}, p: ({starts},),']


def state_of(terms: Sequence[Term], k: int) -> str:
    """The name of the extra state of a term."""
    return 'z' if sum(bool(term.rate) for term in terms) == 1 else f'z_{k + 1}'


def text_of(terms: Sequence[Term], names: Sequence[Mapping[str, str]], k: int, what: str) -> str:
    """An expression of a term with the names of the file."""
    text = terms[k].text(what, **{shape: f'p.{name}' for shape, name in names[k].items()})
    return text.replace('m.z', f'm.{state_of(terms, k)}')


def coefficient_units(place: Place, terms: Sequence[Term]) -> list[str]:
    """The unit of each coefficient."""
    return [per_unit(place.unit, term.unit) for term in terms]
