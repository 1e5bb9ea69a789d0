"""Options that every command has, and the progress that commands show."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from sma_sim.cli.common.idle_effects import noted
from sma_sim.model.config import Config, read_config
from sma_sim.model.given import effect_folders_of
from sma_sim.solver import first_start
from sma_sim.workflow.code_folders import folders_from

QUIET_TIME = 2.0  # [s] before progress is shown


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
        '--effect', action='append', default=[], metavar='NAME[:PARAM=VALUE,...]', dest='effects',
        help='switch an effect on; `sma-sim effects` lists them and their scopes, as in natural_convection@wire_1',
    )  # fmt: skip


def add_namespace_option(parser: argparse.ArgumentParser) -> None:
    """``--namespace``."""
    parser.add_argument('--namespace', metavar='NAME', help="the module's namespace, where there are several")


def config_from(arguments: argparse.Namespace, *words: str) -> Config:
    """The configuration that the options ask for; `words` come last. Raises UserError."""
    return noted(read_config(arguments.config, [*arguments.words, *words], arguments.effects))


def folders_beside(arguments: argparse.Namespace, out: Path) -> list[str]:
    """The folders of the user's effects, as a parameter file at `out` names them."""
    return folders_from(out, effect_folders_of(arguments.config, arguments.words))


def announce_first_compilation(entries: Sequence[Callable[..., Any]] = first_start.SIMULATION) -> None:
    """Print why the first start takes long."""
    first_start.announce_compilation(lambda line: print(line, file=sys.stderr, flush=True), entries)


class ProgressLine:
    """A line on stderr that shows how much is done, once the work takes longer than a moment."""

    def __init__(self, what: str) -> None:
        self._what, self._start, self._shown = what, time.monotonic(), False

    def __call__(self, part: float) -> None:
        """Show that `part` (0 to 1) is done."""
        self.show(f'{100.0 * part:3.0f} %')

    def show(self, state: str) -> None:
        """Show how far the work is, in words."""
        passed = time.monotonic() - self._start
        if passed > QUIET_TIME and sys.stderr.isatty():
            text = f'{self._what}: {state} after {passed:.0f} s'
            print(f'\r{text:<79}', end='', file=sys.stderr, flush=True)
            self._shown = True

    def close(self) -> None:
        """End the line."""
        if self._shown:
            print(file=sys.stderr)
