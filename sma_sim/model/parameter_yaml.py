"""ROS 2 parameter files: the sections for a node, their numbers as ROS reads them, and what every node has.

Nodes and offline commands read files here, so that they say the same of the same file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from sma_sim.model.errors import UserError

SECTION = 'ros__parameters'
EVERY_NODE = '/**'
MODULE = 'sma_module_sim'  # the node as which the offline commands read a file, in any namespace
OF_OFFLINE = (MODULE, 'sma_model_check', 'sma_live_feed', 'sma_observer', 'sma_guard', 'sma_controller')
FLOAT = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$|[-+]?\.(inf|Inf|INF)$|\.(nan|NaN|NAN)$')
INTEGER = re.compile(r'[-+]?\d+$')
TAGS = {f'tag:yaml.org,2002:{name}' for name in ('int', 'float', 'timestamp')}  # that YAML 1.1 reads in its own way

QOS_OVERRIDES = 'qos_overrides.'
SWITCHES = ('use_sim_time', 'start_type_description_service')  # every node has them; they say nothing of a model
DEEPEST = 1_000_000  # messages; each keeps memory from the start on
QOS_CHOICES: Mapping[str, tuple[str, ...]] = {  # what a user may choose, by policy
    'history': ('keep_last', 'keep_all'),
    'reliability': ('reliable', 'best_effort'),
    'durability': ('volatile', 'transient_local'),
}
POLICIES = ('history', 'depth', 'reliability', 'durability')


class ConfigError(UserError):
    """A parameter that is wrong; the message names it, what was given, what is expected and where to change it."""


class NothingForNode(ConfigError):
    """A parameter file without a section for a node."""


class UniqueKeys(yaml.SafeLoader):
    """YAML in which no key of a mapping is there twice: Python would keep the last one alone, ROS joins them."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """A mapping as it is written, before others are merged into it. Raises yaml.MarkedYAMLError."""
        node: yaml.MappingNode = super().compose_mapping_node(anchor)
        lines: dict[tuple[str, str], int] = {}
        for key, _ in node.value:
            name = key.tag, str(key.value)
            if name in lines:
                problem = (
                    f'{key.value} is there twice, first in line {lines[name]}: expected it once, with all that belongs to it'
                )
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            lines[name] = key.start_mark.line + 1
        return node


class Loader(UniqueKeys):
    """YAML with the numbers of ROS: 3e9 and 3.0e9 are numbers (to YAML 1.1 texts), 1:30 and 2026-01-01 are texts."""


Loader.yaml_implicit_resolvers = {
    first: [(tag, form) for tag, form in resolvers if tag not in TAGS]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
Loader.add_implicit_resolver('tag:yaml.org,2002:int', INTEGER, list('-+0123456789'))
Loader.add_implicit_resolver('tag:yaml.org,2002:float', FLOAT, list('-+0123456789.'))
Loader.add_constructor('tag:yaml.org,2002:int', lambda loader, node: int(str(loader.construct_scalar(node))))  # type: ignore[arg-type]


def read_yaml(path: Path, node: str | None = None) -> dict[str, Any]:
    """What a parameter file says to a node of this full name, such as /left/sma_module_sim, by nested names; a plain mapping
    speaks to every node. Without a name, what it says to our nodes in the one namespace that it names.

    Raises ConfigError for a file that cannot be read, NothingForNode where it says nothing to the node.
    """
    content = load(path)
    sections = list(sections_of(content, path))
    if not sections:
        for key, value in content.items():
            if str(key).startswith('/') and isinstance(value, Mapping):
                below = ', '.join(map(str, value))
                raise ConfigError(f'{path}: {key} is the name of a node: expected {SECTION} below it, got {below}')
        return content
    for key, value in content.items():
        if not list(sections_of({key: value}, path)):
            raise ConfigError(f'{path}: {key} stands beside the names of nodes: expected it below one of them and {SECTION}')
    chosen = [(name, section) for name, section in sections if is_for(name, node)]
    if not chosen:
        wanted, there = node or f'/{MODULE}', ', '.join(name for name, _ in sections)
        raise NothingForNode(
            f'{path} has nothing for this node: expected {EVERY_NODE}: or {wanted}: above {SECTION}, got {there}'
        )
    spaces = {name.rpartition('/')[0] for name, _ in chosen} - {'', EVERY_NODE, '/*'}
    if node is None and len(spaces) > 1:
        raise ConfigError(
            f'{path} has parameters in several namespaces, {", ".join(sorted(spaces))}: expected a file for each of them'
        )
    merged: dict[str, Any] = {}
    for _, section in chosen:
        merged = merge(merged, section)
    return merged


def load(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file. Raises ConfigError."""
    try:
        content = yaml.load(path.read_text(encoding='utf-8'), Loader)  # noqa: S506  a SafeLoader
    except OSError as error:
        raise ConfigError(f'cannot read {path}: {error.strerror}') from error
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f'line {mark.line + 1}, column {mark.column + 1}: ' if mark else ''
        raise ConfigError(f'{path} is not YAML: {where}{error.problem or error.context}') from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ConfigError(f'{path} is not YAML: {" ".join(str(error).split())}') from error
    if not isinstance(content, dict):
        raise ConfigError(f'{path}: expected a mapping of parameters, got {type(content).__name__}')
    return content


