"""The equations of motion of a structure with its wires: dy/dt = flow(t, y) in a given mode of each wire."""

from __future__ import annotations

from sma_sim.model.arrays import Vector
from sma_sim.model.automaton import ABOVE_A, BELOW_M, EMPTY, FALLING, FULL, TO_AUSTENITE, TO_MARTENSITE
from sma_sim.model.effects.calls import (
    add_rates,
    fill_kernel_phases,
    fill_kernel_state,
    share_rates,
    sum_of_neighbours,
    true_channel,
)
from sma_sim.model.effects.ports import (
    ACTUATION,
    S_CHANNEL,
    S_DX,
    S_F,
    S_J,
    S_NEIGHBOURS,
    S_STRAIN,
    S_T,
    S_VALUE,
    S_X,
    SENSING,
    STRUCTURE_FORCE,
    TRANSFORMATION_STRESS,
    WIRE_FORCE,
    WIRE_HEAT,
    EffectTable,
    call_effect,
    call_kernel,
)
from sma_sim.model.kinetics import mas_rate
from sma_sim.model.layout import (
    O_DEPS,
    O_DX,
    O_EPS,
    O_F,
    O_J,
    O_LENGTH,
    O_RATIO,
    O_S_A,
    O_S_M,
    O_SIGMA,
    O_STRAIN,
    O_V,
    O_X,
    Evaluation,
    InputPoint,
    System,
    SystemState,
)
from sma_sim.model.material import heat_capacity, latent_heat
from sma_sim.model.transformation import HeatBalance, fraction_rate, phase_and_stress

# What of the flow changes with a state: bits. Those of the next wire follow those of wire 1.
LENGTHS, SPEEDS, STRESS_1, RATES_1, PER_WIRE_BITS = 1, 2, 8, 16, 2
WIRE_1 = STRESS_1 | RATES_1
EVERY_WIRE = (1 << 62) - STRESS_1
EVERYTHING = LENGTHS | SPEEDS | EVERY_WIRE


def flow(t: float, state: SystemState, point: InputPoint, p: System, dy: Vector, obs: Vector) -> None:
    """Write dy/dt into `dy` (n,) and what is found on the way into `obs` (`Evaluation`)."""
    update_flow(t, state, point, p, Evaluation(dy, obs), EVERYTHING)


def depends_on(j: int, state: SystemState, p: System) -> int:
    """What of the flow depends on state `j`, for `update_flow`."""
    any_effect = p.effects.port_start[-1] > 0
    if j < p.coordinates:
        return EVERYTHING
    if j < 2 * p.coordinates:
        moving = SPEEDS
        for i in range(p.wires):
            if any_effect or not p.mas and (state.mode[i] == TO_MARTENSITE or state.mode[i] == TO_AUSTENITE):
                moving |= RATES_1 << PER_WIRE_BITS * i
        return moving
    if any_effect:
        return EVERY_WIRE
    i = j - p.first_T if j < p.first_T + p.wires else j - p.first_x
    return WIRE_1 << PER_WIRE_BITS * i


def update_flow(t: float, state: SystemState, point: InputPoint, p: System, found: Evaluation, changed: int) -> None:
    """Evaluate the flow into `found`, of which only what `changed` says differs from what it holds already.

    `changed` is EVERYTHING, or what `depends_on` says of a state when all else is as it was.
    """
    y, e, dy, obs = state.y, p.effects, found.dy, found.obs
    T_E = ambient_temperature(point.u, p)
    any_effect = e.port_start[-1] > 0
    if changed & LENGTHS:
        kinematics(y, point, p, obs)
    if changed & SPEEDS and p.coordinates > 0:
        speeds(y, p, obs)
    for i in range(p.wires):
        obs[i, O_J] = commanded_heating(i, point.u, p)
    if any_effect:
        fill_kernel_state(t, y, T_E, p, obs)
    for i in range(p.wires):
        if any_effect or changed & (STRESS_1 << PER_WIRE_BITS * i):
            stress_and_force(i, state, p, obs)
    if any_effect:
        fill_kernel_phases(p, obs)
        for i in range(p.wires):
            obs[i, O_J] = heating(i, y, p, obs, dy)
    for i in range(p.wires):
        if any_effect or changed & (RATES_1 << PER_WIRE_BITS * i):
            wire_rates(i, state, point, p, dy, obs)
        if any_effect:
            obs[i, O_F] = p.wire.n * force_passed_on(i, y, p, obs, dy)
    if any_effect:
        share_rates(y, p, dy)
    if p.coordinates > 0:
        motion(y, point.u, p, dy, obs)
    if sensors_remember(e):
        sensing_rates(y, p, dy, obs)


