"""Options that every command has, and the progress that commands show."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from sma_sim.model.config import Config, read_config
from sma_sim.model.effects.meaning import idle_effects
from sma_sim.model.errors import PhysicsWarning
from sma_sim.model.given import effect_folders_of
from sma_sim.solver import first_start
from sma_sim.workflow.code_folders import folders_from


def add_config_options(parser: argparse.ArgumentParser) -> None:
    """``--config``, ``--set`` and ``--effect``."""
    parser.add_argument('--config', type=Path, metavar='FILE', help='YAML parameter file (default: the paper\'s values)')
    add_overriding_options(parser)


def add_overriding_options(parser: argparse.ArgumentParser) -> None:
    """``--set`` and ``--effect``."""
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        dest='words',
        help='set a parameter, such as wire.E_A=12e9',
    )
    parser.add_argument(
        '--effect',
        action='append',
        default=[],
        metavar='NAME[:PARAM=VALUE,...]',
        dest='effects',
        help='switch an effect on; `sma-sim effects` lists them and their scopes, as in natural_convection@wire_1',
    )


def add_namespace_option(parser: argparse.ArgumentParser) -> None:
    """``--namespace``."""
    parser.add_argument('--namespace', metavar='NAME', help="the module's namespace, where there are several")


def config_from(arguments: argparse.Namespace, *words: str) -> Config:
    """The configuration that the options ask for; `words` come last. Raises UserError."""
    return noted(read_config(arguments.config, [*arguments.words, *words], arguments.effects))


def noted(config: Config) -> Config:
    """The configuration itself; a line on stderr for every active effect that has no meaning in its system."""
    for words in idle_effects((active.effect for active in config.effects), config.structure):
        print(f'note: {words}', file=sys.stderr)
    warnings.filterwarnings('ignore', 'effect .* is left out', PhysicsWarning)  # what is called with it says so too
    return config


def folders_beside(arguments: argparse.Namespace, out: Path) -> list[str]:
    """The folders of the user's effects, as a parameter file at `out` names them."""
    return folders_from(out, effect_folders_of(arguments.config, arguments.words))


def announce_first_compilation(entries: Sequence[Callable[..., Any]] = first_start.SIMULATION) -> None:
    """Print why the first start takes long."""
    first_start.announce_compilation(lambda line: print(line, file=sys.stderr, flush=True), entries)
