"""A model with the other kinetics: they are a choice of model, not a finding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import declared_parameters, default_names, free_parameter, values_of
from sma_sim.evidence.estimation.problem import Problem

Vector = NDArray[np.float64]


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
