"""What each hypothesis predicts for a command that was not given yet: channels, their derivatives, peaks.

The derivatives are secants along the columns of the posterior's root, half a standard deviation long: they describe the
model on the scale on which it is uncertain, well above the solver's error.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import Dataset, Recording
from sma_sim.evidence.estimation.executors import PickledConfig
from sma_sim.evidence.estimation.residuals import FitData, Nuisance, fit_data, model_columns
from sma_sim.evidence.experiment_design.rival_fits import ModelHypothesis
from sma_sim.evidence.experiment_design.sequences import CommandGrid, as_input
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.config import Config
from sma_sim.solver.simulate import SimulationError
from sma_sim.solver.wire_columns import stresses_from_forces

SECANT_STEP = 0.5  # in standard deviations of the posterior
MAX_PREDICTED_SAMPLES = 1000  # of an experiment; each then counts for several of the measurement
PREDICTION_RTOL = 1e-5  # of the simulations: a hundredth of what a secant changes


@dataclass(frozen=True)
class OperatingLimits:
    """What no hypothesis may exceed: temperature [K] and stress [Pa] of the wires."""

    temperature: float
    stress: float


@dataclass(frozen=True)
class ModelPoint:
    """A model with values of all unknowns, and the nuisance parameters of the run."""

    config: PickledConfig
    nuisance: Nuisance


@dataclass(frozen=True)
class EvaluationPoints:
    """Where a hypothesis is simulated: `centres` times (a centre, its `columns` neighbours), then `draws`.

    `steps` (centres, columns): how far the neighbours lie, in standard deviations.
    """

    points: tuple[ModelPoint, ...]
    steps: Matrix
    draws: int


@dataclass(frozen=True)
class RunPrediction:
    """Channels over noise under one command, flattened to (N,): `centres` (c, N), `jacobians` (c, m, N), `draws` (d, N).

    Derivatives are by the whitened unknowns: shared ones and starts, prior covariance 1. Then the largest temperature [K]
    and stress [Pa].
    """

    centres: Matrix
    jacobians: NDArray[np.float64]
    draws: Matrix
    temperature: float
    stress: float

    def is_within(self, limits: OperatingLimits) -> bool:
        """Whether nothing exceeds the limits."""
        return self.temperature <= limits.temperature and self.stress <= limits.stress


@dataclass(frozen=True)
class SimulatedRun:
    """Channels over noise (N,), the largest temperature [K] and stress [Pa] of one simulation."""

    values: Vector
    temperature: float
    stress: float


def blank_run(training: Dataset, grid: CommandGrid, noise_factor: float) -> tuple[FitData, int]:
    """A run with the channels and sample rate of the recordings, measured as zero, without a command yet.

    Only every so-many-th sample is simulated (that number comes second); weights count all. `noise_factor` widens the noise.
    """
    first = training.recordings[0]
    rate = 1.0 / float(np.median(np.concatenate([np.diff(recording.time) for recording in training.recordings])))
    time = np.arange(1, int(grid.length * rate) + 1) / rate
    every = max(1, -(-len(time) // MAX_PREDICTED_SAMPLES))
    channels = {name: np.zeros(len(time)) for name in first.channels}
    T_E = float(first.source.values[0, -1])
    blank = Recording('next', first.system, time, channels, as_input(np.zeros(grid.cells), grid, T_E))
    run = fit_data(blank, training.noise_std, every, PREDICTION_RTOL, step_limited=True)
    return replace(run, weight=run.weight * np.sqrt(every) / noise_factor), every


def evaluation_points(hypothesis: ModelHypothesis, run: FitData, centres: int, draws: int, seed: int) -> EvaluationPoints:
    """The fitted values with their neighbours, and `draws`; for `centres` - 1 of the draws their neighbours too."""
    problem = replace(hypothesis.fitted.problem.at_tolerance(PREDICTION_RTOL), runs=(run,), delay=None)
    low, high = problem.limits()
    n, wires = hypothesis.shared, run.starts
    root = np.zeros((n + wires, n + wires))
    root[:n, :n], root[n:, n:] = hypothesis.root, np.eye(wires)
    best = np.clip(np.concatenate([hypothesis.fitted.z[:n], hypothesis.starts]), low, high)
    random = np.random.default_rng(seed)
    drawn = [np.concatenate([draw, random.uniform(-1.0, 1.0, wires)]) for draw in hypothesis.draws]
    points: list[Vector] = []
    steps = np.zeros((centres, n + wires))
    for c, centre in enumerate([best, *drawn[: centres - 1]]):
        neighbours, steps[c] = secant_points(centre, root, low, high)
        points += [centre, *neighbours]
    points += drawn[:draws]
    models = tuple(ModelPoint(PickledConfig(problem.fitted(z)), problem.nuisance(run, z)) for z in points)
    return EvaluationPoints(models, steps, draws)


def secant_points(centre: Vector, root: Matrix, low: Vector, high: Vector) -> tuple[list[Vector], Vector]:
    """A point along each column of the root, forwards or, where a bound is near, backwards, and the steps."""
    points, steps = [], np.zeros(len(centre))
    for k, column in enumerate(root.T):
        room = [distance_to_bound(sign * column, centre, low, high) for sign in (1.0, -1.0)]
        sign = 1.0 if room[0] >= room[1] else -1.0
        steps[k] = sign * min(SECANT_STEP, max(room))
        points.append(centre + steps[k] * column)
    return points, steps


def distance_to_bound(direction: Vector, z: Vector, low: Vector, high: Vector) -> float:
    """The largest multiple of a direction that stays within the bounds."""
    room = np.where(direction > 0.0, high - z, z - low) / np.maximum(np.abs(direction), 1e-300)
    return float(room.min())


def predict_hypotheses(
    hypotheses: Sequence[EvaluationPoints], runs: Sequence[FitData], pool: Executor
) -> list[list[RunPrediction | None]]:
    """What hypotheses predict, for each run by hypothesis; None where one cannot be simulated."""
    futures = [[pool.submit(simulate_points, points.points, run) for points in hypotheses] for run in runs]
    return [
        [prediction_from(points, future.result()) for points, future in zip(hypotheses, of_run, strict=True)]
        for of_run in futures
    ]


def simulate_points(points: Sequence[ModelPoint], run: FitData) -> list[SimulatedRun] | None:
    """All points of one hypothesis under one command; None where one cannot be simulated."""
    try:
        simulated = [simulate_run(point.config.config, run, point.nuisance) for point in points]
    except SimulationError:
        return None
    return simulated if all(np.isfinite(simulation.values).all() for simulation in simulated) else None


def simulate_run(config: Config, run: FitData, nuisance: Nuisance) -> SimulatedRun:
    """One simulation. Raises SimulationError."""
    columns = model_columns(config, run, nuisance)
    values = np.array([columns[run.columns[name]] for name in run.channels]) * run.weight
    suffixes = config.structure.wire_suffixes
    temperature = max(columns[f'T{suffix}_K'].max() for suffix in suffixes)
    stress = max(stress.max() for stress in stresses_from_forces(config, columns).values())
    return SimulatedRun(values.ravel(), float(temperature), float(stress))


def prediction_from(points: EvaluationPoints, simulated: list[SimulatedRun] | None) -> RunPrediction | None:
    """Centres, derivatives and draws from the simulations of one hypothesis."""
    if simulated is None:
        return None
    values = np.array([simulation.values for simulation in simulated])
    centres, columns = points.steps.shape
    block = values[: centres * (columns + 1)].reshape(centres, columns + 1, -1)
    steps = np.where(points.steps == 0.0, np.inf, points.steps)
    return RunPrediction(
        block[:, 0],
        (block[:, 1:] - block[:, :1]) / steps[:, :, None],
        values[len(values) - points.draws :],
        max(simulation.temperature for simulation in simulated),
        max(simulation.stress for simulation in simulated),
    )


def with_command(run: FitData, levels: Vector, grid: CommandGrid) -> FitData:
    """The run under a command."""
    return replace(run, source=as_input(levels, grid, float(run.source.values[0, -1])))
