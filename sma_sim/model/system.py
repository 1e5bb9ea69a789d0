"""The equations of motion of the module and of the single wire: dy/dt = flow(t, y) in a given mode of each wire.

State vector y: module (U_x, U_y, alpha, their rates, T_1, T_2), wire (T); then, for the MAS model, x_M of each
wire; then the extra states of the active effects. Inputs u: module (J_eq, T_E); wire (strain, J, T_E). `du` is the
slope of u. `mode` and `x_frozen` are the discrete states of the hybrid model, one per wire.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.automaton import ABOVE_A, BELOW_M, EMPTY, FALLING, FULL, TO_AUSTENITE, TO_MARTENSITE
from sma_sim.model.beam import beam_forces, wire_length
from sma_sim.model.effects.ports import (
    ACTUATION,
    S_CHANNEL,
    S_DEPS,
    S_DX,
    S_EPS,
    S_F,
    S_J,
    S_LENGTH,
    S_POSE,
    S_SIGMA,
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
    TRANSFORMATION_STRESS,
    WIRE_FORCE,
    WIRE_HEAT,
    WIRE_STRAIN,
    EffectTable,
    call_effect,
)
from sma_sim.model.kinetics import mas_rate
from sma_sim.model.material import (
    compliance,
    fraction_at_stress,
    heat_capacity,
    latent_heat,
    sigma_A,
    sigma_M,
    stress,
)
from sma_sim.model.parameters import BeamConstants, WireConstants

Vector = NDArray[np.float64]
Modes = NDArray[np.int64]

# Columns of `obs`, a row per wire: what the flow finds on its way.
O_LENGTH, O_V, O_EPS, O_DEPS, O_J, O_X, O_STRAIN, O_SIGMA, O_S_A, O_S_M, O_DX, O_F, O_DL, O_SIZE = (
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 15,
)  # fmt: skip
X_STEP, T_STEP = 1e-5, 1e-2  # for the partial derivatives of strain and stress offsets of effects
NEWTON_STEPS = 40


class System(NamedTuple):
    """Everything that the flow needs and that does not change during a run."""

    module: bool  # else a single wire on a test bench
    mas: bool  # else the hybrid model
    wires: int
    first_T: int  # index of T_1 in y
    first_x: int  # index of x_M of wire 1 in y (MAS)
    wire: WireConstants
    beam: BeamConstants
    effects: EffectTable


def flow(
    t: float, y: Vector, u: Vector, du: Vector, mode: Modes, x_frozen: Vector, p: System, dy: Vector, obs: Vector
) -> None:
    """Write dy/dt into `dy` (n,) and what is found on the way into `obs` (wires, O_SIZE)."""
    T_E = u[1] if p.module else u[2]
    if p.effects.port_start[-1] > 0:
        share_state(t, y, T_E, p)
    kinematics(y, u, du, p, obs)
    for i in range(p.wires):
        obs[i, O_J] = heating(i, y, u, p, obs, dy)
        phase_and_stress(i, y, mode[i], x_frozen[i], p, obs)
    for i in range(p.wires):
        wire_rates(i, y, T_E, mode[i], p, dy, obs)
        obs[i, O_F] = p.wire.n * force_passed_on(i, y, p, obs, dy)
    if p.module:
        accelerations(y, p, dy, obs)
    if p.effects.port_start[SENSING + 1] > p.effects.port_start[SENSING]:
        sensing_rates(y, p, dy, obs)


def share_state(t: float, y: Vector, T_E: float, p: System) -> None:
    """Put what does not depend on the wire into the state that kernels read."""
    s = p.effects.s
    s[S_TIME], s[S_T_E] = t, T_E
    if p.module:
        for j in range(6):
            s[S_POSE + j] = y[j]


def kinematics(y: Vector, u: Vector, du: Vector, p: System, obs: Vector) -> None:
    """Length, strain and their rates of each wire: from the pose (module) or from the input (wire)."""
    if not p.module:
        obs[0, O_EPS], obs[0, O_DEPS] = u[0], du[0]
        obs[0, O_LENGTH], obs[0, O_V] = p.wire.l0 * (1.0 + u[0]), p.wire.l0 * du[0]
        return
    for i in range(2):
        length, by_x, by_y, by_alpha = wire_length(y[0], y[1], y[2], 2.0 * i - 1.0, p.beam)
        v = by_x * y[3] + by_y * y[4] + by_alpha * y[5]
        obs[i, O_LENGTH], obs[i, O_V] = length, v
        obs[i, O_EPS], obs[i, O_DEPS] = length / p.wire.l0 - 1.0, v / p.wire.l0
        obs[i, O_DL], obs[i, O_DL + 1], obs[i, O_DL + 2] = by_x, by_y, by_alpha


def commanded_heating(i: int, u: Vector, p: System) -> float:
    """Heating of one wire [W] before the actuation chain: J_eq > 0 heats bundle 1, J_eq < 0 bundle 2."""
    if not p.module:
        return u[1]
    side = u[0] if i == 0 else -u[0]
    return max(side, 0.0) / p.wire.n


def focus(i: int, y: Vector, p: System, obs: Vector) -> None:
    """Point the state that kernels read at wire `i`."""
    s = p.effects.s
    other = p.wires - 1 - i
    s[S_WIRE] = i
    s[S_T], s[S_T_OTHER] = y[p.first_T + i], y[p.first_T + other]
    s[S_X], s[S_X_OTHER] = obs[i, O_X], obs[other, O_X]
    s[S_EPS], s[S_DEPS] = obs[i, O_EPS], obs[i, O_DEPS]
    s[S_LENGTH], s[S_V], s[S_J] = obs[i, O_LENGTH], obs[i, O_V], obs[i, O_J]
    s[S_SIGMA], s[S_DX] = obs[i, O_SIGMA], obs[i, O_DX]


def add_rates(k: int, instance: int, constants: Vector, y: Vector, e: EffectTable, dy: Vector) -> None:
    """Rates of the extra states of one instance of effect `k`."""
    if e.states[k] > 0:
        call_effect(e.rate[k], k, instance, constants, y, e)
        first = e.state_start[k] + instance * e.states[k]
        for j in range(e.states[k]):
            dy[first + j] = e.out[j]


def heating(i: int, y: Vector, u: Vector, p: System, obs: Vector, dy: Vector) -> float:
    """Heating of one wire [W] after the actuation chain."""
    J = commanded_heating(i, u, p)
    e = p.effects
    if e.port_start[ACTUATION + 1] > e.port_start[ACTUATION]:
        focus(i, y, p, obs)
        for k in range(e.port_start[ACTUATION], e.port_start[ACTUATION + 1]):
            e.s[S_J] = J
            add_rates(k, i, e.wire, y, e, dy)
            call_effect(e.value[k], k, i, e.wire, y, e)
            J = e.out[0]
    return J


def offsets(i: int, T: float, x: float, y: Vector, p: System) -> tuple[float, float, float]:
    """Strain e [-] and shifts of sigma_A and sigma_M [Pa] that effects add at temperature T and fraction x."""
    e = p.effects
    strain, shift_A, shift_M = 0.0, 0.0, 0.0
    e.s[S_T], e.s[S_X] = T, x
    for k in range(e.port_start[WIRE_STRAIN], e.port_start[WIRE_STRAIN + 1]):
        call_effect(e.value[k], k, i, e.wire, y, e)
        strain += e.out[0]
    for k in range(e.port_start[TRANSFORMATION_STRESS], e.port_start[TRANSFORMATION_STRESS + 1]):
        call_effect(e.value[k], k, i, e.wire, y, e)
        shift_A += e.out[0]
        shift_M += e.out[1]
    return strain, shift_A, shift_M


def has_offsets(e: EffectTable) -> bool:
    """Whether any effect shifts strain or transformation stresses."""
    return e.port_start[TRANSFORMATION_STRESS + 1] > e.port_start[WIRE_STRAIN]


def offsets_depend_on_x(e: EffectTable) -> bool:
    """Whether any of them depends on x_M, so that x_M is an implicit function in modes 4 and 5."""
    for k in range(e.port_start[WIRE_STRAIN], e.port_start[TRANSFORMATION_STRESS + 1]):
        if e.depends_on_x[k] != 0:
            return True
    return False


def phase_and_stress(i: int, y: Vector, mode: int, x_frozen: float, p: System, obs: Vector) -> None:
    """x_M, stress and transformation stresses of wire `i` in its mode."""
    w, T, eps = p.wire, y[p.first_T + i], obs[i, O_EPS]
    strain, shift_A, shift_M = 0.0, 0.0, 0.0
    shifted = has_offsets(p.effects)
    if shifted:
        focus(i, y, p, obs)
    if p.mas:
        x = y[p.first_x + i]
    elif mode == TO_MARTENSITE or mode == TO_AUSTENITE:
        if shifted:
            x = transforming_fraction(i, eps, T, mode, x_frozen, y, p)
        else:
            x = fraction_at_stress(eps, sigma_A(T, w) if mode == TO_MARTENSITE else sigma_M(T, w), w)
    else:
        x = x_frozen
    if shifted:
        strain, shift_A, shift_M = offsets(i, T, x, y, p)
    obs[i, O_X], obs[i, O_STRAIN] = x, strain
    obs[i, O_SIGMA] = stress(eps - strain, x, w)
    obs[i, O_S_A], obs[i, O_S_M] = sigma_A(T, w) + shift_A, sigma_M(T, w) + shift_M


def transforming_fraction(
    i: int, eps: float, T: float, mode: int, x_guess: float, y: Vector, p: System
) -> float:
    """The x_M of mode 4 or 5: stress(eps - e, x) = sigma_A + shift_A (or M), in closed form or by Newton."""
    w = p.wire
    bare = sigma_A(T, w) if mode == TO_MARTENSITE else sigma_M(T, w)
    x = x_guess
    implicit = offsets_depend_on_x(p.effects)
    for _ in range(NEWTON_STEPS):
        strain, shift_A, shift_M = offsets(i, T, x, y, p)
        target = bare + (shift_A if mode == TO_MARTENSITE else shift_M)
        if not implicit:
            return fraction_at_stress(eps - strain, target, w)
        sigma = stress(eps - strain, x, w)
        slope = stress_slope_in_x(i, sigma, T, x, mode, y, p)
        change = (sigma - target) / slope
        x -= min(max(change, -0.2), 0.2)
        if abs(change) < 1e-13:
            break
    return x


def stress_slope_in_x(i: int, sigma: float, T: float, x: float, mode: int, y: Vector, p: System) -> float:
    """d(sigma - sigma_A)/dx at constant strain and temperature [Pa] (sigma_M in mode 5)."""
    w = p.wire
    slope = -(w.eps_T + sigma * w.d)
    shift = 0.0
    if offsets_depend_on_x(p.effects):
        e_up, A_up, M_up = offsets(i, T, x + X_STEP, y, p)
        e_down, A_down, M_down = offsets(i, T, x - X_STEP, y, p)
        slope -= (e_up - e_down) / (2.0 * X_STEP)
        shift = (A_up - A_down if mode == TO_MARTENSITE else M_up - M_down) / (2.0 * X_STEP)
    return slope / compliance(x, w) - shift


def stress_slope_in_T(i: int, T: float, x: float, mode: int, y: Vector, p: System) -> float:
    """d(sigma - sigma_A)/dT at constant strain and fraction [Pa/K] (sigma_M in mode 5)."""
    w = p.wire
    slope = -w.sigma_T
    if has_offsets(p.effects):
        e_up, A_up, M_up = offsets(i, T + T_STEP, x, y, p)
        e_down, A_down, M_down = offsets(i, T - T_STEP, x, y, p)
        slope -= (e_up - e_down) / (2.0 * T_STEP * compliance(x, w))
        slope -= (A_up - A_down if mode == TO_MARTENSITE else M_up - M_down) / (2.0 * T_STEP)
    return slope


def wire_rates(i: int, y: Vector, T_E: float, mode: int, p: System, dy: Vector, obs: Vector) -> None:
    """dT/dt and dx_M/dt of wire `i` (MAS9, L3; X4 to X8 as the total derivative of sigma = sigma_A or sigma_M)."""
    w, T, x, sigma = p.wire, y[p.first_T + i], obs[i, O_X], obs[i, O_SIGMA]
    heat = obs[i, O_J] - w.lambda_ * w.area * (T - T_E) + extra_heat(i, y, p, obs, dy)
    capacity = heat_capacity(T, x, w)
    latent = latent_heat(T, sigma, w)
    if p.mas:
        dx = mas_rate(sigma, x, T, obs[i, O_S_A], obs[i, O_S_M], w)
        dy[p.first_x + i] = dx
    else:
        dx = 0.0
        if mode == TO_MARTENSITE or mode == TO_AUSTENITE:
            if has_offsets(p.effects):
                focus(i, y, p, obs)
            by_x = stress_slope_in_x(i, sigma, T, x, mode, y, p)
            by_T = stress_slope_in_T(i, T, x, mode, y, p)
            by_eps = 1.0 / compliance(x, w)
            dx = -(by_eps * obs[i, O_DEPS] + by_T * heat / capacity) / (by_x + by_T * latent / capacity)
    obs[i, O_DX] = dx
    dy[p.first_T + i] = (heat + latent * dx) / capacity


def extra_heat(i: int, y: Vector, p: System, obs: Vector, dy: Vector) -> float:
    """Heat that effects bring into wire `i` [W]."""
    e = p.effects
    heat = 0.0
    if e.port_start[WIRE_HEAT + 1] > e.port_start[WIRE_HEAT]:
        focus(i, y, p, obs)
        for k in range(e.port_start[WIRE_HEAT], e.port_start[WIRE_HEAT + 1]):
            add_rates(k, i, e.wire, y, e, dy)
            call_effect(e.value[k], k, i, e.wire, y, e)
            heat += e.out[0]
    return heat


def force_passed_on(i: int, y: Vector, p: System, obs: Vector, dy: Vector) -> float:
    """Force of one wire on the structure [N] (MAS4), and the rates of the memory of strain and stress effects."""
    e = p.effects
    force = p.wire.section * obs[i, O_SIGMA]
    if e.port_start[WIRE_FORCE + 1] > e.port_start[WIRE_STRAIN]:
        focus(i, y, p, obs)
        e.s[S_F] = force
        for k in range(e.port_start[WIRE_STRAIN], e.port_start[TRANSFORMATION_STRESS + 1]):
            add_rates(k, i, e.wire, y, e, dy)
        for k in range(e.port_start[WIRE_FORCE], e.port_start[WIRE_FORCE + 1]):
            add_rates(k, i, e.wire, y, e, dy)
            call_effect(e.value[k], k, i, e.wire, y, e)
            force += e.out[0]
    return force


def accelerations(y: Vector, p: System, dy: Vector, obs: Vector) -> None:
    """Motion of the plate (EB-Ba to EB-Bc) under the beam, the wires (tau = -J^T F) and the structure's effects."""
    b, e = p.beam, p.effects
    F_x, F_y, M = beam_forces(y[0], y[1], y[2], y[3], y[4], y[5], b)
    for i in range(2):
        F_x -= obs[i, O_DL] * obs[i, O_F]
        F_y -= obs[i, O_DL + 1] * obs[i, O_F]
        M -= obs[i, O_DL + 2] * obs[i, O_F]
    for k in range(e.port_start[STRUCTURE_FORCE], e.port_start[STRUCTURE_FORCE + 1]):
        add_rates(k, 0, e.beam, y, e, dy)
        call_effect(e.value[k], k, 0, e.beam, y, e)
        F_x += e.out[0]
        F_y += e.out[1]
        M += e.out[2]
    dy[0], dy[1], dy[2] = y[3], y[4], y[5]
    dy[3], dy[4], dy[5] = F_x / b.m_H, F_y / b.m_H, M / b.J_H


