"""Electrical heating of a wire that differs from the command by a part with a given time course.

A part, and not watts: what a supply loses steps where the command steps, and is nothing where nothing is commanded.
"""

from sma_sim.evidence.latent_input.time_functions.time_function import time_function, values
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='latent_power',
    port='actuation',
    stage='gain',
    equation='P = J (1 + u(t))',
    source='a basis, not a law of nature',
    parameters=values('-'),
    kernel=lambda s, w, p: s.J * (1.0 + time_function(s.t, p)) if s.wire == p.wire else s.J,
)
