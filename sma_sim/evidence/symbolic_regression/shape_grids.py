"""The first values of shape parameters: from the ranges that the data visit, their length, the spectrum of the residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from sma_sim.evidence.estimation.problem import LinearizedRun, Problem
from sma_sim.evidence.symbolic_regression.terms import ShapeParameter, Term
from sma_sim.evidence.symbolic_regression.visited_states import VisitedStates

Limits = tuple[float, float]
# Cost grows with their product.
THRESHOLDS_PER_RANGE, INSTANTS_PER_RUN, TIME_CONSTANTS_PER_RUN, MAX_FREQUENCIES = 9, 19, 7, 6
WIDTH_FRACTIONS = (0.06, 0.15, 0.35)  # of the visited range
PERIODS_PER_RANGE = np.arange(1.5, 10.1, 0.5)  # within the visited range
PHASES = (0.0, 0.25 * math.pi, 0.5 * math.pi, 0.75 * math.pi)
MIN_PERIODS = 2.0  # within a run, of an oscillation: what did not come again may be anything that happened once
MAX_PERIODS = 60.0  # of those that are tried
MIN_TIME_CONSTANT = 0.01  # fraction of a run
MIN_RELATIVE_RANGE = 1e-6  # range of a variable, relative to its size, below which it counts as constant
TRIMMED_PERCENT = 1.0  # of the samples, at either end of a range


@dataclass(frozen=True)
class VisitedRanges:
    """What grids are made of: the states at a location, the length of a run [s], frequencies of the residuals [Hz]."""

    visited: Sequence[VisitedStates]
    length: float
    frequencies: tuple[float, ...]

    def range_of(self, variable: str) -> tuple[float, float]:
        """The values of a variable that the runs visit."""
        values = np.concatenate([states.fields[variable] for states in self.visited])
        return float(np.percentile(values, TRIMMED_PERCENT)), float(np.percentile(values, 100.0 - TRIMMED_PERCENT))


def grid_of(shape: ShapeParameter, ranges: VisitedRanges) -> tuple[tuple[float, ...], Limits]:
    """The first values of a shape parameter, none of a variable that stays where it is, and its realistic range in the file:
    the values that data of these ranges can tell, with some margin."""
    length = ranges.length
    if shape.grid == 'phase':
        return PHASES, (-2.0 * math.pi, 3.0 * math.pi)
    if shape.grid == 'frequency':
        return ranges.frequencies, (MIN_PERIODS / length, 5.0 * max(ranges.frequencies, default=MAX_PERIODS / length))
    if shape.grid == 'instant':
        return tuple(np.linspace(0.0, length, INSTANTS_PER_RUN + 2)[1:-1]), (0.0, length)
    if shape.grid in ('fixed', 'time_constant'):
        times = tuple(np.geomspace(MIN_TIME_CONSTANT, 1.0, TIME_CONSTANTS_PER_RUN) * length)
        values = shape.values if shape.grid == 'fixed' else times
        return values, (0.2 * min(values), 5.0 * max(values))
    low, high = ranges.range_of(shape.of)
    width = high - low
    if width <= MIN_RELATIVE_RANGE * max(abs(low), abs(high)):
        return (), (low, high)
    if shape.grid == 'threshold':
        return tuple(np.linspace(low, high, THRESHOLDS_PER_RANGE + 2)[1:-1]), (low - 0.2 * width, high + 0.2 * width)
    if shape.grid == 'width':
        return tuple(fraction * width for fraction in WIDTH_FRACTIONS), (0.01 * width, 3.0 * width)
    return tuple(2.0 * math.pi * PERIODS_PER_RANGE / width), (0.5 * math.pi / width, 60.0 * math.pi / width)


def shape_grid(term: Term, ranges: VisitedRanges) -> list[tuple[float, ...]]:
    """All combinations of a term's shapes."""
    return list(product(*(grid_of(shape, ranges)[0] for shape in term.shapes)))


def peak_frequencies(problem: Problem, linearized: Sequence[LinearizedRun]) -> tuple[float, ...]:
    """Frequencies [Hz] of the largest peaks of the residuals' mean periodogram, all channels and runs.

    Of what came again in a run, and is sampled twice in a period at least.
    """
    longest = max(float(run.time[-1] - run.time[0]) for run in problem.runs)
    samples = max(len(run.time) for run in problem.runs)
    frequencies = np.arange(MIN_PERIODS - 0.25, min(MAX_PERIODS, 0.5 * samples) + 0.5, 0.25) / longest
    power = np.zeros(len(frequencies))
    for run, linear in zip(problem.runs, linearized, strict=True):
        transform = np.exp(-2j * math.pi * np.outer(frequencies, run.time - run.time[0]))
        for row in linear.residuals:
            power += np.abs(transform @ row) ** 2
    is_peak = (power[1:-1] >= power[:-2]) & (power[1:-1] >= power[2:])
    peaks = np.flatnonzero(is_peak) + 1
    largest = peaks[np.argsort(-power[peaks])][:MAX_FREQUENCIES]
    return tuple(float(frequencies[k]) for k in largest)
