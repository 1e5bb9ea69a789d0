"""One recording linearised by the tangents of its run (solver.tangents) in place of differences of runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import GAIN
from sma_sim.evidence.estimation.executors import PickledConfig
from sma_sim.evidence.estimation.residuals import (
    FitData,
    Nuisance,
    compared,
    planned_run,
    slopes_of_readings,
    smoothed_residuals,
    start_of,
    step_limit,
    weighted_residuals,
)
from sma_sim.model.arrays import Matrix
from sma_sim.model.config import Config
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.structures.structure import Structure
from sma_sim.solver.beginning import Beginning
from sma_sim.solver.inputs import Input
from sma_sim.solver.integrate import Run
from sma_sim.solver.model import Model
from sma_sim.solver.sensitivities import DELTA, Neighbour, Sensitivities, simulate_with_tangents
from sma_sim.solver.simulate import SimulationError, new_run, new_work
from sma_sim.solver.work import Work

# Of solver.rtol, in the runs that give tangents, unless they are a search's, which has them already: tangents keep 3 digits,
# where a difference of two such runs would be noise.
LOOSER = {'hybrid': 10.0, 'mas': 3.0}
ROWS = 4096  # of derivatives that are turned about at once
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class TangentTask:
    """One run to linearise: the point, the same with each unknown in turn moved by DELTA, and which unknown is the delay.

    `delay` is -1 where that is known; `delay_scale` [s] is that of its unknown. `still`: unknowns that cannot move. `apart`:
    unknowns whose derivatives are differences of runs, by how much each is moved, and the point there.
    """

    run: FitData
    point: tuple[PickledConfig, Nuisance]
    moved: tuple[tuple[PickledConfig, Nuisance], ...]
    delay: int
    delay_scale: float
    still: tuple[int, ...]
    apart: tuple[tuple[int, float, PickledConfig, Nuisance], ...] = ()


def tangents_apply(config: Config, run: FitData) -> bool:
    """Whether a run has tangents: as its structure says, or at a set stress and temperature where it transforms gradually.

    A sharp transformation passes samples one by one there, between which no tangent sees it move, and differences do.
    """
    structure = run.on_bench(config).structure
    return has_tangents(structure) or (structure.is_quasi_static and any(map(is_gradual, config.effects)))


def is_gradual(active: ActiveEffect) -> bool:
    """Whether an effect spreads the transformation, with the values that it has."""
    effect = active.effect
    return effect.gradual and any(
        value != p.neutral for p, value in zip(effect.parameters, active.values, strict=True) if p.neutral is not None
    )


def has_tangents(structure: Structure) -> bool:
    """Whether all runs of a structure have tangents: not those of segments in series, nor of tests without time."""
    return structure.segment is None and not structure.is_quasi_static


def linearized_by_tangents(task: TangentTask) -> tuple[Matrix, NDArray[np.float64], Matrix | None] | None:
    """Weighted residuals (channels, k), their derivatives (unknowns, channels, k), and what the former are more than those
    under the smoothed command (channels, k), None where none is smoothed.

    None where there are no derivatives, or where the model cannot be run there.
    """
    run, (config, nuisance) = task.run, task.point
    try:
        found = sensitivities_of(task)
        if found is None or not found.trajectory.completed:
            return None
        index = planned_run(run, nuisance)[2]
        shown = np.array([found.trajectory[run.columns[name]] for name in run.channels])[:, index]
        as_exact, model = looser(run, config.config) == 1.0, config.model(run.bench, factors=nuisance.factors)
        here = compared(run, shown, nuisance) if as_exact else smoothed_residuals(model, run, nuisance)
        is_the_run = as_exact and not found.smoothed
        if here is not None and is_the_run:
            residuals = here
        elif here is not None and run.correction is not None:
            residuals = here + run.correction
        else:
            residuals = weighted_residuals(model, run, nuisance)
        correction = None if is_the_run or here is None else residuals - here
        nearby = replace(run, correction=correction)
        beside = {
            j: (weighted_residuals(moved.model(run.bench, factors=there.factors), nearby, there) - residuals) / step
            for j, step, moved, there in task.apart
        }
    except SimulationError:
        return None
    tangents = np.empty((*found.tangents.shape[:2], len(index)))
    for first in range(0, len(index), ROWS):  # which lie together otherwise, those of two hours in half of all memory
        tangents[:, :, first : first + ROWS] = found.tangents[:, :, index[first : first + ROWS]]
    if task.delay >= 0:
        tangents[task.delay] = -task.delay_scale * found.slopes[:, index] * (index > 0)
    tangents[list(task.still)] = 0.0
    del found
    jacobian = derivatives(run, nuisance, shown, tangents)
    for j, column in beside.items():
        jacobian[j] = column
    steepest = max(float(jacobian.max(initial=0.0)), -float(jacobian.min(initial=0.0)))
    if not (np.isfinite(float(np.vdot(residuals, residuals))) and steepest * EPS < 1.0):
        return None  # as good as a jump: the smallest step that a number can make would change the residuals by their noise
    return residuals, jacobian, correction


def sensitivities_of(task: TangentTask) -> Sensitivities | None:
    """The run with the tangents of all unknowns."""
    run, (pickled, nuisance) = task.run, task.point
    source, asked, _ = planned_run(run, nuisance)
    model = pickled.model(run.bench, looser(run, pickled.config), nuisance.factors)
    work = new_work(model)
    initial_state = run.initial_state or started(model, source, nuisance, work)
    neighbours = []
    for other, moved in task.moved:
        is_same = other is pickled and factors_of_robot(moved) == factors_of_robot(nuisance)
        beside = None if is_same else other.model(run.bench, looser(run, other.config), moved.factors)
        other_source = (
            planned_run(run, replace(moved, delay=nuisance.delay))[0] if input_of(moved) != input_of(nuisance) else None
        )
        begins_alike = beside is None and initial_conditions(moved) == initial_conditions(nuisance)
        begins_alike &= other_source is None or np.array_equal(other_source.values[0], source.values[0])
        initial_run = None
        if run.initial_state is None and not begins_alike:
            initial_run = started(beside or model, other_source or source, moved, work)
        neighbours.append(Neighbour(beside, initial_run, other_source))
    return simulate_with_tangents(
        model,
        source,
        asked,
        initial_state,
        run.channels,
        neighbours,
        step_limit(source, run.step_limited, samples=len(run.time)),
        run.leeway,
    )


def factors_of_robot(nuisance: Nuisance) -> list[tuple[str, float]]:
    """What of a nuisance makes the robot another one."""
    return [one for one in nuisance.factors if one[0] != GAIN]


def input_of(nuisance: Nuisance) -> tuple[object, ...]:
    """What of a nuisance says what a run was given."""
    return nuisance.switches, nuisance.powers, nuisance.ambient, dict(nuisance.factors).get(GAIN)


def initial_conditions(nuisance: Nuisance) -> tuple[tuple[float, ...], Beginning]:
    """What of a nuisance says where a run begins."""
    return nuisance.start, nuisance.beginning


def started(model: Model, source: Input, nuisance: Nuisance, work: Work) -> Run:
    """Where a run begins."""
    initial_run = start_of(model, source, nuisance, work)
    return initial_run or new_run(model, np.asarray(source.values[0], float), work)


def looser(run: FitData, config: Config) -> float:
    """By how much the tolerance of a run is looser where it gives tangents."""
    return 1.0 if run.step_limited else LOOSER[config.simulated_kinetics]


def derivatives(run: FitData, nuisance: Nuisance, shown: Matrix, tangents: NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivatives of weighted residuals from those of what is shown, in their place: the baseline of a recording moves with
    that."""
    if not (run.zero_std or nuisance.unknown_zero):
        tangents *= run.weight * slopes_of_readings(run, shown) if run.rounding else run.weight
        return tangents
    here = compared(run, shown, nuisance)
    sides: Sequence[Matrix] = [(compared(run, shown + DELTA * one, nuisance) - here) / DELTA for one in tangents]
    return np.array(sides)
