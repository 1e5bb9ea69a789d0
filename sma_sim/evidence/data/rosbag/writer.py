"""Writes rosbag2 folders (storage mcap) that stay readable when the writing process is killed.

What was written before the last `flush` is on the disk in whole chunks; `salvage` reads a file that ends anywhere.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import IO, Any

import yaml
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from sma_sim.evidence.data.rosbag.bag_files import METADATA
from sma_sim.model.errors import UserError

METADATA_VERSION = 9  # of rosbag2 in Jazzy and Kilted
PROVENANCE_RECORD = 'sma_sim'  # name of the metadata record that says how a bag came about


@cache
def typestore() -> Typestore:
    """The message types of ROS 2 (those that we use are the same in Jazzy and Kilted)."""
    return get_typestore(Stores.ROS2_KILTED)


@dataclass
class MessageSpan:
    """How many messages a file or a bag has, and their first and last log time [ns]."""

    count: int = 0
    first: int = 0
    last: int = 0

    def add(self, log_time: int) -> None:
        """Count one message."""
        self.first = min(self.first, log_time) if self.count else log_time
        self.last = max(self.last, log_time) if self.count else log_time
        self.count += 1

    def as_metadata(self) -> dict[str, Any]:
        """As rosbag2's metadata have it."""
        return {
            'starting_time': {'nanoseconds_since_epoch': self.first},
            'duration': {'nanoseconds': self.last - self.first},
            'message_count': self.count,
        }


@dataclass
class Topic:
    """A topic of the bag; `channel` is its number in the current file."""

    name: str
    kind: str
    definition: str
    qos: Sequence[Mapping[str, Any]] = ()
    channel: int = 0
    count: int = 0

    @property
    def digest(self) -> str:
        """Hash of the message type, where it is known."""
        return typestore().hash_rihs01(self.kind) if self.kind in typestore().types else ''


@dataclass
class BagWriter:
    """A new bag in the folder `path`, which must not exist. Times are in nanoseconds.

    A file of the bag is followed by the next one when it has `max_bytes` or spans `longest` ns of log time (0: never).
    `about` goes into every file and into the bag's metadata. Raises UserError when the folder cannot be made, OSError
    from `write`, `flush` and `close` when the disk fails.
    """

    path: Path
    about: Mapping[str, str] = field(default_factory=dict)
    max_bytes: int = 0
    longest: int = 0
    bag: MessageSpan = field(default_factory=MessageSpan)

    def __post_init__(self) -> None:
        try:
            self.path.mkdir(parents=True)
        except FileExistsError as error:
            raise UserError(f'{self.path} exists already and is not overwritten: give the bag another name') from error
        except OSError as error:
            raise UserError(f'cannot make the bag {self.path}: {error.strerror}') from error
        self._topics: list[Topic] = []
        self._files: list[tuple[str, MessageSpan]] = []
        with self.discarded_on_failure():
            self._open_next()

    def tell(self, about: Mapping[str, str]) -> None:
        """What else goes into every file and the metadata; before the first message."""
        self.about = {**self.about, **about}
        self._writer.add_metadata(PROVENANCE_RECORD, dict(self.about))
        self.write_metadata()

    def add(self, name: str, kind: str, definition: str = '', qos: Sequence[Mapping[str, Any]] = ()) -> int:
        """A topic of a message type such as std_msgs/msg/Float64; returns its number.

        Types that ROS 2 does not bring along need their `definition`. Raises UserError without it. `qos` are
        the profiles that its publishers offer, as rosbag2's metadata have them; `ros2 bag play` offers them again.
        """
        if not definition:
            if kind not in typestore().types:
                raise UserError(f'{name}: the message type {kind} is not known, and its definition is missing')
            definition, _ = typestore().generate_msgdef(kind, ros_version=2)
        self._topics.append(Topic(name, kind, definition, qos))
        self._register(self._topics[-1])
        return len(self._topics) - 1

    def write(self, topic: int, log_time: int, cdr: bytes) -> None:
        """One serialized message."""
        if self._is_full(log_time):
            self._close_file()
            self._open_next()
        entry = self._topics[topic]
        entry.count += 1
        self._writer.add_message(entry.channel, log_time, cdr, publish_time=log_time, sequence=entry.count)
        self._files[-1][1].add(log_time)
        self.bag.add(log_time)

    def flush(self) -> None:
        """What was written so far survives the end of this process."""
        self._writer.flush()

    def close(self) -> None:
        """End the bag."""
        self._close_file()
        self.write_metadata()

    def abandon(self) -> None:
        """Let go of a file that cannot be written any more; what reached the disk stays there."""
        with suppress(OSError, AttributeError):  # it may not have been opened
            self._stream.close()

    @contextmanager
    def discarded_on_failure(self) -> Iterator[None]:
        """Leave nothing of the bag behind where the block fails: its folder would be in the way of the next try."""
        try:
            yield
        except BaseException:
            self.abandon()
            shutil.rmtree(self.path, ignore_errors=True)
            raise

    def write_metadata(self) -> None:
        """The file that says what is in the bag: whole or not at all."""
        temporary = self.path / f'.{METADATA}.part'
        try:
            temporary.write_text(
                yaml.safe_dump({'rosbag2_bagfile_information': self._metadata()}, sort_keys=False), encoding='utf-8'
            )
            temporary.replace(self.path / METADATA)
        finally:
            temporary.unlink(missing_ok=True)

    def _is_full(self, log_time: int) -> bool:
        span = self._files[-1][1]
        if not span.count:
            return False
        grown = self.max_bytes and self._stream.tell() >= self.max_bytes
        return bool(grown or self.longest and log_time - span.first >= self.longest)

    def _open_next(self) -> None:
        name = f'{self.path.name}_{len(self._files)}.mcap'
        self._stream: IO[Any] = (self.path / name).open('xb')
        self._files.append((name, MessageSpan()))
        self._writer = Writer(self._stream, compression=CompressionType.ZSTD)
        self._writer.start(profile='ros2', library='sma_sim')
        if self.about:
            self._writer.add_metadata(PROVENANCE_RECORD, dict(self.about))
        self._schemas: dict[str, int] = {}
        for topic in self._topics:
            self._register(topic)
        self._stream.flush()
        self.write_metadata()

    def _close_file(self) -> None:
        self._writer.finish()
        self._stream.close()

    def _register(self, topic: Topic) -> None:
        if topic.kind not in self._schemas:
            encoding = 'ros2idl' if topic.definition.startswith('=' * 80 + '\nIDL: ') else 'ros2msg'
            self._schemas[topic.kind] = self._writer.register_schema(topic.kind, encoding, topic.definition.encode())
        profiles = yaml.safe_dump([dict(profile) for profile in topic.qos], sort_keys=False) if topic.qos else ''
        extra = {'offered_qos_profiles': profiles, 'topic_type_hash': topic.digest}
        topic.channel = self._writer.register_channel(topic.name, 'cdr', self._schemas[topic.kind], extra)

    def _metadata(self) -> dict[str, Any]:
        topics = [
            {
                'topic_metadata': {
                    'name': topic.name,
                    'type': topic.kind,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': [dict(profile) for profile in topic.qos],
                    'type_description_hash': topic.digest,
                },
                'message_count': topic.count,
            }
            for topic in self._topics
        ]
        return {
            'version': METADATA_VERSION,
            'storage_identifier': 'mcap',
            **self.bag.as_metadata(),
            'topics_with_message_count': topics,
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [name for name, _ in self._files],
            'files': [{'path': name, **span.as_metadata()} for name, span in self._files],
            'custom_data': dict(self.about) or None,
            'ros_distro': 'kilted',
        }
