"""The linear problem of one model: how each run responds to every port and to all that was fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from threading import Event

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.evidence.estimation.injection_points import Port
from sma_sim.evidence.estimation.problem import Problem, linearize, residuals_at
from sma_sim.evidence.estimation.residuals import model_columns
from sma_sim.evidence.latent_input.covariances import Points
from sma_sim.evidence.latent_input.hypotheses import Hypothesis
from sma_sim.evidence.latent_input.inference import Products, added
from sma_sim.evidence.latent_input.sensitivities import (
    Grid,
    acting,
    binned,
    course_at,
    grid_of,
    marked,
    ready,
    sensed,
    submitted,
)
from sma_sim.model.effects.ports import CHANNELS

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
MOST_KNOTS = 200  # spacings of all runs together
FOLDS, BLOCKS = 5, 25  # a run is cut into blocks of time; every fifth is left out at once
OnProgress = Callable[[str], None]


@dataclass(frozen=True)
class RunDesign:
    """One run: binned residuals (channels, bins), its rows (ports' knots, then its z), and their products by fold.

    `rows` (rows, channels bins) are per probe and per unit of z; `first` tells where the rows of a port begin, `place`
    where its z are among all. `excess`: squares of the samples beyond those of the bins, `samples` their number.
    `columns`: the model at the knots.
    """

    name: str
    channels: tuple[str, ...]
    grid: Grid
    residuals: Matrix
    rows: Matrix
    first: Mapping[str, int]
    place: NDArray[np.int64]
    folds: tuple[Products, ...]
    excess: float
    samples: int
    columns: Mapping[str, Vector]

    def of_ports(self, ports: Sequence[Port]) -> NDArray[np.int64]:
        """The rows of some ports, if any."""
        first = np.array([self.first[port.name] for port in ports], dtype=np.int64)
        return (first[:, None] + np.arange(len(self.grid.knots))).ravel()

    @property
    def of_shifts(self) -> NDArray[np.int64]:
        """The rows of z."""
        return np.arange(len(self.rows) - len(self.place), len(self.rows))


@dataclass(frozen=True)
class Design:
    """All runs, and the point z (n,) around which they are linearised."""

    runs: tuple[RunDesign, ...]
    z: Vector

    def places(self, one: Hypothesis) -> tuple[list[NDArray[np.int64]], list[NDArray[np.int64]], int]:
        """Per run, which of its rows a hypothesis uses and where they go in (u, z); and the length of u."""
        rows, places, at = [], [], 0
        m = sum(len(run.grid.knots) for run in self.runs) * len(one.ports)
        for run in self.runs:
            own = run.of_ports(one.ports)
            rows.append(np.concatenate([own, run.of_shifts]))
            places.append(np.concatenate([at + np.arange(len(own)), m + run.place]))
            at += len(own)
        return rows, places, m

    def products(self, one: Hypothesis, widened: float = 1.0, fold: int | None = None) -> Products:
        """The products of a hypothesis over all data (with the pull of the fit's prior), or over one fold.

        `widened`: the variance of noise, over what was stated.
        """
        rows, places, m = self.places(one)
        size = m + len(self.z)
        gram, pull, squares, count = np.zeros((size, size)), np.zeros(size), 0.0, 0
        for run, own, place in zip(self.runs, rows, places, strict=True):
            part = added(run.folds) if fold is None else run.folds[fold]
            gram[np.ix_(place, place)] += part.gram[np.ix_(own, own)] / widened
            pull[place] += part.pull[own] / widened
            squares, count = squares + part.squares / widened, count + part.count
        if fold is None:
            pull[m:] += self.z
        return Products(gram, pull, squares, count)

    def pulls(self, one: Hypothesis, data: Sequence[Matrix]) -> Matrix:
        """The pulls (m + n, draws) of other residuals, (channels bins, draws) by run."""
        rows, places, m = self.places(one)
        found = np.zeros((m + len(self.z), data[0].shape[1]))
        for run, own, place, residuals in zip(self.runs, rows, places, data, strict=True):
            found[place] += run.rows[own] @ residuals
        return found

    def points(self, one: Hypothesis, T_E: float) -> Points:
        """Where the values of a hypothesis are, and the states of the model there."""
        parts = [(q, port, run, states_at(port, run.columns, T_E)) for q, run in enumerate(self.runs) for port in one.ports]
        knots = [len(run.grid.knots) for _, _, run, _ in parts]
        return Points(
            run=np.repeat([float(q) for q, _, _, _ in parts], knots),
            wire=np.repeat([float(port.component) for _, port, _, _ in parts], knots),
            t=np.concatenate([run.grid.knots - run.grid.knots[0] for _, _, run, _ in parts]),
            states={name: np.concatenate([states[name] for _, _, _, states in parts]) for name in parts[0][3]},
        )

    def left(self, one: Hypothesis, x: Vector) -> list[Matrix]:
        """Residuals (channels, bins) by run after a change x of (u, z)."""
        rows, places, _ = self.places(one)
        return [
            run.residuals + (x[place] @ run.rows[own]).reshape(run.residuals.shape)
            for run, own, place in zip(self.runs, rows, places, strict=True)
        ]


def states_at(port: Port, columns: Mapping[str, Vector], T_E: float) -> dict[str, Vector]:
    """The states of the model on which a quantity at this port may depend, (knots,) each."""
    if port.hook == 'sensing':
        return {'value': columns[CHANNEL_COLUMNS[CHANNELS[port.component]]]}
    if port.hook == 'structure_force':
        return {'alpha': columns['alpha_rad']}
    if 'J_W' in columns:
        return {'T': columns['T_K'] - T_E, 'x': columns['x_M'], 'J': columns['J_W']}
    i = port.component + 1
    side = columns['J_eq_W'] if i == 1 else -columns['J_eq_W']
    return {'T': columns[f'T_{i}_K'] - T_E, 'x': columns[f'x_M_{i}'], 'J': np.maximum(side, 0.0)}


class Stopped(Exception):
    """Ctrl-C before there was enough to tell anything."""


@dataclass(frozen=True)
class Place:
    """Around what a model is linearised: the runs (with a row of input at every knot), z (n,), and courses by run and port.

    `courses` (knots,) are in the ports' units; a port that has none is at zero.
    """

    problem: Problem
    grids: tuple[Grid, ...]
    z: Vector
    courses: tuple[Mapping[Port, Vector], ...]

    def problem_of(self, k: int) -> tuple[Problem, Vector]:
        """The problem of one run by itself, its courses active, and its part of z."""
        acts = [acting(port, self.grids[k], u) for port, u in self.courses[k].items() if port.hook != 'sensing']
        config = replace(self.problem.config, effects=(*self.problem.config.effects, *acts))
        return replace(self.problem, config=config, runs=(self.problem.runs[k],)), self.z[self.problem.places()[k]]

    def sensors(self, k: int, delay: float) -> Matrix:
        """What courses of the sensing ports add to the weighted residuals of a run, (channels, samples)."""
        run, grid = self.problem.runs[k], self.grids[k]
        shown = np.zeros_like(run.weight)
        for port, u in self.courses[k].items():
            if port.hook == 'sensing':
                row = run.channels.index(CHANNELS[port.component])
                shown[row] += course_at(grid, u, run.time - delay) * run.weight[row]
        return shown

    def residuals(self, pool: Executor) -> list[Matrix | None]:
        """Binned residuals (channels, bins) of every run; None where the model cannot be run."""
        found: list[Matrix | None] = []
        for k, run in enumerate(self.problem.runs):
            problem, z = self.problem_of(k)
            shown = residuals_at(problem, z, pool)[0]
            extra = self.sensors(k, problem.delay_at(z))
            found.append(None if shown is None else binned(shown + extra, run, self.grids[k]))
        return found


def place_of(problem: Problem, z: Vector) -> Place:
    """The fitted model itself."""
    grids = tuple(grid_of(run, MOST_KNOTS // len(problem.runs)) for run in problem.runs)
    runs = tuple(replace(run, source=marked(run.source, grid.knots)) for run, grid in zip(problem.runs, grids, strict=True))
    return Place(replace(problem, runs=runs), grids, z, tuple({} for _ in runs))


def design_of(place: Place, ports: Sequence[Port], pool: Executor, stop: Event, on_progress: OnProgress) -> Design:
    """Every run's response to every port at every knot. Raises Stopped."""
    runs = []
    for k, run in enumerate(place.problem.runs):
        on_progress(f'responses of {run.name} to {len(ports)} ports at {len(place.grids[k].knots)} instants')
        runs.append(run_design(place, k, ports, pool, stop))
    return Design(tuple(runs), place.z)


def run_design(place: Place, k: int, ports: Sequence[Port], pool: Executor, stop: Event) -> RunDesign:
    """One run's responses. Its residuals are those without the courses, as the linear model has them. Raises Stopped."""
    problem, z = place.problem_of(k)
    run, grid, config = problem.runs[0], place.grids[k], problem.fitted(z)
    linear = linearize(problem, z, pool)[0]
    begun, plain_run, plain = ready(config, run, problem.nuisance(z))
    work = {port: [] if port.hook == 'sensing' else submitted(port, plain_run, grid, begun, plain, pool) for port in ports}
    rows, first, at = [], {}, 0
    for port, futures in work.items():
        if stop.is_set():
            for future in (future for later in work.values() for future in later):
                future.cancel()
            raise Stopped
        shown = np.concatenate([f.result() for f in futures]) if futures else sensed(port, run, grid, plain.delay)
        first[port.name] = at
        at += len(shown)
        rows.append(shown.reshape(len(shown), -1))
    rows.append(np.array([binned(row, run, grid).ravel() for row in linear.jacobian]))
    every = np.concatenate(rows).astype(float)
    raw = linear.residuals + place.sensors(k, plain.delay)
    residuals = binned(raw, run, grid)
    excess = float(np.sum(raw**2) - np.sum(residuals**2))
    for port, u in place.courses[k].items():
        part = slice(first[port.name], first[port.name] + len(u))
        residuals = residuals - ((u / port.probe) @ every[part]).reshape(residuals.shape)
    return RunDesign(
        run.name, run.channels, grid, residuals, every, first, place.problem.places()[k],
        products_by_fold(every, residuals, grid), excess, run.samples,
        model_columns(begun, replace(plain_run, time=grid.knots), plain),
    )  # fmt: skip


def products_by_fold(rows: Matrix, residuals: Matrix, grid: Grid) -> tuple[Products, ...]:
    """The products of all rows of a run over each fold of its blocks of time."""
    fold = np.tile(np.arange(grid.bins) * BLOCKS // grid.bins % FOLDS, len(residuals))
    values = residuals.ravel()
    found = []
    for k in range(FOLDS):
        part, own = rows[:, fold == k], values[fold == k]
        found.append(Products(part @ part.T, part @ own, float(own @ own), len(own)))
    return tuple(found)
