"""Samples: of sensor channels and of what the wires do: only what they show is evaluated."""

from __future__ import annotations

from sma_sim.model.arrays import Integers, Matrix, Vector
from sma_sim.model.automaton import observed_mode
from sma_sim.model.effects.calls import stress_wire, true_channel
from sma_sim.model.effects.ports import SENSING, TRANSFORMATION_STRESS, WIRE_FORCE, WIRE_STRAIN
from sma_sim.model.kinetics import mas_rate
from sma_sim.model.layout import O_S_A, O_S_M, O_SIGMA, O_X, InputPoint, System, SystemState
from sma_sim.model.system import (
    EVERYTHING,
    PER_WIRE_BITS,
    STRESS_1,
    sensed_channel,
    update_flow,
    update_forces,
)
from sma_sim.solver.stepper import Segment, input_at
from sma_sim.solver.work import Work

RESTING_RATE = 1e-5  # |dx_M/dt| [1/s] below which a MAS wire is seen as resting


def needed_for(numbers: Integers, p: System) -> int:
    """What samples of these `numbers` (solver.columns) need: EVERYTHING, or the STRESS bits of wires (`update_forces`)."""
    e, needed = p.effects, 0
    for number in numbers:
        if number < p.channels:
            for k in range(e.port_start[SENSING], e.port_start[SENSING + 1]):
                if e.slot[k, number] >= 0:
                    return EVERYTHING
        i = wire_evaluated(number, p)
        if i >= 0 and (
            e.port_start[TRANSFORMATION_STRESS + 1] > e.port_start[WIRE_STRAIN]
            or e.port_start[WIRE_FORCE + 1] > e.port_start[WIRE_FORCE]
        ):
            return EVERYTHING
        if i >= 0:
            needed |= STRESS_1 << PER_WIRE_BITS * i
    return needed


def wire_evaluated(number: int, p: System) -> int:
    """The wire whose stress and phase a number shows, -1 where it shows a state."""
    if number < p.channels:
        return stress_wire(number, p)
    return (number - p.channels) % p.wires if number < p.channels + 2 * p.wires else -1


def sample_numbers(
    t: float, state: SystemState, segment: Segment, p: System, w: Work, numbers: Integers, needed: int, row: Vector
) -> None:
    """A sample of these `numbers` (solver.columns); `needed` is what `needed_for` says of them."""
    if needed != 0:
        input_at(t, segment, w.u)
        point = InputPoint(w.u, segment.du)
        if needed == EVERYTHING:
            update_flow(t, state, point, p, w.sample, needed)
        else:
            update_forces(state, point, p, w.sample.obs, needed)
    for k in range(numbers.shape[0]):
        number = numbers[k]
        if number >= p.channels:
            row[k] = wire_number(number - p.channels, state, p, w.sample.obs)
        elif needed == EVERYTHING:
            row[k] = sensed_channel(number, state.y, p, w.sample.obs, w.sample.dy)
        else:
            row[k] = true_channel(number, state.y, p, w.sample.obs)


def state_number(number: int, state: SystemState) -> float:
    """A number of the state: of its y, then the modes, then the frozen fractions."""
    value: float
    n, wires = state.y.shape[0], state.mode.shape[0]
    if number < n:
        value = state.y[number]
    elif number < n + wires:
        value = state.mode[number - n]
    else:
        value = state.x_frozen[number - n - wires]
    return value


def wire_number(number: int, state: SystemState, p: System, obs: Matrix) -> float:
    """x_M, mode and T of the wires, numbered in this order, wire by wire, then the state as it is: y, modes, x_frozen."""
    value: float
    i = number - p.wires
    if i >= 2 * p.wires:
        return state_number(i - 2 * p.wires, state)
    if i < 0:
        value = obs[number, O_X]
        return value
    if i >= p.wires:
        value = state.y[p.first_T + i - p.wires]
        return value
    if not p.mas:
        value = state.mode[i]
        return value
    T = state.y[p.first_T + i]
    dx = mas_rate(obs[i, O_SIGMA], obs[i, O_X], T, obs[i, O_S_A], obs[i, O_S_M], p.wire)
    return observed_mode(obs[i, O_X], dx, RESTING_RATE)
