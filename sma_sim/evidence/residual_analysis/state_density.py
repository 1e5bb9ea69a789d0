"""How residuals lie over the model's states: their density and their mean in steps of a state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.residual_analysis.compare import Comparison
from sma_sim.evidence.residual_analysis.error_by_stratum import ChannelSamples, samples_of
from sma_sim.evidence.residual_analysis.wire_states import wires_of
from sma_sim.model.arrays import Vector

STATE_STEPS, RESIDUAL_STEPS = 56, 40
MIN_SAMPLES = 5  # in a step of the state of which the mean is taken
INSIDE = 0.998  # quantile of |residual| that the residual's range holds, a little enlarged


@dataclass(frozen=True)
class StateDensity:
    """Residuals of a channel over noise, against one state, with a label for the state.

    `state` (n,), `residual` (m,): middles of the steps; `counts` (m, n) of samples; `mean_state`, `mean` (k,): where there
    are enough samples, the mean of the residual.
    """

    label: str
    state: Vector
    residual: Vector
    counts: Vector
    mean_state: Vector
    mean: Vector


def state_densities(comparison: Comparison) -> dict[str, tuple[StateDensity, ...]]:
    """By channel, the residual over every state that changes, all runs together."""
    states = changing_states(comparison)
    return {
        channel: tuple(state_density(samples, values, label) for label, values in states)
        for channel in comparison.channels
        for samples in (samples_of(comparison, channel),)
    }


def changing_states(comparison: Comparison) -> Sequence[tuple[str, Vector]]:
    """Labels and values of the states over all runs joined; those that do not change are left out."""
    columns: list[tuple[str, str, float, float]] = []
    for suffix, wire in wires_of(comparison.config).items():
        columns += [
            (f'temperature of {wire} [deg C]', f'T{suffix}_K', 1.0, -ZERO_CELSIUS),
            (f'strain of {wire} [%]', f'strain{suffix}', 100.0, 0.0),
            (f'x_M of {wire} [-]', f'x_M{suffix}', 1.0, 0.0),
        ]
    for name in comparison.config.structure.commands:
        columns.append(('power J [W]' if name == 'J' else f'{name} [W]', f'{name}_W', 1.0, 0.0))
    joined = [
        (label, factor * np.concatenate([run.states[name] for run in comparison.runs]) + offset)
        for label, name, factor, offset in columns
    ]
    return [(label, values) for label, values in joined if np.ptp(values) > 0.0]


def state_density(samples: ChannelSamples, values: Vector, label: str) -> StateDensity:
    """The residual of one channel over one state, `values` (n,) over all runs joined."""
    state, residual = values[samples.index], samples.scaled
    reach = max(3.0, 1.1 * float(np.quantile(np.abs(residual), INSIDE)))
    edges = np.linspace(state.min(), state.max(), STATE_STEPS + 1), np.linspace(-reach, reach, RESIDUAL_STEPS + 1)
    counts, _, _ = np.histogram2d(state, np.clip(residual, -reach, reach), bins=edges)
    middles, middle_residuals = (0.5 * (edge[1:] + edge[:-1]) for edge in edges)
    step = np.clip(np.searchsorted(edges[0], state, side='right') - 1, 0, STATE_STEPS - 1)
    samples_in_step = np.bincount(step, minlength=STATE_STEPS)
    enough = samples_in_step >= MIN_SAMPLES
    mean = np.bincount(step, residual, STATE_STEPS)[enough] / samples_in_step[enough]
    return StateDensity(label, middles, middle_residuals, counts.T, middles[enough], mean)
