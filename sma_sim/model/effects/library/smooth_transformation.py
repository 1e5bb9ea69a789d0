"""Smooth beginning and end of transformation, each way apart.

s_A = width_A (x^end_A - (1 - x)^start_A)/2,   s_M = width_M (x^start_M - (1 - x)^end_M)/2   [Pa],   x = x_M
The stress (at constant stress: the temperature) moves by a width from the first to the last of the material. An exponent
of 1 is a sharp bend; the larger, the more gradual: the slope there is exponent/2 widths per fraction.
"""

from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants

BOUNDS, USUAL = (1.0, 50.0), (1.0, 40.0)


def shifts(s: State, w: WireConstants, p: Any) -> tuple[float, float]:
    """Shifts of sigma_A and sigma_M [Pa]; straight on outside 0 to 1."""
    x = min(max(s.x, 0.0), 1.0)
    outside = s.x - x
    s_A = 0.5 * p.width_A * (x**p.end_A - (1.0 - x) ** p.start_A + slope(outside, p.start_A, p.end_A))
    s_M = 0.5 * p.width_M * (x**p.start_M - (1.0 - x) ** p.end_M + slope(outside, p.end_M, p.start_M))
    return s_A, s_M


def slope(outside: float, at_0: float, at_1: float) -> float:
    """What is added outside 0 to 1, with the slope of that end."""
    return outside * (at_1 if outside > 0.0 else at_0)


EFFECT = Effect(
    name='smooth_transformation',
    title='the smooth beginning and end of transformation',
    port='transformation_stress',
    equation='s_A = width_A (x^end_A - (1 - x)^start_A)/2, s_M = width_M (x^start_M - (1 - x)^end_M)/2',
    source='Lagoudas et al., Int. J. Plast. 32-33 (2012) 155: smooth hardening with exponents, here bounded at the ends',
    parameters=(
        Parameter(
            'width_A', 1e8, 'Pa', (0.0, 1e10), 'rise of sigma_A while martensite forms', neutral=0.0, realistic=(2e6, 2e9)
        ),
        Parameter(
            'width_M', 1e8, 'Pa', (0.0, 1e10), 'fall of sigma_M while it turns back', neutral=0.0, realistic=(2e6, 2e9)
        ),
        Parameter('start_A', 3.0, '-', BOUNDS, 'how gradually martensite begins to form', realistic=USUAL),
        Parameter('end_A', 3.0, '-', BOUNDS, 'how gradually the last of it forms', realistic=USUAL),
        Parameter('start_M', 3.0, '-', BOUNDS, 'how gradually it begins to turn back', realistic=USUAL),
        Parameter('end_M', 3.0, '-', BOUNDS, 'how gradually the last of it turns back', realistic=USUAL),
    ),
    kernel=shifts,
    gradual=True,
    energy='latent heat at the shifted stress: first law with U unchanged; energy stored between grains is left out',
    description='inner loops when the wire turns back half way, inside the full loop',
    signature='plateaus have a slope and round ends, which differ between the ways and between beginning and end',
    confused_with=('polycrystal', 'nucleation_peak', 'wire.dsigma', 'wire.sigma_T', 'temperature_gradient'),
)
