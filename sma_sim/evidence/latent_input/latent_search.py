"""Which unknown quantity, acting where, would make a calibrated model meet the measurement (docs/explanation/latent.md)."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from threading import Event

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import Campaign
from sma_sim.evidence.data.train_test_split import hold_out_last
from sma_sim.evidence.estimation.calibrate import Options, check, problem_for, run_in_threads
from sma_sim.evidence.estimation.executors import some_executor
from sma_sim.evidence.estimation.injection_points import Port, ports_of
from sma_sim.evidence.estimation.levenberg_marquardt import FIRST, minimize, start_point
from sma_sim.evidence.estimation.problem import Problem, residuals_at
from sma_sim.evidence.latent_input.design_matrix import Design, OnProgress, Place, Stopped, design_of, place_of
from sma_sim.evidence.latent_input.hypotheses import Hypothesis, hypotheses_of, reason
from sma_sim.evidence.latent_input.inference import Prior, without
from sma_sim.evidence.latent_input.ranking import (
    Weighed,
    error_of,
    errors_in_gaps,
    estimate_of,
    floor_of,
    p_value,
    weigh,
    weigh_all,
    widening,
)
from sma_sim.evidence.latent_input.refinement import RefinedHypothesis, refined
from sma_sim.evidence.model_selection.forward_selection import SearchContext
from sma_sim.evidence.model_selection.nominal_fit import STARTS, DiagnosisRequest, nominal_fit
from sma_sim.evidence.model_selection.refit import FitResult, other_kinetics, refit
from sma_sim.evidence.model_selection.tempered_likelihood import tempered
from sma_sim.model.config import Config

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
MOST_RUNS = 3  # those with the largest error are looked at
SIGNIFICANT = 0.01  # chance of a false alarm over the whole family of hypotheses
LEAST_FALL = 0.03  # part of the error over noise that a quantity must take away, in gaps of the data too
ALIKE = 1.1  # ratio of the errors left within which two explain alike
SHOWN = 6  # hypotheses that are told of where nothing is missing
SOUND = 1.1  # error over noise above which a fit is taken to be bent by what it lacks
FROM_OUTSIDE = ('structure_force', 'wire_heat', 'actuation')  # named before strain, transformation stress and sensors
CERTAIN = 7.0  # difference of log evidences below which data do not tell
GAUSS_95 = 1.96


@dataclass(frozen=True)
class Course:
    """One port's time course in one run: `mean` and `band` (k,) (95 %: mean +- band) at times (k,) [s], in its unit."""

    run: str
    port: Port
    time: Vector
    mean: Vector
    band: Vector


@dataclass(frozen=True)
class Finding:
    """One hypothesis: what it leaves of the error over noise, what it costs, and the time courses.

    `error`: over noise, that is left when the model is simulated with the courses; `held_out`: that in gaps of the data that
    were left out in turn (linear); `dof` the effective number of values that were fitted, `evidence` the logarithm of the
    odds against nothing at all, `prior` what the course looks like, `beyond`: part of the instants at which it leaves its
    band. `parameters`: the free ones (SI) of the model to which the courses belong; none where it was not simulated.
    """

    hypothesis: Hypothesis
    evidence: float
    dof: float
    prior: str
    error: float
    held_out: float
    beyond: float
    courses: tuple[Course, ...]
    parameters: Mapping[str, float]

    @property
    def name(self) -> str:
        """Name of the hypothesis."""
        return self.hypothesis.name


@dataclass(frozen=True)
class Latent:
    """What was found. `verdict`: the name of the best hypothesis, or `none`; `indistinguishable`: others, and why.

    `findings`: best first; those after the finalists have no courses. `error`, `held_out`: over noise, without any of them;
    `p_value`: how often chance alone does as well; `widened`: by which factor noise was widened for what no port explains.
    """

    verdict: str
    indistinguishable: Mapping[str, str]
    findings: tuple[Finding, ...]
    error: float
    held_out: float
    p_value: float
    widened: float
    config: Config
    model: str
    delay: float
    runs: tuple[str, ...]
    interrupted: bool
    seconds: float


@dataclass(frozen=True)
class LatentRequest:
    """How to look: kinetics (hybrid, mas or auto), `fit` the model first or take it as calibrated, seed of the draws."""

    model: str = 'auto'
    fit: bool = True
    seed: int = 0
    options: Options = field(default_factory=lambda: Options(starts=STARTS))


def fitted_model(training: Campaign, config: Config, request: LatentRequest, place: SearchContext) -> FitResult:
    """The model fitted as a diagnosis does; with `fit` off only starts and delay are."""
    if request.fit:
        return nominal_fit(training, config, DiagnosisRequest(request.model, (), request.seed, request.options), place)
    model = config.model if request.model == 'auto' else request.model
    return as_calibrated(training, replace(config, model=model), request, place)