def start_states(y: Vector, p: System, obs: Vector) -> None:
    """Set the extra states of the effects to their first values, for the pose in `y` and the wires in `obs`."""
    e = p.effects
    for port in range(SENSING + 1):
        for k in range(e.port_start[port], e.port_start[port + 1]):
            if e.start[k] == 0:
                continue
            if port == SENSING:
                for channel in range(9):
                    if e.slot[k, channel] >= 0:
                        e.s[S_VALUE], e.s[S_CHANNEL] = true_channel(channel, y, p, obs), channel
                        start_instance(k, e.slot[k, channel], e.wire, y, e)
            elif port == STRUCTURE_FORCE:
                start_instance(k, 0, e.beam, y, e)
            else:
                for i in range(p.wires):
                    focus(i, y, p, obs)
                    start_instance(k, i, e.wire, y, e)


def start_instance(k: int, instance: int, constants: Vector, y: Vector, e: EffectTable) -> None:
    """First values of the states of one instance of effect `k`."""
    call_effect(e.start[k], k, instance, constants, y, e)
    for j in range(e.states[k]):
        y[e.state_start[k] + instance * e.states[k] + j] = e.out[j]


def true_channel(channel: int, y: Vector, p: System, obs: Vector) -> float:
    """The true value of a sensor channel, in the order of CHANNELS."""
    if channel < 3:
        return y[channel]
    if channel < 5:
        return obs[channel - 3, O_F]
    if channel < 7:
        return y[p.first_T + channel - 5]
    if channel == 7:
        return obs[0, O_F] / (p.wire.n * p.wire.section)
    return y[p.first_T]


def sensed_channel(channel: int, y: Vector, p: System, obs: Vector, dy: Vector) -> float:
    """What the sensor of a channel shows after the sensing chain; the chain's rates go into `dy`."""
    e = p.effects
    value = true_channel(channel, y, p, obs)
    e.s[S_CHANNEL] = channel
    for k in range(e.port_start[SENSING], e.port_start[SENSING + 1]):
        if e.slot[k, channel] >= 0:
            e.s[S_VALUE] = value
            add_rates(k, e.slot[k, channel], e.wire, y, e, dy)
            call_effect(e.value[k], k, e.slot[k, channel], e.wire, y, e)
            value = e.out[0]
    return value


def sensing_rates(y: Vector, p: System, dy: Vector, obs: Vector) -> None:
    """Rates of the sensing chain's states."""
    for channel in range(7 if p.module else 9):
        if p.module or channel > 6:
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


