"""Raw messages of rosbag2 bags (mcap, sqlite3), also of bags that break off: a killed recorder, a full disk."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from mcap.exceptions import McapError
from mcap.records import Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import Reader
from zstandard import ZstdError

from sma_sim.evidence.data.rosbag.bag_files import METADATA, is_bag, storage_files
from sma_sim.evidence.data.rosbag.writer import PROVENANCE_RECORD, BagWriter
from sma_sim.model.errors import UserError

# What a broken mcap file makes its parser stumble over.
# Of a size that noise gives, MemoryError or OverflowError.
PARSING_ERRORS = (
    McapError,
    ValueError,
    EOFError,
    MemoryError,
    OverflowError,
    RuntimeError,
    LookupError,
    struct.error,
    ZstdError,
)


class RawMessage(NamedTuple):
    """A serialized message and its log time [ns]; `definition` of its type and profiles (YAML) where the file tells them."""

    topic: str
    kind: str
    log_time: int
    cdr: bytes
    definition: str = ''
    qos: str = ''


@dataclass(frozen=True)
class Bag:
    """A bag: where it is, its topics if it was ended as it should, how it came about (of bags that sma_sim wrote)."""

    path: Path
    contents: dict[str, tuple[str, int]] | None
    about: dict[str, str] = field(default_factory=dict)

    @property
    def whole(self) -> bool:
        """Whether it was ended as it should."""
        return self.contents is not None

    def messages(self, topics: Collection[str] | None = None) -> Iterator[RawMessage]:
        """All messages (of these topics), file by file; as far as they can be read."""
        return whole_messages(self.path, topics) if self.whole else salvaged_messages(self.path, topics)

    def topics(self) -> dict[str, tuple[str, int]]:
        """Message type and count by topic."""
        if self.contents is not None:
            return self.contents
        found: dict[str, tuple[str, int]] = {}
        for message in self.messages():
            found[message.topic] = (message.kind, found.get(message.topic, ('', 0))[1] + 1)
        return found


def open_bag(path: Path) -> Bag:
    """A bag by its folder or one of its files. Raises UserError when it is none, or nothing in it can be read."""
    if not path.exists():
        raise UserError(f'cannot read {path}: there is no such bag')
    if not is_bag(path):
        raise UserError(f'{path} is not a bag: expected a folder with {METADATA}, or a file *.mcap or *.db3')
    if not storage_files(path):
        raise UserError(f'{path} has no file *.mcap or *.db3 in it')
    try:
        with Reader(path) as reader:
            contents = {c.topic: (c.msgtype, c.msgcount) for c in reader.connections}
    except PermissionError as error:
        raise UserError(f'cannot read {path}: {error.strerror}') from error
    except Exception:  # rosbags meets a broken file with whatever its parsing stumbles over
        contents = None
    return Bag(path, contents, provenance_of(path))


def whole_messages(path: Path, topics: Collection[str] | None) -> Iterator[RawMessage]:
    """Messages of a bag that was ended as it should."""
    with Reader(path) as reader:
        wanted = [c for c in reader.connections if topics is None or c.topic in topics]
        if not wanted:
            return
        messages = reader.messages(wanted)
        while True:
            try:
                connection, log_time, cdr = next(messages)
            except StopIteration:
                return
            except Exception as error:  # rosbags meets a broken file with whatever its parsing stumbles over
                raise UserError(
                    f'{path} is damaged ({error}): `sma-sim bag repair {path}` writes what can be read to a new bag'
                ) from error
            yield RawMessage(connection.topic, connection.msgtype, log_time, bytes(cdr))


def salvaged_messages(path: Path, topics: Collection[str] | None) -> Iterator[RawMessage]:
    """Messages of the files of a bag, each up to where it cannot be read any more."""
    for file in storage_files(path):
        source = salvaged_mcap(file) if file.suffix == '.mcap' else salvaged_sqlite(file)
        yield from (message for message in source if topics is None or message.topic in topics)


def mcap_records(file: Path) -> Iterator[Any]:
    """Records of an mcap file up to where it breaks off."""
    with file.open('rb') as stream:
        try:
            yield from StreamReader(stream, validate_crcs=True).records
        except PARSING_ERRORS:
            return


def salvaged_mcap(file: Path) -> Iterator[RawMessage]:
    """Messages of an mcap file up to where it breaks off."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, tuple[str, str, str, str]] = {}
    for record in mcap_records(file):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.schema_id in schemas:
            schema = schemas[record.schema_id]
            qos = record.metadata.get('offered_qos_profiles', '')
            channels[record.id] = record.topic, schema.name, schema.data.decode(), qos
        elif isinstance(record, Message) and record.channel_id in channels:
            topic, kind, definition, qos = channels[record.channel_id]
            yield RawMessage(topic, kind, record.log_time, record.data, definition, qos)


def salvaged_sqlite(file: Path) -> Iterator[RawMessage]:
    """Messages of a sqlite3 storage whose metadata are missing, or whose end is."""
    connection = sqlite3.connect(f'file:{file}?mode=ro', uri=True)
    try:
        rows = connection.execute(
            'SELECT topics.name, topics.type, messages.timestamp, messages.data FROM messages '
            'JOIN topics ON messages.topic_id = topics.id ORDER BY messages.timestamp'
        )
        for name, kind, log_time, cdr in rows:
            yield RawMessage(name, kind, log_time, bytes(cdr))
    except sqlite3.Error:
        return
    finally:
        connection.close()


def provenance_of(path: Path) -> dict[str, str]:
    """How a bag came about, if sma_sim wrote it."""
    try:
        text = (path / METADATA).read_text(encoding='utf-8') if path.is_dir() else ''
        custom = (yaml.safe_load(text) or {}).get('rosbag2_bagfile_information', {}).get('custom_data')
        if isinstance(custom, dict):
            return {str(key): str(value) for key, value in custom.items()}
    except (OSError, UnicodeDecodeError, yaml.YAMLError, AttributeError):
        pass
    for file in storage_files(path)[:1]:
        if file.suffix == '.mcap':
            for record in mcap_records(file):
                if isinstance(record, Metadata) and record.name == PROVENANCE_RECORD:
                    return dict(record.metadata)
                if isinstance(record, Message):
                    break
    return {}


def profiles_in(text: str) -> list[dict[str, Any]]:
    """Profiles of quality of service as a recorder wrote them; none where they are not in the form of today's rosbag2."""
    try:
        profiles = yaml.safe_load(text)
    except yaml.YAMLError:
        return []
    whole = isinstance(profiles, list) and all(
        isinstance(profile, dict) and isinstance(profile.get('durability'), str) for profile in profiles
    )
    return profiles if whole else []  # older ones hold numbers in place of words


def repair(path: Path, out: Path) -> int:
    """Write what can be read of a bag as a whole new one; the number of its messages. Raises UserError."""
    bag = open_bag(path)
    messages = salvaged_messages(path, None)
    first = next(messages, None)
    if first is None:
        raise UserError(f'{path}: no message can be read, there is nothing to repair')
    numbers: dict[str, int] = {}
    try:
        writer = BagWriter(out, bag.about)
        with writer.discarded_on_failure():
            for message in chain((first,), messages):
                if message.topic not in numbers:
                    profiles = profiles_in(message.qos)
                    numbers[message.topic] = writer.add(message.topic, message.kind, message.definition, profiles)
                writer.write(numbers[message.topic], message.log_time, message.cdr)
            writer.close()
    except OSError as error:
        raise UserError(f'cannot write {out}: {error.strerror}') from error
    return writer.bag.count
