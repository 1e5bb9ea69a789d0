"""Integration over the input: steps, jumps, samples, and a reason for every end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sma_sim.model.arrays import Integers, Matrix, Vector
from sma_sim.model.automaton import INNER, observed_mode
from sma_sim.model.layout import O_DL, O_DX, O_F, O_J, O_LENGTH, O_SIGMA, O_V, O_X, System, SystemState
from sma_sim.model.system import ambient_temperature, commanded_heating, sensed_channel
from sma_sim.model.transformation import has_offsets
from sma_sim.solver.events import crossing, evaluate_guards, jump, remember_fraction, violated_edge
from sma_sim.solver.linear import invert_shifted
from sma_sim.solver.sampling import RESTING_RATE, needed_for, sample_numbers
from sma_sim.solver.stepper import (
    ORDER,
    ROW_GAMMA,
    Segment,
    Step,
    dense,
    flow_at,
    input_at,
    linearize_flow,
    pass_cubic,
    prepare_dense,
    rosenbrock_step,
    row_step,
    with_smooth,
)
from sma_sim.solver.work import Work, copy_evaluation, copy_into

NOT_CROSSED = -1
COMPLETED, STEP_LIMIT, STEP_UNDERFLOW, NOT_FINITE, RATE_NOT_FINITE, STALLED = range(6)
REASONS = (
    'end of the input',
    'step limit reached',
    'step size underflow: the equations are too stiff or singular here',
    'a state is no longer finite',
    'a rate is not a finite number here: look at the effects and the parameters',
    'stalled: the last steps are so short that the run would not end; a rate switches too fast to be followed here: check '
    'the effects and the parameters, or raise solver.rtol',
)

# Columns of a sample: coordinates, their rates, PER_WIRE of each wire, what sensors show, generalised forces of the wires.
WIRE_COLUMNS = ('T', 'x_M', 'F', 'length', 'v', 'sigma', 'dx_M', 'mode', 'J')
PER_WIRE = len(WIRE_COLUMNS)

# Counters and controls of a run.
N_STEPS, N_REJECTED, N_FLOWS, N_JUMPS, N_CHATTER, N_WINDOW, N_TIGHTENED, N_SIZE = range(8)
C_H, C_TIME, C_WINDOW, C_KEPT_UNTIL, C_ROW_LENGTH, C_ROWS_LEFT, C_WIRES = range(7)  # from the last on, for each wire:
C_LAST_JUMP, C_BURST, C_DWELL, C_HEAT, PER_WIRE_CONTROLS = 0, 1, 2, 3, 4


class Run(NamedTuple):
    """A run in progress; all arrays are changed in place, so that a run can be continued."""

    state: SystemState
    control: Vector  # step size; time reached, -inf before the first step; start of the window of steps; of steps over rows:
    # until when `solution` is kept, of what length they are (0: none), how many rows to leave to others; per wire: time of
    # the last jump, recent jumps, dwell, heat
    count: Integers
    solution: Matrix  # (n, n) of `solver.linear.invert_shifted`, for steps over rows


class Limits(NamedTuple):
    """What bounds a run. It is stalled when WINDOW steps in a row are shorter than `stall_step` [s] in the mean."""

    max_step: float
    max_steps: int
    stall_step: float


class InputStretches(NamedTuple):
    """An input as stretches: values[k] + slopes[k] (t - times[k]) in [times[k], times[k+1]]."""

    times: Vector
    values: Matrix
    slopes: Matrix
    time_dependent: bool  # whether the flow depends on time other than through the input


class HeldInput(NamedTuple):
    """An input in fixed steps: values[i] is in force from (k_0 + i)/rate, and changes by `slope` to (k_0 + i + 1)/rate."""

    k_0: int
    rate: float
    values: Matrix
    slope: Vector  # of every step [1/s]
    time_dependent: bool
    every: int  # a sample is taken after every step whose number divides by it; 0: one of the state at k_0, and no step


class Log(NamedTuple):
    """What a run writes: samples at `times` (k,), how many so far (1,), and jumps (j, 3).

    Samples are whole rows (k, size), or (k, c) of the `numbers` (c,) in solver.columns, where there are any.
    """

    samples: Matrix
    times: Vector
    written: Integers
    jumps: Matrix
    numbers: Integers


LONG_STEP = 2e-3  # [s]; guards are evaluated in the middle of longer steps too
# First steps tried [s]: after a row of the input; after a jump that changes the rate of a wire's force, as it begins to
# transform or comes to an end of it; after one that stops it where dx_M/dt passes through zero.
AFTER_ROW, AFTER_JUMP, AFTER_REVERSAL = 1e-2, 5e-3, 2e-2
LITTLE_RISE = 0.5  # [K]: a row that changes heating by little may be followed by a step in which this changes T by so much
OF_STRETCH = 0.3  # after a row at imposed temperature, of the new stretch: nothing moves there but with the input
MAX_GROWTH = (5.0, 2.5)  # of a step, after another: hybrid, MAS, where fronts are not announced by jumps
# Of the order that rejected steps show: below which it is that of a front, as where a MAS wire begins to transform; growth
# after a step up to one, since what follows is smooth again
OF_FRONT, AFTER_FRONT = 3.0, 5.0
MIN_STEP = 1e-12  # relative to the time passed, plus this many seconds
BURST, BURST_WINDOW, FIRST_DWELL = 16, 1e-3, 1e-5
WINDOW = 20_000  # steps, tried ones included, over which a stalled run is told from one in a fast transient
TIGHTER = 1e-2  # of the tolerance of the plate's rates, where friction switches within it
# Of steps over rows: how many keep a matrix, and how much of a length they may differ; how many rows are left to other steps
# after one that failed; the most of the tolerance, hybrid and MAS, where a wire's onset is no jump and errors come in bursts
KEPT_ROWS, LIKE_ROWS, ROWS_LEFT = 10.5, 0.3, 8.0
MAX_ERROR = (1.0, 0.3)
NO_JUMP = 2.0  # as a fraction of a step


def jump_now(t: float, run: Run, segment: Segment, p: System, w: Work, log: Log) -> bool:
    """Take the jumps that are due at time t, one per wire at the most; whether any was.

    In the hybrid model ``w.first`` is then the flow before them.
    """
    if p.mas:
        return False
    flow_at(t, run.state, segment, p, w, w.first)
    any_jump = False
    for i in range(p.wires):
        edge = violated_edge(i, run.state, p, w.first.obs)
        last_jump = run.control[of_wire(i, C_LAST_JUMP)]
        if edge >= 0 and t >= last_jump + run.control[of_wire(i, C_DWELL)] and t > last_jump:
            record_jump(t, i, edge, run, log.jumps)
            jump(edge, i, run.state, w.first.obs)
            any_jump = True
            first = AFTER_REVERSAL if run.state.mode[i] == INNER else AFTER_JUMP
            run.control[C_H] = min(run.control[C_H], first)
    return any_jump


def of_wire(i: int, which: int) -> int:
    """Where the control has a number of wire `i`."""
    return C_WIRES + PER_WIRE_CONTROLS * i + which


def record_jump(t: float, i: int, edge: int, run: Run, jumps: Matrix) -> None:
    """Log a jump and watch for chattering: many jumps in a short time make a wire wait before the next."""
    run.control[C_ROW_LENGTH] = 0.0
    j = run.count[N_JUMPS]
    if j < jumps.shape[0]:
        jumps[j, 0], jumps[j, 1], jumps[j, 2] = t, i, edge
    run.count[N_JUMPS] = j + 1
    last, burst, dwell = of_wire(i, C_LAST_JUMP), of_wire(i, C_BURST), of_wire(i, C_DWELL)
    run.control[burst] *= np.exp(-(t - run.control[last]) / BURST_WINDOW)
    run.control[burst] += 1.0
    run.control[last] = t
    if run.control[burst] > BURST:
        run.control[dwell] = max(FIRST_DWELL, 2.0 * run.control[dwell])
        run.count[N_CHATTER] += 1
    elif run.control[burst] < 2.0:
        run.control[dwell] = 0.0


def first_jump(step: Step, run: Run, segment: Segment, p: System, w: Work) -> float:
    """The fraction of the step just made at which the first jump is due, or NO_JUMP."""
    if p.mas:
        return NO_JUMP
    first = NO_JUMP
    if step.h > LONG_STEP:  # a guard may be crossed to and fro within the step
        prepare_dense(w)
        first = first_jump_before(0.5, step, run, segment, p, w)
    if first > 1.0:
        first = first_jump_before(1.0, step, run, segment, p, w)
    return first


def first_jump_before(end: float, step: Step, run: Run, segment: Segment, p: System, w: Work) -> float:
    """The fraction of the step at which the first of the guards violated at fraction `end` was crossed, or NO_JUMP.

    Without a jump ``w.guard`` is the evaluation at `end`.
    """
    first = NO_JUMP
    at_end = False
    for i in range(p.wires):
        if not at_end:  # the search for a crossing evaluates elsewhere
            evaluate_guards(end, step, run.state, segment, p, w)
        edge = violated_edge(i, run.state, p, w.guard.obs)
        at_end = edge < 0
        if edge >= 0:
            prepare_dense(w)
            theta = crossing(edge, i, end, step, run.state, segment, p, w)
            last_jump = run.control[of_wire(i, C_LAST_JUMP)]
            earliest = (last_jump + run.control[of_wire(i, C_DWELL)] - step.t) / step.h
            if theta <= earliest or step.t + theta * step.h <= last_jump:
                theta = 1.0 if earliest < 1.0 else NO_JUMP
                run.count[N_CHATTER] += 1  # its flow would leave the mode at once
            first = min(first, theta)
    if first > 1.0 and not at_end:
        evaluate_guards(end, step, run.state, segment, p, w)
    return first


def cross_row(run: Run, segment: Segment, p: System, w: Work, limits: Limits, log: Log) -> int:
    """Make one cheap step over a short row of a held input that changes heating by little; else NOT_CROSSED.

    It solves its equations with a matrix that is kept over several rows. Steps as usual go on where it is not exact enough,
    and where a wire jumps.
    """
    t, h, control = segment.t_0, segment.t_end - segment.t_0, run.control
    if segment.moving or p.drives > 0 or w.elimination.order.shape[0] > 0:
        return NOT_CROSSED
    if h > min(control[C_H], limits.max_step) or h > first_step(run, segment, p):
        return NOT_CROSSED
    if control[C_ROWS_LEFT] > 0.0:
        control[C_ROWS_LEFT] -= 1.0
        return NOT_CROSSED
    if run.count[N_STEPS] >= limits.max_steps or jump_now(t, run, segment, p, w, log):
        return NOT_CROSSED
    if p.mas:
        flow_at(t, run.state, segment, p, w, w.first)
    error, most = np.inf, MAX_ERROR[int(p.mas)]
    if segment.t_end <= control[C_KEPT_UNTIL] and abs(h - control[C_ROW_LENGTH]) <= LIKE_ROWS * h:
        error = row_step(h, run.state, segment, p, w, run.solution)
        run.count[N_STEPS] += 1
    if not error <= most:
        linearize_flow(t, run.state, segment, p, w, True)
        error = np.inf
        if invert_shifted(w.jacobian, 1.0 / (h * ROW_GAMMA), p.coordinates, run.solution, w.pivot):
            control[C_KEPT_UNTIL], control[C_ROW_LENGTH] = t + KEPT_ROWS * h, h
            error = row_step(h, run.state, segment, p, w, run.solution)
            run.count[N_STEPS] += 1
    if not error <= most or switched(h, run, segment, p, w):
        run.count[N_REJECTED] += 1
        control[C_ROW_LENGTH], control[C_ROWS_LEFT] = 0.0, ROWS_LEFT
        return NOT_CROSSED
    keep_heat(run, segment, p, w)
    return finish_row(Step(t, h), run, segment, p, w, limits, log)


def switched(h: float, run: Run, segment: Segment, p: System, w: Work) -> bool:
    """Whether a MAS wire begins or ends to transform in the step over a row, which no jump tells; makes its dense output."""
    flow_at(segment.t_end, with_smooth(w.y_new, run.state), segment, p, w, w.guard)
    pass_cubic(h, run.state.y, p, w)
    if p.mas:
        for i in range(p.wires):
            before, after = w.first.obs, w.guard.obs
            if observed_mode(before[i, O_X], before[i, O_DX], RESTING_RATE) != observed_mode(
                after[i, O_X], after[i, O_DX], RESTING_RATE
            ):
                return True
    return False


def finish_row(step: Step, run: Run, segment: Segment, p: System, w: Work, limits: Limits, log: Log) -> int:
    """Take the step over a row, up to the first jump within it, from where steps as usual go on."""
    y = run.state.y
    theta = first_jump(step, run, segment, p, w)
    t_new = segment.t_end if theta > 1.0 else step.t + theta * step.h
    sample_step(step, t_new, run, segment, p, w, log)
    if theta < 1.0:
        dense(theta, y, w)
        copy_into(y, w.y_dense)
    else:
        copy_into(y, w.y_new)
    if theta > 1.0:
        remember_fraction(run.state, p, w.guard.obs)
        return COMPLETED
    return run_segment(run, Segment(t_new, segment.t_end, segment.u_0, segment.du, False), p, w, limits, log)


def run_segment(run: Run, segment: Segment, p: System, w: Work, limits: Limits, log: Log) -> int:
    """Integrate one stretch of the input; the reason for its end."""
    t, y = segment.t_0, run.state.y
    run.control[C_H] = min(run.control[C_H], first_step(run, segment, p))
    keep_heat(run, segment, p, w)
    evaluated = not jump_now(t, run, segment, p, w, log) and not p.mas
    while t < segment.t_end:
        linearize_flow(t, run.state, segment, p, w, evaluated)
        status, step, theta, t_new = next_step(t, run, segment, p, w, limits)
        if status != COMPLETED:
            run.control[C_TIME] = t
            return status
        sample_step(step, t_new, run, segment, p, w, log)
        if theta < 1.0:
            dense(theta, y, w)
            copy_into(y, w.y_dense)
        else:
            copy_into(y, w.y_new)
        t = t_new
        if theta <= 1.0:
            evaluated = not jump_now(t, run, segment, p, w, log)
        else:
            evaluated = not p.mas and not has_offsets(p.effects)  # these depend on the fraction that is now remembered
            remember_fraction(run.state, p, w.guard.obs)
            copy_evaluation(w.guard, w.first)
    return COMPLETED


def first_step(run: Run, segment: Segment, p: System) -> float:
    """The longest step to try first after a row [s]: AFTER_ROW, or longer where the row changes heating by little."""
    length = segment.t_end - segment.t_0
    if p.imposed_T >= 0:
        return max(AFTER_ROW, OF_STRETCH * length)
    if p.drives > 0:
        return AFTER_ROW
    change = 0.0
    for i in range(p.wires):
        change = max(change, abs(heat_brought(i, segment.u_0, p) - run.control[of_wire(i, C_HEAT)]))
    longest = LITTLE_RISE * p.wire.volume * p.wire.rho * p.wire.c_V / max(change, 1e-12)
    return max(AFTER_ROW, longest)


def keep_heat(run: Run, segment: Segment, p: System, w: Work) -> None:
    """Leave the heat that a stretch of the input brings in the end in the control, for the next row."""
    if p.drives == 0:
        input_at(segment.t_end, segment, w.u)
        for i in range(p.wires):
            run.control[of_wire(i, C_HEAT)] = heat_brought(i, w.u, p)


def heat_brought(i: int, u: Vector, p: System) -> float:
    """What an input brings to wire `i` [W], but for a constant: its heating, and from surroundings at T_E."""
    return commanded_heating(i, u, p) + p.wire.lambda_ * p.wire.surface * ambient_temperature(u, p)


def next_step(t: float, run: Run, segment: Segment, p: System, w: Work, limits: Limits) -> tuple[int, Step, float, float]:
    """Make a step from the linearised state at time t; the reason, the step, its first jump's fraction, its end."""
    status, h = accepted_step(t, min(run.control[C_H], limits.max_step), run, segment, p, w, limits)
    step = Step(t, h)
    if status != COMPLETED:
        return status, step, NO_JUMP, t
    theta = first_jump(step, run, segment, p, w)
    t_new = segment.t_end if t + h >= segment.t_end else t + h
    if theta <= 1.0:
        t_new = t + theta * h
    return status, step, theta, t_new


