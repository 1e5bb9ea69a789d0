"""What wires do along a run, from its columns: their strain, and the power that heats them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.config import Config
from sma_sim.model.structures.structure import numbers, record

Vector = NDArray[np.float64]


def strains_from_pose(config: Config, columns: Mapping[str, Vector]) -> dict[str, Vector]:
    """Strains of a structure's wires from its pose (of the module EB-B2a), (k,) each."""
    structure, l0 = config.structure.structure, config.parameters['wire.l0']
    assert structure.lengths is not None
    constants, pose = structure.constants_of(config.parameters), record('Pose', structure.coordinate_names)
    rows = np.column_stack([columns[coordinate.column] for coordinate in structure.coordinates]).tolist()
    lengths = np.array([numbers(structure.lengths(pose(*row), constants)) for row in rows])
    return {f'strain{suffix}': lengths[:, i] / l0 - 1.0 for i, suffix in enumerate(structure.wire_suffixes)}


def heating_of_wire(config: Config, columns: Mapping[str, Vector], wire: int) -> Vector:
    """Heating of one wire of a bundle [W] (samples,), as `model.system.commanded_heating` has it."""
    structure = config.structure.structure
    if not structure.coordinates:
        return columns['J_W']
    pair = structure.antagonistic
    J = columns[f'{structure.commands[wire // 2 if pair else wire]}_W']
    side: Vector = np.maximum(-J if pair and wire % 2 else J, 0.0)
    return side / config.parameters['wire.n']
