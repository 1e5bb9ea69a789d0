"""First-order lag of the position sensors (of the load cell, on a wire).

tau dy/dt = value - y;   the sensor shows y
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

FASTEST = 1e-6  # below this time constant the lag is not resolved: neutral

EFFECT = Effect(
    name='sensor_lag',
    title='a lag of the sensors',
    port='sensing',
    stage='lag',
    channels=('U_x', 'U_y', 'alpha', 'stress'),
    equation='tau dy/dt = value - y',
    source='first-order low-pass filter',
    parameters=(
        Parameter('tau', 0.05, 's', (0.0, 1e3), 'time constant of the sensor', neutral=0.0, realistic=(0.005, 1.0)),
    ),
    states=('shown',),
    scale=(1.0,),
    start=lambda s, w, p: s.value,
    rate=lambda s, w, p, m: (s.value - m.shown) / max(p.tau, FASTEST),
    kernel=lambda s, w, p, m: m.shown if p.tau > FASTEST else s.value,
    tried='timed',
    description='the motion itself is as modelled',
    signature='the shown pose follows late and rounds off fast motion, at switching on and off alike; temperatures agree',
    confused_with=('delay', 'driver_lag', 'latent_heat_scale', 'beam.b_y', 'clock_skew'),
)
