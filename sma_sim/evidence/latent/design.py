"""The linear problem of one model: how each run responds to every port and to all that was fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from threading import Event

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.latent.hypotheses import Hypothesis
from sma_sim.evidence.latent.inference import Products, added
from sma_sim.evidence.latent.ports import Port
from sma_sim.evidence.latent.priors import Points
from sma_sim.evidence.latent.responses import Grid, binned, grid_of, ready, sensed, submitted
from sma_sim.evidence.parallel import Parcel
from sma_sim.evidence.problem import Linear, Problem, linearise
from sma_sim.evidence.recording import CHANNEL_COLUMNS
from sma_sim.evidence.residuals import Nuisance, Prepared, model_columns, weighted_residuals
from sma_sim.model.config import Config
from sma_sim.model.effects.ports import CHANNELS

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
MOST_KNOTS = 200  # spacings of all runs together
FOLDS, BLOCKS = 5, 25  # a run is cut into blocks of time; every fifth is left out at once
Told = Callable[[str], None]


@dataclass(frozen=True)
class RunDesign:
    """One run: binned residuals (channels, bins), its rows (ports' knots, then its z), and their products by fold.

    `rows` (rows, channels bins) are per probe and per unit of z; `first` tells where the rows of a port begin, `place`
    where its z are among all. `raw` is the sum of squares of the samples, `samples` their number. `columns`: the model
    at the knots.
    """

    name: str
    channels: tuple[str, ...]
    grid: Grid
    residuals: Matrix
    rows: Matrix
    first: Mapping[str, int]
    place: NDArray[np.int64]
    folds: tuple[Products, ...]
    raw: float
    samples: int
    columns: Mapping[str, Vector]

    def of_ports(self, ports: Sequence[Port]) -> NDArray[np.int64]:
        """The rows of some ports."""
        count = np.arange(len(self.grid.knots))
        return np.concatenate([self.first[port.name] + count for port in ports])

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

    def products(self, one: Hypothesis, fold: int | None = None) -> Products:
        """The products of a hypothesis over all data (with the pull of the fit's prior), or over one fold."""
        rows, places, m = self.places(one)
        size = m + len(self.z)
        gram, pull, squares, count = np.zeros((size, size)), np.zeros(size), 0.0, 0
        for run, own, place in zip(self.runs, rows, places, strict=True):
            part = added(run.folds) if fold is None else run.folds[fold]
            gram[np.ix_(place, place)] += part.gram[np.ix_(own, own)]
            pull[place] += part.pull[own]
            squares, count = squares + part.squares, count + part.count
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
        parts = [
            (q, port, run, states_at(port, run.columns, T_E)) for q, run in enumerate(self.runs) for port in one.ports
        ]
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


def design_of(problem: Problem, z: Vector, ports: Sequence[Port], pool: Executor, stop: Event, told: Told) -> Design:
    """Every run's response to every port at every knot. Raises Stopped."""
    linear = linearise(problem, z, pool)
    config, most = problem.fitted(z), MOST_KNOTS // len(problem.runs)
    runs = []
    for run, one in zip(problem.runs, linear, strict=True):
        grid = grid_of(run, most)
        told(f'responses of {run.name} to {len(ports)} ports at {len(grid.knots)} instants')
        runs.append(run_design(config, run, one, grid, problem.nuisance(z[one.place]), ports, pool, stop))
    return Design(tuple(runs), z)


def run_design(
    config: Config, run: Prepared, one: Linear, grid: Grid, nuisance: Nuisance, ports: Sequence[Port], pool: Executor,
    stop: Event,
) -> RunDesign:  # fmt: skip
    """One run's responses. Raises Stopped."""
    begun, marked, plain = ready(config, run, grid, nuisance)
    base = binned(weighted_residuals(begun, marked, plain), run, grid)
    work = {
        port: [] if port.hook == 'sensing' else submitted(port, marked, grid, Parcel(begun), plain, base, pool)
        for port in ports
    }
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
    rows.append(np.array([binned(row, run, grid).ravel() for row in one.jacobian]))
    every = np.concatenate(rows).astype(float)
    residuals = binned(one.residuals, run, grid)
    return RunDesign(
        run.name, run.channels, grid, residuals, every, first, one.place, products_by_fold(every, residuals, grid),
        float(np.sum(one.residuals**2)), run.samples, model_columns(begun, replace(marked, time=grid.knots), plain),
    )  # fmt: skip


def products_by_fold(rows: Matrix, residuals: Matrix, grid: Grid) -> tuple[Products, ...]:
    """The products of all rows of a run over each fold of its blocks of time."""
    channels = len(residuals)
    fold = np.tile(np.arange(grid.bins) * BLOCKS // grid.bins % FOLDS, channels)
    values = residuals.ravel()
    found = []
    for k in range(FOLDS):
        part, own = rows[:, fold == k], values[fold == k]
        found.append(Products(part @ part.T, part @ own, float(own @ own), len(own)))
    return tuple(found)
