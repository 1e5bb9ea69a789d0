"""The values of shape parameters to try first: from the ranges that the data visit, their length, their residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.problem import LinearizedRun, Problem
from sma_sim.evidence.symbolic_regression.terms import Shape, Term
from sma_sim.evidence.symbolic_regression.visited_states import Course

Vector = NDArray[np.float64]
PLACES, INSTANTS, PACES, PEAKS = 9, 19, 7, 6
WIDTHS = (0.06, 0.15, 0.35)  # parts of the visited range
WAVES = np.arange(1.5, 10.1, 0.5)  # periods within the visited range
PHASES = (0.0, 0.25 * math.pi, 0.5 * math.pi, 0.75 * math.pi)
FASTEST = 0.01  # shortest time constant, in parts of a run
STILL = 1e-6  # range of a variable, relative to its size, that says nothing
TRIM = 1.0  # per cent of the samples that a range leaves out at either end


@dataclass(frozen=True)
class Scope:
    """What grids are made of: the courses at a place, the length of a run [s], frequencies that stand out [Hz]."""

    courses: Sequence[Course]
    length: float
    peaks: tuple[float, ...]

    def range_of(self, variable: str) -> tuple[float, float]:
        """The values of a variable that the runs visit."""
        values = np.concatenate([one.fields[variable] for one in self.courses])
        return float(np.percentile(values, TRIM)), float(np.percentile(values, 100.0 - TRIM))


def values_to_try(shape: Shape, scope: Scope) -> tuple[float, ...]:
    """The grid of one shape parameter; empty for a place or width of a variable that stays where it is."""
    if shape.grid == 'fixed':
        return shape.values
    if shape.grid == 'peaks':
        return scope.peaks
    if shape.grid == 'phase':
        return PHASES
    if shape.grid == 'instant':
        return tuple(np.linspace(0.0, scope.length, INSTANTS + 2)[1:-1])
    if shape.grid == 'pace':
        return tuple(np.geomspace(FASTEST, 1.0, PACES) * scope.length)
    low, high = scope.range_of(shape.of)
    if high - low <= STILL * max(abs(low), abs(high)):
        return ()
    if shape.grid == 'place':
        return tuple(np.linspace(low, high, PLACES + 2)[1:-1])
    if shape.grid == 'width':
        return tuple(part * (high - low) for part in WIDTHS)
    return tuple(2.0 * math.pi * WAVES / (high - low))


def limits_of(shape: Shape, scope: Scope) -> tuple[float, float]:
    """The values that data of these ranges can tell, with some room: the realistic range in the file."""
    if shape.grid == 'phase':
        return -2.0 * math.pi, 3.0 * math.pi
    if shape.grid in ('fixed', 'pace', 'peaks'):
        tried = values_to_try(shape, scope) or (1.0 / scope.length,)
        return 0.2 * min(tried), 5.0 * max(tried)
    if shape.grid == 'instant':
        return 0.0, scope.length
    low, high = scope.range_of(shape.of)
    if shape.grid == 'place':
        return low - 0.2 * (high - low), high + 0.2 * (high - low)
    if shape.grid == 'width':
        return 0.01 * (high - low), 3.0 * (high - low)
    return 0.5 * math.pi / (high - low), 60.0 * math.pi / (high - low)


def grid_of(term: Term, scope: Scope) -> list[tuple[float, ...]]:
    """All combinations of a term's shapes."""
    return list(product(*(values_to_try(shape, scope) for shape in term.shapes)))


def standing_out(problem: Problem, linear: Sequence[LinearizedRun]) -> tuple[float, ...]:
    """Frequencies [Hz] of the largest peaks of the residuals' mean periodogram, all channels and runs."""
    longest = max(float(run.time[-1] - run.time[0]) for run in problem.runs)
    pitches = np.arange(0.5, 60.5, 0.25) / longest
    power = np.zeros(len(pitches))
    for run, one in zip(problem.runs, linear, strict=True):
        turns = np.exp(-2j * math.pi * np.outer(pitches, run.time - run.time[0]))
        for row in one.residuals:
            power += np.abs(turns @ row) ** 2
    inner = (power[1:-1] >= power[:-2]) & (power[1:-1] >= power[2:])
    peaks = np.flatnonzero(inner) + 1
    best = peaks[np.argsort(-power[peaks])][:PEAKS]
    return tuple(float(pitches[k]) for k in best)
