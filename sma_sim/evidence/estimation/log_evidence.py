"""Which of the kinetics explains recordings better: log evidence by Laplace's method, prior 1/2 for each.

    log p(y | M) = -S/(2 k^2) - |z|^2/2 - log det(I + J^T J/k^2)/2 + constant

with the sum of squares S and the Jacobian J at the optimum z, whose priors are N(0, 1) (MacKay, Neural Computation 4 (1992)
415). k, the overdispersion of the model that leaves least, is the same for all that are compared: what none of them explains
is no evidence for one of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from math import exp, log

import numpy as np

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.overdispersion import overdispersion
from sma_sim.evidence.estimation.problem import accumulated, normal_parts

DECISIVE = 5.0  # log odds: posterior odds of 150 to 1


def log_evidences(fits: Sequence[FitResult], pool: Executor) -> list[float]:
    """The log evidence of each of several fits to the same recordings, up to a common constant. Raises SimulationError."""
    k = min(overdispersion(fit.problem, fit.z, pool) for fit in fits)
    return [log_evidence(fit, k, pool) for fit in fits]


def more_probable(fits: Sequence[FitResult], pool: Executor) -> FitResult:
    """The fit with the largest log evidence. Raises SimulationError."""
    return fits[0] if len(fits) == 1 else fits[int(np.argmax(log_evidences(fits, pool)))]


def log_evidence(fit: FitResult, k: float, pool: Executor) -> float:
    """The log evidence of a fit for an overdispersion k, up to a constant of the recordings. Raises SimulationError."""
    hessian = accumulated(normal_parts(fit.problem, fit.z, pool), fit.z, k)[2]
    occam = float(np.linalg.slogdet(hessian)[1]) - 2.0 * len(fit.z) * log(k)
    return -0.5 * (fit.squares / k**2 + float(fit.z @ fit.z) + occam)


def kinetics_probabilities(fits: Sequence[FitResult], evidences: Sequence[float]) -> Mapping[str, float]:
    """The posterior probability of the kinetics of each fit, prior 1/2."""
    weights = [exp(evidence - max(evidences)) for evidence in evidences]
    return {fit.problem.config.simulated_kinetics: weight / sum(weights) for fit, weight in zip(fits, weights, strict=True)}
