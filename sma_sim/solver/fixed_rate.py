"""The stepper at a fixed rate, as the ROS node runs it: same commands in, bit-identical trajectory out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.compiler.compile import package_compiler
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.solver.columns import new_samples, sample_columns
from sma_sim.solver.effect_table import own_scratch
from sma_sim.solver.end_of_run import notes_on_commands, notes_on_start, stop_reason
from sma_sim.solver.inputs import Input
from sma_sim.solver.integrate import (
    COMPLETED,
    N_JUMPS,
    REASONS,
    HeldInput,
    Limits,
    Log,
    integrate_held,
)
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import (
    MAX_JUMPS,
    STOPPED,
    Jump,
    SimulationError,
    Trajectory,
    move_clock,
    named_jumps,
    new_run,
    new_work,
    stall_step,
    trajectory,
)

STEPS_AT_ONCE = 10_000
WHOLE_ROWS = np.zeros(0, dtype=np.int64)  # samples are of no channels in particular
STEP_TOLERANCE = 1e-4  # [steps] within which a time is that of a step: bags tell times in whole nanoseconds
MAX_STEPS_PER_STEP = 100_000  # of the adaptive stepper within one fixed step


class FixedRateRun:
    """A run in steps of 1/rate: step k goes from k/rate to (k + 1)/rate under a held input.

    What is imposed beside heating, such as the strain of a wire on a test bench, is a set point: it is reached at the end of
    the step, linearly, because a wire cannot be stretched in no time.
    `sample` (size,) holds what was seen at the end of the last step (at the start, before it), where
    `solver.columns.sample_columns` says.
    Raises SimulationError when there is no start, or when a step cannot be made.
    """

    def __init__(self, model: Model, rate: float, first_input: Vector, k: int = 0) -> None:
        self.model, self.rate, self.k = model, float(rate), int(k)  # of one type: one version is compiled
        self._work = new_work(model)
        self.run = new_run(model, np.asarray(first_input, float), self._work)
        self.notes = notes_on_start(model, self.run)
        self.jumps = np.zeros((MAX_JUMPS, 3))
        self._still = np.zeros(len(self._work.u))
        self._drives = model.compiled.drives
        self._imposed = np.array(first_input[: self._drives], dtype=float)  # what has been reached
        self._compiled = own_scratch(model.compiled)
        self._integrate = package_compiler().function(integrate_held)
        self._samples = new_samples(1, WHOLE_ROWS, model.structure)
        self._observe(first_input)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.k / self.rate

    @property
    def sample(self) -> Vector:
        """What was seen at the end of the last step."""
        row: Vector = self._samples[0]
        return row

    def shown(self, channel: str) -> float:
        """What the sensor of a channel, such as ``alpha``, showed at the end of the last step (SI)."""
        structure = self.model.structure
        return float(self.sample[sample_columns(structure).sensed][structure.channels.index(channel)])

    def restart_clock(self, u: Vector) -> None:
        """Go on from the state of now at time 0, under the input `u`; `sample` is renewed. What is imposed stays."""
        move_clock(self.run.control, 0.0)
        self.k = 0
        self._observe(u)

    def _observe(self, u: Vector) -> None:
        """Renew `sample` by what is seen now, under the input `u`."""
        input_now = np.array(u, dtype=float)
        input_now[: self._drives] = self._imposed
        now = HeldInput(self.k, self.rate, input_now[None, :], self._still, False, 0)
        self._integrate(now, self.run, self._compiled, self._work, self._limits(0), self._log(self._samples))

    def step(self, u: Vector, count: int = 1, every: int = 1) -> None:
        """Steps under the input `u`, such as (J_eq [W], T_E [K]); `sample` is renewed where `every` divides their number."""
        self.advance(np.tile(u, (count, 1)), every, self._samples)

    def advance(self, inputs: NDArray[np.float64], every: int, samples: NDArray[np.float64]) -> int:
        """One step per row of `inputs`, a sample after every step whose number divides by `every`; their count."""
        self.run.count[:N_JUMPS] = 0
        inputs = np.array(inputs, dtype=float, order='C')
        limits = self._limits(len(inputs))
        if not self._drives or not len(inputs):
            held = HeldInput(self.k, self.rate, inputs, self._still, self.model.uses_time, every)
            return self._make_steps(held, samples, limits)
        written = 0
        for row in inputs:
            slope, begin = self._still.copy(), row.copy()
            begin[: self._drives] = self._imposed
            slope[: self._drives] = (row[: self._drives] - self._imposed) * self.rate
            self._imposed = row[: self._drives].copy()
            moving = self.model.uses_time or bool(slope.any())
            held = HeldInput(self.k, self.rate, begin[None, :], slope, moving, every)
            written += self._make_steps(held, samples[min(written, len(samples) - 1) :], limits)
        return written

    def _make_steps(self, held: HeldInput, samples: NDArray[np.float64], limits: Limits) -> int:
        """The steps of an input, and samples of them; their count."""
        log = self._log(samples)
        status = self._integrate(held, self.run, self._compiled, self._work, limits, log)
        if status != COMPLETED:
            raise SimulationError(f'the run ended after {self.time:g} s: {stop_reason(status, self.model, self.run)}')
        self.k += len(held.values)
        return int(log.written[0])

    def _limits(self, steps: int) -> Limits:
        return Limits(np.inf, MAX_STEPS_PER_STEP * steps, stall_step(self.model))

    def _log(self, samples: NDArray[np.float64]) -> Log:
        return Log(samples, self._still[:0], np.zeros(1, dtype=np.int64), self.jumps, WHOLE_ROWS)

    def take_jumps(self) -> tuple[Jump, ...]:
        """The jumps since this was last asked."""
        jumps = named_jumps(self.jumps, int(self.run.count[N_JUMPS]))
        self.run.count[N_JUMPS] = 0
        return jumps


def first_steps(times: Vector, rate: float) -> NDArray[np.int64]:
    """The first steps that begin at `times` [s] or later."""
    return np.ceil(times * rate - STEP_TOLERANCE).astype(np.int64)


def held_inputs(source: Input, rate: float) -> tuple[int, NDArray[np.float64]]:
    """The first step and the input of every step: a row takes effect at the first step that begins with it or later."""
    first = first_steps(np.asarray(source.times, float), rate)
    row = np.searchsorted(first, np.arange(first[0], max(first[-1], first[0] + 1)), side='right') - 1
    return int(first[0]), np.asarray(source.values, float)[row]


def steps_per_sample(rate: float, sample_rate: float) -> int:
    """Steps between two samples. Raises UserError when the rates do not fit."""
    every = round(rate / sample_rate)
    if every < 1 or abs(every * sample_rate - rate) > 1e-9 * rate:
        raise UserError(
            f'{sample_rate:g} samples per second do not divide {rate:g} steps per second: choose a rate that does'
        )
    return every


def simulate_fixed_rate(
    model: Model, source: Input, rate: float, sample_rate: float, progress: Callable[[float], None] | None = None
) -> Trajectory:
    """Run at a fixed rate, bit for bit as the node does; samples at the nearest whole number of steps.

    Raises SimulationError when the input is not held, or when the sampling rate does not divide the rate.
    """
    every = steps_per_sample(rate, sample_rate)
    if any(source.linear):
        raise SimulationError('fixed steps need held inputs, not linear ones')
    k_0, inputs = held_inputs(source, rate)
    run = FixedRateRun(model, rate, inputs[0], k_0)
    samples = new_samples(len(inputs) // every + 2, WHOLE_ROWS, model.structure)
    samples[0] = run.sample
    written, reason = 1, REASONS[COMPLETED]
    counts: Any = np.zeros_like(run.run.count)
    try:
        for first in range(0, len(inputs), STEPS_AT_ONCE):
            written += run.advance(inputs[first : first + STEPS_AT_ONCE], every, samples[written:])
            counts[:N_JUMPS] += run.run.count[:N_JUMPS]
            if progress is not None:
                progress(min(1.0, (first + STEPS_AT_ONCE) / len(inputs)))
    except KeyboardInterrupt:
        reason = STOPPED
    except SimulationError as error:
        reason = str(error)
    run.run.count[:N_JUMPS] = counts[:N_JUMPS]
    times = (k_0 // every + np.arange(written)) * every / rate
    times[0] = k_0 / rate
    log = Log(samples, times, np.array([written]), run.jumps, WHOLE_ROWS)
    return trajectory(model, log, times, run.run, reason, (*run.notes, *notes_on_commands(model, source)), source)
