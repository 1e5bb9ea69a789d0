"""Heating of a wire beside the command with a given time course."""

from sma_sim.evidence.latent.courses.course import course, values
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='latent_power',
    port='actuation',
    stage='gain',
    equation='P = J + u(t)',
    source='a basis, not a law of nature',
    parameters=values('W'),
    kernel=lambda s, w, p: s.J + (course(s.t, p) if s.wire == p.wire else 0.0),
)
