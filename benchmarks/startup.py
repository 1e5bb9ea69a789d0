"""Time to the first result: with nothing compiled yet, and on every later start.

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

PROGRAM = """
import numpy as np
from sma_sim import Input, Model, simulate
simulate(Model(), Input(np.array([0.0, 1.0]), np.array([[1.0, 298.0]] * 2), (False, False)), np.array([0.0]))
"""


def start(cache: str) -> float:
    """Duration of a fresh process that simulates one second [s]."""
    began = time.perf_counter()
    subprocess.run([sys.executable, '-c', PROGRAM], check=True, env=os.environ | {'XDG_CACHE_HOME': cache})
    return time.perf_counter() - began


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """First and later starts."""
    with tempfile.TemporaryDirectory() as cache:
        first = start(cache)
        later = [start(cache) for _ in range(arguments.starts)]
    return {'process start to end': {'first_s': first, 'later_s': float(np.median(later))}}


if __name__ == '__main__':
    report(__doc__ or '', measure, starts=5)
