"""Tempered likelihood: fits of a model that is known to be wrong, in which correlated residuals count as few.

A model that lacks something biases its parameters as far as white noise would let it. The squares are divided by the
overdispersion k^2 of the residuals (`estimation.overdispersion`; generalised Bayes; k = 1 when the model is right), so that
the priors keep their weight.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import replace
from math import inf, isnan

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import minimize
from sma_sim.evidence.estimation.overdispersion import overdispersion
from sma_sim.evidence.estimation.problem import Problem, residuals_at
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import ADDED_EFFECT, TEMPERED
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]


def tempered_minimum(problem: Problem, z: Vector, k: float, context: SearchContext) -> FitResult:
    """Minima with the squares divided by the square of the overdispersion: at first `k`, then that of the fit so far.

    `cost` is that without tempering. Raises SimulationError where the model cannot be run.
    """
    for _ in range(CRITERIA.tempering_stages):
        z = minimize(problem.weighted(1.0 / k), z, TEMPERED, context).z
        now = overdispersion(problem, z, context.pool)
        if now > CRITERIA.tempering_ratio * k or context.stop.is_set():
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


def tempered(fit: FitResult, context: SearchContext) -> FitResult:
    """A fit of isobaric tests whose priors count as its overdispersion asks; itself for other runs.

    Few levels leave open how strain grows with stress, and no model of one homogeneous wire follows them within the noise.
    As if what is left were white, it would drive parameters through what the levels leave open, against all priors.
    """
    if isnan(fit.problem.span) or context.stop.is_set():
        return fit
    problem = replace(fit.problem, tempering=overdispersion(fit.problem, fit.z, context.pool))
    try:
        found = minimize(problem, fit.z, ADDED_EFFECT, context)
    except SimulationError:
        return fit
    return replace(fit, problem=problem, z=found.z, cost=found.cost)
