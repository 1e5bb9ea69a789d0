"""`sma-sim add`: switch effects on in a parameter file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sma_sim.cli.common.commands import add_command
from sma_sim.cli.common.config_options import folders_beside
from sma_sim.evidence.data.tables import check_writable, write_whole
from sma_sim.model.config import read_config
from sma_sim.model.errors import UserError
from sma_sim.workflow.code_folders import parameter_file_at


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'add')
    parser.add_argument(
        'effects', nargs='+', metavar='EFFECT[:PARAM=VALUE,...]', help='effects to switch on; `sma-sim effects` lists them'
    )
    parser.add_argument('--config', type=Path, metavar='FILE', help='YAML parameter file (default: the paper\'s values)')
    parser.add_argument('-o', '--out', type=Path, required=True, metavar='FILE.yaml', help='parameter file to write')
    parser.set_defaults(run=run, words=[])


def run(arguments: argparse.Namespace) -> int:
    """Write the file with the effects; those that were on already stay on."""
    check_writable(arguments.out)
    if arguments.out.suffix not in ('.yaml', '.yml'):
        raise UserError(f'{arguments.out}: expected a name that ends in .yaml')
    config = read_config(arguments.config, (), arguments.effects)
    text = parameter_file_at(arguments.out, config, folders_beside(arguments, arguments.out))
    write_whole(arguments.out, lambda file: file.write(text))
    names = ', '.join(active.effect.name for active in config.effects)
    print(f'Wrote {arguments.out}; active effects: {names}.')
    return 0
