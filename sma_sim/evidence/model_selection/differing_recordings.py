"""What may differ between the recordings of a campaign: a zero of a sensor, the ambient temperature, a wire without power.

Each recording has its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.problem import AMBIENT as ROOM
from sma_sim.evidence.estimation.problem import (
    AMBIENT_STEP,
    LinearizedRun,
    Problem,
    linearize,
    residuals_at,
    start_point,
    with_own_unknowns,
)
from sma_sim.evidence.estimation.recording_differences import ZERO_PART, RecordingDifference
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.score_tests import Projection
from sma_sim.model.arrays import Vector
from sma_sim.solver.effect_table import channel_scales
from sma_sim.solver.inputs import Input
from sma_sim.solver.simulate import SimulationError

AMBIENT = RecordingDifference('the ambient temperature', ambient=True)
IN_MOTION = RecordingDifference('how warm its wires are when it begins', in_motion=True)
FIRST_SAMPLES = 10  # of a recording: a robot that cools moves in them, and one at rest is hardly heated yet
WITHOUT_POWER = 0.75  # part of its squares to which a run must fall without a command to be tried as one that lost it


@dataclass(frozen=True)
class Promise:
    """A difference, and by how much it would lower the squares at some point of the model without it."""

    difference: RecordingDifference
    gain: float


def with_difference(problem: Problem, z: Vector, difference: RecordingDifference) -> tuple[Problem, Vector]:
    """The problem whose recordings differ in one thing more, and z with its unknowns at 0."""
    runs = tuple(difference.in_run(run) for run in problem.runs)
    differing = replace(problem, runs=runs, differences=(*problem.differences, difference))
    return differing, with_own_unknowns(problem, z, differing)


def promises(problem: Problem, z: Vector, context: SearchContext) -> list[Promise]:
    """What each difference would take away at z, to first order; none where the model cannot be run there."""
    try:
        linear = linearize(problem, z, context.pool)
    except SimulationError:
        return []
    known = {difference.words for difference in problem.differences}
    moving = None if IN_MOTION.words in known else motion_before(problem, context)
    if len(problem.runs) < 2:
        return [] if moving is None else [moving]
    project = Projection(linear, len(z), problem.tempering)
    found = [
        Promise(difference, gain(responses, linear, project))
        for difference, responses in responses_at(problem, z, linear, context)
    ]
    lost = [unpowered_side(problem, z, linear, side, context) for side in (1, -1)]
    return [one for one in (*found, *lost, moving) if one is not None and one.difference.words not in known]


def responses_at(
    problem: Problem, z: Vector, linear: Sequence[LinearizedRun], context: SearchContext
) -> list[tuple[RecordingDifference, list[NDArray[np.float64]]]]:
    """By difference, the change of each run's residuals (channels, k) by one standard deviation of its prior."""
    structure = problem.config.structure.structure
    sizes = dict(zip(structure.channels, channel_scales(structure), strict=True))
    found = []
    for name in dict.fromkeys(name for run in problem.runs for name in run.channels):
        zero = RecordingDifference(f'the zero of {name}', channel=name, std=ZERO_PART * sizes[name])
        rows = [np.array([[channel == name] for channel in run.channels]) for run in problem.runs]
        found.append((zero, [row * zero.std * run.weight for row, run in zip(rows, problem.runs, strict=True)]))
    differing, start = with_difference(problem, z, AMBIENT)
    if not problem.differences:
        for own, run in zip(differing.indices(), differing.runs, strict=True):
            start[own[differing.places(run, ROOM)]] = AMBIENT_STEP
        moved = residuals_at(differing, start, context.pool)
        pairs = zip(moved, linear, strict=True)
        changes = [(there - run.residuals) / AMBIENT_STEP for there, run in pairs if there is not None]
        found += [(AMBIENT, changes)] if len(changes) == len(linear) else []
    return found


