"""A message to the page: JSON, and behind it the numbers of all curves as they are in memory.

Four bytes say how long the JSON is, which is filled up to a multiple of eight bytes; then come the numbers (float64,
little-endian), to which the JSON refers as ``[first, count]``.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

ALIGNMENT = 8


class Numbers:
    """Arrays that go behind the JSON of one message."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._count = 0

    def put(self, values: NDArray[Any]) -> list[int]:
        """Append an array; where it lies, as the JSON says it."""
        at = [self._count, values.size]
        self._parts.append(np.ascontiguousarray(values, dtype='<f8').tobytes())
        self._count += values.size
        return at

    def message(self, content: dict[str, Any]) -> bytes:
        """The whole message."""
        text = json.dumps(content, separators=(',', ':'), allow_nan=False).encode()
        text += b' ' * (-(len(text) + 4) % ALIGNMENT)
        return b''.join([struct.pack('<I', len(text)), text, *self._parts])
