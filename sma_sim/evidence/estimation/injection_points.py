"""The ports at which something unknown may act: a force, heat, a strain, a stress, power, or an offset of a sensor."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

from sma_sim.model.config import Config
from sma_sim.model.effects.conversion import pull_of
from sma_sim.model.effects.meaning import POSE
from sma_sim.model.structures.structure import Coordinate, Structure, numbers, record

STIFFNESS = -2  # `component` of the port that takes a part of K q
FORCE_UNITS = {'m': 'N', 'rad': 'N m'}
SPRING_PART, PULL_PART = 0.02, 0.01  # of what springs, else wires, exert: small but visible
USUAL_STRESS = 1e8  # [Pa] of a wire that transforms
SENSOR_PARTS = {'rad': 1.0 / 75.0}  # small but visible parts of a usual change: angles are measured best ...
SENSOR_PART = 0.1  # ... beside what else is measured
SENSOR_PROBES = {'F': 0.2, 'T': 1.0, 'stress': 1e6}  # SI


@dataclass(frozen=True)
class Port:
    """An injection point, at which an unknown function of time u(t) [`unit`] may be missing.

    `hook`: the port of the effects that acts there (`Effect.port`); `component`: the wire from 0, the coordinate of the
    structure (STIFFNESS: along K q, the springs' own force), or on sensing the place of the channel. `group`: its quantity,
    which it has in common with the same of other wires. `probe`: size of a small but visible u. `variable`, `column`: the
    coordinate on which a force most likely depends, or the channel that is sensed, and its column.
    """

    name: str
    unit: str
    hook: str
    component: int
    group: str
    probe: float
    description: str
    variable: str = ''
    column: str = ''


def ports_of(config: Config, channels: Collection[str]) -> tuple[Port, ...]:
    """The ports of a model; of the sensors those of the channels that were recorded.

    None where stress and temperature are imposed: time, over which an input is sought, says nothing there.
    """
    structure = config.structure
    if structure.is_quasi_static:
        return ()
    forces = () if structure.drives else force_ports(config)
    return *forces, *wire_ports(structure), *sensor_ports(structure, channels)


def force_ports(config: Config) -> tuple[Port, ...]:
    """A force on every coordinate, and for the planar beam one along K q."""
    structure = config.structure
    ports = [force_port(config, j) for j in range(len(structure.coordinates))]
    if structure.coordinate_names == POSE:
        last = structure.coordinates[-1]
        words = f"part of the {structure.title}'s stiffness"
        ports.append(Port('stiffness', '-', 'structure_force', STIFFNESS, 'stiffness', 0.02, words, last.name, last.column))
    return tuple(ports)


def force_port(config: Config, j: int) -> Port:
    """A generalised force on one coordinate."""
    structure = config.structure
    coordinate = structure.coordinates[j]
    turns = coordinate.unit == 'rad'
    name = f'{"moment" if turns else "force"}_{coordinate.name}'
    words = coordinate.force or f'{"moment about" if turns else "force along"} {coordinate.name}'
    law = next((other for other in structure.coordinates if other.name == coordinate.law), coordinate)
    unit = FORCE_UNITS.get(coordinate.unit, f'J/{coordinate.unit}')
    probe = coordinate.small_force or small_force(config, j)
    return Port(name, unit, 'structure_force', j, name, probe, words, law.name, law.column)


def small_force(config: Config, j: int) -> float:
    """A small but visible generalised force on a coordinate: a part of its spring's force, or of the wires' pull."""
    structure, values = config.structure, config.parameters
    constants, forces = structure.constants_of(values), structure.forces
    assert forces is not None
    pose = record('Pose', structure.coordinate_names)
    rest = pose(*(0.0 for _ in structure.coordinates))
    coordinate = structure.coordinates[j]
    moved = rest._replace(**{coordinate.name: coordinate.size(constants)})
    spring = abs(numbers(forces(moved, rest, constants))[j] - numbers(forces(rest, rest, constants))[j])
    if math.isfinite(spring) and spring > 0.0:
        return SPRING_PART * spring
    return PULL_PART * USUAL_STRESS * pull_of(structure, j, values)


def wire_ports(structure: Structure) -> tuple[Port, ...]:
    """What may act in every wire; heat and power where the temperature is not imposed."""
    quantities = [
        ('heat', 'W', 'wire_heat', 0.02, 'heat into one strand of'),
        ('strain', '-', 'wire_strain', 1e-4, 'strain, neither elastic nor of martensite, of'),
        ('stress', 'Pa', 'transformation_stress', 5e5, 'shift of both transformation stresses of'),
        ('power', '-', 'actuation', 0.02, 'share of the electrical heating of'),
    ]
    return tuple(
        Port(f'{group}_{i + 1}', unit, hook, i, group, probe, f'{words} wire {i + 1}')
        for group, unit, hook, probe, words in quantities
        for i in range(structure.wires)
        if structure.imposed_temperature < 0 or group not in ('heat', 'power')
    )


def sensor_ports(structure: Structure, channels: Collection[str]) -> tuple[Port, ...]:
    """An offset of what each of some channels shows; none of a resistance, which is that of leads and measured apart."""
    sensors = zip(structure.channels, structure.channel_columns, strict=True)
    coordinates = {coordinate.name: coordinate for coordinate in structure.coordinates}
    return tuple(
        Port(
            f'sense_{channel}',
            column[len(channel) + 1 :] or '-',
            'sensing',
            k,
            f'sense_{channel}',
            sensor_probe(channel, coordinates.get(channel), structure),
            f'offset of the shown {channel}',
            channel,
            column,
        )
        for k, (channel, column) in enumerate(sensors)
        if channel in channels and column not in structure.resistance_columns
    )


def sensor_probe(channel: str, coordinate: Coordinate | None, structure: Structure) -> float:
    """A small but visible offset of a channel."""
    if coordinate is None:
        return SENSOR_PROBES[channel.partition('_')[0]]
    return SENSOR_PARTS.get(coordinate.unit, SENSOR_PART) * coordinate.sensor_size(structure.default_constants)
