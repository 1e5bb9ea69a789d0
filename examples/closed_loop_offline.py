"""A PI controller of the angle around the model, without ROS: `python examples/closed_loop_offline.py`.

The loop runs at 100 Hz on the fixed steps that the node makes; the controller does not wind up at its limits.
"""

import math

import numpy as np

from sma_sim import Model
from sma_sim.solver.fixed_rate import FixedRateRun

RATE, CONTROL_EVERY = 1000, 10  # [Hz], steps
J_MAX, K_P, K_I, BIAS = 15.0, 60.0, 120.0, 0.0  # [W], [W/rad], [W/(rad s)], [W]
T_E = 298.0  # [K]


def target(t: float) -> float:
    """Wanted angle [rad]."""
    return math.radians(3.0) if t < 10.0 else math.radians(-2.0)


run = FixedRateRun(Model(), RATE, np.array([0.0, T_E]))
J_eq, integral, errors = 0.0, 0.0, []
while run.time < 20.0:
    if run.k % CONTROL_EVERY == 0:
        error = target(run.time) - run.shown('alpha')
        wanted = BIAS + K_P * error + K_I * integral
        J_eq = min(max(wanted, -J_MAX), J_MAX)
        if J_eq == wanted:
            integral += error * CONTROL_EVERY / RATE
        errors.append(math.degrees(error))
    run.step(np.array([J_eq, T_E]))
print(f'error after 10 s: {errors[990]:+.3f} deg; after 20 s: {errors[-1]:+.3f} deg')
