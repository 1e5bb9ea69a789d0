"""Numbers that cannot be in the unit that their column's name says."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sma_sim.model.arrays import Vector
from sma_sim.model.parameters import KELVIN

MAX_DURATION, MIN_DURATION = 1e7, 1e-3  # [s]: no run lasts four months, and no wire moves in less than milliseconds
LATEST_DATE = 1e11  # [s]: later times are in smaller units; seconds since the year 0, as MATLAB counts, are 6.4e10
DAY = 86_400.0  # [s]
FIRST_DAY, LAST_DAY = 2e4, 1e6  # [d]: spreadsheets count from 1900 (20,000 is 1954), MATLAB from the year 0 (740,000)
SLOW_STEP = 2.0  # [s]: wires heat and cool faster, so nobody samples a module so slowly
FAST_STEP = 1e-4  # [s]: wires are slower by far, so few sample them faster
SHORT_RUN = 1.0  # [s]: a wire heats in less, but does not cool
MIN_TEMPERATURE, MAX_TEMPERATURE = KELVIN  # a median below is in deg C
OFFSET_FRACTION = 0.02  # of the largest heating: a power meter's offset
MIN_STRESS, MAX_STRESS = 1e4, 1e11  # [Pa] that the largest stress of a run lies between
MAX_RESISTANCE = 2e3  # [ohm]: 1 m of the thinnest wire, of 25 um, has 1,900; usual actuators have some ohm
REACH = {'rad': np.pi, 'm': 0.5}  # what no joint, small robot or wire passes, by unit
CELSIUS_TO_KELVIN = 'offset: 273.15'


class UnitMismatch(NamedTuple):
    """What a column was expected to hold, the number that does not fit, what it looks like, what converts it in a map."""

    expected: str
    got: float | str
    looks_like: str
    conversion: str

    @property
    def words(self) -> str:
        """What does not fit."""
        got = self.got if isinstance(self.got, str) else f'{self.got:g}'
        return f'expected {self.expected}, got {got}, which looks like {self.looks_like}'


def above(limit: float, expected: str, looks_like: str, conversion: str) -> Callable[[Vector], UnitMismatch | None]:
    """The check that no number is larger than a limit, either way."""

    def mismatch(values: Vector) -> UnitMismatch | None:
        top = float(np.abs(values).max())
        return UnitMismatch(expected, top, looks_like, conversion) if top > limit else None

    return mismatch


angle_mismatch = above(REACH['rad'], 'radians up to pi', 'degrees', 'scale: 0.017453292519943295')
displacement_mismatch = above(REACH['m'], 'metres, less than 0.5', 'millimetres', 'scale: 0.001')
strain_mismatch = above(0.5, 'a fraction such as 0.05', 'percent', 'scale: 0.01')
force_mismatch = above(1e4, 'newtons, at most 10000', 'millinewtons', 'scale: 0.001')
power_mismatch = above(2e3, 'watts, at most 2000', 'milliwatts', 'scale: 0.001')


def temperature_mismatch(values: Vector) -> UnitMismatch | None:
    """Kelvin at which a shape-memory alloy can be."""
    middle = float(np.median(values))
    if middle < MIN_TEMPERATURE:
        return UnitMismatch(f'kelvin, at least {MIN_TEMPERATURE:g}', middle, 'degrees Celsius', CELSIUS_TO_KELVIN)
    wrong = values[(values > MAX_TEMPERATURE) | (values <= 0.0)]
    return (
        UnitMismatch(f'kelvin, at most {MAX_TEMPERATURE:g}', float(wrong[0]), 'another unit', 'scale: 0.001')
        if len(wrong)
        else None
    )


def heating_mismatch(values: Vector) -> UnitMismatch | None:
    """Watts into a wire, which cannot be negative."""
    least = float(values.min())
    if least < -OFFSET_FRACTION * max(float(values.max()), 0.0):
        return UnitMismatch('heating, not negative', least, 'the wrong sign', 'scale: -1')
    return power_mismatch(values)


def stress_mismatch(values: Vector) -> UnitMismatch | None:
    """Pascal of a loaded wire."""
    top = float(np.abs(values).max())
    if 0.0 < top < MIN_STRESS:
        return UnitMismatch(f'pascal, {MIN_STRESS:g} at least in a loaded wire', top, 'megapascal', 'scale: 1e6')
    return UnitMismatch('pascal', top, 'another unit', 'scale: 1e-6') if top > MAX_STRESS else None


def resistance_mismatch(values: Vector) -> UnitMismatch | None:
    """Ohm of a wire, which conducts."""
    middle = float(np.median(values))
    if 0.0 < middle <= MAX_RESISTANCE:
        return None
    looks_like = ('milliohm', 'scale: 0.001') if middle > 0.0 else ('the wrong sign', 'scale: -1')
    return UnitMismatch(f'ohm of a wire, positive and at most {MAX_RESISTANCE:g}', middle, *looks_like)


def duration_mismatch(time: Vector) -> UnitMismatch | None:
    """How times (k,) cannot be seconds: a run of months or microseconds, a date in the far future, days of a calendar."""
    if len(time) < 2:
        return None
    length, first, step = float(time[-1] - time[0]), float(time[0]), float(np.median(np.diff(time)))
    is_calendar = FIRST_DAY < first < LAST_DAY and 0.0 < step * DAY <= SLOW_STEP
    if MIN_DURATION <= length <= MAX_DURATION and first < LATEST_DATE and not is_calendar:
        return None
    if length < MIN_DURATION or is_calendar:
        got = f'times from {first:.10g} to {time[-1]:.10g}' if is_calendar else f'a run of {length:g} s'
        return UnitMismatch('seconds', got, 'days, as spreadsheets count them', f'scale: {DAY:g}')
    got = f'a run of {length:g} s' if length > MAX_DURATION else f'a date {first:g} s after 1970'
    smaller = {'milliseconds': 1e-3, 'microseconds': 1e-6, 'nanoseconds': 1e-9}
    possible = {
        unit: scale for unit, scale in smaller.items() if scale * first < LATEST_DATE and scale * step <= SLOW_STEP
    } or {'nanoseconds': 1e-9}
    (unit, scale), *finer = possible.items()

    def fits(scale: float) -> bool:
        """Whether a run in this unit is neither sampled too fast nor too short."""
        return scale * step >= FAST_STEP and scale * length >= SHORT_RUN

    usual = [(unit, scale), *(one for one in finer if first < LATEST_DATE and fits(one[1]))]
    if len(usual) == 1:
        return UnitMismatch('seconds', got, unit, f'scale: {scale:g}')
    words = ' or '.join(f'{unit} (scale: {scale:g}, a sample every {scale * step:g} s)' for unit, scale in usual)
    return UnitMismatch('seconds', got, words, 'scale: FACTOR')


CHECKS: dict[str, Callable[[Vector], UnitMismatch | None]] = {
    'time_s': duration_mismatch,
    'J_eq_W': power_mismatch,
    'J_W': heating_mismatch,
    'T_E_K': temperature_mismatch,
    'strain': strain_mismatch,
    'U_x_m': displacement_mismatch,
    'U_y_m': displacement_mismatch,
    'alpha_rad': angle_mismatch,
    'T_1_K': temperature_mismatch,
    'T_2_K': temperature_mismatch,
    'stress_Pa': stress_mismatch,
    'T_K': temperature_mismatch,
}


SIGNED_POWER = 'J_eq'  # what the names of commands of antagonistic pairs begin with
BY_SUFFIX = {
    '_m': displacement_mismatch,
    '_rad': angle_mismatch,
    '_N': force_mismatch,
    '_K': temperature_mismatch,
    '_W': heating_mismatch,
    '_ohm': resistance_mismatch,
}


def mismatch_of(name: str, values: Vector) -> UnitMismatch | None:
    """How the numbers (k,), NaN where missing, cannot be in the unit that `name` ends with; None where they can."""
    known = values[np.isfinite(values)]
    check = CHECKS.get('J_eq_W' if name.startswith(SIGNED_POWER) else name) or next(
        (mismatch for suffix, mismatch in BY_SUFFIX.items() if name.endswith(suffix)), None
    )
    return None if check is None or len(known) == 0 else check(known)
