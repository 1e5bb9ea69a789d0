"""The only place that compiles: plain Python functions of the model in, native code out.

What Python calls is compiled as one piece with everything that it calls (compiler.fragments). Native code is kept in a
folder whose name is a hash of every source file that went into it, so that no stale code is ever used (numba itself
misses a change in a callee), and copies of the package with the same sources share it.
With NUMBA_DISABLE_JIT=1 nothing is compiled: all runs as plain Python, where debuggers and coverage see it, to the
same bits and a hundred times slower.
"""

from __future__ import annotations

import ctypes
import getpass
import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from threading import RLock
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

import llvmlite
import numba
import numpy as np
from numba.core import types
from numba.extending import intrinsic

from sma_sim.compiler.by_reference import by_reference, native_record_at, native_store_record
from sma_sim.compiler.fragments import Entry, fragment
from sma_sim.compiler.native_code_cache import CachedCFunc
from sma_sim.compiler.pinned_systems import record_at, store_record
from sma_sim.model.effects.ports import call_kernel

_numba: Any = numba  # its types are not declared
carray = _numba.carray
_one_at_a_time = RLock()
_PACKAGE = Path(__file__).resolve().parent.parent
_COMPILED_FOLDERS = ('model', 'compiler', 'solver')
OWN = ('sma_sim.',)
LIBRARIES = (*OWN, 'math', 'numba', 'numpy', 'scipy')  # what is in them is that of a version, or of our own sources
# Large functions that are called from several others; the rest is inlined where it is called.
OUT_OF_LINE = (
    'update_flow',
    'update_guards',
    'linearize_flow',
    'linearize_segments',
    'difference',
    'eliminate',
    'solve_eliminated',
    'rosenbrock_step',
    'observe',
    'crossing',
    'first_jump_before',
    'jump_now',
    'run_segment',
    'cross_row',
    'row_step',
    'integrate',
    'integrate_held',
    'linearize_node',
    'unknown_columns',
    'tangent_step',
    'restart',
    'follow_segment',
    'follow',
    'interpolate',
    'add_row',
    'add_combination',
    'subtract_product',
    'solve_for_all',
    'sample_row',
    'start_states',
    'balance',
    'solve_pose',
    'start_at',
    'start',
)
ENTRY = 'def {name}(*arguments):\n    return function(*by_reference(arguments))\n'


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


# What plain Python does in its own way.
INTRINSICS: dict[Callable[..., Any], Any] = {
    call_kernel: _native_call,
    record_at: native_record_at,
    store_record: native_store_record,
}


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


def content_key(*paths: Path, code: str = '') -> str:
    """Hash of the given files, of `code`, and of all sources of the package that take part in compilation."""
    sources = [file for folder in _COMPILED_FOLDERS for file in (_PACKAGE / folder).rglob('*.py')]
    digest = hashlib.sha256(f'{sys.version} {numba.__version__} {llvmlite.__version__}'.encode())
    for file in [*sorted(sources), *sorted(set(paths) - set(sources))]:
        digest.update(file.name.encode() + b'\0' + file.read_bytes() + b'\0')
    digest.update(code.encode())
    return digest.hexdigest()[:20]


def code_of(*functions: Callable[..., Any] | None) -> str:
    """What functions that no known file holds do, as text: their code, and the constants and functions that they use. These
    are part of native code as they were when it was compiled."""
    parts: list[str] = []
    pending, seen = [function for function in functions if function is not None], set[Any]()
    while pending:
        python = pending.pop()
        if python in seen or not isinstance(python, FunctionType) or str(python.__module__).startswith(LIBRARIES):
            continue
        seen.add(python)
        names = names_in(python.__code__)
        modules = [one for name in names if isinstance(one := python.__globals__.get(name), ModuleType)]
        parts.append(text_of(python.__code__))
        used = [
            *(cell.cell_contents for cell in python.__closure__ or ()),
            *(python.__defaults__ or ()),
            *(python.__globals__.get(name) for name in names),
            *(vars(one).get(name) for one in modules if not one.__name__.startswith(LIBRARIES) for name in names),
        ]
        for value in used:
            if isinstance(value, FunctionType):
                pending.append(value)
            elif isinstance(value, np.ndarray):
                parts.append(f'{value.dtype} {value.shape} {value.tobytes().hex()}')
            elif isinstance(value, complex | float | int | str | tuple | np.generic):
                parts.append(repr(value))
    return '\n'.join(parts)


def names_in(code: CodeType) -> list[str]:
    """The names that a code object and those within it look up."""
    inner = (one for one in code.co_consts if isinstance(one, CodeType))
    return [*code.co_names, *(name for one in inner for name in names_in(one))]


def text_of(code: CodeType) -> str:
    """A code object as text, without where it was written: a cell of a notebook has another name every time."""
    constants = [text_of(one) if isinstance(one, CodeType) else repr(one) for one in code.co_consts]
    return f'{code.co_name} {code.co_code.hex()} {code.co_names} {code.co_varnames} {constants}'


def compiled_with(files: Iterable[Path], *functions: Callable[..., Any] | None) -> tuple[str, ...]:
    """Prefixes of the modules whose functions are compiled with kernels: this package's, their own, those in their files."""
    modules = {str(function.__module__).partition('.')[0] for function in functions if function is not None}
    return (*OWN, *sorted(modules - {_PACKAGE.name}), *(file.stem for file in files))


def user_cache() -> Path:
    """Where the user's native code is kept, by the custom of the operating system."""
    if sys.platform == 'win32':
        return Path(os.environ.get('LOCALAPPDATA') or Path.home() / 'AppData' / 'Local') / 'sma_sim'
    custom = 'Library/Caches' if sys.platform == 'darwin' else '.cache'
    return Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / custom) / 'sma_sim'


