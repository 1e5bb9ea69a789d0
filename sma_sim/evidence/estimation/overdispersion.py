"""How much less correlated residuals of a wrong model say than their number and the stated noise would let them.

N residuals of size e (in units of the noise) that stay correlated over tau samples are N/tau independent ones, each as
uncertain as e: their squares count e^2 tau times too much (1 when the model is right).
"""

from __future__ import annotations

from concurrent.futures import Executor
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.problem import Problem, residuals_at
from sma_sim.evidence.estimation.uncertainty import autocorrelation_time

Vector = NDArray[np.float64]


def overdispersion(problem: Problem, z: Vector, pool: Executor) -> float:
    """k: root mean square of the residuals times the root of their longest correlation time in samples, at least 1.

    inf where the model cannot be run.
    """
    found = [residuals for residuals in residuals_at(problem, z, pool) if residuals is not None]
    if len(found) < len(problem.runs):
        return inf
    size = sqrt(sum(float(np.vdot(residuals, residuals)) for residuals in found) / problem.samples)
    longest = max(autocorrelation_time(row) for residuals in found for row in residuals)
    return max(1.0, size * sqrt(longest))
