"""Where runs begin within the hysteresis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.config import Config
from sma_sim.solver.inputs import Input
from sma_sim.solver.integrate import Run
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import new_run, new_work
from sma_sim.solver.work import Work

Vector = NDArray[np.float64]


def within_hysteresis(model: Model, source: Input, start: Sequence[float], work: Work) -> Vector:
    """x_M (wires,) of a start given as parts of what a resting wire can have, from sigma_A (least) to sigma_M (most)."""
    first = np.asarray(source.values[0], float)
    least = new_run(model, first, work, np.full(model.wires, np.nan)).state.x_frozen
    most = new_run(model, first, work, np.full(model.wires, np.inf)).state.x_frozen
    return np.clip(least + np.asarray(start, float) * (most - least), 0.0, 1.0)


def with_start(config: Config, source: Input, start: Sequence[float]) -> Config:
    """The configuration with the x_M of a start given as parts of the hysteresis."""
    if not len(start):
        return config
    model = Model(config)
    x = within_hysteresis(model, source, start, new_work(model))
    initial = {f'initial.x_M_{i + 1}': float(x[i]) for i in range(len(x))}
    return replace(config, parameters={**config.parameters, **initial})


def start_of(model: Model, source: Input, start: Sequence[float], work: Work | None = None) -> Run | None:
    """Where a run with a start given as parts of the hysteresis begins; None as the configuration says.

    `work`: scratch memory of a model with the same states.
    """
    if not len(start):
        return None
    work = work or new_work(model)
    return new_run(model, np.asarray(source.values[0], float), work, within_hysteresis(model, source, start, work))
