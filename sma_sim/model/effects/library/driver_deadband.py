"""Driver that gives nothing below a threshold.

J_out = max(J - J_d, 0)   [W] per wire, rounded off over w = J_d/20: w ln(1 + exp((J - J_d)/w))
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants

RELATIVE_KNEE_WIDTH = 0.05  # of the threshold
SMALLEST = 1e-9  # [W]; a smaller threshold is none


def passed(s: State, w: WireConstants, p: Any) -> float:
    """What the driver passes on [W], nothing without a command."""
    if p.J_d < SMALLEST or s.J <= 0.0:
        return s.J
    width: float = RELATIVE_KNEE_WIDTH * p.J_d
    beyond: float = (s.J - p.J_d) / width
    return width * (max(beyond, 0.0) + math.log1p(math.exp(-abs(beyond))))


EFFECT = Effect(
    name='driver_deadband',
    title='a deadband of the driver',
    port='actuation',
    stage='deadband',
    equation='J_out = max(J - J_d, 0)',
    source='dead zone of a power stage: Tao and Kokotovic, Adaptive Control of Systems with Actuator Nonlinearities',
    parameters=(
        Parameter(
            'J_d',
            0.05,
            'W',
            (0.0, 1e3),
            'heating of one wire (of n) below which none arrives',
            neutral=0.0,
            realistic=(5e-3, 0.3),
        ),
    ),
    kernel=passed,
    description='the same loss at every command above the threshold',
    signature='small commands do nothing, large ones lack a constant power',
    confused_with=('wire.lambda', 'natural_convection', 'r_phase'),
)
