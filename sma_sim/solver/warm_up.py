"""Compiles the equations ahead of their use, so that nothing else has to wait for it."""

from __future__ import annotations

import numpy as np

from sma_sim.model.config import Config
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.inputs import module_input
from sma_sim.solver.model import Model
from sma_sim.solver.sensitivities import Neighbour, simulate_with_tangents
from sma_sim.solver.simulate import new_run, new_work, simulate


def compile_simulation() -> None:
    """Compile, or load, what simulates an input."""
    simulate(Model(Config()), module_input([0.0, 0.01], [0.0, 0.0]), 100.0)


def compile_tangents() -> None:
    """Compile, or load, what gives fits their derivatives."""
    model, source = Model(Config()), module_input([0.0, 0.01], [0.0, 0.0])
    initial_run = new_run(model, source.values[0], new_work(model))
    simulate_with_tangents(model, source, 100.0, initial_run, model.structure.channels, (Neighbour(),))


def compile_fixed_rate() -> None:
    """Compile, or load, what makes the steps of the nodes."""
    FixedRateRun(Model(Config()), 1000.0, np.array([0.0, 298.0]))
