"""Different slopes of sigma_A and sigma_M over temperature.

sigma_A - sigma_M = dsigma + delta (T - T0); half of the change on either side of sigma_MW   [Pa]
"""

from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants


def shifts(s: State, w: WireConstants, p: Any) -> tuple[float, float]:
    """Opposite shifts of sigma_A and sigma_M [Pa]."""
    half = 0.5 * p.delta * (s.T - w.T0)
    return half, -half


EFFECT = Effect(
    name='clausius_clapeyron_mismatch',
    title='a hysteresis whose height depends on temperature',
    port='transformation_stress',
    equation='s_A = delta (T - T0)/2, s_M = -s_A: slopes sigma_T + delta/2 and sigma_T - delta/2',
    source='Brinson, J. Intell. Mater. Syst. Struct. 4 (1993) 229: stress influence coefficients C_A and C_M',
    parameters=(
        Parameter(
            'delta', 2e5, 'Pa/K', (-1e8, 1e8), 'slope of sigma_A less slope of sigma_M', neutral=0.0, realistic=(-5e5, 1e6)
        ),
    ),
    kernel=shifts,
    energy='latent heat at the shifted stress: first law with U unchanged',
    description='the height of the hysteresis is dsigma at T0 and changes with temperature',
    signature='loops get higher (delta > 0) or lower with temperature, their middle stays on one line',
    confused_with=('wire.dsigma',),
)
