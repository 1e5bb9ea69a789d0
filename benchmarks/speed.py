"""Time and error of 100 s runs, cost of effects, use of all cores.

python benchmarks/speed.py [--runs 30] [--parallel 1000] [--json FILE]
"""

from __future__ import annotations

import argparse
import os
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from common import SAMPLES, largest_errors, median_time, module, random_command, report

from sma_sim import simulate

TOLERANCES = {'hybrid': (1e-4, 1e-5), 'mas': (3e-5, 1e-5)}
EXACT = 1e-9
TURNS, BATCHES = 9, 10
WITHOUT_STATES = (
    ('gravity', 'natural_convection', 'thermal_expansion'),
    ('gravity', 'natural_convection', 'polycrystal'),
    ('gravity', 'natural_convection', 'guide_friction'),
)
WITH_STATES = (('ambient_heating', 'beam_creep', 'driver_lag'), ('ambient_heating', 'beam_creep', 'sensor_lag'))


def runs_at(model: str, rtol: float, count: int) -> dict[str, float]:
    """Times and errors of `count` random runs."""
    times, steps, alphas = [], [], []
    fast, exact = module(model, rtol), module(model, EXACT)
    for seed in range(count):
        command = random_command(seed)
        run = simulate(fast, command, SAMPLES)
        times.append(1e3 * median_time(lambda command=command: simulate(fast, command, SAMPLES)))
        steps.append(run.steps)
        alphas.append(largest_errors(run.columns, simulate(exact, command, SAMPLES).columns)['alpha'])
    return {
        'rtol': rtol,
        'median_ms': float(np.median(times)),
        'worst_over_median': float(max(times) / np.median(times)),
        'median_steps': float(np.median(steps)),
        'median_alpha_error_deg': float(np.median(alphas)),
        'largest_alpha_error_deg': float(max(alphas)),
    }


def cost_of_effects(model: str, count: int) -> dict[str, float]:
    """Time with effects over time without, under the same command, by turns; the median over commands."""
    result = {}
    nominal = module(model, 1e-5)
    for names in WITHOUT_STATES + WITH_STATES:
        rich = module(model, 1e-5, names)
        ratios = []
        for seed in range(count):
            command = random_command(seed)
            times: list[list[float]] = [[], []]
            for _ in range(TURNS):
                for k, one in enumerate((rich, nominal)):
                    start = time.perf_counter()
                    simulate(one, command, SAMPLES)
                    times[k].append(time.perf_counter() - start)
            ratios.append(np.median(times[0]) / np.median(times[1]))
        result[' + '.join(names)] = float(np.median(ratios))
    return result


def use_of_cores(count: int) -> dict[str, float]:
    """Runs in threads on all cores against the same runs one after the other."""
    fast = module('hybrid', 1e-5)
    commands = [random_command(seed) for seed in range(count)]
    workers = os.cpu_count() or 1

    def run(command: Any) -> None:
        simulate(fast, command, SAMPLES)

    run(commands[0])
    seconds, ratios = 0.0, []
    with ThreadPoolExecutor(workers) as pool:
        for batch in range(BATCHES):  # by turns, since the machine is shared
            part = commands[batch::BATCHES]
            start = time.perf_counter()
            for command in part:
                run(command)
            middle = time.perf_counter()
            list(pool.map(run, part))
            end = time.perf_counter()
            seconds += end - middle
            ratios.append((middle - start) / (end - middle) / workers)
    return {'cores': workers, 'runs': count, 'seconds': seconds, 'efficiency': float(np.median(ratios))}


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All numbers."""
    return {
        '100 s runs': {
            f'{model}, rtol {rtol:g}': runs_at(model, rtol, arguments.runs)
            for model, tolerances in TOLERANCES.items()
            for rtol in tolerances
        },
        'time with effects over nominal': {model: cost_of_effects(model, 5) for model in TOLERANCES},
        'all cores': use_of_cores(arguments.parallel),
    }


if __name__ == '__main__':
    report(__doc__ or '', measure, runs=30, parallel=1000)
