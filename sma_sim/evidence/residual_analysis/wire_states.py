"""What a wire does at every sample, from the columns of the model: strain, rates, mode with a class for resting."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.config import Config
from sma_sim.model.parameters import beam_constants
from sma_sim.model.structures.beam import wire_length

Vector = NDArray[np.float64]
REST_DX = 1e-5  # |dx_M/dt| [1/s] below which a mode label says nothing (docs/explanation/physics.md) ...
REST_DT = 0.05  # ... if the temperature stands still too [K/s]
REST_DEPS = 1e-6  # ... and the strain [1/s]
RESTING = 0  # the number of the class beside modes 1 to 5


def wires_of(config: Config) -> dict[str, str]:
    """The wires by the suffix of their columns."""
    return {'_1': 'wire 1', '_2': 'wire 2'} if config.system == 'module' else {'': 'the wire'}


def with_derived_states(config: Config, time: Vector, columns: Mapping[str, Vector]) -> dict[str, Vector]:
    """The columns (k,), and for each wire (suffix s): ``strain{s}`` [-], ``dT{s}`` [K/s], ``deps{s}`` [1/s], and
    ``class{s}``: its mode, or RESTING where nothing of it moves."""  # fmt: skip
    found = dict(columns)
    if config.system == 'module':
        found |= module_strains(config, columns)
    for suffix in wires_of(config):
        dT, deps = rate_of_change(time, columns[f'T{suffix}_K']), rate_of_change(time, found[f'strain{suffix}'])
        dx = rate_of_change(time, columns[f'x_M{suffix}'])
        rests = (np.abs(dx) < REST_DX) & (np.abs(dT) < REST_DT) & (np.abs(deps) < REST_DEPS)
        mode = np.nan_to_num(columns[f'mode{suffix}'], nan=3.0)
        found |= {f'dT{suffix}': dT, f'deps{suffix}': deps, f'class{suffix}': np.where(rests, RESTING, mode)}
    return found


def module_strains(config: Config, columns: Mapping[str, Vector]) -> dict[str, Vector]:
    """Strains of the module's wires from the pose (EB-B2a), (k,) each."""
    beam, l0 = beam_constants(config.parameters), config.parameters['wire.l0']
    poses = np.column_stack([columns['U_x_m'], columns['U_y_m'], columns['alpha_rad']]).tolist()
    lengths = {f'_{i + 1}': [wire_length(x, y, a, 2.0 * i - 1.0, beam)[0] for x, y, a in poses] for i in range(2)}
    return {f'strain{suffix}': np.array(values) / l0 - 1.0 for suffix, values in lengths.items()}


def rate_of_change(time: Vector, values: Vector) -> Vector:
    """Rate of change (k,) by central differences."""
    if len(time) < 2:
        return np.zeros(len(time))
    found: Vector = np.gradient(values, time)
    return found
