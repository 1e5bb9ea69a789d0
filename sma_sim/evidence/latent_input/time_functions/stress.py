"""A shift of both transformation stresses of a wire with a given time course.

It is a state, so that its rate enters the rate of x_M (docs/explanation/physics.md).
"""

from sma_sim.evidence.latent_input.time_functions.time_function import slope, time_function, values
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='latent_stress',
    port='transformation_stress',
    equation='du/dt = slope of the course',
    source='a basis, not a law of nature',
    parameters=values('Pa'),
    states=('u',),
    scale=(1e6,),
    rate=lambda s, w, p, m: slope(s.t, p) if s.wire == p.wire else 0.0,
    start=lambda s, w, p: time_function(s.t, p) if s.wire == p.wire else 0.0,
    kernel=lambda s, w, p, m: (m.u, m.u),
    energy='does not enter',
)
