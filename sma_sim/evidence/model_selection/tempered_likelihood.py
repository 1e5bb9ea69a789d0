"""Fits of a model that is known to be wrong: residuals that hang together count as few, so that priors keep their say.

A model that lacks something bends its parameters as far as white noise would let it. With N residuals of size e (in units of
the noise) that stay correlated over tau samples there are N/tau that tell something, each as uncertain as e: their squares
are weighed down by k^2 = e^2 tau (generalised Bayes; k = 1 when the model is right). Such a fit stays near what is
plausible.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import replace
from threading import Event

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.levenberg_marquardt import StopCriteria, minimize
from sma_sim.evidence.estimation.problem import Problem, residuals_at
from sma_sim.evidence.estimation.uncertainty import autocorrelation_time
from sma_sim.evidence.model_selection.refit import FitResult
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
SOFT = StopCriteria(most=15, damping=1.0, enough=0.01, gain=3e-3, near=False)
STAGES = 3
COOLED = 0.7  # another stage is worth its time when k has fallen below this part


def overdispersion(problem: Problem, z: Vector, pool: Executor) -> float:
    """k: root mean square of the residuals times the root of their longest correlation time in samples, at least 1."""
    found = [one for one in residuals_at(problem, z, pool) if one is not None]
    if len(found) < len(problem.runs):
        return float('inf')
    size = float(np.sqrt(sum(float(np.vdot(one, one)) for one in found) / problem.samples))
    longest = max(autocorrelation_time(row) for one in found for row in one)
    return max(1.0, size * float(np.sqrt(longest)))


def tempered_minimum(problem: Problem, z: Vector, k: float, pool: Executor, stop: Event, stages: int = STAGES) -> FitResult:
    """Descents with the squares weighed down, at first by `k`, then by what the fit has come to.

    `cost` is that without weights. Raises SimulationError where the model cannot be run.
    """
    for _ in range(stages):
        z = minimize(problem.weighted(1.0 / k), z, pool, SOFT, stop).z
        now = overdispersion(problem, z, pool)
        if now > COOLED * k or stop.is_set():
            break
        k = now
    return FitResult(problem, z, cost_of(problem, z, pool))


def cost_of(problem: Problem, z: Vector, pool: Executor) -> float:
    """Half the sum of squares and of the prior, inf where the model cannot be run."""
    found = residuals_at(problem, z, pool)
    if any(one is None for one in found):
        return float('inf')
    return 0.5 * float(z @ z) + 0.5 * sum(float(np.vdot(one, one)) for one in found if one is not None)


def tempered(one: FitResult, pool: Executor, stop: Event) -> tuple[FitResult, float]:
    """A fit from the middle of the priors that is not bent by what the model lacks, and its k; `one` is the bent fit."""
    k = overdispersion(one.problem, one.z, pool)
    try:
        soft = tempered_minimum(one.problem, np.zeros_like(one.z), k, pool, stop)
    except SimulationError:
        soft = tempered_minimum(one.problem, one.z, k, pool, stop)
    return replace(soft, validated=one.validated), overdispersion(one.problem, soft.z, pool)
