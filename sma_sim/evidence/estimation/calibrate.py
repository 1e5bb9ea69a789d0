"""Calibration: weighted nonlinear least squares over the compiled simulator, from several starts, for either model.

Each descent begins on thinned samples, where it costs a third; the best goes on with all of them. Of two models the
one that foretells runs which it was not fitted to is taken (docs/explanation/calibration.md).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from functools import partial
from threading import Event
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import Campaign
from sma_sim.evidence.estimation.cross_validation import RunFit, cross_validated_error, mean_error, run_fits, with_starts
from sma_sim.evidence.estimation.executors import some_executor
from sma_sim.evidence.estimation.free_parameters import FreeParameter, Held, choose_free
from sma_sim.evidence.estimation.levenberg_marquardt import (
    FIRST,
    LAST,
    LIGHTER,
    MinimizerResult,
    Progress,
    StopCriteria,
    cost_at,
    feasible,
    minimize,
    start_point,
)
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.residuals import fit_data
from sma_sim.evidence.estimation.run_subset import of_all, part_of
from sma_sim.evidence.estimation.uncertainty import Uncertainty, uncertainty
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError

Vector = NDArray[np.float64]
Answer = TypeVar('Answer')
RTOL, LAST_RTOL = 1e-5, 1e-6  # of the simulations of the first descents and of the last
THINNED = 1000  # samples per run of the first descents
SPREAD = 0.25  # of further starts, in standard deviations of the priors
NEARER = 10.0  # damping at first when runs join a descent that has come to its end without them
TRIES = 20  # for a further start at which every run can be made
# Where the error is below CLEAN times the stated noise, weights grow as long as it stays below the noise by as much:
# priors weigh nothing then. In stages, because the valley of sharp weights is narrow.
CLEAN, SHARPER, POLISHED_RTOL = 0.1, (10.0, 100.0, 1000.0), 1e-7
SAME = 2.0  # a descent that ends within this of the best's cost has found the same
MODELS = ('hybrid', 'mas')
AT_BOUND = 1e-6


@dataclass(frozen=True)
class Options:
    """How to fit. `free` None: the default parameters. `model`: hybrid, mas, or auto for the better of both.

    `starts` descents, the first from the configuration, the others `seed`-ed around it; `robust`: Huber's loss.
    """

    free: tuple[str, ...] | None = None
    model: str = 'auto'
    starts: int = 2
    robust: bool = False
    seed: int = 0
    intervals: bool = True


@dataclass(frozen=True)
class OtherStart:
    """Where a further start led: its cost above the best's, its parameters, and whether it is the same optimum."""

    excess: float
    values: Mapping[str, float]
    same: bool


@dataclass(frozen=True)
class Calibration:
    """A fitted model; SI units. `config` runs as it is. `cost`: half the sum of squares, prior included.

    `channels` and `error`: RMSE over noise by channel, over all runs, and sqrt(mean of its square);
    `cross_validation`: that error on runs left out in turn, by model.
    """

    config: Config
    free: tuple[FreeParameter, ...]
    held: tuple[Held, ...]
    values: Mapping[str, float]
    delay: float
    runs: tuple[RunFit, ...]
    channels: Mapping[str, float]
    error: float
    cost: float
    iterations: int
    converged: bool
    interrupted: bool
    at_bound: tuple[str, ...]
    cross_validation: Mapping[str, float]
    other_starts: tuple[OtherStart, ...]
    uncertainty: Uncertainty | None
    seconds: float


@dataclass(frozen=True)
class MultistartResult:
    """The best descent of one model (on thinned samples at first), and where the other starts led."""

    problem: Problem
    best: MinimizerResult
    others: tuple[OtherStart, ...]
    validated: float = float('nan')


