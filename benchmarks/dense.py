"""Runs of 100 s under the command of a controller, 5,000 changes, beside the same with 10 steps: time and error.

python benchmarks/dense.py [--turns 20] [--json FILE]

A PI controller of alpha at 50 Hz, whose sensor has noise, follows a sine; the larger its gains, the more its command changes
from row to row. Tangents are those of a search, its residuals included, and its trial steps are made beside them. Errors of
the simulation are against one at rtol 1e-8.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Hashable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Any

import numpy as np
from common import DURATION, module, random_command, report
from tangents import NOISE

from sma_sim import Dataset, FitOptions, Input, Recording, module_input, simulate
from sma_sim.evidence.estimation.calibrate import problem_for
from sma_sim.evidence.estimation.problem import linearize, near, residuals_at, start_point
from sma_sim.solver.fixed_rate import FixedRateRun

CONTROL_RATE, RATE, J_MAX, T_E = 50, 500, 15.0, 298.0
AMPLITUDE, PERIOD = np.radians(6.0), 20.0
GAINS = ((40.0, 15.0), (200.0, 100.0), (1000.0, 800.0))  # [W/rad], [W/(rad s)]
TIMES = np.linspace(0.0, DURATION, 1003)


def closed_loop(model: str, gains: tuple[float, float]) -> Input:
    """The command that a controller gives."""
    random, run = np.random.default_rng(0), FixedRateRun(module(model, 1e-5), RATE, np.array([0.0, T_E]))
    count, integral = int(DURATION * CONTROL_RATE), 0.0
    J_eq = np.zeros(count + 1)
    for k in range(count):
        target = AMPLITUDE * np.sin(2.0 * np.pi * k / CONTROL_RATE / PERIOD)
        error = target - run.shown('alpha') - NOISE['alpha'] * random.standard_normal()
        wanted = gains[0] * error + integral
        J_eq[k] = min(max(wanted, -J_MAX), J_MAX)
        if J_eq[k] == wanted:
            integral += gains[1] * error / CONTROL_RATE
        run.step(np.array([J_eq[k], T_E]), RATE // CONTROL_RATE)
    J_eq[-1] = J_eq[-2]
    return module_input((np.arange(count + 1) / CONTROL_RATE).tolist(), J_eq.tolist())


def calls_of(model: str, command: Input, pool: Executor) -> tuple[dict[str, Callable[[], Any]], dict[str, float]]:
    """A simulation, its tangents in a fit and a trial step beside them, to be called; the error of alpha and T_1."""
    made = module(model, 1e-5)
    shown, exact = simulate(made, command, TIMES), simulate(module(model, 1e-8), command, TIMES)
    channels = {'U_y': 'U_y_m', 'alpha': 'alpha_rad', 'F_1': 'F_1_N', 'F_2': 'F_2_N'}
    measured = {name: shown[column] for name, column in channels.items()}
    dataset = Dataset((Recording('run', 'module', TIMES, measured, command),), NOISE)
    problem = problem_for(dataset, made.config, FitOptions(), 1)
    z = start_point(problem) + 0.05
    (linear,) = linearize(problem, z, pool)
    nearby = near(problem, [linear.correction])
    calls: dict[str, Callable[[], Any]] = {
        'simulation': lambda: simulate(made, command, TIMES),
        'trial': lambda: residuals_at(nearby, z + 0.01, pool),
        'tangents': lambda: linearize(problem, z, pool),
    }
    return calls, {
        'steps': float(shown.steps),
        'alpha_error_deg': float(np.degrees(np.abs(shown['alpha_rad'] - exact['alpha_rad']).max())),
        'T_1_error_K': float(np.abs(shown['T_1_K'] - exact['T_1_K']).max()),
    }


def least_times(calls: Mapping[Hashable, Callable[[], Any]], turns: int) -> dict[Hashable, float]:
    """The least processor time of each call [ms]; they take turns, since the machine is shared."""
    least = dict.fromkeys(calls, np.inf)
    for turn in range(turns + 1):  # the first warms up
        for name, call in calls.items():
            start = time.process_time()
            call()
            if turn:
                least[name] = min(least[name], 1e3 * (time.process_time() - start))
    return least


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All numbers."""
    result: dict[str, Any] = {}
    for model in ('hybrid', 'mas'):
        commands = {f'{model}, 10 steps': random_command(0)}
        for gains in GAINS:
            command = closed_loop(model, gains)
            commands[f'{model}, changes by {float(np.std(np.diff(command.values[:, 0]))):.2g} W'] = command
        with ThreadPoolExecutor(1) as pool:
            made = {name: calls_of(model, command, pool) for name, command in commands.items()}
            least = least_times(
                {(name, kind): call for name in made for kind, call in made[name][0].items()}, arguments.turns
            )
        first, *others = made
        for name in made:
            result[name] = {f'{kind}_ms': least[name, kind] for kind in made[name][0]} | made[name][1]
        for name in others:
            ratios = {f'{kind}_ratio': least[name, kind] / least[first, kind] for kind in made[name][0]}
            result[name] |= ratios
    return {'dense commands': result}


if __name__ == '__main__':
    report(__doc__ or '', measure, turns=20)
