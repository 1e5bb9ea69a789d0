"""The clock of the measurement: when the sensors saw what a recording shows at a time."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.arrays import Vector
from sma_sim.solver.model import Model

Segments = tuple[Vector, NDArray[np.float64], NDArray[np.float64]]


def seen_at(model: Model, times: Vector, begin: float) -> Vector:
    """The times [s] of the command's clock at which was seen what is shown at `times` (k,); `begin` is that of the run."""
    for active in model.config.effects:
        effect = active.effect
        if effect.clock is not None:
            times = begin + np.asarray(effect.clock(times - begin, SimpleNamespace(**active.by_short_name)), float)
    return times


def held_until(segments: Segments, times: Vector) -> Segments:
    """The stretches of an input (`solver.inputs.segments`), the last values held up to the last of some times [s]."""
    ends, values, slopes = segments
    if not len(times) or times[-1] <= ends[-1]:
        return segments
    if len(ends) > 1 and not slopes[-2:].any() and np.array_equal(values[-1], values[-2]):
        return np.append(ends[:-1], times[-1]), values, slopes
    return np.append(ends, times[-1]), np.vstack([values, values[-1:]]), np.vstack([slopes, slopes[-1:]])
