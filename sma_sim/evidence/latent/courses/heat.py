"""Heat into a wire with a given time course."""

from sma_sim.evidence.latent.courses.course import course, values
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='latent_heat',
    port='wire_heat',
    equation='Q = u(t)',
    source='a basis, not a law of nature',
    parameters=values('W'),
    kernel=lambda s, w, p: course(s.t, p) if s.wire == p.wire else 0.0,
)
