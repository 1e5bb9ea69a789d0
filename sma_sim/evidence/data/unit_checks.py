"""Columns of files and arrays of recordings that cannot be in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sma_sim.evidence.data.stated_units import in_yaml, unit_of
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.model.expected_units import MAX_DURATION, SLOW_STEP, mismatch_of

NONE_LIKE: Mapping[str, str] = {}
JUMP = 1e3  # times as long as all other steps together, a step is a clock that was set, in whatever unit
OUTERMOST = 0.02  # of an array, to either side, that may be outliers


def check_unit(path: Path, name: str, values: Vector, column: str, like: Mapping[str, str] = NONE_LIKE) -> None:
    """Raise UserError where the numbers (k,), NaN where missing, cannot be in the unit that `name` ends with.

    `column`: where they come from in the file; `like`: those of quantities like it, by name, that may be in that unit too.
    """
    if mismatch := mismatch_of(name, values):
        check_mark(path, name, values)
        line, *others = (
            f'{one}: {{column: {in_yaml(of)}, {mismatch.conversion}}}' for one, of in ({name: column} | dict(like)).items()
        )
        too = f'; is the same true of others? {"; ".join(others)}' if others else ''
        raise UserError(f'{path}, column {name}: {mismatch.words}; a map (--map) can convert: {line}{too}')


def check_mark(path: Path, name: str, values: Vector) -> None:
    """Raise UserError where one of the values (k,), far from others, is no number of the unit of `name`: it marks gaps."""
    known = values[np.isfinite(values)]
    for mark in (known.min(), known.max()):
        rest = known[known != mark]
        count = len(known) - len(rest)
        is_far = count < len(rest) and np.abs(rest - mark).min() > np.ptp(rest) > 0.0
        if is_far and unit_of(name) not in ('s', 'W') and mismatch_of(name, rest) is None:  # a command has levels
            raise UserError(
                f'{path}, column {name}: {mark:g} in {count} rows is no value in {unit_of(name)}, all others are; where it '
                f'stands for none, leave these cells empty'
            )


def check_clock_set(path: Path, column: str, time: Vector) -> None:
    """Raise UserError where times (k,) [s] go on for minutes, but for one jump of months: the clock was set."""
    steps = np.diff(time)
    at = int(np.argmax(steps))
    rest = time[-1] - time[0] - steps[at]
    if steps[at] > max(MAX_DURATION, JUMP * rest) and rest > 0.0:
        raise UserError(
            f'{path}, column {column}: expected times that go on, got {time[at]:.12g} s and then {time[at + 1]:.12g} s: the '
            f'clock was set there; delete the {at + 1} rows before, or split the file'
        )


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
