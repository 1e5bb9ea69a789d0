"""What curves of tests of a wire show: transformation temperatures, plateau stresses, and the values at which fits start.

Isobaric tests, strain over temperature at one stress: lines through the cold and the hot end of each way, and the steepest
tangent between them, cross at the start and the finish of the transformation (the evaluation of ASTM F2082 and F3097).
Isothermal tests, stress over strain at one temperature: where the wire transforms, the slope is a small part of that of the
elastic wire. The stress in the middle of that stretch is the plateau stress; ASTM F2516 reads it at 3 % on the way up and
2.5 % on the way down, which presupposes a plateau there.

Each isobaric test gives one temperature, each isothermal test one stress, at which half of the wire has transformed, for
either way. These points of the phase diagram lie near two lines, sigma_A(T) and sigma_M(T), whose slope is sigma_T
(Clausius-Clapeyron) and whose distance is dsigma.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.quasi_static import GRID, SMOOTHED, Cycle, both_ways, cycles, smoothed_way
from sma_sim.evidence.data.recording import Dataset, Recording
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config

TEMPERATURES = ('M_f', 'M_s', 'A_s', 'A_f')
END = 0.12  # part of the temperatures, at either end, through which a baseline goes
MIN_RANGE = 20.0  # [K] of temperatures and ...
MIN_STRAIN = 2e-4  # ... of strain, below which nothing transforms
STEADY_STRESS = 0.05  # relative change of a stress that counts as constant
FLAT = 0.35  # of the steepest slope, below which the wire transforms
MIN_PLATEAU = 0.1  # part of the strains that it must take
MIN_BEYOND = 0.05  # part of the strains after the plateau that shows the modulus of martensite
STEEPEST = 0.95  # quantile of the slopes: the elastic wire, but for noise
MIN_TESTED_STRAIN = 5e-3  # that a test must reach
STEADY = 3.0  # [K] within which a temperature counts as constant
USUAL_SLOPE = 7e6  # [Pa/K] of NiTi, where all tests have one stress
SLOPES = (1e6, 3e7)  # [Pa/K] of alloys
MODULI = (5e9, 2e11)  # [Pa]
MARTENSITE_OVER_AUSTENITE = 0.6  # of the moduli: usual
STRAINS = (2e-3, 0.2)  # of transformation
MIN_WIDTH = 1.0  # [K] of a hysteresis
Point = tuple[float, float]  # temperature [K], stress [Pa]


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
    drives = [drive.name for drive in recording.structure.drives]
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


@dataclass(frozen=True)
class IsothermalTest:
    """The features of one isothermal test.

    `temperature` [K]; `loading`, `unloading`: plateau stresses [Pa], NaN where there is none; `modulus` [Pa]: the steepest
    slope of loading; `plateau_strain` [-]: how much strain the plateau of loading takes; `martensite_modulus` [Pa]: the
    steepest slope after it, NaN where the test ends before the wire is martensite.
    """

    name: str
    temperature: float
    loading: float
    unloading: float
    modulus: float
    plateau_strain: float
    martensite_modulus: float = float('nan')

    @property
    def hysteresis(self) -> float:
        """Width of the hysteresis [Pa]."""
        return self.loading - self.unloading


def isothermal_tests(dataset: Dataset) -> tuple[IsothermalTest, ...]:
    """The features of all recordings that are isothermal tests with a plateau, by temperature."""
    found = (isothermal_test(recording) for recording in dataset.recordings)
    return tuple(sorted((test for test in found if test is not None), key=lambda test: test.temperature))


def isothermal_test(recording: Recording) -> IsothermalTest | None:
    """The features of one recording; None where it is no isothermal test, or nothing transforms."""
    structure = recording.structure
    if 'stress' not in recording.channels or [drive.name for drive in structure.drives][:1] != ['strain']:
        return None
    times, values = np.asarray(recording.source.times, float), np.asarray(recording.source.values, float)
    columns = dict(zip(structure.input_columns, values.T, strict=True))
    if np.any(columns.get('J_W', 0.0)):
        return None
    warm = 'T_K' if 'T_K' in columns else 'T_E_K'
    strain, T = (np.interp(recording.time, times, columns[name]) for name in ('strain', warm))
    return isothermal_features(recording.name, T, strain, np.asarray(recording.channels['stress'], float))


def isothermal_features(name: str, T: Vector, strain: Vector, stress: Vector) -> IsothermalTest | None:
    """The features of `stress` (k,) [Pa], NaN where missing, over `strain` (k,) at a temperature (k,) [K] that is constant.

    None where that is not constant, or where nothing transforms.
    """
    known = np.isfinite(stress)
    T, strain, stress = T[known], strain[known], stress[known]
    if len(T) < 10 or np.ptp(T) > STEADY or np.ptp(strain) < MIN_TESTED_STRAIN:
        return None
    ways = both_ways(strain, stress)
    if ways is None:
        return None
    grid, smooth, slope = smoothed_way(*ways[0])
    modulus = float(np.quantile(slope, STEEPEST))
    flat = slope < FLAT * modulus
    loading, unloading = plateau(smooth, flat), plateau(*plateau_of(ways[1]))
    if np.isnan(loading):
        return None
    takes, beyond = float(flat.mean() * (grid[-1] - grid[0])), slope_beyond(slope, flat)
    return IsothermalTest(name, float(np.mean(T)), loading, unloading, modulus, takes, float(np.minimum(beyond, modulus)))


def plateau_of(way: tuple[Vector, Vector]) -> tuple[Vector, NDArray[np.bool_]]:
    """Smoothed stresses of a way, and where it is flat."""
    _, smooth, slope = smoothed_way(*way)
    return smooth, slope < FLAT * float(np.quantile(slope, STEEPEST))


def slope_beyond(slope: Vector, flat: NDArray[np.bool_]) -> float:
    """The steepest slope [Pa] after what is flat; NaN where that is the end of the test, but for a few samples."""
    inner = flat[: -int(SMOOTHED * GRID) - 1]  # smoothing makes the end flat too
    beyond = slope[int(np.flatnonzero(inner)[-1]) + 1 :]
    return float(np.quantile(beyond, STEEPEST)) if len(beyond) >= MIN_BEYOND * len(slope) else float('nan')


def plateau(smooth: Vector, flat: NDArray[np.bool_]) -> float:
    """The stress [Pa] in the middle of what is flat; NaN where that is too short."""
    return float(np.median(smooth[flat])) if flat.mean() >= MIN_PLATEAU else float('nan')


@dataclass(frozen=True)
class CurveFeatures:
    """What the curves of the tests of one wire show."""

    isobaric: tuple[IsobaricTest, ...]
    isothermal: tuple[IsothermalTest, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.isobaric or self.isothermal)

    @property
    def points(self) -> tuple[tuple[Point, ...], tuple[Point, ...]]:
        """The points of the phase diagram: to martensite, to austenite."""
        ways = tuple(tuple((test.middles[way], test.stress) for test in self.isobaric) for way in (0, 1))
        loading = tuple((test.temperature, test.loading) for test in self.isothermal)
        unloading = tuple((test.temperature, test.unloading) for test in self.isothermal if np.isfinite(test.unloading))
        return ways[0] + loading, ways[1] + unloading


def curve_features(dataset: Dataset) -> CurveFeatures:
    """The features of all recordings that are isobaric or isothermal tests."""
    return CurveFeatures(isobaric_tests(dataset), isothermal_tests(dataset))


def median_slope(points: Sequence[Point]) -> float:
    """Median of the slopes between all pairs of points (Theil and Sen); NaN for fewer than two."""
    slopes = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in combinations(points, 2) if a[0] != b[0]]
    return float(np.median(slopes)) if slopes else float('nan')


def starting_values(features: CurveFeatures) -> dict[str, float]:
    """Parameters of the wire (SI) from the features of its tests."""
    slopes = [slope for slope in map(median_slope, features.points) if slope > 0.0]
    sigma_T = float(np.clip(np.mean(slopes) if slopes else USUAL_SLOPE, *SLOPES))
    widths = [sigma_T * test.hysteresis for test in features.isobaric]
    widths += [test.hysteresis for test in features.isothermal if np.isfinite(test.hysteresis)]
    dsigma = max(MIN_WIDTH * sigma_T, float(np.median(widths)) if widths else 0.0)
    middles = [(float(np.mean(test.middles)), test.stress) for test in features.isobaric]
    middles += [(test.temperature, middle_stress(test, dsigma)) for test in features.isothermal]
    T0, level = (float(value) for value in np.mean(middles, axis=0))
    E_A = austenite_modulus(features)
    E_M = martensite_modulus(features, E_A)
    return {
        'wire.T0': T0,
        'wire.sigma_MW0': level,
        'wire.sigma_T': sigma_T,
        'wire.dsigma': dsigma,
        'wire.E_A': E_A,
        'wire.E_M': E_M,
        'wire.eps_T': transformation_strain(features, E_A, E_M),
    }


def middle_stress(test: IsothermalTest, dsigma: float) -> float:
    """The middle of the plateaus [Pa]; from the width of the hysteresis `dsigma` [Pa] where unloading has none."""
    if np.isfinite(test.unloading):
        return 0.5 * (test.loading + test.unloading)
    return test.loading - 0.5 * dsigma


def austenite_modulus(features: CurveFeatures) -> float:
    """From the steepest loading, else from how the hottest point moves with stress [Pa]."""
    found = [test.modulus for test in features.isothermal]
    softness = median_slope([(test.stress, test.hottest_strain) for test in features.isobaric])
    if not found and softness > 0.0:
        found = [1.0 / softness]
    return float(np.clip(np.median(found) if found else 5e10, *MODULI))


def martensite_modulus(features: CurveFeatures, E_A: float) -> float:
    """From the steepest loading after a plateau, else a usual part of that of austenite [Pa]."""
    found = [test.martensite_modulus for test in features.isothermal if np.isfinite(test.martensite_modulus)]
    return float(np.clip(np.median(found) if found else MARTENSITE_OVER_AUSTENITE * E_A, *MODULI))


def transformation_strain(features: CurveFeatures, E_A: float, E_M: float) -> float:
    """Strain that a test recovers, or that its plateau takes without the elastic strain by which martensite is softer [-].

    Plateaus that end within their test say it, the others and isobaric tests that it is no less. It is rather too small: the
    end of a plateau that is in the model and not in the test is seen by a fit, the reverse is not.
    """
    ended = [test for test in features.isothermal if np.isfinite(test.martensite_modulus)]
    tests = ended or features.isothermal
    strains = [test.plateau_strain - test.loading * (1.0 / E_M - 1.0 / E_A) for test in tests]
    return float(np.clip(max([*strains, *(test.recovered for test in features.isobaric)]), *STRAINS))


def shown_by_curves(features: CurveFeatures, config: Config) -> dict[str, float]:
    """What the tests of a wire show of all parameters, about the T0 of a configuration; {} without tests."""
    T0 = config.parameters['wire.T0']
    if not features:
        return {}
    found = starting_values(features)
    level = found['wire.sigma_MW0'] + found['wire.sigma_T'] * (T0 - found['wire.T0'])
    return {**found, 'wire.T0': T0, 'wire.sigma_MW0': level}
