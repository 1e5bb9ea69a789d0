"""A run that goes on from state to state, each time with the derivatives of its end in its beginning: what a filter needs.

The unknowns are, in this order, the states of the flow in units of `Model.scales`; the frozen fractions x_M of the wires, in
units of FRACTION_SCALE; those that move the equations, such as parameters; by which part the heating of each wire is more
than was said; the ambient temperature [K]. The derivatives are the tangents of `solver.tangents`: they pass over the jumps
of the hybrid model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.compiler.compile import is_interpreted, package_compiler
from sma_sim.compiler.pinned_systems import pin_system, pinned_systems, record_at
from sma_sim.model.automaton import INNER
from sma_sim.model.errors import UserError
from sma_sim.model.layout import System, SystemState
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.effect_table import own_scratch
from sma_sim.solver.end_of_run import stop_reason
from sma_sim.solver.integrate import (
    C_H,
    COMPLETED,
    N_STEPS,
    PER_WIRE,
    WIRE_COLUMNS,
    InputStretches,
    Limits,
    Log,
    Run,
    observe,
)
from sma_sim.solver.model import Model
from sma_sim.solver.sensitivities import new_tangents, padded
from sma_sim.solver.simulate import SimulationError, new_run, new_work, stall_step
from sma_sim.solver.stepper import Segment
from sma_sim.solver.tangent_nodes import Tangents, move_along
from sma_sim.solver.tangents import follow
from sma_sim.solver.work import Work

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
FRACTION_SCALE = 0.1  # of a frozen fraction
DELTA = 1e-6  # by which an unknown is moved for its derivatives
MAX_STEPS = 20_000  # of one call
# Of the usual changes of pose and rates, and of the other states, the errors of a step. A correction of the state lets the
# structure vibrate a little; steps longer than a vibration then damp it, as the method is L-stable.
POSE_TOLERANCE, TOLERANCE = 0.05, 1e-4
NO_NUMBERS = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Unknowns:
    """Where each kind of unknown stands among all of them."""

    states: slice
    fractions: slice
    parameters: slice
    heating: slice
    T_E: int

    @property
    def count(self) -> int:
        """How many there are."""
        return self.T_E + 1


def observe_beside(t: float, run: Run, segment: Segment, p: System, w: Work, a: Tangents, rows: Matrix) -> None:
    """Samples (1 + unknowns, size) at a state, and beside it along the tangent of each unknown.

    Where rows have room for them (size + coordinates), accelerations follow.
    """
    observe_with_accelerations(t, run.state, segment, p, w, rows[0])
    for j in range(a.systems.shape[0]):
        observe_with_accelerations(t, move_along(j, run.state, a), segment, record_at(a.systems[j], p), w, rows[j + 1])


def observe_with_accelerations(t: float, state: SystemState, segment: Segment, p: System, w: Work, row: Vector) -> None:
    """A sample, and behind it the accelerations where its row has room for them."""
    observe(t, state, segment, p, w, row)
    n = p.coordinates
    first = 3 * n + PER_WIRE * p.wires + p.channels
    for i in range(row.shape[0] - first):
        row[first + i] = w.sample.dy[n + i]


def run_at_rest(model: Model, T_E: float) -> Run:
    """A run of a model at rest at T_E [K]. Raises SimulationError where there is none."""
    u = np.zeros(len(model.structure.input_columns))
    u[-1] = T_E
    return new_run(model, u, new_work(model))


class Propagation:
    """Runs of a model from any state, under heating of each wire (W, of all wires of a bundle) and T_E [K].

    `neighbours` are the model with each parameter moved by DELTA of its unit. `scales` (n,) are the units of the states,
    where not those of the model. Raises UserError for a structure without tangents: a wire on a test bench, and segments in
    series.
    """

    def __init__(self, model: Model, neighbours: Sequence[Model], scales: Vector | None = None) -> None:
        structure = model.structure
        if not structure.coordinates or structure.segments > 1 or structure.drives:
            raise UserError(
                f'system = {structure.name}: derivatives of its runs are not known; expected a structure with coordinates, '
                'without segments in series, such as module, lever, slider or spatial'
            )
        self.model = model
        self.scales = model.scales if scales is None else scales
        self.where = sample_columns(structure)
        n, wires, P = len(self.scales), model.wires, len(neighbours)
        first = n + wires + P
        self.unknowns = Unknowns(
            slice(0, n), slice(n, n + wires), slice(n + wires, first), slice(first, first + wires), first + wires
        )
        self._uses_time, self._unit_states = model.uses_time, np.diag(self.scales)
        self._of_wires = np.arange(wires)
        weight = TOLERANCE * self.scales
        weight[: 2 * len(structure.coordinates)] *= POSE_TOLERANCE / TOLERANCE
        self._work = new_work(model)._replace(u=np.zeros(wires + 1), weight=weight)
        self._p = own_scratch(model.compiled._replace(antagonistic=False))
        moved = [own_scratch(one.compiled._replace(antagonistic=False)) for one in neighbours]
        same = own_scratch(self._p)
        systems = [same] * (n + wires) + moved + [same] * (wires + 1)
        self._records = pinned_systems(systems, package_compiler().function(pin_system), is_interpreted())
        self._systems = systems
        self._hybrid: Any = None  # the same with hybrid kinetics, pinned once they are asked for
        self._rows = np.zeros((1 + len(systems), self.where.size + len(structure.coordinates)))
        self._limits = Limits(np.inf, MAX_STEPS, stall_step(model))
        self._follow, self._observe = (package_compiler().function(one) for one in (follow, observe_beside))
        self._tangents: dict[int, Tangents] = {}  # by how many stretches the input has
        empty = np.zeros(0)
        self._log = Log(np.zeros((0, 0)), empty, np.zeros(1, dtype=np.int64), np.zeros((0, 3)), NO_NUMBERS)

    def _prepared(self, run: Run, inputs: Matrix) -> Tangents:
        """Tangents at the beginning: of every unknown of the state, along itself."""
        rows = len(inputs)
        if rows not in self._tangents:
            self._tangents[rows] = self._new_tangents(run, rows)
        a, at = self._tangents[rows], self.unknowns
        wires = self._of_wires
        a.value_shift[:, at.heating.start + wires, wires] = inputs[:, :-1]
        a.s[:] = 0.0
        a.r[:] = 0.0
        a.shift[:] = 0.0
        a.s[:, at.states] = self._unit_states
        a.r[wires, at.fractions.start + wires] = FRACTION_SCALE * (run.state.mode == INNER)
        return a

    def _new_tangents(self, run: Run, rows: int) -> Tangents:
        values = np.zeros((rows, padded(self.unknowns.count), self.model.wires + 1))
        values[:, self.unknowns.T_E, -1] = 1.0
        return held_input_tangents(self.model, run, self.unknowns.count, values, self._records.addresses)

    def advance(self, run: Run, times: Vector, inputs: Matrix) -> Matrix:
        """Carry `run` over the stretches from one of `times` (k + 1,) [s] to the next under held `inputs` (k, wires + 1).

        Returns the derivatives (unknowns, unknowns) of the end in the beginning; what is no state stays. Raises
        SimulationError where the run cannot go on.
        """
        a, at = self._prepared(run, inputs), self.unknowns
        values = np.vstack([inputs, inputs[-1:]])
        stretches = InputStretches(times, values, np.zeros_like(values), self._uses_time)
        run.count[N_STEPS] = 0
        run.control[C_H] = max(run.control[C_H], 1e-6)
        self._log.written[0] = 0
        status = self._follow(stretches, run, self._p, self._work, self._limits, self._log, a)
        if status != COMPLETED:
            raise SimulationError(f'the run ended: {stop_reason(status, self.model, run)}')
        found = np.eye(at.count)
        found[at.states] = a.s[:, : at.count] / self.scales[:, None]
        inner = run.state.mode == INNER
        found[at.fractions] = np.where(inner[:, None], a.r[:, : at.count] / FRACTION_SCALE, 0.0)
        return found

    def observe(self, t: float, run: Run, u: Vector) -> tuple[Vector, Matrix]:
        """A sample (size,) at the state of `run`, where `solver.columns.sample_columns` says, and its derivatives (size,
        unknowns)."""
        return self._look(t, run, u, self._p, self._prepared(run, u[None]), slice(0, self.where.size))

    def accelerations(self, t: float, run: Run, u: Vector) -> tuple[Vector, Matrix]:
        """Those of the coordinates (n,) at the state of `run` [SI], and their derivatives (n, unknowns)."""
        return self._look(t, run, u, self._p, self._prepared(run, u[None]), slice(self.where.size, None))

    def fractions_of_transforming(self, t: float, run: Run, u: Vector, mode: int) -> tuple[Vector, Matrix]:
        """x_M (wires,) with which wires of the pose and temperatures of `run` transform in `mode` 4 or 5 of the hybrid
        automaton, also of MAS kinetics, and its derivatives (wires, unknowns). It is less than 0 or more than 1 where none
        can. The modes of `run` are changed."""
        run.state.mode[:] = mode
        a, first = self._prepared(run, u[None]), self.where.wires.start + WIRE_COLUMNS.index('x_M')
        if self._p.mas:
            if self._hybrid is None:
                systems = [own_scratch(one._replace(mas=False)) for one in self._systems]
                self._hybrid = pinned_systems(systems, package_compiler().function(pin_system), is_interpreted())
            a = a._replace(systems=self._hybrid.addresses)
        return self._look(t, run, u, self._p._replace(mas=False), a, slice(first, self.where.wires.stop, PER_WIRE))

    def _look(self, t: float, run: Run, u: Vector, p: System, a: Tangents, columns: slice) -> tuple[Vector, Matrix]:
        segment = Segment(t, t, u, np.zeros_like(u), False)
        self._observe(t, run, segment, p, self._work, a, self._rows)
        sample = self._rows[0, columns].copy()
        return sample, ((self._rows[1:, columns] - sample) / DELTA).T


def held_input_tangents(model: Model, run: Run, count: int, values: NDArray[np.float64], systems: Any) -> Tangents:
    """Room for the tangents of a run in `count` unknowns, under inputs that are held and move by `values` (stretches, padded
    count, wires + 1) with them."""
    rows, width, columns = values.shape
    none: Any = NO_NUMBERS
    return new_tangents(
        model,
        run,
        (0, count, 0),
        numbers=none,
        direct=none,
        timed=none,
        systems=systems,
        delta=DELTA,
        row_shift=np.zeros((rows + 1, width)),
        value_shift=values,
        slope_shift=np.zeros_like(values),
        moved_u=np.zeros(columns),
        moved_du=np.zeros(columns),
        s=np.zeros((len(model.scales), width)),
        r=np.zeros((model.wires, width)),
    )
