"""Runs with the derivatives of their samples in unknowns: the Python interface of `solver.tangents`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.compiler.compile import is_interpreted, package_compiler
from sma_sim.compiler.pinned_systems import PinnedSystems, pin_system, pinned_systems
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.effects.ports import SENSING
from sma_sim.model.layout import System
from sma_sim.solver.clock import held_until, seen_at
from sma_sim.solver.columns import sampled_numbers
from sma_sim.solver.effect_table import own_scratch
from sma_sim.solver.end_of_run import stop_reason
from sma_sim.solver.inputs import Input, requested_times, segments
from sma_sim.solver.integrate import InputStretches, Limits, Run
from sma_sim.solver.model import Model, new_findings
from sma_sim.solver.simulate import Trajectory, copy_of_run, new_log, new_work, stall_step, trajectory
from sma_sim.solver.smoothed_input import Leeway, Moved, Shifts, Stretches, smoothed, system_under, under_lines
from sma_sim.solver.stepper import STAGES
from sma_sim.solver.tangent_nodes import Tangents
from sma_sim.solver.tangents import follow

TOGETHER = 8  # unknowns that vector instructions serve at once: the last ones of a run may be none
DELTA = 1e-6  # by which an unknown is moved
NODES = 3  # of a step, at which it is linearised
PACE_STEP = 1e-3  # [s], for the pace of a clock


@dataclass(frozen=True)
class Neighbour:
    """A run in which one unknown is moved: what differs from the run itself, None for what does not.

    `source` has the same rows, which may be at other times and have other values.
    """

    model: Model | None = None
    initial_state: Run | None = None
    source: Input | None = None


@dataclass(frozen=True)
class Sensitivities:
    """A run and its derivatives.

    Attributes
    ----------
    trajectory : Trajectory
        The run, with the channels that were asked for.
    tangents : array (unknowns, channels, k)
        Derivatives of the samples in the unknowns.
    slopes : array (channels, k)
        Derivatives of the samples in time [1/s].
    smoothed : bool
        Whether rows of the input were taken together: else the run is, to the last bit, the one that `simulate` makes.
    """

    trajectory: Trajectory
    tangents: NDArray[np.float64]
    slopes: Matrix
    smoothed: bool = False


def padded(count: int) -> int:
    """Columns for so many unknowns."""
    return -(-count // TOGETHER) * TOGETHER


def direct_states(model: Model, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """For each channel (c,) the state that its sensor shows as it is, -1 where it shows something else."""
    p = model.compiled
    n, wires, e = p.coordinates, p.wires, p.effects
    first = {k: k for k in range(n)}
    if p.imposed_T < 0:  # else temperatures are no channels
        first |= {n + wires + i: p.first_T + i for i in range(wires)}
    sensed = e.slot[e.port_start[SENSING] : e.port_start[SENSING + 1]]
    return np.array([-1 if (sensed[:, c] >= 0).any() else first.get(c, -1) for c in numbers.tolist()], dtype=np.int64)


def timed_channels(model: Model, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """For each channel (c,) 1 where an effect on its sensor depends on time itself, else 0."""
    e = model.compiled.effects
    sensing = slice(e.port_start[SENSING], e.port_start[SENSING + 1])
    timed = (e.slot[sensing][:, numbers] >= 0) & (e.depends_on_t[sensing, None] != 0)
    return np.asarray(timed.any(axis=0), dtype=np.int64)


def shifts_of_rows(source: Input, neighbours: Sequence[Neighbour], delta: float) -> Shifts | None:
    """Derivatives of the stretches of an input in unknowns; None where neighbours have other rows."""
    (times, values, slopes), count = segments(source), padded(len(neighbours))
    row_shift, changed = np.zeros((len(times), count)), dict[int, Matrix]()
    for j, neighbour in enumerate(neighbours):
        if neighbour.source is not None:
            there, own, inclined = segments(neighbour.source)
            if own.shape != values.shape or not np.allclose(own, values, rtol=1e-4, atol=1e-9):
                return None
            row_shift[:, j] = (there - times) / delta
            change = np.array([own - values - slopes * (there - times)[:, None], inclined - slopes])  # at the same time
            changed |= {j: change / delta} if change.any() else {}
    shifts = np.zeros((2, len(times) if changed else 0, count, values.shape[1]))
    for j, change in changed.items():
        shifts[:, :, j] = change
    return Shifts(row_shift, *shifts)


def differences_of_starts(run: Run, neighbours: Sequence[Neighbour], delta: float) -> tuple[Matrix, Matrix]:
    """Tangents of the first state (n, P) and of the frozen fractions (wires, P)."""
    s, r = (np.zeros((len(own), padded(len(neighbours)))) for own in (run.state.y, run.state.mode))
    for j, neighbour in enumerate(neighbours):
        if neighbour.initial_state is not None:
            moved = neighbour.initial_state.state
            s[:, j] = (moved.y - run.state.y) / delta
            r[:, j] = (moved.x_frozen - run.state.x_frozen) / delta
    return s, r


def pinned(systems: Sequence[System]) -> PinnedSystems:
    """The equations of all neighbours behind addresses."""
    keep = package_compiler().function(pin_system)
    return pinned_systems([own_scratch(one) for one in systems], keep, is_interpreted())


def new_tangents(model: Model, run: Run, sizes: tuple[int, int, int], **given: Any) -> Tangents:
    """Room for the tangents of a run; `sizes` are those of channels, unknowns and samples."""
    c, k = sizes[0], sizes[2]
    count = padded(sizes[1])
    n, wires = len(run.state.y), len(run.state.mode)
    obs = new_findings(model.compiled)
    return Tangents(
        shift=np.zeros(count),
        y=np.zeros((NODES, n)),
        dy=np.zeros((NODES, n)),
        obs=np.zeros((NODES, *obs.shape)),
        shown=np.zeros((NODES, c)),
        by_state=np.zeros((NODES, n + c, n + wires)),
        by_unknown=np.zeros((NODES, n + c, count)),
        sensed=np.zeros((NODES, c, count)),
        slope=np.zeros((n, count)),
        matrix=np.zeros((n, n + wires)),
        stage=np.zeros((n, count)),
        stages=np.zeros((STAGES, n, count)),
        rhs=np.zeros((n, count)),
        new=np.zeros((n, count)),
        dense=np.zeros((2, n, count)),
        mode=np.zeros(wires, dtype=np.int64),
        x_frozen=np.zeros(wires),
        moved=np.zeros(n),
        moved_x=np.zeros(wires),
        row=np.zeros(1, dtype=np.int64),
        samples=np.zeros((k, c, count)),
        slopes=np.zeros((k, c)),
        **given,
    )


def simulate_with_tangents(
    model: Model,
    source: Input,
    sample_times: Vector | float,
    initial_state: Run,
    channels: Sequence[str],
    neighbours: Sequence[Neighbour],
    max_steps: int = 10_000_000,
    leeway: Leeway | None = None,
) -> Sensitivities | None:
    """Run a model under an input, with the derivatives of its samples in unknowns.

    Parameters
    ----------
    model, source, sample_times, initial_state, channels, max_steps
        As for `simulate`; the state and the channels must be given. Samples may be later than the input, whose last values
        are held.
    neighbours : sequence of Neighbour
        For each unknown what changes when it is moved by DELTA, which is so small that this leaves errors of 1e-6 in units
        of its usual size.
    leeway : Leeway, optional
        How far the input may be smoothed, in place of what the tolerance of the model allows.

    Returns
    -------
    Sensitivities
        None where a neighbour's input has other rows, or the input only one, so that there is no derivative.
    """
    shifts, (times, values, slopes) = shifts_of_rows(source, neighbours, DELTA), segments(source)
    if shifts is None or len(times) < 2:
        return None
    run, begin = copy_of_run(model, initial_state), float(source.times[0])
    asked = requested_times(source, sample_times) if isinstance(sample_times, float) else sample_times
    seen = seen_at(model, asked, begin)
    numbers, work = sampled_numbers(channels, model.structure), new_work(model)
    beside = {j: one.model for j, one in enumerate(neighbours) if one.model is not None}
    lines = smoothed(model, source, float(seen[-1]), leeway, shifts, Moved(beside, DELTA))
    is_smoothed = lines is not None
    if lines is not None:
        stretches = under_lines(lines)
        row_shift = np.zeros((len(lines.times), shifts.times.shape[1]))
        work = work._replace(u=np.zeros(lines.values.shape[1]))
    else:
        times, values, slopes = held_until((times, values, slopes), seen)
        shifts = shifts.held_until(len(times))
        stretches = InputStretches(times, values, slopes, model.uses_time)
        row_shift, lines = shifts.times, Stretches(times, values, slopes, shifts.values, shifts.slopes)
    p, *others = [one.compiled for one in (model, *(one.model or model for one in neighbours))]
    if is_smoothed:
        p, *others = [system_under(lines, one) for one in (p, *others)]
    records = pinned(others)
    s, r = differences_of_starts(run, neighbours, DELTA)
    tangents = new_tangents(
        model,
        run,
        (len(numbers), len(neighbours), len(seen)),
        numbers=numbers,
        direct=direct_states(model, numbers),
        timed=timed_channels(model, numbers),
        systems=records.addresses,
        delta=DELTA,
        row_shift=row_shift,
        value_shift=lines.value_shifts,
        slope_shift=lines.slope_shifts,
        moved_u=np.zeros_like(work.u),
        moved_du=np.zeros_like(work.u),
        s=s,
        r=r,
    )
    log = new_log(model, seen, numbers)
    limits = Limits(np.inf, max_steps, stall_step(model))
    status = package_compiler().function(follow)(stretches, run, own_scratch(p), work, limits, log, tangents)
    made = trajectory(model, log, asked, run, stop_reason(status, model, run), ())
    count = len(made.time)
    found, slopes = tangents.samples[:count, :, : len(neighbours)].transpose(2, 1, 0), tangents.slopes[:count].T
    for j, neighbour in enumerate(neighbours):
        later = (seen_at(neighbour.model or model, asked, begin) - seen)[:count] / DELTA
        if later.any():
            found[j] += later * slopes
    if not np.array_equal(seen, asked):
        slopes = slopes * ((seen_at(model, asked + PACE_STEP, begin) - seen) / PACE_STEP)[:count]
    return Sensitivities(made, found, slopes, is_smoothed)
