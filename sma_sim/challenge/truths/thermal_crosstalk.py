"""Heat conducted from one bundle to the other through what lies between them.

Two parallel cylinders of radius r_b in a medium: G = 2 pi k l0/acosh(D^2/(2 r_b^2) - 1), Q = G (T_other - T)/n   [W]
"""

import math
from typing import Any

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import WireConstants

DISTANCE = 10e-3  # of the bundles [m]
CLOSEST = 1.1  # bundles that nearly touch


def conducted(s: State, w: WireConstants, p: Any) -> float:
    """Heat into one wire of this bundle [W]."""
    radius = 1.5 * math.sqrt(w.n) * w.r0
    conductance: float = 2.0 * math.pi * p.k * w.l0 / math.acosh(max(0.5 * (DISTANCE / radius) ** 2 - 1.0, CLOSEST))
    return conductance * (s.T_other - s.T) / w.n


EFFECT = Effect(
    name='truth_thermal_crosstalk',
    port='wire_heat',
    equation='Q = 2 pi k l0/acosh(D^2/(2 r_b^2) - 1) (T_other - T)/n',
    source='conduction shape factor of two cylinders (Incropera, table 4.1), r_b = 1.5 sqrt(n) r0, D = 10 mm',
    parameters=(drawn_parameter('k', 'W/(m K)', 0.06, 0.8, 'effective conductivity of what lies between the bundles'),),
    kernel=conducted,
)
TRUTH = simulated_truth(EFFECT, library='thermal_crosstalk', variables=('T_other', 'T'))
