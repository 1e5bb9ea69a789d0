"""Different slopes of sigma_A and sigma_M over temperature.

sigma_A - sigma_M = dsigma (1 + u), u = delta (T - T0)/dsigma; half of the change on either side of sigma_MW   [Pa]
Below u = -0.8 the height goes on as 0.05 + 0.15 exp((u + 0.8)/0.15): the hysteresis narrows to 5 % of dsigma and does not
close. As it closes, 1/E_I grows as eps_T/(sigma_A - sigma_M) and the MAS rates become a switch at sigma_A.
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants

KNEE, LEAST = 0.2, 0.05  # of dsigma: from where on the height no longer falls in proportion, and its limit


def shifts(s: State, w: WireConstants, p: Any) -> tuple[float, float]:
    """Opposite shifts of sigma_A and sigma_M [Pa]."""
    change = p.delta * (s.T - w.T0) / w.dsigma
    if change < KNEE - 1.0:
        change = LEAST + (KNEE - LEAST) * math.exp((change + 1.0 - KNEE) / (KNEE - LEAST)) - 1.0
    half = 0.5 * w.dsigma * change
    return half, -half


EFFECT = Effect(
    name='clausius_clapeyron_mismatch',
    title='a hysteresis whose height depends on temperature',
    port='transformation_stress',
    equation='s_A = delta (T - T0)/2, s_M = -s_A: slopes sigma_T + delta/2 and sigma_T - delta/2',
    source='Brinson, J. Intell. Mater. Syst. Struct. 4 (1993) 229: stress influence coefficients C_A and C_M',
    parameters=(
        Parameter('delta', 2e5, 'Pa/K', (-1e8, 1e8), 'slope of sigma_A less slope of sigma_M', '', 0.0, (-5e5, 1e6)),
    ),
    kernel=shifts,
    energy='latent heat at the shifted stress: first law with U unchanged',
    description='the height of the hysteresis is dsigma at T0 and changes with temperature',
    signature='loops get higher (delta > 0) or lower with temperature, their middle stays on one line',
    confused_with=('wire.dsigma',),
)
