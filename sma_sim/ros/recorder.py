"""The node's own bag: written in a thread, on the disk within a fraction of a second, never in the way of the steps."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sma_sim.model.errors import UserError
from sma_sim.model.optional import missing

FLUSH_PERIOD = 0.6  # [s]; what is older survives a kill; each flush adds to the bag's index
FIRST_FLUSH = 0.05  # [s]
MAX_QUEUED_FOR_DISK = 500_000  # messages that may wait for a slow disk
MEGABYTE = 10**6


class RecordedTopic(NamedTuple):
    """A topic, its message type, and the quality of service that its publisher offers, as rosbag2's metadata have it."""

    name: str
    kind: str
    qos: Mapping[str, Any]


class Recorder:
    """Records messages of `topics`. Raises UserError where the bag cannot be made.

    When the disk fails, the bag is left as it is, `failed` holds the reason, `on_failure` is called with a message once, and
    nothing more is recorded.
    """

    def __init__(
        self,
        path: Path,
        topics: Sequence[RecordedTopic],
        about: Mapping[str, str],
        max_megabytes: float,
        longest: float,
        on_failure: Callable[[str], object],
    ) -> None:
        try:  # only here, so that a node that records nothing needs neither rosbags nor mcap
            from sma_sim.evidence.data.rosbag.writer import BagWriter
        except ModuleNotFoundError as error:
            raise missing(error, f'node.record = {path}: a bag') from error
        try:
            self._bag = BagWriter(path, about, round(max_megabytes * MEGABYTE), round(longest * 1e9))
            with self._bag.discarded_on_failure():
                for topic in topics:
                    self._bag.add(topic.name, topic.kind, qos=[topic.qos])
        except OSError as error:
            raise UserError(f'node.record = {path}: cannot write the bag: {error.strerror}') from error
        self.path, self.failed, self._on_failure = path, '', on_failure
        self._further: Mapping[str, str] = {}
        self._waiting: deque[tuple[int, int, bytes]] = deque()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='recorder', daemon=True)
        self._thread.start()

    @property
    def count(self) -> int:
        """Messages in the bag."""
        return self._bag.bag.count

    def tell(self, about: Mapping[str, str]) -> None:
        """What else the bag says of how it came about; before the first message. Returns at once."""
        self._further = about

    def write(self, topic: int, log_time: int, cdr: bytes) -> None:
        """Record one serialized message; returns at once."""
        if not self.failed:
            self._waiting.append((topic, log_time, cdr))

    def close(self) -> None:
        """Write what waits and end the bag."""
        self._stop.set()
        self._thread.join()
        if not self.failed:
            self._try(self._bag.close)

    def _run(self) -> None:
        pause = FIRST_FLUSH  # a bag that is killed early has its topics at least
        while not self.failed:
            stopping = self._stop.wait(pause)
            pause = FLUSH_PERIOD
            self._try(self._drain)
            if stopping:
                return

    def _drain(self) -> None:
        if len(self._waiting) > MAX_QUEUED_FOR_DISK:
            raise OSError(f'the disk is too slow: {len(self._waiting)} messages wait')
        while self._waiting:
            self._tell_further()  # after a message was seen: it was told before
            self._bag.write(*self._waiting.popleft())
        self._tell_further()
        self._bag.flush()

    def _tell_further(self) -> None:
        if self._further:
            self._bag.tell(self._further)
            self._further = {}

    def _try(self, work: Callable[[], None]) -> None:
        try:
            work()
        except OSError as error:
            self.failed = error.strerror or str(error)
            self._waiting.clear()
            self._bag.abandon()
            self._on_failure(
                f'recording to {self.path} ended: {self.failed}; what was written so far can be read, '
                f'`sma-sim bag repair {self.path}` makes a whole bag of it'
            )
