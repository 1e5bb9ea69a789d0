"""A fitted problem with less freedom: an effect within its realistic range, or without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import FreeParameter
from sma_sim.evidence.estimation.plausibility import realistic_range
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.model_selection.candidates import is_plausible
from sma_sim.model.effects.discovery import FoundEffect

Vector = NDArray[np.float64]


def is_plausible_fit(fit: FitResult, found: FoundEffect) -> bool:
    """Whether the fitted values of an effect lie in their realistic ranges."""
    return is_plausible(found, fit.values_of(found.effect.name))


def within_realistic_range(fit: FitResult, found: FoundEffect) -> tuple[Problem, Vector]:
    """The problem with the parameters of one effect kept in their realistic ranges, and the nearest point there."""
    ranges = {f'effects.{found.effect.name}.{p.name}': realistic_range(p) for p in found.effect.parameters}
    free = tuple(with_narrower_bounds(p, ranges.get(p.name)) for p in fit.problem.free)
    problem = replace(fit.problem, free=free)
    return problem, np.clip(fit.z, *problem.limits())


def with_narrower_bounds(free: FreeParameter, between: tuple[float, float] | None) -> FreeParameter:
    """A free parameter with narrower bounds (SI), if any; a logarithmic one has no coordinate of zero."""
    if between is None:
        return free
    low, high = (free.coordinate(value) if value > 0.0 or not free.log else free.low for value in between)
    return replace(free, low=max(free.low, low), high=min(free.high, high))


def without_effect(fit: FitResult, effect: str) -> tuple[Problem, Vector]:
    """The problem without one of its effects, and the rest of z as it was."""
    problem, prefix = fit.problem, f'effects.{effect}.'
    kept = [k for k, p in enumerate(problem.free) if not p.name.startswith(prefix)]
    fewer = tuple(active for active in problem.config.effects if active.found.effect.name != effect)
    rest = np.arange(len(problem.free), len(fit.z))
    smaller = replace(problem, config=replace(problem.config, effects=fewer), free=tuple(problem.free[k] for k in kept))
    return smaller, fit.z[[*kept, *rest]]
