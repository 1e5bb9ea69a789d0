"""An effect as it is on a structure: scopes, title, and parameters in the units and of the size of its coordinates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.meaning import acting_coordinates, acts_on, channel_slots
from sma_sim.model.effects.ports import PORT_NAMES, SENSING
from sma_sim.model.parameters import Parameter, wire_constants
from sma_sim.model.structures.module import STRUCTURE as MODULE
from sma_sim.model.structures.structure import Structure, numbers, record

REFERENCE = 2  # the coordinate of the module for which the numbers of effects are declared: its rotation
SHOWN = {'rad': 2, 'm': 1}  # the channel of the module, for sensors
STEP = 1e-3  # of the differences of lengths, in usual changes of a coordinate
DIGITS = 2  # of converted numbers


def effect_on(effect: Effect, structure: Structure, values: Mapping[str, float] | None = None) -> Effect:
    """The effect as it is on a structure with parameters `values` (default: its own).

    Its parameters have the unit of the coordinate on which it acts first, and values of the same size in comparison with
    the pull of the wires there (forces) or with a usual change of the coordinate.
    """
    if effect.structure is structure or effect.scope.name:
        return effect
    if structure.name == MODULE.name:
        return effect
    general = effect.general_title if structure.title != MODULE.title else ''
    known = values if values is not None and structure.default_values.keys() <= values.keys() else structure.default_values
    moved = replace(
        effect, structure=structure, title=general or effect.title,
        confused_with=tuple(name for name in effect.confused_with if has_parameter(name, structure)),
    )  # fmt: skip
    if effect.port == PORT_NAMES[SENSING]:
        slots = zip(structure.channels, channel_slots(effect, structure), strict=True)
        moved = replace(moved, channels=tuple(channel for channel, slot in slots if slot >= 0))
    if not structure.coordinates or not acts_on(effect, structure):
        return moved
    if effect.by_channel:
        return replace(moved, parameters=parameters_of_channels(effect, structure, known))
    if effect.needs:
        at = acting_coordinates(effect.needs, structure)[0]
        return replace(moved, parameters=tuple(converted(p, structure, at, known) for p in effect.parameters))
    return moved


def has_parameter(name: str, structure: Structure) -> bool:
    """Whether a name is that of an effect, or of a parameter that a structure has."""
    return name in structure.declared or not name.startswith(('beam.', 'plate.'))


def converted(parameter: Parameter, structure: Structure, at: int, values: Mapping[str, float]) -> Parameter:
    """A parameter that is declared for the rotation of the module, for coordinate `at` of another structure."""
    unit = structure.coordinates[at].unit
    change = size_of(structure, at, values) / size_of(MODULE, REFERENCE, MODULE.default_values)
    if parameter.quantity == 'force':
        own, declared = pull_of(structure, at, values), pull_of(MODULE, REFERENCE, MODULE.default_values)
        return scaled(parameter, own / declared, parameter.unit if unit == 'rad' else parameter.unit.replace('N m', 'N'))
    factors = {'change': change, 'rate': change, '1/change^2': 1.0 / change**2}
    if parameter.quantity not in factors:
        return parameter
    return scaled(parameter, factors[parameter.quantity], parameter.unit.replace('rad', unit))


def parameters_of_channels(effect: Effect, structure: Structure, values: Mapping[str, float]) -> tuple[Parameter, ...]:
    """One parameter for each coordinate that is sensed, from those of the module in the same unit."""
    made = []
    slots = channel_slots(effect, structure)
    for coordinate, slot in zip(structure.coordinates, slots, strict=False):
        if slot < 0:
            continue
        k = SHOWN.get(coordinate.unit, 1)
        like = effect.parameters[k]
        shown = coordinate.sensor_size(structure.constants_of(values)) / MODULE.coordinates[k].sensor_size(
            MODULE.default_constants
        )
        here = replace(like, name=coordinate.name, description=like.description.replace(like.name, coordinate.name))
        made.append(here if like.unit == '-' else scaled(here, shown, coordinate.unit))
    return tuple(made)


def scaled(parameter: Parameter, factor: float, unit: str) -> Parameter:
    """A parameter in another unit, all its numbers times a factor and rounded."""
    default, low, high = (rounded(factor * number) for number in (parameter.default, *parameter.bounds))
    realistic = parameter.realistic and (rounded(factor * parameter.realistic[0]), rounded(factor * parameter.realistic[1]))
    return replace(parameter, default=default, unit=unit, bounds=(low, high), realistic=realistic)


def rounded(number: float) -> float:
    """A number to a few digits."""
    return float(f'{number:.{DIGITS}g}')


def size_of(structure: Structure, at: int, values: Mapping[str, float]) -> float:
    """A usual change of a coordinate."""
    return structure.coordinates[at].size(structure.constants_of(values))


def pull_of(structure: Structure, at: int, values: Mapping[str, float]) -> float:
    """Generalised force of the bundles on a coordinate over their stress: n section max |dl/dq| at q = 0 [N/Pa]."""
    constants, wire = structure.constants_of(values), wire_constants(values)
    pose, lengths = record('Pose', structure.coordinate_names), structure.lengths
    assert lengths is not None
    h = STEP * structure.coordinates[at].size(constants)
    moved = [pose(*(sign * h * (j == at) for j in range(len(structure.coordinates)))) for sign in (1.0, -1.0)]
    ends = [numbers(lengths(q, constants)) for q in moved]
    arm = max(abs(a - b) for a, b in zip(*ends, strict=True)) / (2.0 * h)
    return wire.n * wire.section * arm if math.isfinite(arm) and arm > 0.0 else wire.n * wire.section
