"""What a recording would show if something acted at a port: the response of all samples to a hat of time at each knot.

The measured samples are taken together in bins of time, whose means keep all that is slower than a bin.
"""

from __future__ import annotations

from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.executors import PickledConfig
from sma_sim.evidence.estimation.injection_points import Port
from sma_sim.evidence.estimation.residuals import FitData, Nuisance, started, weighted_residuals, with_switches
from sma_sim.model.config import Config
from sma_sim.model.effects.discovery import ActiveEffect, FoundEffect, find_effects
from sma_sim.model.effects.ports import CHANNELS
from sma_sim.solver.inputs import Input, between
from sma_sim.solver.simulate import Model, SimulationError, simulate

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
COURSES = Path(__file__).parent / 'time_functions'
NAMES = {
    'structure_force': 'latent_force', 'wire_heat': 'latent_heat', 'wire_strain': 'latent_strain',
    'transformation_stress': 'latent_stress', 'actuation': 'latent_power',
}  # fmt: skip
MOST_KNOTS, LEAST_SPACING = 101, 1.0  # per run, as in courses/course.py; [s]
BINS_PER_KNOT = 5
KNOTS_AT_ONCE = 5  # of one task
MARK = 1e-9  # [K] of ambient temperature: rows that differ make the solver begin a step at every knot


@dataclass(frozen=True)
class Grid:
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


@cache
def courses() -> dict[str, FoundEffect]:
    """The effects with a given time course, by the port of effects on which they act."""
    found = find_effects([COURSES])
    return {hook: found[name] for hook, name in NAMES.items()}


def grid_of(run: FitData, most: int = MOST_KNOTS - 1) -> Grid:
    """Knots from the first to the last sample of a run, with `most` spacings at the most."""
    first, last = float(run.time[0]), float(run.time[-1])
    count = int(np.clip(round((last - first) / LEAST_SPACING), 4, min(most, MOST_KNOTS - 1)))
    spacing, bins = (last - first) / count, count * BINS_PER_KNOT
    knots = np.asarray(first + spacing * np.arange(count + 1), dtype=np.float64)
    at = np.minimum(((run.time - first) / spacing * BINS_PER_KNOT).astype(np.int64), bins - 1)
    return Grid(knots, spacing, at, bins)


def binned(values: Matrix, run: FitData, grid: Grid) -> Matrix:
    """Weighted residuals (channels, samples) as sums over bins over the root of their count: (channels, bins).

    White noise of variance 1 keeps it.
    """
    rows = []
    for row, weights in zip(values, run.weight, strict=True):
        count = np.bincount(grid.bin_of, weights=weights > 0.0, minlength=grid.bins)
        rows.append(np.bincount(grid.bin_of, weights=row, minlength=grid.bins) / np.sqrt(np.maximum(count, 1.0)))
    return np.array(rows)


def marked(source: Input, knots: Vector) -> Input:
    """The input with a row at every knot, so that no step of the solver passes over a hat."""
    inside = knots[(knots > source.times[0]) & (knots < source.times[-1])]
    times = np.union1d(source.times, inside)
    held = np.searchsorted(source.times, times, side='right') - 1
    values = source.values[held].copy()
    for k in np.flatnonzero(source.linear):
        values[:, k] = np.interp(times, source.times, source.values[:, k])
    values[:, -1] += MARK * (np.arange(len(times)) % 2)
    return Input(times, values, source.linear)


def ready(config: Config, run: FitData, nuisance: Nuisance) -> tuple[Config, FitData, Nuisance]:
    """The run with its start in the configuration and its commands where they were."""
    source = with_switches(run, nuisance.switches)
    initial_state = started(config, source, nuisance.start)
    none = np.zeros(0)
    plain = replace(run, source=source, changed=none, interval=none, group=np.zeros(0, dtype=np.int64))
    return initial_state, plain, Nuisance(delay=nuisance.delay)


def acting(port: Port, grid: Grid, course: Vector) -> ActiveEffect:
    """The effect that acts at a port with values (knots,) at the knots."""
    beyond = np.full(MOST_KNOTS - len(course), course[-1])
    return ActiveEffect(
        courses()[port.hook],
        (float(grid.knots[0]), grid.spacing, float(port.component), *course.tolist(), *beyond.tolist()),
    )


