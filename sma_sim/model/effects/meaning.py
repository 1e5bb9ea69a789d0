"""On which structures an effect has a meaning, in which of their coordinates, and on which of their channels."""

from __future__ import annotations

from collections.abc import Iterable

from sma_sim.model.effects.effect import Effect, kind_of
from sma_sim.model.effects.ports import PORT_NAMES, SENSING
from sma_sim.model.structures.structure import Structure

FUNCTIONS = ('stiffness', 'gravity')  # of a structure, that kernels take
HEATING = ('actuation', 'wire_heat')  # ports without a meaning where the temperature is imposed
POSE = ('U_x', 'U_y', 'alpha')  # the coordinates of the state that most kernels take


def acts_on(effect: Effect, structure: Structure) -> bool:
    """Whether an effect has a meaning on a structure."""
    return not why_idle(effect, structure)


def why_idle(effect: Effect, structure: Structure) -> str:
    """Why an effect has no meaning on a structure; empty where it has one."""
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
    if lacking:
        return f'{name} declares no {lacking[0]}'
    is_of_channel = effect.port == PORT_NAMES[SENSING] and effect.clock is None
    acts = not is_of_channel or any(slot >= 0 for slot in channel_slots(effect, structure))
    acts = acts and (not effect.needs or bool(acting_coordinates(effect.needs, structure)))
    return '' if acts else f'{name} has nothing on which it could act'


def idle_effects(effects: Iterable[Effect], structure: Structure) -> tuple[str, ...]:
    """In words, which of some effects have no meaning on a structure, and why."""
    return tuple(f'effect {one.name} is left out: {why}' for one in effects if (why := why_idle(one, structure)))


def is_tried(effect: Effect, structure: Structure) -> bool:
    """Whether a diagnosis looks for an effect on a structure."""
    seen = {'everywhere': True, 'single wire': structure.wires == 1, 'timed': not structure.is_quasi_static, 'never': False}
    return seen[effect.tried] and acts_on(effect, structure)


def acting_coordinates(needs: tuple[str, ...], structure: Structure) -> tuple[int, ...]:
    """The coordinates in which an effect acts that `needs` something of a structure."""
    every = range(len(structure.coordinates))
    if 'spring' in needs:
        return tuple(j for j in structure.sprung if structure.coordinates[j].joint)
    return tuple(j for j in every if 'joint' not in needs or structure.coordinates[j].joint)


def channel_slots(effect: Effect, structure: Structure) -> list[int]:
    """The instance of a sensing effect on each channel of the structure, -1 where it does not act.

    An effect on every coordinate of the module acts on every coordinate of other structures too, one on both of its wires
    on all wires, one on wire 1 on the only wire.
    """
    slots, count = [], 0
    of_pose = set(POSE) <= set(effect.channels) and not effect.scope.channel
    for channel in structure.channels:
        named = channel in effect.channels or f'{channel}_1' in effect.channels
        named |= not effect.scope.channel and {f'{kind_of(channel)}_1', f'{kind_of(channel)}_2'} <= set(effect.channels)
        acts = effect.port == PORT_NAMES[SENSING] and (named or of_pose and channel in structure.coordinate_names)
        slots.append(count if acts else -1)
        count += acts
    return slots