def accepted_step(t: float, h: float, run: Run, segment: Segment, p: System, w: Work, limits: Limits) -> tuple[int, float]:
    """Try steps until one meets the tolerance; (reason, its length). The next length is left in the control.

    After a second rejection the order of the error is the one that both have shown (Gustafsson, ACM Trans. Math. Software 20
    (1994) 496): over a front it falls with the step and not with its fourth power, and six trials would be made for two.
    """
    longer, larger, is_front = 0.0, 0.0, False  # the trial before, and its error
    has_fronts = p.mas and p.imposed_T < 0  # hybrid ones are jumps, and where temperature is imposed all is slow
    while True:
        if run.count[N_STEPS] >= limits.max_steps:
            return STEP_LIMIT, h
        rest = segment.t_end - t
        clipped = h >= rest or h > 0.999999 * rest
        step = rest if clipped else min(h, 0.5 * rest) if h > 0.6 * rest else h
        if is_stalled(t, run, limits) and not tighten_rates(run, p, w):
            return STALLED, h
        error = rosenbrock_step(Step(t, step), run.state, segment, p, w)
        run.count[N_STEPS] += 1
        order = float(ORDER)
        if has_fronts and error > 1.0 and larger > 1.0 and np.isfinite(error) and np.isfinite(larger):
            order = min(max(np.log(larger / error) / np.log(longer / step), 1.0), order)
            is_front = is_front or order < OF_FRONT
        longer, larger = step, error
        factor = min(MAX_GROWTH[int(p.mas)], max(0.15, 0.9 * max(error, 1e-10) ** (-1.0 / order)))
        if error <= 1.0:
            if is_front:
                factor = max(factor, AFTER_FRONT)
            run.control[C_H] = max(run.control[C_H], step * factor) if step < h else step * factor
            return COMPLETED, step
        run.count[N_REJECTED] += 1
        h = step * factor
        run.control[C_H] = h
        for i in range(run.state.y.shape[0]):
            if not np.isfinite(run.state.y[i]):
                return NOT_FINITE, h
        if h < MIN_STEP * (t - segment.t_0) + 1e-3 * MIN_STEP:
            return STEP_UNDERFLOW if np.isfinite(error) else RATE_NOT_FINITE, h


