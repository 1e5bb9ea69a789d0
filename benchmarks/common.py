"""What the benchmarks share: random commands, timing, and a report for people or programs."""

from __future__ import annotations

import argparse
import json
import platform
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim import Config, Input, Model, default_parameters, find_effects
from sma_sim.model.effects.discovery import ActiveEffect

DURATION = 100.0  # [s]
STEPS = 10  # changes of the command
AMPLITUDE = 15.0  # [W]
SAMPLES = np.linspace(0.0, DURATION, 501)
CHANNELS = {'alpha_rad': 'alpha', 'U_x_m': 'U_x', 'U_y_m': 'U_y', 'T_1_K': 'T_1', 'T_2_K': 'T_2'}


def random_command(seed: int) -> Input:
    """A command that changes at STEPS random times to random levels."""
    random = np.random.default_rng(seed)
    times = np.concatenate([[0.0], np.sort(random.uniform(0.0, DURATION, STEPS - 1)), [DURATION]])
    J_eq = random.uniform(-AMPLITUDE, AMPLITUDE, STEPS + 1)
    return Input(times, np.column_stack([J_eq, np.full(STEPS + 1, 298.0)]), (False, False))


def module(model: str, rtol: float, effects: tuple[str, ...] = ()) -> Model:
    """The paper's module at a tolerance, with effects at their default values."""
    found = find_effects()
    active = tuple(ActiveEffect(found[n], tuple(p.default for p in found[n].parameters)) for n in effects)
    return Model(Config(default_parameters() | {'solver.rtol': rtol}, 'module', model, active))


def median_time(call: Callable[[], Any], repeats: int = 7) -> float:
    """Median duration of a call after one warm-up [s]."""
    call()
    durations = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        durations.append(time.perf_counter() - start)
    return float(np.median(durations))


def largest_errors(columns: Mapping[str, NDArray[np.float64]], exact: Mapping[str, NDArray[np.float64]]) -> dict[str, float]:
    """Largest error of each channel: alpha in degrees, the rest in SI units."""
    errors = {short: float(np.abs(columns[name] - exact[name]).max()) for name, short in CHANNELS.items()}
    errors['alpha'] = float(np.degrees(errors['alpha']))
    return errors


def report(description: str, measure: Callable[[argparse.Namespace], dict[str, Any]], **options: float) -> None:
    """Run `measure` with options of the types of their defaults; print its rows, or write JSON with --json."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument('--json', type=Path, metavar='FILE', help='also write the numbers as JSON')
    for name, default in options.items():
        parser.add_argument(f'--{name}', type=type(default), default=default)
    arguments = parser.parse_args()
    result = {'machine': f'{platform.machine()}, Python {platform.python_version()}', **measure(arguments)}
    show(result)
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2) + '\n')


def show(result: Mapping[str, Any], indent: str = '') -> None:
    """Print nested results, a line per group of numbers."""
    for name, value in result.items():
        if isinstance(value, Mapping) and any(isinstance(v, Mapping) for v in value.values()):
            print(f'{indent}{name}')
            show(value, indent + '  ')
        elif isinstance(value, Mapping):
            print(f'{indent}{name}: ' + ', '.join(f'{k} {shown(v)}' for k, v in value.items()))
        else:
            print(f'{indent}{name}: {shown(value)}')


def shown(value: Any) -> str:
    """A number with three digits."""
    return f'{value:.3g}' if isinstance(value, float) else str(value)
