"""On which structures an effect has a meaning, in which of their coordinates, and on which of their channels."""

from __future__ import annotations

from sma_sim.model.effects.effect import Effect, kind_of
from sma_sim.model.effects.ports import PORT_NAMES, SENSING
from sma_sim.model.structures.structure import Structure

HEATING = ('actuation', 'wire_heat')  # ports without a meaning where the temperature is imposed
POSE = ('U_x', 'U_y', 'alpha')  # the coordinates of the state that most kernels take


def acts_on(effect: Effect, structure: Structure) -> bool:
    """Whether an effect has a meaning on a structure."""
    if effect.systems and not {structure.family, structure.original} & {*effect.systems}:
        return False
    if structure.wires < effect.wires:
        return False
    if structure.imposed_temperature >= 0 and effect.port in HEATING or effect.straight and structure.strain is not None:
        return False
    if 'stiffness' in effect.needs and not structure.stiffness or 'gravity' in effect.needs and not structure.gravity:
        return False
    if effect.needs and not acting_coordinates(effect.needs, structure):
        return False
    return (
        effect.port != PORT_NAMES[SENSING]
        or effect.clock is not None
        or any(slot >= 0 for slot in channel_slots(effect, structure))
    )


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


def moves_in_space(structure: Structure) -> bool:
    """Whether gravity along z moves a structure."""
    return any(structure.weight(0.0, 0.0, 1.0))


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
