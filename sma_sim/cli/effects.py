"""`sma-sim effects`: what physical effects there are."""

from __future__ import annotations

import argparse
import textwrap
from typing import Any

from sma_sim.cli.common.listing import TEXT_WIDTH, Listed, add_listing, chosen_names, print_list
from sma_sim.cli.systems import SYSTEMS
from sma_sim.model.effects.discovery import effects_on, find_effects, with_scopes
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.meaning import acts_on
from sma_sim.model.given import effect_folders_of, structure_folders_of
from sma_sim.model.structures.discovery import find_structures, known_structures
from sma_sim.model.structures.structure import Structure

EFFECTS = Listed('effect', 'effects', 'effects.paths')
TRIED_WORDS = {
    'single wire': 'on structures with one wire',
    'timed': 'but in quasi-static tests, whose time says nothing',
    'never': 'never: switched on, it is part of the model',
}
PARAMETER_FIELDS = ('name', 'unit', 'default', 'bounds', 'neutral', 'realistic', 'description')
LIST_FIELDS = ('confused_with', 'same_as', 'states')


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_listing(verbs, 'effects', EFFECTS)
    parser.add_argument(
        '--system', metavar='NAME', help='only those that act on this structure, with parameters in its units'
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print all effects, or those that are named."""
    found = find_effects(effect_folders_of(arguments.config, arguments.words))
    if arguments.system:
        structure = named_structure(arguments)
        found = effects_on(found, arguments.names, structure)
        arguments.names = arguments.names or [name for name, effect in found.items() if acts_on(effect, structure)]
    else:
        found = with_scopes(found, arguments.names)
    effects = [found[name] for name in chosen_names(arguments.names, found, EFFECTS)]
    print_list(effects, arguments.json, effect_data, effect_text)
    return 0


def named_structure(arguments: argparse.Namespace) -> Structure:
    """The structure that ``--system`` names. Raises UserError."""
    found = find_structures(structure_folders_of(arguments.config, arguments.words))
    (name,) = chosen_names([arguments.system], found, SYSTEMS)
    return found[name]


def effect_data(effect: Effect) -> dict[str, Any]:
    """An effect as plain data."""
    parameters = [{name: getattr(p, name) for name in PARAMETER_FIELDS} for p in effect.parameters]
    words = ('name', 'title', 'port', 'equation', 'source', 'description', 'energy', 'signature')
    plain = {name: getattr(effect, name) for name in (*words, *LIST_FIELDS)} | {'systems': systems_of(effect)}
    return plain | {'parameters': parameters, 'scopes': scope_names(effect)}


def systems_of(effect: Effect) -> list[str]:
    """The structures on which an effect has a meaning."""
    return [name for name, structure in known_structures().items() if acts_on(effect, structure)]


def scope_names(effect: Effect) -> list[str]:
    """The scopes of an effect at its port; whether the states of a user's effect can be shared shows when it runs."""
    return [] if effect.scope.name else [scope.name for scope in effect.scopes]


def effect_text(effect: Effect) -> str:
    """An effect as text."""
    lines = [f'{effect.name}  ({effect.port})', f'    {effect.equation}']
    details = {
        'acts on': ', '.join(systems_of(effect)),
        'looked for by a diagnosis': TRIED_WORDS.get(effect.tried, ''),
        'signature': effect.signature,
        'confused with': ', '.join(effect.confused_with),
        'the same as': effect.same_as,
        'source': effect.source,
        'energy': effect.energy,
        'also in part of its places, as NAME@SCOPE': ', '.join(scope_names(effect)),
    }
    for words in (effect.title, effect.description, *(f'{word}: {text}' for word, text in details.items() if text)):
        lines += textwrap.wrap(words, TEXT_WIDTH, initial_indent='    ', subsequent_indent='      ')
    for p in effect.parameters:
        low, high = p.bounds
        numbers = f'{p.default:g} {p.unit}, allowed {low:g} to {high:g}'
        if p.realistic:
            numbers += f', realistic {p.realistic[0]:g} to {p.realistic[1]:g}'
        if p.neutral is not None:
            numbers += f', no effect at {p.neutral:g}'
        lines.append(f'    {p.name:<8} {p.description}')
        lines.append(f'             {numbers}')
    return '\n'.join(lines)
