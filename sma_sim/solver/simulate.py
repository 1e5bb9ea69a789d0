"""From parameters and an input to a trajectory: the Python interface of the simulator."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.automaton import EDGES, GUARD_NAMES
from sma_sim.model.effects.ports import S_SIZE, EffectTable
from sma_sim.model.parameters import DEFAULTS, beam_constants, wire_constants
from sma_sim.model.system import O_SIZE, System
from sma_sim.solver.compile import package_compiler
from sma_sim.solver.equilibrium import start
from sma_sim.solver.integrate import (
    C_H,
    C_LAST_JUMP,
    C_SIZE,
    COMPLETED,
    N_CHATTER,
    N_JUMPS,
    N_REJECTED,
    N_SIZE,
    N_STEPS,
    PER_WIRE,
    REASONS,
    SAMPLE_SIZE,
    Y_SENSED,
    Y_WIRE,
    Limits,
    Run,
    integrate,
)  # fmt: skip
from sma_sim.solver.stepper import Work

Vector = NDArray[np.float64]


class SimulationError(Exception):
    """A run that cannot be started, with the reason for a person to read."""


@dataclass(frozen=True)
class Input:
    """A piecewise linear input. `values` (k, 2): module J_eq [W], T_E [K]; (k, 3): wire strain, J [W], T_E [K].

    A column holds its value until the next time, or runs linearly to the next value where `linear` says so.
    """

    times: Vector
    values: NDArray[np.float64]
    linear: tuple[bool, ...]


@dataclass(frozen=True)
class Jump:
    """One jump of the hybrid-time log: at (t, j) wire `wire` left mode `source` for `target` through `guard`."""

    t: float
    j: int
    wire: int
    guard: str
    source: int
    target: int


@dataclass(frozen=True)
class Trajectory:
    """Samples of a run: `time` (k,) and the named columns of the file contract, each (k,)."""

    time: Vector
    columns: dict[str, Vector]
    jumps: tuple[Jump, ...]
    reason: str
    completed: bool
    steps: int
    rejected: int
    chattering: int

    def __getitem__(self, name: str) -> Vector:
        return self.columns[name]


@dataclass(frozen=True)
class Model:
    """A model ready to run: parameters by name (``wire.E_A``, ...), the system and its kinetics."""

    parameters: dict[str, float]
    system: str = 'module'
    model: str = 'hybrid'

    @cached_property
    def compiled(self) -> System:
        """What the compiled flow reads."""
        module, mas = self.system == 'module', self.model == 'mas'
        wires = 2 if module else 1
        first_T = 6 if module else 0
        wire, beam = wire_constants(self.parameters), beam_constants(self.parameters)
        empty = np.zeros(0, dtype=np.int64)
        table = EffectTable(
            port_start=np.zeros(8, dtype=np.int64), value=empty, rate=empty, start=empty, states=empty,
            state_start=empty, channels=empty, depends_on_x=empty, parameter_start=empty,
            parameters=np.zeros(0), s=np.zeros(S_SIZE), wire=np.array(wire), beam=np.array(beam), out=np.zeros(8),
        )  # fmt: skip
        return System(module, mas, wires, first_T, first_T + wires, wire, beam, table)

    @property
    def size(self) -> int:
        """Number of continuous states."""
        p = self.compiled
        return p.first_x + (p.wires if p.mas else 0)

    def scales(self) -> Vector:
        """The size of every state, for the error control and the difference steps."""
        p = self.compiled
        L = p.beam.L
        pose = [1e-3 * L, 0.01 * L, 0.15] if p.module else []
        rates = [s / RATE_TIME for s in pose]
        return np.array(pose + rates + [30.0] * p.wires + [0.5] * (p.wires if p.mas else 0))


RATE_TIME = 2e-3  # the time in which the pose is taken to change by its own size [s]
DIFFERENCE = 1e-7  # difference steps relative to the scales


def defaults() -> dict[str, float]:
    """The paper's parameters, by name."""
    return {name: parameter.default for name, parameter in DEFAULTS.items()}


def new_work(model: Model) -> Work:
    """Scratch memory for the runs of a model."""
    n, p = model.size, model.compiled
    scales = model.scales()
    return Work(
        jacobian=np.zeros((n, n)), matrix=np.zeros((n, n)), pivot=np.zeros(n, dtype=np.int64), f=np.zeros(n),
        f_t=np.zeros(n), f_stage=np.zeros(n), y_stage=np.zeros(n), u=np.zeros(2 if p.module else 3),
        stages=np.zeros((6, n)), y_new=np.zeros(n), y_dense=np.zeros(n), k=np.zeros((2, n)),
        increment=DIFFERENCE * scales, weight=model.parameters['solver.rtol'] * scales,
        obs=np.zeros((p.wires, O_SIZE)), obs_jacobian=np.zeros((p.wires, O_SIZE)),
    )  # fmt: skip


