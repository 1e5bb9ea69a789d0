"""Which kinetics suit a model better: they are a choice of model, not a finding."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.cross_validation import cross_validated
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import declared_parameters, default_names, free_parameter, values_of
from sma_sim.evidence.estimation.log_evidence import log_evidences
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.evidence.model_selection.refit import cost_with, refit

Vector = NDArray[np.float64]


def better_kinetics(fit: FitResult, context: SearchContext, target: float = inf) -> FitResult:
    """The same effects with the other kinetics, if these may be chosen and are more probable.

    Given up where the cost cannot reach `target`. Not tried in quasi-static tests, which have no time for rates.
    """
    if len(context.kinetics) == 1 or fit.problem.config.structure.structure.is_quasi_static or context.stop.is_set():
        return fit
    problem, z = with_other_kinetics(fit)
    most = (1.0 + CRITERIA.same_error) * fit.error
    other = refit(problem, z, context, target=min(target, cost_with(most, problem, z)))
    if other is None or other.error > most or context.stop.is_set():
        return fit
    ours, theirs = log_evidences([fit, other], context.pool)
    if theirs <= ours:
        return fit
    context.on_progress(
        f'{other.problem.config.simulated_kinetics} kinetics are more probable: log odds {theirs - ours:.1f}'
    )
    return cross_validated(other, context)


def with_other_kinetics(fit: FitResult) -> tuple[Problem, Vector]:
    """The same problem with the other model of kinetics, and z carried over by name."""
    problem = fit.problem
    model = 'mas' if problem.config.simulated_kinetics == 'hybrid' else 'hybrid'
    config = problem.config.variant(kinetics=model)
    measured = {channel for run in problem.runs for channel in run.channels}
    names = [*default_names(config, measured), *(p.name for p in problem.free if p.name.startswith('effects.'))]
    known = dict(zip([p.name for p in problem.free], zip(problem.free, fit.z, strict=False), strict=True))
    declared, values = declared_parameters(config), values_of(config)
    free = [
        known[name][0] if name in known else free_parameter(name, values[name], declared[name], config.priors.get(name))
        for name in names
    ]
    start = [float(known[name][1]) if name in known else 0.0 for name in names]
    return replace(problem, config=config, free=tuple(free)), np.array([*start, *fit.z[len(problem.free) :]])


def is_as_good(restricted: FitResult, fit: FitResult) -> bool:
    """Whether a model with less freedom predicts as well without leaving more, or leaves only the same noise."""
    predicts_as_well = restricted.prediction_error <= (1.0 + CRITERIA.same_error) * fit.prediction_error
    more = restricted.error / fit.error
    only_noise = restricted.error <= CRITERIA.noise_only and more <= 1.0 + CRITERIA.same_error
    return (predicts_as_well and more <= 1.0 + CRITERIA.min_error_reduction) or only_noise
