"""The states that kernels read, along the runs of a fitted model, and the values of terms there."""

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
from sma_sim.evidence.symbolic_regression.locations import BOTH_WIRES, Location
from sma_sim.evidence.symbolic_regression.terms import Term
from sma_sim.model.effects.ports import CHANNELS
from sma_sim.model.parameters import wire_constants

Vector = NDArray[np.float64]
MAX_STATES_PER_RUN = 150  # instants at which terms are evaluated in Python: enough for a range and a mean square
POSE_FIELDS = {'U_x': 'U_x_m', 'U_y': 'U_y_m', 'alpha': 'alpha_rad'}  # columns of the coordinates


@dataclass(frozen=True)
class VisitedStates:
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


def visited_by_wire(problem: Problem, z: Vector, wire: int = 0) -> list[VisitedStates]:
    """All runs of a problem at z, as one wire sees them."""
    config, visited = problem.fitted(z), []
    for run, indices in zip(problem.runs, problem.indices(), strict=True):
        columns = model_columns(config, run, problem.nuisance(run, z[indices]))
        every = max(1, len(run.time) // MAX_STATES_PER_RUN)
        fields = kernel_fields(run.time, columns, config.parameters, wire)
        visited.append(VisitedStates(run.name, wire, {name: values[::every] for name, values in fields.items()}))
    return visited


def kernel_fields(
    time: Vector, columns: Mapping[str, Vector], parameters: Mapping[str, float], wire: int
) -> dict[str, Vector]:
    """The kernels' state (samples,) by name, from the columns of a module or of a single wire."""
    w = wire_constants(parameters)
    module = 'alpha_rad' in columns
    suffixes = [f'_{wire + 1}', f'_{2 - wire}'] if module else ['', '']
    fields = {'t': time, 'T_E': columns['T_E_K'], 'wire': np.full_like(time, wire)}
    for name, column in (('T', 'T{}_K'), ('x', 'x_M{}')):
        fields[name], fields[f'{name}_other'] = (columns[column.format(suffix)] for suffix in suffixes)
    if module:
        fields |= {name: columns[column] for name, column in POSE_FIELDS.items()}
        side = columns['J_eq_W'] if wire == 0 else -columns['J_eq_W']
        fields['J'] = np.maximum(side, 0.0) / w.n
        fields['sigma'] = columns[f'F_{wire + 1}_N'] / (w.n * w.section)
        half = (wire - 0.5) * parameters['plate.W']
        sine, cosine = np.sin(fields['alpha']), np.cos(fields['alpha'])
        across, along = fields['U_y'] + half * (1 - cosine), parameters['beam.L'] + fields['U_x'] + half * sine
        fields['eps'] = np.hypot(across, along) / w.l0 - 1.0
    else:
        fields |= {'J': columns['J_W'], 'sigma': columns['stress_Pa'], 'eps': columns['strain']}
    for name in ('x', 'eps', *(POSE_FIELDS if module else ())):
        fields[f'd{name}'] = np.gradient(fields[name], time)
    return fields


def visited_states(location: Location, problem: Problem, z: Vector) -> list[VisitedStates]:
    """The runs as the kernels at a location see them; both wires where it acts in both."""
    module = problem.config.system == 'module'
    if location.hook == 'sensing':
        channel = CHANNELS[location.component]
        visited = visited_by_wire(problem, z, 1 if channel.endswith('_2') else 0)
        return [
            VisitedStates(states.run, states.wire, {**states.fields, **sensor_fields(channel, states, problem)})
            for states in visited
        ]
    if location.hook == 'structure_force':
        return visited_by_wire(problem, z, 1)
    wires = (0, 1) if location.component == BOTH_WIRES and module else (max(location.component, 0),)
    return [states for wire in wires for states in visited_by_wire(problem, z, wire)]


def sensor_fields(channel: str, states: VisitedStates, problem: Problem) -> dict[str, Vector]:
    """What a sensor's effects see: the value of the channel, and its number."""
    fields, parameters = states.fields, problem.config.parameters
    if channel.startswith('F') or channel == 'stress':
        w = wire_constants(parameters)
        value = fields['sigma'] * (w.n * w.section if channel.startswith('F') else 1.0)
    else:
        value = fields[channel[0] if channel.startswith('T') else channel]
    return {'value': value, 'channel': np.full_like(value, CHANNELS.index(channel))}


@cache
def compiled_expression(expression: str) -> CodeType:
    """An expression of terms as Python code."""
    return compile(expression, '<term>', 'eval')


def term_values(term: Term, shapes: Sequence[float], states: VisitedStates) -> Vector:
    """A term along a run, (k,); its state is integrated by Euler's rule at the samples."""
    values = {f'q_{k}': float(shape) for k, shape in enumerate(shapes)}
    names = {shape.name: f'p.q_{k}' for k, shape in enumerate(term.shapes)}
    scope: dict[str, Any] = {'math': math, 'p': SimpleNamespace(**values), 'abs': abs, 'max': max, 'min': min}
    value = compiled_expression(term.text('value', **names))
    samples = states.samples
    if not term.rate:
        return np.array([eval(value, {**scope, 's': s}) for s in samples], dtype=float)
    rate, memory = compiled_expression(term.text('rate', **names)), SimpleNamespace(z=0.0)
    memory.z = float(eval(compiled_expression(term.text('start', **names)), {**scope, 's': samples[0]}))
    along, time = np.zeros(len(samples)), states.fields['t']
    for k, s in enumerate(samples):
        along[k] = eval(value, {**scope, 's': s, 'm': memory})
        if k + 1 < len(samples):
            memory.z = euler_step(memory.z, rate, {**scope, 's': s}, float(time[k + 1] - time[k]))
    return along


def euler_step(z: float, rate: CodeType, scope: Mapping[str, Any], step: float) -> float:
    """One step [s] of the linearly implicit Euler rule: fast states do not overshoot."""
    slope = float(eval(rate, {**scope, 'm': SimpleNamespace(z=z)}))
    increment = 1e-6 * (abs(z) + 1e-3)
    slope_there = float(eval(rate, {**scope, 'm': SimpleNamespace(z=z + increment)}))
    return z + step * slope / (1.0 - step * min((slope_there - slope) / increment, 0.0))
