"""Kept native code is loaded without what only compiling needs.

Before numba loads anything it imports its implementations of all of Python and NumPy, a third of the time that a short
command takes, and with every function it reads the bitcode that others may be linked with, a tenth of it. Machine code needs
neither; when something is compiled after all, the compiler imports them, and links with what it needs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba.core.runtime
from llvmlite.binding import parse_bitcode
from numba.core import types
from numba.core.caching import FunctionCache
from numba.core.ccallback import CFunc
from numba.core.codegen import JITCodeLibrary

_runtime: Any = numba.core.runtime  # its types are not declared


class KeptLibrary(JITCodeLibrary):
    """Machine code that was kept; its bitcode is read when something that is compiled is linked with it."""

    _bitcode = b''

    @classmethod
    def _unserialize(cls, codegen: Any, state: tuple[str, str, Any]) -> Any:
        name, kind, content = state
        if kind != 'object':
            return super()._unserialize(codegen, state)
        library = codegen.create_library(name)
        code, library._bitcode = content
        library.enable_object_caching()
        library._set_compiled_object(code)
        library._finalize_final_module()
        return library

    def _get_module_for_linking(self) -> Any:
        if self._bitcode and self._shared_module is None:
            self._shared_module = parse_bitcode(self._bitcode)
        return super()._get_module_for_linking()

    def get_pointer_to_function(self, name: str) -> int:
        """The address of a function; which ones there are numba would look up in the bitcode."""
        if not self._bitcode:
            return int(super().get_pointer_to_function(name))
        return int(self._codegen._engine.get_function_address(name))


class NativeCodeCache(FunctionCache):
    """Native code of one function in the cache folder."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for these types of arguments, if it is kept and can be loaded; with the runtime that it is linked to."""
        _runtime.rtsys.initialize(target_context)
        codegen = target_context.codegen()
        usual, codegen._library_class = codegen._library_class, KeptLibrary  # numba's lock is held
        with self._guard_against_spurious_io_errors():
            try:
                return self._load_overload(sig, target_context)
            except ModuleNotFoundError:  # kept by another program, such as a notebook, whose kernel has the same text
                self.flush()  # else what is compiled now could not be kept beside it
                return None
            finally:
                codegen._library_class = usual


class CachedCFunc(CFunc):
    """A C function that returns nothing, compiled or loaded."""

    def __init__(self, python: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        """`arguments`: their types."""
        super().__init__(python, (arguments, types.void), locals={}, options={'error_model': 'numpy'})
        self._cache = NativeCodeCache(python)
        self.compile()
