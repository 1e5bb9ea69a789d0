"""Commands as a controller gives them: a PI controller on the first coordinate, at 50 Hz, with a noisy sensor."""

from __future__ import annotations

import numpy as np

from sma_sim import Input
from sma_sim.solver.fixed_rate import FixedRateRun

RATE, CONTROL_RATE, T_E = 200, 50, 298.0
NOISE = 2e-3  # of the scale of the coordinate


def closed_loop(model, duration, seed, per_scale=15.0, most=15.0):
    """The input that a controller gives whose proportional gain is `per_scale` [W] per scale of the coordinate."""
    random, structure = np.random.default_rng(seed), model.structure
    channel, scale = structure.channels[0], structure.coordinates[0].size(model.constants)
    if 'alpha' in structure.channels:
        channel, scale = 'alpha', 0.15
    bundles = len(structure.input_columns) - 1
    run = FixedRateRun(model, RATE, np.array([0.0] * bundles + [T_E]))
    count, integral = int(duration * CONTROL_RATE), 0.0
    rows = np.full((count + 1, bundles + 1), T_E)
    for k in range(count):
        error = 0.3 * np.sin(2.0 * np.pi * k / CONTROL_RATE / 12.0) - run.shown(channel) / scale
        error += NOISE * random.standard_normal()
        integral = float(np.clip(integral + 0.5 * error / CONTROL_RATE, -1.0, 1.0))
        power = float(np.clip(per_scale * (error + integral), -most, most))
        signs = [1.0] if structure.antagonistic else [(-1.0) ** i for i in range(bundles)]
        rows[k, :bundles] = power * np.array(signs)
        if not structure.antagonistic:
            rows[k, :bundles] = np.maximum(rows[k, :bundles], 0.0)
        run.step(rows[k], RATE // CONTROL_RATE)
    rows[-1] = rows[-2]
    held = (False,) * (bundles + 1)
    return Input(np.arange(count + 1) / CONTROL_RATE, rows, held, structure.input_columns)
