"""Transformation temperatures by tangents, and what they say of a wire: where a fit of isobaric tests starts.

Strain over temperature at one stress: lines through the cold and the hot end of each way, and the steepest tangent between
them, cross at the start and the finish of the transformation (the evaluation of ASTM F2082 and F3097). Over the stresses of
several tests these temperatures lie near lines, whose slopes are one over sigma_T (Clausius-Clapeyron).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.quasi_static import both_ways, smoothed_way
from sma_sim.evidence.data.recording import Dataset, Recording
from sma_sim.model.config import Config
from sma_sim.model.structures.structure import Structure

Vector = NDArray[np.float64]
END = 0.12  # part of the temperatures, at either end, through which a baseline goes
LEAST_RANGE = 20.0  # [K] of temperatures and ...
LEAST_STRAIN = 2e-4  # ... of strain, below which nothing transforms
STEADY_STRESS = 0.05  # relative change of a stress that counts as constant
USUAL_SLOPE = 7e6  # [Pa/K] of NiTi, where all tests have one stress
SLOPES = (1e6, 3e7)  # [Pa/K] of alloys
MODULI = (5e9, 2e11)  # [Pa]
MARTENSITE_OVER_AUSTENITE = 0.6  # of the moduli: usual


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
    """The features of one isobaric test: its stress [Pa], both ways (heating, cooling), the strain at its hottest point."""

    name: str
    stress: float
    heating: Tangents
    cooling: Tangents
    hottest_strain: float

    @property
    def recovered(self) -> float:
        """Strain recovered by heating [-]."""
        return self.heating.cold_strain - self.heating.hot_strain


def isobaric_tests(dataset: Dataset, structure: Structure) -> tuple[IsobaricTest, ...]:
    """The features of all recordings that are isobaric tests with a transformation, by stress."""
    drives = [drive.name for drive in structure.drives]
    if drives != ['stress', 'T'] or structure.coordinate_names != ('strain',):
        return ()
    found = (isobaric_test(recording) for recording in dataset.recordings)
    return tuple(sorted((test for test in found if test is not None), key=lambda test: test.stress))


def isobaric_test(recording: Recording) -> IsobaricTest | None:
    """The features of one recording; None where it is no isobaric test, or nothing transforms."""
    if 'strain' not in recording.channels:
        return None
    times, values = np.asarray(recording.source.times, float), np.asarray(recording.source.values, float)
    stress, T = (np.interp(recording.time, times, values[:, k]) for k in (0, 1))
    strain = np.asarray(recording.channels['strain'], float)
    known = np.isfinite(strain)
    stress, T, strain = stress[known], T[known], strain[known]
    middle = float(np.median(stress)) if len(stress) else 0.0
    if len(T) < 10 or middle <= 0.0 or np.ptp(np.quantile(stress, [0.05, 0.95])) > STEADY_STRESS * middle + 1e6:
        return None
    if np.ptp(T) < LEAST_RANGE or np.ptp(strain) < LEAST_STRAIN:
        return None
    ways = both_ways(T, strain)
    if ways is None:
        return None
    heating, cooling = (tangents(*way) for way in ways)
    return IsobaricTest(recording.name, middle, heating, cooling, float(strain[np.argmax(T)]))


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


def median_slope(x: Sequence[float], y: Sequence[float]) -> float:
    """Median of the slopes between all pairs of points (Theil and Sen); NaN for fewer than two."""
    slopes = [(y[j] - y[i]) / (x[j] - x[i]) for i, j in combinations(range(len(x)), 2) if x[j] != x[i]]
    return float(np.median(slopes)) if slopes else float('nan')


def starting_values(tests: Sequence[IsobaricTest]) -> dict[str, float]:
    """Parameters of the wire (SI) from the features of isobaric tests."""
    stress = [test.stress for test in tests]
    middles = [[0.5 * (way.low + way.high) for way in (test.heating, test.cooling)] for test in tests]
    per_way = [median_slope(stress, [middle[way] for middle in middles]) for way in (0, 1)]
    per_kelvin = [1.0 / slope for slope in per_way if slope > 0.0]
    sigma_T = float(np.clip(np.mean(per_kelvin) if per_kelvin else USUAL_SLOPE, *SLOPES))
    width = max(1.0, float(np.median([heating - cooling for heating, cooling in middles])))
    softness = median_slope(stress, [test.hottest_strain for test in tests])
    E_A = float(np.clip(1.0 / softness if softness > 0.0 else 5e10, *MODULI))
    T0 = float(np.mean(middles))
    return {
        'wire.T0': T0,
        'wire.sigma_MW0': float(np.mean(stress)),
        'wire.sigma_T': sigma_T,
        'wire.dsigma': sigma_T * width,
        'wire.E_A': E_A,
        'wire.E_M': MARTENSITE_OVER_AUSTENITE * E_A,
        'wire.eps_T': float(np.clip(max(test.recovered for test in tests), 2e-3, 0.2)),
    }


def started_from_curves(dataset: Dataset, config: Config) -> tuple[Config, tuple[IsobaricTest, ...]]:
    """A configuration with the starting values of isobaric tests in place of those that have their defaults.

    Returns the tests too; without isobaric tests the configuration is as it was.
    """
    tests = isobaric_tests(dataset, config.structure.structure)
    if not tests:
        return config, ()
    defaults: Mapping[str, float] = config.structure.structure.default_values
    own = {name: value for name, value in starting_values(tests).items() if config.parameters[name] == defaults[name]}
    return replace(config, parameters={**config.parameters, **own}), tests


def tests_as_text(tests: Sequence[IsobaricTest]) -> list[str]:
    """A table of the transformation temperatures, in deg C."""
    lines = ['transformation temperatures by tangents [deg C], strain recovered by heating:',
             'test                 stress [MPa]     M_f     M_s     A_s     A_f   strain']  # fmt: skip
    for test in tests:
        ends = (test.cooling.low, test.cooling.high, test.heating.low, test.heating.high)
        numbers = ''.join(f'{T - 273.15:8.1f}' for T in ends)
        lines.append(f'{test.name:<20} {test.stress / 1e6:12.4g} {numbers} {100.0 * test.recovered:6.2f} %')
    return lines
