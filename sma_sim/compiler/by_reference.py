"""Large named tuples go to compiled functions by their address.

numba passes every number of a named tuple as an argument of its own. The model has 200 of them, which most functions
only pass on: three quarters of what the compiler had to read. Behind an address a function loads only what it reads.
"""

from __future__ import annotations

from typing import Any

import numba.core.types
from llvmlite import ir
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, register_model

types: Any = numba.core.types  # their classes are not declared
RECORD_WORDS = 1024  # of 8 bytes, more than a system needs
MAX_BY_VALUE = 8  # numbers and arrays of a named tuple that is passed by value
ADDRESS = ir.IntType(8).as_pointer()


def size_of(kind: Any) -> int:
    """Numbers and arrays in a type, those of inner tuples included."""
    return sum(map(size_of, kind)) if isinstance(kind, types.BaseTuple) else 1


def is_large(kind: Any) -> bool:
    """Whether values of this type are passed by reference."""
    return isinstance(kind, types.NamedTuple) and size_of(kind) > MAX_BY_VALUE


class Reference(types.Type):
    """The address of a named tuple that does not change while compiled code runs."""

    def __init__(self, record: Any) -> None:
        self.record = record
        super().__init__(name=f'reference({record.instance_class.__name__}, {size_of(record)})')

    @property
    def key(self) -> Any:
        """What makes two of them the same type."""
        return self.record


def passed_as(kind: Any) -> Any:
    """The type as which values of `kind` are passed."""
    return Reference(kind) if is_large(kind) else kind


@register_model(Reference)
class _ReferenceModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Reference) -> None:
        super().__init__(manager, kind, ADDRESS)


@infer_getattr
class _ReferenceFields(AttributeTemplate):
    key = Reference

    def generic_resolve(self, reference, name):  # type: ignore[no-untyped-def,override]
        fields = reference.record.fields
        return passed_as(reference.record[fields.index(name)]) if name in fields else None


@lower_getattr_generic(Reference)  # type: ignore[untyped-decorator]
def _field(context: Any, builder: Any, kind: Reference, value: Any, name: str) -> Any:
    position = kind.record.fields.index(name)
    record = builder.bitcast(value, context.get_value_type(kind.record).as_pointer())
    field = cgutils.gep_inbounds(builder, record, 0, position)
    return builder.bitcast(field, ADDRESS) if is_large(kind.record[position]) else _loaded(builder, field)


def _loaded(builder: Any, address: Any) -> Any:
    """What is at an address, number by number, each marked as one that no store changes."""
    kind = address.type.pointee
    if isinstance(kind, ir.LiteralStructType | ir.ArrayType):
        whole = ir.Constant(kind, ir.Undefined)
        for i in range(len(kind)):
            whole = builder.insert_value(whole, _loaded(builder, cgutils.gep_inbounds(builder, address, 0, i)), i)
        return whole
    number = builder.load(address)
    number.set_metadata('invariant.load', builder.module.add_metadata([]))
    return number


@intrinsic
def by_reference(typingctx, values):  # type: ignore[no-untyped-def]
    """The values of a tuple, large named tuples replaced by their addresses.

    They are on the caller's stack, and count as constant: only for calls of functions that are not inlined.
    """
    passed = types.Tuple([passed_as(kind) for kind in values.types])

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        items = []
        for i, kind in enumerate(values.types):
            item = builder.extract_value(args[0], i)
            if is_large(kind):
                item = builder.bitcast(cgutils.alloca_once_value(builder, item), ADDRESS)
            items.append(item)
        return context.make_tuple(builder, passed, items)

    return passed(values), codegen


@intrinsic
def native_record_at(typingctx, address, like):  # type: ignore[no-untyped-def]
    """The reference at an address, of the type of another."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.inttoptr(args[0], ADDRESS)

    return like(address, like), codegen


@intrinsic
def native_store_record(typingctx, like, address):  # type: ignore[no-untyped-def]
    """Copy what a reference refers to."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        kind = context.get_value_type(like.record)
        size = context.get_abi_sizeof(kind)
        assert size <= 8 * RECORD_WORDS
        target = builder.inttoptr(args[1], ADDRESS)
        copy: Any = cgutils.raw_memcpy
        copy(builder, target, args[0], ir.Constant(ir.IntType(64), size), 1)
        return context.get_dummy_value()

    return types.void(like, address), codegen
