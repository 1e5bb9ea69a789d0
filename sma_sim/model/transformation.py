"""Phase fraction and stress of a wire in its mode, and the rate of the fraction while the wire transforms.

In modes 4 and 5 x_M is algebraic: sigma(eps - e, x_M) = sigma_A + s_A (or sigma_M + s_M), where effects add the strain
e(T, x_M, m) and the shifts s(T, x_M, m) with extra states m. Its rate follows from the total derivative of that
equation together with the heat balance (docs/explanation/physics.md).
"""

from __future__ import annotations

from sma_sim.model.automaton import TO_AUSTENITE, TO_MARTENSITE
from sma_sim.model.effects.calls import focus
from sma_sim.model.effects.ports import (
    S_DX,
    S_EPS,
    S_LENGTH,
    S_STRAIN,
    S_T,
    S_X,
    TRANSFORMATION_STRESS,
    WIRE_STRAIN,
    EffectTable,
    call_effect,
)
from sma_sim.model.layout import O_DEPS, O_EPS, O_LENGTH, O_S_A, O_S_M, O_SIGMA, O_STRAIN, O_X, System, Vector
from sma_sim.model.material import compliance, fraction_at_stress, sigma_A, sigma_M, stress

# One-sided difference steps for what effects add: small beside any feature, large beside rounding.
X_STEP, EPS_STEP, T_STEP, MEMORY_STEP = 1e-7, 1e-7, 1e-4, 1e-7
SECANT_STEPS = 60
FRACTION_TOLERANCE = 1e-13
LARGEST_CHANGE, SMALLEST_SLOPE = 0.2, -0.3  # of the secant method


def offsets(i: int, T: float, x: float, y: Vector, p: System) -> tuple[float, float, float]:
    """Strain e [-] and shifts of sigma_A and sigma_M [Pa] that effects add at temperature T and fraction x."""
    e = p.effects
    strain, shift_A, shift_M = 0.0, 0.0, 0.0
    e.s[S_T], e.s[S_X], e.s[S_STRAIN] = T, x, 0.0
    for k in range(e.port_start[WIRE_STRAIN], e.port_start[WIRE_STRAIN + 1]):
        call_effect(e.value[k], k, i, e.wire, y, e)
        strain += e.out[0]
        shift_A += e.out[1]
        shift_M += e.out[2]
        e.s[S_STRAIN] = strain
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


def offsets_depend_on_eps(e: EffectTable) -> bool:
    """Whether any of them depends on the strain of the wire."""
    for k in range(e.port_start[WIRE_STRAIN], e.port_start[TRANSFORMATION_STRESS + 1]):
        if e.depends_on_eps[k] != 0:
            return True
    return False


def phase_and_stress(i: int, y: Vector, mode: int, x_frozen: float, p: System, obs: Vector) -> None:
    """x_M, stress and transformation stresses of wire `i` in its mode."""
    w, T, eps = p.wire, y[p.first_T + i], obs[i, O_EPS]
    x = y[p.first_x + i] if p.mas else x_frozen
    strain, shift_A, shift_M = 0.0, 0.0, 0.0
    transforming = not p.mas and (mode == TO_MARTENSITE or mode == TO_AUSTENITE)
    if has_offsets(p.effects):
        focus(i, y, p, obs)
        if transforming:
            x, strain, shift_A, shift_M = transforming_fraction(i, eps, T, mode, x_frozen, y, p)
        else:
            strain, shift_A, shift_M = offsets(i, T, x, y, p)
    elif transforming:
        x = fraction_at_stress(eps, sigma_A(T, w) if mode == TO_MARTENSITE else sigma_M(T, w), w)
    obs[i, O_X], obs[i, O_STRAIN] = x, strain
    obs[i, O_SIGMA] = stress(eps - strain, x, w)
    obs[i, O_S_A], obs[i, O_S_M] = sigma_A(T, w) + shift_A, sigma_M(T, w) + shift_M


