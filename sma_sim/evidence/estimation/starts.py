"""Where runs begin within the hysteresis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sma_sim.model.config import Config
from sma_sim.solver.inputs import Input
from sma_sim.solver.integrate import Run
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import new_run, new_work
from sma_sim.solver.work import Work


def with_start(config: Config, source: Input, start: Sequence[float]) -> Config:
    """The configuration with the x_M of a start given as parts of the hysteresis."""
    run = start_of(Model(config), source, start)
    if run is None:
        return config
    initial = {f'initial.x_M_{i + 1}': float(x) for i, x in enumerate(run.state.x_frozen)}
    return config.variant(initial)


def start_of(model: Model, source: Input, start: Sequence[float], work: Work | None = None) -> Run | None:
    """Where a run with a start given as parts of the hysteresis begins; None as the configuration says.

    `work`: scratch memory of a model with the same states.
    """
    if not len(start):
        return None
    return new_run(model, np.asarray(source.values[0], float), work or new_work(model), parts=start)