def sections_of(tree: Mapping[Any, Any], path: Path, name: str = '') -> Iterator[tuple[str, Mapping[Any, Any]]]:
    """The mappings below ``ros__parameters`` with the full names of their nodes, which may be nested. Raises ConfigError."""
    for key, value in tree.items():
        if key == SECTION:
            if not isinstance(value, Mapping):
                raise ConfigError(f'{path}: expected a mapping below {SECTION}, got {type(value).__name__}')
            yield name or EVERY_NODE, value
        elif isinstance(value, Mapping):
            yield from sections_of(value, path, f'{name}/{str(key).strip("/")}')


def merge(tree: Mapping[Any, Any], over: Mapping[Any, Any]) -> dict[Any, Any]:
    """A mapping with another one over it, at every depth."""
    both = {
        key: merge(tree[key], value)
        for key, value in over.items()
        if isinstance(value, Mapping) and isinstance(tree.get(key), Mapping)
    }
    return {**tree, **over, **both}


def is_for(name: str, node: str | None) -> bool:
    """Whether the name of a section, in which * stands for a word and ** for any number of them, is that of a node."""
    if node is None:
        return name.rpartition('/')[2] in ('*', '**', *OF_OFFLINE)
    words = {'**': r'(/\w+)*', '*': r'/\w+'}
    return bool(re.fullmatch(''.join(words.get(word, '/' + re.escape(word)) for word in name.split('/')[1:]), node))


def flatten(tree: Mapping[Any, Any], prefix: str = '') -> dict[str, Any]:
    """Nested names joined with dots."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat |= flatten(value, f'{prefix}{key}.')
        else:
            flat[f'{prefix}{key}'] = value
    return flat


def belongs_to_ros(name: str) -> bool:
    """Whether a parameter is one of the node as such, which `ros2 param dump` writes too."""
    return name in SWITCHES or name.startswith(QOS_OVERRIDES)


def check_of_ros(name: str, value: Any, where: str) -> None:
    """Raise ConfigError for a wrong value of a parameter that belongs to ROS."""
    if name in SWITCHES:
        if not isinstance(value, bool):
            raise ConfigError(f'{name} = {value!r} ({where}): expected true or false')
    else:
        check_override(name, value, where)


def check_override(name: str, value: Any, where: str) -> None:
    """Raise ConfigError for a policy of quality of service that is none, or a value that it cannot have."""
    *_, entity, policy = ['', *name.rsplit('.', 2)]
    if policy not in POLICIES or entity not in ('publisher', 'subscription'):
        raise ConfigError(
            f'{name} ({where}): expected {QOS_OVERRIDES}TOPIC.publisher.POLICY or .subscription.POLICY, where '
            f'POLICY is one of {", ".join(POLICIES)}'
        )
    if policy == 'depth':
        if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= DEEPEST:
            raise ConfigError(f'{name} = {value!r} ({where}): expected a whole number of messages, 1 to {DEEPEST}')
    elif value not in QOS_CHOICES[policy]:
        raise ConfigError(f'{name} = {value!r} ({where}): expected {" or ".join(QOS_CHOICES[policy])}')
