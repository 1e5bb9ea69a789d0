"""The states that kernels read, along the runs of a fitted model: what terms are worth there."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from types import CodeType, SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.residuals import model_columns
from sma_sim.evidence.symbolic_regression.locations import BOTH_WIRES, Place
from sma_sim.evidence.symbolic_regression.terms import Term
from sma_sim.model.effects.ports import CHANNELS
from sma_sim.model.parameters import wire_constants

Vector = NDArray[np.float64]
MOST = 150  # samples of a run
POSE = ('U_x', 'U_y', 'alpha')


@dataclass(frozen=True)
class Course:
    """One run as one wire (or the structure, or a channel) sees it: `fields` (k,) by the names of the kernels' state."""

    run: str
    wire: int
    fields: Mapping[str, Vector]

    @cached_property
    def samples(self) -> list[Any]:
        """The states, one per instant."""
        names = list(self.fields)
        rows = np.column_stack([self.fields[name] for name in names]).tolist()
        return [SimpleNamespace(**dict(zip(names, row, strict=True))) for row in rows]


def courses(problem: Problem, z: Vector, wire: int = 0) -> list[Course]:
    """All runs of a problem at z, as one wire sees them."""
    config, found = problem.fitted(z), []
    for run, place in zip(problem.runs, problem.places(), strict=True):
        columns = model_columns(config, run, problem.nuisance(z[place]))
        every = max(1, len(run.time) // MOST)
        found.append(Course(run.name, wire, fields_of(run.time, columns, config.parameters, wire, every)))
    return found


def fields_of(
    time: Vector, columns: Mapping[str, Vector], parameters: Mapping[str, float], wire: int, every: int
) -> dict[str, Vector]:
    """The kernels' state from the columns of a module or of a single wire."""
    w = wire_constants(parameters)
    module = 'alpha_rad' in columns
    names = [f'_{wire + 1}', f'_{2 - wire}'] if module else ['', '']
    fields = {'t': time, 'T_E': columns['T_E_K'], 'wire': np.full_like(time, wire)}
    for kind, column in (('T', 'T{}_K'), ('x', 'x_M{}')):
        fields[kind], fields[f'{kind}_other'] = (columns[column.format(name)] for name in names)
    if module:
        fields |= {name: columns[f'{name}_{"rad" if name == "alpha" else "m"}'] for name in POSE}
        side = columns['J_eq_W'] if wire == 0 else -columns['J_eq_W']
        fields['J'] = np.maximum(side, 0.0) / w.n
        fields['sigma'] = columns[f'F_{wire + 1}_N'] / (w.n * w.section)
        half = (wire - 0.5) * parameters['plate.W']
        sine, cosine = np.sin(fields['alpha']), np.cos(fields['alpha'])
        across, along = fields['U_y'] + half * (1 - cosine), parameters['beam.L'] + fields['U_x'] + half * sine
        fields['eps'] = np.hypot(across, along) / w.l0 - 1.0
    else:
        fields |= {'J': columns['J_W'], 'sigma': columns['stress_Pa'], 'eps': columns['strain']}
    for name in ('x', 'eps', *(POSE if module else ())):
        fields[f'd{name}'] = np.gradient(fields[name], time)
    return {name: values[::every] for name, values in fields.items()}


def seen_at(place: Place, problem: Problem, z: Vector) -> list[Course]:
    """The runs as the kernels at a place see them; both wires where it acts in both."""
    module = problem.config.system == 'module'
    if place.hook == 'sensing':
        name = CHANNELS[place.component]
        whole = courses(problem, z, 1 if name.endswith('_2') else 0)
        return [Course(one.run, one.wire, {**one.fields, **shown(name, one, problem)}) for one in whole]
    if place.hook == 'structure_force':
        return courses(problem, z, 1)
    wires = (0, 1) if place.component == BOTH_WIRES and module else (max(place.component, 0),)
    return [one for wire in wires for one in courses(problem, z, wire)]


def shown(channel: str, course: Course, problem: Problem) -> dict[str, Vector]:
    """What a sensor's effects see: the value of the channel, and its number."""
    fields, p = course.fields, problem.config.parameters
    if channel.startswith('F') or channel == 'stress':
        w = wire_constants(p)
        value = fields['sigma'] * (w.n * w.section if channel.startswith('F') else 1.0)
    else:
        value = fields[channel[0] if channel.startswith('T') else channel]
    return {'value': value, 'channel': np.full_like(value, CHANNELS.index(channel))}


@cache
def compiled(expression: str) -> CodeType:
    """An expression of terms, ready to be evaluated."""
    return compile(expression, '<term>', 'eval')


def along(term: Term, shapes: Sequence[float], course: Course) -> Vector:
    """A term along a course, (k,); its state is integrated by Euler's rule at the samples."""
    values = {f'q_{k}': float(shape) for k, shape in enumerate(shapes)}
    names = {shape.name: f'p.q_{k}' for k, shape in enumerate(term.shapes)}
    scope: dict[str, Any] = {'math': math, 'p': SimpleNamespace(**values), 'abs': abs, 'max': max, 'min': min}
    value = compiled(term.text('value', **names))
    samples = course.samples
    if not term.rate:
        return np.array([eval(value, {**scope, 's': s}) for s in samples], dtype=float)
    rate, memory = compiled(term.text('rate', **names)), SimpleNamespace(z=0.0)
    memory.z = float(eval(compiled(term.text('start', **names)), {**scope, 's': samples[0]}))
    found, time = np.zeros(len(samples)), course.fields['t']
    for k, s in enumerate(samples):
        found[k] = eval(value, {**scope, 's': s, 'm': memory})
        if k + 1 < len(samples):
            step = float(time[k + 1] - time[k])
            memory.z = stepped(memory.z, float(eval(rate, {**scope, 's': s, 'm': memory})), step, rate, scope, s)
    return found


def stepped(z: float, slope: float, step: float, rate: CodeType, scope: Mapping[str, Any], s: Any) -> float:
    """One step of a linearly implicit Euler rule: fast states do not overshoot."""
    away = 1e-6 * (abs(z) + 1e-3)
    steeper = float(eval(rate, {**scope, 's': s, 'm': SimpleNamespace(z=z + away)}))
    return z + step * slope / (1.0 - step * min((steeper - slope) / away, 0.0))
