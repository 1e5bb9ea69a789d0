"""Heat into a wire with a given time course."""

from sma_sim.evidence.latent_input.time_functions.time_function import time_function, values
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='latent_heat',
    port='wire_heat',
    equation='Q = u(t)',
    source='a basis, not a law of nature',
    parameters=values('W'),
    kernel=lambda s, w, p: time_function(s.t, p) if s.wire == p.wire else 0.0,
)
