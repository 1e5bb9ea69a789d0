"""What a user gives of parameters, with the place where it was given: YAML files, ``name=value`` words, data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sma_sim.model.nearest import nearest
from sma_sim.model.parameter_yaml import ConfigError, belongs_to_ros, check_of_ros, flatten, read_yaml
from sma_sim.model.program_parameters import DEFAULTS

KINETICS_NAMES = ('model', 'kinetics')  # in files, which go on having the first
LISTS = ('effects.active', 'effects.paths', 'structures.paths')
SWITCH_WORDS = {'true': True, 'false': False}
COMMAND_LINE = 'on the command line'


@dataclass(frozen=True)
class RawValue:
    """A value as given, where it was given, and the folder to which paths in it are relative.

    `recorded` values come from data, which must not decide which code is run.
    """

    value: Any
    where: str
    folder: Path = Path()
    recorded: bool = False


def given_values(path: Path | None, words: str | Iterable[str] | Mapping[str, Any]) -> dict[str, RawValue]:
    """What a YAML file and ``name=value`` words, or values by name, say, by full name. Raises ConfigError."""
    given: dict[str, RawValue] = {}
    if path is not None:
        given |= {name: one for name, one in given_in_file(path).items() if not belongs_to_ros(name)}
    if isinstance(words, Mapping):
        return given_over(given, {name: RawValue(value, COMMAND_LINE) for name, value in words.items()})
    if not isinstance(words, Iterable):
        raise ConfigError(f"words: expected 'name=value', such as 'wire.E_A=12e9'; got {words!r}")
    for word in [words] if isinstance(words, str) else words:
        if not isinstance(word, str):
            raise ConfigError(f"words: expected 'name=value', such as 'wire.E_A=12e9'; got {word!r}")
        name, equals, text = word.partition('=')
        if not equals:
            near = nearest(word, [*DEFAULTS, 'system', *KINETICS_NAMES])
            example = f'{near[0]}=VALUE' if near else 'wire.E_A=12e9'
            raise ConfigError(f'--set {word}: expected name=value, such as --set {example}')
        given = given_over(given, {name.strip(): RawValue(parse(name.strip(), text), COMMAND_LINE)})
    return given


def given_over(before: Mapping[str, RawValue], more: Mapping[str, RawValue]) -> dict[str, RawValue]:
    """All values, `more` over those `before`; either name of the kinetics replaces the other."""
    replaced = KINETICS_NAMES if any(name in more for name in KINETICS_NAMES) else ()
    return {name: one for name, one in before.items() if name not in replaced} | dict(more)


def given_in_file(path: Path, node: str | None = None) -> dict[str, RawValue]:
    """What a parameter file says to a node, by full name; see `read_yaml`. Raises ConfigError."""
    given = {name: RawValue(value, f'in {path}', path.parent) for name, value in flatten(read_yaml(path, node)).items()}
    for name, one in given.items():
        if belongs_to_ros(name):
            check_of_ros(name, one.value, one.where)
    return given


def structure_folders_of(path: Path | None, words: Iterable[str]) -> list[Path]:
    """The folders of the user's structures that a YAML file or ``structures.paths=...`` names. Raises ConfigError."""
    return named_folders('structures.paths', given_values(path, words).get('structures.paths', RawValue([], '')))


def effect_folders_of(path: Path | None, words: Iterable[str]) -> list[Path]:
    """The folders of the user's effects that a YAML file or ``effects.paths=...`` names. Raises ConfigError."""
    return named_folders('effects.paths', given_values(path, words).get('effects.paths', RawValue([], '')))


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
            raise ConfigError(f'effect {word}: expected name:parameter=value,..., got {setting!r}')
        values[parameter.strip()] = parse(parameter.strip(), text)
    return name, values


def names_in(name: str, one: RawValue) -> list[str]:
    """A list of words, without the empty ones (ROS 2 cannot write an empty list)."""
    words = one.value if isinstance(one.value, list | tuple) else [one.value]
    if not all(isinstance(word, str) for word in words):
        raise ConfigError(f'{name} = {one.value!r} ({one.where}): expected a list of names, such as [gravity]')
    words = [word for word in words if word]
    doubled = [word for word in words if words.count(word) > 1]
    if doubled:
        raise ConfigError(f'{name} ({one.where}): {doubled[0]} is there twice')
    return words


def named_folders(name: str, one: RawValue) -> list[Path]:
    """Folders of the user's effects or structures; relative ones start at the YAML file's folder."""
    return [one.folder / Path(word).expanduser() for word in names_in(name, one)]
