"""What a model does under a heating to come, with the derivatives in it: what a controller that looks ahead needs.

The heating is held from one of some times to the next. Its derivatives are the tangents of `solver.tangents`, over the jumps
of the hybrid model too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.compiler.compile import is_interpreted, package_compiler
from sma_sim.compiler.pinned_systems import pin_system, pinned_systems
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.errors import UserError
from sma_sim.model.layout import System
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.effect_table import own_scratch
from sma_sim.solver.end_of_run import stop_reason
from sma_sim.solver.integrate import C_H, COMPLETED, InputStretches, Limits, Log, Run, integrate, stretch
from sma_sim.solver.model import Model
from sma_sim.solver.propagation import DELTA, NO_NUMBERS, held_input_tangents, observe_beside
from sma_sim.solver.sensitivities import padded
from sma_sim.solver.simulate import SimulationError, copy_of_run, new_work, stall_step
from sma_sim.solver.tangent_nodes import Tangents
from sma_sim.solver.tangents import follow_segment
from sma_sim.solver.work import Work

Arrays = NDArray[np.float64]  # of three dimensions
FIRST_STEP = 1e-3  # [s]
MAX_STEPS = 20_000  # of one prediction


def follow_samples(
    stretches: InputStretches, run: Run, p: System, w: Work, limits: Limits, log: Log, a: Tangents, rows: Arrays
) -> int:
    """Run over all stretches of the input with tangents; a sample, and beside it along each tangent, at the end of each."""
    for k in range(stretches.times.shape[0] - 1):
        segment = stretch(k, stretches)
        status = follow_segment(k, run, segment, p, w, limits, log, a)
        if status != COMPLETED:
            return status
        observe_beside(segment.t_end, run, segment, p, w, a, rows[k])
    return COMPLETED


class Prediction:
    """Predicts samples of a model at `times` (k,) [s] from now, under a heating whose level j holds from ``edges[j]`` to
    ``edges[j + 1]`` [s] from now (levels + 1,).

    Edges but the first, 0, must be among the times, and the last be the last of them. `tolerance` is that of a step,
    relative to the usual changes of the states. Raises UserError for a structure that more than a single heating command
    moves.
    """

    def __init__(self, model: Model, edges: Sequence[float], times: Sequence[float], tolerance: float) -> None:
        structure = model.structure
        if not structure.has_one_command or not structure.coordinates or structure.segments > 1:
            raise UserError(
                f'system = {structure.name}: it is not moved by one heating command alone; expected a structure such as '
                'module, lever, slider or coil'
            )
        self.edges, self.times = np.asarray(edges, dtype=float), np.asarray(times, dtype=float)
        self._begins = np.r_[0.0, self.times]  # of stretches, and the end of the last one
        self._level = np.searchsorted(self.edges[:-1], self._begins + 1e-9, side='right') - 1  # of each stretch
        self._uses_time = model.uses_time
        self._antagonistic, wires = model.compiled.antagonistic, model.wires
        self._sides = np.array([1.0, -1.0] if self._antagonistic else [1.0])
        self._tangents: Tangents | None = None
        self.follow(model)
        self._work = new_work(model)._replace(u=np.zeros(wires + 1), weight=tolerance * model.scales)
        self._limits = Limits(np.inf, MAX_STEPS, stall_step(model))
        count, k, size = self.levels, len(self.times), sample_columns(structure).size
        self._integrate, self._follow = (package_compiler().function(one) for one in (integrate, follow_samples))
        empty, written = np.zeros(0), np.zeros(1, dtype=np.int64)
        self._silent = Log(np.zeros((0, 0)), empty, written, np.zeros((0, 3)), NO_NUMBERS)
        self._log = Log(np.zeros((k, size)), np.zeros(k), np.zeros(1, dtype=np.int64), np.zeros((0, 3)), NO_NUMBERS)
        self._rows = np.zeros((k, 1 + count, size))

    def follow(self, model: Model) -> None:
        """Predict another model of the same structure and effects from now on, such as one whose parameters have moved."""
        self.model = model
        # Wires are heated each for itself: of an antagonistic pair, part of the power may be that of one wire alone.
        self._p = own_scratch(model.compiled._replace(antagonistic=False))
        same, keep = own_scratch(self._p), package_compiler().function(pin_system)
        self._records = pinned_systems([same] * self.levels, keep, is_interpreted())
        if self._tangents is not None:
            self._tangents = self._tangents._replace(systems=self._records.addresses)

    @property
    def levels(self) -> int:
        """How many levels the heating has."""
        return len(self.edges) - 1

    def heating(self, J: Vector, gains: Vector) -> Matrix:
        """Heating of the wires (..., wires) [W] by commands (...,) [W], each times its gain (wires,)."""
        found: Matrix = np.maximum(J[..., None] * self._sides, 0.0) * gains
        return found

    def samples(self, time: float, run: Run, J: Vector, gains: Vector, T_E: float) -> Matrix:
        """Samples (k, size), where `solver.columns.sample_columns` says, from the state `run` at `time` [s] on.

        Under the levels J (levels,) [W], of which each wire gets so many times as `gains` (wires,) say, at T_E [K]. Raises
        SimulationError where the run cannot go on.
        """
        log = self._log
        log.times[:] = time + self.times
        log.written[0] = 0
        self._run(self._integrate, time, run, J, gains, T_E, log)
        return log.samples.copy()

    def with_derivatives(self, time: float, run: Run, J: Vector, gains: Vector, T_E: float) -> tuple[Matrix, Arrays]:
        """The same, and the derivatives in the levels (k, size, levels) [1/W]: at J = 0 those towards J > 0."""
        a = self._prepared(run, J, gains)
        self._run(self._follow, time, run, J, gains, T_E, self._silent, a, self._rows)
        samples = self._rows[:, 0].copy()
        return samples, ((self._rows[:, 1:] - samples[:, None]) / DELTA).transpose(0, 2, 1)

    def _run(self, call: Any, time: float, run: Run, J: Vector, gains: Vector, T_E: float, log: Log, *more: Any) -> None:
        values = np.full((len(self._begins), len(gains) + 1), T_E)
        values[:, :-1] = self.heating(J, gains)[self._level]
        stretches = InputStretches(time + self._begins, values, np.zeros(values.shape), self._uses_time)
        own = copy_of_run(self.model, run)
        own.control[C_H] = FIRST_STEP
        status = call(stretches, own, self._p, self._work, self._limits, log, *more)
        if status != COMPLETED:
            raise SimulationError(f'a prediction ended: {stop_reason(status, self.model, own)}')

    def _prepared(self, run: Run, J: Vector, gains: Vector) -> Tangents:
        """Tangents at the beginning: nothing has moved yet."""
        a = self._tangents = self._tangents or self._new_tangents(run)
        slopes = np.stack([J >= 0.0, -1.0 * (J < 0.0)], axis=-1) if self._antagonistic else np.ones((len(J), 1))
        stretches, levels = np.arange(len(self.times)), self._level[:-1]
        a.value_shift[:] = 0.0
        a.value_shift[stretches, levels, :-1] = (slopes * gains)[levels]
        a.s[:], a.r[:], a.shift[:] = 0.0, 0.0, 0.0
        return a

    def _new_tangents(self, run: Run) -> Tangents:
        values = np.zeros((len(self.times), padded(self.levels), self.model.wires + 1))
        return held_input_tangents(self.model, run, self.levels, values, self._records.addresses)
