"""A formula of one to a few terms at one location as an effect: its parameters, its equation, its file.

A search tries its terms one by one, as candidates beside the effects of the library.
"""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.injection_points import STIFFNESS
from sma_sim.evidence.model_selection.candidates import Candidate
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.symbolic_regression.code_generation import STIFFNESS_IMPORT, kernel_return, load_generated, port_lines
from sma_sim.evidence.symbolic_regression.locations import Location
from sma_sim.evidence.symbolic_regression.term_fits import TermFit
from sma_sim.evidence.symbolic_regression.terms import POSITIVE_GRIDS, ShapeParameter, Term, factor, per_unit
from sma_sim.evidence.symbolic_regression.universal_term import universal_term
from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter
from sma_sim.model.structures.module import STRUCTURE as MODULE
from sma_sim.model.structures.structure import Structure

FORMULA_SOURCE = 'proposed by sma-sim diagnose from recordings: a formula that fits, not a law that is known'
PARAMETER_SOURCE = 'fitted to recordings'
BOUND_RATIO = 1e3  # of a coefficient's bounds to its value: a later fit may change its order of magnitude
NEAR_RATIO = 5.0  # of the realistic range to the value: a refit may change it by so much, either way
VALUE_DIGITS, BOUND_DIGITS = 6, 3  # significant ones in the file
MAX_INLINE_LENGTH = 60  # characters of an expression; a longer one gets a function of its own
MAX_TEXT_LENGTH = 100  # characters of a string on one line


