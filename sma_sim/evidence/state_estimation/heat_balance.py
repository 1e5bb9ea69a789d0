"""The temperature of a wire without latent heat, C dT/dt = J - lambda A_s (T - T_E)."""

from __future__ import annotations

import math

from sma_sim.model.arrays import Vector
from sma_sim.model.parameters import WireConstants


def heat_balance(wire: WireConstants, T: Vector, T_E: float, lasted: float) -> tuple[Vector, float]:
    """Temperatures (wires,) [K] after so many seconds without heating and latent heat, and what each watt adds [K/W]."""
    cooling = wire.lambda_ * wire.surface
    decay = math.exp(-cooling * lasted / (wire.volume * wire.rho * wire.c_V))
    return T * decay + T_E * (1.0 - decay), (1.0 - decay) / cooling