@dataclass(frozen=True)
class Part:
    """What of a run may feel a knock at some `knots`.

    `run` begins in the state that the model has there, `late` (samples,) tells which samples of the whole run it has, and
    `base` (channels, those) are its weighted residuals without a knock.
    """

    knots: tuple[int, ...]
    run: FitData
    late: NDArray[np.bool_]
    base: Matrix


def parts_of(port: Port, config: Config, run: FitData, nuisance: Nuisance, grid: Grid) -> list[Part]:
    """The parts of a (ready) run, each for a few knots; what lies before them is simulated once, not for every knot.

    A course that is zero acts at the port, for its effect may have states.
    """
    config = replace(config, effects=(*config.effects, acting(port, grid, np.zeros(len(grid.knots)))))
    base, source = weighted_residuals(config, run, nuisance), run.source
    found: list[Part] = []
    at, state = float(source.times[0]), None
    for first in range(0, len(grid.knots), KNOTS_AT_ONCE):
        until = float(source.times[source.times <= max(grid.knots[max(first - 1, 0)], at)][-1])
        if until > at:
            state = simulate(Model(config), between(source, at, until), np.zeros(0), initial_state=state).state
            at = until
        late = (run.time - nuisance.delay >= at) | (state is None)
        later = replace(
            run, time=run.time[late], measured=run.measured[:, late], weight=run.weight[:, late],
            source=between(source, at, float(source.times[-1])), initial_state=state,
        )  # fmt: skip
        knots = tuple(range(first, min(first + KNOTS_AT_ONCE, len(grid.knots))))
        found.append(Part(knots, later, late, base[:, late]))
    return found


@dataclass(frozen=True)
class KnotResponses:
    """A part of a run that is to be knocked through a port at each of its knots in turn; `whole`: all of that run."""

    part: Part
    whole: FitData
    grid: Grid
    parcel: PickledConfig
    nuisance: Nuisance
    port: Port


def knot_response(task: KnotResponses) -> NDArray[np.float32]:
    """Change of the binned residuals per probe, (knots, channels, bins); 0 where the model cannot be run."""
    part, grid, config = task.part, task.grid, task.parcel.config
    found = np.zeros((len(part.knots), len(task.whole.channels), grid.bins), dtype=np.float32)
    for k, knot in enumerate(part.knots):
        active = acting(task.port, grid, task.port.probe * (np.arange(len(grid.knots)) == knot))
        try:
            shown = weighted_residuals(replace(config, effects=(*config.effects, active)), part.run, task.nuisance)
        except SimulationError:
            continue
        change = np.zeros_like(task.whole.weight)
        change[:, part.late] = shown - part.base
        found[k] = binned(change, task.whole, grid)
    return found


def course_at(grid: Grid, values: Vector, time: Vector) -> Vector:
    """The course through values (knots,) at times (k,) [s], as courses/course.py has it."""
    at = np.clip((time - grid.knots[0]) / grid.spacing, 0.0, len(values) - 1.000001)
    k = at.astype(np.int64)
    part = np.sin(0.5 * np.pi * (at - k)) ** 2
    found: Vector = values[k] * (1.0 - part) + values[k + 1] * part
    return found


def sensed(port: Port, run: FitData, grid: Grid, delay: float) -> NDArray[np.float32]:
    """Change of the binned residuals per probe by an offset of what a channel shows, (knots, channels, bins)."""
    found = np.zeros((len(grid.knots), len(run.channels), grid.bins), dtype=np.float32)
    row = run.channels.index(CHANNELS[port.component])
    shown = np.zeros_like(run.weight)
    for k, values in enumerate(port.probe * np.eye(len(grid.knots))):
        shown[row] = course_at(grid, values, run.time - delay) * run.weight[row]
        found[k] = binned(shown, run, grid)
    return found


def submitted(
    port: Port, run: FitData, grid: Grid, config: Config, nuisance: Nuisance, pool: Executor
) -> list[Future[NDArray[np.float32]]]:
    """The work of one port on one (ready) run, dealt out."""
    parts, parcel = parts_of(port, config, run, nuisance, grid), PickledConfig(config)
    return [pool.submit(knot_response, KnotResponses(part, run, grid, parcel, nuisance, port)) for part in parts]
