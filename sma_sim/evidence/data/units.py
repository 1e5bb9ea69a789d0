"""Columns of files and arrays of recordings that cannot be in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sma_sim.evidence.data.stated_units import in_yaml
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.model.unit_mismatch import SLOW_STEP, mismatch_of

NONE_LIKE: Mapping[str, str] = {}
OUTERMOST = 0.02  # of an array, to either side, that may be outliers


def check_unit(path: Path, name: str, values: Vector, column: str, like: Mapping[str, str] = NONE_LIKE) -> None:
    """Raise UserError where the numbers (k,), NaN where missing, cannot be in the unit that `name` ends with.

    `column`: where they come from in the file; `like`: those of quantities like it, by name, that may be in that unit too.
    """
    if mismatch := mismatch_of(name, values):
        line, *others = (
            f'{one}: {{column: {in_yaml(of)}, {mismatch.conversion}}}' for one, of in ({name: column} | dict(like)).items()
        )
        too = f'; is the same true of others? {"; ".join(others)}' if others else ''
        raise UserError(f'{path}, column {name}: {mismatch.words}; a map (--map) can convert: {line}{too}')


def array_mismatch(name: str, values: Vector, measured: bool = True) -> str:
    """What is wrong with the unit of an array (k,), NaN where missing, and what converts it; empty where nothing is.

    The outermost values of what is `measured` may be outliers, of which files are rid.
    """
    known = np.sort(values[np.isfinite(values)])
    if measured and (few := int(OUTERMOST * len(known))):
        known = known[few:-few]
    mismatch = mismatch_of(name, known)
    if mismatch is None:
        return ''
    kind, _, number = mismatch.conversion.partition(': ')
    return f'{mismatch.words}; {"add" if kind == "offset" else "multiply by"} {number}'


def slow_sampling(time: Vector) -> list[str]:
    """A note where a module is sampled so slowly that its time may be in milliseconds."""
    step = float(np.median(np.diff(time)))
    return [f'a sample every {step:g} s: is time_s in seconds?'] if step > SLOW_STEP else []
