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

LAST_POSE_CHANNEL = 2  # index of alpha among the channels
BOTH_WIRES = -1  # `component` of a location that is no single port


@dataclass(frozen=True)
class Location:
    """Where a term in `unit` acts through the effects' port `hook`; `ports` are those that it moves.

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
        """The candidate terms here."""
        terms = TERMS_BY_LOCATION[f'{self.hook}/{self.component}' if self.hook == 'structure_force' else self.hook]()
        # hysteresis of a sensor needs the rate of what it shows, which only the pose has
        without_rate = self.hook == 'sensing' and self.component > LAST_POSE_CHANNEL
        return tuple(term for term in terms if not (without_rate and term.rate))


TERMS_BY_LOCATION: Mapping[str, Callable[[], tuple[Term, ...]]] = MappingProxyType({
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
CHAIN_STAGES = {'actuation': 'gain', 'sensing': 'bias'}
POWER_UNIT, POWER_PROBE = 'W', 0.02  # of terms of the electrical power, whose port is a fraction of it
BOTH_WIRES_DESCRIPTIONS: Mapping[str, str] = MappingProxyType({
    'heat': 'heat into each wire', 'strain': 'strain of each wire',
    'stress': 'shift of both transformation stresses of each wire',
    'power': 'electrical heating of each wire',
})  # fmt: skip


def location_of(port: Port) -> Location:
    """One port alone."""
    unit, probe = (POWER_UNIT, POWER_PROBE) if port.hook == 'actuation' else (port.unit, port.probe)
    return Location(port.name, port.hook, port.component, unit, probe, (port.name,), port.description)


def locations_for(system: str, channels: tuple[str, ...]) -> tuple[Location, ...]:
    """All locations of a system, of the sensors those of the `channels` that were measured."""
    singles = [
        location_of(port) for port in PORTS
        if system in port.systems and (port.hook != 'sensing' or CHANNELS[port.component] in channels)
    ]  # fmt: skip
    if system != 'module':
        return tuple(singles)
    both = []
    for group, description in BOTH_WIRES_DESCRIPTIONS.items():
        members = [port for port in PORTS if port.group == group]
        names = tuple(port.name for port in members)
        both.append(replace(location_of(members[0]), name=group, component=BOTH_WIRES, ports=names, description=description))
    return (*singles, *both)


@cache
def locations_of_hook(hook: str) -> tuple[Location, ...]:
    """All locations of a port of the effects."""
    return tuple(location for location in locations_for('module', CHANNELS) if location.hook == hook)
