"""Every structure under random commands: time of a 100 s run against the module's, and runs that fail.

python benchmarks/structures.py [--runs 1000] [--json FILE]

The parameters of the structures vary by a quarter about their defaults, lengths too, with wires cut to fit; commands reach
levels that bring wires to their working temperature.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from common import DURATION, STEPS, median_time, report

from sma_sim import Config, Input, Model, simulate
from sma_sim.model.structures.discovery import package_structures
from sma_sim.model.structures.structure import Structure, numbers, record

LEVEL = 1.2  # [W] for each wire of a bundle
SPREAD = 0.25
TIMED = 7  # runs of which the time is taken


def random_input(structure: Structure, wires: float, random: np.random.Generator) -> Input:
    """Commands that change at random times to random levels; `wires` in each bundle."""
    times = np.concatenate([[0.0], np.sort(random.uniform(0.0, DURATION, STEPS - 1)), [DURATION]])
    low = -1.0 if structure.antagonistic else 0.0
    levels = LEVEL * wires * random.uniform(low, 1.0, (STEPS + 1, len(structure.commands)))
    values = np.column_stack([levels, np.full(STEPS + 1, 298.0)])
    return Input(times, values, (False,) * values.shape[1], structure.input_columns)


def varied(structure: Structure, random: np.random.Generator) -> dict[str, float]:
    """Parameters of a structure about their defaults, and wires that are as slack or as taut as at these."""
    values = structure.default_values
    declared = structure.default_constants
    for name, parameter in structure.declared.items():
        if name != structure.size_name:
            values[name] = float(np.clip(values[name] * (1.0 + SPREAD * random.uniform(-1.0, 1.0)), *parameter.bounds))
    values['wire.l0'] *= rest_length(structure, structure.constants_of(values)) / rest_length(structure, declared)
    return values


def rest_length(structure: Structure, constants: Any) -> float:
    """Length of the first wire in the pose q = 0 [m]."""
    assert structure.lengths is not None
    pose = record('Pose', structure.coordinate_names)
    return float(numbers(structure.lengths(pose(*(0.0 for _ in structure.coordinates)), constants))[0])


def runs_of(structure: Structure, kind: str, count: int) -> dict[str, Any]:
    """Failures of `count` random runs, and the median time [ms] and steps of the first ones at the defaults."""
    failures, times, steps = [], [], []
    wires = structure.default_values['wire.n']
    for seed in range(count):
        random = np.random.default_rng(seed)
        source = random_input(structure, wires, random)
        run = simulate(Model(Config(varied(structure, random), structure.name, kind)), source, 5.0)
        if not run.completed:
            failures.append(f'{kind}, seed {seed}: {run.reason}')
        if seed < TIMED:
            model = Model(Config(system=structure.name, kinetics=kind))
            times.append(1e3 * median_time(lambda model=model, source=source: simulate(model, source, 5.0)))
            steps.append(simulate(model, source, 5.0).steps)
    return {'milliseconds': float(np.median(times)), 'steps': float(np.median(steps)), 'failures': failures}


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """A row for each structure and kind of kinetics."""
    structures = [found for found in package_structures().values() if found.coordinates]
    result: dict[str, Any] = {}
    for kind in ('hybrid', 'mas'):
        found = {structure.name: runs_of(structure, kind, arguments.runs) for structure in structures}
        for name, one in found.items():
            ratio = one['milliseconds'] / found['module']['milliseconds']
            result[f'{name}, {kind}'] = {
                'milliseconds': one['milliseconds'],
                'times_the_module': ratio,
                'steps': one['steps'],
                'failures': len(one['failures']),
            }
            print(*one['failures'][:3], sep='\n', end='\n' if one['failures'] else '')
    return result


if __name__ == '__main__':
    report(__doc__, measure, runs=1000)
