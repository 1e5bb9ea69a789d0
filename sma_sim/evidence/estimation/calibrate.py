"""Calibration: weighted nonlinear least squares over the compiled simulator, from several starts, for either model.

Each minimisation begins on thinned samples, where it costs a third; the best one continues with all of them. Of two models
the more probable one is taken (`sma_sim.evidence.estimation.log_evidence`).
"""

from __future__ import annotations

import time
import warnings
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from math import inf, isfinite, nan
from threading import Event
from typing import Any

import numpy as np

from sma_sim.evidence.data.quasi_static import first_cycles
from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.beginnings import NEAR_END, with_better_beginnings
from sma_sim.evidence.estimation.curve_features import shown_by_curves
from sma_sim.evidence.estimation.executors import executor_or_threads, run_in_threads
from sma_sim.evidence.estimation.fit_result import FitResult, OtherStart
from sma_sim.evidence.estimation.free_parameters import (
    FixedParameter,
    FreeParameter,
    choose_free,
    declared_parameters,
    free_in_dataset,
)
from sma_sim.evidence.estimation.heat_balance import shown_by_warming
from sma_sim.evidence.estimation.held_out_prediction import RunFit, mean_error, run_fits
from sma_sim.evidence.estimation.levenberg_marquardt import minimize
from sma_sim.evidence.estimation.log_evidence import DECISIVE, kinetics_probabilities, log_evidences
from sma_sim.evidence.estimation.overdispersion import overdispersion
from sma_sim.evidence.estimation.plausibility import (
    ImplausibleParameter,
    ImprobableOffset,
    implausible_of,
    improbable_offsets,
    unusual_of,
)
from sma_sim.evidence.estimation.prepared_fit import PreparedFit, check_data, check_kinetics, prepare
from sma_sim.evidence.estimation.problem import (
    AMBIENT,
    DELAY,
    START,
    LinearizedRun,
    Problem,
    cost_at,
    costs_at,
    feasible,
    near_point,
    start_point,
)
from sma_sim.evidence.estimation.residuals import SOLVER_NOISE, ZERO_STDS, FitData, fit_data, hidden_rtol, leeway_for
from sma_sim.evidence.estimation.run_estimates import Optimum, ParameterByRun, ReducedRun, estimates_by_run, reduced_run
from sma_sim.evidence.estimation.run_subset import on_all_runs, run_subset
from sma_sim.evidence.estimation.run_tangents import LOOSER, has_tangents
from sma_sim.evidence.estimation.search_context import OnIteration, SearchContext, iteration_words, silent
from sma_sim.evidence.estimation.stop_criteria import ALL_SAMPLES, FROM_PRIORS, WEAKLY_DAMPED, StopCriteria
from sma_sim.evidence.estimation.uncertainty import (
    Interval,
    RunInformation,
    Uncertainty,
    checked_by_runs,
    information_of,
    posterior_covariance,
    reduced_runs,
    uncertainty,
    with_other_minima,
)
from sma_sim.model.archive import Saved
from sma_sim.model.argument_checks import check_fields, checked, is_like
from sma_sim.model.arrays import Vector
from sma_sim.model.config import AUTO, Config
from sma_sim.model.errors import PhysicsWarning, UserError
from sma_sim.model.likely_unit import unit_hint
from sma_sim.model.materials import MATERIALS
from sma_sim.model.nearest import suggestion
from sma_sim.model.optional import require
from sma_sim.model.parameters import Parameter
from sma_sim.model.progress import progress_line
from sma_sim.model.renamed import renamed
from sma_sim.model.shown import Shown, listed, text_table
from sma_sim.solver.effect_table import channel_scales
from sma_sim.solver.simulate import SimulationError

SEARCH_RTOL, FINAL_RTOL = 1e-5, 1e-6  # of the simulations of a search without tangents, and of the last fit
LOOSER_BY, LOOSEST_RTOL = 10.0, 1e-3  # of that of a search whose runs cannot be made
SEARCH_SAMPLES = 1000  # samples per run of a search
JOINING_DAMPING = 10.0  # of the first step when runs join a minimisation that has ended without them
# Where the error is below CLEAN times the stated noise, weights grow as long as it stays below the noise by as much:
# priors weigh nothing then. In stages, because the valley of large weights is narrow.
CLEAN, SHARPER, SHARP_RTOL = 0.1, (10.0, 100.0, 1000.0), 1e-7
SAME_OPTIMUM = 2.0  # minimisations whose costs differ by less have found the same: the one from the configuration is taken
UNMOVED = 1e-9  # in standard deviations of the prior: data say nothing of a parameter that stays where it was


