"""Serialized messages (CDR, XCDR version 1) of one type, decoded many at once.

Messages of a topic differ in their numbers, seldom in their strings and in the lengths of their sequences. Those that agree
in these have every number at one place: a column of the bytes of them all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

from sma_sim.evidence.data.rosbag.writer import typestore

Bytes = NDArray[np.uint8]
ENCAPSULATION = 4  # bytes before the message; alignment counts from after them
BYTE_ORDERS: dict[bytes, Literal['<', '>']] = {b'\x00\x00': '>', b'\x00\x01': '<'}
LENGTH = 'uint32'
MAX_PADDING = 3  # bytes after the message


def decoded_together(messages: Sequence[bytes], kind: str) -> Iterator[tuple[NDArray[np.int64], Any]]:
    """Groups of messages that agree in all but numbers: their indices, (k,), and one message that stands for them.

    Its fields are those of the type; in place of a number stands an array (k,), of a sequence of n numbers (n, k), of the
    group. Raises ValueError with the index of a message that is none of the type.
    """
    for length in dict.fromkeys(map(len, messages)):
        left = np.array([i for i, message in enumerate(messages) if len(message) == length], dtype=np.int64)
        raw = np.frombuffer(b''.join(messages[i] for i in left), dtype=np.uint8).reshape(len(left), length)
        while len(left):
            try:
                reader = Reader(raw)
                found = reader.message(kind)
                reader.end()
            except (IndexError, KeyError, UnicodeDecodeError, NotImplementedError) as error:
                raise ValueError(int(left[0])) from error
            alike = (raw[:, reader.fixed] == raw[0, reader.fixed]).all(axis=1)
            yield left[alike], found if alike.all() else Reader(raw[alike]).message(kind)
            left, raw = left[~alike], raw[~alike]


class Reader:
    """Reads messages of one length, (k, bytes), as the first of them is laid out.

    Attributes
    ----------
    fixed : list of int
        Where the bytes are that say how a message is laid out, or that are text.
    """

    def __init__(self, raw: Bytes) -> None:
        """Take the messages. Raises KeyError for an encapsulation that is not known."""
        self.raw, self.at = raw[:, ENCAPSULATION:], 0
        self.order = BYTE_ORDERS[raw[0, :2].tobytes()]
        self.fixed = [0, 1]

    def message(self, kind: str) -> Any:
        """A message of a type."""
        _, fields = typestore().fielddefs[kind]
        return SimpleNamespace(**{name: self.field(*node) for name, node in fields})

    def field(self, node: Nodetype, of: Any) -> Any:
        """A field: a number, a text, a message, or several of them."""
        if node == Nodetype.NAME:
            return self.message(of)
        if node == Nodetype.BASE:
            return self.text() if of[0] == 'string' else self.numbers(of[0], 1)[0]
        (inner, inner_of), count = of
        if node == Nodetype.SEQUENCE:
            count = self.length()
        if inner == Nodetype.BASE and inner_of[0] != 'string':
            return self.numbers(inner_of[0], count)
        if count > self.raw.shape[1]:  # each takes a byte at least
            raise IndexError
        return [self.field(inner, inner_of) for _ in range(count)]

    def numbers(self, kind: str, count: int) -> NDArray[Any]:
        """Numbers of every message, (count, k)."""
        dtype = np.dtype(kind).newbyteorder(self.order)
        if count:
            self.at += -self.at % dtype.itemsize
        taken = self.take(count * dtype.itemsize)
        return np.ascontiguousarray(taken).view(dtype).T

    def length(self) -> int:
        """The length of what follows, which all messages have in common."""
        number = int(self.numbers(LENGTH, 1)[0, 0])
        self.fix(np.dtype(LENGTH).itemsize)
        return number

    def text(self) -> str:
        """A text with its ending zero, which all messages have in common."""
        count = self.length()
        found: bytes = self.take(count)[0].tobytes()
        self.fix(count)
        return found.rstrip(b'\0').decode()

    def take(self, count: int) -> Bytes:
        """The next bytes of every message. Raises IndexError where there are not so many."""
        if self.at + count > self.raw.shape[1]:
            raise IndexError
        self.at += count
        return self.raw[:, self.at - count : self.at]

    def fix(self, count: int) -> None:
        """The last bytes are the same in all messages."""
        end = ENCAPSULATION + self.at
        self.fixed.extend(range(end - count, end))

    def end(self) -> None:
        """Nothing but padding follows. Raises IndexError."""
        if self.raw.shape[1] > self.at + MAX_PADDING:
            raise IndexError
