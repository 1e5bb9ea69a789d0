"""The missing quantity itself, beside the formula for it: a partial-residual plot through the simulator.

The quantity is the formula along each run plus what the residuals still call for: hat functions of time at its location,
whose responses (less what the fitted parameters absorb) explain the residuals, with a prior as wide as the formula.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from sma_sim.compiler.effect_kernels import coordinate_fields
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.symbolic_regression.formula import Formula
from sma_sim.evidence.symbolic_regression.locations import Location
from sma_sim.evidence.symbolic_regression.term_fits import LinearizedFit, TermTrial
from sma_sim.evidence.symbolic_regression.term_library import HAT_FUNCTION
from sma_sim.evidence.symbolic_regression.visited_states import VisitedStates, term_values
from sma_sim.model.arrays import Matrix, Vector

NODES_PER_RUN = 25  # hat functions: points of a run in the plot
NOT_DRAWN = ('memory', 'constant', 'deps', 'dx')  # variables that are no axis of a plot
VARIABLE_UNITS = {'t': 's', 'T': 'K', 'T_other': 'K', 'J': 'W', 'x': '-'}
VARIABLE_LABELS = {
    't': 'time',
    'T': 'temperature of the wire',
    'T_other': 'temperature of the other wire',
    'J': 'heating of the wire',
    'x': 'x_M',
    'value': 'true value',
}


@dataclass(frozen=True)
class PartialResiduals:
    """One run (as one wire sees it): the variable, the quantity with its standard error and the formula, (k,) each."""

    label: str
    x: Vector
    quantity: Vector
    std: Vector
    formula: Vector


@dataclass(frozen=True)
class PartialResidualPlot:
    """The quantity over the chosen variable, with names and units of both.

    `curve`: the formula as a line, x and y, where it depends on nothing else.
    """

    variable: str
    variable_unit: str
    quantity: str
    unit: str
    runs: tuple[PartialResiduals, ...]
    curve: tuple[Vector, Vector] | None


def partial_residual_plot(fitted: FitResult, formula: Formula, pool: Executor) -> PartialResidualPlot:
    """What the missing quantity did in the training runs, over the variable on which the formula depends."""
    linearized = LinearizedFit(fitted.problem, fitted.z, pool)
    variable, runs = chosen_variable(formula), fitted.problem.runs
    locations = [one for one in linearized.locations if one.name in formula.location.ports]
    visited = [states for location in locations for states in linearized.runs.visited(location)]
    values = [formula_values(formula, states) for states in visited]
    size = max(float(np.sqrt(np.mean(np.concatenate(values) ** 2))), 1e-300)
    nodes = [np.linspace(float(run.time[0]), float(run.time[-1]), NODES_PER_RUN) for run in runs]
    columns = hat_responses(linearized, locations, nodes, size)
    covariance = np.linalg.inv(columns @ columns.T + np.eye(len(columns)))  # their prior has a width of one
    coefficients = covariance @ (-columns @ linearized.projected_residuals)
    more, errors = (size * one.reshape(len(visited), -1) for one in (coefficients, np.sqrt(np.diag(covariance))))
    by_run = list[PartialResiduals]()
    for k, (states, along) in enumerate(zip(visited, values, strict=True)):
        run, instants = runs[k % len(runs)], nodes[k % len(runs)]
        x, at_nodes = (np.interp(instants, states.fields['t'], one) for one in (states.fields[variable], along))
        label = run.name if len(locations) == 1 else f'{run.name}, wire {states.wire + 1}'
        by_run.append(PartialResiduals(label, x, at_nodes + more[k], errors[k], at_nodes))
    location, axis = formula.location, axis_of(variable, formula)
    x = np.concatenate([states.fields[variable] for states in visited])
    order, y = np.argsort(x), np.concatenate(values)
    curve = (x[order], y[order]) if formula.variables == (variable,) else None
    return PartialResidualPlot(*axis, location.description, location.unit, tuple(by_run), curve)


def axis_of(variable: str, formula: Formula) -> tuple[str, str]:
    """What a variable is called, and its unit: of a coordinate, its rate, or another state; else that of the quantity."""
    structure = formula.structure
    for coordinate, (name, rate) in zip(structure.coordinates, coordinate_fields(structure).values(), strict=True):
        if variable in (name, f'd{name}', rate):
            unit = coordinate.unit
            return (coordinate.name, unit) if variable == name else (f'd({coordinate.name})/dt', f'{unit}/s')
    return VARIABLE_LABELS.get(variable, variable), VARIABLE_UNITS.get(variable, formula.location.unit)


def chosen_variable(formula: Formula) -> str:
    """The state over which the quantity is drawn: that of a shape, time, or the first on which the formula depends."""
    of_shapes = [shape.of for term in formula.terms for shape in term.shapes if shape.of]
    timed = [shape for term in formula.terms for shape in term.shapes if shape.grid in ('instant', 'frequency')]
    drawable = [name for name in formula.variables if name not in NOT_DRAWN]
    return (of_shapes or (['t'] if timed else []) or drawable or ['t'])[0]


def formula_values(formula: Formula, states: VisitedStates) -> Vector:
    """The formula along a run, (k,)."""
    terms = [fit.coefficient * term_values(fit.term, fit.shapes, states) for fit in formula.term_fits]
    values: Vector = np.sum(terms, axis=0)
    return values


def hat_responses(linearized: LinearizedFit, locations: list[Location], nodes: list[Vector], size: float) -> Matrix:
    """What each hat function changes in the residuals, (locations x runs x NODES_PER_RUN, N)."""
    ends = np.cumsum([0, *(run.residuals.size for run in linearized.linear)])
    columns = []
    for location in locations:
        for j, instants in enumerate(nodes):
            width = float(instants[1] - instants[0])
            hats = [TermTrial(HAT_FUNCTION, (float(t), width), size) for t in instants]
            for response in linearized.responses(location, hats):
                of_run = np.zeros(int(ends[-1]))
                if response is not None:
                    of_run[ends[j] : ends[j + 1]] = response[ends[j] : ends[j + 1]]
                column = linearized.projection.visible(of_run)
                columns.append(np.zeros_like(of_run) if column is None else column)
    return np.array(columns)
