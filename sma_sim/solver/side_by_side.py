"""Many robots of one kind, each stepped at a fixed rate, in one call of compiled code for each processor thread."""

from __future__ import annotations

import os
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.compiler.compile import is_interpreted, package_compiler
from sma_sim.compiler.pinned_systems import pin_system, pinned_systems, record_at
from sma_sim.model.arrays import Integers, Matrix, Vector
from sma_sim.model.layout import System, SystemState
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.effect_table import own_scratch
from sma_sim.solver.fixed_rate import MAX_STEPS_PER_STEP, WHOLE_ROWS, FixedRateRun
from sma_sim.solver.integrate import COMPLETED, N_JUMPS, HeldInput, Limits, Log, Run, integrate_held
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import new_run, new_work, stall_step
from sma_sim.solver.work import Work, copy_into

MAX_JUMPS = 1000  # of a wire within one step, which nobody reads
LEAST_PART = 8  # robots that are worth a thread of their own: to ask it takes as long as a step of three


class Batch(NamedTuple):
    """The robots as compiled code reads and writes them, a row of every array for each."""

    y: Matrix
    mode: Integers
    x_frozen: Matrix
    control: Matrix
    counts: Integers
    solution: NDArray[np.float64]
    weight: Matrix
    increment: Matrix
    values: Matrix  # the input that is held
    samples: Matrix
    k: Integers  # steps made
    status: Integers  # of the last one
    systems: Integers  # addresses


def step_side_by_side(which: Integers, b: Batch, held: HeldInput, like: System, w: Work, limits: Limits, log: Log) -> None:
    """Make a step of the robots `which`; `like` is the equations of any of them, `w` scratch memory of these.

    `held` says what their inputs have in common, `log` where what nobody reads is written.
    """
    for at in range(which.shape[0]):
        i = which[at]
        run = Run(SystemState(b.y[i], b.mode[i], b.x_frozen[i]), b.control[i], b.counts[i], b.solution[i])
        copy_into(w.weight, b.weight[i])
        copy_into(w.increment, b.increment[i])
        for j in range(N_JUMPS + 1):
            run.count[j] = 0
        log.written[0] = 0
        own = HeldInput(b.k[i], held.rate, b.values[i : i + 1], held.slope, held.time_dependent, 1)
        into = Log(b.samples[i : i + 1], log.times, log.written, log.jumps, log.numbers)
        b.status[i] = integrate_held(own, run, record_at(b.systems[i], like), w, limits, into)
        copy_into(b.weight[i], w.weight)
        b.k[i] += 1


class SideBySide:
    """Robots with one structure, kinetics and set of effects, whose parameters may differ; no set points are imposed.

    `put` begins the run of one of them, `step` makes a step of some. `samples` (robots, size) holds what was seen last,
    where `solver.columns.sample_columns` says. The steps are those of a `FixedRateRun`, to the last bit.
    """

    def __init__(self, model: Model, rate: float, count: int) -> None:
        structure, self.rate, self._model = model.structure, float(rate), model
        threads = max(1, min(os.cpu_count() or 1, count // LEAST_PART))
        works = [new_work(model) for _ in range(threads)]
        run = new_run(model, np.array([*np.zeros(len(structure.input_columns) - 1), 298.0]), works[0])
        self._kept: list[object] = [None] * count  # what the addresses need to live
        self._pin = package_compiler().function(pin_system)
        self._step = package_compiler().function(step_side_by_side)
        still = np.zeros(len(structure.input_columns))
        self._held = HeldInput(0, self.rate, still[None], still, model.uses_time, 1)
        state, n, whole = run.state, len(works[0].weight), sample_columns(structure).size
        self._of_threads = [
            (work, Log(np.zeros((1, whole)), np.zeros(0), np.zeros(1, dtype=np.int64), np.zeros((MAX_JUMPS, 3)), WHOLE_ROWS))
            for work in works
        ]
        self._batch = Batch(
            y=np.zeros((count, n)),
            mode=rows_like(state.mode, count),
            x_frozen=rows_like(state.x_frozen, count),
            control=rows_like(run.control, count),
            counts=rows_like(run.count, count),
            solution=np.zeros((count, n, n)),
            weight=np.zeros((count, n)),
            increment=np.zeros((count, n)),
            values=np.zeros((count, len(structure.input_columns))),
            samples=np.zeros((count, whole)),
            k=np.zeros(count, dtype=np.int64),
            status=np.zeros(count, dtype=np.int64),
            systems=np.zeros(count, dtype=np.int64),
        )

    @property
    def samples(self) -> Matrix:
        """What was seen last, a row for each robot."""
        return self._batch.samples

    def put(self, i: int, model: Model, first_input: Vector) -> None:
        """Robot `i` begins a run. Raises SimulationError where it has no rest."""
        one, b = FixedRateRun(model, self.rate, first_input), self._batch
        b.y[i], b.mode[i], b.x_frozen[i] = one.run.state
        b.control[i], b.counts[i], b.solution[i] = one.run.control, one.run.count, one.run.solution
        work = new_work(model)
        b.weight[i], b.increment[i], b.samples[i], b.k[i] = work.weight, work.increment, one.sample, 0
        pinned = pinned_systems([own_scratch(model.compiled)], self._pin, is_interpreted())
        b.systems[i], self._kept[i] = pinned.addresses[0], pinned.kept

    def step(self, inputs: Matrix, which: Integers) -> NDArray[np.bool_]:
        """A step of the robots `which` under their rows of `inputs` (robots, columns); who of all could not make it."""
        b = self._batch
        b.values[:], b.status[:] = inputs, COMPLETED
        limits = Limits(np.inf, MAX_STEPS_PER_STEP, stall_step(self._model))
        own, *others = [
            partial(self._step, part, b, self._held, self._model.compiled, work, limits, log)
            for part, (work, log) in zip(np.array_split(which, len(self._of_threads)), self._of_threads, strict=True)
        ]
        asked = [threads_of(os.getpid()).submit(one) for one in others]
        own()
        for future, one in zip(asked, others, strict=True):
            if future.cancel():  # the thread has not come to it, where the processor is busy
                one()
            else:
                future.result()
        return np.asarray(b.status != COMPLETED)


@lru_cache(1)
def threads_of(process: int) -> Executor:
    """Threads beside that of the caller, for all robots of a process: one that was forked has none of its parent's."""
    return ThreadPoolExecutor(max(1, (os.cpu_count() or 1) - 1))


def rows_like(one: NDArray[Any], count: int) -> NDArray[Any]:
    """Zeros, so many rows like `one`."""
    return np.zeros((count, *one.shape), dtype=one.dtype)
