"""One compiled effect per port that can be any term there: its numbers choose, so that trying terms compiles nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from sma_sim.evidence.estimation.injection_points import STIFFNESS
from sma_sim.evidence.symbolic_regression.code_generation import common_lines, effect_of
from sma_sim.evidence.symbolic_regression.locations import Place, places_of
from sma_sim.evidence.symbolic_regression.term_library import PULSE
from sma_sim.evidence.symbolic_regression.terms import MOST_SHAPES, Term
from sma_sim.model.effects.discovery import FoundEffect

HEAD = '''\
"""All terms of one port, chosen by number, to see what the measured channels would show of each."""

import math

from sma_sim import Effect, Parameter
'''
WIRE = '(1.0 if p.place < 0.0 else s.wire if p.place > 0.0 else 1.0 - s.wire)'
RETURNED = {
    'structure_force': f'any_force(s, w, p, VALUE) if p.place > {STIFFNESS - 0.5} else ('
    '(VALUE, 0.0, 0.0) if p.place < 0.5 else (0.0, VALUE, 0.0) if p.place < 1.5 else (0.0, 0.0, VALUE))',
    'sensing': 's.value + (VALUE if s.channel == p.place else 0.0)',
    'actuation': f's.J + {WIRE} * VALUE',
    'wire_heat': f'{WIRE} * VALUE',
    'wire_strain': f'{WIRE} * VALUE',
    'transformation_stress': f'({WIRE} * VALUE, {WIRE} * VALUE)',
}
ALONG_K_Q = '''

def any_force(s, b, p, value):
    return value * b.k_x * s.U_x, value * (b.k_y * s.U_y - b.k_ya * s.alpha), value * (b.k_a * s.alpha - b.k_ya * s.U_y)

'''


@dataclass(frozen=True)
class AnyTerm:
    """A compiled effect that is any of `terms` at the places of one port."""

    found: FoundEffect
    terms: tuple[Term, ...]

    def values(self, place: Place, term: Term, amount: float, shapes: Sequence[float]) -> dict[str, float]:
        """Its parameters for `amount` of one term at one place."""
        rest = {f'q_{k}': shape for k, shape in enumerate(shapes)}
        return {'term': float(self.terms.index(term)), 'place': float(place.component), 'c': amount, **rest}


@cache
def any_term(hook: str, memory: bool, copy: int = 0) -> AnyTerm:
    """The effect for the terms of a port that have a state (`memory`), or for those that have none.

    Formulas of several terms need as many copies.
    """
    of_places = [t for place in places_of(hook) for t in place.terms if bool(t.rate) == memory]
    terms = tuple(dict.fromkeys(of_places if memory else [*of_places, PULSE]))
    name = f'any_{hook}{"_with_memory" if memory else ""}{copy or ""}'
    return AnyTerm(effect_of(name, source(name, hook, terms, memory)), terms)


def source(name: str, hook: str, terms: Sequence[Term], memory: bool) -> str:
    """The file of such an effect."""
    given = 's, p, m' if memory else 's, p'
    arguments = 's, w, p, m' if memory else 's, w, p'
    value = f'p.c * value_of({given})'
    parts = [HEAD, ALONG_K_Q if hook == 'structure_force' else '']
    parts.append(choice_of('value_of', given, [shaped(t, 'value') for t in terms]))
    lines = [f'name={name!r},', f'port={hook!r},', "equation='any term',", "source='',", 'parameters=(']
    names = ('term', 'place', *(f'q_{k}' for k in range(MOST_SHAPES)))
    lines += [f"    Parameter({one!r}, 0.5, '-', (-1e15, 1e15), '')," for one in names]
    lines += ["    Parameter('c', 0.0, '-', (-1e15, 1e15), '', '', 0.0),", '),']
    lines.append(f'kernel=lambda {arguments}: {RETURNED[hook].replace("VALUE", value)},')
    if memory:
        parts.append(choice_of('rate_of', given, [shaped(t, 'rate') for t in terms]))
        parts.append(choice_of('start_of', 's, p', [shaped(t, 'start') for t in terms]))
        lines += ["states=('z',),", 'scale=(0.1,),', 'rate=lambda s, w, p, m: (rate_of(s, p, m),),',
                  'start=lambda s, w, p: (start_of(s, p),),']  # fmt: skip
    lines += common_lines(hook)
    body = '\n'.join(f'    {line}' for line in lines)
    return ''.join(parts) + f'\n\nEFFECT = Effect(\n{body}\n)\n'


def shaped(term: Term, what: str) -> str:
    """An expression with numbered shapes."""
    return term.text(what, **{shape.name: f'p.q_{k}' for k, shape in enumerate(term.shapes)})


def choice_of(name: str, arguments: str, expressions: Sequence[str]) -> str:
    """A function that evaluates the expression number `p.term`."""
    lines = [f'\n\ndef {name}({arguments}):']
    for k, expression in enumerate(expressions):
        lines.append(f'    if p.term == {k}:\n        return {expression}')
    lines.append('    return 0.0\n')
    return '\n'.join(lines)
