"""Runs of 100 s under the command of a controller, 5,000 changes, beside the same with 10 steps: time and error.

python benchmarks/dense.py [--turns 5] [--json FILE]

A PI controller of alpha at 50 Hz, whose sensor has noise, follows a sine; the larger its gains, the more its command changes
from row to row. Tangents are those of a search, its residuals included, and its trial steps are made beside them. Errors of
the simulation are against one at rtol 1e-8.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from common import DURATION, module, random_command, report
from tangents import NOISE, timed

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


def times_of(model: str, command: Input, turns: int) -> dict[str, float]:
    """Milliseconds of a simulation, and of its tangents in a fit; the error of alpha and T_1."""
    made = module(model, 1e-5)
    shown, simulation = timed(lambda: simulate(made, command, TIMES), turns)
    exact = simulate(module(model, 1e-8), command, TIMES)
    channels = {'U_y': 'U_y_m', 'alpha': 'alpha_rad', 'F_1': 'F_1_N', 'F_2': 'F_2_N'}
    measured = {name: shown[column] for name, column in channels.items()}
    dataset = Dataset((Recording('run', 'module', TIMES, measured, command),), NOISE)
    problem = problem_for(dataset, made.config, FitOptions(), 1)
    z = start_point(problem) + 0.05
    with ThreadPoolExecutor(1) as pool:
        (linear,), tangents = timed(lambda: linearize(problem, z, pool), turns)
        nearby = near(problem, [linear.correction])
        _, trial = timed(lambda: residuals_at(nearby, z + 0.01, pool), turns)
    return {
        'simulation_ms': simulation,
        'trial_ms': trial,
        'tangents_ms': tangents,
        'steps': float(shown.steps),
        'alpha_error_deg': float(np.degrees(np.abs(shown['alpha_rad'] - exact['alpha_rad']).max())),
        'T_1_error_K': float(np.abs(shown['T_1_K'] - exact['T_1_K']).max()),
    }


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All numbers."""
    result: dict[str, Any] = {}
    for model in ('hybrid', 'mas'):
        few = times_of(model, random_command(0), arguments.turns)
        result[f'{model}, 10 steps'] = few
        for gains in GAINS:
            command = closed_loop(model, gains)
            dense = times_of(model, command, arguments.turns)
            changes = float(np.std(np.diff(command.values[:, 0])))
            result[f'{model}, changes by {changes:.2g} W'] = dense | {
                'simulation_ratio': dense['simulation_ms'] / few['simulation_ms'],
                'trial_ratio': dense['trial_ms'] / few['trial_ms'],
                'tangents_ratio': dense['tangents_ms'] / few['tangents_ms'],
            }
    return {'dense commands': result}


if __name__ == '__main__':
    report(__doc__ or '', measure, turns=5)
