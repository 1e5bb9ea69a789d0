"""Files that join the model: those of the package, of installed packages, and in folders of the user's own."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import pkgutil
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from sma_sim.model.errors import UserError

USER_PACKAGE = 'sma_sim_user_files'
SEARCHED: set[Path] = set()  # folders whose helper modules may have been imported in this process


@cache
def installed_entry_points() -> Any:
    """Those of all installed packages, each of which is opened for them: once. Their class is another in Python 3.10."""
    return entry_points()


def package_plugins(package: ModuleType, attribute: str, group: str) -> Iterator[Any]:
    """What the modules of a package declare as `attribute`, and installed packages as entry points of a `group`.

    The latter with the `files` that their native code depends on.
    """
    for module in pkgutil.iter_modules(package.__path__):
        member = importlib.import_module(f'{package.__name__}.{module.name}')
        if hasattr(member, attribute):
            yield getattr(member, attribute)
    for point in installed_entry_points().select(group=group):
        value = point.load()
        home = sys.modules[point.module]
        files = tuple(Path(home.__file__).parent.rglob('*.py')) if home.__file__ else ()
        yield replace(value, files=files)


def user_plugins(folder: Path, parameter: str, kind: type[Any], error: type[UserError]) -> Iterator[tuple[Path, Any]]:
    """What the files in a folder that a `parameter` names declare of a kind: an `Effect` as ``EFFECT``. Importing runs them.

    By file; with all `files` that its native code depends on, beside the package's own.

    Raises `error` with what is wrong.
    """
    attribute = kind.__name__.upper()
    if not folder.is_dir():
        raise error(f'{parameter}: {folder} is not a folder')
    files = tuple(sorted(folder.rglob('*.py')))
    package = package_for(files)
    SEARCHED.add(folder.resolve())
    for stem in (
        file.stem for file in files
    ):  # helper modules that a file imports: edited since, or another folder's of the same name
        if is_below_one(SEARCHED, sys.modules.get(stem)):
            del sys.modules[stem]
    for file in sorted(folder.glob('*.py')):
        value = getattr(load_file(file, package, error), attribute, None)
        if value is None:
            continue
        if not isinstance(value, kind):
            raise error(f'{file}: {attribute} must be an sma_sim.{kind.__name__}, got {type(value).__name__}')
        yield file, replace(value, files=files)


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
    except (Exception, SystemExit) as fault:
        raise error(f'{file} cannot be loaded: {type(fault).__name__}: {fault}{hint(fault)}') from fault
    finally:
        sys.path.remove(str(file.parent))
        sys.dont_write_bytecode = writes
    return module


def hint(error: BaseException) -> str:
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