def motion_before(problem: Problem, context: SearchContext) -> Promise | None:
    """What it takes away if the recordings begin in motion: how little the model can begin like them at rest, whatever its
    parameters; None where it cannot be run.

    That is twice the log Bayes factor of their first samples, about those of the model in the middle of its priors, to first
    order: beside noise and all that is unknown at rest stands what may be left of a motion. Where recordings begin at rest
    it is negative. Where a fit has ended that lacks it, parameters are bent to imitate it.
    """
    early = replace(problem, runs=tuple(first_samples(run) for run in problem.runs))
    middle = start_point(early)
    moving, z = with_difference(early, middle, IN_MOTION)
    try:
        pairs = list(zip(linearize(early, middle, context.pool), linearize(moving, z, context.pool), strict=True))
    except SimulationError:
        return None
    at_rest, left = responses_of([one for one, _ in pairs], len(middle))
    with_motion, _ = responses_of([one for _, one in pairs], len(z))
    known = map(len, map(early.own, early.runs))
    new = np.concatenate([at[len(early.shared) + count :] for at, count in zip(moving.indices(), known, strict=True)])
    rest = np.eye(len(left)) + at_rest @ at_rest.T
    both = rest + with_motion[:, new] @ with_motion[:, new].T
    explained = left @ (np.linalg.solve(rest, left) - np.linalg.solve(both, left))
    return Promise(IN_MOTION, float(explained - np.linalg.slogdet(both)[1] + np.linalg.slogdet(rest)[1]))


def begin_in_motion(problem: Problem, context: SearchContext) -> bool:
    """Whether recordings that are taken to begin at rest are more probable in motion, by their first samples."""
    motion = motion_before(problem, context)
    return motion is not None and motion.gain > 0.0


def responses_of(linear: Sequence[LinearizedRun], unknowns: int) -> tuple[NDArray[np.float64], Vector]:
    """The derivatives (samples, unknowns) of the residuals of all runs, and these (samples,)."""
    rows = [np.zeros((run.residuals.size, unknowns)) for run in linear]
    for row, run in zip(rows, linear, strict=True):
        row[:, run.indices] = run.jacobian.reshape(len(run.indices), -1).T
    return np.concatenate(rows), np.concatenate([run.residuals.ravel() for run in linear])


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


def gain(responses: Sequence[NDArray[np.float64]], linear: Sequence[LinearizedRun], project: Projection) -> float:
    """By how much the squares decrease if each run has its own amount of its response, under a standard normal prior."""
    sizes = [run.residuals.size for run in linear]
    residuals = np.concatenate([run.residuals.ravel() for run in linear])
    columns = np.zeros((len(responses), len(residuals)))
    for column, response, end, size in zip(columns, responses, np.cumsum(sizes), sizes, strict=True):
        column[end - size : end] = response.ravel()
    columns = np.array([project(column) for column in columns])
    score = columns @ residuals
    return float(score @ np.linalg.solve(columns @ columns.T + np.eye(len(columns)), score))


def unpowered_side(
    problem: Problem, z: Vector, linear: Sequence[LinearizedRun], side: int, context: SearchContext
) -> Promise | None:
    """The runs that are explained better if commands of one sign heat nothing; None where these are none, or all."""
    everywhere = replace(problem, runs=tuple(replace(run, unpowered_side=side) for run in problem.runs))
    shown = residuals_at(everywhere, z, context.pool)
    before = [float(np.vdot(run.residuals, run.residuals)) for run in linear]
    after = [np.inf if residuals is None else float(np.vdot(residuals, residuals)) for residuals in shown]
    gains = {
        run.name: a - b
        for run, a, b in zip(problem.runs, before, after, strict=True)
        if not run.unpowered_side and b < WITHOUT_POWER * a
    }
    if not 0 < len(gains) < len(problem.runs):
        return None
    words = f'the power of the wires that {"positive" if side > 0 else "negative"} commands heat'
    lost = RecordingDifference(words, unpowered_side=side, recordings=tuple(gains))
    return Promise(lost, sum(gains.values()))
