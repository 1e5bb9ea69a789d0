"""Martensite takes more heat than austenite to warm by a kelvin: enthalpy beside that of the model.

H = f rho Om c_V (x_M - 1/2) (T - 298 K), which the wire takes up: Q = -dH/dt, from a copy that follows within 2 ms
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.challenge.truths.latent_heat_scale import FOLLOWS
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import WireConstants

COLD = 298.0  # [K]


def enthalpy(s: State, w: WireConstants, f: float) -> float:
    """What the wire holds beyond one of the mean specific heat [J]."""
    return f * w.rho * w.volume * w.c_V * (s.x - 0.5) * (s.T - COLD)


EFFECT = Effect(
    name='truth_heat_capacity_difference',
    port='wire_heat',
    equation='Q = -(H - z)/tau, dz/dt = (H - z)/tau, H = f rho Om c_V (x_M - 1/2) (T - 298 K)',
    source='calorimetry of both phases',
    parameters=(drawn_parameter('f', '-', 0.1, 0.4, 'specific heat of martensite less that of austenite, over their mean'),),
    states=('z',),
    scale=(0.1,),
    start=lambda s, w, p: enthalpy(s, w, p.f),
    rate=lambda s, w, p, m: ((enthalpy(s, w, p.f) - m.z) / FOLLOWS,),
    kernel=lambda s, w, p, m: (m.z - enthalpy(s, w, p.f)) / FOLLOWS,
)
TRUTH = simulated_truth(
    EFFECT, library='heat_capacity_difference', variables=('x', 'T'), listed=lambda p, of: {'r': p['f']}, signed=('f',)
)
