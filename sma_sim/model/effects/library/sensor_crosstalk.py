"""Sensors of the wires that see a part of what their neighbours measure.

shown = value + c sum of the other forces (or temperatures): c is the off-diagonal sensitivity, the same for every two
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='sensor_crosstalk',
    title='crosstalk between the sensors of the wires',
    port='sensing',
    stage='misalignment',
    channels=('F_1', 'F_2', 'T_1', 'T_2'),
    wires=2,
    equation='shown_i = value_i + c sum_(j != i) value_j',
    source='cross-sensitivity of multi-component force transducers: ASTM E2428; JCGM 200, 4.12',
    parameters=(
        Parameter(
            'F',
            0.05,
            '-',
            (-1.0, 1.0),
            'part of the other forces that a force sensor shows',
            neutral=0.0,
            realistic=(-0.2, 0.2),
        ),
        Parameter(
            'T',
            0.02,
            '-',
            (-1.0, 1.0),
            'part of the other temperatures that a thermometer shows',
            neutral=0.0,
            realistic=(-0.1, 0.1),
        ),
    ),
    by_channel=True,
    kernel=lambda s, w, p: s.value + p.own * s.neighbours,
    description='the motion itself is as modelled; before gain and zero of each channel',
    signature='a force changes with that of the other wire while its own does not; the pose agrees',
    confused_with=('wire.sigma_MW0',),
)
