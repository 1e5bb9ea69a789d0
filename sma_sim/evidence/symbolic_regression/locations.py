"""Where a term may act: a port of the effects with the wire, the direction or the channel there."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

from sma_sim.compiler.effect_kernels import coordinate_fields
from sma_sim.evidence.estimation.injection_points import STIFFNESS, Port, ports_of
from sma_sim.evidence.symbolic_regression import term_library
from sma_sim.evidence.symbolic_regression.terms import Term
from sma_sim.model.config import Config
from sma_sim.model.structures.structure import Structure
from sma_sim.solver.effect_table import channel_codes

EVERY_WIRE = -1  # `component` of a location that is no single port


@dataclass(frozen=True)
class Location(Port):
    """A port at which a term in `unit` acts, or the same port of every wire: `ports` are those that it moves.

    `component`: as of a port, but EVERY_WIRE for the same equation in each, and on sensing the number by which kernels know
    the channel. `symbol`: what an equation calls the quantity. `terms`: the candidates here.
    """

    ports: tuple[str, ...] = ()
    symbol: str = ''
    terms: tuple[Term, ...] = field(default=(), repr=False, compare=False)


CHAIN_STAGES = {'actuation': 'gain', 'sensing': 'bias'}
POWER_UNIT = 'W'  # of terms of the electrical power, whose port is a fraction of it
SYMBOLS = {'wire_heat': 'Q', 'wire_strain': 'e', 'transformation_stress': 's_A = s_M', 'actuation': 'P', 'sensing': 'shown'}
EVERY_WIRE_DESCRIPTIONS: Mapping[str, str] = {
    'heat': 'heat into each wire',
    'strain': 'strain of each wire',
    'stress': 'shift of both transformation stresses of each wire',
    'power': 'electrical heating of each wire',
}


def terms_at(port: Port, structure: Structure, config: Config) -> tuple[Term, ...]:
    """The candidate terms at a port."""
    name, rate = coordinate_fields(structure).get(port.variable, ('', ''))
    if port.hook == 'structure_force':
        if port.component == STIFFNESS:
            return term_library.stiffness_terms(structure.wires)
        coordinate = structure.coordinates[structure.coordinate_names.index(port.variable)]
        size = coordinate.size(structure.constants_of(config.parameters))
        guided = structure.coordinates[port.component].joint
        return term_library.coordinate_terms(name, rate, coordinate.unit, size, guided, structure.wires)
    if port.hook == 'sensing':
        return term_library.sensor_terms(rate)
    library = {
        'wire_heat': term_library.heat_terms,
        'actuation': term_library.power_terms,
        'wire_strain': term_library.strain_terms,
        'transformation_stress': term_library.strain_terms,
    }
    return library[port.hook]()


def symbol_of(port: Port, structure: Structure) -> str:
    """What an equation calls the quantity at a port: a force by its coordinate where there are several."""
    if port.hook != 'structure_force':
        return SYMBOLS[port.hook]
    if port.component == STIFFNESS:
        return 'F'
    coordinate = structure.coordinates[port.component]
    letter = 'M' if coordinate.unit == 'rad' else 'F'
    alone = sum(other.unit == coordinate.unit for other in structure.coordinates) == 1
    return letter if alone else f'{letter}_{coordinate.name.removeprefix("U_")}'


def location_of(port: Port, structure: Structure, config: Config) -> Location:
    """One port alone."""
    terms, at = terms_at(port, structure, config), dict(vars(port))
    if port.hook == 'actuation':
        at['unit'] = POWER_UNIT
    elif port.hook == 'sensing':
        at['component'] = channel_codes(structure)[port.component]
    return Location(**at, ports=(port.name,), symbol=symbol_of(port, structure), terms=terms)


def locations_for(config: Config, channels: Collection[str]) -> tuple[Location, ...]:
    """All locations of a model, of the sensors those of the `channels` that were measured."""
    structure, ports = config.structure, ports_of(config, channels)
    singles = [location_of(port, structure, config) for port in ports]
    together = []
    for group, description in EVERY_WIRE_DESCRIPTIONS.items():
        members = [location for location, port in zip(singles, ports, strict=True) if port.group == group]
        if len(members) > 1:
            names = tuple(member.name for member in members)
            every = replace(members[0], name=group, component=EVERY_WIRE, ports=names, description=description)
            together.append(every)
    return (*singles, *together)


@lru_cache(64)
def locations_of_hook(hook: str, on: Structure) -> tuple[Location, ...]:
    """All locations of a port of the effects, on a structure at its defaults."""
    config = Config(on.default_values, own_structure=on)
    return tuple(location for location in locations_for(config, on.channels) if location.hook == hook)
