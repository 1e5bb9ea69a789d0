"""Zeros of the sensors that jump at an instant: a bumped camera, a load cell that slips in its seat.

shown = value + jump (1 + tanh(2 (t - t_slip)/w))/2,   jump of the channel; t since the beginning of the recording
The derivatives in t_slip are those of the smooth step: beyond some w from it there are none, so a fit begins near it.
"""

from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.library.clamp_slip import INSTANT, RISE, smooth_step
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants


def jumping(s: State, w: WireConstants, p: Any) -> float:
    """What the sensor shows."""
    return float(s.value + p.own * smooth_step(s.t, p.t_slip, p.w))


EFFECT = Effect(
    name='sensor_jump',
    title='a jump of the zeros of the sensors',
    port='sensing',
    stage='bias',
    channels=('U_x', 'U_y', 'alpha', 'F_1', 'F_2', 'stress'),
    equation='shown = value + jump (1 + tanh(2 (t - t_slip)/w))/2',
    source='abrupt sensor fault: Isermann, Fault-Diagnosis Systems, 5.2',
    parameters=(
        Parameter('U_x', 1e-5, 'm', (-1.0, 1.0), 'jump of U_x', neutral=0.0, realistic=(-1e-4, 1e-4)),
        Parameter('U_y', 2e-4, 'm', (-1.0, 1.0), 'jump of U_y', neutral=0.0, realistic=(-2e-3, 2e-3)),
        Parameter('alpha', 0.01, 'rad', (-3.0, 3.0), 'jump of alpha', neutral=0.0, realistic=(-0.1, 0.1)),
        Parameter('F_1', 0.5, 'N', (-1e4, 1e4), 'jump of F_1', neutral=0.0, realistic=(-5.0, 5.0)),
        Parameter('F_2', 0.5, 'N', (-1e4, 1e4), 'jump of F_2', neutral=0.0, realistic=(-5.0, 5.0)),
        Parameter(
            'stress', 2e6, 'Pa', (-1e10, 1e10), 'jump of the load cell over the section', neutral=0.0, realistic=(-2e7, 2e7)
        ),
        INSTANT,
        RISE,
    ),
    by_channel=True,
    kernel=jumping,
    tried='timed',
    description='the motion itself is as modelled; all channels jump together',
    signature='a constant error of the shown channel from one instant on; the motion itself has none',
    confused_with=('sensor_bias', 'sensor_drift', 'wire.sigma_MW0'),
)