def is_stalled(t: float, run: Run, limits: Limits) -> bool:
    """Count a step that is about to be tried at time t; whether the last WINDOW of them led nowhere."""
    steps = run.count[N_WINDOW]
    run.count[N_WINDOW] = steps + 1
    if 0 < steps < WINDOW:
        return False
    stalled = steps > 0 and t - run.control[C_WINDOW] < WINDOW * limits.stall_step
    run.control[C_WINDOW], run.count[N_WINDOW] = t, 1
    return stalled


def tighten_rates(run: Run, p: System, w: Work) -> bool:
    """Tighten the tolerance of the structure's rates, once a run; whether that was done.

    They are scaled as undamped vibrations. Friction that switches over a much smaller speed is then not resolved, and a
    short step may repeat the same error for ever; resolved, it takes no more steps than usual.
    """
    if p.coordinates == 0 or run.count[N_TIGHTENED] > 0:
        return False
    run.count[N_TIGHTENED] = 1
    for i in range(p.coordinates, 2 * p.coordinates):
        w.weight[i] *= TIGHTER
    return True


def sample_step(step: Step, t_new: float, run: Run, segment: Segment, p: System, w: Work, log: Log) -> None:
    """Write the samples that fall into the step, up to `t_new`."""
    k = log.written[0]
    if k >= log.times.shape[0] or log.times[k] >= t_new:
        return
    prepare_dense(w)
    needed = needed_for(log.numbers, p)
    while k < log.times.shape[0] and log.times[k] < t_new:
        dense((log.times[k] - step.t) / step.h, run.state.y, w)
        write_sample(k, with_smooth(w.y_dense, run.state), segment, p, w, log, needed)
        k += 1
    log.written[0] = k


