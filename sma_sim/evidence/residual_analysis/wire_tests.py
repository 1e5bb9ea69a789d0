"""The tests of a wire as a materials scientist reads them: the same evaluation of measured curves and of the model's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from sma_sim.evidence.estimation.curve_features import (
    CurveFeatures,
    IsobaricTest,
    IsothermalTest,
    isobaric_features,
    isothermal_features,
    median_slope,
)
from sma_sim.evidence.residual_analysis.compare import ComparedRun, Comparison
from sma_sim.model.arrays import Vector
from sma_sim.model.structures.discovery import known_structures

Features = TypeVar('Features', IsobaricTest, IsothermalTest)


@dataclass(frozen=True)
class EvaluatedTest(Generic[Features]):
    """A test with its features as measured, and as the model has them; None where the model does not transform."""

    run: ComparedRun
    measured: Features
    model: Features | None


@dataclass(frozen=True)
class Characterization:
    """The isobaric tests by stress, the isothermal tests by temperature."""

    isobaric: tuple[EvaluatedTest[IsobaricTest], ...]
    isothermal: tuple[EvaluatedTest[IsothermalTest], ...]

    def __bool__(self) -> bool:
        return bool(self.isobaric or self.isothermal)

    @property
    def slopes(self) -> tuple[float, float]:
        """Slopes of the measured transformation stresses to martensite and to austenite [Pa/K], NaN where unknown."""
        isobaric = tuple(test.measured for test in self.isobaric)
        first, second = CurveFeatures(isobaric, tuple(test.measured for test in self.isothermal)).points
        return median_slope(first), median_slope(second)


def characterization(comparison: Comparison) -> Characterization:
    """The tests of a wire among the runs of a comparison; empty for another structure."""
    if comparison.config.structure.original != 'wire':
        return Characterization((), ())
    isobaric = evaluated(comparison.runs, 'strain', isobaric_curve)
    isothermal = evaluated(comparison.runs, 'stress', isothermal_curve)
    return Characterization(
        tuple(sorted(isobaric, key=lambda test: test.measured.stress)),
        tuple(sorted(isothermal, key=lambda test: test.measured.temperature)),
    )


def evaluated(
    runs: Sequence[ComparedRun], channel: str, features: Callable[[ComparedRun, Vector], Features | None]
) -> list[EvaluatedTest[Features]]:
    """The runs that show features in a channel, measured and of the model."""
    found = []
    for run in runs:
        measured = features(run, run.measured[channel]) if channel in run.measured else None
        if measured is not None:
            found.append(EvaluatedTest(run, measured, features(run, run.predicted[channel])))
    return found


def isobaric_curve(run: ComparedRun, strain: Vector) -> IsobaricTest | None:
    """The features of a strain under the stress of a run, where its temperature is imposed."""
    return isobaric_features(run.name, run.states['stress_Pa'], run.states['T_K'], strain) if imposes_T(run) else None


def isothermal_curve(run: ComparedRun, stress: Vector) -> IsothermalTest | None:
    """The features of a stress over the strain of a run that is not heated."""
    if np.any(run.states['J_W']):
        return None
    T = run.states['T_K'] if imposes_T(run) else run.states['T_E_K']
    return isothermal_features(run.name, T, run.states['strain'], stress)


def imposes_T(run: ComparedRun) -> bool:
    """Whether the temperature of the wire is imposed in a run."""
    return known_structures()[run.system].imposed_temperature >= 0
