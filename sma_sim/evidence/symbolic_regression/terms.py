"""What a term of an equation is: an expression of the states at a port, with a few shape parameters.

One text serves twice: in a compiled kernel that can be any term of a port, and in the effect file that is written in the
end. In the texts ``{name}`` stands for a shape parameter and ``m.z`` for the extra state.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

POSITIVE_GRIDS = ('width', 'wavenumber', 'time_constant', 'frequency', 'fixed')  # shapes that are fitted as logarithms
MAX_SHAPES = 3  # of one term: parameters of the compiled kernel are declared for so many


@dataclass(frozen=True)
class ShapeParameter:
    """A parameter inside a term: `grid` names how its first values follow from the data.

    threshold: over the range of the variable `of`; width: fractions of that range; wavenumber: whole and half waves within
    it [rad per unit]; phase: a half turn (the sign of the coefficient does the rest); instant: over the run; time_constant:
    up to the run's length; frequency: peaks of the residuals' spectrum [Hz]; fixed: `values` themselves.
    """

    name: str
    unit: str
    grid: str
    of: str = ''
    values: tuple[float, ...] = ()
    description: str = ''


@dataclass(frozen=True)
class Term:
    """One candidate: ``value`` (a Python expression) in `unit`, of the `variables` that it depends on.

    With `rate` (and `start`, 0 without it) it has one extra state ``m.z`` of size `scale`.
    """

    name: str
    value: str
    unit: str
    variables: tuple[str, ...]
    shapes: tuple[ShapeParameter, ...] = ()
    rate: str = ''
    start: str = '0.0'
    scale: float = 1.0

    def text(self, attribute: str, **names: str) -> str:
        """One of its expressions (`value`, `rate`, `start`) with the shape parameters as `names` say."""
        expression: str = getattr(self, attribute)
        return expression.format(**names)

    def numbered(self, attribute: str) -> str:
        """The same with the shape parameters numbered, as a kernel has them that can be any term."""
        return self.text(attribute, **{shape.name: f'p.q_{k}' for k, shape in enumerate(self.shapes)})


def times(term: Term, other: Term) -> Term:
    """The product of a term and one without a state."""
    return replace(
        term,
        name=f'{term.name}_{other.name}',
        value=f'{factor(term.value)} * {factor(other.value)}',
        unit=' '.join(unit for unit in (term.unit, other.unit) if unit != '-') or '-',
        variables=tuple(dict.fromkeys((*term.variables, *other.variables))),
        shapes=(*term.shapes, *other.shapes),
    )


def factor(text: str) -> str:
    """An expression that can stand in a product: in brackets if it is a sum."""
    depth = 0
    for k, letter in enumerate(text):
        depth += (letter in '([{') - (letter in ')]}')
        if depth == 0 and text[k : k + 3] in (' + ', ' - ', ' if'):
            return f'({text})'
    return text


def per_unit(port: str, term: str) -> str:
    """The unit of the coefficient of a term at a port."""
    if term == '-':
        return port
    below = f'({term})' if ' ' in term or '/' in term else term
    return f'{"1" if port == "-" else port}/{below}'
