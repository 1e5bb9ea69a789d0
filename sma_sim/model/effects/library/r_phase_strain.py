"""Strain of the R-phase: cold austenite is R-phase, which a stress orients.

e = eps_R (1 - x_M) r(T) sigma/(sigma + sigma_R),   r = 1/(1 + exp((T - T_R)/w))   [-], nil in compression
r is the part of the parent phase that is R-phase. sigma depends on e in turn, solved for it (`material.saturating_strain`).
By Clausius-Clapeyron T_R rises with stress by eps_R/(rho ds), 1 K in about 15 MPa, which is left out.
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.material import compliance, saturating_strain
from sma_sim.model.parameters import Parameter, WireConstants

FARTHEST = 50.0  # widths from T_R, beyond which nothing changes any more


def oriented(s: State, w: WireConstants, p: Any) -> float:
    """Strain of what is R-phase."""
    away = min(max((s.T - p.T_R) / p.w, -FARTHEST), FARTHEST)
    most = p.eps_R * min(max(1.0 - s.x, 0.0), 1.0) / (1.0 + math.exp(away))
    return saturating_strain(s.eps - s.strain - w.eps_T * s.x, most, p.sigma_R, compliance(s.x, w))


EFFECT = Effect(
    name='r_phase_strain',
    title='the strain of the R-phase',
    port='wire_strain',
    stage='series',
    equation='e = eps_R (1 - x_M) sigma/(sigma + sigma_R)/(1 + exp((T - T_R)/w))',
    source='Otsuka and Ren, Prog. Mater. Sci. 50 (2005) 511: R-phase transformation, its small strain and hysteresis',
    parameters=(
        Parameter('eps_R', 5e-3, '-', (0.0, 0.05), 'strain of oriented R-phase', neutral=0.0, realistic=(5e-4, 1.2e-2)),
        Parameter(
            'T_R', 310.0, 'K', (100.0, 600.0), 'temperature at which half of the parent is R-phase', realistic=(285.0, 345.0)
        ),
        Parameter('w', 3.0, 'K', (0.05, 50.0), 'width of its window', realistic=(0.5, 8.0)),
        Parameter('sigma_R', 1e7, 'Pa', (1e4, 1e10), 'stress that orients half of it', realistic=(2e6, 5e7)),
    ),
    tried='single wire',
    kernel=oriented,
    energy='Om sigma de/dt and the heat of austenite to R-phase are left out, below eps_R/eps_T of the latent heat',
    description='r_phase is what the same transformation does to the transformation stresses',
    signature='at low stress strain grows in two steps on cooling, the first of them small and nearly without hysteresis',
    confused_with=('thermal_expansion', 'attachment_compliance', 'wire.E_A'),
)
