"""Rival explanations of the same recordings: each fitted to them, with its evidence and what it leaves uncertain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.calibrate import FINAL_RTOL, FitOptions, full_problem, multistart_search
from sma_sim.evidence.estimation.executors import run_in_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import minimize, refit
from sma_sim.evidence.estimation.log_evidence import more_probable
from sma_sim.evidence.estimation.overdispersion import overdispersion
from sma_sim.evidence.estimation.prepared_fit import check_data, prepare
from sma_sim.evidence.estimation.problem import Problem, accumulated, cost_at, measured_steps, normal_parts
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS, StopCriteria
from sma_sim.evidence.model_selection.candidates import Candidate, candidates_for
from sma_sim.evidence.model_selection.model_changes import with_other_kinetics
from sma_sim.evidence.model_selection.score_tests import ScreeningResult, at_finite_step, screen
from sma_sim.evidence.model_selection.variants import variants_of
from sma_sim.evidence.search.beam import search
from sma_sim.evidence.search.components import catalogue_for
from sma_sim.evidence.search.refine import WINDOW, better, extended, further_fits, model_of
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.config import Config, suggestion
from sma_sim.model.effects.ports import CHANNELS
from sma_sim.model.errors import UserError
from sma_sim.solver.simulate import SimulationError

NO_EFFECT = 'nothing'  # the name of the hypothesis that no effect is missing
LAST_STOP_CRITERIA = StopCriteria(  # patient: evidence differs by less than a usual fit leaves
    max_iterations=25, damping=1e2, min_decrease=0.1, relative_decrease=0.0, central=False
)
BASE_FIT_STARTS = 2  # of the fit without further effects: one start may end in a side valley
DRAWS_PER_POSTERIOR = 3  # at which limits are checked; each is a simulation of every sequence
MAX_SHORTENINGS, SHORTENING = 6, 0.5  # of a draw that the recordings contradict


@dataclass(frozen=True)
class NamedFit:
    """A fitted explanation by the name under which it is reported."""

    name: str
    fitted: FitResult


@dataclass(frozen=True)
class ModelHypothesis:
    """A fitted explanation with its posterior.

    Attributes
    ----------
    name
        Its effects, joined by `+`, or `nothing`.
    fitted
        The fit on all samples.
    log_evidence
        By Laplace's method (natural, up to a common constant).
    root
        (n, n): L with L L^T the posterior covariance of the n unknowns that all runs share, in z.
    starts
        (wires,): the mean start of the recordings, in z.
    draws
        (d, n): of the shared unknowns from the posterior.
    noise_factor
        By how much the noise was widened in `fitted.problem`.
    """

    name: str
    fitted: FitResult
    log_evidence: float
    root: Matrix
    starts: Vector
    draws: Matrix
    noise_factor: float = 1.0

    @property
    def shared(self) -> int:
        """How many unknowns all runs share: the free parameters and the delay."""
        return len(self.fitted.problem.shared)

    @property
    def as_measured(self) -> Problem:
        """The problem with the noise as it was stated."""
        return self.fitted.problem.weighted(self.noise_factor)


def fit_base_model(training: Dataset, config: Config, models: Sequence[str], context: SearchContext) -> FitResult:
    """The configuration as it is, with the more probable of the kinetics."""
    options = FitOptions(starts=BASE_FIT_STARTS)
    check_data(training, config)
    fits, start = list[FitResult](), prepare(training, config)
    for model in models:
        context.on_progress(f'fitting the {model} model')
        fits.append(multistart_search(start.with_kinetics(model), options, context))
        raise_if_stopped(context)
    return more_probable(fits, context.pool)


def raise_if_stopped(context: SearchContext) -> None:
    """Before there is a design, Ctrl-C ends all."""
    if context.stop.is_set():
        raise KeyboardInterrupt


def named_rivals(base: FitResult, names: Sequence[str], context: SearchContext) -> list[NamedFit]:
    """The explanations by name: effects, several joined by `+`, or `nothing`. Raises UserError."""
    candidates = candidates_by_name(base, context)
    for effect in (part for name in names for part in name.split('+') if name != NO_EFFECT):
        if effect not in candidates:
            known = ', '.join(sorted({candidate.effect.plain_name for candidate in candidates.values()}))
            raise UserError(
                f'between {effect}: no effect that could be missing from this model{suggestion(effect, candidates)}; '
                f'expected {NO_EFFECT}, or some of {known}, joined by + where they act together'
            )
    context.on_progress(f'fitting {", ".join(names)}')
    jobs = [partial(fit_with_effects, base, () if name == NO_EFFECT else name.split('+'), context) for name in names]
    fits = run_in_threads(jobs, context.stop)
    return [NamedFit(name, fit) for name, fit in zip(names, fits, strict=True)]


def candidates_by_name(fitted: FitResult, context: SearchContext) -> dict[str, Candidate]:
    """The effects that may be missing from a model, and their variants."""
    effects = candidates_for(fitted.problem.config, context.folders)
    return {candidate.name: candidate for candidate in (*effects, *variants_of(effects, CHANNELS))}


def fit_with_effects(base: FitResult, effects: Sequence[str], context: SearchContext) -> FitResult:
    """The fit with further effects, one after the other. Raises SimulationError where the model cannot be run."""
    found = model_of((), [base], context)
    for name in effects:
        if found is None:
            break
        candidates = candidates_by_name(found.fit, context)
        if name not in candidates:
            raise UserError(f'between: {name} twice in one explanation')
        catalogue = catalogue_for(found.fit, context)
        component = catalogue.component(screen_candidate(found.fit, candidates[name], context))
        models = extended(found, [component], context)
        found = better(models[0], next(iter(further_fits(found, models, context)), None)) if models else None
    if found is None:
        raise SimulationError(f'the model cannot be fitted with {" + ".join(effects)}')
    return found.fit


def screen_candidate(fitted: FitResult, candidate: Candidate, context: SearchContext) -> ScreeningResult:
    """The score test of one effect; its first probe where the recordings do not see it."""
    screened = screen(fitted.problem, fitted.z, [candidate], context.pool)
    return screened[0] if screened else at_finite_step(candidate)


def leading_rivals(base: FitResult, context: SearchContext) -> list[NamedFit]:
    """The explanations by one further effect, or none, that have weight beside the best (`search`)."""
    book = search([base], context, equations=False, most=1)
    k, ranked = book.overdispersion, [model for model in book.ranked() if not any(c.is_difference for c in model.components)]
    limit = ranked[0].score(k) - WINDOW
    return [
        NamedFit(next((one.name for one in model.components), NO_EFFECT), model.fit)
        for model in ranked
        if model.score(k) >= limit
    ]


def with_common_kinetics(rivals: Sequence[NamedFit], context: SearchContext) -> list[NamedFit]:
    """The same with the other kinetics, if the best explanation is more probable with them: kinetics are no rival."""
    best = min(rivals, key=lambda rival: rival.fitted.cost)
    if len(context.kinetics) == 1:
        return list(rivals)
    other = refit(*with_other_kinetics(best.fitted), context, FROM_PRIORS)
    raise_if_stopped(context)
    if other is None or more_probable([best.fitted, other], context.pool) is best.fitted:
        return list(rivals)
    context.on_progress(f'{best.name} is more probable with the {other.problem.config.simulated_kinetics} kinetics')
    jobs = [partial(refit, *with_other_kinetics(rival.fitted), context, FROM_PRIORS) for rival in rivals]
    fits = run_in_threads(jobs, context.stop)
    return [NamedFit(rival.name, fit) for rival, fit in zip(rivals, fits, strict=True) if fit is not None]


def fit_hypotheses(training: Dataset, rivals: Sequence[NamedFit], context: SearchContext) -> tuple[ModelHypothesis, ...]:
    """Each explanation at the optimum of all samples, with its posterior.

    All weights shrink by the overdispersion of what the best leaves: what no rival explains must not count as evidence for
    one of them.
    """
    context.on_progress('the last fits, on all samples')
    jobs = [partial(refit_on_all_samples, training, rival.fitted, context) for rival in rivals]
    fits = run_in_threads(jobs, context.stop)
    raise_if_stopped(context)
    factor = min(overdispersion(fit.problem, fit.z, context.pool) for fit in fits)
    return tuple(
        laplace_hypothesis(NamedFit(rival.name, replace(fit, problem=fit.problem.weighted(1.0 / factor))), factor, context)
        for rival, fit in zip(rivals, fits, strict=True)
    )


def refit_on_all_samples(training: Dataset, fit: FitResult, context: SearchContext) -> FitResult:
    """The fit continued on all samples."""
    problem = full_problem(training, fit, FitOptions()).at_tolerance(FINAL_RTOL)
    return minimize(problem, fit.z, LAST_STOP_CRITERIA, context)


def laplace_hypothesis(rival: NamedFit, noise_factor: float, context: SearchContext) -> ModelHypothesis:
    """Evidence and posterior from the curvature at the optimum."""
    problem, z = rival.fitted.problem, rival.fitted.z
    cost = cost_at(problem, z, context.pool)
    parts = normal_parts(problem, z, context.pool, measured_steps(problem, z, context.pool), central=True)
    hessian = accumulated(parts, z, problem.tempering)[2]
    n = len(problem.shared)
    covariance = np.asarray(np.linalg.inv(hessian), dtype=np.float64)
    wires = problem.runs[0].starts
    starts: Vector = np.array([z[indices[n : n + wires]] for indices in problem.indices()]).mean(axis=0)
    root = np.asarray(np.linalg.cholesky(covariance[:n, :n]), dtype=np.float64)
    draws = posterior_draws(rival.fitted, cost, covariance, context)[:, :n]
    log_evidence = -cost - 0.5 * float(np.linalg.slogdet(hessian)[1])
    fitted = replace(rival.fitted, cost=cost)
    return ModelHypothesis(rival.name, fitted, log_evidence, root, starts, draws, noise_factor)


def posterior_draws(fit: FitResult, cost: float, covariance: Matrix, context: SearchContext) -> Matrix:
    """Draws (DRAWS_PER_POSTERIOR, all unknowns) from the posterior: normal ones, shortened where the recordings object.

    Valleys are curved: a step of one standard deviation along the tangent may leave them. Each step is shortened until the
    cost rises by no more than twice what the curvature predicts.
    """
    problem, random = fit.problem, np.random.default_rng(context.seed)
    low, high = problem.limits()
    root, draws = np.linalg.cholesky(covariance), []
    for _ in range(DRAWS_PER_POSTERIOR):
        xi = random.normal(size=len(fit.z))
        for _ in range(MAX_SHORTENINGS):
            z = np.clip(fit.z + root @ xi, low, high)
            if cost_at(problem, z, context.pool) - cost <= float(xi @ xi) + 1.0:
                break
            xi = SHORTENING * xi
        draws.append(z)
    return np.array(draws)