def write_sample(k: int, state: SystemState, segment: Segment, p: System, w: Work, log: Log, needed: int) -> None:
    """Write sample `k`: of the numbers in the log, or a whole row."""
    if log.numbers.shape[0] > 0:
        sample_numbers(log.times[k], state, segment, p, w, log.numbers, needed, log.samples[k])
    else:
        observe(log.times[k], state, segment, p, w, log.samples[k])


def observe(t: float, state: SystemState, segment: Segment, p: System, w: Work, row: Vector) -> None:
    """One sample: true states, what the wires do, and what the sensors show."""
    flow_at(t, state, segment, p, w, w.sample)
    y, obs, n = state.y, w.sample.obs, p.coordinates
    for j in range(2 * n):
        row[j] = y[j]
    for i in range(p.wires):
        at = 2 * n + i * PER_WIRE
        row[at], row[at + 1], row[at + 2] = y[p.first_T + i], obs[i, O_X], obs[i, O_F]
        row[at + 3], row[at + 4], row[at + 5] = obs[i, O_LENGTH], obs[i, O_V], obs[i, O_SIGMA]
        row[at + 6], row[at + 8] = obs[i, O_DX], obs[i, O_J]
        row[at + 7] = observed_mode(obs[i, O_X], obs[i, O_DX], RESTING_RATE) if p.mas else state.mode[i]
    sensed = 2 * n + p.wires * PER_WIRE
    for channel in range(p.channels):
        row[sensed + channel] = sensed_channel(channel, y, p, obs, w.sample.dy)
    for j in range(n):  # tau = -J^T F
        pull, own, wires = 0.0, n // p.segments, p.wires // p.segments
        first = j // own * wires
        for i in range(first, first + wires):
            pull += obs[i, O_DL + j % own] * obs[i, O_F]
        row[sensed + p.channels + j] = -pull


