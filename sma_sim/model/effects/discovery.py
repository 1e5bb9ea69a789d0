"""Finds effects: those of the package, files in folders of the user's own, entry points of other packages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType

import sma_sim.model.effects.library as package
from sma_sim.model.argument_checks import as_folders, checked
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.scope import SEPARATOR, Scope
from sma_sim.model.errors import UserError
from sma_sim.model.plugins import OWN, package_plugins, user_plugins
from sma_sim.model.structures.structure import Structure

ENTRY_POINTS = 'sma_sim.effects'


class EffectError(UserError):
    """An effect file that cannot be used; the message names the file and what is wrong."""


@dataclass(frozen=True, repr=False)
class FoundEffect:
    """An effect and the files that its kernels depend on."""

    effect: Effect
    files: tuple[Path, ...]
    packages: tuple[str, ...]  # prefixes of the modules whose functions are compiled with the kernels
    plain: FoundEffect | None = None  # of one in a scope, or on a structure: the effect itself, whose kernels it shares

    def on(self, structure: Structure, values: Mapping[str, float] | None = None) -> FoundEffect:
        """The effect as it is on a structure with parameters `values` by full name (default: the structure's own)."""
        effect = effect_on(self.effect, structure, values)
        return self if effect is self.effect else replace(self, effect=effect, plain=self.plain or self)

    def in_scope(self, scope: Scope) -> FoundEffect:
        """The same effect in one of its scopes."""
        return replace(self, effect=self.effect.in_scope(scope), plain=self.plain or self)

    def __hash__(self) -> int:
        """Of what tells effects apart nearly always: it is asked for with every model."""
        return hash((self.effect.name, self.files))

    def __repr__(self) -> str:
        return f'FoundEffect({self.effect.name})'


@dataclass(frozen=True, repr=False)
class ActiveEffect:
    """An effect with the values of its parameters, in the order of its declaration."""

    found: FoundEffect
    values: tuple[float, ...]

    def __repr__(self) -> str:
        pairs = zip(self.found.effect.parameters, self.values, strict=False)
        return f'{self.found.effect.name}({", ".join(f"{parameter.name}={value:g}" for parameter, value in pairs)})'

    @property
    def by_name(self) -> dict[str, float]:
        """The values by full name, such as ``effects.gravity.g_y``."""
        return {f'effects.{self.found.effect.name}.{name}': value for name, value in self.by_short_name.items()}

    @property
    def by_short_name(self) -> dict[str, float]:
        """The values by the names that the effect's declaration gives its parameters."""
        return {p.name: value for p, value in zip(self.found.effect.parameters, self.values, strict=True)}

    def with_values(self, values: Mapping[str, float]) -> ActiveEffect:
        """The same with values that are given by full name."""
        return replace(self, values=tuple(values.get(name, value) for name, value in self.by_name.items()))


@cache
def package_effects() -> dict[str, FoundEffect]:
    """The effects of the package and of installed packages that declare an entry point, by name."""
    plugins = package_plugins(package, 'EFFECT', ENTRY_POINTS)
    return {plugin.value.name: FoundEffect(plugin.value, plugin.files, plugin.packages) for plugin in plugins}


def found_effect(effect: Effect, known: Mapping[str, FoundEffect] = MappingProxyType({})) -> FoundEffect:
    """An effect that is given as an object: one of the package or of those `known`, or one of your own, which has no file.

    Raises EffectError where another effect has its name.
    """
    name = effect.plain_name
    for each in (known, package_effects()):
        if name in each and each[name].effect is effect:
            return each[name]
    if name in package_effects() or name in known:
        raise EffectError(f'an effect named {name!r} exists already; choose another name')
    kernels = (effect.kernel, effect.rate, effect.start)
    modules = {kernel.__module__.partition('.')[0] for kernel in kernels if kernel is not None}
    return FoundEffect(effect, (), (*OWN, *sorted(modules)))


@checked
def find_effects(folders: str | Path | Iterable[str | Path] = ()) -> dict[str, FoundEffect]:
    """All effects by name: those of the package and those in the given folders.

    Parameters
    ----------
    folders : str or Path, or several
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
    for folder in as_folders('effects.paths', folders):
        for plugin in user_plugins(folder, 'effects.paths', Effect, EffectError):
            effect = plugin.value
            if effect.name in found:
                raise EffectError(f'{plugin.file}: an effect named {effect.name!r} exists already; choose another name')
            found[effect.name] = FoundEffect(effect, plugin.files, plugin.packages)
    return found


def effects_on(
    found: Mapping[str, FoundEffect], names: Iterable[str], structure: Structure, values: Mapping[str, float] | None = None
) -> dict[str, FoundEffect]:
    """The effects as they are on a structure with parameters `values`, and those of `names` that name one in a scope.

    Raises EffectError for an unknown scope.
    """
    return with_scopes({name: one.on(structure, values) for name, one in found.items()}, names)


def with_scopes(found: Mapping[str, FoundEffect], names: Iterable[str]) -> dict[str, FoundEffect]:
    """The effects and, of `names`, those that name one in a scope (NAME@SCOPE). Raises EffectError for an unknown scope."""
    every = dict(found)
    for name in names:
        plain, separator, scope = name.partition(SEPARATOR)
        if separator and plain in found:
            effect = found[plain].effect
            scopes = {one.name: one for one in effect.scopes}
            known = scopes | {one.name: one for one in effect.forms}
            if scope not in known:
                raise EffectError(
                    f'unknown scope {scope!r} of effect {plain} ({name}): expected one of {", ".join(scopes)}, '
                    f'such as {plain}{SEPARATOR}{next(iter(scopes))}'
                )
            every[name] = found[plain].in_scope(known[scope])
    return every
