"""The next experiment: from recordings and hypotheses to a command sequence and what it is expected to tell."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from threading import Event

import numpy as np

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.executors import PickledConfig, executor_or_threads
from sma_sim.evidence.estimation.free_parameters import declared_parameters
from sma_sim.evidence.estimation.motion_before import begin_in_motion
from sma_sim.evidence.estimation.prepared_fit import kinetics_to_try
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.experiment_design.forecast import (
    ModelPoint,
    OperatingLimits,
    RunPrediction,
    SimulatedRun,
    blank_run,
    evaluation_points,
    simulate_points,
)
from sma_sim.evidence.experiment_design.further_channels import further_channels
from sma_sim.evidence.experiment_design.plan import DesignRequest, ExpectedRatio, InformationGain, ParameterPrecision, Plan
from sma_sim.evidence.experiment_design.refitted_utilities import (
    RefitSearchResult,
    all_pairs,
    refit_problem,
    search_with_refits,
)
from sma_sim.evidence.experiment_design.rival_fits import (
    DRAWS_PER_POSTERIOR,
    NO_EFFECT,
    ModelHypothesis,
    NamedFit,
    fit_base_model,
    fit_hypotheses,
    leading_rivals,
    named_rivals,
    with_common_kinetics,
)
from sma_sim.evidence.experiment_design.sequence_search import (
    DesignProblem,
    SequenceSearchResult,
    Utility,
    evaluate_sequences,
    search_sequences,
)
from sma_sim.evidence.experiment_design.sequences import CommandGrid
from sma_sim.evidence.experiment_design.utilities import (
    EvidenceRatio,
    RivalPair,
    combination_precision,
    discrimination_utility,
    evidence_ratios,
    information_gain,
    weak_directions,
)
from sma_sim.evidence.search.refine import WINDOW
from sma_sim.model.argument_checks import checked
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.config import Config, suggestion
from sma_sim.model.effects.discovery import find_effects
from sma_sim.model.effects.scope import SEPARATOR
from sma_sim.model.errors import UserError
from sma_sim.model.progress import progress_in_words
from sma_sim.model.structures.structure import Structure
from sma_sim.solver.inputs import command_column

# A combination of parameters is weakly known if its standard deviation exceeds this fraction of its prior's: at a tenth, the
# recordings say a hundred times what the prior says. At least so many are considered, since a design for one alone may tell
# nothing of the next.
WEAK_STD, MIN_DIRECTIONS = 0.1, 3
LIMIT_MARGIN = 0.1  # of the rise above rest, by which a default limit exceeds what was reached: beyond, nothing was compared
LINEAR_SHARE = 0.4  # of the budget, where rivals are refitted afterwards: the linear prediction is rough there
PRECISION_CENTRES = 3  # at which derivatives are taken, where parameters are to be known: the model is not linear


@dataclass(frozen=True)
class SearchOutcome:
    """The linear search, and the search with refits that followed it, if any."""

    linear: SequenceSearchResult
    refitted: RefitSearchResult | None

    @property
    def levels(self) -> Vector:
        """The best sequence (cells,) [W]."""
        return self.linear.best[0].levels if self.refitted is None else self.refitted.best.sequence.levels

    @property
    def count(self) -> int:
        """Sequences evaluated."""
        return self.linear.count + (self.refitted.count if self.refitted else 0)

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended either."""
        return self.linear.interrupted or (self.refitted is not None and self.refitted.interrupted)


