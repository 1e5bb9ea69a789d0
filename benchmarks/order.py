"""Measured order of the stepper, of its dense output, of event times, and of the MAS model as it is in the paper.

    python benchmarks/order.py [--halvings 4] [--json FILE]

Errors are those of all states relative to their sizes, after 1 s of equal steps (dense output: within one step).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from common import report

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test' / 'solver'))
from systems import make_model, smooth_state
from test_order import PROBLEMS, fixed_steps, heated_martensite, model_of, problem


def study(error: Callable[[int], float], halvings: int) -> dict[str, float]:
    """Errors under halving of the step, and the mean order."""
    errors = [float(error(2**k)) for k in range(halvings)]
    named = {f'h/{2**k}' if k else 'h': value for k, value in enumerate(errors)}
    return named | {'order': float(np.log2(errors[0] / errors[-1]) / (halvings - 1))}


def steps_of(model: Any, start: Any, count: int, halvings: int) -> dict[str, float]:
    """Order of steps on a problem."""
    exact = fixed_steps(model, start, 1.0, 64 * count)
    return study(lambda n: np.abs((fixed_steps(model, start, 1.0, n * count) - exact) / model.scales).max(), halvings)


def dense_of(model: Any, start: Any, count: int, halvings: int, theta: float = 0.5) -> dict[str, float]:
    """Order of the error within one step (one more than the order of the output)."""

    def error(n: int) -> float:
        h = 0.5 / count / n
        exact = fixed_steps(model, start, theta * h, 40)
        return float(np.abs((fixed_steps(model, start, h, 1, theta) - exact) / model.scales).max())

    return study(error, halvings)


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All tables."""
    n = arguments.halvings
    stiff = make_model('module', 'mas', solver__rtol=1e-10)
    steps = {name: steps_of(model_of(name), *problem(name), n) for name in PROBLEMS}
    steps['stiff MAS module'] = steps_of(stiff, smooth_state(stiff, J_eq=10.0, after=4.0), 8, n)
    return {
        'steps': steps,
        'dense output, one step': {name: dense_of(model_of(name), *problem(name), n) for name in PROBLEMS},
        'time of an event [s], h = 0.08 s': study(lambda k: abs(np.subtract(*heated_martensite(0.08 / k))), n),
    }


if __name__ == '__main__':
    report(__doc__ or '', measure, halvings=4)
