"""A part f of the latent heat more (or less) than sigma_T says.

Q = f Om T sigma_T (eps_T + d sigma_MW) dx/dt   [W], with dx/dt as the difference to a copy of x_M that follows within 2 ms
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

FOLLOWS = 2e-3  # [s]


EFFECT = Effect(
    name='truth_latent_heat_scale',
    port='wire_heat',
    equation='Q = f Om T sigma_T (eps_T + d sigma_MW) (x_M - z)/tau; dz/dt = (x_M - z)/tau',
    source='calorimetry against the Clausius-Clapeyron slope',
    parameters=(drawn_parameter('f', '-', 0.05, 0.5, 'heat in excess over the heat of the model'),),
    states=('z',),
    scale=(0.1,),
    start=lambda s, w, p: s.x,
    rate=lambda s, w, p, m: ((s.x - m.z) / FOLLOWS,),
    kernel=lambda s, w, p, m: (
        p.f * w.volume * s.T * w.sigma_T * (w.eps_T + w.d * (w.sigma_MW0 + w.sigma_T * (s.T - w.T0))) * (s.x - m.z) / FOLLOWS
    ),
)
TRUTH = simulated_truth(
    EFFECT, library='latent_heat_scale', variables=('dx',), listed=lambda p, of: {'k': 1.0 + p['f']}, signed=('f',)
)
