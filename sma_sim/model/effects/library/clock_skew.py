"""Clocks of command and measurement that run at different rates.

What is shown at t was seen at (1 - rate) t of the clock of the command;   t since the beginning of the recording
A constant offset between them is the delay of a recording, which every fit estimates.
"""

from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter


def seen_at(t: Any, p: Any) -> Any:
    """When the sensors saw what is shown at `t` [s], (k,) each."""
    return (1.0 - p.rate) * t


EFFECT = Effect(
    name='clock_skew',
    title='a clock of the measurement that is fast or slow',
    port='sensing',
    stage='delay',
    channels=(),
    equation='shown(t) = value((1 - rate) t)',
    source='clock skew: Mills, Computer Network Time Synchronization, 1.2',
    parameters=(
        Parameter(
            'rate',
            5e-3,
            '-',
            (-0.5, 0.5),
            'seconds that the clock of the measurement gains in one second',
            neutral=0.0,
            realistic=(-0.02, 0.02),
        ),
    ),
    kernel=lambda s, w, p: s.value,
    clock=seen_at,
    tried='timed',
    description='of all channels; of recorded runs, not in the node, which has one clock',
    signature='all channels follow the command the later (rate > 0), or the earlier, the longer a recording lasts',
    confused_with=('delay', 'driver_lag', 'sensor_lag', 'wire.c_V'),
)
