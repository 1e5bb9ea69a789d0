"""What a missing quantity may look like: covariances of its values at the knots, by time and by what it may depend on.

Beside a course that is merely smooth in time, a law of one state (of the temperature, say) is believed possible: its values
then agree wherever that state does, in all runs and on both wires. Which one holds is for the evidence to say.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
TIMES = (2.0, 10.0, 50.0)  # [s] in which a course changes
WIDTHS = (0.15, 0.5, 1.5)  # of a law, in standard deviations of the state
HOT = 20.0  # [K]: unit of temperature above ambient
LAWS = {
    'structure_force': (('alpha',),),
    'wire_heat': (('T',), ('x',), ('T', 'x')),
    'wire_strain': (('T',), ('x',), ('T', 'x')),
    'transformation_stress': (('T',), ('x',), ('T', 'x')),
    'actuation': (('J',),),
    'sensing': (('value',),),
}  # fmt: skip


@dataclass(frozen=True)
class Points:
    """Where values are unknown: run, wire, time [s] and the states there, (m,) each, by run and then by port."""

    run: Vector
    wire: Vector
    t: Vector
    states: Mapping[str, Vector]


def in_time(t: Vector, scale: float) -> Matrix:
    """exp(-|t - t'|/scale): continuous, with corners and steep parts allowed."""
    decay: Matrix = np.exp(-np.abs(t[:, None] - t) / scale)
    return decay


def of_states(points: Points, law: tuple[str, ...], width: float) -> Matrix:
    """exp of minus half the squared distance of the states in units of their spread."""
    distance = np.zeros((len(points.t), len(points.t)))
    for name in law:
        state = points.states[name]
        distance += ((state[:, None] - state) / (width * (float(np.std(state)) or 1.0))) ** 2
    return np.exp(-0.5 * distance)


def covariances(hook: str, points: Points) -> dict[str, Matrix]:
    """The covariances (m, m) that are tried at a port, by what they say in words; of size 1.

    Heat may also be in proportion to the temperature above ambient.
    """
    alone = (points.run[:, None] == points.run) & (points.wire[:, None] == points.wire)
    same_wire = points.wire[:, None] == points.wire
    found = {}
    for scale in TIMES:
        decay = in_time(points.t, scale)
        found[f'time, {scale:g} s'] = decay * alone
        found[f'time of the run, {scale:g} s'] = decay * same_wire
        if hook == 'wire_heat':
            hot = points.states['T'] / HOT
            found[f'T times time, {scale:g} s'] = decay * np.outer(hot, hot)
        if hook == 'actuation':
            found[f'both, time of the run, {scale:g} s'] = decay
    for law in LAWS[hook]:
        for width in WIDTHS:
            found[f'{" and ".join(law)}, {width:g}'] = of_states(points, law, width)
    return found
