"""Stacks of one to ten modules: time of a 100 s run against their number, and random stacks whose runs fail.

python benchmarks/stack.py [--runs 1000] [--json FILE]

Every module has its own random command, or all have the same one, so that their wires transform together. The random stacks
hang, lean up to a tenth, and have parameters within a quarter of the defaults.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from common import report
from structures import random_input, varied

from sma_sim import Config, Model, simulate
from sma_sim.model.structures.stack import MAX_MODULES, stack_of

TIMED, REPEATS = 5, 7  # runs of which the time is taken, and how often each
HANGING, LEANING = 9.81, 1.0  # [m/s^2] along the stack, and either way across it


def processor_time(call: Callable[[], Any]) -> float:
    """The shortest time that the processor needs for a call, whatever else it does [s]."""
    durations = []
    for _ in range(REPEATS):
        start = time.process_time()
        call()
        durations.append(time.process_time() - start)
    return min(durations)


def scaling(modules: int, kind: str, together: bool) -> dict[str, float]:
    """Medians of runs of a stack at the defaults: time [ms], steps, time of a step [us]; all modules with one command?"""
    structure, times, steps = stack_of(modules), [], []
    model = Model(Config({'stack.modules': float(modules)}, 'stack', kind))
    for seed in range(TIMED):
        source = random_input(structure, structure.default_values['wire.n'], np.random.default_rng(seed))
        if together:
            source.values[:, :modules] = source.values[:, :1]
        times.append(1e3 * processor_time(lambda source=source: simulate(model, source, 5.0)))
        steps.append(simulate(model, source, 5.0).steps)
    return {
        'milliseconds': float(np.median(times)),
        'steps': float(np.median(steps)),
        'microseconds_per_step': float(np.median(1e3 * np.array(times) / steps)),
    }


def random_runs(kind: str, count: int) -> dict[str, Any]:
    """Failures of `count` random stacks."""
    failures = []
    for seed in range(count):
        random = np.random.default_rng(seed)
        structure = stack_of(int(random.integers(1, MAX_MODULES + 1)))
        values = varied(structure, random)
        values |= {'stack.g_x': random.uniform(0.0, HANGING), 'stack.g_y': random.uniform(-LEANING, LEANING)}
        run = simulate(Model(Config(values, 'stack', kind)), random_input(structure, values['wire.n'], random), 5.0)
        if not run.completed:
            failures.append(f'{kind}, seed {seed}: {run.reason}')
    print(*failures[:3], sep='\n', end='\n' if failures else '')
    return {'runs': count, 'failures': len(failures)}


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """A row for each number of modules, and for the random runs of each kind of kinetics."""
    result: dict[str, Any] = {}
    for kind in ('hybrid', 'mas'):
        for together in (False, True):
            for modules in range(1, MAX_MODULES + 1):
                name = f'{kind}, {"one command, " if together else ""}modules {modules}'
                result[name] = scaling(modules, kind, together)
        result[f'{kind}, random stacks'] = random_runs(kind, arguments.runs)
    return result


if __name__ == '__main__':
    report(__doc__, measure, runs=1000)
