"""Finds effects: those of the package, files in folders of the user's own, entry points of other packages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType

import sma_sim.model.effects.library as package
from sma_sim.model.argument_checks import as_folders, checked
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.scope import SEPARATOR
from sma_sim.model.errors import UserError
from sma_sim.model.plugins import package_plugins, user_plugins
from sma_sim.model.renamed import renamed
from sma_sim.model.structures.structure import Structure

ENTRY_POINTS = 'sma_sim.effects'


class EffectError(UserError):
    """An effect file that cannot be used; the message names the file and what is wrong."""


@renamed(found='effect')
@dataclass(frozen=True, repr=False)
class ActiveEffect:
    """An effect with the values of its parameters, in the order of its declaration."""

    effect: Effect
    values: tuple[float, ...]

    def __repr__(self) -> str:
        pairs = zip(self.effect.parameters, self.values, strict=False)
        return f'{self.effect.name}({", ".join(f"{parameter.name}={value:g}" for parameter, value in pairs)})'

    @property
    def by_name(self) -> dict[str, float]:
        """The values by full name, such as ``effects.gravity.g_y``."""
        return {f'effects.{self.effect.name}.{name}': value for name, value in self.by_short_name.items()}

    @property
    def by_short_name(self) -> dict[str, float]:
        """The values by the names that the effect's declaration gives its parameters."""
        return {p.name: value for p, value in zip(self.effect.parameters, self.values, strict=True)}

    def with_values(self, values: Mapping[str, float]) -> ActiveEffect:
        """The same with values that are given by full name."""
        return ActiveEffect(self.effect, tuple(values.get(name, value) for name, value in self.by_name.items()))


@cache
def package_effects() -> dict[str, Effect]:
    """The effects of the package and of installed packages that declare an entry point, by name."""
    return {effect.name: effect for effect in package_plugins(package, 'EFFECT', ENTRY_POINTS)}


def declared_effect(effect: Effect, known: Mapping[str, Effect] = MappingProxyType({})) -> Effect:
    """The declaration of an effect that is given as an object: one of the package, of those `known`, or one of your own.

    Raises EffectError where another effect has its name.
    """
    declared = effect.plain or effect
    for each in (known, package_effects()):
        if declared.name in each:
            if each[declared.name] != declared:
                raise EffectError(f'an effect named {declared.name!r} exists already; choose another name')
            return each[declared.name]
    return declared


@checked
def find_effects(folders: str | Path | Iterable[str | Path] = ()) -> dict[str, Effect]:
    """All effects by name: those of the package and those in the given folders.

    Parameters
    ----------
    folders : str or Path, or several
        Folders of effect files of your own. Importing them runs them.

    Returns
    -------
    dict
        An `Effect` by name.

    Raises
    ------
    EffectError
        For a folder that does not exist, a file that cannot be imported, or a name that exists already.

    Examples
    --------
    >>> import sma_sim
    >>> sma_sim.find_effects()['gravity'].port
    'structure_force'
    """
    found = dict(package_effects())
    for folder in as_folders('effects.paths', folders):
        for file, effect in user_plugins(folder, 'effects.paths', Effect, EffectError):
            if effect.name in found:
                raise EffectError(f'{file}: an effect named {effect.name!r} exists already; choose another name')
            found[effect.name] = effect
    return found


def effects_on(
    found: Mapping[str, Effect], names: Iterable[str], structure: Structure, values: Mapping[str, float] | None = None
) -> dict[str, Effect]:
    """The effects as they are on a structure with parameters `values`, and those of `names` that name one in a scope.

    Raises EffectError for an unknown scope.
    """
    return with_scopes({name: effect_on(one, structure, values) for name, one in found.items()}, names)


def with_scopes(found: Mapping[str, Effect], names: Iterable[str]) -> dict[str, Effect]:
    """The effects and, of `names`, those that name one in a scope (NAME@SCOPE). Raises EffectError for an unknown scope."""
    every = dict(found)
    for name in names:
        plain, separator, scope = name.partition(SEPARATOR)
        if separator and plain in found:
            effect = found[plain]
            scopes = {one.name: one for one in effect.scopes}
            known = scopes | {one.name: one for one in effect.forms}
            if scope not in known:
                raise EffectError(
                    f'unknown scope {scope!r} of effect {plain} ({name}): expected one of {", ".join(scopes)}, '
                    f'such as {plain}{SEPARATOR}{next(iter(scopes))}'
                )
            every[name] = effect.in_scope(known[scope])
    return every
