"""The only place that compiles: plain Python functions of the model in, native code out.

Functions are compiled with everything that they call. Native code is kept in a folder whose name is a hash of
every source file that went into it, so that no stale code is ever used (numba itself misses a change in a callee).
With NUMBA_DISABLE_JIT=1 nothing is compiled: all runs as plain Python, where debuggers and coverage see it, to the
same bits and a hundred times slower.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from threading import RLock
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

import numba
from numba.core import types
from numba.extending import intrinsic

from sma_sim.model.effects.ports import call_kernel

_one_at_a_time = RLock()
_PACKAGE = Path(__file__).resolve().parent.parent
_COMPILED_FOLDERS = ('model', 'solver')
# The large functions; all others are small and are inlined where they are called.
OUT_OF_LINE = (
    'flow',
    'flow_at',
    'linearise',
    'rosenbrock_step',
    'observe',
    'crossing',
    'run_segment',
    'integrate',
    'integrate_held',
    'start',
)


@intrinsic
def _native_call(typingctx, address, s, w, p, m, out):  # type: ignore[no-untyped-def]
    """Call the C function at `address` with five addresses."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        from llvmlite import ir

        word = context.get_value_type(types.intp)
        kind = ir.FunctionType(ir.VoidType(), [word] * 5)
        values = [context.cast(builder, a, t, types.intp) for a, t in zip(args, signature.args, strict=True)]
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), values[1:])
        return context.get_dummy_value()

    return types.void(address, s, w, p, m, out), codegen


class InterpretedFunction(NamedTuple):
    """A Python function behind the address of a C function, in place of native code."""

    function: Any
    address: int


def interpreted(python: Callable[..., Any]) -> InterpretedFunction:
    """A C function of five data addresses that calls `python` itself."""
    function = ctypes.CFUNCTYPE(None, *[ctypes.POINTER(ctypes.c_double)] * 5)(python)
    return InterpretedFunction(function, ctypes.cast(function, ctypes.c_void_p).value or 0)


def is_interpreted() -> bool:
    """Whether numba is told to compile nothing (NUMBA_DISABLE_JIT)."""
    settings: Any = numba.config
    return bool(settings.DISABLE_JIT)


def content_key(*paths: Path) -> str:
    """Hash of the given files and of all sources of the package that take part in compilation."""
    sources = [file for folder in _COMPILED_FOLDERS for file in (_PACKAGE / folder).rglob('*.py')]
    digest = hashlib.sha256(f'{sys.version} {numba.__version__} {_PACKAGE}'.encode())
    for file in sorted({*sources, *paths}):
        digest.update(file.name.encode() + b'\0' + file.read_bytes() + b'\0')
    return digest.hexdigest()[:20]


def cache_folder(key: str) -> Path:
    """A writable folder for native code of this key: the user's cache, or a temporary one."""
    home = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache')
    for root in (home / 'sma_sim', Path(tempfile.gettempdir()) / f'sma_sim-{os.getuid()}'):
        folder = root / key
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder
        except OSError:
            continue
    return Path(tempfile.mkdtemp(prefix='sma_sim-'))


def is_compiled() -> bool:
    """Whether native code of the model and the solver is at hand, so that a start takes no half minute."""
    return is_interpreted() or any(cache_folder(content_key()).glob('*/integrate.run_segment-*.nbi'))


class Compiler:
    """Compiles functions with all that they call, into one cache folder."""

    def __init__(self, key: str, owned: tuple[str, ...] = ('sma_sim.',)):
        self.folder = cache_folder(key)
        self._owned = owned
        self._done: dict[Callable[..., Any], Any] = {call_kernel: _native_call}

    def function(self, python: Callable[..., Any]) -> Any:
        """The compiled twin of `python`; its callees of our own packages are compiled with it."""
        if is_interpreted():
            return python
        with _one_at_a_time:
            if python not in self._done:
                self._done[python] = self._jit(self._with_compiled_callees(python))
            return self._done[python]

    def _with_compiled_callees(self, python: Callable[..., Any], *more: Callable[..., Any]) -> FunctionType:
        assert isinstance(python, FunctionType)
        namespace = dict(python.__globals__)
        for name in python.__code__.co_names:
            callee = namespace.get(name)
            if isinstance(callee, FunctionType) and (callee in more or callee.__module__.startswith(self._owned)):
                namespace[name] = self.function(callee)
            elif isinstance(callee, ModuleType) and callee.__name__.startswith(self._owned):
                namespace[name] = self._compiled_module(callee, python.__code__.co_names)
        twin = FunctionType(python.__code__, namespace, python.__name__, python.__defaults__, python.__closure__)
        twin.__module__ = python.__module__
        twin.__qualname__ = python.__qualname__
        return twin

    def _compiled_module(self, module: ModuleType, used: tuple[str, ...]) -> ModuleType:
        """A module whose functions that are `used` are compiled."""
        twin = ModuleType(module.__name__)
        twin.__dict__.update(module.__dict__)
        for name in used:
            if isinstance(getattr(module, name, None), FunctionType):
                setattr(twin, name, self.function(getattr(module, name)))
        return twin

    def _jit(self, python: FunctionType) -> Any:
        # No reference counts (_nrt): our functions allocate nothing, and counting costs ten times the arithmetic.
        large = python.__name__ in OUT_OF_LINE
        options: dict[str, Any] = {'_nrt': False, 'forceinline': not large, 'cache': large}
        return self._cached(lambda: numba.njit(nogil=True, error_model='numpy', **options)(python))

    def native(self, python: Callable[..., Any], kernel: Callable[..., Any]) -> Any:
        """A C function of five data addresses that calls `kernel`; keep what is returned while its address is used."""
        if is_interpreted():
            return interpreted(python)
        kinds: Any = types
        signature = kinds.void(*([kinds.CPointer(kinds.float64)] * 5))
        twin = self._with_compiled_callees(python, kernel)
        return self._cached(lambda: numba.cfunc(signature, cache=True, error_model='numpy')(twin))

    def _cached(self, build: Callable[[], Any]) -> Any:
        # numba reads its cache folder, a setting of the whole process, when it makes a dispatcher, and only then.
        settings: Any = numba.config
        with _one_at_a_time:
            before = settings.CACHE_DIR
            settings.CACHE_DIR = str(self.folder)
            try:
                return build()
            finally:
                settings.CACHE_DIR = before


@cache
def package_compiler() -> Compiler:
    """The compiler of the package's own model and solver."""
    return Compiler(content_key())
