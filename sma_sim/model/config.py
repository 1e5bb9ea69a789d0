"""Parameters from YAML files and from ``name=value`` words, checked against their declarations."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from shlex import quote
from types import MappingProxyType
from typing import Any

from sma_sim.model.effects.discovery import ActiveEffect, FoundEffect, effects_on, find_effects
from sma_sim.model.given import LISTS, SWITCH_WORDS, ConfigError, Given, add_effect, given_values, named_folders, names_in
from sma_sim.model.parameters import SETTINGS, Parameter, Setting, joint_name_setting
from sma_sim.model.structures.discovery import FoundStructure, find_structures, package_structures, structure_of_size
from sma_sim.model.structures.structure import Structure

MODELS = ('hybrid', 'mas')
AUTO = 'auto'  # of kinetics: fits take the more probable one, simulations are hybrid


def default_parameters(system: str = 'module') -> dict[str, float]:
    """The default values of all parameters: the paper's, beside them those of another structure.

    Parameters
    ----------
    system : str
        A system of the package.

    Returns
    -------
    dict
        Values in SI units by full name, such as ``wire.E_A``.

    Examples
    --------
    >>> import sma_sim
    >>> sma_sim.default_parameters()['wire.r0']
    7.5e-05
    """
    return package_structures()[system].structure.default_values


def default_settings() -> dict[str, str | bool]:
    """The node's texts and switches by full name."""
    return {name: setting.default for name, setting in SETTINGS.items()}


def settings_of(structure: Structure) -> dict[str, Setting]:
    """The nodes' texts and switches by full name: also the names of a structure's joints, for the live check."""
    names = {name: f'check.name_{name}' for name in structure.coordinate_names}
    return dict(SETTINGS) | {full: joint_name_setting(name) for name, full in names.items()}


@dataclass(frozen=True)
class Config:
    """Checked parameters of a model.

    Attributes
    ----------
    parameters : mapping
        Values in SI units by full name; those that are left out have the defaults of the system.
    system, model : str
        Name of the structure, such as ``'module'``; kinetics ``'hybrid'`` or ``'mas'``.
    effects : tuple of ActiveEffect
        Active effects with their parameter values.
    settings : mapping
        Settings of the node that are not numbers.
    own_structure : FoundStructure, optional
        The structure where it is not one of the package.
    model_is_given : bool
        Whether a file or a command line says which kinetics; then fits keep them.

    Raises
    ------
    ConfigError
        For a system that is not one of the package and is not given.
    """

    parameters: Mapping[str, float] = field(default_factory=dict)
    system: str = 'module'
    model: str = 'hybrid'
    effects: tuple[ActiveEffect, ...] = ()
    settings: Mapping[str, str | bool] = field(default_factory=default_settings)
    own_structure: FoundStructure | None = None
    model_is_given: bool = field(default=False, compare=False)

    def __post_init__(self) -> None:
        if self.own_structure is None and self.system not in package_structures():
            raise ConfigError(f'unknown system {self.system!r}: expected one of {", ".join(package_structures())}')
        needed = self.structure.structure.default_values
        if not needed.keys() <= self.parameters.keys():
            object.__setattr__(self, 'parameters', needed | dict(self.parameters))

    @property
    def kinetics(self) -> str:
        """``'hybrid'`` or ``'mas'`` where these kinetics were given, ``'auto'`` where fits may choose.

        Hybrid is the default, so that only `model_is_given` tells whether it was given.
        """
        return self.model if self.model_is_given or self.model != MODELS[0] else AUTO

    @property
    def structure(self) -> FoundStructure:
        """What the wires pull on, of the size that the parameters say."""
        return structure_of_size(self.own_structure or package_structures()[self.system], self.parameters)

    def on_bench(self, name: str) -> Config:
        """The same wire and effects on another bench of the package: a structure that differs in its options only.

        What only this bench has, such as the lag of a load-controlled machine, keeps its value; what only the other one has
        gets its default, and wires start as they do there.
        """
        own = self.structure.structure
        if name == own.name:
            return self
        other = package_structures()[name].structure
        values = {n: v for n, v in self.parameters.items() if n not in other.defaults and n not in own.defaults}
        effects = tuple(
            active
            if active.found.effect.scope.name
            else replace(active, found=(active.found.plain or active.found).on(other, values))
            for active in self.effects
        )
        return replace(self, system=name, own_structure=None, parameters=other.default_values | values, effects=effects)


def flat_parameters(config: Config) -> dict[str, Any]:
    """All that a configuration says, by full name: `read_config` makes the same one of it."""
    values: dict[str, Any] = {'system': config.system, 'model': config.model, **config.parameters, **config.settings}
    values['effects.active'] = [active.found.effect.name for active in config.effects]
    values['effects.paths'] = absolute_folders(file for active in config.effects for file in active.found.files)
    values['structures.paths'] = folders_of(config.structure)
    for active in config.effects:
        effect = active.found.effect
        values |= {f'effects.{effect.name}.{p.name}': v for p, v in zip(effect.parameters, active.values, strict=True)}
    return values


