"""Where a fit of a wire starts: transformation temperatures and plateau stresses of its tests.

Each isobaric test gives one temperature, each isothermal test one stress, at which half of the wire has transformed, for
either way. These points of the phase diagram lie near two lines, sigma_A(T) and sigma_M(T), whose slope is sigma_T
(Clausius-Clapeyron) and whose distance is dsigma.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.plateau_stresses import IsothermalTest, isothermal_tests
from sma_sim.evidence.estimation.transformation_temperatures import IsobaricTest, isobaric_tests
from sma_sim.model.config import Config

USUAL_SLOPE = 7e6  # [Pa/K] of NiTi, where all tests have one stress
SLOPES = (1e6, 3e7)  # [Pa/K] of alloys
MODULI = (5e9, 2e11)  # [Pa]
MARTENSITE_OVER_AUSTENITE = 0.6  # of the moduli: usual
STRAINS = (2e-3, 0.2)  # of transformation
MIN_WIDTH = 1.0  # [K] of a hysteresis
Point = tuple[float, float]  # temperature [K], stress [Pa]


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
