"""The model against the equations of the paper where these are written differently, and its errata."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from systems import make_model, random_state

from sma_sim import default_parameters
from sma_sim.model.kinetics import mas_rate, transition_rates
from sma_sim.model.layout import O_DX
from sma_sim.model.material import (
    compliance,
    fraction_at_stress,
    gamma,
    gamma_T,
    heat_capacity,
    latent_heat,
    sigma_A,
    sigma_M,
    sigma_MW,
    stress,
)
from sma_sim.model.parameters import beam_constants, wire_constants
from sma_sim.model.structures.beam import wire_length

W, B = wire_constants(default_parameters()), beam_constants(default_parameters())
fractions = st.floats(0.0, 1.0)
strains = st.floats(-0.05, 0.1)
temperatures = st.floats(250.0, 450.0)
STEP = 1e-30


def derivative(f, at):
    """Of a rational function, by a complex step: exact to rounding."""
    return f(at + 1j * STEP).imag / STEP


@given(strains, temperatures)
def test_fraction_is_the_one_of_the_paper(eps, T):
    """Equations X0 and abbr1."""
    Sigma_A = (W.E_A - W.E_M) * sigma_A(T, W) + W.E_A * W.E_M * W.eps_T
    expected = W.E_M / Sigma_A * (W.E_A * eps - sigma_A(T, W))
    assert fraction_at_stress(eps, sigma_A(T, W), W) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@given(strains, fractions)
def test_stress_falls_with_the_fraction(eps, x):
    """The slope is -(eps_T + d sigma)/compliance: negative wherever Sigma_A > 0, so guards in stress and in x_M agree."""
    slope = derivative(lambda z: stress(eps, z, W), x)
    expected = -(W.eps_T + W.d * stress(eps, x, W)) / compliance(x, W)
    assert slope == pytest.approx(expected, rel=1e-9)
    assert (slope < 0) == (W.eps_T + W.d * stress(eps, x, W) > 0)
    if eps > -W.eps_T * W.E_M / (W.E_A - W.E_M):
        assert slope < 0.0


@given(temperatures, st.floats(0.0, 3e8))
def test_latent_heat_is_the_papers(T, sigma):
    """Equations L3a and L2a to L2c; Gamma_T is the derivative of Gamma(sigma_MW(T))."""
    assert gamma_T(T, W) == pytest.approx(derivative(lambda t: gamma(sigma_MW(t, W), W), T), rel=1e-12)
    volume = math.pi * 75e-6**2 * 95.7e-3
    d = 1 / 7.8e9 - 1 / 12.3e9
    Gamma = [0.5 * d * s**2 + 0.067 * s for s in (sigma, sigma_MW(T, W))]
    assert latent_heat(T, sigma, W) == pytest.approx(volume * (T * gamma_T(T, W) + Gamma[0] - Gamma[1]), rel=1e-12)
    assert latent_heat(T, sigma_MW(T, W), W) == pytest.approx(volume * T * gamma_T(T, W), rel=1e-12)


# MAS kinetics


def test_barriers_are_continuous_and_smooth():
    """Up to the first derivative where they vanish: at sigma_A and at sigma_M."""
    s_A, s_M = 120e6, 108e6

    def barriers(sigma):
        return [-math.log(p / W.omega_x) for p in transition_rates(sigma, 1e7, s_A, s_M, W)]

    for at, k, outside in ((s_A, 0, 1.0), (s_M, 1, -1.0)):
        assert barriers(at)[k] == 0.0
        assert barriers(at + outside * 1e6)[k] == 0.0
        near, nearer = barriers(at - outside * 2e3)[k], barriers(at - outside * 1e3)[k]
        assert 0.0 < nearer < near == pytest.approx(4.0 * nearer, rel=1e-9)


@given(st.floats(100e6, 130e6), temperatures)
def test_rates_balance_at_the_fraction_between(sigma, T):
    p_AM, p_MA = transition_rates(sigma, T, 120e6, 108e6, W)
    assert 0.0 <= p_AM <= 100.0 and 0.0 <= p_MA <= 100.0
    assert mas_rate(sigma, 0.0, T, 120e6, 108e6, W) == p_AM
    assert mas_rate(sigma, 1.0, T, 120e6, 108e6, W) == -p_MA
    if p_AM + p_MA > 0.0:
        assert mas_rate(sigma, p_AM / (p_AM + p_MA), T, 120e6, 108e6, W) == pytest.approx(0.0, abs=1e-12)


# Beam


@given(st.floats(-2e-3, 2e-3), st.floats(-2e-2, 2e-2), st.floats(-1.0, 1.0), st.sampled_from([-1.0, 1.0]))
def test_wire_length(U_x, U_y, alpha, side):
    """The distance of the wire's ends, (0, side W/2) and the tip's corner, turned with the plate; and its gradient."""
    W_2 = side * 0.005
    corner = np.array([0.1 + U_x + W_2 * math.sin(alpha), U_y + W_2 * (1 - math.cos(alpha))])
    length, *gradient = wire_length(U_x, U_y, alpha, side, B)
    assert length == pytest.approx(np.hypot(*corner), rel=1e-14)
    for k in range(3):
        ends = []
        for sign in (-1, 1):
            q = [U_x, U_y, alpha]
            q[k] += sign * 1e-6
            ends.append(wire_length(*q, side, B)[0])
        assert gradient[k] == pytest.approx((ends[1] - ends[0]) / 2e-6, rel=1e-6, abs=1e-9)


def test_sides_mirror_each_other():
    left, right = wire_length(1e-4, 2e-3, 0.1, -1.0, B), wire_length(1e-4, -2e-3, -0.1, 1.0, B)
    assert left[0] == pytest.approx(right[0], rel=1e-15)
    assert left[1:] == pytest.approx((right[1], -right[2], -right[3]), rel=1e-12)


# Automaton


@given(strains, temperatures, fractions)
def test_guards_in_stress_are_those_in_fractions(eps, T, x):
    """x^(4) > x_M in the paper (D_1, D_4) is sigma > sigma_A; x^(5) < x_M (D_2, D_3) is sigma < sigma_M."""
    for s, sign in ((sigma_A(T, W), 1.0), (sigma_M(T, W), -1.0)):
        if W.eps_T + W.d * min(stress(eps, x, W), s) <= 0.0:
            continue  # Sigma_A < 0: beyond the paper's model
        in_fractions = sign * (fraction_at_stress(eps, s, W) - x)
        in_stress = sign * (stress(eps, x, W) - s)
        assert (in_fractions > 1e-12) <= (in_stress > -1.0) and (in_fractions < -1e-12) <= (in_stress < 1.0)


@given(strains, temperatures)
def test_inner_flow_set_is_not_empty(eps, T):
    """Erratum: sigma_A > sigma_M gives x^(4) < x^(5), so C_3 as printed would be empty."""
    if W.eps_T + W.d * sigma_M(T, W) > 0.0 and stress(eps, 0.0, W) > -1e9:
        assert fraction_at_stress(eps, sigma_A(T, W), W) < fraction_at_stress(eps, sigma_M(T, W), W)


@pytest.mark.parametrize('mode', [4, 5])
def test_rates_of_transforming_wires_are_the_papers(mode):
    """Equations X6 (X7) and X4 (X5), written down again from the paper; rho_m there is rho_V."""
    model, random = make_model('wire'), np.random.default_rng(mode)
    for _ in range(50):
        s = random_state(model, random, mode)
        eps, J, T_E, v, T = s.u[0], s.u[1], s.u[2], W.l0 * s.du[0], s.y[0]
        level = sigma_A(T, W) if mode == 4 else sigma_M(T, W)
        x = fraction_at_stress(eps, level, W)
        L_x, capacity = latent_heat(T, level, W), heat_capacity(T, x, W)
        Sigma = (W.E_A - W.E_M) * level + W.E_A * W.E_M * W.eps_T
        M = (W.E_A - W.E_M) * eps * W.sigma_T + W.E_M * W.eps_T * W.sigma_T
        E_2, heat = W.E_A * W.E_M, J - W.lambda_ * W.surface * (T - T_E)
        phi_T = (heat * Sigma**2 + E_2 * L_x * Sigma * v / W.l0) / (capacity * Sigma**2 + E_2 * L_x * M)
        phi_x = E_2 / Sigma**2 * (Sigma * v / W.l0 - M * phi_T)
        assert s.dy[0] == pytest.approx(phi_T, rel=1e-9)
        assert s.obs[0, O_DX] == pytest.approx(phi_x, rel=1e-9)
