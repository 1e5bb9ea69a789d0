"""Responses of a recording to an input at a port: the change of all samples for a hat function of time at each knot.

The measured samples are averaged in bins of time, which keep everything that is slower than a bin.
"""

from __future__ import annotations

from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.executors import PickledConfig
from sma_sim.evidence.estimation.injection_points import STIFFNESS, Port
from sma_sim.evidence.estimation.residuals import FitData, Nuisance, start_of, weighted_residuals, with_switches
from sma_sim.evidence.latent_input.time_functions import KNOT_COUNT, time_function_effects
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.config import Config
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.effects.effect import Effect
from sma_sim.model.structures.structure import Structure
from sma_sim.solver.inputs import Input, input_between
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import SimulationError, simulate, uninterrupted

MIN_KNOT_SPACING = 1.0  # [s]: heat and bending take about as long
BINS_PER_KNOT = 5  # so that a hat function is resolved
KNOTS_PER_TASK = 5  # they share the simulation up to the first of them
AMBIENT_MARK = 1e-9  # [K] of ambient temperature: rows that differ make the solver begin a step at every knot


@dataclass(frozen=True)
class KnotGrid:
    """The knots (k,) [s] of a run, one `spacing` apart, and the bin of every sample (samples,), -1 for none."""

    knots: Vector
    spacing: float
    bin_of: NDArray[np.int64]
    bins: int

    @property
    def middles(self) -> Vector:
        """Middles of the bins [s]."""
        middles: Vector = self.knots[0] + (np.arange(self.bins) + 0.5) * self.spacing / BINS_PER_KNOT
        return middles


def knot_grid(run: FitData, max_spacings: int = KNOT_COUNT - 1) -> KnotGrid:
    """Knots from the first to the last sample of a run."""
    first, last = float(run.time[0]), float(run.time[-1])
    count = int(np.clip(round((last - first) / MIN_KNOT_SPACING), 4, min(max_spacings, KNOT_COUNT - 1)))
    spacing, bins = (last - first) / count, count * BINS_PER_KNOT
    knots = np.asarray(first + spacing * np.arange(count + 1), dtype=np.float64)
    bin_of = np.minimum(((run.time - first) / spacing * BINS_PER_KNOT).astype(np.int64), bins - 1)
    return KnotGrid(knots, spacing, bin_of, bins)


def binned(values: Matrix, run: FitData, grid: KnotGrid) -> Matrix:
    """Weighted residuals (channels, samples) as sums over bins over the root of their count: (channels, bins).

    White noise of variance 1 keeps it.
    """
    rows = []
    for row, weights in zip(values, run.weight, strict=True):
        count = np.bincount(grid.bin_of, weights=weights > 0.0, minlength=grid.bins)
        rows.append(np.bincount(grid.bin_of, weights=row, minlength=grid.bins) / np.sqrt(np.maximum(count, 1.0)))
    return np.array(rows)


def with_rows_at_knots(source: Input, knots: Vector) -> Input:
    """The input with a row at every knot, so that no step of the solver passes over a hat function."""
    inside = knots[(knots > source.times[0]) & (knots < source.times[-1])]
    times = np.union1d(source.times, inside)
    held = np.searchsorted(source.times, times, side='right') - 1
    values = source.values[held].copy()
    for k in np.flatnonzero(source.linear):
        values[:, k] = np.interp(times, source.times, source.values[:, k])
    values[:, -1] += AMBIENT_MARK * (np.arange(len(times)) % 2)
    return Input(times, values, source.linear, source.names)


def initialized(run: FitData, nuisance: Nuisance) -> tuple[FitData, Nuisance]:
    """The run with its switching instants fixed, and of what it has its own the delay and where it begins."""
    source, none = with_switches(run, nuisance.switches), np.zeros(0)
    run = replace(run, source=source, changed=none, interval=none, group=np.zeros(0, dtype=np.int64))
    return run, Nuisance(delay=nuisance.delay, start=nuisance.start, beginning=nuisance.beginning)


def input_effect(port: Port, grid: KnotGrid, values: Vector, structure: Structure) -> ActiveEffect:
    """The effect that acts at a port of a structure with `values` (knots,) at the knots."""
    beyond = np.full(KNOT_COUNT - len(values), values[-1])
    at = (float(grid.knots[0]), grid.spacing, float(max(port.component, 0)))
    return ActiveEffect(effect_at(port, structure), (*at, *values.tolist(), *beyond.tolist()))


def effect_at(port: Port, structure: Structure) -> Effect:
    """The effect of a port; that of a force acts in one coordinate."""
    if port.component == STIFFNESS:
        return effect_on(time_function_effects()['stiffness'], structure)
    found = effect_on(time_function_effects()[port.hook], structure)
    return found.in_scope(found.scopes[port.component]) if port.hook == 'structure_force' else found


