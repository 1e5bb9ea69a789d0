"""The linear problem around one model: how each run responds to every port and to all fitted parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.injection_points import Port
from sma_sim.evidence.estimation.problem import Problem, linearize, residuals_at
from sma_sim.evidence.estimation.residuals import FitData, Nuisance, model_columns
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.latent_input.covariances import KnotStates
from sma_sim.evidence.latent_input.hypotheses import InputHypothesis
from sma_sim.evidence.latent_input.inference import SufficientStatistics, sum_of_statistics
from sma_sim.evidence.latent_input.sensitivities import (
    KnotGrid,
    binned,
    initialized,
    input_effect,
    knot_grid,
    sensor_responses,
    submit_responses,
    time_function_at,
    with_rows_at_knots,
)
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.config import Config
from sma_sim.solver.wire_columns import heating_of_wire

Indices = NDArray[np.int64]
MAX_SPACINGS = 200  # of all runs together: the cost of the inference grows with their cube
GAP_FOLDS, TIME_BLOCKS = 5, 25  # a run is cut into blocks of time, longer than residuals correlate; every fifth is left out


@dataclass(frozen=True)
class RunDesign:
    """One run: binned residuals (channels, bins), its rows (ports' knots, then its z), and their products by fold.

    `rows` (rows, channels bins) are per probe and per unit of z; `first_row`: where the rows of a port begin; `z_indices`:
    where its z are among all. `excess`: squares of the samples beyond those of the bins, `samples` their number.
    `columns`: the model at the knots, and the heating of every wire, ``J_wire_1`` [W].
    """

    name: str
    channels: tuple[str, ...]
    grid: KnotGrid
    residuals: Matrix
    rows: Matrix
    first_row: Mapping[str, int]
    z_indices: Indices
    folds: tuple[SufficientStatistics, ...]
    excess: float
    samples: int
    columns: Mapping[str, Vector]

    def port_rows(self, ports: Sequence[Port]) -> Indices:
        """The rows of some ports, if any."""
        first = np.array([self.first_row[port.name] for port in ports], dtype=np.int64)
        return (first[:, None] + np.arange(len(self.grid.knots))).ravel()

    @property
    def z_rows(self) -> Indices:
        """The rows of z."""
        return np.arange(len(self.rows) - len(self.z_indices), len(self.rows))


@dataclass(frozen=True)
class UnknownIndices:
    """Per run the rows that a hypothesis uses and their positions in (u, z); and the length m of u."""

    rows: list[Indices]
    positions: list[Indices]
    m: int


@dataclass(frozen=True)
class DesignMatrix:
    """All runs, the point z (n,) around which they are linearized, and the ambient temperature T_E [K]."""

    runs: tuple[RunDesign, ...]
    z: Vector
    T_E: float

    def indices(self, hypothesis: InputHypothesis) -> UnknownIndices:
        """Where the unknowns of a hypothesis are."""
        rows, positions, at = [], [], 0
        m = sum(len(run.grid.knots) for run in self.runs) * len(hypothesis.ports)
        for run in self.runs:
            port_rows = run.port_rows(hypothesis.ports)
            rows.append(np.concatenate([port_rows, run.z_rows]))
            positions.append(np.concatenate([at + np.arange(len(port_rows)), m + run.z_indices]))
            at += len(port_rows)
        return UnknownIndices(rows, positions, m)

    def statistics(
        self, hypothesis: InputHypothesis, inflation: float = 1.0, fold: int | None = None
    ) -> SufficientStatistics:
        """The statistics of a hypothesis over all data (with the score of the fit's prior), or over one fold.

        `inflation`: the variance of noise over what was stated.
        """
        indices = self.indices(hypothesis)
        size = indices.m + len(self.z)
        gram, score, squares, count = np.zeros((size, size)), np.zeros(size), 0.0, 0
        for run, rows, positions in zip(self.runs, indices.rows, indices.positions, strict=True):
            part = sum_of_statistics(run.folds) if fold is None else run.folds[fold]
            gram[np.ix_(positions, positions)] += part.gram[np.ix_(rows, rows)] / inflation
            score[positions] += part.score[rows] / inflation
            squares, count = squares + part.squares / inflation, count + part.count
        if fold is None:
            score[indices.m :] += self.z
        return SufficientStatistics(gram, score, squares, count)

    def score(self, hypothesis: InputHypothesis, data: Sequence[Matrix]) -> Vector:
        """The score (m + n,) of other residuals, (channels, bins) by run."""
        indices = self.indices(hypothesis)
        score = np.zeros(indices.m + len(self.z))
        for run, rows, positions, residuals in zip(self.runs, indices.rows, indices.positions, data, strict=True):
            score[positions] += run.rows[rows] @ residuals.ravel()
        return score

    def knot_states(self, hypothesis: InputHypothesis) -> KnotStates:
        """Where the values of a hypothesis are, and the states of the model there."""
        parts = [(q, port, run) for q, run in enumerate(self.runs) for port in hypothesis.ports]
        states = [states_at(port, run.columns, self.T_E) for _, port, run in parts]
        knots = [len(run.grid.knots) for _, _, run in parts]
        return KnotStates(
            run=np.repeat([float(q) for q, _, _ in parts], knots),
            wire=np.repeat([float(port.component) for _, port, _ in parts], knots),
            t=np.concatenate([run.grid.knots - run.grid.knots[0] for _, _, run in parts]),
            states={name: np.concatenate([state[name] for state in states]) for name in states[0]},
        )

    def residuals_after(self, hypothesis: InputHypothesis, x: Vector) -> list[Matrix]:
        """Residuals (channels, bins) by run after a change x of (u, z)."""
        indices = self.indices(hypothesis)
        return [
            run.residuals + (x[positions] @ run.rows[rows]).reshape(run.residuals.shape)
            for run, rows, positions in zip(self.runs, indices.rows, indices.positions, strict=True)
        ]


def states_at(port: Port, columns: Mapping[str, Vector], T_E: float) -> dict[str, Vector]:
    """The states of the model on which an input at this port may depend, (knots,) each."""
    if port.hook == 'sensing':
        return {'value': columns[port.column]}
    if port.hook == 'structure_force':
        return {port.variable: columns[port.column]}
    suffix = '' if 'T_K' in columns else f'_{port.component + 1}'
    J = columns[wire_heating(port.component)]
    return {'T': columns[f'T{suffix}_K'] - T_E, 'x': columns[f'x_M{suffix}'], 'J': J}


def wire_heating(wire: int) -> str:
    """The name of the heating of a wire among the columns at the knots."""
    return f'J_wire_{wire + 1}'


def columns_at_knots(config: Config, run: FitData, nuisance: Nuisance) -> dict[str, Vector]:
    """What the model does at the knots, `run` having its samples there. Raises SimulationError."""
    columns = model_columns(config, run, nuisance)
    wires = range(config.structure.wires)
    return columns | {wire_heating(i): heating_of_wire(config, columns, i) for i in wires}


class Stopped(Exception):
    """Ctrl-C before there was a result."""


@dataclass(frozen=True)
class LinearizationPoint:
    """Around what a model is linearized: the runs (with a row of input at every knot), z (n,), and inputs by run and port.

    `inputs` (knots,) are in the ports' units; a port that has none is at zero.
    """

    problem: Problem
    grids: tuple[KnotGrid, ...]
    z: Vector
    inputs: tuple[Mapping[Port, Vector], ...]

    def problem_of_run(self, k: int) -> tuple[Problem, Vector]:
        """The problem of run k alone, its inputs active, and its part of z."""
        structure = self.problem.config.structure
        inputs = [(port, u) for port, u in self.inputs[k].items() if port.hook != 'sensing']
        effects = [input_effect(port, self.grids[k], u, structure) for port, u in inputs]
        config = self.problem.config.variant(effects=(*self.problem.config.effects, *effects))
        return replace(self.problem, config=config, runs=(self.problem.runs[k],)), self.z[self.problem.indices()[k]]

    def sensor_offsets(self, k: int, delay: float) -> Matrix:
        """What inputs at the sensing ports add to the weighted residuals of run k, (channels, samples)."""
        run, grid = self.problem.runs[k], self.grids[k]
        offsets = np.zeros_like(run.weight)
        for port, u in self.inputs[k].items():
            if port.hook == 'sensing':
                row = run.channels.index(port.variable)
                offsets[row] += time_function_at(grid, u, run.time - delay) * run.weight[row]
        return offsets

    def residuals(self, pool: Executor) -> list[Matrix | None]:
        """Binned residuals (channels, bins) of every run; None where the model cannot be run."""
        by_run: list[Matrix | None] = []
        for k, run in enumerate(self.problem.runs):
            problem, z = self.problem_of_run(k)
            residuals = residuals_at(problem, z, pool)[0]
            offsets = self.sensor_offsets(k, problem.delay_at(z))
            by_run.append(None if residuals is None else binned(residuals + offsets, run, self.grids[k]))
        return by_run


def linearization_point(problem: Problem, z: Vector) -> LinearizationPoint:
    """The fitted model itself."""
    grids = tuple(knot_grid(run, MAX_SPACINGS // len(problem.runs)) for run in problem.runs)
    runs = tuple(
        replace(run, source=with_rows_at_knots(run.source, grid.knots))
        for run, grid in zip(problem.runs, grids, strict=True)
    )
    return LinearizationPoint(replace(problem, runs=runs), grids, z, tuple({} for _ in runs))


def design_matrix(point: LinearizationPoint, ports: Sequence[Port], context: SearchContext) -> DesignMatrix:
    """Every run's response to every port at every knot. Raises Stopped."""
    runs = []
    for k, run in enumerate(point.problem.runs):
        context.on_progress(f'responses of {run.name} to {len(ports)} ports at {len(point.grids[k].knots)} instants')
        runs.append(run_design(point, k, ports, context))
    return DesignMatrix(tuple(runs), point.z, point.problem.config.parameters['environment.T_E'])


def run_design(point: LinearizationPoint, k: int, ports: Sequence[Port], context: SearchContext) -> RunDesign:
    """One run's responses. Its residuals are those without inputs, as the linear model has them. Raises Stopped."""
    problem, z = point.problem_of_run(k)
    run, grid, config = problem.runs[0], point.grids[k], problem.fitted(z)
    linearized = linearize(problem, z, context.pool)[0]
    fixed_run, nuisance = initialized(run, problem.nuisance(run, z))
    rows, first_row = port_responses(ports, config, fixed_run, nuisance, grid, context)
    rows.append(np.array([binned(row, run, grid).ravel() for row in linearized.jacobian]))
    all_rows = np.concatenate(rows)
    unbinned = linearized.residuals + point.sensor_offsets(k, nuisance.delay)
    residuals = binned(unbinned, run, grid)
    excess = float(np.sum(unbinned**2) - np.sum(residuals**2))
    for port, u in point.inputs[k].items():
        part = slice(first_row[port.name], first_row[port.name] + len(u))
        residuals = residuals - ((u / port.probe) @ all_rows[part]).reshape(residuals.shape)
    return RunDesign(
        run.name,
        run.channels,
        grid,
        residuals,
        all_rows,
        first_row,
        point.problem.indices()[k],
        statistics_by_fold(all_rows, residuals, grid),
        excess,
        run.samples,
        columns_at_knots(config, replace(fixed_run, time=grid.knots), nuisance),
    )


def port_responses(
    ports: Sequence[Port], config: Config, run: FitData, nuisance: Nuisance, grid: KnotGrid, context: SearchContext
) -> tuple[list[Matrix], dict[str, int]]:
    """Rows (knots, channels bins) by port of an initialized run, and where each port's begin. Raises Stopped."""
    futures = {
        port: [] if port.hook == 'sensing' else submit_responses(port, run, grid, config, nuisance, context.pool)
        for port in ports
    }
    rows: list[Matrix] = []
    first_row, at = {}, 0
    for port, tasks in futures.items():
        if context.stop.is_set():
            for pending in (task for others in futures.values() for task in others):
                pending.cancel()
            raise Stopped
        responses = (
            np.concatenate([task.result() for task in tasks]) if tasks else sensor_responses(port, run, grid, nuisance.delay)
        )
        first_row[port.name] = at
        at += len(responses)
        rows.append(responses.reshape(len(responses), -1).astype(np.float64))
    return rows, first_row


def statistics_by_fold(rows: Matrix, residuals: Matrix, grid: KnotGrid) -> tuple[SufficientStatistics, ...]:
    """The statistics of all rows of a run over each fold of its blocks of time."""
    fold_of = np.tile(np.arange(grid.bins) * TIME_BLOCKS // grid.bins % GAP_FOLDS, len(residuals))
    values = residuals.ravel()
    folds = []
    for k in range(GAP_FOLDS):
        part, own = rows[:, fold_of == k], values[fold_of == k]
        folds.append(SufficientStatistics(part @ part.T, part @ own, float(own @ own), len(own)))
    return tuple(folds)