def stretch(k: int, stretches: InputStretches) -> Segment:
    """Stretch `k` of an input."""
    times, values, slopes = stretches.times, stretches.values, stretches.slopes
    moving = stretches.time_dependent
    for j in range(slopes.shape[1]):
        moving = moving or slopes[k, j] != 0.0
    return Segment(times[k], times[k + 1], values[k], slopes[k], moving)


def sample_again(stretches: InputStretches, states: Matrix, state: SystemState, p: System, w: Work, log: Log) -> None:
    """The samples of a run from its `states` at their times (k, n + 2 wires), as `solver.sampling.state_number` tells them;
    `state` becomes the last of them."""
    n, needed, row = state.y.shape[0], needed_for(log.numbers, p), 0
    for k in range(log.times.shape[0]):
        while row < stretches.times.shape[0] - 1 and log.times[k] >= stretches.times[row + 1]:
            row += 1
        for j in range(n):
            state.y[j] = states[k, j]
        for i in range(p.wires):
            state.mode[i], state.x_frozen[i] = int(states[k, n + i]), states[k, n + p.wires + i]
        t, u, du = stretches.times[row], stretches.values[row], stretches.slopes[row]
        write_sample(k, state, Segment(t, t, u, du, False), p, w, log, needed)
    log.written[0] = log.times.shape[0]


