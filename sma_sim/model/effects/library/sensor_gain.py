"""Wrong scale of the position sensors (of the load cell, on a wire).

shown = gain of the channel * value
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='sensor_gain',
    title='a scale error of the sensors',
    port='sensing',
    stage='gain',
    channels=('U_x', 'U_y', 'alpha', 'stress'),
    equation='shown = gain value',
    source='sensitivity of a sensor: JCGM 200, International Vocabulary of Metrology, 4.12',
    parameters=(
        Parameter('U_x', 1.05, '-', (0.1, 10.0), 'gain of U_x', neutral=1.0, realistic=(0.8, 1.25)),
        Parameter('U_y', 1.05, '-', (0.1, 10.0), 'gain of U_y', neutral=1.0, realistic=(0.8, 1.25)),
        Parameter('alpha', 1.05, '-', (0.1, 10.0), 'gain of alpha', neutral=1.0, realistic=(0.8, 1.25)),
        Parameter('stress', 1.05, '-', (0.1, 10.0), 'gain of the load cell', neutral=1.0, realistic=(0.8, 1.25)),
    ),
    by_channel=True,
    kernel=lambda s, w, p: s.value * p.own,
    description='gains of U_y and alpha that are equal look like a softer beam',
    signature='an error in proportion to the shown value, at every temperature and speed; forces and temperatures agree',
    confused_with=('beam.E', 'plate.W', 'beam_nonlinearity', 'sensor_bias', 'wire.sigma_MW0'),
)