def update_guards(t: float, state: SystemState, point: InputPoint, p: System, found: Evaluation) -> None:
    """Evaluate what `guard` reads into ``found.obs``, with effects the whole flow."""
    if p.effects.port_start[-1] > 0:
        update_flow(t, state, point, p, found, EVERYTHING)
        return
    y, obs = state.y, found.obs
    kinematics(y, point, p, obs)
    moving = False
    for i in range(p.wires):
        stress_and_force(i, state, p, obs)
        moving = moving or state.mode[i] == TO_MARTENSITE or state.mode[i] == TO_AUSTENITE
    if moving and p.coordinates > 0:
        speeds(y, p, obs)
    for i in range(p.wires):
        if state.mode[i] == TO_MARTENSITE or state.mode[i] == TO_AUSTENITE:
            obs[i, O_J] = commanded_heating(i, point.u, p)
            wire_rates(i, state, point, p, found.dy, obs)


def update_forces(state: SystemState, point: InputPoint, p: System, obs: Vector, wires: int) -> None:
    """x_M, stress and force of the wires whose STRESS bit is in `wires`, where no effect acts on them, into `obs`."""
    kinematics(state.y, point, p, obs)
    for i in range(p.wires):
        if wires & (STRESS_1 << PER_WIRE_BITS * i):
            stress_and_force(i, state, p, obs)


def stress_and_force(i: int, state: SystemState, p: System, obs: Vector) -> None:
    """x_M, stress and the force of wire `i` before the effects on it."""
    phase_and_stress(i, state, p, obs)
    obs[i, O_F] = p.wire.n * (p.wire.section * obs[i, O_SIGMA] * obs[i, O_RATIO])


def ambient_temperature(u: Vector, p: System) -> float:
    """T_E [K] of an input, its last entry."""
    return u[u.shape[0] - 1]


def kinematics(y: Vector, point: InputPoint, p: System, obs: Vector) -> None:
    """Length and strain of each wire with their derivatives from the pose; of a single wire from the input."""
    if p.coordinates > 0:
        at = p.structure
        call_kernel(at.kinematics_at, y.ctypes.data, at.constants.ctypes.data, at.effects.ctypes.data, 0, obs.ctypes.data)
        return
    obs[0, O_EPS], obs[0, O_DEPS], obs[0, O_RATIO] = point.u[0], point.du[0], 1.0
    obs[0, O_LENGTH], obs[0, O_V] = p.wire.l0 * (1.0 + point.u[0]), p.wire.l0 * point.du[0]


def speeds(y: Vector, p: System, obs: Vector) -> None:
    """Rates of length and strain of each wire."""
    at = p.structure
    call_kernel(at.speeds_at, y.ctypes.data, at.constants.ctypes.data, at.effects.ctypes.data, 0, obs.ctypes.data)


