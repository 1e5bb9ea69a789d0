"""Several systems at once in compiled code: each is written to memory of its own and read by its address."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from sma_sim.model.layout import System

RECORD_WORDS = 1024  # of 8 bytes, more than a system needs


def record_at(address: int, like: System) -> System:
    """The system at an address of `kept_records`; `like` is of the same type (the compiler puts a cast here)."""
    found: System = ctypes.cast(int(address), ctypes.py_object).value
    return found


def store_record(like: System, address: int) -> None:
    """Write a system to memory (the compiler puts a copy here)."""
    raise NotImplementedError


def keep_record(p: System, memory: NDArray[np.float64]) -> None:
    """Write a system into `memory`, for Python to call when compiled."""
    store_record(p, memory.ctypes.data)


class KeptRecords(NamedTuple):
    """Addresses of systems (P,), 0 for none, and what must live as long as they are used."""

    addresses: NDArray[np.int64]
    kept: tuple[Any, ...]


def kept_records(systems: Sequence[System | None], keep: Any, interpreted: bool) -> KeptRecords:
    """Systems behind addresses; `keep` is the compiled `keep_record`."""
    if interpreted:
        return KeptRecords(np.array([0 if p is None else id(p) for p in systems], dtype=np.int64), tuple(systems))
    memory = np.zeros((len(systems), RECORD_WORDS))
    for p, own in zip(systems, memory, strict=True):
        if p is not None:
            keep(p, own)
    addresses = [0 if p is None else own.ctypes.data for p, own in zip(systems, memory, strict=True)]
    return KeptRecords(np.array(addresses, dtype=np.int64), (*systems, memory))


@intrinsic
def native_record_at(typingctx, address, like):  # type: ignore[no-untyped-def]
    """The reference at an address, of the type of another."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.inttoptr(args[0], ir.IntType(8).as_pointer())

    return like(address, like), codegen


@intrinsic
def native_store_record(typingctx, like, address):  # type: ignore[no-untyped-def]
    """Copy what a reference refers to."""
    from numba.core import types

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        kind = context.get_value_type(like.record)
        size = context.get_abi_sizeof(kind)
        assert size <= 8 * RECORD_WORDS
        target = builder.inttoptr(args[1], ir.IntType(8).as_pointer())
        copy: Any = cgutils.raw_memcpy
        copy(builder, target, args[0], ir.Constant(ir.IntType(64), size), 1)
        return context.get_dummy_value()

    return types.void(like, address), codegen
