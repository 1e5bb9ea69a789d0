"""One compiled effect per port that can be any term there: its parameters choose, so that no term compiles anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from sma_sim.evidence.estimation.injection_points import STIFFNESS
from sma_sim.evidence.symbolic_regression.code_generation import STIFFNESS_IMPORT, load_generated, port_lines
from sma_sim.evidence.symbolic_regression.locations import Location, locations_of_hook
from sma_sim.evidence.symbolic_regression.term_library import HAT_FUNCTION
from sma_sim.evidence.symbolic_regression.terms import MAX_SHAPES, Term
from sma_sim.model.effects.discovery import FoundEffect

FILE_HEADER = '''\
"""All terms of one port, chosen by number, to see what the measured channels would show of each."""

import math

from sma_sim import Effect, Parameter
'''
WIRE_SELECTOR = '(1.0 if p.component < 0.0 else s.wire if p.component > 0.0 else 1.0 - s.wire)'
RETURN_EXPRESSIONS = {
    'structure_force': f'stiffness_forces(s.U_x, s.U_y, s.alpha, w, VALUE) if p.component > {STIFFNESS - 0.5} else ('
    '(VALUE, 0.0, 0.0) if p.component < 0.5 else (0.0, VALUE, 0.0) if p.component < 1.5 else (0.0, 0.0, VALUE))',
    'sensing': 's.value + (VALUE if s.channel == p.component else 0.0)',
    'actuation': f's.J + {WIRE_SELECTOR} * VALUE',
    'wire_heat': f'{WIRE_SELECTOR} * VALUE',
    'wire_strain': f'{WIRE_SELECTOR} * VALUE',
    'transformation_stress': f'({WIRE_SELECTOR} * VALUE, {WIRE_SELECTOR} * VALUE)',
}


@dataclass(frozen=True)
class UniversalTerm:
    """A compiled effect that is any of `terms` at the locations of one port."""

    found: FoundEffect
    terms: tuple[Term, ...]

    def values(self, location: Location, term: Term, coefficient: float, shapes: Sequence[float]) -> dict[str, float]:
        """Its parameters for one term at one location."""
        numbered = {f'q_{k}': shape for k, shape in enumerate(shapes)}
        return {
            'term': float(self.terms.index(term)), 'component': float(location.component), 'c': coefficient, **numbered,
        }  # fmt: skip


@cache
def universal_term(hook: str, has_state: bool, copy: int = 0) -> UniversalTerm:
    """The effect for the terms of a port that have a state, or for those that have none.

    Formulas of several terms need as many copies.
    """
    candidates = [t for location in locations_of_hook(hook) for t in location.terms if bool(t.rate) == has_state]
    terms = tuple(dict.fromkeys(candidates if has_state else [*candidates, HAT_FUNCTION]))
    name = f'any_{hook}{"_with_memory" if has_state else ""}{copy or ""}'
    return UniversalTerm(load_generated(name, universal_file(name, hook, terms, has_state)), terms)


def universal_file(name: str, hook: str, terms: Sequence[Term], has_state: bool) -> str:
    """The file of such an effect."""
    read = 's, p, m' if has_state else 's, p'
    arguments = 's, w, p, m' if has_state else 's, w, p'
    value = f'p.c * value_of({read})'
    parts = [FILE_HEADER, STIFFNESS_IMPORT if hook == 'structure_force' else '']
    parts.append(choice_function('value_of', read, [numbered_text(t, 'value') for t in terms]))
    lines = [f'name={name!r},', f'port={hook!r},', "equation='any term',", "source='',", 'parameters=(']
    names = ('term', 'component', *(f'q_{k}' for k in range(MAX_SHAPES)))
    lines += [f"    Parameter({parameter!r}, 0.5, '-', (-1e15, 1e15), '')," for parameter in names]
    lines += ["    Parameter('c', 0.0, '-', (-1e15, 1e15), '', '', 0.0),", '),']
    lines.append(f'kernel=lambda {arguments}: {RETURN_EXPRESSIONS[hook].replace("VALUE", value)},')
    if has_state:
        parts.append(choice_function('rate_of', read, [numbered_text(t, 'rate') for t in terms]))
        parts.append(choice_function('start_of', 's, p', [numbered_text(t, 'start') for t in terms]))
        lines += ["states=('z',),", 'scale=(0.1,),', 'rate=lambda s, w, p, m: (rate_of(s, p, m),),',
                  'start=lambda s, w, p: (start_of(s, p),),']  # fmt: skip
    lines += port_lines(hook)
    body = '\n'.join(f'    {line}' for line in lines)
    return ''.join(parts) + f'\n\nEFFECT = Effect(\n{body}\n)\n'


def numbered_text(term: Term, attribute: str) -> str:
    """An expression with numbered shapes."""
    return term.text(attribute, **{shape.name: f'p.q_{k}' for k, shape in enumerate(term.shapes)})


def choice_function(name: str, arguments: str, expressions: Sequence[str]) -> str:
    """A function that evaluates the expression number `p.term`."""
    lines = [f'\n\ndef {name}({arguments}):']
    for k, expression in enumerate(expressions):
        lines.append(f'    if p.term == {k}:\n        return {expression}')
    lines.append('    return 0.0\n')
    return '\n'.join(lines)
