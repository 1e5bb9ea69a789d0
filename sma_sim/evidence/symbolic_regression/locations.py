"""Where a term may act: a port of the effects with the wire, the direction or the channel there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType

from sma_sim.evidence.estimation.injection_points import PORTS, Port
from sma_sim.evidence.symbolic_regression import term_library
from sma_sim.evidence.symbolic_regression.terms import Term
from sma_sim.model.effects.ports import CHANNELS

LAST_OF_POSE = 2  # among the channels
BOTH_WIRES = -1  # `component` of a place that is no single port


@dataclass(frozen=True)
class Place:
    """A place `name` where a term in `unit` acts through the effects' port `hook`; `ports` are those that it moves.

    `component`: the wire (BOTH_WIRES: the same equation in both), the coordinate of the pose (STIFFNESS: along K q), or the
    channel. `probe`: a small but visible size.
    """

    name: str
    hook: str
    component: int
    unit: str
    probe: float
    ports: tuple[str, ...]
    description: str

    @property
    def terms(self) -> tuple[Term, ...]:
        """The terms to try here."""
        found = TERMS[f'{self.hook}/{self.component}' if self.hook == 'structure_force' else self.hook]()
        still = self.hook == 'sensing' and self.component > LAST_OF_POSE  # play needs the rate of what is shown
        return tuple(term for term in found if not (still and term.rate))


TERMS: Mapping[str, Callable[[], tuple[Term, ...]]] = MappingProxyType({
    'structure_force/0': term_library.force_terms,
    'structure_force/1': term_library.force_terms,
    'structure_force/2': term_library.moment_terms,
    'structure_force/3': term_library.stiffness_terms,
    'wire_heat': term_library.heat_terms,
    'actuation': term_library.power_terms,
    'wire_strain': term_library.strain_terms,
    'transformation_stress': term_library.strain_terms,
    'sensing': term_library.sensor_terms,
})  # fmt: skip
STAGES = {'actuation': 'gain', 'sensing': 'bias'}
HEATING = ('W', 0.02)  # unit and probe of terms of the electrical power, whose port is a part of it
EVERY_WIRE: Mapping[str, str] = MappingProxyType({
    'heat': 'heat into each wire', 'strain': 'strain of each wire',
    'stress': 'shift of both transformation stresses of each wire',
    'power': 'electrical heating of each wire',
})  # fmt: skip


def place_of(port: Port) -> Place:
    """One port alone."""
    unit, probe = HEATING if port.hook == 'actuation' else (port.unit, port.probe)
    return Place(port.name, port.hook, port.component, unit, probe, (port.name,), port.description)


def places_for(system: str, channels: tuple[str, ...]) -> tuple[Place, ...]:
    """All places of a system, of the sensors those of the `channels` that were measured."""
    alone = [
        place_of(port) for port in PORTS
        if system in port.systems and (port.hook != 'sensing' or CHANNELS[port.component] in channels)
    ]  # fmt: skip
    if system == 'wire':
        return tuple(alone)
    both = []
    for group, words in EVERY_WIRE.items():
        members = [port for port in PORTS if port.group == group]
        names = tuple(port.name for port in members)
        both.append(replace(place_of(members[0]), name=group, component=BOTH_WIRES, ports=names, description=words))
    return (*alone, *both)


@cache
def places_of(hook: str) -> tuple[Place, ...]:
    """All places of a port of the effects."""
    return tuple(place for place in places_for('module', CHANNELS) if place.hook == hook)
