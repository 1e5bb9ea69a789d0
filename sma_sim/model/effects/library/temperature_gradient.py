"""A temperature that differs along the specimen: its coldest part transforms to martensite first, and back last.

s_A = s_M = sigma_T dT (x - 1/2)   [Pa],   x = x_M
With a mean temperature T and a linear distribution of width dT, the front lies where the temperature is T + dT (x - 1/2).
"""

from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants


def shifts(s: State, w: WireConstants, p: Any) -> tuple[float, float]:
    """The same shift of both transformation stresses [Pa]."""
    shift = w.sigma_T * p.dT * (s.x - 0.5)
    return shift, shift


EFFECT = Effect(
    name='temperature_gradient',
    title='a difference of temperature along the specimen',
    port='transformation_stress',
    equation='s_A = s_M = sigma_T dT (x_M - 1/2)',
    source='Clausius-Clapeyron line of the wire at the temperature of the front, a linear distribution',
    parameters=(
        Parameter(
            'dT', 1.0, 'K', (0.0, 3.0), 'difference of temperature from end to end', neutral=0.0, realistic=(0.2, 3.0)
        ),
    ),
    kernel=shifts,
    tried='never',
    gradual=True,
    systems=('wire_at_T', 'wire_under_load_at_T'),
    energy='reversible: the front moves with the mean temperature, none is lost',
    description='of the bench, not of the wire: no finding of a diagnosis, but part of its model where it is switched on',
    signature='steps of strain are spread over a few kelvins, alike on both ways and at all loads',
    confused_with=('polycrystal', 'smooth_transformation'),
)
