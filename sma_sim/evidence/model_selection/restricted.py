"""A fitted problem without one of its effects, and whether the values of one are realistic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.model_selection.candidates import is_plausible
from sma_sim.model.effects.discovery import FoundEffect

Vector = NDArray[np.float64]


def is_plausible_fit(fit: FitResult, found: FoundEffect) -> bool:
    """Whether the fitted values of an effect lie in their realistic ranges."""
    return is_plausible(found, fit.values_of(found.effect.name))


def without_effect(fit: FitResult, effect: str) -> tuple[Problem, Vector]:
    """The problem without one of its effects, and the rest of z as it was."""
    problem, prefix = fit.problem, f'effects.{effect}.'
    kept = [k for k, p in enumerate(problem.free) if not p.name.startswith(prefix)]
    fewer = tuple(active for active in problem.config.effects if active.found.effect.name != effect)
    rest = np.arange(len(problem.free), len(fit.z))
    smaller = replace(problem, config=replace(problem.config, effects=fewer), free=tuple(problem.free[k] for k in kept))
    return smaller, fit.z[[*kept, *rest]]