@renamed(model='kinetics')
@dataclass(frozen=True)
class FitOptions:
    """How to fit.

    Attributes
    ----------
    free : str, sequence of str, or None
        Full names of the parameters to fit; None: those that such data determine; none, ``()``: the model as it is.
    kinetics : str or None
        ``'hybrid'``, ``'mas'``, or ``'auto'`` for the more probable of both; None: as the configuration says
        (`Config.kinetics`).
    starts : int
        Number of starting points: the configuration, and random points around it. Where it is more than one, a single wire
        also starts from what the curves of its tests show, from either end of its hysteresis, and with data that take over
        from the priors gradually; runs that may begin in motion start from either end of the hysteresis too.
    robust : bool
        Whether to use Huber's loss instead of squares.
    seed : int
        Seed of the random starting points.
    intervals : bool
        Whether to compute 95 % intervals.
    limits : mapping
        By name (a parameter, ``'delay'``, ``'zero.strain'``), between which values (SI) it is estimated, in place of the
        usual limits.
    material : str
        Of the wires, ``'superelastic'``, ``'actuator'`` or ``'high-temperature'``: which values are plausible. Empty: of a
        single wire as its transformation temperatures say.
    """

    free: str | Sequence[str] | None = None
    kinetics: str | None = None
    starts: int = 2
    robust: bool = False
    seed: int = 0
    intervals: bool = True
    limits: Mapping[str, Range] = field(default_factory=dict)
    material: str = ''

    def __post_init__(self) -> None:
        if not is_like(self.free, str | Sequence[str] | None):
            raise UserError(f"free: expected names of parameters such as 'beam.E', got {self.free!r}")
        check_fields(self)
        check_kinetics(self.kinetics)
        if self.material and self.material not in MATERIALS:
            hint = suggestion(self.material, MATERIALS)
            raise UserError(f'material {self.material!r}{hint}; expected {", ".join(MATERIALS)}')
        if self.starts < 1:
            raise UserError(f'starts = {self.starts!r}: expected a whole number, 1 or more')
        if self.seed < 0:
            raise UserError(f'seed = {self.seed!r}: expected a whole number, 0 or more')

    @property
    def names(self) -> tuple[str, ...] | None:
        """The parameters to fit: `free`, of which a single one may stand alone."""
        return (self.free,) if isinstance(self.free, str) else None if self.free is None else tuple(self.free)


@dataclass(frozen=True, repr=False)
class Calibration(Shown, Saved):
    """A fit as it is reported; SI units.

    Attributes
    ----------
    config : Config
        The model with the fitted values; it runs as it is.
    free, fixed : tuple
        The parameters that were fitted, and those that were requested but kept at their values, with the reason.
    values : mapping
        Fitted values by full name.
    delay : float
        Delay of the recordings behind the model [s].
    runs : tuple of RunFit
        Errors and nuisance parameters of each recording.
    channel_errors, error
        normalized RMSE by channel over all runs, and sqrt(mean of its square).
    cost : float
        Half the sum of the squared residuals over noise, with the priors.
    iterations : int
    converged, interrupted : bool
    at_bound : tuple of str
        Names of the estimates that ended at a limit.
    other_starts : tuple of OtherStart
        Where the other starting points ended.
    uncertainty : Uncertainty or None
        95 % intervals, correlations, and directions that the data leave undetermined.
    implausible : tuple of ImplausibleParameter
        Parameters that left their plausible range, where intervals are known.
    unusual : tuple of ImplausibleParameter
        Others whose values are outside of what is realistic, or usual of their material, which these data hardly determine.
    improbable_offsets : tuple of ImprobableOffset
        What recordings have their own of that ended far from what was stated of it.
    by_run : tuple of ParameterByRun
        What each recording says of every parameter, where intervals are known.
    kinetics : mapping
        Where both models were fitted, the probability of each.
    limits : tuple of LimitReached
        The estimates that ended at a limit.
    sampling_interval : float
        The shortest of the recordings [s].
    rtol : float
        Relative tolerance of the runs behind errors and intervals.
    errors_of_constants : mapping
        Normalized RMSE by channel that constants would leave, one for each recording.
    seconds : float
        Time that the fit took.
    """

    config: Config
    free: tuple[FreeParameter, ...]
    fixed: tuple[FixedParameter, ...]
    values: Mapping[str, float]
    delay: float
    runs: tuple[RunFit, ...]
    channel_errors: Mapping[str, float]
    error: float
    cost: float
    iterations: int
    converged: bool
    interrupted: bool
    at_bound: tuple[str, ...]
    other_starts: tuple[OtherStart, ...]
    uncertainty: Uncertainty | None
    seconds: float
    implausible: tuple[ImplausibleParameter, ...] = ()
    unusual: tuple[ImplausibleParameter, ...] = ()
    improbable_offsets: tuple[ImprobableOffset, ...] = ()
    by_run: tuple[ParameterByRun, ...] = ()
    kinetics: Mapping[str, float] = field(default_factory=dict)
    limits: tuple[LimitReached, ...] = ()
    sampling_interval: float = 0.0
    rtol: float = FINAL_RTOL
    errors_of_constants: Mapping[str, float] = field(default_factory=dict)

    @property
    def unfollowed(self) -> tuple[str, ...]:
        """Channels of which the model leaves more than half of the variance: it hardly follows them."""
        known = self.errors_of_constants.items()
        return tuple(name for name, error in known if self.channel_errors[name] > UNFOLLOWED * error)

    @property
    def intervals(self) -> Mapping[str, Interval]:
        """The 95 % intervals by name of the parameter; empty where they were not asked for."""
        return {} if self.uncertainty is None else {interval.name: interval for interval in self.uncertainty.intervals}

    def facts(self) -> Mapping[str, str]:
        """What is to be known at a glance; errors are root mean squares over the noise, 1 is perfect."""
        values = (f'{one.name} {self.values[one.name]:.5g} {one.unit}'.removesuffix(' -') for one in self.free)
        found = {
            'kinetics': self.config.simulated_kinetics,
            'normalized RMSE': f'{self.error:.3g}',
            'fitted': listed(values),
        }
        found |= {'recordings': listed(run.name for run in self.runs), 'delay': f'{1e3 * self.delay:.3g} ms'}
        if self.at_bound:
            found['at a limit'] = listed(self.at_bound)
        if without := self.without_influence:
            found['of no influence'] = listed(without)
        if held := self.held_by_prior:
            found['held by priors'] = listed(held.values())
        return found | ({} if self.converged else {'not converged': 'the best so far'})

    def at_tolerance_of(self, config: Config) -> Calibration:
        """The same with the solver.rtol that was asked for: that of a fit is its own."""
        return replace(self, config=self.config.variant({'solver.rtol': config.parameters['solver.rtol']}))

    @property
    def without_influence(self) -> tuple[str, ...]:
        """Parameters that were asked for and change nothing in these data, or that these data do not determine."""
        return (*(one.name for one in self.fixed), *(name for name in self._unseen if name not in self.config.priors))

    @property
    def held_by_prior(self) -> Mapping[str, str]:
        """Parameters of which these data tell less than the standard deviations that were given (`Config.priors`), in words
        by name."""
        units = {one.name: f' {one.unit}'.removesuffix(' -') for one in self.free}
        known = {name: self.config.priors[name] for name in self._unseen if name in self.config.priors}
        return {name: f'{name} (given as known to {std:g}{units[name]})' for name, std in known.items()}

    @property
    def _unseen(self) -> list[str]:
        """Parameters that these data do not determine, or that have not moved where that is not known."""
        if self.intervals:
            return [name for name, one in self.intervals.items() if not one.seen]
        return [one.name for one in self.free if abs(one.coordinate(self.values[one.name])) < UNMOVED]

    def summary(self) -> str:
        """What is to be known, and every parameter with its 95 % interval and unit, as text."""
        words = [f'{name}: {text}' for name, text in self.facts().items() if name not in ('fitted', 'at a limit')]
        words += [f'at a limit: {limit.words}' for limit in self.limits]
        return '\n'.join([*words, *(['FitOptions(limits=...) moves limits'] if self.limits else []), '', self.table()])

    def table(self) -> str:
        """Every parameter with its 95 % interval and unit, as text."""
        rows = []
        for one in self.free:
            known = self.intervals.get(one.name)
            between = '' if known is None else f'{known.low:.5g} to {known.high:.5g}' if known.seen else 'not determined'
            rows.append((one.name, f'{self.values[one.name]:.5g}', between, one.unit))
        return text_table(('parameter', 'value', '95 % interval', 'unit'), rows)

    def to_dataframe(self) -> Any:
        """The parameters as a pandas DataFrame: value, ends of the 95 % interval, standard deviation, unit of all four.

        Raises UserError where pandas is not installed.
        """
        pandas, known = require('pandas', 'a DataFrame'), self.intervals
        rows = {
            one.name: {
                'value': self.values[one.name],
                'low': known[one.name].low if one.name in known else nan,
                'high': known[one.name].high if one.name in known else nan,
                'std': known[one.name].std_of_value if one.name in known else nan,
                'unit': one.unit,
            }
            for one in self.free
        }
        return pandas.DataFrame.from_dict(rows, orient='index')


