"""Limits of a fit: those that a user moves, and the estimates that ended at one.

A limit is there so that a fit ends; the truth may lie beyond it. What ended at one is said, and how to move it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.free_parameters import FreeParameter, declared_parameters
from sma_sim.evidence.estimation.held_out_prediction import RunFit
from sma_sim.evidence.estimation.problem import AMBIENT, DELAY, Problem
from sma_sim.evidence.estimation.residuals import ZERO_STDS
from sma_sim.model.errors import UserError
from sma_sim.model.parameters import Parameter

Vector = NDArray[np.float64]
Range = tuple[float, float]
AT_LIMIT = 1e-6  # of a coordinate
NEAR_LIMIT = 0.05  # of the way from the middle of its prior, which pulls it back, to a limit
DELAY_NAME, STRAIN_ZERO = 'delay', 'zero.strain'  # as a user names them


@dataclass(frozen=True)
class LimitReached:
    """An estimate that ended at `low` or `high` (SI); in some `recordings` where each has its own.

    Not `is_movable` where that is the end of what the parameter can be at all.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    recordings: tuple[str, ...] = ()
    is_movable: bool = True

    @property
    def text(self) -> str:
        """In words."""
        unit = '' if self.unit == '-' else f' {self.unit}'
        if not self.is_movable:
            between = f'{self.low:.4g} to {self.high:.4g}'
            return f'{self.name} = {self.value:.4g}{unit} ended at the end of what it can be ({between})'
        where = f' in {", ".join(self.recordings)}' if self.recordings else ''
        return (
            f'{self.name} = {self.value:.4g}{unit} ended at a limit of the fit{where} ({self.low:.4g} to {self.high:.4g}): '
            f'the true value may be beyond it ({self.cure})'
        )

    @property
    def cure(self) -> str:
        """How the limit is moved."""
        if self.name.startswith('zero.') and self.name != STRAIN_ZERO:
            return 'it is four times the zero_std of the map'
        if self.name == 'ambient':
            return 'it is five times what rooms differ by'
        return f'move it: --limit {self.name}=LOW:HIGH'


def limits_from(words: Sequence[str]) -> dict[str, Range]:
    """Limits by name [SI] from ``name=low:high`` words. Raises UserError."""
    limits = {}
    for word in words:
        name, _, ends = word.partition('=')
        try:
            low, high = map(float, ends.split(':'))
        except ValueError as error:
            raise UserError(f'--limit {word}: expected NAME=LOW:HIGH in SI units, such as delay=-2:5') from error
        limits[name.strip()] = (low, high)
    return limits


def within_limits(problem: Problem, limits: Mapping[str, Range]) -> Problem:
    """A problem whose parameters, delay and zeros of strain lie between `limits` (SI) by name. Raises UserError."""
    names = [free.name for free in problem.free]
    for name, (low, high) in limits.items():
        if name not in (*names, DELAY_NAME, STRAIN_ZERO):
            raise UserError(
                f'--limit {name}: expected {DELAY_NAME}, {STRAIN_ZERO}, or a parameter that is fitted: {", ".join(names)}'
            )
        if not low < high:
            raise UserError(f'--limit {name}={low:g}:{high:g}: expected the lower end first')
    free = tuple(narrowed(one, limits[one.name]) if one.name in limits else one for one in problem.free)
    delay = tuple(map(DELAY.coordinate, limits[DELAY_NAME])) if DELAY_NAME in limits else problem.delay_range
    runs = problem.runs
    if STRAIN_ZERO in limits:
        runs = tuple(replace(run, zero_range=limits[STRAIN_ZERO]) for run in runs)
    return replace(problem, free=free, delay_range=(delay[0], delay[1]), runs=runs)


def narrowed(free: FreeParameter, limits: Range) -> FreeParameter:
    """A parameter between other bounds (SI). Raises UserError for a logarithmic one that is to be 0 or less."""
    if free.log and limits[0] <= 0.0:
        raise UserError(f'--limit {free.name}={limits[0]:g}:{limits[1]:g}: expected more than 0')
    return replace(free, low=free.coordinate(limits[0]), high=free.coordinate(limits[1]))


def limits_reached(problem: Problem, z: Vector, runs: Sequence[RunFit]) -> tuple[LimitReached, ...]:
    """All estimates of a fit that ended at a limit. `runs`: what it says of every recording."""
    declared = declared_parameters(problem.config)
    found = [
        of_unknown(one, float(x), declared.get(one.name))
        for one, x in zip(problem.shared, z, strict=False)
        if is_at_limit(one, float(x))
    ]
    offsets = dict[str, list[tuple[str, float, Range]]]()
    for data, fit in zip(problem.runs, runs, strict=True):
        stds = dict(zip(data.channels, data.zero_std, strict=bool(data.zero_std)))
        given = {f'zero.{channel}': (value, std_range(stds[channel])) for channel, value in fit.zeros.items()}
        given |= {STRAIN_ZERO: (fit.zero, data.zero_range)} if fit.zero else {}
        given |= {'ambient': (fit.ambient, (AMBIENT.low * fit.ambient_std, AMBIENT.high * fit.ambient_std))}
        for name, (value, between) in given.items():
            if between[0] < between[1] and not within(value, between):
                offsets.setdefault(name, []).append((fit.name, value, between))
    units = {'ambient': 'K', STRAIN_ZERO: '-'}
    found += [
        LimitReached(name, where[0][1], *where[0][2], units.get(name, 'SI'), tuple(run for run, _, _ in where))
        for name, where in offsets.items()
    ]
    return tuple(found)


def std_range(std: float) -> Range:
    """Between which values a zero of this standard deviation is estimated."""
    return -ZERO_STDS * std, ZERO_STDS * std


def within(value: float, between: Range) -> bool:
    """Whether a value is away from the ends of what it may be, whose middle is expected."""
    middle, reach = 0.5 * (between[0] + between[1]), 0.5 * (between[1] - between[0])
    return abs(value - middle) < (1.0 - NEAR_LIMIT) * reach


def is_at_limit(unknown: FreeParameter, x: float) -> bool:
    """Whether a coordinate lies at an end of its range, or so far towards it that only its prior may have kept it back."""
    return x - unknown.low < max(AT_LIMIT, -NEAR_LIMIT * unknown.low) or unknown.high - x < max(
        AT_LIMIT, NEAR_LIMIT * unknown.high
    )


def of_unknown(unknown: FreeParameter, x: float, declared: Parameter | None) -> LimitReached:
    """A shared unknown that ended at a limit."""
    ends = unknown.value(unknown.low), unknown.value(unknown.high)
    end, bound = (k[x - unknown.low > unknown.high - x] for k in (ends, declared.bounds if declared else (-inf, inf)))
    movable = abs(end - bound) > AT_LIMIT * max(abs(end), abs(unknown.scale))
    return LimitReached(unknown.name, unknown.value(x), *ends, unknown.unit, is_movable=movable)
