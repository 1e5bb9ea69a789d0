"""Parameters from YAML files and from ``name=value`` words, checked against their declarations."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from shlex import quote
from types import MappingProxyType
from typing import Any

import yaml

from sma_sim.model.effects.discovery import ActiveEffect, FoundEffect, find_effects, with_scopes
from sma_sim.model.errors import UserError
from sma_sim.model.parameters import DEFAULTS, SETTINGS, Parameter

CHOICES = {'system': ('module', 'wire'), 'model': ('hybrid', 'mas')}
EFFECT_LISTS = ('effects.active', 'effects.paths')
SWITCH_WORDS = {'true': True, 'false': False}
COMMAND_LINE = 'on the command line'
QOS_OVERRIDES = 'qos_overrides.'
OF_ROS = ('use_sim_time', 'start_type_description_service')  # every node has them; they say nothing of a model


class ConfigError(UserError):
    """A parameter that is wrong; the message names it, what was given, what is expected and where to change it."""


def default_parameters() -> dict[str, float]:
    """The paper's values of all parameters.

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
    return {name: parameter.default for name, parameter in DEFAULTS.items()}


def default_settings() -> dict[str, str | bool]:
    """The node's texts and switches by full name."""
    return {name: setting.default for name, setting in SETTINGS.items()}


@dataclass(frozen=True)
class Config:
    """Checked parameters of a model.

    Attributes
    ----------
    parameters : mapping
        Values in SI units by full name.
    system, model : str
        ``'module'`` or ``'wire'``; kinetics ``'hybrid'`` or ``'mas'``.
    effects : tuple of ActiveEffect
        Active effects with their parameter values.
    settings : mapping
        Settings of the node that are not numbers.
    """

    parameters: Mapping[str, float] = field(default_factory=default_parameters)
    system: str = 'module'
    model: str = 'hybrid'
    effects: tuple[ActiveEffect, ...] = ()
    settings: Mapping[str, str | bool] = field(default_factory=default_settings)


def flat_parameters(config: Config) -> dict[str, Any]:
    """All that a configuration says, by full name: `read_config` makes the same one of it."""
    values: dict[str, Any] = {'system': config.system, 'model': config.model, **config.parameters, **config.settings}
    values['effects.active'] = [active.found.effect.name for active in config.effects]
    values['effects.paths'] = sorted({str(file.parent) for active in config.effects for file in active.found.files})
    for active in config.effects:
        effect = active.found.effect
        values |= {f'effects.{effect.name}.{p.name}': v for p, v in zip(effect.parameters, active.values, strict=True)}
    return values


@dataclass(frozen=True)
class Given:
    """A value as given, where it was given, and the folder to which paths in it are relative.

    `recorded` values come from data, which must not decide which code is run.
    """

    value: Any
    where: str
    folder: Path = Path()
    recorded: bool = False


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


def belongs_to_ros(name: str) -> bool:
    """Whether a parameter is one of the node as such, which `ros2 param dump` writes too."""
    return name in OF_ROS or name.startswith(QOS_OVERRIDES)


def given_values(path: Path | None, words: Iterable[str]) -> dict[str, Given]:
    """What a YAML file and ``name=value`` words say, by full name."""
    given: dict[str, Given] = {}
    if path is not None:
        values = {name: value for name, value in flatten(read_yaml(path)).items() if not belongs_to_ros(name)}
        given |= {name: Given(value, f'in {path}', path.parent) for name, value in values.items()}
    for word in words:
        name, equals, text = word.partition('=')
        if not equals:
            raise ConfigError(f'--set {word}: expected name=value, such as --set wire.E_A=12e9')
        given[name.strip()] = Given(parse(name.strip(), text), COMMAND_LINE)
    return given


def effect_folders_of(path: Path | None, words: Iterable[str]) -> list[Path]:
    """The folders of the user's effects that a YAML file or ``effects.paths=...`` names. Raises ConfigError."""
    return effect_folders(given_values(path, words).get('effects.paths', Given([], '')))


def parse(name: str, text: str) -> Any:
    """A value from the command line: a list for the lists of effects, a number where it reads as one."""
    if name in EFFECT_LISTS:
        return [word for word in text.split(',') if word]
    try:
        return float(text)
    except ValueError:
        return text


def add_effect(word: str, given: dict[str, Given]) -> None:
    """Put ``name:parameter=value,...`` into the given parameters."""
    name, _, settings = word.partition(':')
    before = given.get('effects.active', Given([], COMMAND_LINE))
    names = names_in('effects.active', before)
    given['effects.active'] = Given([*names, *([] if name in names else [name])], COMMAND_LINE)
    for setting in settings.split(',') if settings else ():
        parameter, equals, text = setting.partition('=')
        if not equals:
            raise ConfigError(f'--effect {word}: expected name:parameter=value,..., got {setting!r}')
        full = f'effects.{name}.{parameter.strip()}'
        given[full] = Given(parse(full, text), COMMAND_LINE)


