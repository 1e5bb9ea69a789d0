"""The model beside a robot as lines of JSON on stdout, for a page: ``python -m sma_sim.ros.live_feed --ros-args ...``.

A line has ``kind``: ``channels`` (their names, once), ``sample`` (``stamp`` [s]; by channel ``measured`` and ``model`` in SI
units, and ``error`` over noise; null where nothing was measured), ``state`` (once a second: ``state``, ``problems``, and
how many ``samples`` were compared), ``cause`` (what has changed on the robot: ``words``, ``changed``, ``since`` [s],
``probabilities`` by cause, and ``causes``), ``recording`` (``path``, empty for none, ``messages``, ``failed``) and ``model``
(the parameter file of another model that has taken the place of the one before as ``path``, and the last ``samples`` anew;
or why it ``failed``).

On stdin it takes lines of JSON: ``{"record": PATH}`` begins a bag of what the robot publishes, ``{"record": ""}`` ends it;
``{"model": PATH}`` compares with the model of another parameter file, also what was measured before.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

import numpy as np

from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config, read_config
from sma_sim.model.errors import UserError
from sma_sim.model.structures.structure import Structure
from sma_sim.ros.entry import Program, Runner, run_node
from sma_sim.words.json_values import finite

if TYPE_CHECKING:
    from sma_sim.evidence.monitoring.live_diagnosis import LiveFinding
    from sma_sim.solver.model import Model


PROGRAM = Program(
    'sma_live_feed', 'Prints the model beside a robot as lines of JSON.', 'check.noise_alpha:=1.0e-3', ('environment.T_E',)
)
SHORTEST = 0.05  # [s] between two samples that are told: more cannot be seen
TOLD_AGAIN = 75.0  # [s] of the past that are told anew of another model: more than a page shows


class Feed:
    """Prints what a `ModelCheck` finds; ends the program when nobody reads it any more."""

    def __init__(self, structure: Structure, recorder: Any) -> None:
        self._told_at, self._recorder, self._structure = -SHORTEST, recorder, structure
        self._asked = ''  # parameter file of the model that takes the place of the one before
        self.tell('channels', channels=list(structure.channels))

    def sample(self, stamp: int, measured: Vector, model: Vector, error: Vector) -> None:
        """One comparison at `stamp` [ns], arrays (channels,); those that follow too soon are not told."""
        now = time.monotonic()
        if now - self._told_at >= SHORTEST:
            self._told_at = now
            self.tell('sample', **sample_data(stamp, measured, model, error))

    def replaced(self, samples: Sequence[tuple[int, Vector, Vector, Vector]], failed: str) -> None:
        """Another model: what it shows of the last minute, or why it cannot be run."""
        told: list[dict[str, Any]] = []
        for sample in samples:
            stamp, last = sample[0] / 1e9, samples[-1][0] / 1e9
            if stamp >= last - TOLD_AGAIN and (not told or stamp - told[-1]['stamp'] >= SHORTEST):
                told.append(sample_data(*sample))
        self.tell('model', path=self._asked, failed=failed, samples=told)

    def cause(self, found: LiveFinding) -> None:
        """What may have changed on the robot."""
        self.tell('cause', words=str(found), **found.as_data())

    def state(self, state: str, problems: Sequence[str], samples: int) -> None:
        """What the check is doing, what is wrong, and how many samples it has compared."""
        self.tell('state', state=state, problems=list(problems), samples=samples)
        self.tell('recording', **self._recorder.state)

    def close(self) -> None:
        """End the bag, if one is being written."""
        self._recorder.stop()

    def obey(self, lines: Iterable[str], use: Callable[[Config, Model], None]) -> None:
        """Begin and end bags and `use` other models as the lines say, until they end; what cannot be done is told."""
        for line in lines:
            try:
                asked = json.loads(line)
                if 'model' in asked:
                    self._change_model(str(asked['model']), use)
                else:
                    self._record(str(asked['record']))
            except (ValueError, TypeError, KeyError):
                continue

    def _change_model(self, path: str, use: Callable[[Config, Model], None]) -> None:
        from sma_sim.solver.fixed_rate import FixedRateRun
        from sma_sim.solver.model import Model
        from sma_sim.solver.simulate import SimulationError

        self._asked = path
        try:
            config = read_config(Path(path))
            if config.structure != self._structure:
                raise UserError(f'{path} is of system {config.system}: end listening, and begin again')
            model = Model(config)
            FixedRateRun(model, config.parameters['node.integration_rate'], at_rest(config))  # compiles what is new in it
            use(config, model)
        except (UserError, SimulationError) as error:
            self.tell('model', path=path, failed=str(error), samples=[])

    def _record(self, path: str) -> None:
        try:
            self._recorder.stop()
            if path:
                self._recorder.start(Path(path))
            self.tell('recording', **self._recorder.state)
        except UserError as error:
            self.tell('recording', path='', messages=0, failed=str(error))

    def tell(self, kind: str, **content: Any) -> None:
        """One line."""
        try:
            print(json.dumps(finite({'kind': kind, **content})), flush=True)
        except OSError:
            sys.stdout = open(os.devnull, 'w', encoding='utf-8')  # noqa: SIM115  until the end
            os.kill(os.getpid(), signal.SIGINT)


def sample_data(stamp: int, measured: Vector, model: Vector, error: Vector) -> dict[str, Any]:
    """A comparison for JSON."""
    return {'stamp': stamp / 1e9, 'measured': measured.tolist(), 'model': model.tolist(), 'error': error.tolist()}


def at_rest(config: Config) -> Vector:
    """The input of a model that nothing drives."""
    inputs = np.zeros(len(config.structure.input_columns))
    inputs[-1] = config.parameters['environment.T_E']
    return inputs


def main(arguments: list[str] | None = None) -> int:
    """Run the model beside a robot; the exit code of `entry.run_node`."""
    return run_node(PROGRAM, fed_check, arguments)


def fed_check(node: Any, config: Config, use_sim_time: bool) -> Runner:
    """The model beside the robot; rclpy is not imported before it is known to be there."""
    from sma_sim.ros.check_node import ModelCheck
    from sma_sim.ros.robot_recorder import RobotRecorder

    structure, numbers = config.structure, config.parameters
    recorder = RobotRecorder(node, structure, (numbers['node.record_size'], numbers['node.record_duration']))
    feed = Feed(structure, recorder)
    check = ModelCheck(node, config, use_sim_time, feed)
    Thread(target=feed.obey, args=(sys.stdin, check.use), daemon=True).start()
    return check


if __name__ == '__main__':
    sys.exit(main())
