"""First-order lag of a thermocouple or an infrared sensor on a wire.

tau dy/dt = T - y;   the sensor shows y
"""

from dataclasses import replace

from sma_sim.model.effects.library.sensor_lag import EFFECT as SENSOR_LAG
from sma_sim.model.parameters import Parameter

EFFECT = replace(
    SENSOR_LAG,
    name='thermometer_lag',
    title='a lag of the thermometers',
    channels=('T', 'T_1', 'T_2'),
    equation='tau dy/dt = T - y',
    source='first-order response of a thermocouple: ASTM E839, time constant',
    parameters=(
        Parameter('tau', 0.2, 's', (0.0, 1e3), 'time constant of the thermometer', neutral=0.0, realistic=(0.01, 5.0)),
    ),
    tried='never',
    description='of the bench, not of the wire: no finding of a diagnosis, but part of its model where it is switched on',
    signature='the shown temperature follows late and rounds off fast heating and cooling; forces and strains agree',
    confused_with=('delay', 'wire.c_V'),
)