@checked
def next_experiment(
    training: Dataset,
    config: Config,
    request: DesignRequest | None = None,
    executor: Executor | None = None,
    on_progress: Callable[[str], None] | None = None,
) -> Plan:
    """Design the next experiment.

    Parameters
    ----------
    training
        Recordings of a robot with one command, and the noise of their channels: the experiment is to have the same.
    config
        The model to start from.
    request
        Rivals or parameters, length, limits, budget.
    executor
        Runs the simulations; None: a pool of processes, as many as there are cores.
    on_progress
        Called with a line of text at each stage; None: a terminal or a notebook shows them.

    Returns
    -------
    Plan
        The sequence of the command, the limits that it keeps under every hypothesis, and what it is expected to tell. Ctrl-C
        during the search gives the best so far (`interrupted`).

    Raises
    ------
    UserError
        For what cannot be designed: a wire on a bench, several commands, unknown names, limits that not even a weak command
        keeps.
    KeyboardInterrupt
        For Ctrl-C before the search has started.

    Examples
    --------
    >>> import sma_sim
    >>> command = sma_sim.module_input([0.0, 2.0, 8.0], [0.0, 10.0, 0.0])
    >>> run = sma_sim.simulate(sma_sim.Model(), command, 2.0)
    >>> recording = sma_sim.Recording('run1', 'module', run.time, {'alpha': run['alpha_rad']}, command)
    >>> dataset = sma_sim.Dataset(recording, {'alpha': 3.5e-4})
    >>> request = sma_sim.DesignRequest(parameters='beam.E', length=8.0, hold=2.0, kinetics='hybrid', budget=2)
    >>> plan = sma_sim.next_experiment(dataset, sma_sim.Config(), request)  # doctest: +SKIP
    >>> sma_sim.next_experiment(dataset, sma_sim.Config(), sma_sim.DesignRequest(between='gravity'))
    Traceback (most recent call last):
    ...
    sma_sim.model.errors.UserError: between gravity: expected at least two different explanations
    """
    t_start, request = time.perf_counter(), request or DesignRequest()
    check_design_request(config, request)
    with executor_or_threads(executor) as pool, progress_in_words('designing', on_progress) as report:
        context = SearchContext(pool, Event(), report, request.folders, request.seed)
        hypotheses = hypotheses_for(training, config, request, context)
        moving = begin_in_motion(hypotheses[0].as_measured, context)
        plan = best_plan(training, hypotheses, request, context)
        return replace(plan, in_motion=moving, seconds=time.perf_counter() - t_start)


def best_plan(
    training: Dataset, hypotheses: tuple[ModelHypothesis, ...], request: DesignRequest, context: SearchContext
) -> Plan:
    """The design for some fitted hypotheses. Raises UserError for limits that no command keeps, and unknown names."""
    structure = hypotheses[0].fitted.problem.config.structure
    grid, grid_origins = command_grid(training, request, structure)
    run, every = blank_run(training, grid, hypotheses[0].noise_factor)
    limits, origins = operating_limits(hypotheses, request, context.pool)
    single = len(hypotheses) == 1
    centres, draws = (PRECISION_CENTRES, 0) if single else (1, DRAWS_PER_POSTERIOR)
    points = tuple(evaluation_points(hypothesis, run, centres, draws, request.seed) for hypothesis in hypotheses)
    combinations = parameter_combinations(hypotheses[0], request) if single else np.zeros((0, 0))
    problem = DesignProblem(points, run, grid, limits, utility_for(hypotheses, combinations), context.pool)
    outcome = search_design(training, hypotheses, problem, request, context)
    plan = replace(plan_from(hypotheses, problem, outcome, grid_origins | origins), every=every)
    if outcome.interrupted:
        return plan
    context.on_progress('comparing further channels')
    counted = () if single else counted_pairs(hypotheses)
    try:
        channels = further_channels(hypotheses, training.noise_std, counted, combinations, context.pool)
    except KeyboardInterrupt:
        return replace(plan, interrupted=True)
    return replace(plan, further_channels=channels)


def check_design_request(config: Config, request: DesignRequest) -> None:
    """Raise UserError for what cannot be designed."""
    structure = config.structure
    if not structure.has_one_command:
        moved = ', '.join([drive.name for drive in structure.drives] + list(structure.commands))
        raise UserError(f'next designs one heating command over time; system {config.system} is moved by {moved}')
    if len(set(request.between)) != len(request.between) or len(request.between) == 1:
        raise UserError(f'between {" ".join(request.between)}: expected at least two different explanations')
    check_names(config, request)
    if request.between and request.parameters:
        raise UserError('between and parameters ask for different experiments: give one of them')
    if not (request.hold > 0.0 and request.length >= 4.0 * request.hold):
        raise UserError(f'length {request.length:g} s with hold {request.hold:g} s: expected at least four holds')


def check_names(config: Config, request: DesignRequest) -> None:
    """Raise UserError, before any fit, for parameters and effects that there are not."""
    declared, effects = declared_parameters(config), find_effects(request.folders)
    for name in request.parameters:
        if name not in declared:
            raise UserError(f'parameters {name}: not fitted here{suggestion(name, declared)}')
    for effect in (part for name in request.between for part in name.split('+') if name != NO_EFFECT):
        if effect.partition(SEPARATOR)[0] not in effects:
            hint = suggestion(effect, effects)
            raise UserError(f'between {effect}: no effect that could be missing from this model{hint}')