def calibrate(
    campaign: Campaign, config: Config, options: Options | None = None, executor: Executor | None = None,
    progress: Progress | None = None,
) -> Calibration:  # fmt: skip
    """Fit the free parameters of `config` to all recordings of a campaign.

    A KeyboardInterrupt ends the fit with the best so far (`interrupted`). Raises UserError for a campaign without
    recordings, noise or channels, for wrong options, and when the model cannot be run at the start.
    """
    options, t_start, stop = options or Options(), time.perf_counter(), Event()
    check(campaign, config, options)
    models = MODELS if options.model == 'auto' else (options.model,)
    with some_executor(executor) as pool:
        found: list[MultistartResult] = []
        for model in models:
            if not (found and stop.is_set()):
                found.append(search(campaign, replace(config, model=model), options, pool, stop, progress))
        if len(found) > 1:
            found = [replace(one, validated=validation(one, pool, stop)) for one in found]
        best = min(found, key=lambda one: (one.validated if np.isfinite(one.validated) else 0.0, one.best.cost))
        scores = {one.problem.config.model: one.validated for one in found if np.isfinite(one.validated)}
        best = finished(campaign, best, options, pool, stop, progress)
        return result(best, config.parameters['solver.rtol'], scores, options, pool, stop, t_start)


def check(campaign: Campaign, config: Config, options: Options) -> None:
    """Raise UserError for what cannot be fitted."""
    if not campaign.recordings:
        raise UserError('there is no recording to fit')
    for recording in campaign.recordings:
        if recording.system != config.system:
            raise UserError(f'{recording.name} is a recording of a {recording.system}, the configuration says system = '
                            f'{config.system}: change it, or leave the recording out')  # fmt: skip
    if options.model not in (*MODELS, 'auto'):
        raise UserError(f'model {options.model!r}: expected one of {", ".join(MODELS)}, auto')
    if options.starts < 1:
        raise UserError(f'starts = {options.starts}: expected 1 or more')


def problem_for(campaign: Campaign, config: Config, options: Options, every: int, step_limited: bool = True) -> Problem:
    """The problem on every `every`-th sample; not `step_limited` for a model that was chosen."""
    rtol = min(RTOL, config.parameters['solver.rtol'])
    free, _ = choose_free(config, options.free)
    runs = tuple(fit_data(recording, campaign.noise_std, every, rtol, step_limited) for recording in campaign.recordings)
    return Problem(config, runs, free, options.robust).at_tolerance(rtol)


