"""Electric power that is known up to a scale: a duty times a constant, a voltage squared over a nominal resistance.

J = k J_c   [W]
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='power_scale',
    title='the scale of electric power',
    port='actuation',
    stage='gain',
    equation='J = k J_c',
    source='sensitivity of a measuring system: JCGM 200, International Vocabulary of Metrology, 4.12',
    parameters=(Parameter('k', 1.1, '-', (0.01, 100.0), 'power over commanded power', neutral=1.0, realistic=(0.5, 2.0)),),
    tried='never',
    kernel=lambda s, w, p: p.k * s.J,
    description='of the bench, not of the wire: no finding of a diagnosis, but part of its model where it is switched on',
    signature='more or less heat than commanded, in all wires and at all times',
    confused_with=('latent_heat_scale', 'wire.c_V', 'wire.lambda'),
    same_as='a latent heat, c_V and lambda times 1/k',
)