@checked
def calibrate(
    dataset: Dataset,
    config: Config,
    options: FitOptions | None = None,
    executor: Executor | None = None,
    progress: OnIteration | None = None,
) -> Calibration:
    """Fit free parameters to all recordings of a dataset.

    Parameters
    ----------
    dataset : Dataset
        Recordings with their noise.
    config : Config
        The model to start from; its values are the centres of weak priors. Of isobaric tests, values that are defaults
        give way to what the curves show.
    options : FitOptions, optional
        What to fit, and how.
    executor : Executor, optional
        Where the simulations run; without it, threads on all cores.
    progress : callable, optional
        Hears how the fit proceeds; without it a terminal or a notebook shows it.

    Returns
    -------
    Calibration
        The fitted model with errors and intervals. After Ctrl-C, the best so far, with `interrupted` set.

    Raises
    ------
    UserError
        For a dataset without recordings, noise or channels, for wrong options, and if the model cannot be run at the
        start.

    Examples
    --------
    >>> import sma_sim
    >>> command = sma_sim.module_input([0.0, 2.0, 8.0, 15.0], [0.0, 10.0, 0.0, 0.0])
    >>> run = sma_sim.simulate(sma_sim.Model(), command, 4.0)
    >>> recording = sma_sim.Recording('run1', 'module', run.time, {'alpha': run['alpha_rad']}, command)
    >>> dataset = sma_sim.Dataset((recording,), {'alpha': 3.5e-4})
    >>> start = sma_sim.read_config(words=['beam.E=1.9e9'])
    >>> options = sma_sim.FitOptions(free=('beam.E',), kinetics='hybrid', starts=1, intervals=False)
    >>> f"{sma_sim.calibrate(dataset, start, options).values['beam.E']:.3g}"
    '2e+09'
    """
    options, t_start = options or FitOptions(), time.perf_counter()
    check_data(dataset, config)
    warn_of_small_noise(dataset)
    start = prepare(dataset, config, options.kinetics, options.names)
    with executor_or_threads(executor) as pool, progress_line('fitting') as line:
        heard = progress or (lambda *step: line.show(iteration_words(*step)))
        context = SearchContext(pool, Event(), silent, (), options.seed, heard)
        best, probabilities = fit_with_kinetics(start, options, context)
        found = final_calibration(dataset, best, options, context)
    found = found.at_tolerance_of(start.config)
    return replace(found, kinetics=probabilities, seconds=time.perf_counter() - t_start)


