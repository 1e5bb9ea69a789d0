"""Random commands (steps and ramps, +-30 W), perturbed parameters, both models, at tolerances from 1e-3 to 1e-7.

python benchmarks/robustness.py [--runs 1000] [--json FILE]          (runs per tolerance)
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from common import report

from sma_sim import Config, Input, Model, default_parameters, simulate

TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
DURATION, AMPLITUDE, SPREAD = 100.0, 30.0, 0.15
FIXED = ('wire.l0', 'wire.T0', 'wire.n', 'beam.L', 'plate.W', 'environment.T_E')


class Outcome(NamedTuple):
    """How one run went."""

    seed: int
    model: str
    rtol: float
    steps: int
    problem: str


def random_case(seed: int) -> tuple[dict[str, float], str, Input]:
    """Parameters, kinetics and command of one run."""
    random = np.random.default_rng(seed)
    parameters = default_parameters()
    for name in parameters:
        if name.startswith(('wire.', 'beam.', 'plate.')) and name not in FIXED:
            parameters[name] *= 1.0 + SPREAD * random.uniform(-1.0, 1.0)
    parameters['wire.l0'] = parameters['beam.L'] * random.uniform(0.945, 0.975)
    parameters['environment.T_E'] = random.uniform(285.0, 310.0)
    count = random.integers(2, 40)
    times = np.concatenate([[0.0], np.sort(random.uniform(0.0, DURATION, count)), [DURATION]])
    J_eq = random.uniform(-AMPLITUDE, AMPLITUDE, len(times)) * (random.random(len(times)) > 0.2)
    values = np.column_stack([J_eq, np.full(len(times), parameters['environment.T_E'])])
    return parameters, ('hybrid', 'mas')[seed % 2], Input(times, values, (bool(random.random() < 0.5), False))


def run_one(seed: int, rtol: float) -> Outcome:
    """One run and what went wrong in it."""
    parameters, kind, source = random_case(seed)
    try:
        model = Model(Config(parameters | {'solver.rtol': rtol}, 'module', kind))
        run = simulate(model, source, np.linspace(0.0, DURATION, 201))
    except Exception as error:
        return Outcome(seed, kind, rtol, 0, f'{type(error).__name__}: {error}')
    finite = all(np.isfinite(column).all() for column in run.columns.values())
    problem = '' if run.completed and finite else run.reason if not run.completed else 'NaN'
    return Outcome(seed, kind, rtol, run.steps, problem)


def run_all(count: int, tolerances: Sequence[float]) -> list[Outcome]:
    """`count` runs at each tolerance, on all cores."""
    run_one(0, 1e-3)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(run_one, *zip(*[(s, r) for r in tolerances for s in range(count)], strict=True)))


def judge(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Failures, and the longest run over the median, per tolerance and model (the worse of the two)."""
    result: dict[str, Any] = {}
    for rtol in sorted({case.rtol for case in outcomes}, reverse=True):
        row: dict[str, Any] = {'runs': 0, 'failed': 0, 'most_over_median': 0.0}
        for kind in ('hybrid', 'mas'):
            own = [case for case in outcomes if case.rtol == rtol and case.model == kind]
            steps = np.array([case.steps for case in own])
            longest = own[int(np.argmax(steps))]
            row['runs'] += len(own)
            row['failed'] += sum(bool(case.problem) for case in own)
            row[f'median_steps_{kind}'] = int(np.median(steps))
            row[f'most_steps_{kind}'] = f'{longest.steps} (seed {longest.seed})'
            row['most_over_median'] = max(row['most_over_median'], float(longest.steps / np.median(steps)))
            for case in own:
                if case.problem:
                    print(f'{kind}, rtol {rtol:g}, seed {case.seed}: {case.problem}')
        result[f'rtol {rtol:g}'] = row
    return result


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All numbers."""
    return judge(run_all(arguments.runs, TOLERANCES))


if __name__ == '__main__':
    report(__doc__ or '', measure, runs=1000)
