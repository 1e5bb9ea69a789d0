"""Runs with random effects, values from their realistic ranges, both kinetics and varied commands: does any stall?

    python benchmarks/fuzz_effects.py [--first 0] [--runs 5000] [--json FILE]

Run k is the same everywhere, so that batches (--first) can be made one after the other or side by side. Every run that
does not reach the end of its input is printed with all that is needed to repeat it.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from typing import Any

import numpy as np
from common import report

from sma_sim import Config, Input, Model, default_parameters, find_effects, module_input, simulate
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.effects.effect import Effect

DURATION = 40.0  # [s]
LARGEST = 30.0  # [W]
STEPS = 8  # changes of a random command
TIMES = np.linspace(0.0, DURATION, 401)


def random_effect(effect: Effect, random: np.random.Generator) -> ActiveEffect:
    """An effect with values from its realistic ranges, one in four at an end of it."""
    values = []
    for parameter in effect.parameters:
        low, high = parameter.realistic or (parameter.default, parameter.default)
        part = random.uniform() if random.uniform() < 0.75 else random.integers(2)
        values.append(float(low + part * (high - low)))
    return ActiveEffect(effect, tuple(values))


def random_command(random: np.random.Generator) -> Input:
    """Full heating of one bundle held, random levels that are held, or ramps between them."""
    kind = random.integers(3)
    if kind == 0:
        level = LARGEST * random.choice([-1.0, 1.0])
        return module_input([0.0, DURATION], [level, level])
    times = np.concatenate([[0.0], np.sort(random.uniform(0.0, DURATION, STEPS - 1)), [DURATION]])
    return module_input(list(times), list(random.uniform(-LARGEST, LARGEST, STEPS + 1)), linear=bool(kind == 2))


def drawn(k: int) -> tuple[Model, Input]:
    """Run number k: one effect or three, the kinetics, the tolerance and the command."""
    random = np.random.default_rng(k)
    effects = find_effects()
    names = random.choice(sorted(effects), 1 if random.uniform() < 0.5 else 3, replace=False)
    active = tuple(random_effect(effects[name], random) for name in names)
    rtol = 10.0 ** random.uniform(-5.5, -4.0)
    kinetics = str(random.choice(['hybrid', 'mas']))
    return Model(Config(default_parameters() | {'solver.rtol': rtol}, 'module', kinetics, active)), random_command(random)


def described(model: Model) -> str:
    """The options that give this model on the command line."""
    effects = [
        f'--effect {active.effect.name}:'
        + ','.join(f'{p.name}={v!r}' for p, v in zip(active.effect.parameters, active.values, strict=True))
        for active in model.config.effects
    ]
    rtol = model.config.parameters['solver.rtol']
    return f'--model {model.config.simulated_kinetics} {" ".join(effects)} --set solver.rtol={rtol!r}'


def fuzz(first: int, count: int) -> dict[str, Any]:
    """Make the runs; how many ended how, and the longest of them."""
    ends: Counter[str] = Counter()
    longest, slowest, steps, chattering = (0, -1), (0.0, -1), [], 0
    for k in range(first, first + count):
        model, command = drawn(k)
        start = time.thread_time()
        run = simulate(model, command, TIMES)
        seconds = time.thread_time() - start
        finite = all(np.isfinite(column).all() for column in run.columns.values())
        reason = run.reason.partition(':')[0]  # what follows has numbers of its own
        ends['completed' if run.completed and finite else reason if finite else 'not finite'] += 1
        steps.append(run.steps)
        chattering += run.chattering > 0
        longest, slowest = max(longest, (run.steps, k)), max(slowest, (seconds, k))
        if not (run.completed and finite):
            print(f'run {k}: {run.reason}, at {run.end:g} s after {run.steps} steps and {seconds:.2g} s: {described(model)}')
    return {
        'runs': count,
        **ends,
        'median_steps': float(np.median(steps)),
        'steps_99_percent': float(np.quantile(steps, 0.99)),
        'most_steps': longest[0],
        'most_steps_in_run': longest[1],
        'runs_that_chatter': chattering,
        'longest_s': slowest[0],
        'longest_run': slowest[1],
    }


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """The numbers of one batch."""
    return {'random effects': fuzz(arguments.first, arguments.runs)}


if __name__ == '__main__':
    report(__doc__ or '', measure, first=0, runs=5000)
