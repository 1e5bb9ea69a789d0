"""Transition rates of the Mueller-Achenbach-Seelecke (MAS) model (paper, MAS5 and MAS6).

The Gibbs energy is two convex parabolas joined by a concave one of modulus -E_I; the barriers below follow from
its continuity up to the first derivative (Seelecke and Mueller 2004; docs/explanation/physics.md).
"""

from __future__ import annotations

import math

from sma_sim.model.parameters import K_B, WireConstants


def transition_rates(sigma: float, T: float, s_A: float, s_M: float, w: WireConstants) -> tuple[float, float]:
    """(p_AM, p_MA) [1/s] at stress `sigma` with transformation stresses `s_A` > `s_M` [Pa]."""
    inverse_E_I = (w.eps_T + s_M / w.E_M - s_A / w.E_A) / (s_A - s_M)
    below_A = max(s_A - sigma, 0.0)
    above_M = max(sigma - s_M, 0.0)
    barrier_AM = 0.5 * below_A * below_A * (1.0 / w.E_A + inverse_E_I)
    barrier_MA = 0.5 * above_M * above_M * (1.0 / w.E_M + inverse_E_I)
    scale = w.V_L / (K_B * T)
    return w.omega_x * math.exp(-scale * barrier_AM), w.omega_x * math.exp(-scale * barrier_MA)


def mas_rate(sigma: float, x: float, T: float, s_A: float, s_M: float, w: WireConstants) -> float:
    """dx_M/dt [1/s] (MAS5)."""
    p_AM, p_MA = transition_rates(sigma, T, s_A, s_M, w)
    return -p_MA * x + p_AM * (1.0 - x)
