"""A loss of stiffness as a given function of time."""

from sma_sim.evidence.latent_input.time_functions.time_function import knot_parameters, time_function
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='latent_stiffness',
    port='structure_force',
    needs=('coordinate', 'stiffness'),
    equation='F = u(t) K q',
    source='a basis, not a law of nature',
    parameters=knot_parameters('-'),
    kernel=lambda s, b, p, stiffness: stiffness(s.q, b, time_function(s.t, p)),
)