@dataclass(frozen=True)
class Formula:
    """Terms at one location of a structure with names for their parameters: coefficients c (c_1, ...), then the shapes."""

    term_fits: tuple[TermFit, ...]
    structure: Structure = field(default=MODULE, repr=False, compare=False)

    @property
    def location(self) -> Location:
        """Where it acts."""
        return self.term_fits[0].location

    @property
    def terms(self) -> tuple[Term, ...]:
        """Its terms."""
        return tuple(fit.term for fit in self.term_fits)

    @property
    def name(self) -> str:
        """The name of the effect."""
        return '_'.join(['proposed', self.location.name, *(term.name for term in self.terms)])

    @property
    def variables(self) -> tuple[str, ...]:
        """The states that it depends on."""
        bending = ('alpha',) if self.along_stiffness else ()
        return tuple(dict.fromkeys([*bending, *(name for term in self.terms for name in term.variables)]))

    @property
    def along_stiffness(self) -> bool:
        """Whether it acts along K q, as a change of the beam's stiffness."""
        return (self.location.hook, self.location.component) == ('structure_force', STIFFNESS)

    def coefficient_name(self, k: int) -> str:
        """The name of the coefficient of term k."""
        return 'c' if len(self.term_fits) == 1 else f'c_{k + 1}'

    @property
    def shape_names(self) -> list[dict[str, str]]:
        """Per term its shapes' names in the file, numbered where two terms share one."""
        count, by_term = Counter[str](), []
        for term in self.terms:
            names = [shape.name for shape in term.shapes]
            count.update(names)
            by_term.append({name: f'{name}_{count[name]}' if count[name] > 1 else name for name in names})
        return by_term

    def unit(self, text: str) -> str:
        """A unit in which 'unit' stands for that of the shown value."""
        return re.sub(r'\bunit\b', self.location.unit, text)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Declarations, with the values as defaults."""
        parameters = []
        for k, fit in enumerate(self.term_fits):
            bound, value = rounded(BOUND_RATIO * abs(fit.coefficient), BOUND_DIGITS), rounded(fit.coefficient)
            unit = self.unit(per_unit(self.location.unit, fit.term.unit))
            near = rounded(NEAR_RATIO * abs(fit.coefficient), BOUND_DIGITS)
            name, realistic = self.coefficient_name(k), (-near, near)
            parameters.append(Parameter(name, value, unit, (-bound, bound), 'coefficient', neutral=0.0, realistic=realistic))
        for fit, names in zip(self.term_fits, self.shape_names, strict=True):
            for shape, value, limits in zip(fit.term.shapes, fit.shapes, fit.limits, strict=True):
                parameters.append(self.shape_parameter(names[shape.name], shape, rounded(value), limits))
        return tuple(parameters)

    def shape_parameter(self, name: str, shape: ShapeParameter, value: float, limits: tuple[float, float]) -> Parameter:
        """One shape parameter; its realistic range is what these recordings could tell."""
        low, high = min(rounded(limits[0], BOUND_DIGITS), value), max(rounded(limits[1], BOUND_DIGITS), value)
        width = high - low
        bounds = (low / 10.0, high * 10.0) if shape.grid in POSITIVE_GRIDS else (low - width, high + width)
        if shape.grid == 'frequency':
            bounds = (low, bounds[1])  # a slower one does not come again
        bounds = (min(rounded(bounds[0], BOUND_DIGITS), value), max(rounded(bounds[1], BOUND_DIGITS), value))
        return Parameter(name, value, self.unit(shape.unit), bounds, shape.description, realistic=(low, high))

    def with_values(self, values: Mapping[str, float]) -> Formula:
        """The same with the parameters (by their names in the file) at these values."""
        term_fits = []
        for k, (fit, names) in enumerate(zip(self.term_fits, self.shape_names, strict=True)):
            shapes = tuple(values[names[shape.name]] for shape in fit.term.shapes)
            term_fits.append(replace(fit, coefficient=values[self.coefficient_name(k)], shapes=shapes))
        return Formula(tuple(term_fits), self.structure)

    @property
    def state_names(self) -> list[str]:
        """Per term the name of its extra state, '' for none."""
        several = sum(bool(term.rate) for term in self.terms) > 1
        return [(f'z_{k + 1}' if several else 'z') if term.rate else '' for k, term in enumerate(self.terms)]

    def term_text(self, k: int, attribute: str) -> str:
        """An expression of term k with the names of the file."""
        text = self.terms[k].text(attribute, **{shape: f'p.{name}' for shape, name in self.shape_names[k].items()})
        return text.replace('m.z', f'm.{self.state_names[k]}') if self.terms[k].rate else text

    @property
    def sum(self) -> str:
        """All terms with their coefficients."""
        parts = [product(f'p.{self.coefficient_name(k)}', self.term_text(k, 'value')) for k in range(len(self.terms))]
        return f'({" + ".join(parts)})' if len(parts) > 1 else parts[0]

    @property
    def equation(self) -> str:
        """For people: what is added where."""
        location = self.location
        before = {'actuation': 'J + ', 'sensing': 'value + '}.get(location.hook, '')
        after = ' K q' if self.along_stiffness else ''
        rates = [f'd{state}/dt = {readable(self.term_text(k, "rate"))}' for k, state in enumerate(self.state_names) if state]
        equations = '; '.join([f'{location.symbol} = {before}{readable(self.sum)}{after}', *rates])
        return f'{equations} ({location.description})'

    def load(self) -> Effect:
        """The effect, loaded from a folder of the user's cache."""
        return load_generated(self.name, self.text())

    def text(self, source: str = FORMULA_SOURCE) -> str:
        """The effect file."""
        location = self.location
        constants = 'b' if location.hook == 'structure_force' else 'w'
        arguments = f's, {constants}, p, m' if any(self.state_names) else f's, {constants}, p'
        separate = self.needs_function
        value = f'quantity({arguments})' if separate else self.sum
        kernel = kernel_return(location.hook, location.component, value, self.structure, constants)
        docstring = f'"""{location.description.capitalize()} [{location.unit}]."""'
        body = f'\n\ndef quantity({arguments}):\n    {docstring}\n    return {self.sum}\n\n' if separate else ''
        lines = [
            f'name={self.name!r},',
            f'port={location.hook!r},',
            *wrapped_argument('equation', self.equation),
            *wrapped_argument('source', source),
            'parameters=(',
            *(f'    {line}' for p in self.parameters for line in declaration(p)),
            '),',
            *self.state_lines(arguments, constants),
            f'kernel=lambda {arguments}: {kernel},',
            *port_lines(location.hook, self.structure, location.variable),
        ]
        effect = '\n'.join(f'    {line}' for line in lines)
        imports = 'import math\n\n' if 'math.' in effect + body else ''
        imports += 'from sma_sim import Effect, Parameter\n' + (STIFFNESS_IMPORT if self.along_stiffness else '')
        paragraphs = (location.description.capitalize() + ', proposed.', self.equation, source)
        header = '\n\n'.join('\n'.join(textwrap.wrap(paragraph, 110)) for paragraph in paragraphs)
        return f'"""{header}\n"""\n\n{imports}{body}\nEFFECT = Effect(\n{effect}\n)\n'

    @property
    def needs_function(self) -> bool:
        """Whether the sum is written as a function of its own: it is long, or the kernel has it more than once."""
        repeated = self.location.hook == 'transformation_stress' or self.along_stiffness
        return repeated or len(self.sum) > MAX_INLINE_LENGTH

    def state_lines(self, arguments: str, constants: str) -> list[str]:
        """States, their scales, rates and first values."""
        with_state = [k for k, state in enumerate(self.state_names) if state]
        if not with_state:
            return []
        starts = [self.term_text(k, 'start') for k in with_state]
        lines = [
            f'states=({", ".join(repr(self.state_names[k]) for k in with_state)},),',
            f'scale=({", ".join(repr(self.terms[k].scale) for k in with_state)},),',
            f'rate=lambda {arguments}: ({", ".join(self.term_text(k, "rate") for k in with_state)},),',
        ]
        return lines if set(starts) == {'0.0'} else [*lines, f'start=lambda s, {constants}, p: ({", ".join(starts)},),']