def search(
    campaign: Campaign, config: Config, options: Options, pool: Executor, stop: Event, progress: Progress | None,
    effort: StopCriteria = FIRST,
) -> MultistartResult:  # fmt: skip
    """Descend from several starts on thinned samples, all but the first damped less; of many runs on a part at first."""
    longest = max(len(recording.time) for recording in campaign.recordings)
    thinned = problem_for(campaign, config, options, max(1, longest // THINNED))
    part = part_of(thinned)
    starts = starting_points(part, options, pool)
    lighter = replace(effort, damping=LIGHTER.damping)
    jobs = [
        partial(minimize, part, z, pool, lighter if k else effort, stop, progress, f'{config.model}, start {k + 1}')
        for k, z in enumerate(starts)
    ]
    descents = run_in_threads(jobs, stop)
    best = min(descents, key=lambda one: one.cost)
    others = tuple(
        OtherStart(one.cost - best.cost, thinned.values(one.z), one.cost - best.cost < SAME)
        for one in descents if one is not best
    )  # fmt: skip
    if len(part.runs) < len(thinned.runs):
        z = of_all(thinned, start_point(thinned), best.z)
        near, label = replace(effort, damping=NEARER), f'{config.model}, all runs'
        last = run_in_threads([partial(minimize, thinned, z, pool, near, stop, progress, label)], stop)[0]
        best = replace(last, iterations=last.iterations + best.iterations)
    return MultistartResult(thinned, best, others)


def finished(
    campaign: Campaign, found: MultistartResult, options: Options, pool: Executor, stop: Event, progress: Progress | None
) -> MultistartResult:
    """The descent continued on all samples, the parameters free within the same bounds."""
    config = found.problem.config
    whole = replace(problem_for(campaign, config, options, 1, step_limited=False), free=found.problem.free)
    problem = whole.at_tolerance(LAST_RTOL)
    label = f'{config.model}, all samples'
    last = run_in_threads([partial(minimize, problem, found.best.z, pool, LAST, stop, progress, label)], stop)[0]
    last = replace(last, iterations=last.iterations + found.best.iterations)
    for sharper in SHARPER:
        error = data_error(problem, last)
        if error * sharper > 10.0 * CLEAN or stop.is_set():
            break
        problem = whole.at_tolerance(POLISHED_RTOL)
        sharp = problem.weighted(sharper)
        polished = run_in_threads([partial(minimize, sharp, last.z, pool, LAST, stop, progress, f'{label}, sharper')], stop)[
            0
        ]
        last = at_stated_noise(problem, polished, last.iterations, pool)
    return replace(found, problem=problem, best=last)


def data_error(problem: Problem, found: MinimizerResult) -> float:
    """The error over noise, without the prior's share of the cost."""
    return float(np.sqrt(max(2.0 * found.cost - float(found.z @ found.z), 0.0) / problem.samples))


def at_stated_noise(problem: Problem, polished: MinimizerResult, before: int, pool: Executor) -> MinimizerResult:
    """A descent with sharper weights, its cost at the stated noise."""
    return replace(polished, cost=cost_at(problem, polished.z, pool), iterations=before + polished.iterations)


def starting_points(problem: Problem, options: Options, pool: Executor) -> list[Vector]:
    """The middle of the priors, then random points around it at which every run can be made."""
    points = [start_point(problem)]
    random = np.random.default_rng(options.seed)
    for _ in range(TRIES * (options.starts - 1)):
        if len(points) == options.starts:
            break
        guess = start_point(problem, SPREAD * random.normal(size=len(points[0])))
        if feasible(problem, guess, pool):
            points.append(guess)
    return points


def run_in_threads(jobs: Sequence[Callable[[], Answer]], stop: Event, at_once: int | None = None) -> list[Answer]:
    """The answers of jobs that run in threads of their own (so many at once); Ctrl-C asks them to come to an end."""
    with ThreadPoolExecutor(at_once or len(jobs)) as threads:
        futures = [threads.submit(job) for job in jobs]
        try:
            wait(futures)
        except KeyboardInterrupt:
            stop.set()
        return [future.result() for future in futures]


def validation(found: MultistartResult, pool: Executor, stop: Event) -> float:
    """The error on runs left out in turn, NaN where there is one run only."""
    if stop.is_set():
        return float('nan')
    return run_in_threads([lambda: cross_validated_error(found.problem, found.best.z, pool, stop)], stop)[0]


def result(
    found: MultistartResult,
    rtol: float,
    scores: Mapping[str, float],
    options: Options,
    pool: Executor,
    stop: Event,
    t_start: float,
) -> Calibration:
    """What is reported of the chosen model."""
    problem, z = found.problem, found.best.z
    fits = run_fits(problem, z, pool)
    sure = None
    if options.intervals and not stop.is_set():
        sure = run_in_threads([lambda: uncertainty(problem, z, pool)], stop)[0]
    channels = over_runs(problem, fits)
    return Calibration(
        config=with_starts(problem.at_tolerance(rtol).fitted(z), fits), free=problem.free,
        held=choose_free(problem.config, options.free)[1], values=problem.values(z),
        delay=problem.delay_at(z), runs=fits, channels=channels, error=mean_error(channels), cost=found.best.cost,
        iterations=found.best.iterations, converged=found.best.converged, interrupted=stop.is_set(),
        at_bound=tuple(at_bound(problem, z)), cross_validation=dict(scores), other_starts=found.others,
        uncertainty=sure, seconds=time.perf_counter() - t_start,
    )  # fmt: skip


def over_runs(problem: Problem, fits: Sequence[RunFit]) -> dict[str, float]:
    """RMSE over noise by channel, over the samples of all runs."""
    squares: dict[str, float] = {}
    counts: dict[str, int] = {}
    for run, fit in zip(problem.runs, fits, strict=True):
        for name, weights in zip(run.channels, run.weight, strict=True):
            count = int(np.count_nonzero(weights))
            if count:
                counts[name] = counts.get(name, 0) + count
                squares[name] = squares.get(name, 0.0) + count * fit.channels[name] ** 2
    return {name: float(np.sqrt(squares[name] / counts[name])) for name in counts}


def at_bound(problem: Problem, z: Vector) -> list[str]:
    """The parameters that lie on a bound of the fit."""
    return [
        one.name for one, x in zip(problem.free, z, strict=False)
        if x - one.low < AT_BOUND or one.high - x < AT_BOUND
    ]  # fmt: skip
