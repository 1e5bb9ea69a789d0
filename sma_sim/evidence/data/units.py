"""Numbers that cannot be in the unit that their column's name says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sma_sim.evidence.data.cells import Vector
from sma_sim.model.errors import UserError

LONGEST_RUN = 1e7  # [s]
SLOW_STEP = 2.0  # [s] wires heat and cool faster
COLDEST, HOTTEST = 150.0, 2000.0  # [K]
LARGEST = {'U': 0.5, 'strain': 0.5, 'J': 2e3}  # [m], [-], [W]
OFFSET_PART = 0.02  # of the largest heating: a power meter's offset
LEAST_STRESS, MOST_STRESS = 1e4, 1e11  # [Pa]
KELVIN = 'offset: 273.15'


class Complaint(NamedTuple):
    """What a column was expected to hold, the number that does not fit, what it looks like and how a map mends that."""

    expected: str
    number: float
    looks: str
    mend: str


def angle(values: Vector) -> Complaint | None:
    """Radians up to a half turn."""
    top = float(np.abs(values).max())
    return Complaint('radians up to pi', top, 'degrees', 'scale: 0.017453292519943295') if top > np.pi else None


def temperature(values: Vector) -> Complaint | None:
    """Kelvin at which a shape-memory alloy can be."""
    middle = float(np.median(values))
    if middle < COLDEST:
        return Complaint(f'kelvin, at least {COLDEST:g}', middle, 'degrees Celsius', KELVIN)
    wrong = values[(values > HOTTEST) | (values <= 0.0)]
    return Complaint(f'kelvin, at most {HOTTEST:g}', float(wrong[0]), 'another unit', 'scale: 0.001') if len(wrong) else None


def displacement(values: Vector) -> Complaint | None:
    """Metres of a small robot."""
    top = float(np.abs(values).max())
    return Complaint('metres, less than 0.5', top, 'millimetres', 'scale: 0.001') if top > LARGEST['U'] else None


def strain(values: Vector) -> Complaint | None:
    """A fraction."""
    top = float(np.abs(values).max())
    return Complaint('a fraction such as 0.05', top, 'percent', 'scale: 0.01') if top > LARGEST['strain'] else None


def power(values: Vector) -> Complaint | None:
    """Watts."""
    top = float(np.abs(values).max())
    return Complaint(f'watts, at most {LARGEST["J"]:g}', top, 'milliwatts', 'scale: 0.001') if top > LARGEST['J'] else None


def heating(values: Vector) -> Complaint | None:
    """Watts into a wire, which cannot be negative."""
    least = float(values.min())
    if least < -OFFSET_PART * max(float(values.max()), 0.0):
        return Complaint('heating, not negative', least, 'the wrong sign', 'scale: -1')
    return power(values)


def stress(values: Vector) -> Complaint | None:
    """Pascal of a loaded wire."""
    top = float(np.abs(values).max())
    if 0.0 < top < LEAST_STRESS:
        return Complaint(f'pascal, {LEAST_STRESS:g} at least in a loaded wire', top, 'megapascal', 'scale: 1e6')
    return Complaint('pascal', top, 'another unit', 'scale: 1e-6') if top > MOST_STRESS else None


CHECKS: dict[str, Callable[[Vector], Complaint | None]] = {
    'J_eq_W': power, 'J_W': heating, 'T_E_K': temperature, 'strain': strain, 'U_x_m': displacement, 'U_y_m': displacement,
    'alpha_rad': angle, 'T_1_K': temperature, 'T_2_K': temperature, 'stress_Pa': stress, 'T_K': temperature,
}  # fmt: skip


def check_unit(path: Path, name: str, values: Vector) -> None:
    """Raise UserError where the numbers (k,), NaN where missing, cannot be in the unit that `name` ends with."""
    known = values[np.isfinite(values)]
    if name not in CHECKS or len(known) == 0:
        return
    complaint = CHECKS[name](known)
    if complaint:
        raise UserError(
            f'{path}, column {name}: expected {complaint.expected}, got {complaint.number:g}, which looks like '
            f'{complaint.looks}; a map (--map) can convert: {name}: {{column: {name}, {complaint.mend}}}'
        )


def slow_sampling(time: Vector) -> list[str]:
    """A note where a module is sampled so slowly that its time may be in milliseconds."""
    step = float(np.median(np.diff(time)))
    return [f'a sample every {step:g} s: is time_s in seconds?'] if step > SLOW_STEP else []


def check_duration(path: Path, time: Vector) -> None:
    """Raise UserError for a run of months: its time is not in seconds."""
    if time[-1] - time[0] > LONGEST_RUN:
        raise UserError(
            f'{path}, column time_s: expected seconds, got a run of {time[-1] - time[0]:g} s, which looks like milli- or '
            f'nanoseconds; a map (--map) can convert: time_s: {{column: time_s, scale: 1e-9}}'
        )