def folders_of(found: FoundStructure) -> list[str]:
    """Folders of the files of a structure, as absolute paths; none for one of the package."""
    return absolute_folders(found.files)


def absolute_folders(files: Iterable[Path]) -> list[str]:
    """The folders of some files, each once."""
    return sorted({os.path.abspath(file.parent) for file in files})


def read_config(
    path: Path | None = None,
    words: Iterable[str] = (),
    effects: Iterable[str] = (),
    recorded: Mapping[str, Any] = MappingProxyType({}),
    source: str = 'a recording',
) -> Config:
    """Read a configuration: a YAML file, then ``name=value`` words over it; defaults for everything else.

    Parameters
    ----------
    path : Path, optional
        A ROS 2 parameter file, as the node reads it.
    words : iterable of str
        Parameters as ``name=value``, SI units.
    effects : iterable of str
        Further active effects, as ``name`` or ``name:parameter=value,...``; ``name@scope`` acts in one wire, coordinate
        or channel only.
    recorded : mapping
        Values by full name that were recorded with data, which all others replace. Folders of effects that are only
        named there are not opened, because importing their files runs them.
    source : str
        Where `recorded` comes from, for messages.

    Returns
    -------
    Config
        Checked parameters; `Model` takes it.

    Raises
    ------
    UserError
        For an unknown name, a value out of range, or a file that cannot be read.

    Examples
    --------
    >>> import sma_sim
    >>> config = sma_sim.read_config(words=['beam.E=2.2e9'], effects=['gravity'])
    >>> config.parameters['beam.E'], config.model
    (2200000000.0, 'hybrid')
    """
    given = {name: Given(value, f'recorded in {source}', recorded=True) for name, value in recorded.items()}
    given |= given_values(path, words)
    for word in effects:
        add_effect(word, given)
    return checked(given)


def checked(given: Mapping[str, Given]) -> Config:
    """Names, types and ranges checked; defaults filled in. Raises UserError."""
    own = checked_structure(given)
    structure = own.structure
    defaults, ranges, texts = structure.default_values, structure.all_parameters, settings_of(structure)
    known = {name: Given(value, 'default') for name, value in defaults.items()}
    folders = given.get('effects.paths', Given([], ''))
    found = find_effects([] if folders.recorded else named_folders('effects.paths', folders))
    if folders.recorded:
        check_effects_found(given, found, folders)
    found = effects_on(found, names_of_effects(given), structure, numbers_within(given, defaults, ranges))
    declared = ranges | effect_parameters(found)
    model, settings = AUTO, {name: setting.default for name, setting in texts.items()}
    for name, entry in given.items():
        if name == 'model':
            model = checked_choice(name, entry, (*MODELS, AUTO))
        elif name in texts:
            settings[name] = checked_setting(name, entry, texts[name])
        elif name not in LISTS and name != 'system' and name not in structure.options:
            known[name] = Given(checked_number(name, entry, declared), entry.where)
    active = names_in('effects.active', given.get('effects.active', Given([], '')))
    effects = tuple(active_effect(name, found, known, given) for name in active)
    values = {name: float(known[name].value) for name in defaults}
    return Config(
        values, structure.family, MODELS[0] if model == AUTO else model, effects, settings, own if own.files else None,
        model != AUTO,
    )  # fmt: skip


def numbers_within(
    given: Mapping[str, Given], defaults: Mapping[str, float], ranges: Mapping[str, Parameter]
) -> dict[str, float]:
    """The values of all parameters of the model: what is given and within its bounds, else the defaults."""
    numbers = dict(defaults)
    for name, entry in given.items():
        low, high = ranges[name].bounds if name in defaults else (0.0, 0.0)
        if name in defaults and isinstance(entry.value, int | float) and low <= entry.value <= high:
            numbers[name] = float(entry.value)
    return numbers


def checked_structure(given: Mapping[str, Given]) -> FoundStructure:
    """The structure of the system that is given. Raises UserError."""
    folders = given.get('structures.paths', Given([], ''))
    found = find_structures([] if folders.recorded else named_folders('structures.paths', folders))
    one = given.get('system', Given('module', 'default'))
    if one.value not in found and folders.recorded and names_in('structures.paths', folders):
        raise ConfigError(only_named_in_data(f'the structure {one.value}', 'structures.paths', folders))
    if one.value not in found and names_in('structures.paths', folders):
        where = ', '.join(map(str, named_folders('structures.paths', folders)))
        one = replace(one, where=f'{one.where}; no STRUCTURE in {where} has this name')
    base = chosen_variant(found[checked_choice('system', one, tuple(found))], given, found)
    size = base.structure.size_name
    if size not in given:
        return base
    return structure_of_size(base, {size: checked_number(size, given[size], base.structure.declared)})


