"""Python files in folders of the user's own: effects and structures."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from sma_sim.model.errors import UserError

USER_PACKAGE = 'sma_sim_user_files'
SEARCHED: set[Path] = set()  # folders whose helper modules may have been imported in this process


@dataclass(frozen=True)
class UserModules:
    """The files directly in a folder, imported; all its files, which their native code depends on, and their packages."""

    modules: tuple[tuple[Path, ModuleType], ...]
    files: tuple[Path, ...]
    packages: tuple[str, ...]  # prefixes of the modules whose functions are compiled with the kernels


def user_modules(folder: Path, parameter: str, error: type[UserError]) -> UserModules:
    """Import the files in a folder that a parameter names, which runs them. Raises `error` with what is wrong."""
    if not folder.is_dir():
        raise error(f'{parameter}: {folder} is not a folder')
    files = tuple(sorted(folder.rglob('*.py')))
    package = package_for(files)
    stems = tuple(file.stem for file in files)
    SEARCHED.add(folder.resolve())
    for stem in stems:  # helper modules that a file imports: edited since, or another folder's of the same name
        if is_below_one(SEARCHED, sys.modules.get(stem)):
            del sys.modules[stem]
    modules = tuple((file, load_file(file, package, error)) for file in sorted(folder.glob('*.py')))
    return UserModules(modules, files, ('sma_sim.', USER_PACKAGE, *stems))


def is_below_one(folders: Iterable[Path], module: ModuleType | None) -> bool:
    """Whether a module was imported from a file in one of the (resolved) folders."""
    file = getattr(module, '__file__', None)
    return file is not None and not set(folders).isdisjoint(Path(file).resolve().parents)


def load_file(file: Path, package: str, error: type[UserError]) -> ModuleType:
    """Import one file of the user's as a module of `package`. Raises `error` with what is wrong in it."""
    name = f'{package}.{file.stem}'
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    sys.path.insert(0, str(file.parent))
    writes, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # bytecode tells edits by second and size only
    try:
        spec.loader.exec_module(module)
    except Exception as fault:
        raise error(f'{file} cannot be loaded: {type(fault).__name__}: {fault}{hint(fault)}') from fault
    finally:
        sys.path.remove(str(file.parent))
        sys.dont_write_bytecode = writes
    return module


def hint(error: Exception) -> str:
    """What to do about an error in a file that another version of the program took."""
    if isinstance(error, TypeError) and "'depends_on_x'" in str(error):
        return '; remove it: what a kernel reads is inferred'
    return ''


def package_for(files: Iterable[Path]) -> str:
    """A package in memory for files of the user's, named by what is in them.

    Native code that was kept refers to its module by name: the name must be there again in the next process, and be
    another one after an edit.
    """
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.name.encode() + b'\0' + file.read_bytes())
    name = f'{USER_PACKAGE}_{digest.hexdigest()[:12]}'
    if name not in sys.modules:
        sys.modules[name] = ModuleType(name)
        sys.modules[name].__path__ = []
    return name
