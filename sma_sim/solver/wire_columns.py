"""What wires do along a run, from its columns: their strain and stress, and the power that heats them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.parameters import wire_constants
from sma_sim.model.structures.structure import numbers, record


def strains_from_pose(config: Config, columns: Mapping[str, Vector]) -> dict[str, Vector]:
    """Strains of a structure's wires from its pose (of the module EB-B2a), (k,) each."""
    strains = strains_and_ratios(config, columns)[:, :, 0]
    return {f'strain{suffix}': strains[:, i] for i, suffix in enumerate(config.structure.wire_suffixes)}


def stresses_from_forces(config: Config, columns: Mapping[str, Vector]) -> dict[str, Vector]:
    """Stresses [Pa] of a structure's wires, (k,) each, from the forces of their bundles, of coils from the pose too."""
    structure, w = config.structure, wire_constants(config.parameters)
    forces = {suffix: columns[f'F{suffix}_N'] / (w.n * w.section) for suffix in structure.wire_suffixes}
    if structure.strain is not None:
        ratios = strains_and_ratios(config, columns)[:, :, 1]
        forces = {suffix: force / ratios[:, i] for i, (suffix, force) in enumerate(forces.items())}
    return {f'stress{suffix}': stress for suffix, stress in forces.items()}


def strains_and_ratios(config: Config, columns: Mapping[str, Vector]) -> NDArray[np.float64]:
    """Strain of every wire and l0 times its derivative in the wire's length, (k, wires, 2)."""
    structure = config.structure
    assert structure.lengths is not None
    constants, pose = structure.constants_of(config.parameters), record('Pose', structure.coordinate_names)
    rows = np.column_stack([columns[coordinate.column] for coordinate in structure.coordinates]).tolist()
    lengths = np.array([numbers(structure.lengths(pose(*row), constants)) for row in rows])
    if structure.strain is None:
        return np.stack([lengths / config.parameters['wire.l0'] - 1.0, np.ones_like(lengths)], axis=2)
    found = structure.strains(lengths.ravel().tolist(), config.parameters)
    return np.array(found).reshape(*lengths.shape, 2)


def heating_of_wire(config: Config, columns: Mapping[str, Vector], wire: int) -> Vector:
    """Heating of one wire of a bundle [W] (samples,), as `model.system.commanded_heating` has it."""
    structure = config.structure
    if not structure.coordinates:
        return columns['J_W']
    pair = structure.antagonistic
    J = columns[f'{structure.commands[wire // 2 if pair else wire]}_W']
    side: Vector = np.maximum(-J if pair and wire % 2 else J, 0.0)
    return side / config.parameters['wire.n']
