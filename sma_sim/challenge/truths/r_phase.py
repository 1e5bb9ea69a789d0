"""Below T_R the parent phase is the R-phase: it is more stable than austenite, so that martensite needs more stress.

Equal Gibbs energies: shift of both = rho h/(T_R eps_T) (T_R - T) below T_R, rounded over 2 K   [Pa], h the heat of A -> R
"""

import math
from typing import Any

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import WireConstants

KNEE_WIDTH = 2.0  # [K]


def both_shifts(s: State, w: WireConstants, p: Any) -> tuple[float, float]:
    """Equal shifts of both transformation stresses [Pa]."""
    z = (p.T_R - s.T) / KNEE_WIDTH
    below = KNEE_WIDTH * (max(z, 0.0) + math.log1p(math.exp(-abs(z))))
    shift = w.rho * p.h / (p.T_R * w.eps_T) * below
    return shift, shift


EFFECT = Effect(
    name='truth_r_phase',
    port='transformation_stress',
    equation='shift = rho h/(T_R eps_T) w ln(1 + exp((T_R - T)/w)), w = 2 K',
    source='Clausius and Clapeyron for R -> M; heat of A -> R in NiTi 1 to 6 kJ/kg',
    parameters=(
        drawn_parameter('h', 'J/kg', 150.0, 2500.0, 'heat of the transformation from austenite to R-phase'),
        drawn_parameter('T_R', 'K', 302.0, 325.0, 'temperature of that transformation'),
    ),
    kernel=both_shifts,
    energy='the heat of A -> R itself is left out',
)
TRUTH = simulated_truth(EFFECT, library='r_phase', variables=('T',))
