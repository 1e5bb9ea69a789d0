"""Electrical heating of a wire that differs from the command by a fraction that is a given function of time.

A fraction, not watts: what a supply loses steps where the command steps, and vanishes where nothing is commanded.
"""

from sma_sim.evidence.latent_input.time_functions.time_function import knot_parameters, time_function
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='latent_power',
    port='actuation',
    stage='gain',
    equation='P = J (1 + u(t))',
    source='a basis, not a law of nature',
    parameters=knot_parameters('-'),
    kernel=lambda s, w, p: s.J * (1.0 + time_function(s.t, p)) if s.wire == p.wire else s.J,
)
