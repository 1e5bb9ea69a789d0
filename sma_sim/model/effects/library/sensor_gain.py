"""Wrong scale of the position sensors (of the load cell, on a wire).

shown = gain of the channel * value
"""

from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants


def scaled(s: State, w: WireConstants, p: Any) -> float:
    """The value times the gain of its channel."""
    gain: float = p.U_x if s.channel == 0 else p.U_y if s.channel == 1 else p.alpha if s.channel == 2 else p.stress
    return s.value * gain


EFFECT = Effect(
    name='sensor_gain',
    title='a scale error of the sensors',
    port='sensing',
    stage='gain',
    channels=('U_x', 'U_y', 'alpha', 'stress'),
    equation='shown = gain value',
    source='sensitivity of a sensor: JCGM 200, International Vocabulary of Metrology, 4.12',
    parameters=(
        Parameter('U_x', 1.05, '-', (0.1, 10.0), 'gain of U_x', '', 1.0, (0.8, 1.25)),
        Parameter('U_y', 1.05, '-', (0.1, 10.0), 'gain of U_y', '', 1.0, (0.8, 1.25)),
        Parameter('alpha', 1.05, '-', (0.1, 10.0), 'gain of alpha', '', 1.0, (0.8, 1.25)),
        Parameter('stress', 1.05, '-', (0.1, 10.0), 'gain of the load cell', '', 1.0, (0.8, 1.25)),
    ),
    kernel=scaled,
    description='gains of U_y and alpha that are equal look like a softer beam',
    signature='an error in proportion to the shown value, at every temperature and speed; forces and temperatures agree',
    confused_with=('beam.E', 'plate.W', 'beam_nonlinearity', 'sensor_bias', 'wire.sigma_MW0'),
)
