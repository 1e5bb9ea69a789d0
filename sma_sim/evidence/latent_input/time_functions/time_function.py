"""A function of time through values at equally spaced knots, flat at each of them. `wire` chooses where it acts."""

import math
from typing import Any

from sma_sim.model.parameters import Parameter
from sma_sim.model.structures.structure import MAX_WIRES

KNOT_COUNT = 101
UNBOUNDED = (-1e30, 1e30)
LOCATION_PARAMETERS = (
    Parameter('first', 0.0, 's', UNBOUNDED, 'instant of the first knot'),
    Parameter('spacing', 1.0, 's', (1e-6, 1e30), 'from knot to knot'),
    Parameter('wire', 0.0, '-', (0.0, MAX_WIRES - 1.0), 'wire in which it acts, from 0'),
)
FIRST_VALUE = len(LOCATION_PARAMETERS)  # index of the value at knot 0 among the parameters


def knot_parameters(unit: str) -> tuple[Parameter, ...]:
    """The first knot, the spacing, where it acts, and the values at the knots in `unit`."""
    values = (Parameter(f'u_{k}', 0.0, unit, UNBOUNDED, f'value at knot {k}', neutral=0.0) for k in range(KNOT_COUNT))
    return *LOCATION_PARAMETERS, *values


def time_function(t: float, p: Any) -> float:
    """The value at t: cos^2 from knot to knot, constant beyond the first and the last."""
    at = min(max((t - p.first) / p.spacing, 0.0), KNOT_COUNT - 1.000001)
    k = int(at)
    part = math.sin(0.5 * math.pi * (at - k)) ** 2
    value: float = p[FIRST_VALUE + k] * (1.0 - part) + p[FIRST_VALUE + 1 + k] * part
    return value


def time_function_rate(t: float, p: Any) -> float:
    """Its derivative by t [1/s]."""
    at = (t - p.first) / p.spacing
    if at <= 0.0 or at >= KNOT_COUNT - 1:
        return 0.0
    k = int(at)
    step = p[FIRST_VALUE + 1 + k] - p[FIRST_VALUE + k]
    rate: float = step * 0.5 * math.pi * math.sin(math.pi * (at - k)) / p.spacing
    return rate
