"""First-order lag of the electrical driver.

tau dP/dt = J - P;   the wire gets P   [W]
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

FASTEST = 1e-6  # below this time constant the lag is not resolved: neutral

EFFECT = Effect(
    name='driver_lag',
    title='a lag of the driver',
    port='actuation',
    stage='lag',
    equation='tau dP/dt = J - P',
    source='first-order lag of a current or power controller',
    parameters=(Parameter('tau', 0.2, 's', (0.0, 1e3), 'time constant of the driver', '', 0.0, (0.01, 3.0)),),
    states=('P',),
    scale=(0.5,),
    rate=lambda s, w, p, m: (s.J - m.P) / max(p.tau, FASTEST),
    kernel=lambda s, w, p, m: m.P if p.tau > FASTEST else s.J,
    description='heating sets in late and goes on after switching off; its integral is kept',
    signature='temperature, then pose, follow every step of the command late by about tau; a kink becomes smooth',
    confused_with=('delay', 'sensor_lag', 'wire.c_V', 'latent_heat_scale'),
    same_as='a delay by tau, to first order in tau',
)
