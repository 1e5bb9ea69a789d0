"""Equality of records that hold arrays: where all of their fields are equal, NaN to NaN."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


class Comparable:
    """For dataclasses with ``eq=False``: those that the decorator makes raise for arrays."""

    __hash__ = None  # type: ignore[assignment]  # arrays can change

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return all(same(getattr(self, field.name), getattr(other, field.name)) for field in fields(self))  # type: ignore[arg-type]


def same(one: Any, other: Any) -> bool:
    """Whether two values are the same; arrays and what holds them in their elements."""
    if one is other:
        return True
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        first, second = np.asarray(one), np.asarray(other)
        numeric = first.dtype.kind in 'fc' and second.dtype.kind in 'fc'
        return bool(np.array_equal(first, second, equal_nan=numeric))
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if is_dataclass(one) and type(one) is type(other) and not isinstance(one, Comparable):
        return all(same(getattr(one, field.name), getattr(other, field.name)) for field in fields(one) if field.compare)
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other) or one != one and other != other  # NaN
