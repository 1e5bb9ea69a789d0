"""The model beside a robot as lines of JSON on stdout, for a page: ``python -m sma_sim.ros.live_feed --ros-args ...``.

A line has ``kind``: ``channels`` (their names, once), ``sample`` (``stamp`` [s]; by channel ``measured`` and ``model`` in SI
units, and ``error`` over noise; null where nothing was measured) and ``state`` (once a second: ``state``, ``problems``, and
how many ``samples`` were compared).
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.json_values import finite
from sma_sim.model.config import Config
from sma_sim.ros.entry import Program, Runner, run_node

PROGRAM = Program(
    'sma_live_feed', 'Prints the model beside a robot as lines of JSON.', 'check.noise_alpha:=1.0e-3', ('environment.T_E',)
)
SHORTEST = 0.05  # [s] between two samples that are told: more cannot be seen


class Feed:
    """Prints what a `ModelCheck` finds; ends the program when nobody reads it any more."""

    def __init__(self, channels: Sequence[str]) -> None:
        self._told_at = -SHORTEST
        self.tell('channels', channels=list(channels))

    def sample(self, stamp: int, measured: NDArray[np.float64], model: NDArray[np.float64], error: Any) -> None:
        """One comparison at `stamp` [ns], arrays (channels,); those that follow too soon are not told."""
        now = time.monotonic()
        if now - self._told_at >= SHORTEST:
            self._told_at = now
            self.tell('sample', stamp=stamp / 1e9, measured=measured.tolist(), model=model.tolist(), error=error.tolist())

    def state(self, state: str, problems: Sequence[str], samples: int) -> None:
        """What the check is doing, what is wrong, and how many samples it has compared."""
        self.tell('state', state=state, problems=list(problems), samples=samples)

    def tell(self, kind: str, **content: Any) -> None:
        """One line."""
        try:
            print(json.dumps(finite({'kind': kind, **content})), flush=True)
        except OSError:
            sys.stdout = open(os.devnull, 'w', encoding='utf-8')  # noqa: SIM115  until the end
            os.kill(os.getpid(), signal.SIGINT)


def main(arguments: list[str] | None = None) -> int:
    """Run the model beside a robot; the exit code of `entry.run_node`."""
    return run_node(PROGRAM, fed_check, arguments)


def fed_check(node: Any, config: Config, settings: Mapping[str, float], use_sim_time: bool) -> Runner:
    """The model beside the robot; rclpy is not imported before it is known to be there."""
    from sma_sim.ros.check_node import ModelCheck

    return ModelCheck(node, config, settings, use_sim_time, Feed(config.structure.structure.channels))


if __name__ == '__main__':
    sys.exit(main())
