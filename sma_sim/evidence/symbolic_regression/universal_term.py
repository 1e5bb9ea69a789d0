"""One compiled effect per port that can be any term there: its parameters choose, so that no term compiles anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from sma_sim.evidence.estimation.injection_points import STIFFNESS
from sma_sim.evidence.symbolic_regression.code_generation import STIFFNESS_IMPORT, kernel_return, load_generated, port_lines
from sma_sim.evidence.symbolic_regression.locations import EVERY_WIRE, Location, locations_of_hook
from sma_sim.evidence.symbolic_regression.term_library import HAT_FUNCTION
from sma_sim.evidence.symbolic_regression.terms import MAX_SHAPES, Term
from sma_sim.model.effects.effect import Effect
from sma_sim.model.structures.structure import Structure

FILE_HEADER = '''\
"""All terms of one port, chosen by number, to see what the measured channels would show of each."""

import math

from sma_sim import Effect, Parameter
'''
WIRE_SELECTOR = '(1.0 if p.component < 0.0 or s.wire == p.component else 0.0)'
OF_STRUCTURES = ('structure_force', 'sensing')  # ports whose terms name coordinates


@dataclass(frozen=True)
class UniversalTerm:
    """A compiled effect that is any of `terms` at the locations of one port."""

    effect: Effect
    terms: tuple[Term, ...]

    def values(self, location: Location, term: Term, coefficient: float, shapes: Sequence[float]) -> dict[str, float]:
        """Its parameters for one term at one location."""
        number = float([*map(text_of, self.terms)].index(text_of(term)))
        chosen = {'term': number, 'component': float(location.component), 'c': coefficient}
        return chosen | {f'q_{k}': shape for k, shape in enumerate(shapes)}


def text_of(term: Term) -> tuple[str, str, str]:
    """What is compiled of a term: all but the values of its shapes, which follow from parameters."""
    return term.value, term.rate, term.start


@cache
def universal_term(hook: str, has_state: bool, on: Structure, copy: int = 0) -> UniversalTerm:
    """The effect for the terms of a port of a structure that have a state, or for those that have none.

    Formulas of several terms need as many copies.
    """
    candidates = [t for location in locations_of_hook(hook, on) for t in location.terms if bool(t.rate) == has_state]
    unique = {text_of(term): term for term in (candidates if has_state else [*candidates, HAT_FUNCTION])}
    own = f'_{on.name}' if hook in OF_STRUCTURES else ''
    name = f'any_{hook}{own}{"_with_memory" if has_state else ""}{copy or ""}'
    terms = tuple(unique.values())
    return UniversalTerm(load_generated(name, universal_file(name, hook, terms, has_state, on)), terms)


def return_expression(hook: str, value: str, on: Structure) -> str:
    """What the kernel returns for a value at the component that a parameter names."""
    if hook != 'structure_force':
        chosen = f'({value} if s.channel == p.component else 0.0)' if hook == 'sensing' else f'{WIRE_SELECTOR} * {value}'
        return kernel_return(hook, EVERY_WIRE, chosen, on)
    count = len(on.coordinates)
    if count == 1:
        return value
    each = f'({", ".join(f"{value} if p.component == {float(j)!r} else 0.0" for j in range(count))})'
    if all(location.component != STIFFNESS for location in locations_of_hook(hook, on)):
        return each
    return f'{kernel_return(hook, STIFFNESS, value, on)} if p.component == {float(STIFFNESS)!r} else {each}'


def universal_file(name: str, hook: str, terms: Sequence[Term], has_state: bool, on: Structure) -> str:
    """The file of such an effect."""
    read = 's, p, m' if has_state else 's, p'
    arguments = 's, w, p, m' if has_state else 's, w, p'
    parts = [FILE_HEADER, STIFFNESS_IMPORT if hook == 'structure_force' else '']
    parts.append(choice_function('value_of', read, [t.numbered('value') for t in terms]))
    lines = [f'name={name!r},', f'port={hook!r},', "equation='any term',", "source='',", 'parameters=(']
    names = ('term', 'component', *(f'q_{k}' for k in range(MAX_SHAPES)))
    lines += [f"    Parameter({parameter!r}, 0.5, '-', (-1e15, 1e15), '')," for parameter in names]
    lines += ["    Parameter('c', 0.0, '-', (-1e15, 1e15), '', '', 0.0),", '),']
    lines.append(f'kernel=lambda {arguments}: {return_expression(hook, f"p.c * value_of({read})", on)},')
    if has_state:
        parts.append(choice_function('rate_of', read, [t.numbered('rate') for t in terms]))
        parts.append(choice_function('start_of', 's, p', [t.numbered('start') for t in terms]))
        lines += [
            "states=('z',),",
            'scale=(0.1,),',
            'rate=lambda s, w, p, m: (rate_of(s, p, m),),',
            'start=lambda s, w, p: (start_of(s, p),),',
        ]
    lines += port_lines(hook, on)
    body = '\n'.join(f'    {line}' for line in lines)
    return ''.join(parts) + f'\n\nEFFECT = Effect(\n{body}\n)\n'


def choice_function(name: str, arguments: str, expressions: Sequence[str]) -> str:
    """A function that evaluates the expression number `p.term`."""
    lines = [f'\n\ndef {name}({arguments}):']
    for k, expression in enumerate(expressions):
        lines.append(f'    if p.term == {k}:\n        return {expression}')
    lines.append('    return 0.0\n')
    return '\n'.join(lines)
