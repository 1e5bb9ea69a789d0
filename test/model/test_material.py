"""Material law, beam and automaton against closed forms and the paper."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_sim import default_parameters
from sma_sim.model.automaton import EDGES, GUARD_NAMES, frozen_fraction, observed_mode
from sma_sim.model.kinetics import transition_rates
from sma_sim.model.material import (
    fraction_at_stress,
    gamma,
    gamma_T,
    heat_capacity,
    internal_energy,
    latent_heat,
    sigma_A,
    sigma_M,
    sigma_MW,
    stress,
)
from sma_sim.model.parameters import K_B, beam_constants, wire_constants
from sma_sim.model.structures.beam import wire_length
from sma_sim.model.structures.module import STRUCTURE
from sma_sim.model.structures.structure import record

W = wire_constants(default_parameters())
B = beam_constants(default_parameters())
temperatures, fractions = st.floats(250.0, 400.0), st.floats(0.0, 1.0)


@given(x=fractions, sigma=st.floats(-1e8, 5e8))
def test_fraction_at_stress_inverts_stress(x, sigma):
    eps = sigma * (x / W.E_M + (1 - x) / W.E_A) + W.eps_T * x
    assert stress(eps, x, W) == pytest.approx(sigma, abs=1.0)
    assert fraction_at_stress(eps, sigma, W) == pytest.approx(x, abs=1e-9)


@given(T=temperatures)
def test_transformation_stresses(T):
    assert sigma_A(T, W) - sigma_M(T, W) == pytest.approx(12.3e6)
    assert 0.5 * (sigma_A(T, W) + sigma_M(T, W)) == pytest.approx(121.35e6 + 2.13e6 * (T - 323.0))


@given(T=temperatures)
def test_gamma_T_is_the_derivative(T):
    h = 1e-3
    slope = (gamma(sigma_MW(T + h, W), W) - gamma(sigma_MW(T - h, W), W)) / (2 * h)
    assert gamma_T(T, W) == pytest.approx(slope, rel=1e-6)


@given(T=temperatures, x=fractions, sigma=st.floats(0.0, 3e8))
def test_heat_terms_are_derivatives_of_the_energy(T, x, sigma):
    """At constant strain: dU/dT is the heat capacity, and dU/dx is -L_x (docs/explanation/physics.md, section 3)."""
    eps = sigma * (x / W.E_M + (1 - x) / W.E_A) + W.eps_T * x

    def U(T, x):
        return internal_energy(eps - W.eps_T * x, T, x, W)

    assert (U(T + 0.1, x) - U(T - 0.1, x)) / 0.2 == pytest.approx(heat_capacity(T, x, W), rel=1e-6)
    h = 1e-4
    assert -(U(T, x + h) - U(T, x - h)) / (2 * h) == pytest.approx(latent_heat(T, sigma, W), rel=1e-5, abs=1e-9)


def test_mas_barriers_are_those_of_a_smooth_energy():
    """Barriers by numerical integration of the three-parabola Gibbs energy (docs/explanation/physics.md, section 4)."""
    T, sigma = 320.0, 110e6
    s_A, s_M = sigma_A(T, W), sigma_M(T, W)
    strain_A, strain_M = s_A / W.E_A, W.eps_T + s_M / W.E_M
    grid = np.linspace(0.0, W.eps_T + s_A / W.E_M, 2_000_001)
    middle = s_A + (s_M - s_A) * (grid - strain_A) / (strain_M - strain_A)
    slope = np.where(grid < strain_A, W.E_A * grid, np.where(grid > strain_M, W.E_M * (grid - W.eps_T), middle)) - sigma
    potential = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(grid))])
    inside = (grid > strain_A) & (grid < strain_M)
    top = potential[inside].max()
    valley_A, valley_M = potential[grid < strain_A].min(), potential[grid > strain_M].min()
    scale = W.V_L / (K_B * T)
    p_AM, p_MA = transition_rates(sigma, T, s_A, s_M, W)
    assert p_AM == pytest.approx(W.omega_x * math.exp(-scale * (top - valley_A)), rel=1e-3)
    assert p_MA == pytest.approx(W.omega_x * math.exp(-scale * (top - valley_M)), rel=1e-3)


@given(T=temperatures)
def test_no_barrier_beyond_the_transformation_stresses(T):
    assert transition_rates(sigma_A(T, W) + 1.0, T, sigma_A(T, W), sigma_M(T, W), W)[0] == W.omega_x
    assert transition_rates(sigma_M(T, W) - 1.0, T, sigma_A(T, W), sigma_M(T, W), W)[1] == W.omega_x


@given(x=st.floats(-1e-3, 1e-3), y=st.floats(-0.02, 0.02), alpha=st.floats(-1.0, 1.0), side=st.sampled_from([-1.0, 1.0]))
def test_gradient_of_the_wire_length(x, y, alpha, side):
    h = 1e-6
    _, *slopes = wire_length(x, y, alpha, side, B)
    for k, slope in enumerate(slopes):
        d = h * np.eye(3)[k]
        up, _, _, _ = wire_length(x + d[0], y + d[1], alpha + d[2], side, B)
        down, _, _, _ = wire_length(x - d[0], y - d[1], alpha - d[2], side, B)
        assert slope == pytest.approx((up - down) / (2 * h), abs=1e-8)


def test_beam_is_the_cantilever_of_textbooks():
    """A tip force P gives P L^3/(3 E I) and P L^2/(2 E I); a tip moment M gives M L^2/(2 E I) and M L/(E I)."""
    pose = record('Pose', STRUCTURE.coordinate_names)
    rest = pose(0, 0, 0)
    stiffness = -np.array([STRUCTURE.forces(pose(0, *moved), rest, B)[1:] for moved in ((1, 0), (0, 1))]).T
    compliance = np.linalg.inv(stiffness)
    L, EI = 0.1, 2e9 * math.pi * 2.5e-3**4 / 4
    assert compliance == pytest.approx(np.array([[L**3 / (3 * EI), L**2 / (2 * EI)], [L**2 / (2 * EI), L / EI]]))
    assert STRUCTURE.forces(pose(1, 0, 0), rest, B)[0] == pytest.approx(-2e9 * math.pi * 2.5e-3**2 / L)


def test_automaton_is_the_papers():
    """Edges of section III.C with their guards; the order of the edges is the uniqueness rule."""
    assert [(e.source, e.target, GUARD_NAMES[e.guard]) for e in EDGES] == [
        (1, 4, 'sigma > sigma_A'),
        (2, 5, 'sigma < sigma_M'),
        (3, 5, 'sigma < sigma_M'),
        (3, 4, 'sigma > sigma_A'),
        (4, 2, 'x_M > 1'),
        (4, 3, 'dx_M/dt < 0'),
        (5, 1, 'x_M < 0'),
        (5, 3, 'dx_M/dt > 0'),
    ]
    assert [frozen_fraction(mode, 0.4) for mode in (1, 2, 3)] == [0.0, 1.0, 0.4]


@pytest.mark.parametrize(('x', 'dx', 'mode'), [(0.5, 1e-3, 4), (0.5, -1e-3, 5), (0.5, 0, 3), (0, 0, 1), (1, 0, 2)])
def test_observed_mode(x, dx, mode):
    assert observed_mode(x, dx, 1e-5) == mode
