"""Integration over the input: steps, jumps, samples, and a reason for every end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sma_sim.model.automaton import observed_mode
from sma_sim.model.layout import O_DL, O_DX, O_F, O_J, O_LENGTH, O_SIGMA, O_V, O_X, System
from sma_sim.model.system import sensed_channel
from sma_sim.solver.events import crossing, jump, remember_fraction, violated_edge
from sma_sim.solver.stepper import (
    ORDER,
    Integers,
    Matrix,
    Segment,
    Vector,
    Work,
    dense,
    flow_at,
    linearize,
    prepare_dense,
    rosenbrock_step,
)  # fmt: skip

COMPLETED, STEP_LIMIT, STEP_UNDERFLOW, NOT_FINITE, RATE_NOT_FINITE = range(5)
REASONS = (
    'end of the input',
    'step limit reached',
    'step size underflow: the equations are too stiff or singular here',
    'a state is no longer finite',
    'a rate is not a finite number here: look at the effects and the parameters',
)
RESTING_RATE = 1e-5  # |dx_M/dt| [1/s] below which a MAS wire is seen as resting

# Columns of a sample.
Y_POSE, Y_RATE, Y_WIRE, Y_SENSED, Y_TAU, SAMPLE_SIZE = 0, 3, 6, 26, 35, 38
WIRE_COLUMNS = ('T', 'x_M', 'F', 'length', 'v', 'sigma', 'dx_M', 'mode', 'J', 'd2')
PER_WIRE = 10

# Counters and controls of a run.
N_STEPS, N_REJECTED, N_FLOWS, N_JUMPS, N_CHATTER, N_SIZE = range(6)
C_H, C_LAST_JUMP, C_BURST, C_DWELL, C_SIZE = 0, 1, 3, 5, 7


class Run(NamedTuple):
    """The state of a run; all arrays are changed in place, so that a run can be continued."""

    y: Vector
    mode: Integers
    x_frozen: Vector
    control: Vector  # step size, per wire: time of the last jump, recent jumps, dwell
    count: Integers


class Limits(NamedTuple):
    """What bounds a run."""

    max_step: float
    max_steps: int


LONG_STEP = 2e-3  # [s]; longer steps are looked at in their middle too
AFTER_JUMP = 4e-3  # first step tried after a jump or a change of the input [s]
MIN_STEP = 1e-12  # relative to the time passed, plus this many seconds
BURST, BURST_WINDOW, FIRST_DWELL = 16, 1e-3, 1e-5


def jump_now(t: float, run: Run, segment: Segment, p: System, w: Work, jumps: Matrix) -> bool:
    """Take the jumps that are due at time t, one per wire at the most; whether any was."""
    if p.mas:
        return False
    flow_at(t, run.y, segment, run.mode, run.x_frozen, p, w, w.f, w.obs)
    any_jump = False
    for i in range(p.wires):
        edge = violated_edge(i, run.mode, p, w.obs)
        if edge >= 0 and t >= run.control[C_LAST_JUMP + i] + run.control[C_DWELL + i] and t > run.control[C_LAST_JUMP + i]:
            record_jump(t, i, edge, run, jumps)
            jump(edge, i, run.mode, run.x_frozen, w.obs)
            any_jump = True
            run.control[C_H] = min(run.control[C_H], AFTER_JUMP)
    return any_jump


def record_jump(t: float, i: int, edge: int, run: Run, jumps: Matrix) -> None:
    """Log a jump and watch for chattering: many jumps in a short time make a wire wait before the next."""
    j = run.count[N_JUMPS]
    if j < jumps.shape[0]:
        jumps[j, 0], jumps[j, 1], jumps[j, 2] = t, i, edge
    run.count[N_JUMPS] = j + 1
    run.control[C_BURST + i] *= np.exp(-(t - run.control[C_LAST_JUMP + i]) / BURST_WINDOW)
    run.control[C_BURST + i] += 1.0
    run.control[C_LAST_JUMP + i] = t
    if run.control[C_BURST + i] > BURST:
        run.control[C_DWELL + i] = max(FIRST_DWELL, 2.0 * run.control[C_DWELL + i])
        run.count[N_CHATTER] += 1
    elif run.control[C_BURST + i] < 2.0:
        run.control[C_DWELL + i] = 0.0


def first_jump(t: float, h: float, run: Run, segment: Segment, p: System, w: Work) -> float:
    """The fraction of the step just made at which the first jump is due, or 2 when there is none."""
    if p.mas:
        return 2.0
    first = 2.0
    if h > LONG_STEP:  # a guard may be crossed to and fro within the step
        prepare_dense(w)
        first = first_jump_before(0.5, t, h, run, segment, p, w)
    if first > 1.0:
        first = first_jump_before(1.0, t, h, run, segment, p, w)
    return first


def first_jump_before(end: float, t: float, h: float, run: Run, segment: Segment, p: System, w: Work) -> float:
    """The fraction of the step at which the first of the guards violated at fraction `end` was crossed, or 2."""
    first = 2.0
    for i in range(p.wires):
        if i == 0 or first < 2.0:  # the search for a crossing looked elsewhere
            look(end, t, h, run, segment, p, w)
        edge = violated_edge(i, run.mode, p, w.obs_jacobian)
        if edge >= 0:
            prepare_dense(w)
            theta = crossing(edge, i, end, t, h, run.y, segment, run.mode, run.x_frozen, p, w)
            earliest = (run.control[C_LAST_JUMP + i] + run.control[C_DWELL + i] - t) / h
            if theta <= earliest or t + theta * h <= run.control[C_LAST_JUMP + i]:
                theta = 1.0 if earliest < 1.0 else 2.0
                run.count[N_CHATTER] += 1  # its flow would leave the mode at once
            first = min(first, theta)
    if first < 2.0 and end == 1.0:
        look(end, t, h, run, segment, p, w)
    return first


def look(theta: float, t: float, h: float, run: Run, segment: Segment, p: System, w: Work) -> None:
    """What is found at a fraction of the step, into ``w.obs_jacobian``."""
    if theta < 1.0:
        dense(theta, run.y, w)
        flow_at(t + theta * h, w.y_dense, segment, run.mode, run.x_frozen, p, w, w.f_stage, w.obs_jacobian)
    else:
        flow_at(t + h, w.y_new, segment, run.mode, run.x_frozen, p, w, w.f_stage, w.obs_jacobian)


def run_segment(
    t_end: float, run: Run, segment: Segment, p: System, w: Work, limits: Limits, samples: Matrix, sample_times: Vector,
    next_sample: int, jumps: Matrix,
) -> tuple[int, int]:  # fmt: skip
    """Integrate one stretch of the input; the reason for its end and the index of the next sample."""
    t = segment.t_0
    run.control[C_H] = min(run.control[C_H], AFTER_JUMP)
    jump_now(t, run, segment, p, w, jumps)
    while t < t_end:
        linearize(t, run.y, segment, run.mode, run.x_frozen, p, w)
        h = min(run.control[C_H], limits.max_step)
        status, h = accepted_step(t, t_end, h, run, segment, p, w, limits)
        if status != COMPLETED:
            return status, next_sample
        theta = first_jump(t, h, run, segment, p, w)
        t_new = t_end if t + h >= t_end else t + h
        if theta <= 1.0:
            t_new = t + theta * h
        next_sample = sample_step(t, h, t_new, theta > 1.0, run, segment, p, w, samples, sample_times, next_sample)
        if theta < 1.0:
            dense(theta, run.y, w)
            replace(run.y, w.y_dense)
        else:
            replace(run.y, w.y_new)
        t = t_new
        if theta <= 1.0:
            jump_now(t, run, segment, p, w, jumps)
        else:
            remember_fraction(run.mode, run.x_frozen, p, w.obs_jacobian)
    return COMPLETED, next_sample


def replace(y: Vector, new: Vector) -> None:
    """Copy `new` into `y`."""
    for i in range(y.shape[0]):
        y[i] = new[i]


def accepted_step(
    t: float, t_end: float, h: float, run: Run, segment: Segment, p: System, w: Work, limits: Limits
) -> tuple[int, float]:
    """Try steps until one meets the tolerance; (reason, its length). The next length is left in the control."""
    while True:
        if run.count[N_STEPS] >= limits.max_steps:
            return STEP_LIMIT, h
        rest = t_end - t
        clipped = h >= rest or h > 0.999999 * rest
        step = rest if clipped else min(h, 0.5 * rest) if h > 0.6 * rest else h
        error = rosenbrock_step(t, step, run.y, segment, run.mode, run.x_frozen, p, w)
        run.count[N_STEPS] += 1
        factor = min(2.5, max(0.15, 0.9 * max(error, 1e-10) ** (-1.0 / ORDER)))
        if error <= 1.0:
            run.control[C_H] = max(run.control[C_H], step * factor) if step < h else step * factor
            return COMPLETED, step
        run.count[N_REJECTED] += 1
        h = step * factor
        run.control[C_H] = h
        for i in range(run.y.shape[0]):
            if not np.isfinite(run.y[i]):
                return NOT_FINITE, h
        if h < MIN_STEP * (t - segment.t_0) + 1e-3 * MIN_STEP:
            return STEP_UNDERFLOW if np.isfinite(error) else RATE_NOT_FINITE, h


def sample_step(
    t: float, h: float, t_new: float, whole: bool, run: Run, segment: Segment, p: System, w: Work, samples: Matrix,
    sample_times: Vector, next_sample: int,
) -> int:  # fmt: skip
    """Write the samples that fall into the step; the index of the next one."""
    if next_sample >= sample_times.shape[0] or sample_times[next_sample] >= t_new:
        return next_sample
    prepare_dense(w)
    while next_sample < sample_times.shape[0] and sample_times[next_sample] < t_new:
        theta = (sample_times[next_sample] - t) / h
        dense(theta, run.y, w)
        observe(sample_times[next_sample], w.y_dense, run, segment, p, w, samples[next_sample])
        next_sample += 1
    if whole:
        flow_at(t_new, w.y_new, segment, run.mode, run.x_frozen, p, w, w.f_stage, w.obs_jacobian)
    return next_sample


def observe(t: float, y: Vector, run: Run, segment: Segment, p: System, w: Work, row: Vector) -> None:
    """One sample: true states, what the wires do, and what the sensors show."""
    flow_at(t, y, segment, run.mode, run.x_frozen, p, w, w.f_stage, w.obs_jacobian)
    obs = w.obs_jacobian
    if p.module:
        for j in range(6):
            row[j] = y[j]
        for j in range(3):  # tau = -J^T F
            row[Y_TAU + j] = -(obs[0, O_DL + j] * obs[0, O_F] + obs[1, O_DL + j] * obs[1, O_F])
    for i in range(p.wires):
        at = Y_WIRE + i * PER_WIRE
        row[at], row[at + 1], row[at + 2] = y[p.first_T + i], obs[i, O_X], obs[i, O_F]
        row[at + 3], row[at + 4], row[at + 5] = obs[i, O_LENGTH], obs[i, O_V], obs[i, O_SIGMA]
        row[at + 6], row[at + 8] = obs[i, O_DX], obs[i, O_J]
        row[at + 7] = observed_mode(obs[i, O_X], obs[i, O_DX], RESTING_RATE) if p.mas else run.mode[i]
    for channel in range(9):
        if p.module == (channel < 7):
            row[Y_SENSED + channel] = sensed_channel(channel, y, p, obs, w.f_stage)


def integrate(
    times: Vector, inputs: Matrix, slopes: Matrix, time_dependent: bool, run: Run, p: System, w: Work, limits: Limits,
    samples: Matrix, sample_times: Vector, jumps: Matrix,
) -> tuple[int, int]:  # fmt: skip
    """Run over all stretches of the input: inputs[k] + slopes[k] (t - times[k]) in [times[k], times[k+1]].

    Returns the reason for the end and the number of samples written.
    """
    next_sample = 0
    status = COMPLETED
    for k in range(times.shape[0] - 1):
        moving = time_dependent
        for j in range(slopes.shape[1]):
            moving = moving or slopes[k, j] != 0.0
        segment = Segment(times[k], inputs[k], slopes[k], moving)
        status, next_sample = run_segment(
            times[k + 1], run, segment, p, w, limits, samples, sample_times, next_sample, jumps
        )
        if status != COMPLETED:
            return status, next_sample
    last = times.shape[0] - 1
    segment = Segment(times[last], inputs[last], slopes[last], False)
    jump_now(times[last], run, segment, p, w, jumps)
    while next_sample < sample_times.shape[0] and sample_times[next_sample] <= times[last]:
        observe(sample_times[next_sample], run.y, run, segment, p, w, samples[next_sample])
        next_sample += 1
    return COMPLETED, next_sample


def integrate_held(
    k_0: int, rate: float, inputs: Matrix, still: Vector, time_dependent: bool, every: int, run: Run, p: System, w: Work,
    limits: Limits, samples: Matrix, jumps: Matrix,
) -> tuple[int, int]:  # fmt: skip
    """Fixed steps from k_0/rate on, `inputs[i]` held over step k_0 + i, with a sample after every `every`-th step.

    Returns the reason for the end and the number of samples written.
    """
    written = 0
    for i in range(inputs.shape[0]):
        k = k_0 + i + 1
        segment = Segment((k - 1) / rate, inputs[i], still, time_dependent)
        status, _ = run_segment(k / rate, run, segment, p, w, limits, samples, still[:0], 0, jumps)
        if status != COMPLETED:
            return status, written
        jump_now(k / rate, run, segment, p, w, jumps)
        if k % every == 0:
            observe(k / rate, run.y, run, segment, p, w, samples[written])
            written += 1
    return COMPLETED, written
