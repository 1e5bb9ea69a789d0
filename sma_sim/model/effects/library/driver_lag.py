"""First-order lag of the electrical driver, whose power changes no faster than at a largest rate.

dP/dt = tanh(rise (J - P)/(tau + rise P_l))/rise, without a limit (rise = 0) dP/dt = (J - P)/tau;   the wire gets P   [W]
1/rise is the largest rate; within P_l = 5 mW of the command the driver is linear, however short tau is.
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants

FASTEST = 1e-6  # [s]; below this time constant the lag is not resolved: neutral
LINEAR = 0.005  # P_l [W]
SHORTEST_RISE = 1e-9  # [s/W]; below it the rate has no limit


def time_constant(p: Any) -> float:
    """Of small changes [s]."""
    tau: float = p.tau + LINEAR * p.rise
    return tau


def rate(s: State, w: WireConstants, p: Any, m: Any) -> float:
    """dP/dt [W/s]."""
    lagging: float = (s.J - m.P) / max(time_constant(p), FASTEST)
    return math.tanh(p.rise * lagging) / p.rise if p.rise > SHORTEST_RISE else lagging


EFFECT = Effect(
    name='driver_lag',
    title='a lag of the driver',
    port='actuation',
    stage='lag',
    equation='tau dP/dt = J - P, no faster than 1/rise',
    source='first-order lag of a current or power controller, with its slew rate',
    parameters=(
        Parameter('tau', 0.2, 's', (0.0, 1e3), 'time constant of the driver', neutral=0.0, realistic=(0.01, 3.0)),
        Parameter(
            'rise',
            0.0,
            's/W',
            (0.0, 1e3),
            'rise time per watt of one wire at the largest rate',
            neutral=0.0,
            realistic=(0.1, 10.0),
        ),
    ),
    states=('P',),
    scale=(0.5,),
    rate=rate,
    kernel=lambda s, w, p, m: m.P if time_constant(p) > FASTEST else s.J,
    description='heating sets in late and goes on after switching off; its integral is kept',
    signature='temperature, then pose, follow every step late by about tau; at a limited rate large steps by more',
    confused_with=('delay', 'sensor_lag', 'wire.c_V', 'latent_heat_scale', 'clock_skew'),
    same_as='a delay by tau, to first order in tau',
)
