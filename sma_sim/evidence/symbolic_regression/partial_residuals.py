"""The missing quantity itself, beside the formula for it: a partial-residual plot through the simulator.

The quantity is the formula along each run plus what residuals still ask for: hats in time at the same place, whose responses
(less what the fitted parameters absorb) explain the residuals, with a normal prior as wide as the formula is large.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.model_selection.refit import FitResult
from sma_sim.evidence.symbolic_regression.formula import Formula
from sma_sim.evidence.symbolic_regression.locations import BOTH_WIRES, Place, places_of
from sma_sim.evidence.symbolic_regression.term_fits import LinearizedFit
from sma_sim.evidence.symbolic_regression.term_library import PULSE
from sma_sim.evidence.symbolic_regression.visited_states import Course, along, seen_at

Vector = NDArray[np.float64]
NODES = 25  # hats over a run
UNITS = {'t': 's', 'T': 'K', 'T_other': 'K', 'alpha': 'rad', 'U_y': 'm', 'J': 'W', 'x': '-'}
WORDS = {
    't': 'time', 'T': 'temperature of the wire', 'T_other': 'temperature of the other wire', 'alpha': 'alpha', 'U_y': 'U_y',
    'J': 'heating of the wire', 'x': 'x_M', 'value': 'true value', 'dalpha': 'd(alpha)/dt', 'dU_y': 'd(U_y)/dt',
}  # fmt: skip


@dataclass(frozen=True)
class Trace:
    """One run (as one wire sees it): the variable, the quantity with its standard error and the formula, (k,) each."""

    label: str
    x: Vector
    quantity: Vector
    error: Vector
    formula: Vector


@dataclass(frozen=True)
class Portrait:
    """The quantity over the chosen variable, with names and units of both.

    `curve`: the formula as a line, x and y, where it depends on nothing else.
    """

    variable: str
    variable_unit: str
    quantity: str
    unit: str
    traces: tuple[Trace, ...]
    curve: tuple[Vector, Vector] | None


def portrait(fitted: FitResult, formula: Formula, pool: Executor) -> Portrait:
    """What the missing quantity did in the training runs, over the variable on which the formula depends."""
    bench = LinearizedFit(fitted.problem, fitted.z, pool)
    variable = chosen_variable(formula)
    traces: list[Trace] = []
    places = places_alone(formula.place)
    seen = [seen_at(place, fitted.problem, fitted.z) for place in places]
    sizes = [values_along(formula, course) for courses in seen for course in courses]
    size = max(float(np.sqrt(np.mean(np.concatenate(sizes) ** 2))), 1e-300)
    nodes, columns = hat_functions(bench, fitted, places, size)
    amounts, errors = explained(columns, bench.left)
    runs = fitted.problem.runs
    for k, courses in enumerate(seen):
        for j, (run, course) in enumerate(zip(runs, courses, strict=True)):
            at = slice((k * len(runs) + j) * NODES, (k * len(runs) + j + 1) * NODES)
            there = course.fields['t']
            values = np.interp(nodes[j], there, values_along(formula, course))
            x = np.interp(nodes[j], there, course.fields[variable])
            label = run.name if len(places) == 1 else f'{run.name}, wire {course.wire + 1}'
            traces.append(Trace(label, x, values + size * amounts[at], size * errors[at], values))
    unit = UNITS.get(variable, '1/s' if variable.startswith('d') else formula.place.unit)
    curve = line_of(formula, variable, seen) if formula.variables == (variable,) else None
    return Portrait(WORDS.get(variable, variable), unit, formula.place.description, formula.place.unit, tuple(traces), curve)


def line_of(formula: Formula, variable: str, seen: list[list[Course]]) -> tuple[Vector, Vector]:
    """The formula at all values of its variable that the runs visit, in their order."""
    x = np.concatenate([course.fields[variable] for courses in seen for course in courses])
    y = np.concatenate([values_along(formula, course) for courses in seen for course in courses])
    order = np.argsort(x)
    return x[order], y[order]


def chosen_variable(formula: Formula) -> str:
    """The state over which the quantity is drawn: the first that the formula depends on (a shape's first of all)."""
    shaped = [shape.of for term in formula.terms for shape in term.shapes if shape.of]
    timed = [shape for term in formula.terms for shape in term.shapes if shape.grid in ('instant', 'peaks')]
    known = [name for name in formula.variables if name not in ('memory', 'constant', 'deps', 'dx')]
    return (shaped or (['t'] if timed else []) or known or ['t'])[0]


def places_alone(place: Place) -> list[Place]:
    """The place itself, or each of the two wires."""
    if place.component != BOTH_WIRES:
        return [place]
    return [one for one in places_of(place.hook) if one.component != BOTH_WIRES and one.name in place.ports]


def values_along(formula: Formula, course: Course) -> Vector:
    """The formula along a run, (k,)."""
    values: Vector = np.sum([one.amount * along(one.term, one.shapes, course) for one in formula.guesses], axis=0)
    return values


def hat_functions(
    bench: LinearizedFit, fitted: FitResult, places: list[Place], size: float
) -> tuple[list[Vector], NDArray[np.float64]]:
    """Instants of the hats by run, and what each changes in the residuals, (places x runs x NODES, N)."""
    runs = fitted.problem.runs
    nodes = [np.linspace(float(run.time[0]), float(run.time[-1]), NODES) for run in runs]
    ends = np.cumsum([0, *(one.residuals.size for one in bench.linear)])
    columns = []
    for place in places:
        for j in range(len(runs)):
            width = float(nodes[j][1] - nodes[j][0])
            shown = bench.responses([(place, PULSE, (float(t), width), size) for t in nodes[j]])
            for response in shown:
                alone = np.zeros(int(ends[-1]))
                if response is not None:
                    alone[ends[j] : ends[j + 1]] = response[ends[j] : ends[j + 1]]
                left = bench.project(alone)
                columns.append(np.zeros_like(alone) if left is None else left)
    return nodes, np.array(columns)


def explained(columns: NDArray[np.float64], residuals: Vector) -> tuple[Vector, Vector]:
    """Amounts of the columns that explain the residuals, and their standard errors; their prior has a width of one."""
    spread = np.linalg.inv(columns @ columns.T + np.eye(len(columns)))
    return spread @ (-columns @ residuals), np.sqrt(np.diag(spread))
