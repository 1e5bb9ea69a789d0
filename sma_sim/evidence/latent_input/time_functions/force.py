"""A force on a coordinate, or a moment about it, as a given function of time; in the coordinate of its scope."""

from sma_sim.evidence.latent_input.time_functions.time_function import knot_parameters, time_function
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='latent_force',
    port='structure_force',
    needs=('coordinate',),
    equation='F = u(t)',
    source='a basis, not a law of nature',
    parameters=knot_parameters('N, N m'),
    kernel=lambda s, b, p: time_function(s.t, p),
)
