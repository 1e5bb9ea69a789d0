"""Plateau stresses of isothermal tests: stress over strain at one temperature, loading and unloading.

Where the wire transforms, the slope is a small part of that of the elastic wire. The stress in the middle of that stretch is
the plateau stress; ASTM F2516 reads it at 3 % on the way up and 2.5 % on the way down, which presupposes a plateau there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.quasi_static import GRID, SMOOTHED, both_ways, smoothed_way
from sma_sim.evidence.data.recording import Dataset, Recording
from sma_sim.model.structures.discovery import known_structures

Vector = NDArray[np.float64]
FLAT = 0.35  # of the steepest slope, below which the wire transforms
MIN_PLATEAU = 0.1  # part of the strains that it must take
MIN_BEYOND = 0.05  # part of the strains after the plateau that shows the modulus of martensite
STEEPEST = 0.95  # quantile of the slopes: the elastic wire, but for noise
MIN_STRAIN = 5e-3  # that a test must reach
STEADY = 3.0  # [K] within which a temperature counts as constant


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
    structure = known_structures()[recording.system]
    if 'stress' not in recording.channels or [drive.name for drive in structure.drives][:1] != ['strain']:
        return None
    times, values = np.asarray(recording.source.times, float), np.asarray(recording.source.values, float)
    columns = dict(zip(structure.input_columns, values.T, strict=True))
    if np.any(columns.get('J_W', 0.0)):
        return None
    strain, T = (np.interp(recording.time, times, columns[name]) for name in ('strain', temperature_column(columns)))
    return isothermal_features(recording.name, T, strain, np.asarray(recording.channels['stress'], float))


def isothermal_features(name: str, T: Vector, strain: Vector, stress: Vector) -> IsothermalTest | None:
    """The features of `stress` (k,) [Pa], NaN where missing, over `strain` (k,) at a temperature (k,) [K] that is constant.

    None where that is not constant, or where nothing transforms.
    """
    known = np.isfinite(stress)
    T, strain, stress = T[known], strain[known], stress[known]
    if len(T) < 10 or np.ptp(T) > STEADY or np.ptp(strain) < MIN_STRAIN:
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


def temperature_column(columns: dict[str, Vector]) -> str:
    """The column that tells the temperature of the wire: its own where it is imposed, else that of the room."""
    return 'T_K' if 'T_K' in columns else 'T_E_K'


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
