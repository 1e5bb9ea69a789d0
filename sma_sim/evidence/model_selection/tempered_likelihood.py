"""Tempered likelihood: fits of a model that is known to be wrong, in which correlated residuals count as few.

A model that lacks something biases its parameters as far as white noise would let it. The squares are divided by the
overdispersion k^2 of the residuals (`estimation.overdispersion`; generalised Bayes; k = 1 when the model is right), so that
the priors keep their weight.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import minimize
from sma_sim.evidence.estimation.overdispersion import overdispersion
from sma_sim.evidence.estimation.problem import Problem, residuals_at
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import TEMPERED
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
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
