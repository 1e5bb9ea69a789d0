"""Effects of the library in other forms: one coordinate, one wire, air that both wires share, another exponent.

Each is a closed kernel of its own, written from the law; none is made from an effect of the library or of a term of the
equation search.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from sma_sim.challenge.truth import Truth, drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

SOURCE = 'a law of the library in another form'


@dataclass(frozen=True)
class OtherForm:
    """A truth, and what a diagnosis should say of it.

    `effect` and `scopes`: the listed effect, '' where parameters of the model absorb the truth, and the scopes (as in
    NAME@SCOPE, '' for the effect itself) that are right. `terms`: those of equations that are exactly the truth.
    """

    truth: Truth
    effect: str
    scopes: tuple[str, ...]
    terms: tuple[tuple[str, ...], ...] = ()


def form(
    effect: str, scopes: tuple[str, ...], hidden: Effect, *terms: str, variables: tuple[str, ...] = ('T',)
) -> OtherForm:
    """A form with its truth."""
    truth = simulated_truth(hidden, library=effect, variables=variables)
    return OtherForm(truth, effect, scopes, tuple((term,) for term in terms))


def law(name: str, port: str, equation: str, parameters: tuple[Parameter, ...], kernel: Any, **more: Any) -> Effect:
    """The effect of a truth."""
    return Effect(f'form_{name}', port, equation, SOURCE, parameters, kernel, **more)


TAU = drawn_parameter('tau', 's', 4.0, 30.0, 'relaxation time')
RELAXING = {'states': ('z',), 'energy': 'dissipates'}

FORMS: dict[str, OtherForm] = {
    'hinge_creep': form('beam_creep', ('rotation',), law(
        'hinge_creep', 'structure_force', "M = c z, tau z' = alpha - z",
        (drawn_parameter('c', 'N m/rad', 0.05, 0.3, 'moment that relaxes'), TAU),
        lambda s, b, p, m: (0.0, 0.0, p.c * m.z), **RELAXING, scale=(0.1,),
        rate=lambda s, b, p, m: ((s.alpha - m.z) / p.tau,), start=lambda s, b, p: (s.alpha,)), 'hinge_relaxing'),
    'stretch_creep': form('beam_creep', ('stretch',), law(
        'stretch_creep', 'structure_force', "F_x = c z, tau z' = U_x - z",
        (drawn_parameter('c', 'N/m', 4e4, 1.5e5, 'force that relaxes'), TAU),
        lambda s, b, p, m: (p.c * m.z, 0.0, 0.0), **RELAXING, scale=(1e-4,),
        rate=lambda s, b, p, m: ((s.U_x - m.z) / p.tau,), start=lambda s, b, p: (s.U_x,))),
    'sideways_creep': form('beam_creep', ('deflection',), law(
        'sideways_creep', 'structure_force', "F_y = c z, tau z' = U_y - z",
        (drawn_parameter('c', 'N/m', 50.0, 250.0, 'force that relaxes'), TAU),
        lambda s, b, p, m: (0.0, p.c * m.z, 0.0), **RELAXING, scale=(1e-3,),
        rate=lambda s, b, p, m: ((s.U_y - m.z) / p.tau,), start=lambda s, b, p: (s.U_y,)), 'slide_relaxing'),
    'hinge_cubic': form('beam_nonlinearity', ('rotation',), law(
        'hinge_cubic', 'structure_force', 'M = -c alpha^3',
        (drawn_parameter('c', 'N m/rad^3', 5.0, 40.0, 'cubic stiffness'),),
        lambda s, b, p: (0.0, 0.0, -p.c * s.alpha**3)), 'alpha_cube'),
    'sideways_cubic': form('beam_nonlinearity', ('deflection',), law(
        'sideways_cubic', 'structure_force', 'F_y = -c U_y^3',
        (drawn_parameter('c', 'N/m^3', 3e5, 2e6, 'cubic stiffness'),),
        lambda s, b, p: (0.0, -p.c * s.U_y**3, 0.0)), 'U_y_cube'),
    'hinge_square': form('beam_nonlinearity', ('rotation', ''), law(
        'hinge_square', 'structure_force', 'M = -c |alpha| alpha',
        (drawn_parameter('c', 'N m/rad^2', 0.5, 3.0, 'stiffness'),),
        lambda s, b, p: (0.0, 0.0, -p.c * abs(s.alpha) * s.alpha)), 'alpha_abs'),
    'slide_friction': form('joint_friction', ('deflection',), law(
        'slide_friction', 'structure_force', 'F_y = -F_c tanh(U_y\'/w)',
        (drawn_parameter('F_c', 'N', 0.1, 0.8, 'friction'), drawn_parameter('w', 'm/s', 1e-4, 1e-3, 'speed')),
        lambda s, b, p: (0.0, -p.F_c * math.tanh(s.dU_y / p.w), 0.0)), 'slide_friction'),
    'sideways_damper': form('', ('',), law(
        'sideways_damper', 'structure_force', "F_y = -b U_y'",
        (drawn_parameter('b', 'N s/m', 20.0, 200.0, 'damping'),),
        lambda s, b, p: (0.0, -p.b * s.dU_y, 0.0)), 'slide_damping'),
    'wire_1_convection': form('natural_convection', ('wire_1',), law(
        'wire_1_convection', 'wire_heat', 'Q_1 = -h A_s (T - T_E)',
        (drawn_parameter('h', 'W/(m^2 K)', 40.0, 150.0, 'further convection'),),
        lambda s, w, p: (s.wire - 1.0) * p.h * w.surface * (s.T - s.T_E)), 'T'),
    'wire_2_free_convection': form('natural_convection', ('wire_2',), law(
        'wire_2_free_convection', 'wire_heat', 'Q_2 = -k A_s |T - T_E|^(5/4)',
        (drawn_parameter('k', 'W/(m^2 K^1.25)', 15.0, 60.0, 'free convection'),),
        lambda s, w, p: -s.wire * p.k * w.surface * abs(s.T - s.T_E) ** 0.25 * (s.T - s.T_E))),
    'square_convection': form('natural_convection', ('',), law(
        'square_convection', 'wire_heat', 'Q = -k A_s |T - T_E| (T - T_E)',
        (drawn_parameter('k', 'W/(m^2 K^2)', 1.0, 5.0, 'grows with the square'),),
        lambda s, w, p: -p.k * w.surface * abs(s.T - s.T_E) * (s.T - s.T_E)), 'T_abs', 'T_square'),  # the same above T_E
    'wire_1_power_loss': form('power_gain_mismatch', ('', 'wire_1'), law(
        'wire_1_power_loss', 'actuation', 'J_1 -> (1 - q) J_1',
        (drawn_parameter('q', '-', 0.06, 0.25, 'lost share'),),
        lambda s, w, p: s.J * (1.0 - p.q * (1.0 - s.wire)), stage='gain'), 'J'),
    'wire_2_deadband': form('driver_deadband', ('wire_2',), law(
        'wire_2_deadband', 'actuation', 'J_2 -> max(J_2 - J_d, 0)',
        (drawn_parameter('J_d', 'W', 0.03, 0.15, 'threshold'),),
        lambda s, w, p: s.J if s.wire < 0.5 else max(s.J - p.J_d, 0.0), stage='deadband')),
    'wire_1_lag': form('driver_lag', ('wire_1',), law(
        'wire_1_lag', 'actuation', "tau P' = J - P in wire 1",
        (drawn_parameter('tau', 's', 0.4, 2.0, 'time constant'),),
        lambda s, w, p, m: m.P if s.wire < 0.5 else s.J, stage='lag', states=('P',), scale=(0.5,),
        rate=lambda s, w, p, m: ((s.J - m.P) / p.tau,))),
    'rate_limited_driver': form('driver_lag', ('',), law(
        'rate_limited_driver', 'actuation', "P' = clip((J - P)/10 ms, -r, r)",
        (drawn_parameter('r', 'W/s', 0.15, 1.0, 'largest rate of the power of one wire'),),
        lambda s, w, p, m: m.P, stage='lag', states=('P',), scale=(0.5,),
        rate=lambda s, w, p, m: (max(-p.r, min(p.r, (s.J - m.P) / 0.01)),))),
    'wire_1_fatigue': form('functional_fatigue', ('wire_1',), law(
        'wire_1_fatigue', 'transformation_stress', "z' = |x'| (1 - z)/N, both stresses of wire 1 fall by s z",
        (drawn_parameter('s', 'Pa', 1.5e7, 4e7, 'loss'), drawn_parameter('N', '-', 1.0, 4.0, 'transformations')),
        lambda s, w, p, m: ((s.wire - 1.0) * p.s * m.z, (s.wire - 1.0) * p.s * m.z), states=('z',), scale=(1.0,),
        rate=lambda s, w, p, m: (abs(s.dx) * (1.0 - m.z) / p.N,)), 'training'),
    'unsaturated_fatigue': form('functional_fatigue', ('',), law(
        'unsaturated_fatigue', 'transformation_stress', "z' = |x'|, both stresses fall by r z",
        (drawn_parameter('r', 'Pa', 4e6, 1.2e7, 'loss per transformation'),),
        lambda s, w, p, m: (-p.r * m.z, -p.r * m.z), states=('z',), scale=(1.0,),
        rate=lambda s, w, p, m: (abs(s.dx),)), 'accumulated_transformation'),
    'wire_2_latent': form('latent_heat_scale', ('wire_2',), law(
        'wire_2_latent', 'wire_heat', "Q_2 = q x'",
        (drawn_parameter('q', 'J', 0.15, 0.3, 'further latent heat of a wire'),),
        lambda s, w, p: s.wire * p.q * s.dx)),
    'wire_1_resistance': form('resistance_feedback', ('wire_1',), law(
        'wire_1_resistance', 'actuation', 'J_1 -> J_1 (1 + a (T - T_E))',
        (drawn_parameter('a', '1/K', 1e-3, 4e-3, 'growth of resistance'),),
        lambda s, w, p: s.J * (1.0 + (1.0 - s.wire) * p.a * (s.T - s.T_E)), stage='gain'), 'J_dT'),
    'shared_air': form('ambient_heating', ('shared',), law(
        'shared_air', 'wire_heat', "C y' = n h A_s (T_1 + T_2 - 2 T_E - 2 y) - G y, Q = h A_s y in both wires",
        (drawn_parameter('G', 'W/K', 1.0, 6.0, 'to the room'), drawn_parameter('C', 'J/K', 20.0, 150.0, 'capacity')),
        lambda s, w, p, m: w.lambda_ * w.surface * m.y, states=('y',), scale=(10.0,),
        rate=lambda s, w, p, m: (
            (w.n * w.lambda_ * w.surface * (s.T + s.T_other - 2.0 * s.T_E - 2.0 * m.y) - p.G * m.y) / p.C,))),
    'one_way_exchange': form('thermal_crosstalk', ('wire_2',), law(
        'one_way_exchange', 'wire_heat', 'Q_2 = g (T_1 - T_2)',
        (drawn_parameter('g', 'W/K', 1e-3, 8e-3, 'conductance'),),
        lambda s, w, p: s.wire * p.g * (s.T_other - s.T)), 'exchange'),
    'wire_1_polycrystal': form('polycrystal', ('wire_1',), law(
        'wire_1_polycrystal', 'transformation_stress', 'both stresses of wire 1 rise by h (x - 1/2)',
        (drawn_parameter('h', 'Pa', 5e6, 3e7, 'rise from austenite to martensite'),),
        lambda s, w, p: ((1.0 - s.wire) * p.h * (s.x - 0.5), (1.0 - s.wire) * p.h * (s.x - 0.5)))),
    'wire_2_slopes': form('clausius_clapeyron_mismatch', ('wire_2',), law(
        'wire_2_slopes', 'transformation_stress', 'sigma_A of wire 2 rises by g (T - T0), sigma_M falls by it',
        (drawn_parameter('g', 'Pa/K', 5e4, 2e5, 'half of the difference of the slopes'),),
        lambda s, w, p: (s.wire * p.g * (s.T - w.T0), -s.wire * p.g * (s.T - w.T0)))),
    'wire_1_friction': form('guide_friction', ('wire_1',), law(
        'wire_1_friction', 'wire_force', "F_1 -> F_1 (1 + m tanh(v/w))",
        (drawn_parameter('m', '-', 0.03, 0.2, 'friction'), drawn_parameter('w', 'm/s', 3e-5, 3e-4, 'speed')),
        lambda s, w, p: (1.0 - s.wire) * s.F * p.m * math.tanh(s.v / p.w))),
    'saturating_hinge': form('beam_nonlinearity', ('rotation', ''), law(
        'saturating_hinge', 'structure_force', 'M = -c tanh(alpha/w)',
        (drawn_parameter('c', 'N m', 0.005, 0.03, 'largest moment'), drawn_parameter('w', 'rad', 0.02, 0.08, 'angle')),
        lambda s, b, p: (0.0, 0.0, -p.c * math.tanh(s.alpha / p.w))), 'alpha_saturating'),
    'forming_heat': form('latent_heat_scale', ('',), law(
        'forming_heat', 'wire_heat', "Q = q max(x', 0)",
        (drawn_parameter('q', 'J', 0.15, 0.4, 'further latent heat of one way'),),
        lambda s, w, p: p.q * max(s.dx, 0.0)), 'forming'),
    'curved_slopes': form('clausius_clapeyron_mismatch', ('',), law(
        'curved_slopes', 'transformation_stress', 'both stresses rise by g (T - T_E)^2',
        (drawn_parameter('g', 'Pa/K^2', 8e3, 3e4, 'curvature of the phase diagram'),),
        lambda s, w, p: (p.g * (s.T - s.T_E) ** 2, p.g * (s.T - s.T_E) ** 2)), 'T_square', 'T_abs'),  # the same above T_E
    'wire_1_heating': form('ambient_heating', ('wire_1',), law(
        'wire_1_heating', 'wire_heat', "tau y' = R n h A_s (T_1 - T_E - y) - y, Q_1 = h A_s y",
        (drawn_parameter('R', 'K/W', 2.0, 12.0, 'of the air'), drawn_parameter('tau', 's', 8.0, 40.0, 'time constant')),
        lambda s, w, p, m: (1.0 - s.wire) * w.lambda_ * w.surface * m.y, states=('y',), scale=(10.0,),
        rate=lambda s, w, p, m: ((p.R * w.n * w.lambda_ * w.surface * (s.T - s.T_E - m.y) - m.y) / p.tau,))),
    'wire_1_r_phase': form('r_phase', ('wire_1',), law(
        'wire_1_r_phase', 'transformation_stress', 'both stresses of wire 1 rise by q max(T_R - T, 0)',
        (drawn_parameter('q', 'Pa/K', 1e6, 4e6, 'slope'), drawn_parameter('T_R', 'K', 305.0, 320.0, 'begin')),
        lambda s, w, p: (
            (1.0 - s.wire) * p.q * max(p.T_R - s.T, 0.0), (1.0 - s.wire) * p.q * max(p.T_R - s.T, 0.0)))),
}  # fmt: skip
