"""Rival explanations of the same recordings: each fitted to them, with its evidence and what it leaves uncertain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import Campaign
from sma_sim.evidence.estimation.calibrate import (
    FINAL_RTOL,
    MODELS,
    Options,
    check,
    full_problem,
    multistart_search,
)
from sma_sim.evidence.estimation.executors import run_in_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import (
    accumulated,
    cost_at,
    measured_steps,
    minimize,
    normal_parts,
)
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS, StopCriteria
from sma_sim.evidence.model_selection.candidates import Candidate, candidates_for
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.evidence.model_selection.forward_selection import most_promising
from sma_sim.evidence.model_selection.kinetics_choice import with_other_kinetics
from sma_sim.evidence.model_selection.refit import best_refits, refit
from sma_sim.evidence.model_selection.restricted import is_plausible_fit
from sma_sim.evidence.model_selection.score_tests import ScreeningResult, screen
from sma_sim.model.config import Config, suggestion
from sma_sim.model.errors import UserError
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
BARE = 'nothing'  # the name of the hypothesis that no effect is missing
PATIENT = StopCriteria(
    max_iterations=25, damping=1e2, min_decrease=0.1, relative_decrease=0.0, central=False
)  # evidence differs by less than a fit's progress
LEADING = 10.0  # log evidence behind the best within which an explanation is a rival to be told apart
STARTS = 2  # of the bare fit
DRAWS = 3  # from each posterior
SHORTENINGS, SHORTER = 6, 0.5  # of a draw that the recordings contradict


@dataclass(frozen=True)
class Hypothesis:
    """A fitted explanation. `evidence`: log of its evidence by Laplace's method (natural, up to a common constant).

    `root` (n, n): L with L L^T the posterior covariance of the n unknowns that all runs share, in z. `starts` (wires,):
    the mean start of the recordings, in z; `draws` (d, n) of the shared unknowns from the posterior.
    `factor`: by how much the noise was widened in `fitted.problem`.
    """

    name: str
    fitted: FitResult
    evidence: float
    root: Matrix
    starts: Vector
    draws: Matrix
    factor: float = 1.0

    @property
    def shared(self) -> int:
        """How many unknowns all runs share: the free parameters and the delay."""
        return len(self.fitted.problem.shared)


def bare_fit(training: Campaign, config: Config, models: Sequence[str], place: SearchContext) -> FitResult:
    """The configuration as it is, with the kinetics that fit it better."""
    options = Options(starts=STARTS)
    check(training, config, options)
    found = []
    for model in models:
        place.on_progress(f'fitting the {model} model')
        found.append(multistart_search(training, replace(config, model=model), options, place))
        stop_if_asked(place)
    return min(found, key=lambda one: one.cost)


def stop_if_asked(place: SearchContext) -> None:
    """Before there is a design, Ctrl-C ends all."""
    if place.stop.is_set():
        raise KeyboardInterrupt


def named_rivals(bare: FitResult, names: Sequence[str], place: SearchContext) -> list[tuple[str, FitResult]]:
    """The explanations by name: effects, several joined by `+`, or `nothing`. Raises UserError."""
    known = {one.name: one for one in candidates_for(bare.problem.config, place.folders)}
    for effect in (part for name in names for part in name.split('+') if name != BARE):
        if effect not in known:
            raise UserError(
                f'--between {effect}: no effect that could be missing from this model{suggestion(effect, known)}; '
                f'expected {BARE}, or some of {", ".join(known)}, joined by + where they act together'
            )
    place.on_progress(f'fitting {", ".join(names)}')
    jobs = [partial(explained, bare, () if name == BARE else tuple(name.split('+')), place) for name in names]
    return list(zip(names, run_in_threads(jobs, place.stop), strict=True))


def explained(bare: FitResult, effects: Sequence[str], place: SearchContext) -> FitResult:
    """The fit with some effects more, one after the other. Raises SimulationError where the model cannot be run."""
    fitted = bare
    for name in effects:
        candidates = {one.name: one for one in candidates_for(fitted.problem.config, place.folders)}
        if name not in candidates:
            raise UserError(f'--between: {name} twice in one explanation')
        alone = screened_alone(fitted, candidates[name], place)
        (better,) = best_refits(fitted, [alone], place)
        if better is None:
            raise SimulationError(f'the model cannot be fitted with {name}')
        fitted = better
    return fitted


def screened_alone(fitted: FitResult, candidate: Candidate, place: SearchContext) -> ScreeningResult:
    """What a score test makes of one effect; its first probe where the recordings do not see it."""
    found = screen(fitted.problem, fitted.z, [candidate], place.pool, place.seed)
    if found:
        return found[0]
    probe = candidate.families[0][0]
    return ScreeningResult(candidate, 0.0, {**probe.shape, probe.parameter: probe.neutral + probe.step}, 1.0)


def leading_rivals(bare: FitResult, place: SearchContext) -> list[tuple[str, FitResult]]:
    """The explanations of one more effect that come close to the best, and the bare model if it does."""
    candidates = candidates_for(bare.problem.config, place.folders)
    place.on_progress(f'screening {len(candidates)} effects')
    screened = screen(bare.problem, bare.z, candidates, place.pool, place.seed)
    tried = most_promising(screened)
    if not tried:
        return [(BARE, bare)]
    place.on_progress(f'fitting {", ".join(one.candidate.name for one in tried)}')
    refitted = best_refits(bare, tried, place)
    fits = [
        (one.candidate.name, fit) for one, fit in zip(tried, refitted, strict=True)
        if fit is not None and is_plausible_fit(fit, one.candidate.found)
    ]  # fmt: skip
    scored = [(BARE, bare), *fits]
    best = min(rough_score(fit) for _, fit in scored)
    return [(name, fit) for name, fit in scored if rough_score(fit) <= best + LEADING]


def rough_score(fit: FitResult) -> float:
    """Half the Bayesian information criterion on the noise that the fit leaves: smaller is better."""
    return fit.cost + 0.5 * len(fit.problem.free) * float(np.log(fit.problem.samples))


def with_common_kinetics(rivals: Sequence[tuple[str, FitResult]], place: SearchContext) -> list[tuple[str, FitResult]]:
    """The same with the other kinetics, if the best explanation fits better with them: kinetics are no rival."""
    name, best = min(rivals, key=lambda one: one[1].cost)
    if best.error < CRITERIA.other_kinetics_above:
        return list(rivals)
    other = refit(*with_other_kinetics(best), place, FROM_PRIORS)
    stop_if_asked(place)
    if other is None or other.cost >= best.cost:
        return list(rivals)
    place.on_progress(f'{other.problem.config.model} kinetics suit {name} better')
    jobs = [partial(refit, *with_other_kinetics(fit), place, FROM_PRIORS) for _, fit in rivals]
    fits = run_in_threads(jobs, place.stop)
    return [(one, fit) for (one, _), fit in zip(rivals, fits, strict=True) if fit is not None]


def hypotheses(training: Campaign, rivals: Sequence[tuple[str, FitResult]], place: SearchContext) -> tuple[Hypothesis, ...]:
    """Each explanation at the optimum of all samples, with its posterior.

    Where even the best leaves more than the noise, all weights shrink by that factor: what no rival explains must not
    count as evidence for one of them.
    """
    place.on_progress('the last fits, on all samples')
    last = run_in_threads([partial(on_all_samples, training, fit, place) for _, fit in rivals], place.stop)
    stop_if_asked(place)
    factor = max(1.0, min(one.error for one in last))
    return tuple(
        hypothesis(name, replace(one, problem=one.problem.weighted(1.0 / factor)), factor, place)
        for (name, _), one in zip(rivals, last, strict=True)
    )


def on_all_samples(training: Campaign, fit: FitResult, place: SearchContext) -> FitResult:
    """The descent continued on all samples."""
    return minimize(full_problem(training, fit, Options()).at_tolerance(FINAL_RTOL), fit.z, PATIENT, place)


def hypothesis(name: str, fit: FitResult, factor: float, place: SearchContext) -> Hypothesis:
    """Evidence and posterior from the curvature at the optimum."""
    problem, z = fit.problem, fit.z
    cost = cost_at(problem, z, place.pool)
    parts = normal_parts(problem, z, place.pool, measured_steps(problem, z, place.pool), central=True)
    hessian = accumulated(parts, z)[2]
    n = len(problem.shared)
    covariance = np.asarray(np.linalg.inv(hessian), dtype=np.float64)
    starts: Vector = np.array([z[at[n : n + problem.wires]] for at in problem.indices()]).mean(axis=0)
    root = np.asarray(np.linalg.cholesky(covariance[:n, :n]), dtype=np.float64)
    draws = posterior_draws(fit, cost, covariance, place)[:, :n]
    evidence = -cost - 0.5 * float(np.linalg.slogdet(hessian)[1])
    return Hypothesis(name, replace(fit, cost=cost), evidence, root, starts, draws, factor)


def posterior_draws(fit: FitResult, cost: float, covariance: Matrix, place: SearchContext) -> Matrix:
    """Draws (DRAWS, all unknowns) from the posterior: normal ones, drawn in where the recordings contradict them.

    Valleys are curved: a step of one standard deviation along the tangent may leave them. Each step is shortened until the
    cost rises by no more than twice what the curvature foretells.
    """
    problem, random = fit.problem, np.random.default_rng(place.seed)
    low, high = problem.limits()
    root, found = np.linalg.cholesky(covariance), []
    for _ in range(DRAWS):
        xi = random.normal(size=len(fit.z))
        for _ in range(SHORTENINGS):
            at = np.clip(fit.z + root @ xi, low, high)
            if cost_at(problem, at, place.pool) - cost <= float(xi @ xi) + 1.0:
                break
            xi = SHORTER * xi
        found.append(at)
    return np.array(found)


def models_of(model: str) -> tuple[str, ...]:
    """The kinetics to try."""
    return MODELS if model == 'auto' else (model,)