def new_run(model: Model, first_input: Vector, work: Work) -> Run:
    """A run at its start: static equilibrium at ambient temperature, modes that admit it.

    Raises SimulationError when there is no equilibrium.
    """
    p = model.compiled
    y = np.zeros(model.size)
    u = np.array(first_input, dtype=float)
    u[0 if p.module else 1] = 0.0
    y[p.first_T : p.first_T + p.wires] = u[-1]
    wanted = np.array([model.parameters[f'initial.x_M_{i + 1}'] for i in range(p.wires)])
    if p.mas:
        y[p.first_x : p.first_x + p.wires] = np.where(np.isnan(wanted), 0.5, wanted)
    mode, x_frozen = np.zeros(p.wires, dtype=np.int64), np.zeros(p.wires)
    hybrid = p._replace(mas=False)
    if not package_compiler().function(start)(y, u, np.zeros_like(u), wanted, mode, x_frozen, hybrid, work):
        raise SimulationError('no static equilibrium of beam and wires was found; check beam.*, plate.*, wire.l0')
    if p.mas:
        y[p.first_x : p.first_x + p.wires] = x_frozen
    control = np.zeros(C_SIZE)
    control[C_H] = 1e-3
    control[C_LAST_JUMP : C_LAST_JUMP + 2] = -1.0
    return Run(y, mode, x_frozen, control, np.zeros(N_SIZE, dtype=np.int64))


def pieces(source: Input) -> tuple[Vector, Vector, Vector]:
    """Times, values and slopes of the stretches of an input, equal neighbours joined."""
    times, values = np.asarray(source.times, float), np.asarray(source.values, float)
    slopes = np.zeros_like(values)
    linear = np.array(source.linear)
    if len(times) > 1:
        slopes[:-1, linear] = (np.diff(values[:, linear], axis=0).T / np.diff(times)).T
    keep = np.ones(len(times), dtype=bool)
    if len(times) > 2:
        same = (values[1:-1] == values[:-2]).all(axis=1) & (slopes[1:-1] == 0).all(axis=1) & (slopes[:-2] == 0).all(axis=1)
        keep[1:-1] = ~same
    return times[keep], values[keep], slopes[keep]


def simulate(
    model: Model, source: Input, sample_times: Vector, max_step: float = np.inf, max_steps: int = 10_000_000
) -> Trajectory:
    """Run `model` under an input and sample it at `sample_times` (increasing, within the input's times)."""
    times, values, slopes = pieces(source)
    work = new_work(model)
    run = new_run(model, values[0], work)
    samples = np.full((len(sample_times), SAMPLE_SIZE), np.nan)
    jumps = np.zeros((100_000, 3))
    status, written = package_compiler().function(integrate)(
        times, values, slopes, False, run, model.compiled, work, Limits(max_step, max_steps), samples,
        np.asarray(sample_times, float), jumps,
    )  # fmt: skip
    return Trajectory(
        time=np.asarray(sample_times, float)[:written],
        columns=named_columns(model, samples[:written]),
        jumps=named_jumps(jumps, int(run.count[N_JUMPS])),
        reason=REASONS[status],
        completed=status == COMPLETED,
        steps=int(run.count[N_STEPS]),
        rejected=int(run.count[N_REJECTED]),
        chattering=int(run.count[N_CHATTER]),
    )


def named_columns(model: Model, samples: NDArray[np.float64]) -> dict[str, Vector]:
    """Samples by the names of the file contract."""

    def wire(i: int, column: int) -> Vector:
        return samples[:, Y_WIRE + i * PER_WIRE + column]

    if model.system == 'wire':
        return {
            'stress_Pa': samples[:, Y_SENSED + 7], 'T_K': samples[:, Y_SENSED + 8],
            'x_M': wire(0, 1), 'mode': wire(0, 7),
        }  # fmt: skip
    names = ('U_x_m', 'U_y_m', 'alpha_rad', 'F_1_N', 'F_2_N', 'T_1_K', 'T_2_K')
    columns = {name: samples[:, Y_SENSED + k] for k, name in enumerate(names)}
    for column, name in ((1, 'x_M'), (7, 'mode')):
        columns |= {f'{name}_{i + 1}': wire(i, column) for i in range(2)}
    return columns


def named_jumps(jumps: Any, count: int) -> tuple[Jump, ...]:
    """The log of jumps with names; j counts the jumps before it."""
    log = []
    for j, (t, wire, edge) in enumerate(jumps[:count]):
        taken = EDGES[int(edge)]
        log.append(Jump(float(t), j, int(wire) + 1, GUARD_NAMES[taken.guard], taken.source, taken.target))
    return tuple(log)
