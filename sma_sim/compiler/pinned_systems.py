"""Several systems at once in compiled code: each is written to memory of its own and read by its address."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.compiler.by_reference import RECORD_WORDS
from sma_sim.model.layout import System


def record_at(address: int, like: System) -> System:
    """The system at an address of `pinned_systems`; `like` is of the same type (the compiler puts a cast here)."""
    found: System = ctypes.cast(int(address), ctypes.py_object).value
    return found


def store_record(like: System, address: int) -> None:
    """Write a system to memory (the compiler puts a copy here)."""
    raise NotImplementedError


def pin_system(p: System, memory: NDArray[np.float64]) -> None:
    """Write a system into `memory`, for Python to call when compiled."""
    store_record(p, memory.ctypes.data)


class PinnedSystems(NamedTuple):
    """Addresses of systems (P,), 0 for none, and what must live as long as they are used."""

    addresses: NDArray[np.int64]
    kept: tuple[Any, ...]


def pinned_systems(systems: Sequence[System | None], keep: Any, interpreted: bool) -> PinnedSystems:
    """Systems behind addresses, one that comes several times behind a single one; `keep` is the compiled `pin_system`."""
    if interpreted:
        return PinnedSystems(np.array([0 if p is None else id(p) for p in systems], dtype=np.int64), tuple(systems))
    distinct = {id(p): p for p in systems if p is not None}
    memory = np.zeros((len(distinct), RECORD_WORDS))
    for p, own in zip(distinct.values(), memory, strict=True):
        keep(p, own)
    places = {one: memory.ctypes.data + k * memory.strides[0] for k, one in enumerate(distinct)}
    addresses = [0 if p is None else places[id(p)] for p in systems]
    return PinnedSystems(np.array(addresses, dtype=np.int64), (*systems, memory))
