"""How well parameters predict runs that they were not fitted to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import log, nan
from threading import Event

import numpy as np

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.executors import PickledConfig, executor_or_threads, in_turn
from sma_sim.evidence.estimation.levenberg_marquardt import minimize
from sma_sim.evidence.estimation.prepared_fit import check_data
from sma_sim.evidence.estimation.problem import (
    POWER,
    START,
    SWITCH,
    EvaluationTask,
    Problem,
    evaluate,
    start_point,
    values_in_order,
)
from sma_sim.evidence.estimation.residuals import (
    FitData,
    Nuisance,
    check_delay,
    error_over_noise,
    fit_data,
    leeway_for,
    offsets_of,
    planned_run,
    with_start,
    zero_of,
)
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import RUN_UNKNOWNS
from sma_sim.model.argument_checks import checked
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.solver.beginning import AT_REST, Beginning
from sma_sim.solver.simulate import SimulationError

INITIAL_GUESSES = (0.0, -0.9, 0.9)  # of a start, in its coordinate (-1 on sigma_A, 1 on sigma_M)
BEGINNING = 0.1  # of a run, from which the state in which it begins is estimated: nine tenths judge the prediction
GOOD_FIT = 1.1  # error over that of the fitted runs, or over noise, with which no further guess is tried


@dataclass(frozen=True)
class RunFit:
    """One run under a model.

    `start`: per wire the part of the hysteresis (0 on sigma_A, 1 on sigma_M) and `x_M` the phase fraction there;
    `switches`: parts of the sampling interval by which sampled commands came before their rows; `channel_errors`: RMSE
    over noise; `error`: sqrt(mean over channels of its square). `zero`: what a strain gauge of unknown zero shows too much;
    `zeros`: the same of other channels, by channel (SI); `drifts`: by how much these zeros drift within the run.
    `quasi_static`: a test whose time says nothing. `ambient`: by how much its ambient temperature was above that of its
    input, `ambient_std`: the prior of that [K]. `T_E`: its ambient temperature at the beginning
    [K]. `beginning`: what was left then of a motion before. `powers`: by how much each power that was commanded
    was more than is written [W]. `factors`: by parameter that was another one then, how many times as large it was.
    """

    name: str
    start: tuple[float, ...]
    x_M: tuple[float, ...]
    switches: tuple[float, ...]
    channel_errors: Mapping[str, float]
    error: float
    zero: float = 0.0
    zeros: Mapping[str, float] = field(default_factory=dict)
    drifts: Mapping[str, float] = field(default_factory=dict)
    quasi_static: bool = False
    ambient: float = 0.0
    ambient_std: float = 0.0
    T_E: float = nan
    beginning: Beginning = AT_REST
    powers: tuple[float, ...] = ()
    factors: tuple[tuple[str, float], ...] = ()


def nuisances_of(delay: float, fits: Sequence[RunFit]) -> dict[str, Nuisance]:
    """What was estimated of each run beside the parameters, by its name."""
    return {
        fit.name: Nuisance(
            0.0 if fit.quasi_static else delay,
            fit.start,
            fit.switches,
            fit.quasi_static,
            fit.ambient,
            fit.beginning,
            fit.powers,
            fit.factors,
        )
        for fit in fits
    }


def point_with(problem: Problem, known: Sequence[float], fits: Sequence[RunFit]) -> Vector:
    """The point z (n,) of a problem from its first unknowns and what was estimated of the other runs, within the bounds."""
    z = list(known)
    for run, fit in zip(problem.runs[len(problem.runs) - len(fits) :], fits, strict=True):  # in the order of Problem.own
        ambient = [fit.ambient / fit.ambient_std] if fit.ambient_std > 0.0 else []
        z += [*map(START.coordinate, fit.start), *map(SWITCH.coordinate, fit.switches), *ambient]
        z += [POWER.coordinate(power / step) for power, step in zip(fit.powers, run.rounded_to, strict=True)]
        z += [log(factor) / run.varied[name] for name, factor in fit.factors]
        left = fit.beginning.parts
        for kind, stds in problem.beginning_std(run).parts.items():
            z += [value / std for value, std in zip(left.get(kind) or (0.0,) * len(stds), stds, strict=True)]
    return start_point(problem, np.array(z))


def mean_error(channel_errors: Mapping[str, float]) -> float:
    """sqrt(mean over channels of the square of normalized RMSE)."""
    return float(np.sqrt(np.mean(np.square(list(channel_errors.values()))))) if channel_errors else float('nan')


def pooled_error(fits: Sequence[RunFit]) -> tuple[float, dict[str, float]]:
    """Normalized RMSE of several runs, in all and by channel; NaN where there are none."""
    names = dict.fromkeys(name for fit in fits for name in fit.channel_errors)
    errors = {name: mean_error(by_run(fits, name)) for name in names}
    return mean_error(errors), errors


def by_run(fits: Sequence[RunFit], channel: str) -> dict[str, float]:
    """The error of one channel by run."""
    return {fit.name: fit.channel_errors[channel] for fit in fits if channel in fit.channel_errors}


def run_errors(task: EvaluationTask) -> dict[str, float] | None:
    """Normalized RMSE of one run at one point by channel; None where the model cannot be run."""
    (residuals,) = evaluate(task)
    return None if residuals is None else error_over_noise(residuals, task.run)


def run_fits(problem: Problem, z: Vector, executor: Executor) -> tuple[RunFit, ...]:
    """Errors and nuisances of every run at z; infinite errors where the model cannot be run."""
    config, fits, pickled = problem.fitted(z), [], PickledConfig(problem.fitted(z))
    nuisances = [problem.nuisance(run, z[indices]) for run, indices in zip(problem.runs, problem.indices(), strict=True)]
    tasks = [EvaluationTask(run, ((pickled, nuisance),)) for run, nuisance in zip(problem.runs, nuisances, strict=True)]
    by_run = in_turn(executor, run_errors, tasks)  # residuals would not fit into the memory
    for run, nuisance, found in zip(problem.runs, nuisances, by_run, strict=True):
        errors = found or dict.fromkeys(run.channels, np.inf)
        initial = (
            with_start(run.on_bench(config, nuisance), planned_run(run, nuisance)[0], nuisance.start).parameters
            if found is not None
            else config.parameters
        )
        x = tuple(initial[f'initial.x_M_{i + 1}'] for i in range(run.starts))
        zero = zero_of(config, run, nuisance) if nuisance.unknown_zero and found is not None else 0.0
        zeros, drifts = offsets_of(config, run, nuisance) if found is not None else ({}, {})
        fits.append(
            RunFit(
                run.name,
                nuisance.start,
                x,
                nuisance.switches,
                errors,
                mean_error(errors),
                zero,
                zeros,
                drifts,
                quasi_static=nuisance.unknown_zero,
                ambient=nuisance.ambient,
                ambient_std=run.ambient_std,
                T_E=float(planned_run(run, nuisance)[0].values[0, -1]),
                beginning=nuisance.beginning,
                powers=nuisance.powers,
                factors=nuisance.factors,
            )
        )
    return tuple(fits)


def predict_runs(
    config: Config, runs: tuple[FitData, ...], delay: float, context: SearchContext, fitted_error: float = 1.0
) -> tuple[RunFit, ...]:
    """Runs under fixed parameters and delay; only their starts (and sampled switching instants) are estimated.

    What is left of a motion before a run is estimated from its beginning alone: the rest of it judges the prediction.
    From the middle of the hysteresis, and from its ends where that leads to no good: a start has several optima. The
    errors of a run that cannot be made are infinite. `fitted_error`: of the runs to which the model was fitted; one that is
    predicted as well needs no other start.
    """

    def predicted(run: FitData) -> RunFit:
        problem = Problem(config, (run,), (), delay=delay)
        if not problem.unknowns:
            return run_fits(problem, start_point(problem), context.pool)[0]
        leeway, found = leeway_for(config, run), list[RunFit]()
        for guess in INITIAL_GUESSES:
            z = start_point(problem)
            z[: run.starts] = guess
            known = problem
            with suppress(SimulationError):  # a run that cannot be made is infinitely far off
                if run.is_in_motion:
                    z = minimize(replace(problem, runs=(beginning_of(run),)), z, RUN_UNKNOWNS, context).z
                    known = replace(problem, runs=(beginning_at(run, problem.nuisance(run, z).beginning),))
                    z = values_in_order(problem.own(run), z, known.own(known.runs[0]))
                smoothed = replace(known, runs=(replace(known.runs[0], leeway=leeway),))
                z = minimize(smoothed, z, RUN_UNKNOWNS, context).z
            found.append(run_fits(known, z, context.pool)[0])
            if found[-1].error <= GOOD_FIT * max(fitted_error, 1.0):
                break
        return min(found, key=lambda fit: fit.error)

    with ThreadPoolExecutor(len(runs)) as threads:
        return tuple(threads.map(predicted, runs))


def beginning_of(run: FitData) -> FitData:
    """The beginning of a run, which alone tells what is left of a motion before it."""
    until = run.time[0] + BEGINNING * (run.time[-1] - run.time[0])
    return replace(run, weight=run.weight * (run.time <= until))


def beginning_at(run: FitData, beginning: Beginning) -> FitData:
    """A run of which it is known what is left of a motion before it."""
    return replace(run, beginning_std=AT_REST, known_beginning=beginning)


@checked
def evaluate_held_out(
    config: Config, dataset: Dataset, delay: float = 0.0, executor: Executor | None = None, fitted_error: float = 1.0
) -> tuple[RunFit, ...]:
    """Predict recordings that were not fitted; only their initial states are estimated.

    Parameters
    ----------
    config : Config
        A fitted model.
    dataset : Dataset
        The recordings to predict, with their noise.
    delay : float
        Delay of the measurement [s], from the fit.
    executor : Executor, optional
        Where the simulations run; without it, threads on all cores.
    fitted_error : float
        Normalized RMSE of the runs to which the model was fitted: a run predicted as well needs no other start.

    Returns
    -------
    tuple of RunFit
        By recording: normalized RMSE, by channel too; infinite for a run that cannot be simulated.

    Raises
    ------
    UserError
        If the noise of a channel is not known.

    Examples
    --------
    >>> import sma_sim
    >>> command = sma_sim.module_input([0.0, 2.0, 8.0, 15.0], [0.0, 10.0, 0.0, 0.0])
    >>> run = sma_sim.simulate(sma_sim.Model(), command, 4.0)
    >>> recording = sma_sim.Recording('run1', 'module', run.time, {'alpha': run['alpha_rad']}, command)
    >>> dataset = sma_sim.Dataset((recording,), {'alpha': 3.5e-4})
    >>> sma_sim.evaluate_held_out(sma_sim.Config(), dataset)[0].error < 0.1
    True
    """
    check_data(dataset, config)
    for recording in dataset.recordings:
        check_delay(delay, recording.time, recording.name)
    if not fitted_error >= 0.0:
        raise UserError(f'fitted_error = {fitted_error}: expected a normalized RMSE, 0 or more')
    with executor_or_threads(executor) as pool:
        return predict_recordings(config, dataset, delay, pool, fitted_error)


def predict_recordings(
    config: Config, dataset: Dataset, delay: float, pool: Executor, fitted_error: float = 1.0
) -> tuple[RunFit, ...]:
    """Recordings as `evaluate_held_out` predicts them, of which it is known that they suit the configuration."""
    floor = config.parameters['solver.rtol']
    runs = tuple(fit_data(recording, dataset.noise_std, floor=floor) for recording in dataset.recordings)
    return predict_runs(config, runs, delay, SearchContext(pool, Event()), fitted_error)
