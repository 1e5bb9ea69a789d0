"""Phase fraction and stress of a wire in its mode, and the rate of the fraction while the wire transforms.

In modes 4 and 5 x_M is algebraic: sigma(eps - e, x_M) = sigma_A + s_A (or sigma_M + s_M), where effects add the strain
e(T, x_M, m) and the shifts s(T, x_M, m) with extra states m. Its rate follows from the total derivative of that
equation together with the heat balance (docs/explanation/physics.md).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sma_sim.model.arrays import Vector
from sma_sim.model.automaton import TO_AUSTENITE, TO_MARTENSITE
from sma_sim.model.effects.ports import (
    S_DX,
    S_EPS,
    S_LENGTH,
    S_STRAIN,
    S_T,
    S_TIME,
    S_X,
    TRANSFORMATION_STRESS,
    WIRE_STRAIN,
    EffectTable,
    call_effect,
)
from sma_sim.model.layout import O_DEPS, O_EPS, O_LENGTH, O_RATIO, O_S_A, O_S_M, O_SIGMA, O_STRAIN, O_X, System, SystemState
from sma_sim.model.material import compliance, fraction_at_stress, fraction_missing, sigma_A, sigma_M, stress

# One-sided difference steps for what effects add: small beside any feature, large beside rounding.
X_STEP, EPS_STEP, T_STEP, MEMORY_STEP, TIME_STEP = 1e-7, 1e-7, 1e-4, 1e-7, 1e-6
KNEE, LEAST = 0.2, 0.05  # of dsigma: from where on the hysteresis no longer narrows in proportion, and its limit
SECANT_STEPS = 60
FRACTION_TOLERANCE = 1e-13
SERIES_SWEEPS, SERIES_TOLERANCE = 100, 1e-16  # of strains in series
LARGEST_CHANGE, SMALLEST_SLOPE = 0.2, -1e-3  # of the secant method


def offsets(i: int, T: float, x: float, y: Vector, p: System) -> tuple[float, float, float]:
    """Strain e [-] and shifts of sigma_A and sigma_M [Pa] that effects add at temperature T and fraction x."""
    e = p.effects
    strain, shift_A, shift_M = 0.0, 0.0, 0.0
    s = e.s[i]
    s[S_T], s[S_X], s[S_STRAIN] = T, x, 0.0
    for k in range(e.port_start[WIRE_STRAIN], e.port_start[WIRE_STRAIN + 1]):
        call_effect(e.value[k], k, i, y, e)
        for j in range(3):
            e.contribution[k, j] = e.out[j]
        strain += e.out[0]
        shift_A += e.out[1]
        shift_M += e.out[2]
        s[S_STRAIN] = strain
    if e.port_start[WIRE_STRAIN + 1] - e.series_start > 1:
        strain, shift_A, shift_M = balanced(i, (strain, shift_A, shift_M), y, p)
    for k in range(e.port_start[TRANSFORMATION_STRESS], e.port_start[TRANSFORMATION_STRESS + 1]):
        call_effect(e.value[k], k, i, y, e)
        shift_A += e.out[0]
        shift_M += e.out[1]
    half = half_of_height(shift_A - shift_M, p.wire.dsigma)
    middle = 0.5 * (shift_A + shift_M)
    return strain, middle + half, middle - half


def half_of_height(change: float, dsigma: float) -> float:
    """Half of what effects add to the height dsigma of the hysteresis [Pa], such that it never closes.

    Below a fifth of dsigma, what would be left goes on as LEAST + (KNEE - LEAST) exp((u - KNEE)/(KNEE - LEAST)) of it. As
    it closes, 1/E_I grows as eps_T/(sigma_A - sigma_M) and the MAS rates become a switch; upside down, the hybrid model
    jumps to and fro.
    """
    left = 1.0 + change / dsigma
    if left >= KNEE:
        return 0.5 * change
    return 0.5 * dsigma * (LEAST + (KNEE - LEAST) * math.exp((left - KNEE) / (KNEE - LEAST)) - 1.0)


def balanced(i: int, sums: tuple[float, float, float], y: Vector, p: System) -> tuple[float, float, float]:
    """The sums of `offsets` where several effects are in series with the wire, which carry one stress.

    Each of them is solved for with the strain of all others, in turn until none changes; strains that grow with stress
    converge.
    """
    e, s = p.effects, p.effects.s[i]
    strain, shift_A, shift_M = sums
    for _ in range(SERIES_SWEEPS):
        change = 0.0
        for k in range(e.series_start, e.port_start[WIRE_STRAIN + 1]):
            s[S_STRAIN] = strain - e.contribution[k, 0]
            call_effect(e.value[k], k, i, y, e)
            change += abs(e.out[0] - e.contribution[k, 0])
            strain += e.out[0] - e.contribution[k, 0]
            shift_A += e.out[1] - e.contribution[k, 1]
            shift_M += e.out[2] - e.contribution[k, 2]
            for j in range(3):
                e.contribution[k, j] = e.out[j]
        if change < SERIES_TOLERANCE:
            break
    s[S_STRAIN] = strain
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


def offsets_depend_on_eps(e: EffectTable) -> bool:
    """Whether any of them depends on the strain of the wire."""
    for k in range(e.port_start[WIRE_STRAIN], e.port_start[TRANSFORMATION_STRESS + 1]):
        if e.depends_on_eps[k] != 0:
            return True
    return False


def offsets_depend_on_t(e: EffectTable) -> bool:
    """Whether any of them depends on time itself."""
    for k in range(e.port_start[WIRE_STRAIN], e.port_start[TRANSFORMATION_STRESS + 1]):
        if e.depends_on_t[k] != 0:
            return True
    return False


def phase_and_stress(i: int, state: SystemState, p: System, obs: Vector) -> None:
    """x_M, stress and transformation stresses of wire `i` in its mode."""
    w, y, mode, eps = p.wire, state.y, state.mode[i], obs[i, O_EPS]
    T = y[p.first_T + i]
    x = y[p.first_x + i] if p.mas else state.x_frozen[i]
    strain, shift_A, shift_M = 0.0, 0.0, 0.0
    transforming = not p.mas and (mode == TO_MARTENSITE or mode == TO_AUSTENITE)
    if has_offsets(p.effects):
        if transforming:
            x, strain, shift_A, shift_M = transforming_fraction(i, eps, T, state, p)
        else:
            strain, shift_A, shift_M = offsets(i, T, x, y, p)
    elif transforming:
        x = fraction_at_stress(eps, sigma_A(T, w) if mode == TO_MARTENSITE else sigma_M(T, w), w)
    obs[i, O_X], obs[i, O_STRAIN] = x, strain
    obs[i, O_SIGMA] = stress(eps - strain, x, w)
    obs[i, O_S_A], obs[i, O_S_M] = sigma_A(T, w) + shift_A, sigma_M(T, w) + shift_M


def transforming_fraction(i: int, eps: float, T: float, state: SystemState, p: System) -> tuple[float, float, float, float]:
    """x_M in mode 4 or 5 with the strain and the shifts that effects add there.

    In closed form where these do not depend on x_M. Else by the secant method on the fraction that is missing, whose slope
    is close to -1 where effects add little, from the last x_M.
    """
    w, y, mode, x = p.wire, state.y, state.mode[i], state.x_frozen[i]
    nominal = sigma_A(T, w) if mode == TO_MARTENSITE else sigma_M(T, w)
    strain, shift_A, shift_M = offsets(i, T, x, y, p)
    target = nominal + (shift_A if mode == TO_MARTENSITE else shift_M)
    if not offsets_depend_on_x(p.effects):
        return fraction_at_stress(eps - strain, target, w), strain, shift_A, shift_M
    gap = fraction_missing(eps - strain, target, x, w)
    change = min(max(gap, -LARGEST_CHANGE), LARGEST_CHANGE)
    for _ in range(SECANT_STEPS):
        if abs(change) < FRACTION_TOLERANCE:
            break
        new_strain, new_A, new_M = offsets(i, T, x + change, y, p)
        target = nominal + (new_A if mode == TO_MARTENSITE else new_M)
        new_gap = fraction_missing(eps - new_strain, target, x + change, w)
        slope = min((new_gap - gap) / change, SMALLEST_SLOPE)
        more = min(max(-new_gap / slope, -LARGEST_CHANGE), LARGEST_CHANGE)
        if abs(more * change) < FRACTION_TOLERANCE:  # straight on from the last two points
            part = 1.0 + more / change
            x += change + more
            return (
                x,
                strain + part * (new_strain - strain),
                shift_A + part * (new_A - shift_A),
                shift_M + part * (new_M - shift_M),
            )
        x, gap, strain, shift_A, shift_M, change = x + change, new_gap, new_strain, new_A, new_M, more
    return x + change, strain, shift_A, shift_M


def has_memory(e: EffectTable) -> bool:
    """Whether any of them has extra states."""
    for k in range(e.port_start[WIRE_STRAIN], e.port_start[TRANSFORMATION_STRESS + 1]):
        if e.states[k] > 0:
            return True
    return False


class HeatBalance(NamedTuple):
    """capacity dT/dt = heat + latent dx_M/dt of one wire [J/K, W, J]."""

    heat: float
    capacity: float
    latent: float


class Transformation(NamedTuple):
    """A transforming wire, and what effects add there: about it the condition sigma = sigma_A + s_A (or M) is linearized."""

    mode: int
    T: float
    x: float
    strain: float
    shift: float  # s_A in mode 4, s_M in mode 5
    by_eps: float  # d sigma/d eps


def fraction_rate(i: int, balance: HeatBalance, mode: int, y: Vector, p: System, obs: Vector) -> float:
    """dx_M/dt [1/s] in modes 4 and 5 (X4 to X8).

    The derivative of sigma - sigma_A - s_A (or M) along the flow is zero, with dT/dt = (heat + latent dx_M/dt)/capacity
    and with rates of extra states that are linear in dx_M/dt for the sign that it has in this mode.
    """
    w, T, x, sigma = p.wire, y[p.first_T + i], obs[i, O_X], obs[i, O_SIGMA]
    by_eps = 1.0 / compliance(x, w)
    by_x, by_T, drift = -(w.eps_T + sigma * w.d) * by_eps, -w.sigma_T, 0.0
    drawn = by_eps * obs[i, O_DEPS]
    e = p.effects
    if has_offsets(e):
        shift = obs[i, O_S_A] - sigma_A(T, w) if mode == TO_MARTENSITE else obs[i, O_S_M] - sigma_M(T, w)
        at = Transformation(mode, T, x, obs[i, O_STRAIN], shift, by_eps)
        by_T += added(i, T + T_STEP, x, at, y, p) / T_STEP
        if offsets_depend_on_x(e):
            step = X_STEP if x < 0.5 else -X_STEP
            by_x += added(i, T, x + step, at, y, p) / step
        if offsets_depend_on_eps(e):
            drawn += added_by_strain(i, at, y, p, obs) * obs[i, O_DEPS]
        if offsets_depend_on_t(e):
            drawn += added_in_time(i, at, y, p)
        if has_memory(e):
            sign = 1.0 if mode == TO_MARTENSITE else -1.0
            drift = memory_drift(i, 0.0, at, y, p)
            by_x += (memory_drift(i, sign, at, y, p) - drift) * sign
    return -(drawn + by_T * balance.heat / balance.capacity + drift) / (by_x + by_T * balance.latent / balance.capacity)


def added(i: int, T: float, x: float, at: Transformation, y: Vector, p: System) -> float:
    """Change of sigma - sigma_A - s_A (or M) through what effects add at (T, x) beyond what they add `at` it [Pa]."""
    strain, shift_A, shift_M = offsets(i, T, x, y, p)
    shift = shift_A if at.mode == TO_MARTENSITE else shift_M
    return -(strain - at.strain) * at.by_eps - (shift - at.shift)


def added_by_strain(i: int, at: Transformation, y: Vector, p: System, obs: Vector) -> float:
    """Derivative of sigma - sigma_A - s_A (or M) in the strain of the wire, through what effects add [Pa]."""
    s = p.effects.s[i]
    s[S_EPS] = obs[i, O_EPS] + EPS_STEP
    s[S_LENGTH] = obs[i, O_LENGTH] + EPS_STEP * p.wire.l0 / obs[i, O_RATIO]
    slope = added(i, at.T, at.x, at, y, p) / EPS_STEP
    s[S_EPS], s[S_LENGTH] = obs[i, O_EPS], obs[i, O_LENGTH]
    return slope


def added_in_time(i: int, at: Transformation, y: Vector, p: System) -> float:
    """Rate of sigma - sigma_A - s_A (or M) through what effects add as functions of time itself [Pa/s]."""
    s = p.effects.s[i]
    now = s[S_TIME]
    s[S_TIME] = now + TIME_STEP
    rate = added(i, at.T, at.x, at, y, p) / (s[S_TIME] - now)
    s[S_TIME] = now
    return rate


def memory_drift(i: int, dx: float, at: Transformation, y: Vector, p: System) -> float:
    """Rate of sigma - sigma_A - s_A (or M) through the extra states of these effects [Pa/s], were dx_M/dt = `dx`."""
    e = p.effects
    s = e.s[i]
    total = 0.0
    for k in range(e.port_start[WIRE_STRAIN], e.port_start[TRANSFORMATION_STRESS + 1]):
        for j in range(e.states[k]):
            s[S_T], s[S_X], s[S_DX] = at.T, at.x, dx
            call_effect(e.rate[k], k, i, y, e)
            rate = e.out[j]
            state = e.state_start[k] + i * e.states[k] + j
            kept = y[state]
            y[state] = kept + MEMORY_STEP * e.scale[state - e.state_start[0]]
            step = y[state] - kept
            total += added(i, at.T, at.x, at, y, p) / step * rate
            y[state] = kept
    return total
