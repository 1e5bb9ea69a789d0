"""Fitted problems changed and fitted again: with a candidate effect, without an effect, with the other kinetics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import declared_parameters, default_names, free_parameter
from sma_sim.evidence.estimation.levenberg_marquardt import minimize, with_early_stopping
from sma_sim.evidence.estimation.problem import Problem, own_values
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import ADDED_EFFECT, StopCriteria
from sma_sim.evidence.model_selection.candidates import Candidate
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.model.arrays import Vector
from sma_sim.solver.simulate import SimulationError


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


def at_finite_step(candidate: Candidate) -> ScreeningResult:
    """A candidate with its strengths a probe's step from neutral."""
    family = candidate.families[len(candidate.families) // 2]
    values = dict(family[0].shape)
    for probe in family:
        values.setdefault(probe.parameter, probe.neutral + probe.step)
    return ScreeningResult(candidate, 0.0, values)


def without_effect(fit: FitResult, effect: str) -> tuple[Problem, Vector]:
    """The problem without one of its effects, and the rest of z as it was."""
    problem, prefix = fit.problem, f'effects.{effect}.'
    kept = [k for k, p in enumerate(problem.free) if not p.name.startswith(prefix)]
    fewer = tuple(active for active in problem.config.effects if active.found.effect.name != effect)
    kept_free, shared = tuple(problem.free[k] for k in kept), np.arange(len(problem.free), len(problem.shared))
    smaller = replace(problem, config=replace(problem.config, effects=fewer), free=kept_free)
    return smaller, np.concatenate([fit.z[[*kept, *shared]], own_values(problem, fit.z, smaller)])


def with_other_kinetics(fit: FitResult) -> tuple[Problem, Vector]:
    """The same problem with the other model of kinetics, and z carried over by name."""
    problem = fit.problem
    model = 'mas' if problem.config.simulated_kinetics == 'hybrid' else 'hybrid'
    config = problem.config.variant(kinetics=model)
    measured = {channel for run in problem.runs for channel in run.channels}
    names = [*default_names(config, measured), *(p.name for p in problem.free if p.name.startswith('effects.'))]
    known = dict(zip([p.name for p in problem.free], zip(problem.free, fit.z, strict=False), strict=True))
    declared, values = declared_parameters(config), config.values
    free = [
        known[name][0] if name in known else free_parameter(name, values[name], declared[name], config.priors.get(name))
        for name in names
    ]
    start = [float(known[name][1]) if name in known else 0.0 for name in names]
    return replace(problem, config=config, free=tuple(free)), np.array([*start, *fit.z[len(problem.free) :]])
