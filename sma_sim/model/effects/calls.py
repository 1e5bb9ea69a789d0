"""How the flow calls the kernels of effects: the state that they read, their extra states, their first values."""

from __future__ import annotations

from sma_sim.model.arrays import Vector
from sma_sim.model.effects.ports import (
    S_CHANNEL,
    S_DEPS,
    S_DX,
    S_EPS,
    S_J,
    S_LENGTH,
    S_NEIGHBOURS,
    S_OTHERS,
    S_POSE,
    S_SIGMA,
    S_STRAIN,
    S_T,
    S_T_E,
    S_T_OTHER,
    S_TIME,
    S_V,
    S_VALUE,
    S_WIRE,
    S_X,
    S_X_OTHER,
    SENSING,
    STRUCTURE_FORCE,
    WIRE_HEAT,
    EffectTable,
    call_effect,
    call_effect_in,
)
from sma_sim.model.layout import O_DEPS, O_DX, O_EPS, O_F, O_J, O_LENGTH, O_SIGMA, O_STRAIN, O_V, O_X, System
from sma_sim.model.material import resistance


def fill_kernel_state(t: float, y: Vector, T_E: float, p: System, obs: Vector) -> None:
    """Fill the state that kernels read, a row per wire, with what is in `y` and `obs`."""
    for i in range(p.wires):
        s = p.effects.s[i]
        s[S_TIME], s[S_T_E], s[S_WIRE], s[S_OTHERS] = t, T_E, i, p.wires - 1
        s[S_T], s[S_T_OTHER] = y[p.first_T + i], other_temperature(i, y, p)
        s[S_X], s[S_X_OTHER] = obs[i, O_X], other_fraction(i, p, obs)
        s[S_EPS], s[S_DEPS] = obs[i, O_EPS], obs[i, O_DEPS]
        s[S_LENGTH], s[S_V], s[S_J] = obs[i, O_LENGTH], obs[i, O_V], obs[i, O_J]
        s[S_SIGMA], s[S_DX] = obs[i, O_SIGMA], obs[i, O_DX]
        for j in range(2 * p.coordinates):
            s[S_POSE + j] = y[j]


def other_temperature(i: int, y: Vector, p: System) -> float:
    """Temperature of the other wire; the mean of the others, of a single wire its own."""
    if p.wires < 3:
        return y[p.first_T + p.wires - 1 - i]
    total = 0.0
    for other in range(p.wires):
        if other != i:
            total += y[p.first_T + other]
    return total / (p.wires - 1)


def other_fraction(i: int, p: System, obs: Vector) -> float:
    """x_M of the other wire, as `other_temperature`."""
    if p.wires < 3:
        return obs[p.wires - 1 - i, O_X]
    total = 0.0
    for other in range(p.wires):
        if other != i:
            total += obs[other, O_X]
    return total / (p.wires - 1)


def fill_kernel_phases(p: System, obs: Vector) -> None:
    """Put the phase fractions and stresses, as soon as they are known, into the state that kernels read."""
    for i in range(p.wires):
        s = p.effects.s[i]
        s[S_X], s[S_X_OTHER], s[S_SIGMA] = obs[i, O_X], other_fraction(i, p, obs), obs[i, O_SIGMA]
        s[S_STRAIN] = obs[i, O_STRAIN]


def add_rates(k: int, instance: int, y: Vector, e: EffectTable, dy: Vector) -> None:
    """Rates of the extra states of one instance of effect `k`."""
    if e.states[k] > 0:
        call_effect(e.rate[k], k, instance, y, e)
        first = e.state_start[k] + instance * e.states[k]
        for j in range(e.states[k]):
            dy[first + j] = e.out[j]


def share_rates(y: Vector, p: System, dy: Vector) -> None:
    """Rates of the extra states of heat that wires share: every copy changes by the mean of what each wire says."""
    e = p.effects
    for k in range(e.port_start[WIRE_HEAT], e.port_start[WIRE_HEAT + 1]):
        if e.shared[k] != 0:
            for i in range(p.wires):
                first = e.state_start[k] + i * e.states[k]
                for j in range(e.states[k]):
                    dy[first + j] = 0.0
                for other in range(p.wires):
                    call_effect_in(e.rate[k], k, other, i, y, e)
                    for j in range(e.states[k]):
                        dy[first + j] += e.out[j] / p.wires


def start_states(y: Vector, p: System, obs: Vector) -> None:
    """Set the extra states of the effects to their first values, for what `fill_kernel_state` has shown."""
    e = p.effects
    for k in range(e.port_start[SENSING]):
        if e.start[k] != 0:
            for instance in range(1 if k >= e.port_start[STRUCTURE_FORCE] else p.wires):
                start_instance(k, instance, y, e)
    if e.port_start[SENSING + 1] > e.port_start[SENSING]:
        for channel in range(p.channels):
            start_sensor(channel, y, p, obs)


def start_sensor(channel: int, y: Vector, p: System, obs: Vector) -> None:
    """First values of the sensing chain of a channel: each effect starts at what those before it show."""
    e = p.effects
    s = e.s[p.wires - 1]
    s[S_VALUE], s[S_CHANNEL] = true_channel(channel, y, p, obs), e.code[channel]
    for k in range(e.port_start[SENSING], e.port_start[SENSING + 1]):
        if e.slot[k, channel] >= 0:
            if e.depends_on_neighbours[k] != 0:
                s[S_NEIGHBOURS] = sum_of_neighbours(channel, y, p, obs)
            if e.start[k] != 0:
                start_instance(k, e.slot[k, channel], y, e)
            call_effect(e.value[k], k, e.slot[k, channel], y, e)
            s[S_VALUE] = e.out[0]


def start_instance(k: int, instance: int, y: Vector, e: EffectTable) -> None:
    """First values of the states of one instance of effect `k`."""
    call_effect(e.start[k], k, instance, y, e)
    for j in range(e.states[k]):
        y[e.state_start[k] + instance * e.states[k] + j] = e.out[j]


def true_channel(channel: int, y: Vector, p: System, obs: Vector) -> float:
    """The true value of a channel: coordinates, forces, temperatures, resistances; of a wire whose strain is imposed,
    stress, T and R. A temperature that is imposed is no channel."""
    n = p.coordinates
    if channel < n:
        return y[channel]
    i = stress_wire(channel, p)
    if channel < n + p.wires:
        return obs[i, O_F] if n > 0 else obs[i, O_F] / (p.wire.n * p.wire.section)
    if i < 0:
        return y[p.first_T + channel - n - p.wires]
    return resistance(0.0 if p.coiled else obs[i, O_EPS], obs[i, O_X], y[p.first_T + i], p.wire)


def sum_of_neighbours(channel: int, y: Vector, p: System, obs: Vector) -> float:
    """Sum of the true values of all other channels of the kind of a channel."""
    total = 0.0
    for other in range(p.channels):
        if other != channel and p.effects.kind[other] == p.effects.kind[channel]:
            total += true_channel(other, y, p, obs)
    return total


def stress_wire(channel: int, p: System) -> int:
    """The wire whose stress and phase a channel needs, its force or its resistance; -1 of coordinates and temperatures."""
    behind_forces = p.coordinates + p.wires
    behind_temperatures = behind_forces + (p.wires if p.imposed_T < 0 else 0)
    if p.coordinates <= channel < behind_forces:
        return channel - p.coordinates
    return channel - behind_temperatures if channel >= behind_temperatures else -1