def warn_of_small_noise(dataset: Dataset) -> None:
    """Warn, at the line of the caller, where the stated noise is less than the error of the runs, which is taken then."""
    for structure in {recording.structure for recording in dataset.recordings}:
        for name, size in zip(structure.channels, channel_scales(structure), strict=True):
            least = SOLVER_NOISE * FINAL_RTOL * size
            if name in dataset.channels and dataset.noise_std.get(name, least) < least:
                words = f'noise_std of {name} = {dataset.noise_std[name]:g} is less than the error of the solver'
                warnings.warn(f'{words}: {least:.2g} is added to it', PhysicsWarning, stacklevel=4)


def fit_with_kinetics(
    start: PreparedFit, options: FitOptions, context: SearchContext
) -> tuple[FitResult, Mapping[str, float]]:
    """A search with the kinetics to try; the more probable ones, and the probabilities where there are two.

    Where the data do not decide, or Ctrl-C came before they could, they stay open, so that a later fit may choose again, and
    hybrid as they are by default.
    """
    fits = list[FitResult]()
    for kinetics in start.kinetics:
        if not (fits and context.stop.is_set()):
            fits.append(multistart_search(start.with_kinetics(kinetics), options, context))
    if len(start.kinetics) == 1:
        return fits[0], {}
    evidences = [] if context.stop.is_set() else log_evidences(fits, context.pool)  # that of a fit on its way says nothing
    probabilities = kinetics_probabilities(fits, evidences) if evidences else {}
    if evidences and abs(evidences[0] - evidences[1]) >= DECISIVE:
        return fits[int(np.argmax(evidences))], probabilities
    problem = fits[0].problem
    undecided = replace(problem, config=problem.config.variant(kinetics=AUTO))
    return replace(fits[0], problem=undecided), probabilities


def problem_for(dataset: Dataset, config: Config, options: FitOptions, every: int, step_limited: bool = True) -> Problem:
    """The problem on every `every`-th sample; not `step_limited` for a model that was chosen.

    In a search runs are as exact as those that give tangents, where their errors stay far below the noise: they take half
    the time, or a quarter.
    """
    rtol = min(SEARCH_RTOL, config.parameters['solver.rtol'])
    structures = [recording.structure for recording in dataset.recordings]
    if step_limited and all(map(has_tangents, structures)):
        rtol = max(rtol, min(rtol * LOOSER[config.simulated_kinetics], hidden_rtol(dataset)))
    free = free_in_dataset(config, dataset, options.names, options.material)
    runs = tuple(fit_data(recording, dataset.noise_std, every, rtol, step_limited) for recording in dataset.recordings)
    if dataset.floor:
        shares = {name: (floor / dataset.noise_std[name]) ** 2 for name, floor in dataset.floor.items()}
        runs = tuple(replace(run, floor_shares=tuple(shares.get(name, 0.0) for name in run.channels)) for run in runs)
    quasi_static = all(structure.is_quasi_static for structure in structures)
    delay = 0.0 if quasi_static else None
    problem = Problem(config, runs, free, options.robust, delay, material=options.material).at_tolerance(rtol)
    problem = with_leeway(problem, problem.config) if step_limited else problem
    return within_limits(problem, options.limits) if options.limits else problem


def with_leeway(problem: Problem, config: Config) -> Problem:
    """The problem whose commands may be smoothed where they change at every moment, as far as suits a configuration."""
    return replace(problem, runs=tuple(replace(run, leeway=leeway_for(config, run)) for run in problem.runs))


def full_problem(dataset: Dataset, fit: FitResult, options: FitOptions) -> Problem:
    """The problem of a fit on all samples, the parameters free within the same bounds."""
    whole = problem_for(dataset, fit.problem.config, options, 1, step_limited=False)
    problem = fit.problem
    return replace(
        whole,
        free=problem.free,
        nominal_effects=problem.nominal_effects,
        differences=problem.differences,
        tempering=problem.tempering,
        delay_range=problem.delay_range,
    )


