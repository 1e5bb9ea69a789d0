"""The model beside a robot as lines of JSON on stdout, for a page: ``python -m sma_sim.ros.live_feed --ros-args ...``.

A line has ``kind``: ``channels`` (their names, once), ``sample`` (``stamp`` [s]; by channel ``measured`` and ``model`` in SI
units, and ``error`` over noise; null where nothing was measured), ``state`` (once a second: ``state``, ``problems``, and
how many ``samples`` were compared) and ``recording`` (``path``, empty for none, ``messages``, ``failed``).

On stdin it takes lines of JSON: ``{"record": PATH}`` begins a bag of what the robot publishes, ``{"record": ""}`` ends it.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.json_values import finite
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.ros.entry import Program, Runner, run_node

PROGRAM = Program(
    'sma_live_feed', 'Prints the model beside a robot as lines of JSON.', 'check.noise_alpha:=1.0e-3', ('environment.T_E',)
)
SHORTEST = 0.05  # [s] between two samples that are told: more cannot be seen


class Feed:
    """Prints what a `ModelCheck` finds; ends the program when nobody reads it any more."""

    def __init__(self, channels: Sequence[str], recorder: Any) -> None:
        self._told_at, self._recorder = -SHORTEST, recorder
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
        self.tell('recording', **self._recorder.state)

    def close(self) -> None:
        """End the bag, if one is being written."""
        self._recorder.stop()

    def obey(self, lines: Iterable[str]) -> None:
        """Begin and end bags as the lines say, until they end; what cannot be done is told."""
        for line in lines:
            try:
                path = str(json.loads(line)['record'])
                self._recorder.stop()
                if path:
                    self._recorder.start(Path(path))
                self.tell('recording', **self._recorder.state)
            except UserError as error:
                self.tell('recording', path='', messages=0, failed=str(error))
            except (ValueError, TypeError, KeyError):
                continue

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
    from sma_sim.ros.robot_recorder import RobotRecorder

    structure, numbers = config.structure.structure, config.parameters
    recorder = RobotRecorder(node, structure, (numbers['node.record_size'], numbers['node.record_duration']))
    feed = Feed(structure.channels, recorder)
    Thread(target=feed.obey, args=(sys.stdin,), daemon=True).start()
    return ModelCheck(node, config, settings, use_sim_time, feed)


if __name__ == '__main__':
    sys.exit(main())
