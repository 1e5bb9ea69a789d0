"""Derivatives of a fit by tangents beside those by differences of runs: processor time, and error.

python benchmarks/tangents.py [--turns 5] [--json FILE]

The residuals of three recordings of 100 s in all unknowns of a fit, at the tolerance of a search. Errors are against central
differences at rtol 1e-8, extrapolated by Richardson, as the median over the unknowns of the RMS over the samples, each in
units of the noise and of a standard deviation of the prior.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from common import DURATION, module, random_command, report
from numpy.typing import NDArray

from sma_sim import Recording, simulate
from sma_sim.evidence.estimation.free_parameters import choose_free
from sma_sim.evidence.estimation.problem import (
    LinearizedRun,
    Problem,
    accumulated,
    better_steps,
    linearize,
    linearize_by_differences,
    normal_equations,
    start_point,
)
from sma_sim.evidence.estimation.residuals import fit_data

NOISE = {'U_y': 2e-5, 'alpha': 3.5e-4, 'F_1': 0.05, 'F_2': 0.05}
EXACT, STEP, AWAY = 1e-8, 2e-3, 0.05
CASES: Sequence[tuple[str, tuple[str, ...]]] = (
    ('hybrid', ()),
    ('mas', ()),
    ('hybrid', ('gravity', 'natural_convection')),
    ('mas', ('gravity', 'natural_convection')),
)


def problem_of(model: str, effects: tuple[str, ...]) -> Problem:
    """A fit to three recordings of the model itself."""
    made, times = module(model, 1e-5, effects), np.linspace(0.0, DURATION, 1001)
    runs = []
    for seed in range(3):
        command = random_command(seed)
        shown = simulate(made, command, times, channels=tuple(NOISE))
        recording = Recording(f'run{seed}', 'module', times, dict(zip(NOISE, shown.columns.values(), strict=True)), command)
        runs.append(fit_data(recording, NOISE))
    return Problem(made.config, tuple(runs), choose_free(made.config)[0])


def timed(call: Callable[[], Any], turns: int) -> tuple[Any, float]:
    """What a call gives, and its least processor time [ms]."""
    found, least = call(), np.inf
    for _ in range(turns):
        start = time.process_time()
        call()
        least = min(least, 1e3 * (time.process_time() - start))
    return found, least


def errors(found: Sequence[LinearizedRun], exact: Sequence[NDArray[np.float64]]) -> float:
    """The median error of a derivative."""
    parts = [np.sqrt(((run.jacobian - one) ** 2).mean(axis=(1, 2))) for run, one in zip(found, exact, strict=True)]
    return float(np.median(np.concatenate(parts)))


def extrapolated(problem: Problem, z: NDArray[np.float64], pool: Executor) -> list[NDArray[np.float64]]:
    """Derivatives of every run by extrapolated differences."""
    precise = replace(problem, runs=tuple(replace(run, step_limited=False) for run in problem.runs)).at_tolerance(EXACT)
    wide, close = (
        linearize_by_differences(precise, z, pool, np.full(len(z), step), central=True) for step in (STEP, 0.5 * STEP)
    )
    return [(4.0 * b.jacobian - a.jacobian) / 3.0 for a, b in zip(wide, close, strict=True)]


def compare(problem: Problem, turns: int) -> dict[str, float]:
    """Times and errors of the three ways."""
    z = start_point(problem) + AWAY
    with ThreadPoolExecutor(1) as pool:
        tangents, t = timed(lambda: linearize(problem, z, pool), turns)
        one_sided, t_1 = timed(lambda: linearize_by_differences(problem, z, pool), turns)
        hessian = accumulated([normal_equations(run, False) for run in one_sided], z)[2]
        steps = better_steps(problem, hessian, central=True)
        central, t_2 = timed(lambda: linearize_by_differences(problem, z, pool, steps, central=True), turns)
        exact = extrapolated(problem, z, pool)
    return {
        'unknowns of a run': len(problem.indices()[0]),
        'tangents_ms': t,
        'one_sided_ms': t_1,
        'central_ms': t_2,
        'one_sided_over_tangents': t_1 / t,
        'central_over_tangents': t_2 / t,
        'error_tangents': errors(tangents, exact),
        'error_one_sided': errors(one_sided, exact),
        'error_central': errors(central, exact),
    }


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All numbers."""
    return {
        'derivatives of three runs': {
            ' + '.join((model, *effects)): compare(problem_of(model, effects), arguments.turns) for model, effects in CASES
        }
    }


if __name__ == '__main__':
    report(__doc__ or '', measure, turns=5)