@dataclass(frozen=True)
class RunSegment:
    """The part of a run that an input at some `knots` can affect.

    `run` begins in the state that the model has there, `affected` (samples,) tells which samples of the whole run it has,
    and `nominal` (channels, affected samples) are its weighted residuals without an input.
    """

    knots: tuple[int, ...]
    run: FitData
    affected: NDArray[np.bool_]
    nominal: Matrix


def run_segments(port: Port, config: Config, run: FitData, nuisance: Nuisance, grid: KnotGrid) -> list[RunSegment]:
    """The segments of an initialized run, each for a few knots; what precedes them is simulated once, not for every knot.

    An input of zero acts at the port, since its effect may have states.
    """
    nothing = input_effect(port, grid, np.zeros(len(grid.knots)), config.structure)
    config = config.variant(effects=(*config.effects, nothing))
    nominal, source, model = weighted_residuals(config, run, nuisance), run.source, Model(config)
    segments: list[RunSegment] = []
    begin, state = float(source.times[0]), start_of(model, source, nuisance)
    for first in range(0, len(grid.knots), KNOTS_PER_TASK):
        until = float(source.times[source.times <= max(grid.knots[max(first - 1, 0)], begin)][-1])
        if until > begin:
            before = simulate(model, input_between(source, begin, until), np.zeros(0), initial_state=state)
            state = uninterrupted(before).state
            begin = until
        affected = (run.time - nuisance.delay >= begin) | (begin == source.times[0])
        later = replace(
            run,
            time=run.time[affected],
            measured=run.measured[:, affected],
            weight=run.weight[:, affected],
            source=input_between(source, begin, float(source.times[-1])),
            initial_state=state,
        )
        knots = tuple(range(first, min(first + KNOTS_PER_TASK, len(grid.knots))))
        segments.append(RunSegment(knots, later, affected, nominal[:, affected]))
    return segments


@dataclass(frozen=True)
class KnotResponseTask:
    """A segment of a run, to be simulated with an input at each of its knots in turn; `whole`: all of that run."""

    segment: RunSegment
    whole: FitData
    grid: KnotGrid
    config: PickledConfig
    nuisance: Nuisance
    port: Port


def knot_responses(task: KnotResponseTask) -> NDArray[np.float32]:
    """Change of the binned residuals per probe, (knots, channels, bins); 0 where the model cannot be run."""
    segment, grid, config = task.segment, task.grid, task.config.config
    responses = np.zeros((len(segment.knots), len(task.whole.channels), grid.bins), dtype=np.float32)
    for k, knot in enumerate(segment.knots):
        values = task.port.probe * (np.arange(len(grid.knots)) == knot)
        effect = input_effect(task.port, grid, values, config.structure)
        try:
            residuals = weighted_residuals(config.variant(effects=(*config.effects, effect)), segment.run, task.nuisance)
        except SimulationError:
            continue
        change = np.zeros_like(task.whole.weight)
        change[:, segment.affected] = residuals - segment.nominal
        responses[k] = binned(change, task.whole, grid)
    return responses


def time_function_at(grid: KnotGrid, values: Vector, time: Vector) -> Vector:
    """The function through values (knots,) at times (k,) [s], as `time_function` has it."""
    at = np.clip((time - grid.knots[0]) / grid.spacing, 0.0, len(values) - 1.000001)
    k = at.astype(np.int64)
    part = np.sin(0.5 * np.pi * (at - k)) ** 2
    interpolation: Vector = values[k] * (1.0 - part) + values[k + 1] * part
    return interpolation


def sensor_responses(port: Port, run: FitData, grid: KnotGrid, delay: float) -> NDArray[np.float32]:
    """Change of the binned residuals per probe by an offset of what a channel shows, (knots, channels, bins)."""
    responses = np.zeros((len(grid.knots), len(run.channels), grid.bins), dtype=np.float32)
    row = run.channels.index(port.variable)
    change = np.zeros_like(run.weight)
    for k, values in enumerate(port.probe * np.eye(len(grid.knots))):
        change[row] = time_function_at(grid, values, run.time - delay) * run.weight[row]
        responses[k] = binned(change, run, grid)
    return responses


def submit_responses(
    port: Port, run: FitData, grid: KnotGrid, config: Config, nuisance: Nuisance, pool: Executor
) -> list[Future[NDArray[np.float32]]]:
    """Start the simulations of one port on one initialized run."""
    segments, pickled = run_segments(port, config, run, nuisance, grid), PickledConfig(config)
    return [
        pool.submit(knot_responses, KnotResponseTask(segment, run, grid, pickled, nuisance, port)) for segment in segments
    ]
