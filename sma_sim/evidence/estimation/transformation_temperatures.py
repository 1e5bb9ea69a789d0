"""Transformation temperatures by tangents, from isobaric tests: strain over temperature at one stress.

Lines through the cold and the hot end of each way, and the steepest tangent between them, cross at the start and the finish
of the transformation (the evaluation of ASTM F2082 and F3097).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.quasi_static import Cycle, cycles, smoothed_way
from sma_sim.evidence.data.recording import Dataset, Recording
from sma_sim.model.structures.discovery import known_structures

Vector = NDArray[np.float64]
TEMPERATURES = ('M_f', 'M_s', 'A_s', 'A_f')
END = 0.12  # part of the temperatures, at either end, through which a baseline goes
MIN_RANGE = 20.0  # [K] of temperatures and ...
MIN_STRAIN = 2e-4  # ... of strain, below which nothing transforms
STEADY_STRESS = 0.05  # relative change of a stress that counts as constant


@dataclass(frozen=True)
class Tangents:
    """One way of an isobaric test: the temperatures [K] of start and finish in the order of rising temperature, strains.

    `cold_strain` and `hot_strain` are those of the baselines in the middle; `steepest` [K] is where the slope is largest.
    """

    low: float
    high: float
    steepest: float
    cold_strain: float
    hot_strain: float


@dataclass(frozen=True)
class IsobaricTest:
    """The features of one isobaric test: its stress [Pa], both ways (heating, cooling), the strain at its hottest point.

    `cycles`: the same of each of several cycles, in the order of time; the features of the test are those in the middle.
    """

    name: str
    stress: float
    heating: Tangents
    cooling: Tangents
    hottest_strain: float
    cycles: tuple[IsobaricTest, ...] = ()

    @property
    def temperatures(self) -> tuple[float, float, float, float]:
        """M_f, M_s, A_s, A_f [K]."""
        return self.cooling.low, self.cooling.high, self.heating.low, self.heating.high

    @property
    def middles(self) -> tuple[float, float]:
        """The middle [K] of the transformation to martensite and of that to austenite."""
        return 0.5 * (self.cooling.low + self.cooling.high), 0.5 * (self.heating.low + self.heating.high)

    @property
    def hysteresis(self) -> float:
        """Width of the hysteresis [K]: from the middle of one way to that of the other."""
        return self.middles[1] - self.middles[0]

    @property
    def recovered(self) -> float:
        """Strain recovered by heating [-]."""
        return self.heating.cold_strain - self.heating.hot_strain


def isobaric_tests(dataset: Dataset) -> tuple[IsobaricTest, ...]:
    """The features of all recordings that are isobaric tests with a transformation, by stress."""
    found = (isobaric_test(recording) for recording in dataset.recordings)
    return tuple(sorted((test for test in found if test is not None), key=lambda test: test.stress))


def isobaric_test(recording: Recording) -> IsobaricTest | None:
    """The features of one recording; None where it is no isobaric test, or nothing transforms."""
    drives = [drive.name for drive in known_structures()[recording.system].drives]
    if 'strain' not in recording.channels or drives != ['stress', 'T']:
        return None
    times, values = np.asarray(recording.source.times, float), np.asarray(recording.source.values, float)
    stress, T = (np.interp(recording.time, times, values[:, k]) for k in (0, 1))
    return isobaric_features(recording.name, stress, T, np.asarray(recording.channels['strain'], float))


def isobaric_features(name: str, stress: Vector, T: Vector, strain: Vector) -> IsobaricTest | None:
    """The features of `strain` (k,), NaN where missing, at a `stress` (k,) [Pa] that is constant, over `T` (k,) [K].

    None where the stress is not constant, or nothing transforms.
    """
    known = np.isfinite(strain)
    stress, T, strain = stress[known], T[known], strain[known]
    middle = float(np.median(stress)) if len(stress) else 0.0
    if len(T) < 10 or middle <= 0.0 or np.ptp(np.quantile(stress, [0.05, 0.95])) > STEADY_STRESS * middle + 1e6:
        return None
    if np.ptp(T) < MIN_RANGE or np.ptp(strain) < MIN_STRAIN:
        return None
    found = tuple(features_of(name, middle, cycle) for cycle in cycles(T, strain))
    if not found:
        return None
    return replace(found[len(found) // 2], cycles=found if len(found) > 1 else ())


def features_of(name: str, stress: float, cycle: Cycle) -> IsobaricTest:
    """The features of one cycle at a stress [Pa]."""
    heating, cooling = (tangents(*way) for way in cycle)
    (T, strain), _ = cycle
    return IsobaricTest(name, stress, heating, cooling, float(strain[np.argmax(T)]))


def tangents(T: Vector, strain: Vector) -> Tangents:
    """The evaluation of one way, `strain` (k,) at `T` (k,) [K]."""
    grid, smooth, slope = smoothed_way(T, strain)
    ends = int(END * len(grid))
    edge = ends // 4  # smoothing bends what is outside
    k = edge + int(np.argmin(slope[edge:-edge]))
    cold, hot = (np.polyfit(grid[part], smooth[part], 1) for part in (slice(edge, ends), slice(-ends, -edge)))
    low, high = (crossing(line, slope[k], grid[k], smooth[k]) for line in (cold, hot))
    middle = float(grid[k])
    low, high = min(max(low, grid[0]), middle), max(min(high, grid[-1]), middle)
    return Tangents(float(low), float(high), middle, float(np.polyval(cold, low)), float(np.polyval(hot, high)))


def crossing(line: Vector, slope: float, at: float, value: float) -> float:
    """Where a baseline (slope, offset) crosses the tangent of a `slope` through (`at`, `value`)."""
    return float((line[1] - value + slope * at) / (slope - line[0])) if slope != line[0] else at
