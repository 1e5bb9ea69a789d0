"""Active effects that have no meaning in a system: they are left out, and a note says why."""

from __future__ import annotations

import sys

from sma_sim.compiler.kernel_text import FUNCTIONS
from sma_sim.model.config import Config
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.meaning import HEATING, acts_on
from sma_sim.model.structures.structure import Structure


def noted(config: Config) -> Config:
    """The configuration itself; a line on stderr for every active effect that has no meaning in its system."""
    structure = config.structure.structure
    for active in config.effects:
        effect = active.found.effect
        if not acts_on(effect, structure):
            print(f'note: effect {effect.name} is left out: {why_idle(effect, structure)}', file=sys.stderr)
    return config


def why_idle(effect: Effect, structure: Structure) -> str:
    """Why an effect has no meaning on a structure."""
    name = structure.family
    if effect.systems and not {name, structure.original} & {*effect.systems}:
        return f'it acts on {", ".join(effect.systems)}, not on {name}'
    if structure.wires < effect.wires:
        return f'it needs {effect.wires} wires, {name} has {structure.wires}'
    if structure.imposed_temperature >= 0 and effect.port in HEATING:
        return f'the temperature of the wires of {name} is imposed'
    if effect.straight and structure.strain is not None:
        return f'it acts on straight wires, those of {name} are twisted'
    lacking = [need for need in FUNCTIONS if need in effect.needs and getattr(structure, need) is None]
    return f'{name} declares no {lacking[0]}' if lacking else f'{name} has nothing on which it could act'
