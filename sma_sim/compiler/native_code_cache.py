"""Kept native code is loaded without what only compiling needs.

Before numba loads anything it imports its implementations of all of Python and NumPy, a third of the time that a short
command takes. Machine code needs none of them; when something is compiled after all, the compiler imports them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba.core.runtime
from numba.core import types
from numba.core.caching import FunctionCache
from numba.core.ccallback import CFunc

_runtime: Any = numba.core.runtime  # its types are not declared


class NativeCodeCache(FunctionCache):
    """Native code of one function in the cache folder."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for these types of arguments, if it is kept and can be loaded; with the runtime that it is linked to."""
        _runtime.rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            try:
                return self._load_overload(sig, target_context)
            except ModuleNotFoundError:  # kept by another program, such as a notebook, whose kernel has the same text
                self.flush()  # else what is compiled now could not be kept beside it
                return None


class CachedCFunc(CFunc):
    """A C function that returns nothing, compiled or loaded."""

    def __init__(self, python: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        """`arguments`: their types."""
        super().__init__(python, (arguments, types.void), locals={}, options={'error_model': 'numpy'})
        self._cache = NativeCodeCache(python)
        self.compile()