def hypotheses_for(
    training: Dataset, config: Config, request: DesignRequest, context: SearchContext
) -> tuple[ModelHypothesis, ...]:
    """What is to be discriminated; a single one where parameters are to be known, or where nothing rivals the best."""
    kinetics = kinetics_to_try(request.kinetics, config)
    base = fit_base_model(training, config, kinetics, context)
    if request.parameters:
        rivals = [NamedFit('the model', base)]
    elif request.between:
        rivals = named_rivals(base, request.between, context)
    else:
        rivals = leading_rivals(base, context)
    if len(kinetics) > 1:
        rivals = with_common_kinetics(rivals, context)
    return fit_hypotheses(training, rivals, context)


def command_grid(training: Dataset, request: DesignRequest, structure: Structure) -> tuple[CommandGrid, dict[str, str]]:
    """The grid of levels, and where its limit comes from: the largest command of the recordings where none was given."""
    sources = [recording.source for recording in training.recordings]
    reached = max(float(np.abs(source.values[:, command_column(source)]).max()) for source in sources)
    power = reached if request.power is None else request.power
    origin = 'given' if request.power is not None else 'the largest command in the recordings'
    if not power > 0.0:
        raise UserError('the recordings have no command other than zero: give the largest power of the experiment')
    cells = round(request.length / request.hold)
    grid = CommandGrid(cells, request.hold, power, not structure.antagonistic, structure.input_columns)
    return grid, {'power': origin}


def operating_limits(
    hypotheses: Sequence[ModelHypothesis], request: DesignRequest, pool: Executor
) -> tuple[OperatingLimits, dict[str, str]]:
    """Temperature and stress: as given, or a little above what the recordings reached under any hypothesis."""
    reached = [run for hypothesis in hypotheses for run in simulated_recordings(hypothesis, pool)]
    T_E = hypotheses[0].fitted.problem.config.parameters['environment.T_E']
    margin = 1.0 + LIMIT_MARGIN
    temperature = request.temperature or float(T_E + margin * (max(run.temperature for run in reached) - T_E))
    stress = request.stress or float(margin * max(run.stress for run in reached))
    above = 'a tenth above what the recordings reached in the model'
    return OperatingLimits(temperature, stress), {
        'temperature': 'given' if request.temperature else above,
        'stress': 'given' if request.stress else above,
    }


def simulated_recordings(hypothesis: ModelHypothesis, pool: Executor) -> list[SimulatedRun]:
    """The fitted hypothesis under each recorded command."""
    problem, z = hypothesis.fitted.problem, hypothesis.fitted.z
    config = PickledConfig(problem.fitted(z))
    futures = [
        pool.submit(simulate_points, (ModelPoint(config, problem.nuisance(run, z[indices])),), run)
        for run, indices in zip(problem.runs, problem.indices(), strict=True)
    ]
    return [simulated[0] for simulated in (future.result() for future in futures) if simulated is not None]


def parameter_combinations(hypothesis: ModelHypothesis, request: DesignRequest) -> Matrix:
    """The combinations (k, n) to be known better: parameters by name, or the weakly known directions. Raises UserError."""
    names = [parameter.name for parameter in hypothesis.fitted.problem.free]
    if not request.parameters:
        p, covariance = len(names), hypothesis.root @ hypothesis.root.T
        chosen = weak_directions(covariance[:p, :p], WEAK_STD, MIN_DIRECTIONS)
        return np.hstack([chosen, np.zeros((len(chosen), hypothesis.shared - p))])
    for name in request.parameters:
        if name not in names:
            raise UserError(f'parameters {name}: not fitted here{suggestion(name, names)}; fitted are {", ".join(names)}')
    return np.eye(hypothesis.shared)[[names.index(name) for name in request.parameters]]


def counted_pairs(hypotheses: Sequence[ModelHypothesis]) -> list[RivalPair]:
    """Pairs that count: what the recordings have refuted is a rival, not taken for true."""
    limit = max(hypothesis.log_evidence for hypothesis in hypotheses) - WINDOW
    return [pair for pair in all_pairs(len(hypotheses)) if hypotheses[pair.true].log_evidence > limit]


def utility_for(hypotheses: Sequence[ModelHypothesis], combinations: Matrix) -> Utility:
    """The objective of the search."""
    if len(hypotheses) == 1:
        return lambda predictions: information_gain(combinations, hypotheses[0].root, predictions[0])
    counted = counted_pairs(hypotheses)
    return lambda predictions: discrimination_utility(evidence_ratios(predictions, counted))


