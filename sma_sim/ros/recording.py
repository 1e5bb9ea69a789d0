"""The bags of a node: one for each run, and services that start, stop and split the recording while the node runs.

A bag is made and ended in a thread of its own, which may take a while; the simulating thread only changes from one to the
other, between two steps. So no step waits, and what is published goes into exactly one bag.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import datetime
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from sma_sim.evidence.data.rosbag.interface import INTERFACE, interface_of
from sma_sim.model.config import Config, flat_parameters
from sma_sim.model.errors import UserError
from sma_sim.ros.bag_names import bag_path
from sma_sim.ros.control import Control, Refused
from sma_sim.ros.publishers import Publishers
from sma_sim.ros.recorder import Recorder

HERE = './'  # where bags go for which no parameter names a place
NOTHING = 'nothing is being recorded: start it first (~/record_start, std_srvs/Trigger)'
ENDING = 'the node is ending'


class BagSession:
    """Which bag the publishers write to. `record_state` is called in the simulating thread when a bag begins."""

    def __init__(self, node: Node, config: Config, publishers: Publishers, record_state: Callable[[], object]) -> None:
        self._config, self._publishers, self._record_state = config, publishers, record_state
        self._logger = node.get_logger()
        self._name = str(config.settings['node.record'])
        self._epoch: int | None = None  # log time [ns] of simulated time 0; none before it has come
        self._failed = ''
        self._next: Recorder | None = None  # made, for a run that has not begun yet
        self._thread = ThreadPoolExecutor(1, 'recording')

    def serve(self, node: Node, control: Control) -> None:
        """Offer the services."""
        self._control = control
        for name, work in (('start', self._start), ('stop', self._stop), ('split', self._split)):

            async def answer(_: Any, response: Any, work: Callable[[], str] = work) -> Any:
                return await control.answered(self._submit(work), response)

            node.create_service(Trigger, f'~/record_{name}', answer, callback_group=control.callback_group)

    def prepare(self) -> None:
        """Make the bag of a run that will begin: the first, where one is asked for, or another after that of the run before.

        It takes a while. In the simulating thread. Raises UserError where the first cannot be made; a later one is logged
        and reported.
        """
        if self._epoch is None and self._name:
            self._next = self._make(first=True)
        elif self._publishers.recorder is not None:
            self._end(self._exchange(None))
            try:
                self._next = self._make()
            except UserError as error:
                self._failed = str(error)
                self._logger.error(f'the run after the reset is not recorded: {error}')

    def begin(self, epoch: int) -> None:
        """The run begins, with the log time [ns] of its simulated time 0: write to the bag that was made, if one was."""
        self._epoch = epoch
        if self._next is not None:
            self._next.tell(self._about(epoch))
            self._publishers.recorder, self._next = self._next, None

    def close(self) -> None:
        """End the bag, if one is being written, and let no other begin."""
        self._thread.shutdown()
        self._end(self._exchange(None))

    @property
    def problem(self) -> str:
        """Why what is to be recorded is not; empty where it is."""
        recorder = self._publishers.recorder
        return self._failed if recorder is None else recorder.failed

    @property
    def values(self) -> Mapping[str, Any]:
        """What diagnostics tell of it."""
        recorder = self._publishers.recorder
        words = f'failed: {self.problem}' if self.problem else 'no' if recorder is None else 'yes'
        bag = {} if recorder is None else {'bag': str(recorder.path), 'messages in the bag': recorder.count}
        return {'recording': words, **bag}

    def _submit(self, work: Callable[[], str]) -> Future[str]:
        try:
            return self._thread.submit(work)
        except RuntimeError:  # it is shut down
            refused: Future[str] = Future()
            refused.set_exception(Refused(ENDING))
            return refused

    def _start(self) -> str:
        recorder = self._publishers.recorder
        if recorder is not None and not recorder.failed:
            raise Refused(f'{recorder.path} is being recorded: stop it first (~/record_stop), or split it (~/record_split)')
        new, _ = self._begin_bag()
        return str(new.path)

    def _stop(self) -> str:
        if self._publishers.recorder is None:
            raise Refused(NOTHING)
        old = self._control.ask(lambda: self._exchange(None)).result()
        self._end(old)
        return whole_path(old)

    def _split(self) -> str:
        """Go on in another bag; the path of the one that has ended."""
        if self._publishers.recorder is None:
            raise Refused(NOTHING)
        _, old = self._begin_bag()
        return whole_path(old)

    def _begin_bag(self) -> tuple[Recorder, Recorder | None]:
        """Go on in a new bag, and end the one before; both."""
        epoch = self._epoch
        if epoch is None:
            raise Refused('waiting for /clock: nothing runs yet')
        new = self._make()
        new.tell(self._about(epoch))

        def change() -> Recorder | None:
            if self._epoch != epoch:
                raise Refused('the simulation was reset meanwhile: try again')
            return self._exchange(new)

        try:
            old = self._control.ask(change).result()
        except Refused:
            new.close()
            shutil.rmtree(new.path, ignore_errors=True)  # nothing is in it
            raise
        self._end(old)
        return new, old

    def _exchange(self, new: Recorder | None) -> Recorder | None:
        """Write to another bag from now on, or to none; the one before. In the simulating thread."""
        old, self._publishers.recorder = self._publishers.recorder, new
        self._failed = ''
        if new is not None:
            self._record_state()
        return old

    def _about(self, epoch: int) -> Mapping[str, str]:
        """What a bag says of the run in it."""
        numbers = self._config.parameters
        return {
            'epoch': str(epoch),
            'integration_rate': repr(numbers['node.integration_rate']),
            'publish_rate': repr(numbers['node.publish_rate']),
            'parameters': json.dumps(flat_parameters(self._config)),
            INTERFACE: interface_of(self._config.structure).as_json(),
        }

    def _make(self, first: bool = False) -> Recorder:
        """A new bag. Raises UserError."""
        numbers, path = self._config.parameters, bag_path(self._name or HERE, datetime.now(), after_reset=not first)
        most, longest = numbers['node.record_size'], numbers['node.record_duration']
        new = Recorder(path, self._publishers.recorded, {}, most, longest, self._logger.error)
        self._logger.info(f'recording to {path}')
        return new

    def _end(self, recorder: Recorder | None) -> None:
        """End a bag that is not written to any more."""
        if recorder is not None:
            recorder.close()
            if not recorder.failed:
                self._logger.info(f'recorded {recorder.count} messages to {recorder.path}')


def whole_path(recorder: Recorder | None) -> str:
    """Where a bag that has ended is. Raises Refused where there is none, or it is not whole."""
    if recorder is None:
        raise Refused(NOTHING)
    if recorder.failed:
        raise Refused(f'{recorder.path} is not whole: {recorder.failed}')
    return str(recorder.path)
