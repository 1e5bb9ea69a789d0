"""A configuration made ready for the compiled flow."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from sma_sim.compiler.fields_read import uses_time
from sma_sim.compiler.structure_kernels import MAX_EFFECTS, native_structure, new_effects
from sma_sim.model.argument_checks import expect
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.effects.ports import STRUCTURE_FORCE, EffectTable
from sma_sim.model.errors import UserError
from sma_sim.model.layout import O_DL, StructureTable, System
from sma_sim.model.parameters import WireConstants, wire_constants
from sma_sim.model.renamed import renamed
from sma_sim.model.structures.structure import Constants, Structure, numbers, record
from sma_sim.solver.effect_table import effect_table


@renamed()
@dataclass(frozen=True)
class Model:
    """A configuration, ready to run: what it needs is compiled, or loaded, when it is first used.

    Attributes
    ----------
    config : Config
        Parameters, system, kinetics and active effects; default: the paper's module.

    Raises
    ------
    UserError
        For what is no configuration.
    """

    config: Config = field(default_factory=Config)

    def __post_init__(self) -> None:
        expect('config', self.config, Config)

    def __reduce__(self) -> tuple[Any, ...]:
        return Model, (self.config,)

    def __deepcopy__(self, memo: Any) -> Model:
        return self  # nothing of it changes

    @cached_property
    def structure(self) -> Structure:
        """What the wires pull on."""
        return self.config.structure

    @property
    def wires(self) -> int:
        """Number of wires (bundles, in the module)."""
        return self.structure.wires

    @property
    def uses_time(self) -> bool:
        """Whether the flow depends on time other than through the input."""
        acting = (active.effect for active in self.config.effects if not active.effect.only_shows)
        return any(uses_time(effect) for effect in acting)

    @cached_property
    def constants(self) -> Constants:
        """The structure's constants, by name."""
        return self.structure.constants_of(self.config.parameters)

    @cached_property
    def wire(self) -> WireConstants:
        """The wire's constants, by name."""
        return wire_constants(self.config.parameters)

    @cached_property
    def effects(self) -> tuple[EffectTable, tuple[float, ...]]:
        """The table of the active effects, and the scales of their extra states."""
        config, before = self.config, 2 * len(self.structure.coordinates) + self.wires
        first_state = before + (self.wires if config.simulated_kinetics == 'mas' else 0)
        return effect_table(config.effects, self.structure, first_state, self.wire, self.constants)

    @cached_property
    def compiled(self) -> System:
        """What the compiled flow reads."""
        config, structure = self.config, self.structure
        n, mas = len(structure.coordinates), config.simulated_kinetics == 'mas'
        first_T, wire, (table, _) = 2 * n, self.wire, self.effects
        acting = table.port_start[STRUCTURE_FORCE + 1] - table.port_start[STRUCTURE_FORCE]
        if acting > MAX_EFFECTS:
            raise UserError(f'{acting} effects act on the {structure.title}: expected at most {MAX_EFFECTS}')
        scales = [coordinate.size(self.constants) for coordinate in structure.coordinates]
        numbers_read = [*self.constants, *scales, *inertia_of(structure, self.constants), wire.l0]
        at = StructureTable(
            *native_structure(structure).addresses, np.array(numbers_read, dtype=float), new_effects(structure)
        )
        return System(
            n,
            structure.segments,
            self.wires,
            len(structure.drives),
            structure.antagonistic,
            mas,
            first_T,
            first_T + self.wires,
            len(structure.channels),
            wire,
            structure.strain is not None,
            at,
            table,
            structure.imposed_temperature,
        )

    @cached_property
    def scales(self) -> Vector:
        """The size of every state, for the error control and the difference steps; its length is the state's."""
        pose = [coordinate.size(self.constants) for coordinate in self.structure.coordinates]
        wires = [30.0] * self.wires + [0.1] * (self.wires if self.config.simulated_kinetics == 'mas' else 0)
        _, extra = self.effects
        return np.array([*pose, *rate_scales(self.structure, self.constants), *wires, *extra])


def inertia_of(structure: Structure, constants: Constants) -> tuple[float, ...]:
    """The inertia of every coordinate, 1 where accelerations are a kernel of their own. Raises UserError."""
    if structure.inertia is None:
        return (1.0,) * len(structure.coordinates)
    inertia = numbers(structure.inertia(constants))
    if len(inertia) != len(structure.coordinates):
        raise UserError(
            f'structure {structure.name!r}: its inertia returns {len(inertia)} number(s); expected one for each of '
            f'{", ".join(structure.coordinate_names)}'
        )
    for coordinate, value in zip(structure.coordinates, inertia, strict=True):
        if not 0.0 < value < math.inf:
            unit = 'kg m^2' if coordinate.unit == 'rad' else 'kg'
            raise UserError(
                f'structure {structure.name!r}: its inertia in {coordinate.name} is {value:g} {unit}; expected more than 0'
            )
    return inertia


def rate_scales(structure: Structure, constants: Constants) -> list[float]:
    """Usual changes of the rates: declared, or those of undamped vibrations, or of a motion within a second."""
    scales = []
    pose = record('Pose', structure.coordinate_names)
    rest = pose(*(0.0 for _ in structure.coordinates))
    names = [drive.name for drive in structure.loads]
    loads = (record('Drives', names)(*(0.0 for _ in names)),) if names else ()
    for j, (coordinate, inertia) in enumerate(zip(structure.coordinates, inertia_of(structure, constants), strict=True)):
        scale = coordinate.size(constants)
        if coordinate.rate_scale is not None:
            scales.append(coordinate.rate_scale(constants))
            continue
        assert structure.forces is not None
        moved = rest._replace(**{coordinate.name: scale})
        ends = [numbers(structure.forces(q, rest, constants, *loads))[j] for q in (rest, moved)]
        scales.append(scale * max(1.0, math.sqrt(abs(ends[0] - ends[1]) / scale / inertia)))
    return scales


def new_findings(p: System) -> Any:
    """Room for what the flow finds on its way, (wires, O_DL + coordinates of one segment)."""
    return np.zeros((p.wires, O_DL + p.coordinates // p.segments))
