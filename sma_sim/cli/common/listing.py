"""What the commands that list effects or structures share."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from sma_sim.cli.common.commands import add_command
from sma_sim.model.config import suggestion
from sma_sim.model.errors import UserError

Item = TypeVar('Item')
TEXT_WIDTH = 100


class Listed(NamedTuple):
    """What is listed, in the singular and the plural, and the parameter that names folders of the user's own."""

    one: str
    many: str
    folders: str


def add_listing(verbs: Any, verb: str, listed: Listed) -> argparse.ArgumentParser:
    """Declare a verb that lists."""
    parser = add_command(verbs, verb)
    parser.add_argument('names', nargs='*', metavar='NAME', help=f'{listed.many} to show in detail (default: a list of all)')
    parser.add_argument('--json', action='store_true', help='print JSON, for programs')
    parser.add_argument(
        '--config', type=Path, metavar='FILE', help=f'YAML file that names the folders of your own {listed.many}'
    )
    parser.add_argument('--set', action='append', default=[], metavar=f'{listed.folders}=FOLDER', dest='words')
    return parser


def chosen_names(names: Sequence[str], found: Mapping[str, object], listed: Listed) -> list[str]:
    """The names that were asked for, or all. Raises UserError."""
    for name in names:
        if name not in found:
            raise UserError(f'unknown {listed.one} {name}{suggestion(name, found)}; known are {", ".join(sorted(found))}')
    return sorted(names or found)


def print_list(items: Sequence[Item], as_json: bool, data: Callable[[Item], Any], text: Callable[[Item], str]) -> None:
    """Print items as text or as JSON."""
    print(json.dumps([data(item) for item in items], indent=2) if as_json else '\n\n'.join(map(text, items)))
