"""Prior covariances of a missing input at the knots: by time, and by the states on which it may depend.

Beside a function that is merely smooth in time, a law of one state (of the temperature, say) is possible: its values
agree wherever that state does, in all runs and on both wires. The evidence decides between them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sma_sim.model.arrays import Matrix, Vector

CORRELATION_TIMES = (2.0, 10.0, 50.0)  # [s]: from the spacing of the knots to half a run
LENGTH_SCALES = (0.15, 0.5, 1.5)  # of a law, in standard deviations of the state: from steep to nearly linear
TEMPERATURE_UNIT = 20.0  # [K] above ambient at which heat in proportion to the temperature has size 1
STATE_DEPENDENCES = {  # of a force: the coordinate that its port names
    'wire_heat': (('T',), ('x',), ('T', 'x')),
    'wire_strain': (('T',), ('x',), ('T', 'x')),
    'transformation_stress': (('T',), ('x',), ('T', 'x')),
    'actuation': (('J',),),
    'sensing': (('value',),),
}


@dataclass(frozen=True)
class KnotStates:
    """For each unknown value its run, wire, time [s] and the model's states there, (m,) each, by run and then by port."""

    run: Vector
    wire: Vector
    t: Vector
    states: Mapping[str, Vector]


def exponential_covariance(t: Vector, correlation_time: float) -> Matrix:
    """exp(-|t - t'|/tau) (m, m): continuous, with corners and steep parts allowed."""
    return np.exp(-np.abs(t[:, None] - t) / correlation_time)


def state_covariance(knots: KnotStates, names: tuple[str, ...], length_scale: float) -> Matrix:
    """exp of minus half the squared distance of the states in units of their spread, (m, m)."""
    distance = np.zeros((len(knots.t), len(knots.t)))
    for name in names:
        state = knots.states[name]
        distance += ((state[:, None] - state) / (length_scale * (float(np.std(state)) or 1.0))) ** 2
    return np.exp(-0.5 * distance)


def prior_covariances(hook: str, knots: KnotStates) -> dict[str, Matrix]:
    """The candidate covariances (m, m) at a port, of size 1, by a description in words.

    Heat may also be in proportion to the temperature above ambient.
    """
    same_wire = knots.wire[:, None] == knots.wire
    same_wire_and_run = (knots.run[:, None] == knots.run) & same_wire
    covariances = {}
    for time in CORRELATION_TIMES:
        decay = exponential_covariance(knots.t, time)
        covariances[f'time, {time:g} s'] = decay * same_wire_and_run
        covariances[f'time of the run, {time:g} s'] = decay * same_wire
        if hook == 'wire_heat':
            above_ambient = knots.states['T'] / TEMPERATURE_UNIT
            covariances[f'T times time, {time:g} s'] = decay * np.outer(above_ambient, above_ambient)
        if hook == 'actuation':
            covariances[f'both, time of the run, {time:g} s'] = decay
    for names in STATE_DEPENDENCES.get(hook, (tuple(knots.states),)):
        for scale in LENGTH_SCALES:
            covariances[f'{" and ".join(names)}, {scale:g}'] = state_covariance(knots, names, scale)
    return covariances
