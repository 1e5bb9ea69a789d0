"""Transformation stresses that are spread over the grains of a polycrystal.

shift of sigma_A and sigma_M = (spread/2) atanh(c (2 x - 1))/atanh(c),  c = 0.95   [Pa]
Grains transform in the order of their own transformation stress; the shift is the quantile of their distribution,
here a logistic one, cut off at its ends. Reversal inside the loop gives inner loops.
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants

CUT = 0.95
HALF_WIDTH = math.atanh(CUT)
END_SLOPE = CUT / (HALF_WIDTH * (1.0 - CUT * CUT))


def quantile(x: float) -> float:
    """The cut-off logistic quantile, -1/2 at x = 0 and +1/2 at x = 1; straight on outside."""
    inside = min(max(x, 0.0), 1.0)
    z = CUT * (2.0 * inside - 1.0)
    return 0.25 * math.log((1.0 + z) / (1.0 - z)) / HALF_WIDTH + END_SLOPE * (x - inside)  # atanh is twice as slow


def shifts(s: State, w: WireConstants, p: Any) -> tuple[float, float]:
    """The same shift of both transformation stresses [Pa]."""
    shift = p.spread * quantile(s.x)
    return shift, shift


EFFECT = Effect(
    name='polycrystal',
    title='the gradual transformation of a polycrystal',
    port='transformation_stress',
    equation='shift = spread q(x_M), q the quantile of a cut-off logistic distribution from -1/2 to 1/2',
    source='Heintze and Seelecke, J. Alloys Compd. 481 (2009) 389: from single crystal to polycrystal',
    parameters=(
        Parameter(
            'spread',
            20e6,
            'Pa',
            (0.0, 1e10),
            'difference of the transformation stress from first to last grain',
            neutral=0.0,
            realistic=(2e6, 1.5e8),
        ),
    ),
    kernel=shifts,
    gradual=True,
    energy='latent heat at the shifted stress: first law with U unchanged; energy stored between grains is left out',
    description='grains transform one after the other; inner loops when the wire turns back half way',
    signature='plateaus have a slope and round ends; partial cycles run inside the full loop',
    confused_with=(
        'smooth_transformation',
        'wire.sigma_T',
        'plate.W',
        'thermal_crosstalk',
        'natural_convection',
        'temperature_gradient',
    ),
)
