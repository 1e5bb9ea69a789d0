"""Values that were checked, as they were then: what callers do to their own arrays and dicts afterwards changes nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray


class ReadOnlyDict(dict[Any, Any]):
    """A dict of a checked record, which shows and compares as any other and cannot be changed."""

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError('this mapping has been checked and cannot be changed: make another record (dataclasses.replace)')

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (dict(self),)


def frozen(value: Any) -> Any:
    """A value whose mappings and arrays are read-only copies; lists and iterators, which are read once, are tuples."""
    if type(value) is np.ndarray:
        return own_array(value)
    if isinstance(value, Mapping):
        return ReadOnlyDict({name: frozen(one) for name, one in value.items()})
    return tuple(map(frozen, value)) if type(value) in (tuple, list) or isinstance(value, Iterator) else value


def own_array(array: NDArray[Any]) -> NDArray[Any]:
    """An array that nobody else can write to: a read-only copy; itself where all that it shows is read-only already.

    Fits make records of such arrays again and again.
    """
    owner: Any = array
    while isinstance(owner, np.ndarray) and not owner.flags.writeable:
        owner = owner.base
    if owner is not None:
        array = array.copy()
        array.flags.writeable = False
    return array
