"""`sma-sim systems`: what structures there are."""

from __future__ import annotations

import argparse
import json
import textwrap
from pathlib import Path
from typing import Any

from sma_sim.cli.common.commands import add_command
from sma_sim.model.config import suggestion
from sma_sim.model.errors import UserError
from sma_sim.model.given import structure_folders_of
from sma_sim.model.structures.discovery import find_structures
from sma_sim.model.structures.structure import Structure

TEXT_WIDTH = 100


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'systems', 'list the structures that can be simulated, fitted and diagnosed')
    parser.add_argument('names', nargs='*', metavar='NAME', help='structures to show with their parameters (default: all)')
    parser.add_argument('--json', action='store_true', help='print JSON, for programs')
    parser.add_argument('--config', type=Path, metavar='FILE', help='YAML file that names folders of your own structures')
    parser.add_argument('--set', action='append', default=[], metavar='structures.paths=FOLDER', dest='words')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print all structures, or those that are named."""
    found = find_structures(structure_folders_of(arguments.config, arguments.words))
    for name in arguments.names:
        if name not in found:
            raise UserError(f'unknown system {name}{suggestion(name, found)}; known are {", ".join(sorted(found))}')
    structures = [found[name].structure for name in sorted(arguments.names or found)]
    if arguments.json:
        print(json.dumps([structure_data(structure) for structure in structures], indent=2))
    else:
        print('\n\n'.join(structure_text(structure) for structure in structures))
    return 0


def structure_data(structure: Structure) -> dict[str, Any]:
    """A structure as plain data."""
    defaults = structure.default_values
    return {
        'name': structure.name,
        'description': structure.description,
        'source': structure.source,
        'coordinates': [{'name': c.name, 'unit': c.unit, 'description': c.description} for c in structure.coordinates],
        'wires': structure.wires,
        'inputs': ['time_s', *structure.input_columns],
        'channels': list(structure.channel_columns),
        'parameters': [
            {'name': name, 'unit': p.unit, 'default': defaults[name], 'bounds': p.bounds, 'description': p.description}
            for name, p in structure.declared.items()
        ],
        'fitted': list(structure.fitted),
    }


def structure_text(structure: Structure) -> str:
    """A structure as text."""
    wires = f'{structure.wires} bundle{"s" if structure.wires > 1 else ""} of wires'
    lines = [f'{structure.name}  ({wires})']
    details = {
        'coordinates': '; '.join(f'{c.name} [{c.unit}] {c.description}' for c in structure.coordinates),
        'input': ', '.join(('time_s', *structure.input_columns)),
        'channels': ', '.join(structure.channel_columns),
        'a fit changes, beside the material': ', '.join(structure.fitted),
        'source': structure.source,
    }
    for words in (structure.description, *(f'{word}: {text}' for word, text in details.items() if text)):
        lines += textwrap.wrap(words, TEXT_WIDTH, initial_indent='    ', subsequent_indent='      ')
    defaults = structure.default_values
    for name, p in structure.declared.items():
        lines.append(f'    {name:<16} {defaults[name]:g} {p.unit}: {p.description}')
    return '\n'.join(lines)
