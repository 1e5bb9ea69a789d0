"""How well parameters foretell runs that they were not fitted to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from threading import Event

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import Campaign
from sma_sim.evidence.estimation.executors import some_executor
from sma_sim.evidence.estimation.levenberg_marquardt import FIRST, LAST, REFIT, minimize, start_point
from sma_sim.evidence.estimation.problem import START, SWITCH, Problem, residuals_at
from sma_sim.evidence.estimation.residuals import FitData, error_over_noise, fit_data, started
from sma_sim.model.config import Config
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
FOLDS = 5
BEGINNINGS = (0.0, -0.9, 0.9)  # of a start, in its coordinate (-1 on sigma_A, 1 on sigma_M)
GOOD = 1.1  # error over noise with which no other beginning is tried


@dataclass(frozen=True)
class RunFit:
    """One run under a model.

    `start`: per wire the part of the hysteresis (0 on sigma_A, 1 on sigma_M) and `x_M` the phase fraction there;
    `switches`: parts of the sampling interval by which sampled commands came before their rows; `channels`: RMSE over
    noise; `error`: sqrt(mean over channels of its square).
    """

    name: str
    start: tuple[float, ...]
    x_M: tuple[float, ...]
    switches: tuple[float, ...]
    channels: Mapping[str, float]
    error: float


def own_unknowns(fit: RunFit) -> list[float]:
    """The coordinates of a run's starts and switching instants, in the order of Problem.own."""
    return [*map(START.coordinate, fit.start), *map(SWITCH.coordinate, fit.switches)]


def mean_error(channels: Mapping[str, float]) -> float:
    """sqrt(mean over channels of the square of RMSE over noise)."""
    return float(np.sqrt(np.mean(np.square(list(channels.values()))))) if channels else float('nan')


def summed_up(fits: Sequence[RunFit]) -> tuple[float, dict[str, float]]:
    """Error over noise of several runs, in all and by channel; NaN where there are none."""
    names = dict.fromkeys(name for fit in fits for name in fit.channels)
    channels = {name: mean_error(by_run(fits, name)) for name in names}
    return mean_error(channels), channels


def by_run(fits: Sequence[RunFit], channel: str) -> dict[str, float]:
    """The error of one channel by run."""
    return {fit.name: fit.channels[channel] for fit in fits if channel in fit.channels}


def run_fits(problem: Problem, z: Vector, executor: Executor) -> tuple[RunFit, ...]:
    """Errors and nuisances of every run at z; infinite errors where the model cannot be run."""
    config, fits = problem.fitted(z), []
    residuals = residuals_at(problem, z, executor)
    for run, place, found in zip(problem.runs, problem.places(), residuals, strict=True):
        nuisance = problem.nuisance(z[place])
        errors = dict.fromkeys(run.channels, np.inf) if found is None else error_over_noise(found, run)
        initial = started(config, run.source, nuisance.start).parameters if found is not None else config.parameters
        x = tuple(initial[f'initial.x_M_{i + 1}'] for i in range(problem.wires))
        fits.append(RunFit(run.name, nuisance.start, x, nuisance.switches, errors, mean_error(errors)))
    return tuple(fits)


def foretell(config: Config, runs: tuple[FitData, ...], delay: float, executor: Executor, stop: Event) -> tuple[RunFit, ...]:
    """Runs under fixed parameters and delay; only their starts (and sampled switching instants) are estimated.

    From the middle of the hysteresis, and from its ends where that leads to no good: a start has several optima. The
    errors of a run that cannot be made are infinite.
    """

    def one(run: FitData) -> RunFit:
        problem = Problem(config, (run,), (), delay=delay)
        found: list[RunFit] = []
        for at in BEGINNINGS:
            z = start_point(problem)
            z[: problem.wires] = at
            with suppress(SimulationError):  # a run that cannot be made is infinitely far off
                z = minimize(problem, z, executor, replace(FIRST, enough=LAST.enough, gain=0.0), stop).z
            found.append(run_fits(problem, z, executor)[0])
            if found[-1].error <= GOOD:
                break
        return min(found, key=lambda fit: fit.error)

    with ThreadPoolExecutor(len(runs)) as threads:
        return tuple(threads.map(one, runs))


def held_out(config: Config, campaign: Campaign, delay: float = 0.0, executor: Executor | None = None) -> tuple[RunFit, ...]:
    """How well a fitted configuration and delay [s] foretell the recordings of a campaign; only starts are estimated.

    Infinite errors for a run that cannot be made. Raises UserError when a noise is not known.
    """
    floor = config.parameters['solver.rtol']
    runs = tuple(fit_data(recording, campaign.noise_std, floor=floor) for recording in campaign.recordings)
    with some_executor(executor) as pool:
        return foretell(config, runs, delay, pool, Event())


def folds(count: int) -> list[list[int]]:
    """Indices of the runs that are left out in turn: each run once, in FOLDS groups at the most."""
    groups = min(count, FOLDS)
    return [list(range(k, count, groups)) for k in range(groups)]


def cross_validated_error(problem: Problem, z: Vector, executor: Executor, stop: Event) -> float:
    """Mean error over noise of runs left out in turn (refitted from z without them); NaN for a single run."""
    if len(problem.runs) < 2:
        return float('nan')
    places = problem.places()

    def one(left_out: list[int]) -> list[float]:
        kept = [k for k in range(len(problem.runs)) if k not in left_out]
        runs = tuple(problem.runs[k] for k in kept)
        fewer = replace(problem, runs=runs)
        shared = len(problem.shared)
        at = np.concatenate([z[:shared], *(z[places[k][shared:]] for k in kept)])
        found = minimize(fewer, at, executor, REFIT, stop).z
        out = tuple(problem.runs[k] for k in left_out)
        return [fit.error for fit in foretell(fewer.fitted(found), out, fewer.delay_at(found), executor, stop)]

    with ThreadPoolExecutor(FOLDS) as threads:
        errors = [error for part in threads.map(one, folds(len(problem.runs))) for error in part]
    return float(np.sqrt(np.mean(np.square(errors))))


def with_starts(config: Config, fits: tuple[RunFit, ...]) -> Config:
    """The configuration with the mean start of the runs as initial.x_M_*."""
    x = np.mean([fit.x_M for fit in fits], axis=0)
    initial = {f'initial.x_M_{i + 1}': float(x[i]) for i in range(len(x))}
    return replace(config, parameters={**config.parameters, **initial})
