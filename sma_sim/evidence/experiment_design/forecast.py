"""What each hypothesis foretells of a command that was not given yet: channels, their derivatives, peaks.

The derivatives are secants along the columns of the posterior's root, half a standard deviation long: they see the
model on the scale on which it is uncertain, well above the solver's error.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from math import pi

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import CHANNEL_COLUMNS, Campaign, Recording
from sma_sim.evidence.estimation.executors import PickledConfig
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.residuals import FitData, Nuisance, fit_data, model_columns
from sma_sim.evidence.experiment_design.rival_fits import Hypothesis
from sma_sim.evidence.experiment_design.sequences import Grid, as_input
from sma_sim.model.config import Config
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
STEP = 0.5  # of a secant, in standard deviations of the posterior
SAMPLES = 1000  # of a trial at the most; each then counts for several of the measurement
RTOL = 1e-5  # of the simulations


@dataclass(frozen=True)
class Limits:
    """What no hypothesis may exceed: temperature [K] and stress [Pa] of the wires."""

    temperature: float
    stress: float


Place = tuple[PickledConfig, Nuisance]  # a model, and what is unknown about the run


@dataclass(frozen=True)
class Points:
    """Where a hypothesis is looked at: `centres` times (a centre, its `columns` neighbours), then `draws`.

    `steps` (centres, columns): how far the neighbours lie, in standard deviations.
    """

    at: tuple[Place, ...]
    steps: Matrix
    draws: int


def placed(problem: Problem, z: Vector) -> Place:
    """The model at z."""
    return PickledConfig(problem.fitted(z)), problem.nuisance(z)


@dataclass(frozen=True)
class Foretold:
    """Channels over noise under one command, flattened to (N,): `centres` (c, N), `jacobians` (c, m, N), `draws` (d, N).

    Derivatives are by the whitened unknowns: shared ones and starts, prior covariance 1. Then the largest temperature [K]
    and stress [Pa].
    """

    centres: Matrix
    jacobians: NDArray[np.float64]
    draws: Matrix
    temperature: float
    stress: float

    def within(self, limits: Limits) -> bool:
        """Whether nothing exceeds the limits."""
        return self.temperature <= limits.temperature and self.stress <= limits.stress


def empty_run(training: Campaign, grid: Grid, factor: float) -> tuple[FitData, int]:
    """A run as the recordings are, with their channels and sample rate, measured as zero; its command is still nothing.

    Only every so-many-th sample is looked at (that number comes second); weights count all. `factor` widens the noise.
    """
    first = training.recordings[0]
    rate = 1.0 / float(np.median(np.concatenate([np.diff(one.time) for one in training.recordings])))
    time = np.arange(1, int(grid.length * rate) + 1) / rate
    every = max(1, -(-len(time) // SAMPLES))
    channels = {name: np.zeros(len(time)) for name in first.channels}
    T_E = float(first.source.values[0, -1])
    blank = Recording('next', 'module', time, channels, as_input(np.zeros(grid.cells), grid, T_E))
    run = fit_data(blank, training.noise_std, every, RTOL, step_limited=True)
    return replace(run, weight=run.weight * np.sqrt(every) / factor), every


def points_of(one: Hypothesis, run: FitData, centres: int, draws: int, seed: int) -> Points:
    """The fitted values with their neighbours, and `draws`; so for `centres` - 1 of the draws too."""
    problem = replace(one.fitted.problem.at_tolerance(RTOL), runs=(run,), delay=None)
    low, high = problem.limits()
    n, wires = one.shared, problem.wires
    root = np.zeros((n + wires, n + wires))
    root[:n, :n], root[n:, n:] = one.root, np.eye(wires)
    best = np.clip(np.concatenate([one.fitted.z[:n], one.starts]), low, high)
    random = np.random.default_rng(seed)
    drawn = [np.concatenate([draw, random.uniform(-1.0, 1.0, wires)]) for draw in one.draws]
    at: list[Vector] = []
    steps = np.zeros((centres, n + wires))
    for c, middle in enumerate([best, *drawn[: centres - 1]]):
        neighbours, steps[c] = neighbours_of(middle, root, low, high)
        at += [middle, *neighbours]
    at += drawn[:draws]
    return Points(tuple(placed(problem, z) for z in at), steps, draws)


def neighbours_of(middle: Vector, root: Matrix, low: Vector, high: Vector) -> tuple[list[Vector], Vector]:
    """A point along each column of the root, forwards or, where a bound is near, backwards, and the steps."""
    found, steps = [], np.zeros(len(middle))
    for k, column in enumerate(root.T):
        room = [min_ratio(sign * column, middle, low, high) for sign in (1.0, -1.0)]
        sign = 1.0 if room[0] >= room[1] else -1.0
        steps[k] = sign * min(STEP, max(room))
        found.append(middle + steps[k] * column)
    return found, steps


def min_ratio(direction: Vector, at: Vector, low: Vector, high: Vector) -> float:
    """How far one can go before a bound."""
    room = np.where(direction > 0.0, high - at, at - low) / np.maximum(np.abs(direction), 1e-300)
    return float(room.min())


def foretell(points: Sequence[Points], runs: Sequence[FitData], pool: Executor) -> list[list[Foretold | None]]:
    """What hypotheses foretell, for each run by hypothesis; None where one cannot be run."""
    futures = [[pool.submit(one_run, part.at, run) for part in points] for run in runs]
    return [
        [gathered(part, future.result()) for part, future in zip(points, row, strict=True)]
        for row in futures
    ]  # fmt: skip


Shown = tuple[Vector, float, float]  # channels over noise (N,), the largest temperature and stress


def one_run(at: Sequence[Place], run: FitData) -> list[Shown] | None:
    """All points of one hypothesis under one command."""
    try:
        found = [shown(parcel.config, run, nuisance) for parcel, nuisance in at]
    except SimulationError:
        return None
    return found if all(np.isfinite(values).all() for values, _, _ in found) else None


def shown(config: Config, run: FitData, nuisance: Nuisance) -> Shown:
    """One simulation. Raises SimulationError."""
    columns = model_columns(config, run, nuisance)
    values = np.array([columns[CHANNEL_COLUMNS[name]] for name in run.channels]) * run.weight
    section = config.parameters['wire.n'] * pi * config.parameters['wire.r0'] ** 2
    hottest = max(columns['T_1_K'].max(), columns['T_2_K'].max())
    return values.ravel(), float(hottest), float(max(columns['F_1_N'].max(), columns['F_2_N'].max()) / section)


def gathered(points: Points, found: list[Shown] | None) -> Foretold | None:
    """The points of one hypothesis in their places."""
    if found is None:
        return None
    values = np.array([one[0] for one in found])
    centres, columns = points.steps.shape
    block = values[: centres * (columns + 1)].reshape(centres, columns + 1, -1)
    steps = np.where(points.steps == 0.0, np.inf, points.steps)
    return Foretold(
        block[:, 0], (block[:, 1:] - block[:, :1]) / steps[:, :, None], values[len(values) - points.draws :],
        max(one[1] for one in found), max(one[2] for one in found),
    )  # fmt: skip


def with_command(run: FitData, levels: Vector, grid: Grid) -> FitData:
    """The run under a command."""
    return replace(run, source=as_input(levels, grid, float(run.source.values[0, -1])))
