"""Finds effects: those of the package, files in folders of the user's own, entry points of other packages."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import pkgutil
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

import sma_sim.model.effects.library as package
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.scope import SEPARATOR, Scope
from sma_sim.model.errors import UserError

ENTRY_POINTS = 'sma_sim.effects'
USER_PACKAGE = 'sma_sim_user_effects'
SEARCHED: set[Path] = set()  # folders of the user's, whose helper modules may have been imported in this process


class EffectError(UserError):
    """An effect file that cannot be used; the message names the file and what is wrong."""


@dataclass(frozen=True)
class FoundEffect:
    """An effect and the files that its kernels depend on."""

    effect: Effect
    files: tuple[Path, ...]
    packages: tuple[str, ...]  # prefixes of the modules whose functions are compiled with the kernels
    plain: FoundEffect | None = None  # of an effect in a scope: the effect itself, whose kernels it shares

    def in_scope(self, scope: Scope) -> FoundEffect:
        """The same effect in one of its scopes."""
        return replace(self, effect=self.effect.in_scope(scope), plain=self)

    def __hash__(self) -> int:
        """Of what tells effects apart nearly always: it is asked for with every model."""
        return hash((self.effect.name, self.files))


@dataclass(frozen=True)
class ActiveEffect:
    """An effect with the values of its parameters, in the order of its declaration."""

    found: FoundEffect
    values: tuple[float, ...]


@cache
def package_effects() -> dict[str, FoundEffect]:
    """The effects of the package and of installed packages that declare an entry point, by name."""
    found = {}
    for module in pkgutil.iter_modules(package.__path__):
        member = importlib.import_module(f'{package.__name__}.{module.name}')
        if hasattr(member, 'EFFECT'):
            found[member.EFFECT.name] = FoundEffect(member.EFFECT, (), ('sma_sim.',))
    for point in entry_points(group=ENTRY_POINTS):
        effect = point.load()
        home = sys.modules[point.module]
        files = tuple(Path(home.__file__).parent.rglob('*.py')) if home.__file__ else ()
        found[effect.name] = FoundEffect(effect, files, ('sma_sim.', point.module.split('.')[0]))
    return found


def find_effects(folders: Iterable[Path] = ()) -> dict[str, FoundEffect]:
    """All effects by name: those of the package and those in the given folders.

    Parameters
    ----------
    folders : iterable of Path
        Folders of effect files of your own. Importing them runs them.

    Returns
    -------
    dict
        A `FoundEffect` (the `Effect`, its file and its hash) by name.

    Raises
    ------
    EffectError
        For a folder that does not exist, a file that cannot be imported, or a name that exists already.

    Examples
    --------
    >>> import sma_sim
    >>> sma_sim.find_effects()['gravity'].effect.port
    'structure_force'
    """
    found = dict(package_effects())
    for folder in folders:
        if not folder.is_dir():
            raise EffectError(f'effects.paths: {folder} is not a folder')
        files = tuple(sorted(folder.rglob('*.py')))
        package = package_for(files)
        stems = tuple(file.stem for file in files)
        SEARCHED.add(folder.resolve())
        for stem in stems:  # helper modules that an effect file imports: edited since, or another folder's of the same name
            if is_below_one(SEARCHED, sys.modules.get(stem)):
                del sys.modules[stem]
        for file in sorted(folder.glob('*.py')):
            module = load_file(file, package)
            effect = getattr(module, 'EFFECT', None)
            if effect is None:
                continue
            if not isinstance(effect, Effect):
                raise EffectError(f'{file}: EFFECT must be an sma_sim.Effect, got {type(effect).__name__}')
            if effect.name in found:
                raise EffectError(f'{file}: an effect named {effect.name!r} exists already; choose another name')
            found[effect.name] = FoundEffect(effect, files, ('sma_sim.', USER_PACKAGE, *stems))
    return found


def with_scopes(found: Mapping[str, FoundEffect], names: Iterable[str]) -> dict[str, FoundEffect]:
    """The effects and, of `names`, those that name one in a scope (NAME@SCOPE). Raises EffectError for an unknown scope."""
    every = dict(found)
    for name in names:
        plain, separator, scope = name.partition(SEPARATOR)
        if separator and plain in found:
            scopes = {one.name: one for one in found[plain].effect.scopes}
            if scope not in scopes:
                raise EffectError(
                    f'unknown scope {scope!r} of effect {plain} ({name}): expected one of {", ".join(scopes)}, '
                    f'such as {plain}{SEPARATOR}{next(iter(scopes))}'
                )
            every[name] = found[plain].in_scope(scopes[scope])
    return every


def is_below_one(folders: Iterable[Path], module: ModuleType | None) -> bool:
    """Whether a module was imported from a file in one of the (resolved) folders."""
    file = getattr(module, '__file__', None)
    return file is not None and not set(folders).isdisjoint(Path(file).resolve().parents)


def load_file(file: Path, package: str) -> ModuleType:
    """Import one file of the user's as a module of `package`. Raises EffectError with what is wrong in it."""
    name = f'{package}.{file.stem}'
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    sys.path.insert(0, str(file.parent))
    writes, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # bytecode tells edits by second and size only
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise EffectError(f'{file} cannot be loaded: {type(error).__name__}: {error}{hint(error)}') from error
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