def integrate(stretches: InputStretches, run: Run, p: System, w: Work, limits: Limits, log: Log) -> int:
    """Run over all stretches of the input; the reason for the end."""
    times, values, slopes = stretches.times, stretches.values, stretches.slopes
    for k in range(times.shape[0] - 1):
        segment = stretch(k, stretches)
        status = cross_row(run, segment, p, w, limits, log)
        if status == NOT_CROSSED:
            status = run_segment(run, segment, p, w, limits, log)
        if status != COMPLETED:
            return status
    last = times.shape[0] - 1
    segment = Segment(times[last], times[last], values[last], slopes[last], False)
    jump_now(times[last], run, segment, p, w, log)
    run.control[C_TIME] = times[last]
    k, needed = log.written[0], needed_for(log.numbers, p)
    while k < log.times.shape[0] and log.times[k] <= times[last]:
        write_sample(k, run.state, segment, p, w, log, needed)
        k += 1
    log.written[0] = k
    return COMPLETED


def integrate_held(held: HeldInput, run: Run, p: System, w: Work, limits: Limits, log: Log) -> int:
    """Fixed steps under a held input, with samples whatever the times in the log say; the reason for the end."""
    if held.every == 0:  # here, since a function of its own would be compiled with much that is compiled here already
        t = held.k_0 / held.rate
        observe(t, run.state, Segment(t, t, held.values[0], held.slope, False), p, w, log.samples[0])
        return COMPLETED
    for i in range(held.values.shape[0]):
        k = held.k_0 + i + 1
        segment = Segment((k - 1) / held.rate, k / held.rate, held.values[i], held.slope, held.time_dependent)
        if p.imposed_T < 0:
            run.control[C_H] = min(run.control[C_H], AFTER_ROW)
        status = run_segment(run, segment, p, w, limits, log)
        if status != COMPLETED:
            return status
        jump_now(k / held.rate, run, segment, p, w, log)
        run.control[C_TIME] = k / held.rate
        if k % held.every == 0:
            row = min(log.written[0], log.samples.shape[0] - 1)  # a log that is too short keeps the newest in its last row
            observe(k / held.rate, run.state, segment, p, w, log.samples[row])
            log.written[0] += 1
    return COMPLETED
