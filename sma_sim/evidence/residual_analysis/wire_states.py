"""What a wire does at every sample, from the columns of the model: strain, rates, mode with a class for resting."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.solver.wire_columns import strains_from_pose

REST_DX = 1e-5  # |dx_M/dt| [1/s] below which a mode label says nothing (docs/explanation/physics.md) ...
REST_DT = 0.05  # ... if the temperature stands still too [K/s]
REST_DEPS = 1e-6  # ... and the strain [1/s]
RESTING = 0  # the number of the class beside modes 1 to 5


def wires_of(config: Config) -> dict[str, str]:
    """The wires by the suffix of their columns."""
    suffixes = config.structure.wire_suffixes
    return {suffix: f'wire {suffix[1:]}' if suffix else 'the wire' for suffix in suffixes}


def with_derived_states(
    config: Config, run_config: Config, time: Vector, columns: Mapping[str, Vector]
) -> dict[str, Vector]:
    """The columns (k,), and for each wire (suffix s): ``strain{s}`` [-], ``dT{s}`` [K/s], ``deps{s}`` [1/s], and
    ``class{s}``: its mode, or RESTING where nothing of it moves. `run_config` is on the bench of the run."""
    found = dict(columns)
    if run_config.structure.coordinates:
        found |= strains_from_pose(run_config, columns)
    for suffix in wires_of(config):
        dT, deps = rate_of_change(time, found[f'T{suffix}_K']), rate_of_change(time, found[f'strain{suffix}'])
        dx = rate_of_change(time, found[f'x_M{suffix}'])
        rests = (np.abs(dx) < REST_DX) & (np.abs(dT) < REST_DT) & (np.abs(deps) < REST_DEPS)
        mode = np.nan_to_num(found[f'mode{suffix}'], nan=3.0)
        found |= {f'dT{suffix}': dT, f'deps{suffix}': deps, f'class{suffix}': np.where(rests, RESTING, mode)}
    return found


def rate_of_change(time: Vector, values: Vector) -> Vector:
    """Rate of change (k,) by central differences."""
    if len(time) < 2:
        return np.zeros(len(time))
    return np.gradient(values, time)