def as_calibrated(training: Campaign, config: Config, request: LatentRequest, place: SearchContext) -> FitResult:
    """The configuration as it is, with the starts and the delay that suit it."""
    every = max(1, max(len(one.time) for one in training.recordings) // 1000)
    full = problem_for(training, config, request.options, every)
    place.on_progress('estimating starts and delay')
    found = minimize(replace(full, free=()), start_point(replace(full, free=())), place.pool, FIRST, place.stop)
    return FitResult(full, np.concatenate([np.zeros(len(full.free)), found.z]), found.cost)


def worst_runs(training: Campaign, one: FitResult, pool: Executor) -> list[int]:
    """The runs with the largest error, in their order."""
    residuals = residuals_at(one.problem, one.z, pool)
    sizes = [0.0 if found is None else float(np.mean(found**2)) for found in residuals]
    return sorted(np.argsort(sizes)[::-1][:MOST_RUNS].tolist())


def on_all_samples(training: Campaign, one: FitResult, chosen: Sequence[int]) -> tuple[Problem, Vector]:
    """The problem of some runs on all their samples, and z there."""
    full = replace(problem_for(training, one.problem.config, Options(), 1), free=one.problem.free)
    places, shared = full.places(), len(full.shared)
    z = np.concatenate([one.z[:shared], *(one.z[places[k][shared:]] for k in chosen)])
    return replace(full, runs=tuple(full.runs[k] for k in chosen)), z


def discrepancy(
    training: Campaign, fitted: FitResult, chosen: Sequence[int], design: Design, place: SearchContext
) -> list[Matrix]:
    """By run, what the other kinetics would show differently (channels, bins), over noise, were they fitted to this model.

    To the model, not to the measurement: what is missing bends two models differently, and that is not of the kinetics.
    """
    place.on_progress('fitting the other kinetics to this model')
    problem, z = on_all_samples(training, fitted, chosen)
    other, start = on_all_samples(training, FitResult(*other_kinetics(fitted), 0.0), chosen)
    runs = tuple(
        run if one is None else replace(run, measured=run.measured + one / np.where(run.weight > 0.0, run.weight, np.inf))
        for run, one in zip(problem.runs, residuals_at(problem, z, place.pool), strict=True)
    )
    as_measured = replace(other, runs=runs)
    found = refit(as_measured, start, place.pool, place.stop, FIRST)
    shown = place_of(as_measured, start if found is None else found.z).residuals(place.pool)
    return [np.zeros_like(own.residuals) if one is None else one for own, one in zip(design.runs, shown, strict=True)]


def latent(
    campaign: Campaign, config: Config, held: Campaign | None = None, request: LatentRequest | None = None,
    executor: Executor | None = None, on_progress: OnProgress = lambda words: None,
) -> Latent:  # fmt: skip
    """Find the quantity, and where it acts, that would make `config` explain the campaign's recordings.

    Those of `held` are not looked at, so that what is made of the answer can be judged by them; without it the last of three
    or more is held out. A KeyboardInterrupt ends the search with what there is. Raises UserError for what cannot be fitted.
    """
    begun, request, stop = time.perf_counter(), request or LatentRequest(), Event()
    training, _ = hold_out_last(campaign, held)
    check(training, config, request.options)
    with some_executor(executor) as pool:
        place = SearchContext(pool, stop, on_progress, (), request.seed)
        fitted = fitted_model(training, config, request, place)
        found = run_in_threads([partial(searched, training, fitted, request.fit, place)], stop)[0]
    return replace(found, interrupted=stop.is_set(), seconds=time.perf_counter() - begun)


def searched(training: Campaign, fitted: FitResult, free: bool, place: SearchContext) -> Latent:
    """The search around a fitted model; where that lacks something, and is `free`, around one that is not bent by it."""
    chosen = worst_runs(training, fitted, place.pool)
    problem, z = on_all_samples(training, fitted, chosen)
    config = problem.fitted(z)
    ports = ports_of(config.system, tuple(dict.fromkeys(name for run in problem.runs for name in run.channels)))
    shown = [one for one in residuals_at(problem, z, place.pool) if one is not None]
    error = float(np.sqrt(sum(np.vdot(one, one) for one in shown) / problem.samples))
    answer = Latent(
        'none', {}, (), error, float('nan'), 1.0, 1.0, config, config.model, problem.delay_at(z),
        tuple(run.name for run in problem.runs), False, 0.0,
    )  # fmt: skip
    if free and fitted.error > SOUND:
        place.on_progress('fitting with priors that keep their say')
        fitted = tempered(fitted, place.pool, place.stop)[0]
    start = place_of(*on_all_samples(training, fitted, chosen))
    try:
        answer = replace(answer, held_out=error_in_gaps(place_of(problem, z), place))
        design = design_of(start, ports, place.pool, place.stop, place.on_progress)
        gap = discrepancy(training, fitted, chosen, design, place)
        return judged(answer, start, design, ports, gap, place)
    except Stopped:
        return answer


def error_in_gaps(start: Place, place: SearchContext) -> float:
    """Error over noise of a fit in gaps that are left out in turn, without any port. Raises Stopped."""
    design = design_of(start, (), place.pool, place.stop, lambda words: None)
    nothing = Prior('', np.zeros((0, 0)), 0.0, 0.0)
    return errors_in_gaps(Weighed(Hypothesis('nothing', ()), design, nothing, 0.0, 0.0, np.zeros(0)), 1.0)[0]


def judged(
    answer: Latent, start: Place, design: Design, ports: Sequence[Port], gap: Sequence[Matrix], place: SearchContext
) -> Latent:
    """All hypotheses weighed; where the best is more than chance, the best are refined, and weighed against one another."""
    hypotheses, T_E = hypotheses_of(ports), answer.config.parameters['environment.T_E']
    place.on_progress(f'weighing {len(hypotheses)} hypotheses')
    weighed = weigh_all(design, hypotheses, T_E, gap, place.seed, place.pool, place.stop)
    answer = replace(answer, p_value=p_value(weighed))
    tried: Sequence[RefinedHypothesis] = ()
    if answer.p_value <= SIGNIFICANT:
        tried = refined(start, weighed, T_E, place.pool, place.stop, place.on_progress)
    simulated = {one.weighed.hypothesis.name: one for one in tried}
    finalists = [one.weighed for one in tried] or weighed[:SHOWN]
    widened = min([one.doubt for one in tried] or [widening(one, 1.0) for one in finalists])
    last = [weigh(one.design, one.hypothesis, T_E, (), widened) for one in finalists]
    nothing = without(design.products(hypotheses[0], widened), design.z)
    findings = [finding(one, simulated.get(one.hypothesis.name), gap, widened, nothing) for one in last]
    findings.sort(key=lambda one: -one.evidence)
    best = first_to_name(findings)
    findings.sort(key=lambda one: one is not best)
    answer = replace(answer, findings=tuple(findings), widened=widened)
    if not tried or best.error > (1.0 - LEAST_FALL) * answer.error:
        return answer
    pulls_seen = any(port.name in ('sense_F_1', 'sense_F_2', 'sense_stress') for port in ports)
    return replace(answer, verdict=best.name, indistinguishable=indistinguishable(findings, pulls_seen))


def first_to_name(findings: Sequence[Finding]) -> Finding:
    """Of those that leave nearly as little as any the most credible; what comes from outside before what does not.

    A force, heat or power needs a cause; a material that changes with time, or a sensor, can imitate each.
    """
    least = min(one.error for one in findings)
    near = [one for one in findings if one.error <= ALIKE * least]
    outside = [one for one in near if one.hypothesis.hook in FROM_OUTSIDE]
    return max(outside or near, key=lambda one: one.evidence)


def indistinguishable(findings: Sequence[Finding], pulls_seen: bool) -> dict[str, str]:
    """The hypotheses that explain as well as the best, which is the first, with the reason."""
    best, found = findings[0], {}
    least = min(one.error for one in findings)
    for one in findings[1:]:
        why = reason(best.hypothesis, one.hypothesis, pulls_seen)
        if one.error <= ALIKE * least and (why or abs(best.evidence - one.evidence) < CERTAIN):
            found[one.name] = why or 'these recordings do not tell'
    return found


def finding(one: Weighed, tried: RefinedHypothesis | None, gap: Sequence[Matrix], widened: float, nothing: float) -> Finding:
    """What is reported of a hypothesis: as simulated, if it was; `nothing` is the log evidence without any.

    What the linear model promises, and simulation does not keep, is taken off the evidence.
    """
    estimate, prior = estimate_of(one, widened), one.prior
    u, squares = (tried.u, tried.squares / widened) if tried else (estimate.u, estimate.squares)
    band = GAUSS_95 * np.hypot(estimate.std, floor_of(one, gap, widened))
    courses, at = [], 0
    for run in one.design.runs:
        for port in one.hypothesis.ports:
            part = slice(at, at + len(run.grid.knots))
            courses.append(Course(run.name, port, run.grid.knots, port.probe * u[part], port.probe * band[part]))
            at = part.stop
    return Finding(
        one.hypothesis, one.evidence - nothing - 0.5 * max(squares - estimate.squares, 0.0), prior.dof, prior.words,
        error_of(one.design, squares, widened), errors_in_gaps(one, widened)[1], float(np.mean(np.abs(u) > band)),
        tuple(courses), tried.place.problem.values(tried.place.z) if tried else {},
    )  # fmt: skip