def user_name() -> str:
    """The user's name; containers may have users without one."""
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):
        return 'user'


def cache_folder(key: str) -> Path:
    """A writable folder for native code of this key: the user's cache, or a temporary one."""
    for root in (user_cache(), Path(tempfile.gettempdir()) / f'sma_sim-{user_name()}'):
        folder = root / key
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder
        except OSError:
            continue
    return Path(tempfile.mkdtemp(prefix='sma_sim-'))


def is_compiled() -> bool:
    """Whether native code is at hand, or none is needed: the start of a run is compiled before all else."""
    return is_interpreted() or any(cache_folder(content_key()).glob('*/start.start-*.nbi'))


def write_source(file: Path, text: str) -> None:
    """Write a source that numba keeps native code for, unless it is there; several processes may do so at once."""
    if file.exists() and file.read_text(encoding='utf-8') == text:
        return
    handle, name = tempfile.mkstemp(dir=file.parent, suffix='.py')
    with open(handle, 'w', encoding='utf-8') as new:
        new.write(text)
    os.utime(name, (0, 0))  # numba takes native code for stale when the time of its source changes
    os.replace(name, file)


def first_lines_of(error: Exception) -> str:
    """The first lines of the long message of the compiler that say what is wrong."""
    noise = ('Failed in', 'During:', 'File "', '^', 'This error', '[1]')
    lines = [line.strip() for line in str(error).splitlines()]
    kept = [line for line in lines if line and not line.startswith(noise)]
    return ' '.join(kept[:3]) or type(error).__name__


def reachable(*roots: Callable[..., Any]) -> set[Callable[..., Any]]:
    """The functions of the package that are compiled with those given."""
    found: set[Callable[..., Any]] = set()
    pending: list[Any] = list(roots)
    while pending:
        python = pending.pop()
        if python not in found and python not in INTRINSICS:
            found.add(python)
            named = (python.__globals__.get(name) for name in python.__code__.co_names)
            pending += [f for f in named if isinstance(f, FunctionType) and str(f.__module__).startswith(OWN)]
    return found


class Compiler:
    """Compiles functions with all that they call, into one cache folder."""

    def __init__(self, key: str, owned: tuple[str, ...] = OWN):
        self.folder = cache_folder(key)
        self._owned = owned
        self._fragments: dict[tuple[Callable[..., Any], bool], Any] = {}
        self._entries: dict[Callable[..., Any], Any] = {}

    def function(self, python: Callable[..., Any]) -> Any:
        """The compiled twin of `python`, for Python to call; it is compiled, or loaded, when it is called first."""
        if is_interpreted():
            return python
        with _one_at_a_time:
            if python not in self._entries:
                self._entries[python] = self._entry(python)
            return self._entries[python]

    def _entry(self, python: Callable[..., Any]) -> Any:
        name = python.__name__
        file, text = self.folder / f'{name}.py', ENTRY.format(name=name)
        write_source(file, text)
        namespace = {'function': self._fragment(python, inlined=False), 'by_reference': by_reference, '__name__': __name__}
        exec(compile(text, str(file), 'exec'), namespace)
        options = {'nopython': True, 'nogil': True, 'error_model': 'numpy', '_nrt': False, 'no_cfunc_wrapper': True}

        def build() -> Any:
            entry = Entry(namespace[name], targetoptions=options)
            entry.enable_caching()
            return entry

        return self._cached(build)

    def _with_compiled_callees(self, python: Callable[..., Any], *more: Callable[..., Any]) -> FunctionType:
        assert isinstance(python, FunctionType)
        namespace = dict(python.__globals__)
        for name in python.__code__.co_names:
            callee = namespace.get(name)
            if isinstance(callee, FunctionType) and (callee in more or str(callee.__module__).startswith(self._owned)):
                namespace[name] = self._callee(callee)
            elif isinstance(callee, ModuleType) and callee.__name__.startswith(self._owned):
                namespace[name] = self._compiled_module(callee, python.__code__.co_names)
        twin = FunctionType(python.__code__, namespace, python.__name__, python.__defaults__, python.__closure__)
        twin.__module__ = python.__module__ or __name__  # what `exec` has made may have none
        twin.__qualname__ = python.__qualname__
        return twin

    def _compiled_module(self, module: ModuleType, used: tuple[str, ...]) -> ModuleType:
        """A module whose functions that are `used` are compiled."""
        twin = ModuleType(module.__name__)
        twin.__dict__.update(module.__dict__)
        for name in used:
            if isinstance(getattr(module, name, None), FunctionType):
                setattr(twin, name, self._callee(getattr(module, name)))
        return twin

    def _callee(self, python: Callable[..., Any]) -> Any:
        return self._fragment(python, inlined=python.__name__ not in OUT_OF_LINE)

    def _fragment(self, python: Callable[..., Any], inlined: bool) -> Any:
        if python in INTRINSICS:
            return INTRINSICS[python]
        if (python, inlined) not in self._fragments:
            self._fragments[python, inlined] = fragment(self._with_compiled_callees(python), inlined)
        return self._fragments[python, inlined]

    def native(self, python: Callable[..., Any], *kernels: Callable[..., Any]) -> Any:
        """A C function of five data addresses that calls `kernels`; keep what is returned while its address is used."""
        if is_interpreted():
            return interpreted(python)
        kinds: Any = types
        addresses = 5 * (kinds.CPointer(kinds.float64),)
        twin = self._with_compiled_callees(python, *kernels)
        return self._cached(lambda: CachedCFunc(twin, addresses))

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
