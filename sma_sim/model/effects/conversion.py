"""An effect as it is on a structure: scopes, title, and parameters in the units and of the size of its coordinates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from sma_sim.model.effects.effect import WIRE_CHANNELS, Effect, kind_of
from sma_sim.model.effects.meaning import acting_coordinates, acts_on, channel_slots
from sma_sim.model.effects.ports import PORT_NAMES, SENSING
from sma_sim.model.parameters import Parameter, wire_constants
from sma_sim.model.structures.module import STRUCTURE as MODULE
from sma_sim.model.structures.structure import NamedEffect, Structure, numbers, record

REFERENCE = 2  # the coordinate of the module for which the numbers of effects are declared: its rotation
SHOWN = {'rad': 'alpha'}  # the channel of the module whose numbers a sensor of a coordinate in this unit has
OTHERWISE = 'U_y'
STEP = 1e-3  # of the differences of lengths, in usual changes of a coordinate
DIGITS = 2  # of converted numbers
BESIDE = 3.0  # times what a structure has, to which a realistic range reaches at least
MODULE_WIRE = wire_constants(MODULE.default_values)


def effect_on(effect: Effect, structure: Structure, values: Mapping[str, float] | None = None) -> Effect:
    """The effect as it is on a structure with parameters `values` (default: its own).

    Its parameters have the unit of the coordinate on which it acts first, and values of the same size in comparison with
    the pull of the wires there (forces) or with a usual change of the coordinate.
    """
    if effect.scope.name:
        return effect
    if structure.name == MODULE.name:
        return with_parameters(effect, structure)
    if effect.structure is structure:
        return effect
    general = effect.general_title if structure.title != MODULE.title else ''
    single = effect.single_title if structure.wires == 1 else ''
    title, named = structure.named_effects.get(effect.name, NamedEffect('', {}))
    known = values if values is not None and structure.default_values.keys() <= values.keys() else structure.default_values
    moved = effect.derived(
        structure=structure,
        kernel=dict(effect.kernels).get(structure.original, effect.kernel),
        title=title or single or general or effect.title,
        same_as=' with '.join(named.values()) or effect.same_as,
        confused_with=tuple(name for name in effect.confused_with if has_parameter(name, structure)),
    )
    if effect.port == PORT_NAMES[SENSING]:
        slots = zip(structure.channels, channel_slots(effect, structure), strict=True)
        moved = moved.derived(channels=tuple(channel for channel, slot in slots if slot >= 0))
    if not acts_on(effect, structure):
        return moved
    if effect.by_channel:
        return moved.derived(parameters=parameters_of_channels(effect, structure, known))
    if not structure.coordinates:
        return moved
    parameters = (*effect.parameters, *more_parameters(effect, structure))
    if effect.needs:
        at = acting_coordinates(effect.needs, structure)[0]
        parameters = tuple(converted(p, structure, at, known) for p in parameters)
    parameters = tuple(realistic_beside(p, known[named[p.name]]) if p.name in named else p for p in parameters)
    return moved.derived(parameters=parameters)


def realistic_beside(parameter: Parameter, own: float) -> Parameter:
    """A parameter without a neutral value, whose realistic range reaches beyond what the structure has itself."""
    if parameter.neutral is not None or parameter.realistic is None:
        return parameter
    low, high = parameter.realistic
    return replace(parameter, realistic=(min(low, own / BESIDE), max(high, BESIDE * own)))


def with_parameters(effect: Effect, structure: Structure) -> Effect:
    """The effect with the parameters that it lacks of those that it has on a structure; itself where it lacks none."""
    known = {parameter.name for parameter in effect.parameters}
    more = tuple(parameter for parameter in more_parameters(effect, structure) if parameter.name not in known)
    return effect.derived(parameters=effect.parameters + more) if more else effect


def more_parameters(effect: Effect, structure: Structure) -> tuple[Parameter, ...]:
    """The parameters that an effect has beside those of the module, in space and of each of many bundles."""
    bundles = [
        replace(each.parameter, name=f'{each.parameter.name}_{number}', description=f'{each.parameter.description} {number}')
        for each in effect.each_bundle
        for number in each.numbers(structure.wires)
    ]
    moves_in_space = any(structure.weight(0.0, 0.0, 1.0))
    return (*(effect.in_space if moves_in_space else ()), *bundles)


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
    """One parameter for each channel that is sensed, from those of the module in the same unit; then those they share."""
    made: dict[str, Parameter] = {}
    constants, wire = structure.constants_of(values), wire_constants(values)
    slots = channel_slots(effect, structure)
    coordinates = {coordinate.name: coordinate for coordinate in structure.coordinates}
    for channel in (name for name, slot in zip(structure.channels, slots, strict=True) if slot >= 0):
        like, declared = like_of(effect, channel, structure), like_name(channel, structure)
        if like is None or like.name == kind_of(channel):
            made |= {like.name: like} if like else {}
            continue
        here = replace(like, name=channel, description=like.description.replace(like.name, channel))
        if channel not in coordinates:
            part = wire.n * wire.section / (MODULE_WIRE.n * MODULE_WIRE.section) if channel.startswith('F') else 1.0
            made[channel] = here if like.unit == '-' or part == 1.0 else scaled(here, part, like.unit)
            continue
        coordinate, of_module = coordinates[channel], MODULE.coordinates[MODULE.coordinate_names.index(declared)]
        shown = coordinate.sensor_size(constants) / of_module.sensor_size(MODULE.default_constants)
        unit = like.unit.replace(of_module.unit, coordinate.unit, 1).replace('-/', '1/')
        made[channel] = here if like.unit == '-' else scaled(here, shown, unit)
    return (*made.values(), *effect.shared_parameters)


def like_name(channel: str, structure: Structure) -> str:
    """The channel of the module whose parameter one of another structure has, where it has none of its own name."""
    units = {coordinate.name: coordinate.unit for coordinate in structure.coordinates}
    if channel in units:
        return SHOWN.get(units[channel], OTHERWISE)
    kind = kind_of(channel) or channel
    return f'{kind}_1' if kind in WIRE_CHANNELS else channel


def like_of(effect: Effect, channel: str, structure: Structure) -> Parameter | None:
    """The declared parameter of a channel on a structure."""
    return effect.of_channel(like_name(channel, structure))


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
    """Generalised force of the bundles on a coordinate over their stress: n Om max |deps/dq| at q = 0 [N/Pa]."""
    constants, wire = structure.constants_of(values), wire_constants(values)
    pose, lengths = record('Pose', structure.coordinate_names), structure.lengths
    assert lengths is not None
    h = STEP * structure.coordinates[at].size(constants)
    moved = [pose(*(sign * h * (j == at) for j in range(len(structure.coordinates)))) for sign in (1.0, -1.0)]
    ends = [structure.strains(numbers(lengths(q, constants)), values) for q in moved]
    arm = wire.l0 * max(abs(a - b) for (a, _), (b, _) in zip(*ends, strict=True)) / (2.0 * h)
    return wire.n * wire.section * arm if math.isfinite(arm) and arm > 0.0 else wire.n * wire.section
