"""Which samples a screen needs: over time those that leave every pixel as it is, of loops those where they move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.arrays import Vector


def decimated(time: Vector, values: Vector, pixels: int) -> NDArray[np.int64]:
    """Indices of the samples (k,) that draw the same line on `pixels` columns: of each the first, last, least and greatest.

    `time` increases. Samples that are NaN are left out.
    """
    known = np.flatnonzero(np.isfinite(values))
    if len(known) <= 4 * pixels:
        return known
    x, y = time[known], values[known]
    column = np.minimum((pixels * (x - x[0]) / (x[-1] - x[0])).astype(np.int64), pixels - 1)
    begin = np.concatenate([[0], np.flatnonzero(np.diff(column)) + 1])
    end = np.append(begin[1:], len(y)) - 1
    stretch = np.repeat(np.arange(len(begin)), end - begin + 1)
    kept = np.zeros(len(y), dtype=bool)
    kept[begin] = kept[end] = True
    for bound in (np.minimum.reduceat(y, begin), np.maximum.reduceat(y, begin)):
        equal = np.flatnonzero(y == bound[stretch])
        kept[equal[np.diff(stretch[equal], prepend=-1) > 0]] = True  # the first of each column
    return known[kept]


def where_it_moves(columns: Sequence[Vector], count: int) -> NDArray[np.int64]:
    """Indices of `count` samples at most, evenly spaced along the way that columns (k,) go together, each over its span.

    A wire crosses its hysteresis in a fraction of a second and rests for minutes: samples that are even in time would cut
    its corners. Columns with NaN, or that do not move, are left out.
    """
    size = len(columns[0])
    moving = [values for values in columns if np.isfinite(values).all() and np.ptp(values) > 0.0] if size else []
    if size <= count or not moving:
        return np.arange(min(size, count))
    steps = sum(np.abs(np.diff(values, prepend=values[0])) / np.ptp(values) for values in moving)
    way = np.cumsum(steps)
    found = np.flatnonzero(np.diff(np.floor((count - 2) * way / way[-1]), prepend=-1.0))
    return np.unique(np.append(found, size - 1))
