"""R-phase: below T_R the parent of the martensite is the R-phase, which is more stable than austenite there.

s_A = s_M = q w ln(1 + exp((T_R - T)/w))   [Pa]: below T_R both slopes fall from sigma_T to sigma_T - q, over a window w
The entropy of austenite to R-phase is then missing in the transformation to martensite (Clausius-Clapeyron).
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants


def shifts(s: State, w: WireConstants, p: Any) -> tuple[float, float]:
    """The same shift of both transformation stresses [Pa]; the logarithm is written so that nothing overflows."""
    below = (p.T_R - s.T) / p.w
    shift = p.q * p.w * (max(below, 0.0) + math.log1p(math.exp(-abs(below))))
    return shift, shift


EFFECT = Effect(
    name='r_phase',
    title='the R-phase transformation',
    port='transformation_stress',
    equation='s_A = s_M = q w ln(1 + exp((T_R - T)/w))',
    source='Otsuka and Ren, Prog. Mater. Sci. 50 (2005) 511: R-phase transformation; Clausius-Clapeyron relation',
    parameters=(
        Parameter(
            'q', 4e5, 'Pa/K', (0.0, 1e8), 'part of sigma_T that is lost below T_R', neutral=0.0, realistic=(5e4, 1.5e6)
        ),
        Parameter('T_R', 310.0, 'K', (100.0, 600.0), 'temperature of austenite to R-phase', realistic=(285.0, 345.0)),
        Parameter('w', 2.0, 'K', (0.05, 50.0), 'width of its window', realistic=(0.5, 8.0)),
    ),
    kernel=shifts,
    energy='latent heat at the shifted stress: first law with U unchanged; heat of austenite to R-phase is left out',
    description='the strain of the R-phase itself, below 1 %, is r_phase_strain',
    signature='a kink of the transformation stresses over temperature at T_R: cold wires are stiffer to draw than expected',
    confused_with=('wire.sigma_T', 'wire.sigma_MW0', 'driver_deadband', 'thermal_crosstalk'),
)
