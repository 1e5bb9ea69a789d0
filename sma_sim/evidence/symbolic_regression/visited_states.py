"""The states that kernels read, along the runs of a fitted model, and the values of terms there."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import product
from types import CodeType, SimpleNamespace
from typing import Any

import numpy as np

from sma_sim.compiler.effect_kernels import coordinate_fields
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.residuals import model_columns
from sma_sim.evidence.symbolic_regression.locations import EVERY_WIRE, Location
from sma_sim.evidence.symbolic_regression.terms import Term
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.parameters import wire_constants
from sma_sim.solver.wire_columns import heating_of_wire, strains_from_pose, stresses_from_forces

MAX_STATES_PER_RUN = 150  # instants at which terms are evaluated in Python: enough for a range and a mean square
# What expressions of terms call, for all instants at once.
ARRAY_FUNCTIONS = {
    'math': SimpleNamespace(exp=np.exp, sin=np.sin, tanh=np.tanh, copysign=np.copysign, pi=math.pi),
    'abs': np.abs,
    'max': np.maximum,
    'min': np.minimum,
}


@dataclass(frozen=True)
class VisitedStates:
    """One run as one wire (or the structure, or a channel) sees it: `fields` (k,) by the names of the kernels' state."""

    wire: int
    fields: Mapping[str, Vector]
    known: dict[tuple[Term, tuple[float, ...]], Vector] = field(default_factory=dict, init=False, repr=False, compare=False)

    @cached_property
    def samples(self) -> list[Any]:
        """The states, one per instant."""
        rows = np.column_stack(list(self.fields.values())).tolist()
        return [SimpleNamespace(**dict(zip(self.fields, row, strict=True))) for row in rows]


class ModelRuns:
    """All runs of a problem at z, made once for all locations at which terms are tried."""

    def __init__(self, problem: Problem, z: Vector) -> None:
        self._config = config = problem.fitted(z)
        pairs = zip(problem.runs, problem.indices(), strict=True)
        self._runs = [(run.time, model_columns(config, run, problem.nuisance(run, z[indices]))) for run, indices in pairs]
        self._states: dict[tuple[int, int, bool, Location | None], VisitedStates] = {}

    def visited(self, location: Location, every_sample: bool = False) -> list[VisitedStates]:
        """The runs as the kernels at a location see them, every wire where it acts in each; at some of their samples, or at
        every one."""
        wires = wires_of_kernels(location, self._config.structure.wires)
        sensor = location if location.hook == 'sensing' else None
        return [self._seen(wire, run, every_sample, sensor) for wire, run in product(wires, range(len(self._runs)))]

    def _seen(self, wire: int, run: int, every_sample: bool, sensor: Location | None) -> VisitedStates:
        """One run as kernels see it in one wire, or as those of a sensor do."""
        key = (wire, run, every_sample, sensor)
        if key not in self._states:
            if sensor is not None:
                fields = self._seen(wire, run, every_sample, None).fields
                self._states[key] = VisitedStates(wire, {**fields, **sensor_fields(sensor, fields, self._config)})
            else:
                time, columns = self._runs[run]
                every = 1 if every_sample else max(1, len(time) // MAX_STATES_PER_RUN)
                fields = kernel_fields(time, columns, self._config, wire)
                self._states[key] = VisitedStates(wire, {name: values[::every] for name, values in fields.items()})
        return self._states[key]


def wires_of_kernels(location: Location, wires: int) -> Sequence[int]:
    """The wires, from 0 on, with which kernels at a location are called; of a sensor the one whose force or temperature it
    shows, or the first."""
    if location.hook == 'sensing':
        letter, _, number = location.variable.partition('_')
        return (int(number) - 1 if letter in ('F', 'T') and number.isdigit() else 0,)
    if location.hook == 'structure_force':
        return (wires - 1,)
    return range(wires) if location.component == EVERY_WIRE else (location.component,)


def kernel_fields(time: Vector, columns: Mapping[str, Vector], config: Config, wire: int) -> dict[str, Vector]:
    """The kernels' state (samples,) by name, as one wire sees it, from the columns of the model."""
    structure, w = config.structure, wire_constants(config.parameters)
    fields = {'t': time, 'T_E': columns['T_E_K'], 'wire': np.full_like(time, wire)}
    fields['others'] = np.full_like(time, structure.wires - 1)
    suffixes = structure.wire_suffixes
    others = [suffix for i, suffix in enumerate(suffixes) if i != wire] or suffixes
    for name, column in (('T', 'T{}_K'), ('x', 'x_M{}')):
        fields[name] = columns[column.format(suffixes[wire])]
        fields[f'{name}_other'] = np.mean([columns[column.format(suffix)] for suffix in others], axis=0)
    fields['J'] = heating_of_wire(config, columns, wire)
    if structure.coordinates:
        fields['sigma'] = stresses_from_forces(config, columns)[f'stress{suffixes[wire]}']
        fields['F'] = columns[f'F{suffixes[wire]}_N'] / w.n
        fields['eps'] = strains_from_pose(config, columns)[f'strain{suffixes[wire]}']
        for coordinate, (name, rate) in zip(structure.coordinates, coordinate_fields(structure).values(), strict=True):
            fields[name] = columns[coordinate.column]
            fields[rate] = np.gradient(fields[name], time)
    else:
        fields |= {'sigma': columns['stress_Pa'], 'eps': columns['strain']}
    return fields | {f'd{name}': np.gradient(fields[name], time) for name in ('x', 'eps')}


def sensor_fields(location: Location, fields: Mapping[str, Vector], config: Config) -> dict[str, Vector]:
    """What a sensor's effects see: the value of the channel, and its number."""
    structure, channel = config.structure, location.variable
    if channel in structure.coordinate_names:
        value = fields[coordinate_fields(structure)[channel][0]]
    elif channel.startswith('T'):
        value = fields['T']
    else:
        value = fields['sigma'] if channel == 'stress' else wire_constants(config.parameters).n * fields['F']
    return {'value': value, 'channel': np.full_like(value, location.component)}


@cache
def compiled_expression(expression: str) -> CodeType:
    """An expression of terms as Python code."""
    return compile(expression, '<term>', 'eval')


def term_values(term: Term, shapes: Sequence[float], states: VisitedStates) -> Vector:
    """A term along a run, (k,), which is evaluated once."""
    key = (term, tuple(shapes))
    if key not in states.known:
        states.known[key] = evaluated(term, shapes, states)
    return states.known[key]


def evaluated(term: Term, shapes: Sequence[float], states: VisitedStates) -> Vector:
    """A term along a run, (k,); its state is integrated by Euler's rule at the samples. Infinite from where it overflows."""
    parameters = SimpleNamespace(**{f'q_{k}': float(shape) for k, shape in enumerate(shapes)})
    value = compiled_expression(term.numbered('value'))
    time = states.fields['t']
    if not term.rate:
        at_once = eval(value, {**ARRAY_FUNCTIONS, 'p': parameters, 's': SimpleNamespace(**states.fields)})
        return np.broadcast_to(np.asarray(at_once, dtype=float), time.shape)
    scope: dict[str, Any] = {'math': math, 'p': parameters}
    samples = states.samples
    rate, memory = compiled_expression(term.numbered('rate')), SimpleNamespace(z=0.0)
    memory.z = float(eval(compiled_expression(term.numbered('start')), {**scope, 's': samples[0]}))
    along = np.full(len(samples), np.inf)
    with suppress(OverflowError):  # of a rate that grows with T, where wires are far too hot
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