def transforming_fraction(
    i: int, eps: float, T: float, mode: int, x_guess: float, y: Vector, p: System
) -> tuple[float, float, float, float]:
    """x_M in mode 4 or 5 with the strain and the shifts that effects add there.

    In closed form where these do not depend on x_M. Else x_M solves x = g(x), g being the closed form with what
    effects add at x: the secant method on g(x) - x, whose slope is close to -1.
    """
    w, x = p.wire, x_guess
    bare = sigma_A(T, w) if mode == TO_MARTENSITE else sigma_M(T, w)
    strain, shift_A, shift_M = offsets(i, T, x, y, p)
    gap = fraction_at_stress(eps - strain, bare + (shift_A if mode == TO_MARTENSITE else shift_M), w) - x
    if not offsets_depend_on_x(p.effects):
        return x + gap, strain, shift_A, shift_M
    change = min(max(gap, -LARGEST_CHANGE), LARGEST_CHANGE)
    for _ in range(SECANT_STEPS):
        if abs(change) < FRACTION_TOLERANCE:
            break
        new_strain, new_A, new_M = offsets(i, T, x + change, y, p)
        target = bare + (new_A if mode == TO_MARTENSITE else new_M)
        new_gap = fraction_at_stress(eps - new_strain, target, w) - (x + change)
        slope = min((new_gap - gap) / change, SMALLEST_SLOPE)
        more = min(max(-new_gap / slope, -LARGEST_CHANGE), LARGEST_CHANGE)
        if abs(more * change) < FRACTION_TOLERANCE:  # straight on from the last two points
            part = 1.0 + more / change
            x += change + more
            return (
                x, strain + part * (new_strain - strain), shift_A + part * (new_A - shift_A),
                shift_M + part * (new_M - shift_M),
            )  # fmt: skip
        x, gap, strain, shift_A, shift_M, change = x + change, new_gap, new_strain, new_A, new_M, more
    return x + change, strain, shift_A, shift_M


def has_memory(e: EffectTable) -> bool:
    """Whether any of them has extra states."""
    for k in range(e.port_start[WIRE_STRAIN], e.port_start[TRANSFORMATION_STRESS + 1]):
        if e.states[k] > 0:
            return True
    return False


def fraction_rate(
    i: int, heat: float, capacity: float, latent: float, mode: int, y: Vector, p: System, obs: Vector
) -> float:
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
        strain = obs[i, O_STRAIN]
        shift = obs[i, O_S_A] - sigma_A(T, w) if mode == TO_MARTENSITE else obs[i, O_S_M] - sigma_M(T, w)
        by_T += added(i, T + T_STEP, x, strain, shift, by_eps, mode, y, p) / T_STEP
        if offsets_depend_on_x(e):
            step = X_STEP if x < 0.5 else -X_STEP
            by_x += added(i, T, x + step, strain, shift, by_eps, mode, y, p) / step
        if offsets_depend_on_eps(e):
            e.s[S_EPS], e.s[S_LENGTH] = obs[i, O_EPS] + EPS_STEP, obs[i, O_LENGTH] + EPS_STEP * w.l0
            drawn += added(i, T, x, strain, shift, by_eps, mode, y, p) / EPS_STEP * obs[i, O_DEPS]
            e.s[S_EPS], e.s[S_LENGTH] = obs[i, O_EPS], obs[i, O_LENGTH]
        if has_memory(e):
            e.s[S_T], e.s[S_X] = T, x
            sign = 1.0 if mode == TO_MARTENSITE else -1.0
            drift = memory_drift(i, 0.0, T, x, strain, shift, by_eps, mode, y, p)
            by_x += (memory_drift(i, sign, T, x, strain, shift, by_eps, mode, y, p) - drift) * sign
    return -(drawn + by_T * heat / capacity + drift) / (by_x + by_T * latent / capacity)


def added(i: int, T: float, x: float, strain: float, shift: float, by_eps: float, mode: int, y: Vector, p: System) -> float:
    """Change of sigma - sigma_A - s_A (or M) through what effects add at (T, x) beyond `strain` and `shift` [Pa]."""
    new_strain, shift_A, shift_M = offsets(i, T, x, y, p)
    new_shift = shift_A if mode == TO_MARTENSITE else shift_M
    return -(new_strain - strain) * by_eps - (new_shift - shift)


def memory_drift(
    i: int, dx: float, T: float, x: float, strain: float, shift: float, by_eps: float, mode: int, y: Vector, p: System
) -> float:
    """Rate of sigma - sigma_A - s_A through the extra states of these effects [Pa/s], were dx_M/dt = `dx`."""
    e = p.effects
    total = 0.0
    for k in range(e.port_start[WIRE_STRAIN], e.port_start[TRANSFORMATION_STRESS + 1]):
        for j in range(e.states[k]):
            e.s[S_T], e.s[S_X], e.s[S_DX] = T, x, dx
            call_effect(e.rate[k], k, i, e.wire, y, e)
            rate = e.out[j]
            at = e.state_start[k] + i * e.states[k] + j
            kept = y[at]
            y[at] = kept + MEMORY_STEP * e.scale[at - e.state_start[0]]
            step = y[at] - kept
            total += added(i, T, x, strain, shift, by_eps, mode, y, p) / step * rate
            y[at] = kept
    return total