def multistart_search(
    start: PreparedFit, options: FitOptions, context: SearchContext, criteria: StopCriteria = FROM_PRIORS
) -> FitResult:
    """The best of several starts on thinned samples, all but the first damped less; of many runs on a subset at first, and
    of a test of many cycles on the first.

    At a looser tolerance where runs cannot be made at that of a search, as with implausible parameters. Raises
    SimulationError where they cannot at LOOSEST_RTOL either.
    """
    config, recordings = start.config, tuple(map(first_cycles, start.dataset.recordings))
    longest = max(len(recording.time) for recording in recordings)
    dataset = replace(start.dataset, recordings=recordings)
    thinned = problem_for(dataset, config, options, max(1, longest // SEARCH_SAMPLES))
    shown = shown_by_curves(start.curves, config) | shown_by_warming(start.dataset, config)
    while True:
        try:
            return best_of_starts(thinned, shown, options, context, criteria)
        except SimulationError:
            looser = LOOSER_BY * thinned.config.parameters['solver.rtol']
            if looser > LOOSEST_RTOL:
                raise
            thinned = thinned.at_tolerance(looser)


def best_of_starts(
    thinned: Problem, shown: Mapping[str, float], options: FitOptions, context: SearchContext, criteria: StopCriteria
) -> FitResult:
    """The best of the fits from several starts. `shown`: where curves have parameters. Raises SimulationError."""
    subset, kinetics = run_subset(thinned), thinned.config.simulated_kinetics
    points = starting_points(subset, shown, options.starts, options.seed, context.pool)
    weak = replace(criteria, damping=WEAKLY_DAMPED.damping)

    def fitted(points: Sequence[StartingPoint], before: int) -> list[FitResult]:
        jobs = [
            partial(minimized_from, point, subset, weak if k else criteria, context, f'{kinetics}, start {k + 1}')
            for k, point in enumerate(points, start=before)
        ]
        return run_in_threads(jobs, context.stop)

    fits = fitted(points, 0)
    if len(fits) > 1 and any(run.is_in_motion for run in subset.runs):
        first = min(fits, key=lambda fit: fit.cost)
        fits += fitted(from_either_end(subset, first.z), len(fits))
    if len(fits) > 1 and min(fit.error for fit in fits) > UNFOLLOWED * mean_error(errors_of_constants(subset)):
        fits += fitted(from_all_over_the_priors(subset, options.seed, context.pool), len(fits))
    least = min(fit.cost for fit in fits)
    best = next(fit for fit in fits if fit.cost < least + SAME_OPTIMUM)
    first_best = best
    if len(fits) > 1:
        best = with_better_beginnings(best, context, f'{kinetics}, other beginnings')
    k = overdispersion(subset, best.z, context.pool) if len(fits) > 1 else nan
    others = tuple(
        OtherStart(more, thinned.values(fit.z), abs(more) < SAME_OPTIMUM, more / k**2)
        for fit in fits
        if fit is not first_best
        for more in [fit.cost - best.cost]
    )
    if len(subset.runs) < len(thinned.runs):
        z = on_all_runs(best, thinned, start_point(thinned))
        best = continued_fit(best, thinned, z, replace(criteria, damping=JOINING_DAMPING), context, 'all runs')
    return replace(best, other_starts=others)


def continued_fit(
    fit: FitResult, problem: Problem, z: Vector, criteria: StopCriteria, context: SearchContext, label: str
) -> FitResult:
    """A fit continued from z on another problem with the same parameters; iterations of both."""
    job = partial(minimize, problem, z, criteria, context, f'{problem.config.simulated_kinetics}, {label}')
    (found,) = run_in_threads([job], context.stop)
    return replace(found, iterations=fit.iterations + found.iterations, other_starts=fit.other_starts)


def final_fit(dataset: Dataset, fit: FitResult, options: FitOptions, context: SearchContext) -> FitResult:
    """The fit continued on all samples, the parameters free within the same bounds.

    At the tolerance of the search where its parameters, which may be implausible, let no run be made at a smaller one, and
    where none is free: delay and starts need no more than the runs that are shown beside the recordings.
    """
    whole = full_problem(dataset, fit, options)
    try:
        found = fitted_to_all(whole.at_tolerance(FINAL_RTOL) if whole.free else whole, fit, context)
    except SimulationError:
        problem = whole.at_tolerance(fit.problem.config.parameters['solver.rtol'])
        return continued_fit(fit, problem, fit.z, ALL_SAMPLES, context, 'all samples')
    for sharper in SHARPER:
        if found.error * sharper > 10.0 * CLEAN or context.stop.is_set():
            break
        problem = whole.at_tolerance(SHARP_RTOL)
        sharp = continued_fit(found, problem.weighted(sharper), found.z, ALL_SAMPLES, context, 'all samples, sharper')
        found = replace(sharp, problem=problem, cost=cost_at(problem, sharp.z, context.pool))
    return found


def fitted_to_all(problem: Problem, fit: FitResult, context: SearchContext) -> FitResult:
    """The fit continued on a problem with all samples: under smoothed commands first, where they change at every moment.

    Raises SimulationError where the model cannot be run at its end.
    """
    smoothed = with_leeway(problem, problem.fitted(fit.z))
    if any(run.leeway for run in smoothed.runs):  # comes near, for what few runs row by row cost
        fit = continued_fit(fit, smoothed, fit.z, ALL_SAMPLES, context, 'all samples')
        if not problem.free:  # delay and starts, which need no more, as those of runs that are predicted
            return replace(fit, problem=problem)
    return continued_fit(fit, problem, fit.z, ALL_SAMPLES, context, 'all samples')


def final_calibration(dataset: Dataset, fit: FitResult, options: FitOptions, context: SearchContext) -> Calibration:
    """The fit continued on all samples, with intervals; its tolerance is that of the fit that is continued."""
    t_start = time.perf_counter()
    last = final_fit(dataset, fit, options, context)
    found = calibration_of(last, context)
    known, covariance, by_run = None, None, tuple[ParameterByRun, ...]()
    if options.intervals and not context.stop.is_set():
        reduce = partial(information_and_reduced, Optimum.of(last.problem, last.z))
        job = partial(reduced_runs, last.problem, last.z, context.pool, reduce)
        (reduced,) = run_in_threads([job], context.stop)
        informations = [information for information, _ in reduced]
        known = uncertainty(last.problem, last.z, informations)
        check = partial(checked_nearby, known, last, informations, context.pool)
        (checked,) = run_in_threads([check], context.stop)
        known = with_other_minima(checked, last.other_starts)
        covariance = posterior_covariance(last.problem.free, known)
        by_run = estimates_by_run(last.problem, last.z, [run for _, run in reduced])
    rtol = {'solver.rtol': fit.problem.config.parameters['solver.rtol']}
    return replace(
        found,
        config=with_starts(last.config, found.runs).variant(rtol).with_covariance(covariance),
        fixed=choose_free(last.problem.config, options.names, dataset.channels)[1],
        uncertainty=known,
        interrupted=context.stop.is_set(),
        seconds=time.perf_counter() - t_start,
        implausible=implausible_of(last, known),
        unusual=unusual_of(last, known),
        by_run=by_run,
    )


def checked_nearby(
    known: Uncertainty, fit: FitResult, informations: Sequence[RunInformation], pool: Executor
) -> Uncertainty:
    """Intervals checked at their ends, by runs under smoothed commands where these change at every moment.

    What lines lack of a run hardly changes within an interval.
    """
    nearby = near_point(with_leeway(fit.problem, fit.config), fit.z, pool)
    return checked_by_runs(known, nearby, fit.z, informations, pool)


def information_and_reduced(at: Optimum, data: FitData, run: LinearizedRun) -> tuple[RunInformation, ReducedRun]:
    """What intervals and the estimates of single recordings need of one, linearized at the optimum of a fit."""
    return information_of(data, run, at.robust), reduced_run(at, data, run)


def with_starts(config: Config, fits: tuple[RunFit, ...]) -> Config:
    """The configuration with the mean start of the runs as initial.x_M_*."""
    x = np.mean([fit.x_M for fit in fits if fit.x_M] or [()], axis=0)
    initial = {f'initial.x_M_{i + 1}': float(x[i]) for i in range(len(x))}
    return config.variant(initial)


def calibration_of(fit: FitResult, context: SearchContext) -> Calibration:
    """A fit with its errors run by run, without intervals."""
    runs = run_fits(fit.problem, fit.z, context.pool)
    errors = errors_by_channel(fit.problem, runs)
    reached = limits_reached(fit.problem, fit.z, runs)
    return Calibration(
        config=fit.config,
        free=fit.problem.free,
        fixed=(),
        values=fit.values,
        delay=fit.delay,
        runs=runs,
        channel_errors=errors,
        error=mean_error(errors),
        cost=fit.cost,
        iterations=fit.iterations,
        converged=fit.converged,
        interrupted=context.stop.is_set(),
        at_bound=tuple(limit.name for limit in reached),
        other_starts=fit.other_starts,
        uncertainty=None,
        seconds=0.0,
        limits=reached,
        improbable_offsets=improbable_offsets(fit.problem.runs, runs),
        rtol=fit.problem.config.parameters['solver.rtol'],
        errors_of_constants=errors_of_constants(fit.problem),
        sampling_interval=min(float(np.median(np.diff(run.time))) if len(run.time) > 1 else inf for run in fit.problem.runs),
    )


def errors_by_channel(problem: Problem, fits: Sequence[RunFit]) -> dict[str, float]:
    """Normalized RMSE by channel, over the samples of all runs."""
    return pooled_errors(
        (name, int(np.count_nonzero(weights)), fit.channel_errors[name] ** 2)
        for run, fit in zip(problem.runs, fits, strict=True)
        for name, weights in zip(run.channels, run.weight, strict=True)
        if np.any(weights)
    )


def errors_of_constants(problem: Problem) -> dict[str, float]:
    """Normalized RMSE by channel that constants would leave, one for each run."""
    rows = (
        (name, (measured * weight)[weight > 0.0])
        for run in problem.runs
        for name, measured, weight in zip(run.channels, run.measured, run.weight, strict=True)
        if np.any(weight)
    )
    return pooled_errors((name, len(known), float(known.var())) for name, known in rows)


def pooled_errors(parts: Iterable[tuple[str, int, float]]) -> dict[str, float]:
    """By channel, the root of the mean square over all samples of its parts: (channel, samples, mean square)."""
    squares, counts = defaultdict[str, float](float), defaultdict[str, int](int)
    for name, count, square in parts:
        counts[name] += count
        squares[name] += count * square
    return {name: float(np.sqrt(squares[name] / count)) for name, count in counts.items()}


# Where the minimisations of a fit start, and by which weights of the data they come to the whole of them.
SPREAD = 0.25  # of further starts, in standard deviations of the priors
TRIES = 20  # for a further start at which every run can be made
UNFOLLOWED = 0.7  # of the error that constants leave: half of the variance
DRAWS, DRAWN_STDS, MORE_STARTS = 64, (1.0, 2.0), 4  # points of each width [standard deviations], from which fits go on
# Weights of the residuals with which data take over from priors. At first these hold what would hide a wrong valley of a
# single wire, a force's zero and drift and where its runs begin, so that its parameters go where the data lead them.
GRADUALLY = (0.001, 0.01, 0.1, 1.0)


@dataclass(frozen=True)
class StartingPoint:
    """A point z (n,) and the factors of the weights with which it is minimised, one after the other."""

    z: Vector
    weights: tuple[float, ...] = (1.0,)


def starting_points(
    problem: Problem, shown: Mapping[str, float], count: int, seed: int, pool: Executor
) -> list[StartingPoint]:
    """The middle of the priors; if more are asked for, what a single wire or a motion before gives reason to try, then
    random points.

    The curves of its tests may have `shown` parameters elsewhere. Every run can be made at all points but the first.
    """
    middle = start_point(problem)
    points, random = [StartingPoint(middle)], np.random.default_rng(seed)
    if count == 1:
        return points
    given = [*point_of(problem, shown), *points_of_single_wire(problem), *points_in_motion(problem)]
    further = (StartingPoint(SPREAD * random.normal(size=len(middle))) for _ in range(TRIES * (count - 1)))
    for guess in chain(given, further):
        if len(points) >= max(count, 1 + len(given)):
            break
        point = StartingPoint(start_point(problem, guess.z), guess.weights)
        if feasible(problem, point.z, pool):
            points.append(point)
    return points


def point_of(problem: Problem, shown: Mapping[str, float]) -> list[StartingPoint]:
    """The point at which parameters have the values that were `shown`; none where that is hardly beside the middle."""
    point = np.zeros(len(start_point(problem)))
    for k, free in enumerate(problem.free):
        if free.name in shown:
            point[k] = free.coordinate(shown[free.name])
    return [StartingPoint(point)] if np.any(np.abs(point) > SPREAD) else []


def points_of_single_wire(problem: Problem) -> list[StartingPoint]:
    """Priors that give way gradually, and runs that begin near either end of the hysteresis; none for several wires.

    A wire at a fixed strain has a valley for either, where the zeros and drifts of its force hide that its runs begin wrong.
    """
    if any(run.starts != 1 for run in problem.runs):
        return []
    zero = np.zeros(len(problem.unknowns))
    return [StartingPoint(zero, GRADUALLY), *from_either_end(problem, zero)]


def points_in_motion(problem: Problem) -> list[StartingPoint]:
    """Runs that begin near either end of the hysteresis, of several wires that may be warm from before; none at rest."""
    in_motion = any(run.is_in_motion for run in problem.runs)
    return from_either_end(problem, start_point(problem)) if in_motion and not points_of_single_wire(problem) else []


def from_either_end(problem: Problem, z: Vector) -> list[StartingPoint]:
    """A point with all runs near either end of the hysteresis.

    A wire that is heated on and one that cools, whose fractions are far apart where they are warm, lie in valleys of their
    own; a fit may end in the wrong one, and leaves it once its other unknowns are near.
    """
    begins = [unknown is START for unknown in problem.unknowns]
    return [StartingPoint(np.where(begins, NEAR_END * end, z)) for end in (START.low, START.high)]


def from_all_over_the_priors(problem: Problem, seed: int, pool: Executor) -> list[StartingPoint]:
    """The least wrong of many random points: where the values that are given make a robot that hardly moves, no derivative
    tells of what would move it."""
    (low, high), random = problem.limits(), np.random.default_rng(seed)
    points = [np.clip(std * random.normal(size=len(low)), low, high) for std in DRAWN_STDS for _ in range(DRAWS)]
    costs = costs_at(problem, points, pool)
    least = sorted((k for k, cost in enumerate(costs) if isfinite(cost)), key=lambda k: costs[k])
    return [StartingPoint(points[k]) for k in least[:MORE_STARTS]]


def minimized_from(
    point: StartingPoint, problem: Problem, criteria: StopCriteria, context: SearchContext, label: str
) -> FitResult:
    """The optimum to which a starting point leads; iterations of all its weights."""
    z, iterations = point.z, 0
    for factor in point.weights:
        fit = minimize(problem.weighted(factor), z, criteria, context, label)
        z, iterations = fit.z, iterations + fit.iterations
    return replace(fit, problem=problem, iterations=iterations)


# Limits of a fit: those that a user moves, and the estimates that ended at one.
#
# A limit is there so that a fit ends; the truth may lie beyond it. What ended at one is said, and how to move it.
Range = tuple[float, float]
AT_LIMIT = 1e-6  # of a coordinate
NEAR_LIMIT = 0.05  # of the way from the middle of its prior, which pulls it back, to a limit
DELAY_NAME, STRAIN_ZERO = 'delay', 'zero.strain'  # as a user names them


@dataclass(frozen=True)
class LimitReached:
    """An estimate that ended at `low` or `high` (SI); in some `recordings` where each has its own.

    Not `is_movable` where that is the end of what the parameter can be at all.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    recordings: tuple[str, ...] = ()
    is_movable: bool = True

    @property
    def text(self) -> str:
        """In words, with what moves the limit on the command line."""
        return f'{self.words} ({self.cure})' if self.is_movable else self.words

    @property
    def words(self) -> str:
        """Where it ended."""
        unit = '' if self.unit == '-' else f' {self.unit}'
        if not self.is_movable:
            between = f'{self.low:.4g} to {self.high:.4g}'
            return f'{self.name} = {self.value:.4g}{unit} ended at the end of what it can be ({between})'
        where = f' in {", ".join(self.recordings)}' if self.recordings else ''
        return (
            f'{self.name} = {self.value:.4g}{unit} ended at a limit of the fit{where} ({self.low:.4g} to {self.high:.4g}): '
            f'the true value may be beyond it'
        )

    @property
    def cure(self) -> str:
        """How the limit is moved."""
        if self.name.startswith('zero.') and self.name != STRAIN_ZERO:
            return 'it is four times the zero_std of the map'
        if self.name == 'ambient':
            return 'it is five times what rooms differ by'
        effect = self.name.removeprefix('effects.').rpartition('.')[0] if self.name.startswith('effects.') else ''
        asked = f'sma-sim fit --effect {effect} ' if effect else ''  # a search knows no limits of effects that it may find
        return f'move it: {asked}--limit {self.name}=LOW:HIGH'


def limits_from(words: Sequence[str]) -> dict[str, Range]:
    """Limits by name [SI] from ``name=low:high`` words. Raises UserError."""
    limits = {}
    for word in words:
        name, _, ends = word.partition('=')
        try:
            low, high = map(float, ends.split(':'))
        except ValueError as error:
            raise UserError(f'--limit {word}: expected NAME=LOW:HIGH in SI units, such as delay=-2:5') from error
        limits[name.strip()] = (low, high)
    return limits


def within_limits(problem: Problem, limits: Mapping[str, Range]) -> Problem:
    """A problem whose parameters, delay and zeros of strain lie between `limits` (SI) by name. Raises UserError."""
    names = [free.name for free in problem.free]
    for name, (low, high) in limits.items():
        if name not in (*names, DELAY_NAME, STRAIN_ZERO):
            raise UserError(
                f'limit of {name}: expected {DELAY_NAME}, {STRAIN_ZERO}, or a parameter that is fitted: {", ".join(names)}'
            )
        if not low < high:
            raise UserError(f'limit of {name}, {low:g} to {high:g}: expected the lower end first')
    longest = max(float(run.time[-1] - run.time[0]) for run in problem.runs)
    if DELAY_NAME in limits and not (limits[DELAY_NAME][0] < longest and limits[DELAY_NAME][1] > -longest):
        low, high = limits[DELAY_NAME]
        raise UserError(f'limit of delay, {low:g} to {high:g} s: no recording is longer than {longest:g} s')
    declared = declared_parameters(problem.config)
    for name in limits.keys() & declared.keys():
        (low, high), (least, most), unit = limits[name], declared[name].bounds, declared[name].unit
        if high < least or low > most:
            hint = unit_hint(declared[name], high)
            raise UserError(
                f'limit of {name}, {low:g} to {high:g} {unit}: expected some of {least:g} to {most:g} {unit}{hint}'
            )
    free = tuple(narrowed(one, limits[one.name]) if one.name in limits else one for one in problem.free)
    delay = tuple(map(DELAY.coordinate, limits[DELAY_NAME])) if DELAY_NAME in limits else problem.delay_range
    runs = problem.runs
    if STRAIN_ZERO in limits:
        runs = tuple(replace(run, zero_range=limits[STRAIN_ZERO]) for run in runs)
    return replace(problem, free=free, delay_range=(delay[0], delay[1]), runs=runs)


def narrowed(free: FreeParameter, limits: Range) -> FreeParameter:
    """A parameter between other bounds (SI). Raises UserError for a logarithmic one that is to be 0 or less."""
    if free.log and limits[0] <= 0.0:
        raise UserError(f'limit of {free.name}, {limits[0]:g} to {limits[1]:g}: expected more than 0')
    return replace(free, low=free.coordinate(limits[0]), high=free.coordinate(limits[1]))


def limits_reached(problem: Problem, z: Vector, runs: Sequence[RunFit]) -> tuple[LimitReached, ...]:
    """All estimates of a fit that ended at a limit. `runs`: what it says of every recording."""
    declared = declared_parameters(problem.config)
    found = [
        of_unknown(one, float(x), declared.get(one.name))
        for one, x in zip(problem.shared, z, strict=False)
        if is_at_limit(one, float(x))
    ]
    offsets = dict[str, list[tuple[str, float, Range]]]()
    for data, fit in zip(problem.runs, runs, strict=True):
        stds = dict(zip(data.channels, data.zero_std, strict=bool(data.zero_std)))
        given = {
            f'zero.{channel}': (value, (-ZERO_STDS * stds[channel], ZERO_STDS * stds[channel]))
            for channel, value in fit.zeros.items()
        }
        given |= {STRAIN_ZERO: (fit.zero, data.zero_range)} if fit.zero else {}
        given |= {'ambient': (fit.ambient, (AMBIENT.low * fit.ambient_std, AMBIENT.high * fit.ambient_std))}
        for name, (value, between) in given.items():
            if between[0] < between[1] and not within(value, between):
                offsets.setdefault(name, []).append((fit.name, value, between))
    units = {'ambient': 'K', STRAIN_ZERO: '-'}
    found += [
        LimitReached(name, where[0][1], *where[0][2], units.get(name, 'SI'), tuple(run for run, _, _ in where))
        for name, where in offsets.items()
    ]
    return tuple(found)


def within(value: float, between: Range) -> bool:
    """Whether a value is away from the ends of what it may be, whose middle is expected."""
    middle, reach = 0.5 * (between[0] + between[1]), 0.5 * (between[1] - between[0])
    return abs(value - middle) < (1.0 - NEAR_LIMIT) * reach


def is_at_limit(unknown: FreeParameter, x: float) -> bool:
    """Whether a coordinate lies at an end of its range, or so far towards it that only its prior may have kept it back."""
    return x - unknown.low < max(AT_LIMIT, -NEAR_LIMIT * unknown.low) or unknown.high - x < max(
        AT_LIMIT, NEAR_LIMIT * unknown.high
    )


def of_unknown(unknown: FreeParameter, x: float, declared: Parameter | None) -> LimitReached:
    """A shared unknown that ended at a limit."""
    ends = unknown.value(unknown.low), unknown.value(unknown.high)
    end, bound = (k[x - unknown.low > unknown.high - x] for k in (ends, declared.bounds if declared else (-inf, inf)))
    movable = abs(end - bound) > AT_LIMIT * max(abs(end), abs(unknown.scale))
    return LimitReached(unknown.name, unknown.value(x), *ends, unknown.unit, is_movable=movable)
