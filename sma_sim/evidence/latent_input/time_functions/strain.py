"""A strain of a wire with a given function of time.

It is a state, so that its rate enters the rate of x_M (docs/explanation/physics.md).
"""

from sma_sim.evidence.latent_input.time_functions.time_function import knot_parameters, time_function, time_function_rate
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='latent_strain',
    port='wire_strain',
    equation='du/dt = derivative of the time function',
    source='a basis, not a law of nature',
    parameters=knot_parameters('-'),
    states=('u',),
    scale=(1e-3,),
    rate=lambda s, w, p, m: time_function_rate(s.t, p) if s.wire == p.wire else 0.0,
    start=lambda s, w, p: time_function(s.t, p) if s.wire == p.wire else 0.0,
    kernel=lambda s, w, p, m: m.u,
    energy='does not enter',
)
