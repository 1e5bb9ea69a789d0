"""Strata of a comparison: mode, temperature, direction, time, run ... (docs/explanation/residual-analysis.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.residual_analysis.compare import ComparedRun, Comparison
from sma_sim.evidence.residual_analysis.wire_states import RESTING, rate_of_change, wires_of
from sma_sim.model.arrays import Vector
from sma_sim.model.structures.structure import Structure

Classes = NDArray[np.int64]
STEADY_RATE = 0.05  # |dT/dt| [K/s] below which a wire counts as neither heating nor cooling
STILL_FRACTION = 0.02  # of its largest rate: below it a motion counts as none
MAX_BANDS = 8  # more cannot be read in a figure
ROUND_FACTORS = (1.0, 2.0, 2.5, 5.0, 10.0)
MODE_LABELS = (
    'at rest',
    'in mode 1 (austenite)',
    'in mode 2 (martensite)',
    'in mode 3 (inside the hysteresis)',
    'in mode 4 (to martensite)',
    'in mode 5 (to austenite)',
)
assert MODE_LABELS[RESTING] == 'at rest'
TRANSFORMING = ('no wire transforms', 'only wire 1 transforms', 'only wire 2 transforms', 'both wires transform')
QUARTERS = ('first', 'second', 'third', 'last')


@dataclass(frozen=True)
class Dimension:
    """One way to sort samples. `classes`: one array (k,) per run, -1 where a sample belongs nowhere.

    `labels` name the classes in tables. `template` makes words of one: it holds ``{}`` for the label, or, when the
    classes are bands between `edges` (one more than classes, in `unit`), for `above 330 K` and the like.
    """

    name: str
    labels: tuple[str, ...]
    template: str
    classes: tuple[Classes, ...]
    edges: tuple[float, ...] = ()
    unit: str = ''

    def words(self, first: int, last: int) -> str:
        """A class, or the bands from `first` to `last` joined, in words."""
        if not self.edges:
            return self.template.format(self.labels[first])
        low, high = f'{self.edges[first]:.4g}', f'{self.edges[last + 1]:.4g}'
        if first == 0:
            return self.template.format(f'below {high} {self.unit}'.rstrip())
        if last == len(self.labels) - 1:
            return self.template.format(f'above {low} {self.unit}'.rstrip())
        return self.template.format(f'between {low} and {high} {self.unit}'.rstrip())


def dimensions(comparison: Comparison) -> tuple[Dimension, ...]:
    """All ways to sort the samples of a comparison that have more than one class."""
    runs = comparison.runs
    found = [way for suffix, wire in wires_of(comparison.config).items() for way in wire_dimensions(runs, suffix, wire)]
    structure = comparison.config.structure
    if comparison.config.system == 'module':
        found += module_dimensions(runs)
    else:
        found += structure_dimensions(runs, structure) if structure.coordinates else bench_dimensions(runs)
    ambient = [run.states['T_E_K'] for run in runs]
    found += [
        band_dimension('ambient temperature', ambient, 'the ambient temperature is {}', 'deg C', ZERO_CELSIUS),
        quarter_dimension(runs),
        run_dimension(runs),
    ]
    return tuple(way for way in found if len(np.unique(np.concatenate(way.classes))) > 1)


def wire_dimensions(runs: Sequence[ComparedRun], suffix: str, wire: str) -> list[Dimension]:
    """By mode, temperature, heating or cooling of one wire."""
    of_wire = f' of {wire}'
    modes = tuple(run.states[f'class{suffix}'].astype(np.int64) for run in runs)
    rates = [run.states[f'dT{suffix}'] for run in runs]
    temperatures = [run.states[f'T{suffix}_K'] for run in runs]
    return [
        Dimension(f'mode{of_wire}', MODE_LABELS, wire + ' is {}', modes),
        band_dimension(f'temperature{of_wire}', temperatures, wire + ' is {}', 'deg C', ZERO_CELSIUS),
        sign_dimension(
            f'heating or cooling{of_wire}',
            rates,
            STEADY_RATE,
            ('cooling', 'neither heating nor cooling', 'heating'),
            wire + ' is {}',
        ),
    ]


def module_dimensions(runs: Sequence[ComparedRun]) -> list[Dimension]:
    """By command, motion and amplitude of a module."""
    angles = [np.degrees(run.states['alpha_rad']) for run in runs]
    rates = [rate_of_change(run.time, run.states['alpha_rad']) for run in runs]
    moving = tuple(transforming(run) for run in runs)
    return [
        Dimension('transforming wires', TRANSFORMING, '{}', moving),
        sign_dimension(
            'command',
            [run.states['J_eq_W'] for run in runs],
            0.0,
            ('J_eq heats bundle 2', 'J_eq is 0', 'J_eq heats bundle 1'),
            '{}',
        ),
        sign_dimension(
            'direction of motion',
            rates,
            STILL_FRACTION * robust_maximum(rates),
            ('alpha falls', 'alpha stands still', 'alpha rises'),
            '{}',
        ),
        band_dimension('amplitude', [np.abs(angle) for angle in angles], '|alpha| is {}', 'deg'),
    ]


def structure_dimensions(runs: Sequence[ComparedRun], structure: Structure) -> list[Dimension]:
    """By command and by the motion of every coordinate."""
    found = [
        sign_dimension(
            f'command {name}',
            [run.states[f'{name}_W'] for run in runs],
            0.0,
            (f'{name} is negative', f'{name} is 0', f'{name} is positive'),
            '{}',
        )
        for name in structure.commands
    ]
    for coordinate in structure.coordinates:
        rates = [rate_of_change(run.time, run.states[coordinate.column]) for run in runs]
        labels = (f'{coordinate.name} falls', f'{coordinate.name} stands still', f'{coordinate.name} rises')
        still = STILL_FRACTION * robust_maximum(rates)
        found.append(sign_dimension(f'direction of {coordinate.name}', rates, still, labels, '{}'))
    return found


def bench_dimensions(runs: Sequence[ComparedRun]) -> list[Dimension]:
    """By strain, its direction and the heating of a wire on a test bench."""
    strain = [100.0 * run.states['strain'] for run in runs]
    rates = [run.states['deps'] for run in runs]
    return [
        sign_dimension(
            'direction of motion',
            rates,
            STILL_FRACTION * robust_maximum(rates),
            ('unloaded', 'held', 'loaded'),
            'the wire is {}',
        ),
        band_dimension('amplitude', strain, 'the strain is {}', '%'),
        sign_dimension('heating power', [run.states['J_W'] for run in runs], 0.0, ('', 'off', 'on'), 'the power is {}'),
    ]


def transforming(run: ComparedRun) -> Classes:
    """Which wires are in mode 4 or 5 and do not rest: 0 none, 1, 2, 3 both."""
    first, second = (np.isin(run.states[f'class{suffix}'], (4.0, 5.0)) for suffix in ('_1', '_2'))
    return first.astype(np.int64) + 2 * second.astype(np.int64)


def robust_maximum(values: Sequence[Vector]) -> float:
    """A robust largest size."""
    return float(np.quantile(np.abs(np.concatenate(values)), 0.99))


def sign_dimension(
    name: str, values: Sequence[Vector], small: float, labels: tuple[str, str, str], template: str
) -> Dimension:
    """By sign: below -small, within, above small."""
    return Dimension(name, labels, template, tuple(1 + (run > small).astype(np.int64) - (run < -small) for run in values))


def band_dimension(name: str, values: Sequence[Vector], template: str, unit: str, zero: float = 0.0) -> Dimension:
    """By bands with round edges, as few as show the range; one band where nothing changes. `zero` is what `unit` calls 0."""
    joined = np.concatenate(values)
    low, high = float(np.nanmin(joined)), float(np.nanmax(joined))
    if high - low <= 1e-3 * max(abs(low), abs(high)):
        return Dimension(name, ('all',), template, tuple(np.zeros(len(run), np.int64) for run in values))
    low, high, values = low - zero, high - zero, [run - zero for run in values]
    step = round_step((high - low) / MAX_BANDS)
    first, last = int(np.floor(low / step)), int(np.ceil(high / step))
    edges = tuple(float(step * k) for k in range(first, last + 1))
    labels = tuple(f'{edges[k]:.4g} to {edges[k + 1]:.4g} {unit}'.rstrip() for k in range(len(edges) - 1))
    classes = tuple(np.clip(np.searchsorted(edges, run, side='right') - 1, 0, len(labels) - 1) for run in values)
    return Dimension(name, labels, template, classes, edges, unit)


def round_step(least: float) -> float:
    """The next number at or above `least` that is 1, 2, 2.5 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(nice * power for nice in ROUND_FACTORS if nice * power >= least * (1.0 - 1e-9)))


def quarter_dimension(runs: Sequence[ComparedRun]) -> Dimension:
    """By quarter of the run."""
    classes = tuple(np.minimum((4.0 * part_of_run(run)).astype(np.int64), 3) for run in runs)
    return Dimension('time in the run', QUARTERS, 'the run is in its {} quarter', classes)


def part_of_run(run: ComparedRun) -> Vector:
    """Time in the run, 0 at its first sample and 1 at its last (k,)."""
    found: Vector = (run.time - run.time[0]) / max(run.time[-1] - run.time[0], 1e-300)
    return found


def run_dimension(runs: Sequence[ComparedRun]) -> Dimension:
    """By run, in the order of the dataset."""
    names = tuple(run.name for run in runs)
    return Dimension('run', names, 'the run is {}', tuple(np.full(len(run.time), k) for k, run in enumerate(runs)))
