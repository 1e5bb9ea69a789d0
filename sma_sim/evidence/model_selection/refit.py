"""Refits: a candidate effect fitted together with the model's own parameters, from what the screening found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import minimize, with_early_stopping
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import ADDED_EFFECT, StopCriteria
from sma_sim.evidence.model_selection.candidates import Candidate
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]


def cannot_reach(target: float, max_iterations: int, costs: Sequence[float]) -> bool:
    """Whether a cost that falls as slowly as in the last of at most `max_iterations` cannot come down to `target`."""
    before, last = costs[-2:]
    return (before - last) * (max_iterations - len(costs) + 1) < last - target


def refit(
    problem: Problem, z: Vector, context: SearchContext, criteria: StopCriteria = ADDED_EFFECT, target: float = math.inf
) -> FitResult | None:
    """The optimum near z, or where the cost fell too slowly to reach `target`; None where the model cannot be run there."""
    lost = partial(cannot_reach, target, criteria.max_iterations)
    try:
        return minimize(problem, z, criteria, with_early_stopping(context, lost))
    except SimulationError:
        return None


def at_finite_step(candidate: Candidate, screened: ScreeningResult | None) -> ScreeningResult:
    """A candidate with its strengths at least a probe's step from neutral, on the side that the screening found, if any."""
    family = candidate.families[len(candidate.families) // 2]
    values = dict(family[0].shape) | (dict(screened.values) if screened else {})
    for probe in family:
        away = values.get(probe.parameter, probe.neutral) - probe.neutral
        if away == 0.0 or (away * probe.step > 0.0 and abs(away) < abs(probe.step)):
            values[probe.parameter] = probe.neutral + probe.step
    return ScreeningResult(candidate, screened.gain if screened else 0.0, values)
