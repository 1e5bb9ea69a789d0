"""Material law of a single-crystal SMA wire: stress, transformation stresses, latent heat, energy.

Symbols follow the paper (equations MAS3 to L2c). All functions take and return SI scalars.
"""

from __future__ import annotations

import math

from sma_sim.model.parameters import WireConstants

RESISTIVITY_AT = 293.15  # [K]


def compliance(x: float, w: WireConstants) -> float:
    """x/E_M + (1 - x)/E_A [1/Pa] (the denominator of MAS3)."""
    return x / w.E_M + (1.0 - x) / w.E_A


def stress(eps: float, x: float, w: WireConstants) -> float:
    """sigma(eps, x) [Pa] (MAS3)."""
    return (eps - w.eps_T * x) / compliance(x, w)


def sigma_MW(T: float, w: WireConstants) -> float:
    """Maxwell stress [Pa] (MAS8a)."""
    return w.sigma_MW0 + w.sigma_T * (T - w.T0)


def sigma_A(T: float, w: WireConstants) -> float:
    """Stress at which austenite turns to martensite [Pa] (MAS7)."""
    return sigma_MW(T, w) + 0.5 * w.dsigma


def sigma_M(T: float, w: WireConstants) -> float:
    """Stress at which martensite turns to austenite [Pa] (MAS8)."""
    return sigma_MW(T, w) - 0.5 * w.dsigma


def fraction_at_stress(eps: float, sigma: float, w: WireConstants) -> float:
    """The x_M for which stress(eps, x_M) = sigma [-] (X0 and X1, with sigma = sigma_A or sigma_M)."""
    return w.E_M * (w.E_A * eps - sigma) / ((w.E_A - w.E_M) * sigma + w.E_A * w.E_M * w.eps_T)


def fraction_missing(eps: float, sigma: float, x: float, w: WireConstants) -> float:
    """By how much x_M is short of where stress(eps, x_M) = sigma, as if eps_T were all that it strains by [-].

    Zero where fraction_at_stress(eps, sigma) = x_M, but without its pole at sigma = -eps_T/d, where a wire that is pushed is
    as long in martensite as in austenite.
    """
    return (eps - sigma * compliance(x, w)) / w.eps_T - x


def gamma(sigma: float, w: WireConstants) -> float:
    """Gamma(sigma) = d sigma^2/2 + eps_T sigma [J/m^3] (L2a)."""
    return (0.5 * w.d * sigma + w.eps_T) * sigma


def gamma_T(T: float, w: WireConstants) -> float:
    """Derivative of Gamma(sigma_MW(T)) in T [J/(m^3 K)] (L2b)."""
    return (w.d * sigma_MW(T, w) + w.eps_T) * w.sigma_T


def latent_heat(T: float, sigma: float, w: WireConstants) -> float:
    """L_x: heat set free per unit of x_M [J] (L3a)."""
    return w.volume * (T * gamma_T(T, w) + gamma(sigma, w) - gamma(sigma_MW(T, w), w))


def heat_capacity(T: float, x: float, w: WireConstants) -> float:
    """Om rho c_V - L_T [J/K] (MAS9, L3b)."""
    return w.volume * (w.rho * w.c_V - T * w.d * w.sigma_T * w.sigma_T * (x - 1.0))


def internal_energy(elastic_strain: float, T: float, x: float, w: WireConstants) -> float:
    """U [J] of one wire; dU/dt = f v + J - lambda A_s (T - T_E) along every flow.

    `elastic_strain` is eps - eps_T x. U is unchanged by a jump of the hybrid automaton.
    """
    elastic = elastic_strain**2 / (2.0 * compliance(x, w))
    chemical = (x - 1.0) * gamma(sigma_MW(T, w), w) + T * (1.0 - x) * gamma_T(T, w)
    return w.volume * (elastic + chemical + w.rho * w.c_V * T)


def resistance(eps: float, x: float, T: float, w: WireConstants) -> float:
    """Electrical resistance R [ohm] of one wire: rho_e(x, T) l0 (1 + eps)^2/(pi r0^2).

    rho_e = (1 - x) rho_A (1 + a_A (T - 293.15 K)) + x rho_M (1 + a_M (T - 293.15 K)): phases in series along the wire, as
    bands are; length over section at constant volume, which the strain of transformation keeps (Furst and Seelecke, J.
    Intell. Mater. Syst. Struct. 23 (2012) 1233).
    """
    above = T - RESISTIVITY_AT
    austenite = w.resistivity_A * (1.0 + w.resistivity_T_A * above)
    martensite = w.resistivity_M * (1.0 + w.resistivity_T_M * above)
    return (austenite + x * (martensite - austenite)) * w.l0 * (1.0 + eps) ** 2 / w.section


def saturating_strain(load: float, most: float, half: float, elastic: float) -> float:
    """Strain e = most sigma/(sigma + half) [-] in series with an elastic wire: sigma elastic + e = load; nil in compression.

    The root of elastic sigma^2 + (elastic half + most - load) sigma - load half = 0, written so that nothing cancels.
    """
    if load <= 0.0 or most == 0.0:
        return 0.0
    b = elastic * half + most - load
    root = math.sqrt(b * b + 4.0 * elastic * half * load)
    sigma = 2.0 * load * half / (b + root) if b > 0.0 else (root - b) / (2.0 * elastic)
    return most * sigma / (sigma + half)
