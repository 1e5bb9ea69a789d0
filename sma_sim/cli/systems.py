"""`sma-sim systems`: what structures there are."""

from __future__ import annotations

import argparse
import textwrap
from typing import Any

from sma_sim.cli.common.listing import TEXT_WIDTH, Listed, add_listing, chosen_names, print_list
from sma_sim.model.given import structure_folders_of
from sma_sim.model.structures.discovery import find_structures
from sma_sim.model.structures.structure import Structure

SYSTEMS = Listed('system', 'structures', 'structures.paths')


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_listing(verbs, 'systems', SYSTEMS)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print all structures, or those that are named."""
    found = find_structures(structure_folders_of(arguments.config, arguments.words))
    every = [name for name, each in found.items() if each.has_own_columns]
    structures = [found[name] for name in chosen_names(arguments.names or every, found, SYSTEMS)]
    print_list(structures, arguments.json, structure_data, structure_text)
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
        'topics': topics_of(structure),
        'parameters': [
            {'name': name, 'unit': p.unit, 'default': defaults[name], 'bounds': p.bounds, 'description': p.description}
            for name, p in structure.declared.items()
        ],
        'fitted': list(structure.fitted),
    }


def topics_of(structure: Structure) -> dict[str, str]:
    """Message types of the node's topics that recordings are read from, by name; those of commands first."""
    from sma_sim.evidence.data.rosbag.interface import (  # not to list effects
        command_decoders,
        interface_of,
        measured_decoders,
    )

    interface = interface_of(structure)
    decoders = {**command_decoders(interface), **measured_decoders(interface)}
    return {topic: kind for topic, (kind, _) in decoders.items()}


def structure_text(structure: Structure) -> str:
    """A structure as text."""
    wires = f'{structure.wires} bundle{"s" if structure.wires > 1 else ""} of wires'
    lines = [f'{structure.name}  ({wires})']
    details = {
        'coordinates': '; '.join(f'{c.name} [{c.unit}] {c.description}' for c in structure.coordinates),
        'input': ', '.join(('time_s', *structure.input_columns)),
        'channels': ', '.join(structure.channel_columns),
        'topics': ', '.join(topics_of(structure)),
        'a fit changes, beside the material': ', '.join(structure.fitted),
        'source': structure.source,
    }
    for words in (structure.description, *(f'{word}: {text}' for word, text in details.items() if text)):
        lines += textwrap.wrap(words, TEXT_WIDTH, initial_indent='    ', subsequent_indent='      ')
    defaults = structure.default_values
    for name, p in structure.declared.items():
        lines.append(f'    {name:<16} {defaults[name]:g} {p.unit}: {p.description}')
    return '\n'.join(lines)
