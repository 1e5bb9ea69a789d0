"""Which unknown input, acting where, would make a calibrated model reproduce the data (docs/explanation/latent.md)."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from threading import Event

import numpy as np

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.train_test_split import hold_out_last, pooled
from sma_sim.evidence.estimation.calibrate import FitOptions, problem_for
from sma_sim.evidence.estimation.executors import executor_or_threads, run_in_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.injection_points import Port, ports_of
from sma_sim.evidence.estimation.levenberg_marquardt import minimize, refit
from sma_sim.evidence.estimation.motion_before import begin_in_motion
from sma_sim.evidence.estimation.overdispersion import overdispersion
from sma_sim.evidence.estimation.prepared_fit import agreed_kinetics, check_data, prepare
from sma_sim.evidence.estimation.problem import Problem, residuals_at, start_point
from sma_sim.evidence.estimation.search_context import OnProgress, SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS, TEMPERED
from sma_sim.evidence.latent_input.design_matrix import (
    DesignMatrix,
    LinearizationPoint,
    Stopped,
    design_matrix,
    linearization_point,
)
from sma_sim.evidence.latent_input.hypotheses import InputHypothesis, confounding_reason, hypotheses_of
from sma_sim.evidence.latent_input.inference import Prior, null_log_evidence
from sma_sim.evidence.latent_input.ranking import (
    HypothesisEvidence,
    error_from_squares,
    errors_in_gaps,
    estimate_of,
    evidence_of,
    kinetics_bias,
    noise_inflation,
    probability_missing,
    rank_hypotheses,
)
from sma_sim.evidence.latent_input.refinement import RefinedHypothesis, refine_hypotheses
from sma_sim.evidence.latent_input.results import InputEstimate, InputFinding, LatentInputs
from sma_sim.evidence.model_selection.model_changes import with_other_kinetics
from sma_sim.evidence.model_selection.nominal_fit import NOMINAL_STARTS, nominal_fit
from sma_sim.evidence.search.posterior import EVEN
from sma_sim.evidence.search.refine import TIE
from sma_sim.model.argument_checks import check_fields, checked
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.config import MODELS, Config
from sma_sim.model.errors import UserError
from sma_sim.model.progress import progress_in_words
from sma_sim.model.renamed import renamed
from sma_sim.solver.simulate import SimulationError

# How far hypotheses are followed, and when two leave as much; whether an input is named is decided by its odds.
MAX_RUNS = 3  # with the largest error, where a missing quantity shows first: the cost grows with the samples
BIASED_FIT_ERROR = 1.1  # error above which a fit is biased by what the model lacks: estimated noise may be wrong by a tenth
TIE_RATIO = 1.1  # errors within it of the least explain equally well: a tenth, as above
REPORTED_IF_NONE = 6  # hypotheses, where nothing is missing: what fits a table, none of them decides anything
BAND_SIGMAS = 1.96  # half width of a 95 % band in standard deviations
NUISANCE_SAMPLES = 1000  # per run, on which starts and delay are estimated: a handful of unknowns
EXTERNAL_HOOKS = ('structure_force', 'wire_heat', 'actuation')  # named before strain, transformation stress and sensors
FORCE_SENSORS = re.compile(r'sense_(F(_\d+)?|stress)')  # ports that exist where the wires' forces were measured


@renamed(model='kinetics')
@dataclass(frozen=True)
class LatentRequest:
    """How to search.

    Attributes
    ----------
    kinetics
        Kinetics: hybrid, mas, auto, or None for what the configuration says.
    fit
        Whether to fit the model first, or to take it as calibrated.
    seed
        Of the starts of the fit.
    options
        Of the fit.
    """

    kinetics: str | None = None
    fit: bool = True
    seed: int = 0
    options: FitOptions = field(default_factory=lambda: FitOptions(starts=NOMINAL_STARTS))

    def __post_init__(self) -> None:
        check_fields(self)
        object.__setattr__(self, 'kinetics', agreed_kinetics(self.kinetics, self.options.kinetics))


@checked
def estimate_latent_inputs(
    dataset: Dataset,
    config: Config,
    held_out: Dataset | None = None,
    request: LatentRequest | None = None,
    executor: Executor | None = None,
    on_progress: OnProgress | None = None,
) -> LatentInputs:
    """Find the input, and where it acts, that would make `config` explain the dataset's recordings.

    Parameters
    ----------
    dataset
        Recordings of a robot or of a wire, and the noise of their channels.
    config
        The model to start from; its effects are part of it.
    held_out
        Recordings that are not used, so that the answer can be tested on them. None: the last of three or more.
    request
        Kinetics, whether to fit first, seed.
    executor
        Runs the simulations; None: a pool of processes, as many as there are cores.
    on_progress
        Called with a line of text at each stage; None: a terminal or a notebook shows them.

    Returns
    -------
    LatentInputs
        The verdict, and for each hypothesis the error that it leaves and its inputs over time. A KeyboardInterrupt ends the
        search with what there is (`interrupted`).

    Raises
    ------
    UserError
        For recordings that cannot be fitted.

    Examples
    --------
    A robot that lacks nothing:

    >>> import numpy as np
    >>> import sma_sim
    >>> random = np.random.default_rng(0)
    >>> def recorded(name, power):
    ...     command = sma_sim.module_input([0.0, 2.0, 8.0, 15.0], [0.0, power, 0.0, 0.0])
    ...     run = sma_sim.simulate(sma_sim.Model(), command, 4.0)
    ...     alpha = run['alpha_rad'] + 3.5e-4 * random.standard_normal(len(run.time))
    ...     return sma_sim.Recording(name, 'module', run.time, {'alpha': alpha}, command)
    >>> dataset = sma_sim.Dataset((recorded('a', 10.0), recorded('b', -8.0)), {'alpha': 3.5e-4})
    >>> options = sma_sim.FitOptions(free=('beam.E',), kinetics='hybrid', starts=1, intervals=False)
    >>> request = sma_sim.LatentRequest(kinetics='hybrid', options=options)
    >>> sma_sim.estimate_latent_inputs(dataset, sma_sim.Config(), request=request).verdict
    'none'
    """
    t_start, request, stop = time.perf_counter(), request or LatentRequest(), Event()
    training, others = hold_out_last(dataset, held_out)
    check_data(pooled(training, others), config)
    if config.structure.is_quasi_static:
        raise UserError(
            f'latent estimates inputs over time, which says nothing in a test with imposed stress and temperature '
            f'(system {config.system}): use sma-sim diagnose'
        )
    with executor_or_threads(executor) as pool, progress_in_words('searching', on_progress) as report:
        context = SearchContext(pool, stop, report, (), request.seed)
        fitted = fitted_model(training, config, request, context)
        found = run_in_threads([partial(search_inputs, training, fitted, request.fit, context)], stop)[0]
    as_asked = found.config.variant({'solver.rtol': config.parameters['solver.rtol']})  # that of the search is its own
    return replace(found, config=as_asked, interrupted=stop.is_set(), seconds=time.perf_counter() - t_start)


def fitted_model(training: Dataset, config: Config, request: LatentRequest, context: SearchContext) -> FitResult:
    """The model fitted as a diagnosis does; where that is not asked for, its starts and delay only."""
    if request.fit:
        return nominal_fit(prepare(training, config, request.kinetics), request.options, context)
    model = request.kinetics if request.kinetics in MODELS else config.simulated_kinetics
    return fit_starts_and_delay(training, config.variant(kinetics=model), request, context)


def fit_starts_and_delay(training: Dataset, config: Config, request: LatentRequest, context: SearchContext) -> FitResult:
    """The configuration as it is, with the starts and the delay that suit it."""
    every = max(1, max(len(recording.time) for recording in training.recordings) // NUISANCE_SAMPLES)
    full = problem_for(training, config, request.options, every)
    nuisance_only = replace(full, free=())
    context.on_progress('estimating starts and delay')
    optimum = minimize(nuisance_only, start_point(nuisance_only), FROM_PRIORS, context)
    return FitResult(full, np.concatenate([np.zeros(len(full.free)), optimum.z]), optimum.cost)


def worst_runs(fitted: FitResult, pool: Executor) -> list[int]:
    """The runs with the largest error, in their order."""
    residuals = residuals_at(fitted.problem, fitted.z, pool)
    sizes = [0.0 if run is None else float(np.mean(run**2)) for run in residuals]
    return sorted(np.argsort(sizes)[::-1][:MAX_RUNS].tolist())


def problem_on_all_samples(training: Dataset, fitted: FitResult, chosen: Sequence[int]) -> tuple[Problem, Vector]:
    """The problem of some runs on all their samples, and z there."""
    full = replace(problem_for(training, fitted.problem.config, FitOptions(), 1), free=fitted.problem.free)
    indices, shared = full.indices(), len(full.shared)
    z = np.concatenate([fitted.z[:shared], *(fitted.z[indices[k][shared:]] for k in chosen)])
    return replace(full, runs=tuple(full.runs[k] for k in chosen)), z


def kinetics_difference(
    training: Dataset, fitted: FitResult, chosen: Sequence[int], design: DesignMatrix, context: SearchContext
) -> list[Matrix]:
    """By run, what the other kinetics would show differently (channels, bins), over noise, were they fitted to this model.

    To the model, not to the measurement: what is missing biases the two models differently, and that is not of the kinetics.
    """
    context.on_progress('fitting the other kinetics to this model')
    problem, z = problem_on_all_samples(training, fitted, chosen)
    other, start = problem_on_all_samples(training, FitResult(*with_other_kinetics(fitted), 0.0), chosen)
    runs = tuple(
        run
        if residuals is None
        else replace(run, measured=run.measured + residuals / np.where(run.weight > 0.0, run.weight, np.inf))
        for run, residuals in zip(problem.runs, residuals_at(problem, z, context.pool), strict=True)
    )
    as_measured = replace(other, runs=runs)
    refitted = refit(as_measured, start, context, FROM_PRIORS)
    point = linearization_point(as_measured, start if refitted is None else refitted.z)
    return [
        np.zeros_like(run.residuals) if difference is None else difference
        for run, difference in zip(design.runs, point.residuals(context.pool), strict=True)
    ]


def search_inputs(training: Dataset, fitted: FitResult, may_refit: bool, context: SearchContext) -> LatentInputs:
    """The search around a fitted model; where that lacks something, and `may_refit`, around one that is not biased by it."""
    chosen = worst_runs(fitted, context.pool)
    problem, z = problem_on_all_samples(training, fitted, chosen)
    config = problem.fitted(z)
    ports = ports_of(config, {name for run in problem.runs for name in run.channels})
    residuals = [run for run in residuals_at(problem, z, context.pool) if run is not None]
    error = float(np.sqrt(sum(np.vdot(run, run) for run in residuals) / problem.samples))
    result = LatentInputs(
        'stopped',
        {},
        (),
        error,
        float('nan'),
        float('nan'),
        1.0,
        config,
        config.simulated_kinetics,
        problem.delay_at(z),
        tuple(run.name for run in problem.runs),
        False,
        0.0,
        begin_in_motion(fitted.problem, context),
    )
    if may_refit and fitted.error > BIASED_FIT_ERROR:
        context.on_progress('fitting with a tempered likelihood')
        fitted = tempered_fit(fitted, context)[0]
    start = linearization_point(*problem_on_all_samples(training, fitted, chosen))
    try:
        result = replace(result, held_out=nominal_error_in_gaps(linearization_point(problem, z), context))
        design = design_matrix(start, ports, context)
        difference = kinetics_difference(training, fitted, chosen, design, context)
        return evaluate_hypotheses(result, start, design, ports, difference, context)
    except Stopped:
        return result


def nominal_error_in_gaps(point: LinearizationPoint, context: SearchContext) -> float:
    """Normalized RMSE of a fit in gaps that are left out in turn, without any input. Raises Stopped."""
    design = design_matrix(point, (), replace(context, on_progress=lambda words: None))
    no_input = Prior('', np.zeros((0, 0)), 0.0, 0.0)
    evidence = HypothesisEvidence(InputHypothesis('nothing', ()), design, no_input, 0.0)
    return errors_in_gaps(evidence, 1.0)[0]


def evaluate_hypotheses(
    result: LatentInputs,
    start: LinearizationPoint,
    design: DesignMatrix,
    ports: Sequence[Port],
    difference: Sequence[Matrix],
    context: SearchContext,
) -> LatentInputs:
    """The evidence of all hypotheses; where one is more probable than none, the best are refined and compared again."""
    hypotheses = hypotheses_of(ports)
    context.on_progress(f'comparing {len(hypotheses)} hypotheses')
    evidences = rank_hypotheses(design, hypotheses, context)
    over_nothing = [evidence.prior.log_evidence for evidence in evidences]
    result = replace(result, probability=probability_missing(over_nothing, len(hypotheses)))
    refined: Sequence[RefinedHypothesis] = ()
    if result.probability > EVEN:
        refined = refine_hypotheses(start, evidences, context)
    simulated = {hypothesis.hypothesis.name: hypothesis for hypothesis in refined}
    reported = [hypothesis.evidence for hypothesis in refined] or evidences[:REPORTED_IF_NONE]
    inflation = min(
        [hypothesis.inflation for hypothesis in refined] or [noise_inflation(evidence, 1.0) for evidence in reported]
    )
    final = [evidence_of(evidence.design, evidence.hypothesis, inflation) for evidence in reported]
    null = null_log_evidence(design.statistics(hypotheses[0], inflation), design.z)
    findings = [
        finding_for(
            replace(evidence, log_evidence=evidence.log_evidence - null),
            simulated.get(evidence.hypothesis.name),
            difference,
            inflation,
        )
        for evidence in final
    ]
    findings.sort(key=lambda finding: -finding.log_evidence)
    best = best_explanation(findings)
    findings.sort(key=lambda finding: finding is not best)
    probability = probability_missing([finding.log_evidence for finding in findings], len(hypotheses))
    result = replace(result, verdict='none', findings=tuple(findings), noise_inflation=inflation, probability=probability)
    if not refined or probability <= EVEN:
        return result
    forces_measured = any(FORCE_SENSORS.fullmatch(port.name) for port in ports)
    return replace(result, verdict=best.name, indistinguishable=confounded_with_best(findings, forces_measured))


def best_explanation(findings: Sequence[InputFinding]) -> InputFinding:
    """Of those that leave nearly the least error, that of most evidence; external causes come before the others.

    A force, heat or power needs a cause; a material that changes with time, or a sensor, can imitate each.
    """
    least = min(finding.error for finding in findings)
    near = [finding for finding in findings if finding.error <= TIE_RATIO * least]
    external = [finding for finding in near if finding.hypothesis.hook in EXTERNAL_HOOKS]
    return max(external or near, key=lambda finding: finding.log_evidence)


def confounded_with_best(findings: Sequence[InputFinding], forces_measured: bool) -> dict[str, str]:
    """The hypotheses that explain as well as the best, which is the first, with the reason."""
    best, confounded = findings[0], {}
    least = min(finding.error for finding in findings)
    for finding in findings[1:]:
        why = confounding_reason(best.hypothesis, finding.hypothesis, forces_measured)
        undecided = abs(best.log_evidence - finding.log_evidence) < TIE
        if finding.error <= TIE_RATIO * least and (why or undecided):
            confounded[finding.name] = why or 'these recordings do not tell'
    return confounded


def finding_for(
    evidence: HypothesisEvidence,
    simulated: RefinedHypothesis | None,
    difference: Sequence[Matrix],
    inflation: float,
) -> InputFinding:
    """What is reported of a hypothesis, by its evidence over nothing missing: as simulated, if it was.

    Squares that the linear model removes and simulation does not are taken off the evidence.
    """
    estimate, prior, design = estimate_of(evidence, inflation), evidence.prior, evidence.design
    u, squares = (simulated.u, simulated.squares / inflation) if simulated else (estimate.u, estimate.squares)
    band = BAND_SIGMAS * np.hypot(estimate.std, kinetics_bias(evidence, difference, inflation))
    inputs, at = [], 0
    for run in design.runs:
        for port in evidence.hypothesis.ports:
            part = slice(at, at + len(run.grid.knots))
            inputs.append(InputEstimate(run.name, port, run.grid.knots, port.probe * u[part], port.probe * band[part]))
            at = part.stop
    return InputFinding(
        evidence.hypothesis,
        evidence.log_evidence - 0.5 * max(squares - estimate.squares, 0.0),
        prior.dof,
        prior.description,
        error_from_squares(design, squares, inflation),
        errors_in_gaps(evidence, inflation)[1],
        float(np.mean(np.abs(u) > band)),
        tuple(inputs),
        simulated.point.problem.values(simulated.point.z) if simulated else {},
    )


# Tempered likelihood: fits of a model that is known to be wrong, in which correlated residuals count as few.
#
# A model that lacks something biases its parameters as far as white noise would let it. The squares are divided by the
# overdispersion k^2 of the residuals (`estimation.overdispersion`; generalised Bayes; k = 1 when the model is right), so
# that the priors keep their weight.
STAGES = 3  # most fits: they bound the time where the weights do not settle
SETTLED = 0.7  # part of the overdispersion above which another fit would change little


def tempered_minimum(problem: Problem, z: Vector, k: float, context: SearchContext) -> FitResult:
    """Minima with the squares divided by the square of the overdispersion: at first `k`, then that of the fit so far.

    `cost` is that without tempering. Raises SimulationError where the model cannot be run.
    """
    for _ in range(STAGES):
        z = minimize(problem.weighted(1.0 / k), z, TEMPERED, context).z
        now = overdispersion(problem, z, context.pool)
        if now > SETTLED * k or context.stop.is_set():
            break
        k = now
    return FitResult(problem, z, square_cost(problem, z, context.pool))


def square_cost(problem: Problem, z: Vector, pool: Executor) -> float:
    """Half the sum of squares and of the prior, inf where the model cannot be run."""
    found = [residuals for residuals in residuals_at(problem, z, pool) if residuals is not None]
    if len(found) < len(problem.runs):
        return inf
    return 0.5 * float(z @ z) + 0.5 * sum(float(np.vdot(residuals, residuals)) for residuals in found)


def tempered_fit(biased: FitResult, context: SearchContext) -> tuple[FitResult, float]:
    """The tempered fit from the middle of the priors, which is not biased by what the model lacks, and its k.

    `biased` is the ordinary fit.
    """
    problem = replace(biased.problem, tempering=1.0)
    k = overdispersion(problem, biased.z, context.pool)
    try:
        unbiased = tempered_minimum(problem, np.zeros_like(biased.z), k, context)
    except SimulationError:
        unbiased = tempered_minimum(problem, biased.z, k, context)
    prior = 0.5 * (biased.problem.tempering**2 - 1.0) * float(unbiased.z @ unbiased.z)
    unbiased = replace(biased, z=unbiased.z, cost=unbiased.cost + prior)
    return unbiased, overdispersion(problem, unbiased.z, context.pool)
