"""Parameters from YAML files and from ``name=value`` words, checked against their declarations."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from sma_sim.model.parameters import DEFAULTS

CHOICES = {'system': ('module', 'wire'), 'model': ('hybrid', 'mas')}
IGNORED_GROUPS = ('node',)  # for the ROS node only


class ConfigError(ValueError):
    """A parameter that is wrong; the message names it, what was given, what is expected and where to change it."""


@dataclass(frozen=True)
class Config:
    """Checked parameters: numbers by full name, the system and the kinetics."""

    parameters: Mapping[str, float]
    system: str = 'module'
    model: str = 'hybrid'


def default_config() -> Config:
    """The paper's module."""
    return Config({name: parameter.default for name, parameter in DEFAULTS.items()})


def read_config(path: Path | None = None, words: Iterable[str] = ()) -> Config:
    """Parameters of a YAML file (the defaults where it is silent), then ``name=value`` words over them.

    Raises ConfigError.
    """
    given: dict[str, tuple[Any, str]] = {}
    if path is not None:
        given |= {name: (value, f'in {path}') for name, value in flatten(read_yaml(path)).items()}
    for word in words:
        name, equals, text = word.partition('=')
        if not equals:
            raise ConfigError(f'--set {word}: expected name=value, such as --set wire.E_A=12e9')
        given[name] = (parse(text), 'given with --set')
    return checked(given)


def parse(text: str) -> Any:
    """A value from the command line: a number where it reads as one."""
    try:
        return float(text)
    except ValueError:
        return text


def read_yaml(path: Path) -> Mapping[str, Any]:
    """The mapping below ``ros__parameters`` of a ROS 2 parameter file, or a plain mapping."""
    try:
        content = yaml.safe_load(path.read_text())
    except OSError as error:
        raise ConfigError(f'cannot read {path}: {error.strerror}') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f'{path} is not YAML: {error}') from error
    if not isinstance(content, dict):
        raise ConfigError(f'{path}: expected a mapping of parameters, got {type(content).__name__}')
    merged: dict[str, Any] = {}
    nodes = [v['ros__parameters'] for v in content.values() if isinstance(v, dict) and 'ros__parameters' in v]
    for node in nodes or [content]:
        merged |= node
    return merged


def flatten(tree: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    """Nested names joined with dots."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat |= flatten(value, f'{prefix}{key}.')
        else:
            flat[f'{prefix}{key}'] = value
    return flat


def checked(given: Mapping[str, tuple[Any, str]]) -> Config:
    """Names, types and ranges checked; defaults filled in."""
    numbers = {name: parameter.default for name, parameter in DEFAULTS.items()}
    words = {name: choices[0] for name, choices in CHOICES.items()}
    for name, (value, where) in given.items():
        if name in CHOICES:
            if value not in CHOICES[name]:
                raise ConfigError(f'{name} = {value!r} ({where}): expected one of {", ".join(CHOICES[name])}')
            words[name] = value
        elif name.split('.')[0] not in IGNORED_GROUPS:
            numbers[name] = checked_number(name, value, where)
    return Config(numbers, words['system'], words['model'])


def checked_number(name: str, value: Any, where: str) -> float:
    """One number within its bounds."""
    if name not in DEFAULTS:
        close = difflib.get_close_matches(name, [*DEFAULTS, *CHOICES], n=3, cutoff=0.4)
        hint = f'; did you mean {" or ".join(close)}?' if close else ''
        raise ConfigError(f'unknown parameter {name} ({where}){hint}')
    parameter = DEFAULTS[name]
    low, high = parameter.bounds
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f'{name} = {value!r} ({where}): expected a number in {parameter.unit}')
    number = float(value)
    if math.isnan(number) and math.isnan(parameter.default):
        return number
    if not low <= number <= high:
        raise ConfigError(
            f'{name} = {number:g} {parameter.unit} ({where}): expected {low:g} to {high:g} {parameter.unit}'
        )
    return number
