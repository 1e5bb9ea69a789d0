"""Which samples of a curve a screen needs: those that leave every pixel as it is with all of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


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
    found: NDArray[np.int64] = known[kept]
    return found
