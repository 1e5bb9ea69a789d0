"""What a user gives of parameters, with the place where it was given: YAML files, ``name=value`` words, data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from sma_sim.model.errors import UserError

KINETICS_NAMES = ('model', 'kinetics')  # in files, which go on having the first
LISTS = ('effects.active', 'effects.paths', 'structures.paths')
SWITCH_WORDS = {'true': True, 'false': False}
COMMAND_LINE = 'on the command line'
QOS_OVERRIDES = 'qos_overrides.'
OF_ROS = ('use_sim_time', 'start_type_description_service')  # every node has them; they say nothing of a model


class ConfigError(UserError):
    """A parameter that is wrong; the message names it, what was given, what is expected and where to change it."""


@dataclass(frozen=True)
class Given:
    """A value as given, where it was given, and the folder to which paths in it are relative.

    `recorded` values come from data, which must not decide which code is run.
    """

    value: Any
    where: str
    folder: Path = Path()
    recorded: bool = False


def belongs_to_ros(name: str) -> bool:
    """Whether a parameter is one of the node as such, which `ros2 param dump` writes too."""
    return name in OF_ROS or name.startswith(QOS_OVERRIDES)


def given_values(path: Path | None, words: str | Iterable[str] | Mapping[str, Any]) -> dict[str, Given]:
    """What a YAML file and ``name=value`` words, or values by name, say, by full name. Raises ConfigError."""
    given: dict[str, Given] = {}
    if path is not None:
        values = {name: value for name, value in flatten(read_yaml(path)).items() if not belongs_to_ros(name)}
        given |= {name: Given(value, f'in {path}', path.parent) for name, value in values.items()}
    if isinstance(words, Mapping):
        return given_over(given, {name: Given(value, COMMAND_LINE) for name, value in words.items()})
    for word in [words] if isinstance(words, str) else words:
        if not isinstance(word, str):
            raise ConfigError(f"words: expected 'name=value', such as 'wire.E_A=12e9'; got {word!r}")
        name, equals, text = word.partition('=')
        if not equals:
            raise ConfigError(f'--set {word}: expected name=value, such as --set wire.E_A=12e9')
        given = given_over(given, {name.strip(): Given(parse(name.strip(), text), COMMAND_LINE)})
    return given


def given_over(before: Mapping[str, Given], more: Mapping[str, Given]) -> dict[str, Given]:
    """All values, `more` over those `before`; either name of the kinetics replaces the other."""
    replaced = KINETICS_NAMES if any(name in more for name in KINETICS_NAMES) else ()
    return {name: one for name, one in before.items() if name not in replaced} | dict(more)


def structure_folders_of(path: Path | None, words: Iterable[str]) -> list[Path]:
    """The folders of the user's structures that a YAML file or ``structures.paths=...`` names. Raises ConfigError."""
    return named_folders('structures.paths', given_values(path, words).get('structures.paths', Given([], '')))


def effect_folders_of(path: Path | None, words: Iterable[str]) -> list[Path]:
    """The folders of the user's effects that a YAML file or ``effects.paths=...`` names. Raises ConfigError."""
    return named_folders('effects.paths', given_values(path, words).get('effects.paths', Given([], '')))


def parse(name: str, text: str) -> Any:
    """A value from the command line: a list for the lists of effects, a number where it reads as one."""
    if name in LISTS:
        return [word for word in text.split(',') if word]
    try:
        return float(text)
    except ValueError:
        return text


def effect_words(word: str) -> tuple[str, dict[str, Any]]:
    """The effect and the values by name of its parameters that ``name:parameter=value,...`` says. Raises ConfigError."""
    name, _, settings = word.partition(':')
    values = {}
    for setting in settings.split(',') if settings else ():
        parameter, equals, text = setting.partition('=')
        if not equals:
            raise ConfigError(f'--effect {word}: expected name:parameter=value,..., got {setting!r}')
        values[parameter.strip()] = parse(parameter.strip(), text)
    return name, values


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


def named_folders(name: str, one: Given) -> list[Path]:
    """Folders of the user's effects or structures; relative ones start at the YAML file's folder."""
    return [one.folder / Path(word).expanduser() for word in names_in(name, one)]
