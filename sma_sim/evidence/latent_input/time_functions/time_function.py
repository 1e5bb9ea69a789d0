"""A time course through values at equally spaced knots, flat at each of them. `wire` chooses where it acts."""

import math
from typing import Any

from sma_sim.model.parameters import Parameter

KNOTS = 101
WIDE = (-1e30, 1e30)
WHERE = (
    Parameter('first', 0.0, 's', WIDE, 'instant of the first knot', '', None),
    Parameter('spacing', 1.0, 's', (1e-6, 1e30), 'from knot to knot', '', None),
    Parameter('wire', 0.0, '-', (0.0, 3.0), 'wire 0 or 1; coordinate 0, 1 or 2 of the pose, 3 along K q', '', None),
)
HEAD = len(WHERE)


def values(unit: str) -> tuple[Parameter, ...]:
    """Where, when, and the values at the knots."""
    return *WHERE, *(Parameter(f'u_{k}', 0.0, unit, WIDE, f'value at knot {k}', '', 0.0) for k in range(KNOTS))


def time_function(t: float, p: Any) -> float:
    """The value at t: cos^2 from knot to knot, constant beyond the first and the last."""
    at = min(max((t - p.first) / p.spacing, 0.0), KNOTS - 1.000001)
    k = int(at)
    part = math.sin(0.5 * math.pi * (at - k)) ** 2
    value: float = p[HEAD + k] * (1.0 - part) + p[HEAD + 1 + k] * part
    return value


def slope(t: float, p: Any) -> float:
    """Its derivative by t [1/s]."""
    at = (t - p.first) / p.spacing
    if at <= 0.0 or at >= KNOTS - 1:
        return 0.0
    k = int(at)
    value: float = (p[HEAD + 1 + k] - p[HEAD + k]) * 0.5 * math.pi * math.sin(math.pi * (at - k)) / p.spacing
    return value
