"""Fitted problems changed, and where to start: with a candidate effect, without an effect, with the other kinetics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import declared_parameters, default_names, free_parameter
from sma_sim.evidence.estimation.problem import Problem, own_values, with_values
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.model.arrays import Vector


def with_candidate(base: FitResult, screened: ScreeningResult) -> tuple[Problem, Vector]:
    """The problem with one more effect, and where to start: the fit without it and what the screening found."""
    problem, effect = base.problem, screened.candidate.effect
    config, measured = with_effect(problem.config, effect, {}), {channel for run in problem.runs for channel in run.channels}
    declared, neutral, at = declared_parameters(config), config.values, len(problem.free)
    start = {
        f'effects.{effect.name}.{p.name}': screened.values[p.name]
        for p in effect.parameters
        if p.name in screened.values and effect.is_seen(p.name, measured)
    }
    new = [free_parameter(name, neutral[name], declared[name]) for name in start]
    larger = replace(problem, config=config, free=(*problem.free, *new))
    shared = np.insert(base.z[: len(problem.shared)], at, np.zeros(len(new)))
    return larger, with_values(larger, np.concatenate([shared, own_values(problem, base.z, larger)]), start)


def without_effect(fit: FitResult, effect: str) -> tuple[Problem, Vector]:
    """The problem without one of its effects, and the rest of z as it was."""
    problem, prefix = fit.problem, f'effects.{effect}.'
    kept = [k for k, p in enumerate(problem.free) if not p.name.startswith(prefix)]
    fewer = tuple(active for active in problem.config.effects if active.effect.name != effect)
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
