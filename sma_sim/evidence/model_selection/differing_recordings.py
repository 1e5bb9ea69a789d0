"""What may differ between the recordings of a campaign: zeros of sensors, the ambient temperature, how late commands take
effect, what they were before they were rounded, a parameter, a wire without power.

Each recording has its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sma_sim.evidence.estimation.free_parameters import FreeParameter
from sma_sim.evidence.estimation.motion_before import motion_before
from sma_sim.evidence.estimation.problem import AMBIENT as ROOM
from sma_sim.evidence.estimation.problem import (
    POWER,
    SWITCH,
    LinearizedRun,
    Problem,
    factor_of,
    linearize,
    residuals_at,
    with_difference,
)
from sma_sim.evidence.estimation.projection import Projection
from sma_sim.evidence.estimation.recording_differences import (
    AMBIENT,
    CONVECTION,
    IN_MOTION,
    LATE_COMMANDS,
    LENGTH,
    ROUNDED_COMMANDS,
    SUPPLY,
    ZERO_PART,
    RecordingDifference,
    zeros_of,
)
from sma_sim.evidence.estimation.residuals import MAX_SWITCHES, elapsed
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.solver.effect_table import channel_scales
from sma_sim.solver.simulate import SimulationError

# What recordings may have their own unknowns of, and which these are
OWN = {AMBIENT: ROOM, LATE_COMMANDS: SWITCH, ROUNDED_COMMANDS: POWER} | {
    one: factor_of(one.parameter) for one in (CONVECTION, LENGTH, SUPPLY)
}
WITHOUT_POWER = 0.75  # part of its squares to which a run must fall without a command to be tried as one that lost it


def promises(problem: Problem, z: Vector, context: SearchContext) -> dict[RecordingDifference, float]:
    """What each difference would take from the squares at z, to first order; none where the model cannot be run there."""
    known = {difference.words for difference in problem.differences}
    motion = None if IN_MOTION.words in known else motion_before(problem, context)
    moving = {} if motion is None else {IN_MOTION: motion}
    if len(problem.runs) < 2:
        return moving
    try:
        linear = linearize(problem, z, context.pool)
    except SimulationError:
        return {}
    project = Projection(linear, len(z), problem.tempering)
    still, moved = promised_zeros(problem, project), promised_zeros(problem, project, drifting=True)
    most = max((score for _, score in still.values()), default=0.0)
    found = {one: taken for one, (taken, score) in [*still.items(), *moved.items()] if one in still or score > most}
    others = responses_in_runs(problem, z, context)
    found |= {one: gain(*project.products_of_runs(responses)) for one, responses in others.items()}
    for side in (1, -1):
        found |= unpowered_side(problem, z, linear, side, context)
    return {one: taken for one, taken in (found | moving).items() if one.words not in known}


def promised_zeros(
    problem: Problem, project: Projection, drifting: bool = False
) -> dict[RecordingDifference, tuple[float, float]]:
    """What the zeros of the channel that promises most would take from the squares, and those of all channels that promise
    to raise the score, each beside those before: who sets one sensor to zero between recordings may do so with all. With
    twice what the score promises to rise by. `drifting`: zeros that change within a recording."""
    structure = problem.config.structure
    sizes = dict(zip(structure.channels, channel_scales(structure), strict=True))
    stated = [zip(run.channels, run.drift_std if drifting else run.zero_std, strict=False) for run in problem.runs]
    known = {name for of_run in stated for name, std in of_run if std > 0.0}
    stds = {name: ZERO_PART * sizes[name] for run in problem.runs for name in run.channels if name not in known}
    if not stds:
        return {}
    responses = list[Matrix]()
    for run in problem.runs:
        still = [std * run.weight * (np.array(run.channels) == name)[:, None] for name, std in stds.items()]
        rows = [*still, *(one * elapsed(run) for one in still)] if drifting else still
        responses.append(np.reshape(rows, (len(rows), -1)))
    squares, products = project.products_of_runs(responses)
    of_channel = {name: np.arange(k, len(products), len(stds)) for k, name in enumerate(stds)}
    chosen, score, found = list[str](), 0.0, dict[RecordingDifference, tuple[float, float]]()
    while rest := [name for name in stds if name not in chosen]:
        places = {name: np.concatenate([of_channel[one] for one in (*chosen, name)]) for name in rest}
        parts = {name: (squares[np.ix_(at, at)], products[at]) for name, at in places.items()}
        better_known = {name: float(np.linalg.slogdet(part[0] + np.eye(len(part[0])))[1]) for name, part in parts.items()}
        scores = {name: gain(*part) - better_known[name] for name, part in parts.items()}  # twice those of the score
        best = max(rest, key=scores.__getitem__)
        if scores[best] <= score:
            break
        chosen, score = [*chosen, best], scores[best]
        several = zeros_of({name: std for name, std in stds.items() if name in chosen}, drifting)
        found = dict([*list(found.items())[:1], (several, (gain(*parts[best]), score))])
    return found


def responses_in_runs(problem: Problem, z: Vector, context: SearchContext) -> dict[RecordingDifference, list[Matrix]]:
    """By what each recording may have its own unknowns of (OWN), the change of each run's residuals, (unknowns, values), by
    one standard deviation of each; without those that are known, that are too many, or where the model cannot be run."""
    differing, start, kinds = problem, z, dict[RecordingDifference, FreeParameter]()
    for difference, unknown in OWN.items():
        larger, there = with_difference(differing, start, difference)
        counts = [len(larger.places(run, unknown)) for run in larger.runs]
        if difference not in problem.differences and 0 < max(counts) <= MAX_SWITCHES:
            differing, start, kinds = larger, there, {**kinds, difference: unknown}
    at = len(problem.shared)
    moving = replace(differing, config=problem.fitted(z), free=(), delay=differing.delay_at(start))
    try:
        linear = linearize(moving, start[at:], context.pool)
    except SimulationError:
        return {}
    runs = list(zip(moving.runs, linear, strict=True))
    rows = {one: [moving.places(run, unknown) for run in moving.runs] for one, unknown in kinds.items()}
    return {
        one: [
            there.jacobian[own].reshape(len(own), run.measured.size) for own, (run, there) in zip(of_one, runs, strict=True)
        ]
        for one, of_one in rows.items()
    }


def gain(squares: Matrix, products: Vector) -> float:
    """By how much the squares decrease if each of some responses has an amount, under a standard normal prior: by products
    of what is left of these with each other (m, m) and with the residuals (m,)."""
    return float(products @ np.linalg.solve(squares + np.eye(len(products)), products))


def unpowered_side(
    problem: Problem, z: Vector, linear: Sequence[LinearizedRun], side: int, context: SearchContext
) -> dict[RecordingDifference, float]:
    """That commands of one sign heat nothing in the runs that are explained better so; none where these are none, or all."""
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
        return {}
    words = f'the power of the wires that {"positive" if side > 0 else "negative"} commands heat'
    return {RecordingDifference(words, unpowered_side=side, recordings=tuple(gains)): sum(gains.values())}
