"""Whether recordings begin in motion: what their first samples say of wires that are warm from before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sma_sim.evidence.estimation.problem import (
    Problem,
    accumulated,
    linearize,
    normal_equations,
    start_point,
    with_difference,
)
from sma_sim.evidence.estimation.recording_differences import IN_MOTION
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.model.arrays import Vector
from sma_sim.solver.inputs import Input
from sma_sim.solver.simulate import SimulationError

FIRST_SAMPLES = 10  # of a recording: a robot that cools moves in them, and one at rest is hardly heated yet


def motion_before(problem: Problem, context: SearchContext) -> float | None:
    """What it takes away if the recordings begin in motion: how little the model can begin like them at rest, whatever its
    parameters; None where it cannot be run.

    That is twice the log Bayes factor of their first samples, about those of the model in the middle of its priors, to first
    order: beside noise and all that is unknown at rest stands what may be left of a motion. Where recordings begin at rest
    it is negative. Where a fit has ended that lacks it, parameters are bent to imitate it.
    """
    early = replace(problem, runs=tuple(first_samples(run) for run in problem.runs))
    middle = start_point(early)
    try:
        at_rest, in_motion = (
            expected_evidence(*one, context) for one in ((early, middle), with_difference(early, middle, IN_MOTION))
        )
    except SimulationError:
        return None
    return 2.0 * (in_motion - at_rest)


def expected_evidence(problem: Problem, z: Vector, context: SearchContext) -> float:
    """The log evidence of a model by Laplace's method, to first order about z. Raises SimulationError."""
    parts = (normal_equations(run, robust=False) for run in linearize(problem, z, context.pool))
    cost, gradient, hessian = accumulated(parts, z, 1.0)
    return float(0.5 * (gradient @ np.linalg.solve(hessian, gradient) - np.linalg.slogdet(hessian)[1]) - cost)


def begin_in_motion(problem: Problem, context: SearchContext) -> bool:
    """Whether recordings that are taken to begin at rest are more probable in motion, by their first samples."""
    motion = motion_before(problem, context)
    return motion is not None and motion > 0.0


def first_samples(run: FitData) -> FitData:
    """A run up to the instant at which it was sampled so many times that it shows whether it rests, each channel once."""
    until = max(min(FIRST_SAMPLES, len(run.time)), int(np.argmax(run.weight > 0.0, axis=1).max()) + 1)
    rows = int(np.searchsorted(run.source.times, run.time[until - 1], side='right')) + 1
    source = Input(run.source.times[:rows], run.source.values[:rows], run.source.linear, run.source.names)
    return replace(
        run,
        time=run.time[:until],
        measured=run.measured[:, :until],
        weight=run.weight[:, :until],
        source=source,
        changed=run.changed[:0],
        interval=run.interval[:0],
        group=run.group[:0],
        leeway=None,
        correction=None,
    )
