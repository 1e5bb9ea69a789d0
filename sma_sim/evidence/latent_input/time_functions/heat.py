"""Heat into a wire with a given function of time."""

from sma_sim.evidence.latent_input.time_functions.time_function import knot_parameters, time_function
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='latent_heat',
    port='wire_heat',
    equation='Q = u(t)',
    source='a basis, not a law of nature',
    parameters=knot_parameters('W'),
    kernel=lambda s, w, p: time_function(s.t, p) if s.wire == p.wire else 0.0,
)
