"""Effects that are a given function of time, through values at equally spaced knots, flat at each of them.

`wire` chooses the wire in which one acts, its scope the coordinate. Electrical heating differs from the command by a part of
it, not by watts: what a supply loses steps where the command steps, and vanishes where nothing is commanded. A strain and a
shift of both transformation stresses are states, so that their rates enter the rate of x_M (docs/explanation/physics.md).
"""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from sma_sim.model.effects.effect import Effect
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


def given_in_time(name: str, port: str, unit: str, equation: str, **fields: Any) -> Effect:
    """An effect at a port whose values at the knots have a unit; `fields`: others of `Effect`, the kernel among them."""
    source = 'a basis, not a law of nature'
    parameters = knot_parameters(unit)
    return Effect(name=f'latent_{name}', port=port, equation=equation, source=source, parameters=parameters, **fields)


def given_as_state(name: str, port: str, unit: str, scale: float, kernel: Any) -> Effect:
    """One that is a state of a usual size `scale`."""
    return given_in_time(
        name,
        port,
        unit,
        'du/dt = derivative of the time function',
        states=('u',),
        scale=(scale,),
        rate=lambda s, w, p, m: time_function_rate(s.t, p) if s.wire == p.wire else 0.0,
        start=lambda s, w, p: time_function(s.t, p) if s.wire == p.wire else 0.0,
        kernel=kernel,
        energy='does not enter',
    )


@cache
def time_function_effects() -> dict[str, Effect]:
    """The effects by the port of effects on which they act; the one along K q by ``stiffness``."""
    effects = {
        'structure_force': given_in_time(
            'force',
            'structure_force',
            'N, N m',
            'F = u(t)',
            needs=('coordinate',),
            kernel=lambda s, b, p: time_function(s.t, p),
        ),
        'stiffness': given_in_time(
            'stiffness',
            'structure_force',
            '-',
            'F = u(t) K q',
            needs=('coordinate', 'stiffness'),
            kernel=lambda s, b, p, stiffness: stiffness(s.q, b, time_function(s.t, p)),
        ),
        'wire_heat': given_in_time(
            'heat',
            'wire_heat',
            'W',
            'Q = u(t)',
            kernel=lambda s, w, p: time_function(s.t, p) if s.wire == p.wire else 0.0,
        ),
        'actuation': given_in_time(
            'power',
            'actuation',
            '-',
            'P = J (1 + u(t))',
            stage='gain',
            kernel=lambda s, w, p: s.J * (1.0 + time_function(s.t, p)) if s.wire == p.wire else s.J,
        ),
        'wire_strain': given_as_state('strain', 'wire_strain', '-', 1e-3, lambda s, w, p, m: m.u),
        'transformation_stress': given_as_state('stress', 'transformation_stress', 'Pa', 1e6, lambda s, w, p, m: (m.u, m.u)),
    }
    return {hook: replace(effect, files=(Path(__file__),)) for hook, effect in effects.items()}
