"""One turnbuckle was turned further: bundle 1 is shorter than wire.l0 by d, bundle 2 longer by d.

The strain from the true length l0 -+ d is less or more than the nominal one: e = eps - (l/(l0 -+ d) - 1)   [-]
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_pretension_mismatch',
    port='wire_strain',
    equation='e = eps + 1 - l/(l0 -+ d)',
    source='geometry',
    parameters=(drawn_parameter('d', 'm', 1e-4, 9e-4, 'half the difference in length'),),
    kernel=lambda s, w, p: s.eps + 1.0 - s.length / (w.l0 - (1.0 - 2.0 * s.wire) * p.d),
    energy='does not enter',
)
TRUTH = simulated_truth(
    EFFECT,
    library='pretension_mismatch',
    variables=('constant',),
    listed=lambda p, of: {'delta': -2.0 * p['d'] / of['wire.l0']},
    signed=('d',),
)