def read_yaml(path: Path) -> Mapping[str, Any]:
    """The mapping below ``ros__parameters`` of a ROS 2 parameter file, or a plain mapping."""
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise ConfigError(f'cannot read {path}: {error.strerror}') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f'{path} is not YAML: {error}') from error
    if not isinstance(content, dict):
        raise ConfigError(f'{path}: expected a mapping of parameters, got {type(content).__name__}')
    merged: dict[str, Any] = {}
    nodes = [v['ros__parameters'] for v in content.values() if isinstance(v, dict) and 'ros__parameters' in v]
    for node in nodes or [content]:
        if not isinstance(node, dict):
            raise ConfigError(f'{path}: expected a mapping below ros__parameters, got {type(node).__name__}')
        merged |= node
    return merged


def flatten(tree: Mapping[Any, Any], prefix: str = '') -> dict[str, Any]:
    """Nested names joined with dots."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat |= flatten(value, f'{prefix}{key}.')
        else:
            flat[f'{prefix}{key}'] = value
    return flat


def checked(given: Mapping[str, Given]) -> Config:
    """Names, types and ranges checked; defaults filled in. Raises UserError."""
    known = {name: Given(parameter.default, 'default') for name, parameter in DEFAULTS.items()}
    folders = given.get('effects.paths', Given([], ''))
    found = find_effects([] if folders.recorded else effect_folders(folders))
    if folders.recorded:
        check_effects_found(given, found, folders)
    found = with_scopes(found, names_of_effects(given))
    declared = dict(DEFAULTS) | effect_parameters(found)
    words = {name: choices[0] for name, choices in CHOICES.items()}
    settings = default_settings()
    for name, one in given.items():
        if name in CHOICES:
            words[name] = checked_choice(name, one)
        elif name in SETTINGS:
            settings[name] = checked_setting(name, one)
        elif name not in EFFECT_LISTS:
            known[name] = Given(checked_number(name, one, declared), one.where)
    active = names_in('effects.active', given.get('effects.active', Given([], '')))
    effects = tuple(active_effect(name, found, known, given) for name in active)
    values = {name: float(known[name].value) for name in DEFAULTS}
    return Config(values, words['system'], words['model'], effects, settings)


def checked_choice(name: str, one: Given) -> str:
    """One of a few words."""
    if one.value not in CHOICES[name]:
        raise ConfigError(f'{name} = {one.value!r} ({one.where}): expected one of {", ".join(CHOICES[name])}')
    return str(one.value)


def checked_setting(name: str, one: Given) -> str | bool:
    """A text or a switch."""
    wanted = type(SETTINGS[name].default)
    value = SWITCH_WORDS.get(str(one.value).lower(), one.value) if wanted is bool else one.value
    if not isinstance(value, wanted):
        kind = 'true or false' if wanted is bool else 'a text'
        raise ConfigError(f'{name} = {one.value!r} ({one.where}): expected {kind}')
    return value


def names_in(name: str, one: Given) -> list[str]:
    """A list of words, without the empty ones (ROS 2 cannot write an empty list)."""
    words = one.value if isinstance(one.value, list | tuple) else [one.value]
    if not all(isinstance(word, str) for word in words):
        raise ConfigError(f'{name} = {one.value!r} ({one.where}): expected a list of names, such as [gravity]')
    words = [word for word in words if word]
    doubled = [word for word in words if words.count(word) > 1]
    if doubled:
        raise ConfigError(f'{name} ({one.where}): {doubled[0]} is there twice')
    return words


def effect_folders(one: Given) -> list[Path]:
    """Folders of the user's effects; relative ones start at the YAML file's folder."""
    return [one.folder / Path(word).expanduser() for word in names_in('effects.paths', one)]


def check_effects_found(given: Mapping[str, Given], found: Mapping[str, FoundEffect], folders: Given) -> None:
    """Raise ConfigError where an active effect can only come from folders that are named in data alone."""
    names = names_in('effects.active', given.get('effects.active', Given([], '')))
    unknown = [name for name in names if name not in found]
    paths = names_in('effects.paths', folders)
    if unknown and paths:
        raise ConfigError(
            f'the effect {unknown[0]} is needed, but only data name its folder ({folders.where}): {", ".join(paths)}. '
            'Python files in a folder that data name are not run unless you name it too: if you trust them, add '
            f'--set effects.paths={quote(",".join(paths))}'
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
        hint = suggestion(name, [*declared, *CHOICES, *EFFECT_LISTS, *SETTINGS])
        raise ConfigError(f'unknown parameter {name} ({one.where}){hint}')
    parameter, value = declared[name], one.value
    low, high = parameter.bounds
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f'{name} = {value!r} ({one.where}): expected a number in {parameter.unit}{yaml_hint(value)}')
    number = float(value)
    if math.isnan(number) and math.isnan(parameter.default):
        return number
    if not low <= number <= high:
        raise ConfigError(
            f'{name} = {number:g} {parameter.unit} ({one.where}): expected {low:g} to {high:g} {parameter.unit}'
        )
    return number


def yaml_hint(value: Any) -> str:
    """YAML reads 12e9 as text: say how to write it."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return ''
    return f'; write {number:e} (YAML wants a point and a sign in the exponent)' if isinstance(value, str) else ''
