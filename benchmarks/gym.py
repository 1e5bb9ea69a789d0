"""Steps per second of the vectorised Gymnasium environments, a control period of 20 ms each.

python benchmarks/gym.py [--robots 64] [--steps 500] [--json FILE]
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import gymnasium
import numpy as np
from common import report

from sma_sim.gym import ENVIRONMENTS


def measured(name: str, robots: int, steps: int) -> dict[str, float]:
    """Steps of all robots together per second of wall and of processor time, under random actions."""
    env = gymnasium.make_vec(f'sma_sim/{name}-v0', num_envs=robots)
    random = np.random.default_rng(0)
    actions = random.uniform(-1.0, 1.0, (steps, robots, 1)).astype(np.float32)
    env.reset(seed=0)
    env.step(actions[0])
    wall, used = time.perf_counter(), time.process_time()
    for action in actions:
        env.step(action)
    wall, used = time.perf_counter() - wall, time.process_time() - used
    return {'steps_per_second': robots * steps / wall, 'steps_per_processor_second': robots * steps / used}


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Every environment."""
    return {name: measured(name, arguments.robots, arguments.steps) for name in ENVIRONMENTS}


if __name__ == '__main__':
    report(__doc__, measure, robots=64, steps=500)
