"""Where a thermometer on a wire shows how fast it warms up: heat capacity and heat transfer to start a fit from.

Without latent heat the balance of heat of a wire is rho c_V V dT/dt = J - lambda A (T - T_E) (MAS9), whose integral
is linear in a = 1/(rho c_V V) and b = lambda A a, so that a linear regression finds both, however far they are from nominal.
A fit that starts where the wire would have been warm long before the first sample has no slope that leads to them.
"""

from __future__ import annotations

import numpy as np

from sma_sim.evidence.data.recording import Dataset, Recording
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.config import Config
from sma_sim.model.parameters import wire_constants
from sma_sim.solver.inputs import Input, command_column

TEMPERATURE = 'T'  # the channel of a single wire's thermometer
MIN_SAMPLES = 5  # of a recording: two coefficients and its own zero, and some that scatter


def shown_by_warming(dataset: Dataset, config: Config) -> dict[str, float]:
    """c_V [J/(kg K)] and lambda [W/(m^2 K)] as the temperatures of single wires that are heated show them; {} where they do
    not."""
    rows = [balance(one) for one in dataset.recordings if is_warmed(one)]
    if not rows:
        return {}
    terms, change = np.hstack([terms for terms, _ in rows]), np.concatenate([change for _, change in rows])
    scale = np.sqrt((terms**2).mean(axis=1))
    if not (scale > 0.0).all():
        return {}
    a, b = np.linalg.lstsq((terms / scale[:, None]).T, change, rcond=None)[0] / scale
    wire = wire_constants(config.parameters)
    if a <= 0.0 or b <= 0.0:
        return {}
    return {'wire.c_V': float(1.0 / (a * wire.rho * wire.volume)), 'wire.lambda': float(b / (a * wire.surface))}


def is_warmed(recording: Recording) -> bool:
    """Whether a recording shows the temperature of a single wire whose heating was commanded."""
    structure = recording.structure
    if structure.wires != 1 or structure.imposed_temperature >= 0 or TEMPERATURE not in recording.channels:
        return False
    return int(np.isfinite(recording.channels[TEMPERATURE]).sum()) >= MIN_SAMPLES


def balance(recording: Recording) -> tuple[Matrix, Vector]:
    """The integrals of J and of T_E - T over time (2, k) and the temperatures (k,), without their means."""
    known = np.isfinite(recording.channels[TEMPERATURE])
    time, T = np.asarray(recording.time)[known], np.asarray(recording.channels[TEMPERATURE])[known]
    command = command_column(recording.source)
    heat, room = (integral(recording.source, column, time) for column in (command, command + 1))
    lost = np.concatenate([[0.0], np.cumsum(0.5 * (T[1:] + T[:-1]) * np.diff(time))])
    terms = np.array([heat, room - lost])
    return terms - terms.mean(axis=1, keepdims=True), T - T.mean()


def integral(source: Input, column: int, time: Vector) -> Vector:
    """The integral (k,) over time of a held column of an input, from its start."""
    times, values = np.asarray(source.times, float), np.asarray(source.values, float)[:, column]
    found: Vector = np.interp(time, times, np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(times))]))
    return found