def product(coefficient: str, value: str) -> str:
    """A coefficient times a value."""
    return coefficient if value == '1.0' else f'{coefficient} * {factor(value)}'


def readable(text: str) -> str:
    """An expression for people to read."""
    return re.sub(r'\b(\d+)\.0\b', r'\1', re.sub(r'\b(s|p|m|math)\.', '', text).replace(' ** ', '^'))


def declaration(p: Parameter) -> list[str]:
    """The lines that declare a parameter in the file."""
    rest = f'{p.description!r}, {PARAMETER_SOURCE!r}, {p.neutral!r}'
    end = ')' if p.realistic is None else f', {p.realistic!r})'
    return ['Parameter(', f'    {p.name!r}, {p.default!r}, {p.unit!r}, {p.bounds!r},', f'    {rest}{end},']


def wrapped_argument(name: str, value: str) -> list[str]:
    """``name='value',`` on lines that are not too long."""
    if len(value) < MAX_TEXT_LENGTH:
        return [f'{name}={value!r},']
    parts = textwrap.wrap(value, MAX_TEXT_LENGTH, drop_whitespace=False)
    return [f'{name}=(', *(f'    {part!r}' for part in parts), '),']


def rounded(value: float, digits: int = VALUE_DIGITS) -> float:
    """To so many significant digits."""
    return float(f'{value:.{digits}g}')


def as_candidate(fit: TermFit, on: Structure, copy: int = 0) -> ScreeningResult:
    """A term as a candidate of the selection: an effect that is that term, with the coefficient and shapes that it has.

    It shares the kernels of its port (`universal_term`), so that no term compiles anything. `on`: what it acts on, `copy`:
    of several terms.
    """
    universal = universal_term(fit.location.hook, bool(fit.term.rate), on, copy)
    values = universal.values(fit.location, fit.term, fit.coefficient, fit.shapes)
    names = ['c', *(f'q_{k}' for k in range(len(fit.shapes)))]
    declared = {name: replace(p, name=name) for name, p in zip(names, Formula((fit,), on).parameters, strict=True)}
    effect = universal.effect
    parameters = tuple(declared.get(p.name, replace(p, default=values.get(p.name, p.default))) for p in effect.parameters)
    candidate = Candidate(effect.derived(parameters=parameters), ())
    return ScreeningResult(candidate, fit.error_reduction, {name: values[name] for name in declared})


def as_fitted(fit: TermFit, effect: str, fitted: FitResult) -> TermFit:
    """A term with the values that a fit has found, in which `effect` is the term."""
    values = fitted.values_of(effect)
    shapes = tuple(values[f'q_{k}'] for k in range(len(fit.shapes)))
    return replace(fit, coefficient=values['c'], shapes=shapes)