def chosen_variant(
    structure: FoundStructure, given: Mapping[str, Given], found: Mapping[str, FoundStructure]
) -> FoundStructure:
    """The variant of a structure that the given options name; itself without any. Raises ConfigError."""
    own = structure.structure.options
    family = [member for member in found.values() if own and member.structure.options.keys() == own.keys()]
    for name in own:
        if name in given:
            checked_choice(name, given[name], sorted({member.structure.options[name] for member in family}))
    wanted = {name: str(given[name].value) if name in given else word for name, word in own.items()}
    return next((member for member in family if dict(member.structure.options) == wanted), structure)


def checked_choice(name: str, one: Given, choices: Sequence[str]) -> str:
    """One of a few words."""
    if one.value not in choices:
        raise ConfigError(f'{name} = {one.value!r} ({one.where}): expected one of {", ".join(choices)}')
    return str(one.value)


def checked_setting(name: str, one: Given, setting: Setting) -> str | bool:
    """A text or a switch."""
    wanted = type(setting.default)
    value = SWITCH_WORDS.get(str(one.value).lower(), one.value) if wanted is bool else one.value
    if not isinstance(value, wanted):
        kind = 'true or false' if wanted is bool else 'a text'
        raise ConfigError(f'{name} = {one.value!r} ({one.where}): expected {kind}')
    return value


def check_effects_found(given: Mapping[str, Given], found: Mapping[str, FoundEffect], folders: Given) -> None:
    """Raise ConfigError where an active effect can only come from folders that are named in data alone."""
    names = names_in('effects.active', given.get('effects.active', Given([], '')))
    unknown = [name for name in names if name not in found]
    if unknown and names_in('effects.paths', folders):
        raise ConfigError(only_named_in_data(f'the effect {unknown[0]}', 'effects.paths', folders))


def only_named_in_data(what: str, parameter: str, folders: Given) -> str:
    """Why files are not imported, and how a user has them imported."""
    paths = names_in(parameter, folders)
    return (
        f'{what} is needed, but only data name its folder ({folders.where}): {", ".join(paths)}. '
        'Python files in a folder that data name are not run unless you name it too: if you trust them, add '
        f'--set {parameter}={quote(",".join(paths))}'
    )


def names_of_effects(given: Mapping[str, Given]) -> list[str]:
    """The effects that are switched on, or whose parameters are given."""
    active = names_in('effects.active', given.get('effects.active', Given([], '')))
    return [*active, *(name.split('.')[1] for name in given if name.startswith('effects.'))]


def effect_parameters(found: Mapping[str, FoundEffect]) -> dict[str, Parameter]:
    """Parameters of all effects by full name."""
    return {f'effects.{name}.{p.name}': p for name, each in found.items() for p in each.effect.parameters}


def active_effect(
    name: str, found: Mapping[str, FoundEffect], known: Mapping[str, Given], given: Mapping[str, Given]
) -> ActiveEffect:
    """An effect with its parameters, their defaults where nothing was given."""
    if name not in found:
        where = given['effects.active'].where
        raise ConfigError(
            f'unknown effect {name} (effects.active, {where}){suggestion(name, found)}; known are '
            f'{", ".join(sorted(found))}; your own need their folder in effects.paths'
        )
    names = {p.name: f'effects.{name}.{p.name}' for p in found[name].effect.parameters}
    values = [
        float(known[names[p.name]].value) if names[p.name] in known else p.default for p in found[name].effect.parameters
    ]
    return ActiveEffect(found[name], tuple(values))


def suggestion(name: str, known: Iterable[str]) -> str:
    """What may have been meant."""
    close = difflib.get_close_matches(name, list(known), n=3, cutoff=0.4)
    return f'; did you mean {" or ".join(close)}?' if close else ''


def checked_number(name: str, one: Given, declared: Mapping[str, Parameter]) -> float:
    """One number within its bounds."""
    if name not in declared:
        hint = suggestion(name, [*declared, 'system', 'model', *LISTS, *SETTINGS])
        raise ConfigError(f'unknown parameter {name} ({one.where}){hint}')
    parameter, value = declared[name], one.value
    low, high = parameter.bounds
    if isinstance(value, bool) or not isinstance(value, int | float):
        unit = f' in {parameter.unit}'.removesuffix(' in -')
        raise ConfigError(f'{name} = {value!r} ({one.where}): expected a number{unit}{yaml_hint(value)}')
    number = float(value)
    if math.isnan(number) and math.isnan(parameter.default):
        return number
    if not low <= number <= high:
        unit = f' {parameter.unit}'.removesuffix(' -')
        raise ConfigError(f'{name} = {number:g}{unit} ({one.where}): expected {low:g} to {high:g}{unit}')
    return number


def yaml_hint(value: Any) -> str:
    """YAML reads 12e9 as text: say how to write it."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return ''
    return f'; write {number:e} (YAML wants a point and a sign in the exponent)' if isinstance(value, str) else ''
