"""Time to the first result of a simulation and of a node: with nothing compiled yet, and on every later start.

python benchmarks/startup.py [--starts 5] [--json FILE]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np
from common import report

PROGRAMS = {
    'simulation': """
import numpy as np
from sma_sim import Input, Model, simulate
simulate(Model(), Input(np.array([0.0, 1.0]), np.array([[1.0, 298.0]] * 2), (False, False)), np.array([0.0]))
""",
    'fixed steps, as in the node': """
import numpy as np
from sma_sim import Model
from sma_sim.solver.fixed_rate import FixedRateRun
FixedRateRun(Model(), 1000.0, np.array([0.0, 298.0])).step(np.array([1.0, 298.0]))
""",
}


def start(program: str, cache: str) -> float:
    """Duration of a fresh process that runs a program [s]."""
    t_start = time.perf_counter()
    subprocess.run([sys.executable, '-c', program], check=True, env=os.environ | {'XDG_CACHE_HOME': cache})
    return time.perf_counter() - t_start


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """First and later starts."""
    times = {}
    for name, program in PROGRAMS.items():
        with tempfile.TemporaryDirectory() as cache:
            first = start(program, cache)
            later = [start(program, cache) for _ in range(arguments.starts)]
        times[f'{name}, process start to end'] = {'first_s': first, 'later_s': float(np.median(later))}
    return times


if __name__ == '__main__':
    report(__doc__ or '', measure, starts=5)