def search_design(
    training: Dataset,
    hypotheses: Sequence[ModelHypothesis],
    problem: DesignProblem,
    request: DesignRequest,
    context: SearchContext,
) -> SearchOutcome:
    """The linear search, continued with refitted rivals where there are any. Raises UserError if no command is allowed."""
    single = len(hypotheses) == 1
    budget = request.budget if single else round(LINEAR_SHARE * request.budget)
    linear = search_sequences(problem, budget, request.seed, context.on_progress)
    if linear is None:
        limits = problem.limits
        raise UserError(
            f'the limits of {limits.temperature:.0f} K and {limits.stress / 1e6:.0f} MPa leave no command: a default '
            'sequence exceeds them however weak; allow a higher temperature or stress'
        )
    if single or linear.interrupted:
        return SearchOutcome(linear, None)
    (best,) = evaluate_sequences(problem, [linear.best[0].levels], keep_predictions=True)
    if best is None:
        return SearchOutcome(linear, None)
    refits = refit_problem(training, hypotheses, best, counted_pairs(hypotheses), context)
    return SearchOutcome(linear, search_with_refits(refits, problem, linear, request.budget, context.on_progress))


def plan_from(
    hypotheses: tuple[ModelHypothesis, ...], problem: DesignProblem, outcome: SearchOutcome, origins: dict[str, str]
) -> Plan:
    """All that is reported of the best sequence."""
    (best,) = evaluate_sequences(problem, [outcome.levels], keep_predictions=True)
    assert best is not None and best.predictions is not None
    single = len(hypotheses) == 1
    evaluated = outcome.linear.defaults
    defaults = [default.predictions for default in evaluated if default.predictions is not None]
    gain = InformationGain(best.utility, float(np.mean([default.utility for default in evaluated])))
    return Plan(
        hypotheses=hypotheses,
        grid=problem.grid,
        levels=outcome.levels,
        limits=problem.limits,
        limits_from=origins,
        expected=() if single else expected_ratios(hypotheses, best.predictions, defaults, outcome.refitted),
        precision=parameter_precision(hypotheses[0], best.predictions[0], [d[0] for d in defaults]) if single else (),
        gain=gain if single else InformationGain(0.0, 0.0),
        predictions=best.predictions,
        run=problem.run,
        every=1,
        evaluated=outcome.count,
        interrupted=outcome.interrupted,
        seconds=0.0,
    )


def expected_ratios(
    hypotheses: Sequence[ModelHypothesis],
    best: Sequence[RunPrediction],
    defaults: Sequence[Sequence[RunPrediction]],
    refitted: RefitSearchResult | None,
) -> tuple[ExpectedRatio, ...]:
    """Every pair: designed against the mean of the default sequences; of refitted rivals where there are any."""
    pairs = all_pairs(len(hypotheses))
    means = mean_ratios(evidence_ratios(best, pairs), [evidence_ratios(default, pairs) for default in defaults])
    if refitted is not None and refitted.defaults:
        means |= mean_ratios(refitted.best.ratios, [default.ratios for default in refitted.defaults])
    return tuple(ExpectedRatio(hypotheses[p.true].name, hypotheses[p.rival].name, *means[p]) for p in pairs)


def mean_ratios(
    designed: Sequence[EvidenceRatio], defaults: Sequence[Sequence[EvidenceRatio]]
) -> dict[RivalPair, tuple[float, float]]:
    """By pair the ratio of the design, and the mean over the default sequences (their ratios in the same order)."""
    return {
        ratio.pair: (ratio.mean, float(np.mean([default[k].mean for default in defaults])))
        for k, ratio in enumerate(designed)
    }


def parameter_precision(
    hypothesis: ModelHypothesis, best: RunPrediction, defaults: Sequence[RunPrediction]
) -> tuple[ParameterPrecision, ...]:
    """Every free parameter: how well it is known now and after the experiment."""
    free, root = hypothesis.fitted.problem.free, hypothesis.root
    each = np.eye(hypothesis.shared)[: len(free)]
    now, designed = combination_precision(each, root).std, combination_precision(each, root, best).std
    default = np.mean([combination_precision(each, root, prediction).std for prediction in defaults], axis=0)
    return tuple(
        ParameterPrecision(p.name, p.unit, p.log, *(float(p.scale * std[k]) for std in (now, default, designed)))
        for k, p in enumerate(free)
    )
