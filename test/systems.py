"""Models, random states and raw runs for the tests of physics and solver."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sma_sim import Config, Model, default_parameters, find_effects
from sma_sim.compiler.compile import package_compiler
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.layout import InputPoint, SystemState
from sma_sim.model.material import fraction_at_stress, sigma_A, sigma_M
from sma_sim.model.system import flow
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.inputs import segments
from sma_sim.solver.integrate import (
    PER_WIRE,
    WIRE_COLUMNS,
    InputStretches,
    Limits,
    Log,
    integrate,
)
from sma_sim.solver.model import new_findings
from sma_sim.solver.simulate import new_run, new_work

COMBINATIONS = [(system, kind) for system in ('wire', 'module') for kind in ('hybrid', 'mas')]


def active(name, found=None, **values):
    """An effect at its defaults, or at the given values."""
    effect = (found or find_effects())[name]
    return ActiveEffect(effect, tuple(values.get(p.name, p.default) for p in effect.parameters))


def make_model(system='module', kind='hybrid', effects=(), **parameters):
    """A model with the paper's values; parameters as group__name=value."""
    given = {name.replace('__', '.'): value for name, value in parameters.items()}
    return Model(Config(default_parameters() | given, system, kind, tuple(effects)))


class State(NamedTuple):
    """One state of a model with its input, and what the flow makes of it."""

    y: np.ndarray
    u: np.ndarray
    du: np.ndarray
    mode: np.ndarray
    x_frozen: np.ndarray
    dy: np.ndarray
    obs: np.ndarray


def evaluate(model, y, u, du, mode, x_frozen, t=0.0):
    """The flow in plain Python."""
    p = model.compiled
    dy, obs = np.zeros(len(y)), new_findings(p)
    flow(t, SystemState(y, mode, x_frozen), InputPoint(u, du), p, dy, obs)
    return State(y, u, du, mode, x_frozen, dy, obs)


def random_state(model, random, mode=None):
    """A random state in the given (or random) modes at which the wires have fractions between 0 and 1."""
    p, w = model.compiled, model.compiled.wire
    while True:
        y = np.zeros(len(model.scales))
        if p.coordinates:
            y[:3] = random.uniform(-1.0, 1.0, 3) * [3e-4, 3e-3, 0.2]
            y[3:6] = random.uniform(-1.0, 1.0, 3) * [1e-2, 5e-2, 1.0]
            u, du = np.array([random.uniform(-30, 30), random.uniform(280, 320)]), np.zeros(2)
            strains = [0.045, 0.045]
        else:
            strains = [random.uniform(0.005, 0.07)]
            u = np.array([strains[0], random.uniform(0, 2), random.uniform(280, 320)])
            du = np.array([random.uniform(-0.05, 0.05), 0.0, 0.0])
        y[p.first_T : p.first_T + p.wires] = random.uniform(290, 380, p.wires)
        modes = np.full(p.wires, mode) if mode else random.integers(1, 6, p.wires)
        x = np.where(modes == 1, 0.0, np.where(modes == 2, 1.0, random.uniform(0.01, 0.99, p.wires)))
        if p.mas:
            y[p.first_x : p.first_x + p.wires] = random.uniform(0.0, 1.0, p.wires)
        n = p.first_T + p.wires * (2 if p.mas else 1)
        y[n:] = random.uniform(-0.5, 0.5, len(y) - n) * model.scales[n:]
        T = y[p.first_T : p.first_T + p.wires]
        bounds = [fraction_at_stress(e, s(t, w), w) for e, t in zip(strains, T, strict=True) for s in (sigma_A, sigma_M)]
        if p.mas or (min(bounds) > 0.02 and max(bounds) < 0.98):
            return evaluate(model, y, u, du, modes.astype(np.int64), x)


WHOLE_ROWS = np.zeros(0, dtype=np.int64)


class RawRun(NamedTuple):
    """All that the solver samples: pose (k, 3), its rates, and per wire a dict of columns."""

    pose: np.ndarray
    rates: np.ndarray
    wires: list
    jumps: np.ndarray
    status: int
    steps: int
    y: np.ndarray


def new_log(where, sample_times=()):
    """Room for samples of whole rows at these times, and for jumps."""
    times = np.asarray(sample_times, float)
    return Log(
        np.full((len(times), where.size), np.nan), times, np.zeros(1, dtype=np.int64), np.zeros((10_000, 3)), WHOLE_ROWS
    )


def raw_run(model, source, sample_times, max_step=np.inf, max_steps=10_000_000):
    """Run and keep every column of the samples."""
    stretches = InputStretches(*segments(source), model.uses_time)
    work = new_work(model)
    run = new_run(model, stretches.values[0], work)
    where = sample_columns(model.structure)
    log = new_log(where, sample_times)
    samples, jumps = log.samples, log.jumps
    status = package_compiler().function(integrate)(
        stretches, run, model.compiled, work, Limits(max_step, max_steps, 0.0), log
    )
    wires = [dict(zip(WIRE_COLUMNS, samples[:, where.wires][:, i * PER_WIRE :].T, strict=False)) for i in range(model.wires)]
    pose, rates = samples[:, where.pose], samples[:, where.rates]
    return RawRun(pose, rates, wires, jumps[: run.count[3]], status, int(run.count[0]), run.state.y)


def rest_state(model, T, u, du, mode, x):
    """A state of a wire on the test bench."""
    y = np.array([T, x] if model.compiled.mas else [T])
    return evaluate(model, y, np.array(u), np.array(du), np.array([mode]), np.array([x]))


def smooth_state(model, J_eq, after):
    """A structure some time after its heating was switched on, when the fast motion is gone."""
    u = np.append(np.full(len(model.structure.commands), J_eq), 298.0)
    work = new_work(model)
    run = new_run(model, u, work)
    stretches = InputStretches(np.array([0.0, after]), np.array([u, u]), np.zeros((2, len(u))), False)
    log = new_log(sample_columns(model.structure))
    package_compiler().function(integrate)(stretches, run, model.compiled, work, Limits(np.inf, 10_000_000, 0.0), log)
    y, mode, x_frozen = run.state
    return evaluate(model, y, u, np.zeros(len(u)), mode, x_frozen)