def commanded_heating(i: int, u: Vector, p: System) -> float:
    """Heating of one wire [W] before the actuation chain: a bundle's power is shared by its wires.

    Of an antagonistic pair, J_eq > 0 heats the first bundle, J_eq < 0 the second. Where the strain is imposed, J heats the
    wire.
    """
    if p.coordinates == 0:
        return u[p.drives]
    if p.antagonistic:
        J = u[p.drives + i // 2]
        side = J if i % 2 == 0 else -J
        return max(side, 0.0) / p.wire.n
    return max(u[p.drives + i], 0.0) / p.wire.n


def heating(i: int, y: Vector, p: System, obs: Vector, dy: Vector) -> float:
    """Heating of one wire [W] after the actuation chain."""
    J = obs[i, O_J]
    e = p.effects
    if e.port_start[ACTUATION + 1] > e.port_start[ACTUATION]:
        for k in range(e.port_start[ACTUATION], e.port_start[ACTUATION + 1]):
            add_rates(k, i, y, e, dy)
            call_effect(e.value[k], k, i, y, e)
            J = e.out[0]
            e.s[i, S_J] = J
    return J


def wire_rates(i: int, state: SystemState, point: InputPoint, p: System, dy: Vector, obs: Vector) -> None:
    """dT/dt and dx_M/dt of wire `i` (MAS9, L3; X4 to X8 as the total derivative of sigma = sigma_A or sigma_M)."""
    y, mode, w = state.y, state.mode[i], p.wire
    T, x, sigma = y[p.first_T + i], obs[i, O_X], obs[i, O_SIGMA]
    dx = 0.0
    if p.mas:
        dx = mas_rate(sigma, x, T, obs[i, O_S_A], obs[i, O_S_M], w)
        dy[p.first_x + i] = dx
    transforming = not p.mas and (mode == TO_MARTENSITE or mode == TO_AUSTENITE)
    if p.imposed_T >= 0:  # whatever heat it takes
        heat, capacity, latent = point.du[p.imposed_T + i], 1.0, 0.0
    else:
        T_E = ambient_temperature(point.u, p)
        heat = obs[i, O_J] - w.lambda_ * w.surface * (T - T_E) + extra_heat(i, dx, y, p)
        capacity = heat_capacity(T, x, w) + extra_capacity(p)
        latent = latent_heat(T, sigma, w)
        if transforming:
            latent += extra_latent_heat(i, 1.0 if mode == TO_MARTENSITE else -1.0, y, p)
    if transforming:
        dx = fraction_rate(i, HeatBalance(heat, capacity, latent), mode, y, p, obs)
    obs[i, O_DX] = dx
    dy[p.first_T + i] = (heat + latent * dx) / capacity


def extra_heat(i: int, dx: float, y: Vector, p: System) -> float:
    """Heat that effects bring into wire `i` [W] while it transforms at the rate `dx`; keeps the capacities that they add."""
    e = p.effects
    heat = 0.0
    if e.port_start[WIRE_HEAT + 1] > e.port_start[WIRE_HEAT]:
        e.s[i, S_DX] = dx
        for k in range(e.port_start[WIRE_HEAT], e.port_start[WIRE_HEAT + 1]):
            call_effect(e.value[k], k, i, y, e)
            heat += e.out[0]
            e.contribution[k, 0] = e.out[1]
    return heat


def extra_capacity(p: System) -> float:
    """Heat capacity [J/K] that effects add to the wire whose `extra_heat` was found last."""
    e = p.effects
    capacity = 0.0
    for k in range(e.port_start[WIRE_HEAT], e.port_start[WIRE_HEAT + 1]):
        capacity += e.contribution[k, 0]
    return capacity


def extra_latent_heat(i: int, sign: float, y: Vector, p: System) -> float:
    """Heat that effects bring into wire `i` per unit of x_M [J], for dx_M/dt of the given sign (1 or -1)."""
    e = p.effects
    latent = 0.0
    for k in range(e.port_start[WIRE_HEAT], e.port_start[WIRE_HEAT + 1]):
        if e.depends_on_dx[k] != 0:
            e.s[i, S_DX] = sign
            call_effect(e.value[k], k, i, y, e)
            latent += e.out[0] * sign
            e.s[i, S_DX] = 0.0
            call_effect(e.value[k], k, i, y, e)
            latent -= e.out[0] * sign
    return latent


def force_passed_on(i: int, y: Vector, p: System, obs: Vector, dy: Vector) -> float:
    """Force of one wire on the structure [N] (MAS4; Om sigma deps/dl, by virtual work), and the rates of the memory of heat,
    strain and stress effects."""
    e = p.effects
    force = p.wire.section * obs[i, O_SIGMA] * obs[i, O_RATIO]
    if e.port_start[WIRE_FORCE + 1] > e.port_start[WIRE_HEAT]:
        s = e.s[i]
        s[S_T], s[S_X], s[S_STRAIN] = y[p.first_T + i], obs[i, O_X], obs[i, O_STRAIN]  # others were tried for their rates
        s[S_DX], s[S_F] = obs[i, O_DX], force
        for k in range(e.port_start[WIRE_HEAT], e.port_start[TRANSFORMATION_STRESS + 1]):
            add_rates(k, i, y, e, dy)
        for k in range(e.port_start[WIRE_FORCE], e.port_start[WIRE_FORCE + 1]):
            add_rates(k, i, y, e, dy)
            call_effect(e.value[k], k, i, y, e)
            force += e.out[0]
    return force


def motion(y: Vector, u: Vector, p: System, dy: Vector, obs: Vector) -> None:
    """Motion of the structure under its own forces, the wires (tau = -J^T F) and the effects on it."""
    e, at, first = p.effects, p.structure, p.drives + 1
    for k in range(p.drives):
        at.effects[k] = u[k]
    count = 0
    for k in range(e.port_start[STRUCTURE_FORCE], e.port_start[STRUCTURE_FORCE + 1]):
        add_rates(k, 0, y, e, dy)
        call_effect(e.value[k], k, 0, y, e)
        for j in range(p.coordinates):
            at.effects[first + count * p.coordinates + j] = e.out[j]
        count += 1
    at.effects[p.drives] = count
    call_kernel(
        at.motion_at, y.ctypes.data, at.constants.ctypes.data, at.effects.ctypes.data, obs.ctypes.data, dy.ctypes.data
    )


def sensed_channel(channel: int, y: Vector, p: System, obs: Vector, dy: Vector) -> float:
    """What the sensor of a channel shows after the sensing chain; the chain's rates go into `dy`."""
    e = p.effects
    s = e.s[p.wires - 1]
    value = true_channel(channel, y, p, obs)
    s[S_CHANNEL] = e.code[channel]
    for k in range(e.port_start[SENSING], e.port_start[SENSING + 1]):
        if e.slot[k, channel] >= 0:
            s[S_VALUE] = value
            if e.depends_on_neighbours[k] != 0:
                s[S_NEIGHBOURS] = sum_of_neighbours(channel, y, p, obs)
            add_rates(k, e.slot[k, channel], y, e, dy)
            call_effect(e.value[k], k, e.slot[k, channel], y, e)
            value = e.out[0]
    return value


def sensors_remember(e: EffectTable) -> bool:
    """Whether any effect on sensors has states: the rates of all other ones are none of the flow."""
    for k in range(e.port_start[SENSING], e.port_start[SENSING + 1]):
        if e.states[k] > 0:
            return True
    return False


def sensing_rates(y: Vector, p: System, dy: Vector, obs: Vector) -> None:
    """Rates of the sensing chain's states."""
    for channel in range(p.channels):
        sensed_channel(channel, y, p, obs, dy)


def guard(which: int, i: int, p: System, obs: Vector) -> float:
    """Value of a guard of the automaton: positive when violated (stress ones relative to dsigma)."""
    if which == ABOVE_A:
        return (obs[i, O_SIGMA] - obs[i, O_S_A]) / p.wire.dsigma
    if which == BELOW_M:
        return (obs[i, O_S_M] - obs[i, O_SIGMA]) / p.wire.dsigma
    if which == FULL:
        return obs[i, O_X] - 1.0
    if which == EMPTY:
        return -obs[i, O_X]
    if which == FALLING:
        return -obs[i, O_DX]
    return obs[i, O_DX]
