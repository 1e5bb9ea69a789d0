"""Tests of a wire: their features as tables for people and as plain data for programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from sma_sim.evidence.estimation.curve_features import TEMPERATURES, CurveFeatures, IsobaricTest, IsothermalTest
from sma_sim.evidence.residual_analysis.wire_tests import Characterization, EvaluatedTest


def features_as_text(found: CurveFeatures) -> list[str]:
    """Tables of what the tests of a wire show."""
    tables = [tests_as_text(found.isobaric)] if found.isobaric else []
    tables += [plateaus_as_text(found.isothermal)] if found.isothermal else []
    return [line for table in tables for line in table]


def plateaus_as_text(tests: Sequence[IsothermalTest]) -> list[str]:
    """A table of the plateau stresses."""
    lines = [
        'plateau stresses of isothermal tests [MPa], strain that the plateau takes:',
        'test                 temperature [deg C]  loading  unloading   strain',
    ]
    for test in tests:
        numbers = f'{1e-6 * test.loading:9.1f}{1e-6 * test.unloading:11.1f}{100.0 * test.plateau_strain:7.2f} %'
        lines.append(f'{test.name:<20} {test.temperature - 273.15:19.1f}{numbers}')
    return lines


def tests_as_text(tests: Sequence[IsobaricTest]) -> list[str]:
    """A table of the transformation temperatures, in deg C; of tests of several cycles some of these, and their drift."""
    lines = [
        'transformation temperatures by tangents [deg C], strain recovered by heating:',
        'test                 stress [MPa]     M_f     M_s     A_s     A_f   strain',
    ]
    for test in tests:
        if not test.cycles:
            lines.append(line_of(test.name, test))
            continue
        lines += [line_of(f'{test.name} {k + 1}', test.cycles[k]) for k in shown_cycles(len(test.cycles))]
        lines.append(drift_sentence(test))
    return lines


def drift_sentence(test: IsobaricTest) -> str:
    """By how much the cycles of a test drift, from the first to the last."""
    first, last = test.cycles[0], test.cycles[-1]
    moved = (
        f'{name} {after - before:+.1f} K'
        for name, before, after in zip(TEMPERATURES, first.temperatures, last.temperatures, strict=True)
    )
    return (
        f'{test.name}: {len(test.cycles)} cycles, from the first to the last {", ".join(moved)}, strain at the hottest '
        f'point {100.0 * (last.hottest_strain - first.hottest_strain):+.3f} %, recovered '
        f'{100.0 * (last.recovered - first.recovered):+.3f} %'
    )


def characterization_data(found: Characterization) -> dict[str, Any]:
    """The tests for programs, by recording; SI units, None where something is unknown."""
    return {
        'isobaric': {test.run.name: features_data(test) for test in found.isobaric},
        'isothermal': {test.run.name: features_data(test) for test in found.isothermal},
        'slopes': {'to_martensite': found.slopes[0], 'to_austenite': found.slopes[1]},
    }


def features_data(test: EvaluatedTest[Any]) -> dict[str, Any]:
    """A test as plain data: measured, and of the model."""
    return {
        'held_out': test.run.held_out,
        'measured': asdict(test.measured),
        'model': asdict(test.model) if test.model else None,
    }


def line_of(name: str, test: IsobaricTest) -> str:
    """One line of the table."""
    numbers = ''.join(f'{T - 273.15:8.1f}' for T in test.temperatures)
    return f'{name:<20} {test.stress / 1e6:12.4g} {numbers} {100.0 * test.recovered:6.2f} %'


def shown_cycles(count: int) -> list[int]:
    """Indices of the cycles that stand for all, 1, 2, 5, 10, ... and the last: a drift is fast at first."""
    decades = (10**power for power in range(len(str(count))))
    numbers = {step * decade for decade in decades for step in (1, 2, 5)}
    return [number - 1 for number in sorted(numbers | {count}) if number <= count]
