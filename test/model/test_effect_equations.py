"""Every effect of the library against its equation, written once more with other means, at random states."""

from types import SimpleNamespace

import numpy as np
import pytest
from flows import called
from numpy import cos, exp, sign, sin, tanh
from scipy.integrate import quad
from scipy.optimize import brentq
from systems import active, make_model

from sma_sim import Effect, find_effects, module_input, simulate
from sma_sim.model.effects import ports
from sma_sim.model.effects.ports import CHANNELS, State
from sma_sim.model.material import heat_capacity, latent_heat
from sma_sim.model.parameters import beam_constants, wire_constants
from sma_sim.model.structures.discovery import package_structures
from sma_sim.model.structures.geometry import shape_of
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.integrate import PER_WIRE, WIRE_COLUMNS

COLUMNS = ('length', 'v', 'F', 'sigma')

PARAMETERS = make_model().config.parameters
WHERE = sample_columns(package_structures()['module'])
WIRE, BEAM = wire_constants(PARAMETERS), beam_constants(PARAMETERS)
A_S = 2.0 * np.pi * 75e-6 * 0.0957  # [m^2] surface of one wire
E_A, E_M, EPS_T = 12.3e9, 7.8e9, 0.067


def softplus(x):
    return float(np.logaddexp(0.0, x))


def compliance(x):
    return x / E_M + (1.0 - x) / E_A


def quantile(x):
    """Half of atanh(0.95 (2 x - 1))/atanh(0.95): that of a logistic distribution without its tails."""
    return 0.5 * np.arctanh(0.95 * (2.0 * x - 1.0)) / np.arctanh(0.95)


def bias_or_gain(s, p):
    return getattr(p, {0: 'U_x', 1: 'U_y', 2: 'alpha', 3: 'F_1', 4: 'F_2', 7: 'stress'}[int(s.channel)])


def stepped(s, p):
    """A logistic step: (1 + tanh z)/2 = 1/(1 + exp(-2 z))."""
    return 1.0 / (1.0 + np.exp(min(4.0 * (p.t_slip - s.t) / p.w, 700.0)))


def limited(s, p):
    """The p-norm of 1/J and 1/limit, inverted."""
    return 1.0 / np.linalg.norm([1.0 / s.J, p.r], 2.0 * p.p)


def fatigue(s, p, m):
    part = 1.0 - exp(-m['z'] / p.z_r)
    return p.eps_r * part, -p.sigma_r * part, -p.sigma_r * part


def missing_share(s, p):
    return p.deficit * exp(-max(s.sigma - p.sigma_crit, 0.0) / p.k)


def spring(s, p):
    """Both in series carry one stress: strain - e = eps_T x + sigma s(x), e = c sigma."""
    c = p.C * np.pi * 75e-6**2 / 0.0957
    return c * (s.eps - s.strain - EPS_T * s.x) / (compliance(s.x) + c)


def in_series(s, most, half):
    """Strain e = most sigma/(sigma + half) under the load that is left, by bisection."""
    load, C = s.eps - s.strain - EPS_T * s.x, compliance(s.x)
    return (
        0.0 if load <= 0.0 else load - C * brentq(lambda q: q * C + most * q / (q + half) - load, 0.0, load / C, xtol=1e-9)
    )


def oriented(s, p):
    return in_series(s, p.eps_R * (1.0 - s.x) * 0.5 * (1.0 - tanh(0.5 * (s.T - p.T_R) / p.w)), p.sigma_R)


def overshoot(peak, x, p):
    """It falls by half of what a wire at constant strain loses by a fraction, at most."""
    return peak * exp(-x / max(p.x_n, 2.0 * peak / (EPS_T * E_M)))


def camera(s, p):
    """(U_x, U_y) in axes turned by theta."""
    axes = np.array([[cos(p.theta), sin(p.theta)], [-sin(p.theta), cos(p.theta)]])
    turned = axes @ [s.value if s.channel == 0 else s.U_x, s.value if s.channel == 1 else s.U_y]
    return s.value - p.theta if s.channel == 2 else turned[int(s.channel)]


EQUATIONS = {  # of state s, parameters p and memory m
    'ambient_drift': lambda s, p, m: 450.0 * A_S * p.c * s.t,
    'ambient_heating': lambda s, p, m: 450.0 * A_S * m['Theta'],
    'attachment_compliance': lambda s, p, m: spring(s, p),
    'clamp_slip': lambda s, p, m: p.delta * stepped(s, p),
    'clock_skew': lambda s, p, m: s.value,
    'driver_deadband': lambda s, p, m: 0.05 * p.J_d * softplus((s.J - p.J_d) / (0.05 * p.J_d)),
    'driver_lag': lambda s, p, m: m['P'],
    'driver_saturation': lambda s, p, m: limited(s, p),
    'functional_fatigue': fatigue,
    'gravity': lambda s, p, m: (BEAM.m_H * p.g_x, BEAM.m_H * p.g_y, 0.0),
    'grip_toe': lambda s, p, m: in_series(s, p.toe, p.sigma_t),
    'guide_friction': lambda s, p, m: s.F * np.expm1(p.mu * tanh(s.v / p.v_s)),
    'heat_capacity_difference': lambda s, p, m: (
        -p.r * 7745.0 * 380.0 * WIRE.volume * (s.T - p.T_ref) * s.dx,
        p.r * 7745.0 * 380.0 * WIRE.volume * (s.x - 0.5),
    ),
    'joint_friction': lambda s, p, m: (0.0, 0.0, -p.M_c * tanh(s.dalpha / p.w_s)),
    'latent_heat_scale': lambda s, p, m: (p.k - 1.0) * latent_heat(s.T, s.sigma, WIRE) * s.dx,
    'natural_convection': lambda s, p, m: -p.k * A_S * sign(s.T - s.T_E) * abs(s.T - s.T_E) ** (1.0 + p.m),
    'nucleation_peak': lambda s, p, m: (overshoot(p.peak_A, s.x, p), -overshoot(p.peak_M, 1.0 - s.x, p)),
    'polycrystal': lambda s, p, m: (p.spread * quantile(s.x),) * 2,
    'power_gain_mismatch': lambda s, p, m: s.J * p.ratio ** (0.5 - s.wire),
    'power_scale': lambda s, p, m: p.k * s.J,
    'pretension_mismatch': lambda s, p, m: 0.5 * p.delta * (1.0 - 2.0 * s.wire),
    'r_phase': lambda s, p, m: (p.q * p.w * softplus((p.T_R - s.T) / p.w),) * 2,
    'r_phase_strain': lambda s, p, m: oriented(s, p),
    'radiation': lambda s, p, m: -p.emissivity * 5.670374419e-8 * A_S * (s.T**2 + s.T_E**2) * (s.T + s.T_E) * (s.T - s.T_E),
    'resistance_feedback': lambda s, p, m: s.J * (1.0 + p.r * s.x - 0.5 * p.r) * (1.0 + p.a * (s.T - 323.0)),
    'sensor_bias': lambda s, p, m: s.value + bias_or_gain(s, p),
    'sensor_crosstalk': lambda s, p, m: s.value + (p.F if s.channel in (3, 4) else p.T) * s.neighbours,
    'sensor_drift': lambda s, p, m: s.value + quad(lambda t: bias_or_gain(s, p) * exp(-p.k * t), 0.0, s.t)[0],
    'sensor_gain': lambda s, p, m: s.value * bias_or_gain(s, p),
    'sensor_jump': lambda s, p, m: s.value + bias_or_gain(s, p) * stepped(s, p),
    'sensor_lag': lambda s, p, m: m['shown'],
    'sensor_misalignment': lambda s, p, m: camera(s, p),
    'slack': lambda s, p, m: p.part * (p.F_s * softplus(s.F / p.F_s) - s.F),
    'smooth_transformation': lambda s, p, m: (
        0.5 * p.width_A * (s.x**p.end_A - (1.0 - s.x) ** p.start_A),
        0.5 * p.width_M * (s.x**p.start_M - (1.0 - s.x) ** p.end_M),
    ),
    'stress_dependent_transformation_strain': lambda s, p, m: -EPS_T * m['m'] * s.x,
    'temperature_gradient': lambda s, p, m: (WIRE.sigma_T * p.dT * (s.x - 0.5),) * 2,
    'thermal_crosstalk': lambda s, p, m: p.G * 0.0957 * s.others * (s.T_other - s.T),
    'thermal_expansion': lambda s, p, m: (p.a + p.da * s.x) * (s.T - p.T_ref),
    'thermometer_lag': lambda s, p, m: m['shown'],
    'transformation_plasticity': lambda s, p, m: m['e'],
}
RATES = {
    'ambient_heating': lambda s, p, m: (p.R * 10.0 * 450.0 * A_S * (s.T - s.T_E - m['Theta']) - m['Theta']) / p.tau,
    'beam_creep': lambda s, p, m: (np.array([s.U_x, s.U_y, s.alpha]) - m['z']) / p.tau,
    'driver_lag': lambda s, p, m: tanh(p.rise * (s.J - m['P']) / (p.tau + 0.005 * p.rise)) / p.rise,
    'functional_fatigue': lambda s, p, m: abs(s.dx),
    'stress_dependent_transformation_strain': lambda s, p, m: (
        (missing_share(s, p) - m['m']) * s.dx / s.x if s.dx > 0.0 else 0.0
    ),
    'sensor_lag': lambda s, p, m: (s.value - m['shown']) / p.tau,
    'thermometer_lag': lambda s, p, m: (s.value - m['shown']) / p.tau,
    'transformation_plasticity': lambda s, p, m: (
        p.c * (s.sigma > 0.0) * s.sigma * abs(s.dx) * p.z_p / (p.z_p + m['z']),
        abs(s.dx),
    ),
}
STARTS = {
    'beam_creep': lambda s: (s.U_x, s.U_y, s.alpha),
    'sensor_lag': lambda s: s.value,
    'thermometer_lag': lambda s: s.value,
}


def random_state(random, channels):
    names = dict(zip(State._fields, random.uniform(-1.0, 1.0, len(State._fields)), strict=True))
    names |= {'T': random.uniform(290, 370), 'T_E': random.uniform(290, 305), 'T_other': random.uniform(290, 370)}
    names |= {'x': random.uniform(), 'wire': float(random.integers(2)), 'eps': 0.05 * random.uniform(), 'strain': 1e-3}
    names |= {
        'J': random.uniform(0.0, 1.0),
        'F': 0.02 * names['F'],
        'v': 1e-3 * names['v'],
        'dalpha': 0.02 * names['dalpha'],
    }
    names |= {'U_x': 1e-4 * names['U_x'], 'U_y': 5e-3 * names['U_y'], 'alpha': 0.2 * names['alpha']}
    names |= {'sigma': 1e8 * names['sigma'], 'channel': float(random.choice(channels)), 't': random.uniform(0.0, 100.0)}
    return State(**names)


def cases(name, count=30):
    """States, parameters within their realistic ranges, and memories of an effect."""
    effect, random = find_effects()[name], np.random.default_rng(3)
    channels = [CHANNELS.index(channel) for channel in effect.channels] or [0]
    for _ in range(count):
        p = SimpleNamespace(**{q.name: random.uniform(*q.realistic) for q in effect.parameters})
        size = (len(effect.states), 3) if effect.needs else len(effect.states)
        memory = dict(zip(effect.states, random.uniform(0.1, 0.9, size), strict=True))
        yield effect, random_state(random, channels), p, memory


@pytest.mark.parametrize('name', sorted(EQUATIONS))
def test_what_it_adds(name):
    for effect, s, p, memory in cases(name):
        constants = BEAM if effect.port == 'structure_force' else WIRE
        near = 1e-3 if effect.port == 'transformation_stress' else 1e-12  # [Pa]: of shifts that cancel
        expected = pytest.approx(EQUATIONS[name](s, p, memory), rel=1e-9, abs=near)
        assert called(effect, 'kernel', s, constants, p, memory) == expected


def test_every_effect_has_its_equation_here():
    apart = {'beam_creep', 'beam_nonlinearity', 'clausius_clapeyron_mismatch', 'cubic_stiffness', 'backlash'}
    assert {*EQUATIONS} | apart == set(find_effects())
    assert set(RATES) == {name for name, found in find_effects().items() if found.rate is not None}


@pytest.mark.parametrize('name', sorted(RATES))
def test_how_its_memory_changes(name):
    for effect, s, p, memory in cases(name):
        constants = BEAM if effect.port == 'structure_force' else WIRE
        rate = called(effect, 'rate', s, constants, p, memory)
        assert rate == pytest.approx(np.squeeze(RATES[name](s, p, memory)), rel=1e-9)
        if name in STARTS:
            assert called(effect, 'start', s, constants, p, memory) == pytest.approx(STARTS[name](s))


def strain_energy(q, b, c):
    """Energy beyond the linear one, by quadrature over the cubic shape w(0) = w'(0) = 0, w(L) = U_y, w'(L) = alpha."""
    (U_x, U_y, alpha), L, EI = q, 0.1, 2e9 * np.pi * 0.0025**4 / 4.0
    k_x = 2e9 * np.pi * 0.0025**2 / L

    def slope(x):
        return (6 * U_y / L - 2 * alpha) * (x / L) + (3 * alpha - 6 * U_y / L) * (x / L) ** 2

    def curvature(x):
        return (6 * U_y / L - 2 * alpha) / L + 2 * (3 * alpha - 6 * U_y / L) * x / L**2

    S = quad(lambda x: 0.5 * slope(x) ** 2, 0.0, L)[0]
    bending = quad(lambda x: EI * b * L**2 * curvature(x) ** 4 / 4.0, 0.0, L)[0]
    return bending + k_x * ((U_x + c * S) ** 2 - U_x**2) / 2.0


def test_a_nonlinear_beam_pulls_down_the_slope_of_its_energy():
    for effect, s, p, _ in cases('beam_nonlinearity', 12):
        q, steps = np.array([s.U_x, s.U_y, s.alpha]), np.diag([1e-8, 1e-6, 1e-5])
        slope = [(strain_energy(q + d, p.b, p.c) - strain_energy(q - d, p.b, p.c)) / (2.0 * d.sum()) for d in steps]
        assert effect.kernel(s, BEAM, p) == pytest.approx(-np.array(slope), rel=1e-5, abs=1e-7)


def test_a_creeping_beam_gives_back_part_of_its_stiffness():
    """F = phi K z with the stiffness of a clamped beam: 12 EI/L^3, -6 EI/L^2, 4 EI/L, EA/L."""
    EI, EA, L = 2e9 * np.pi * 0.0025**4 / 4.0, 2e9 * np.pi * 0.0025**2, 0.1
    K = np.array([[EA / L, 0, 0], [0, 12 * EI / L**3, -6 * EI / L**2], [0, -6 * EI / L**2, 4 * EI / L]])
    for effect, s, p, memory in cases('beam_creep'):
        added = called(effect, 'kernel', s, BEAM, p, memory)
        assert added == pytest.approx(p.phi * K @ memory['z'], rel=1e-9)


def test_stresses_go_apart_in_proportion_to_temperature():
    for effect, s, p, _ in cases('clausius_clapeyron_mismatch', 20):
        up, down = effect.kernel(s, WIRE, p)
        assert up == pytest.approx(0.5 * p.delta * (s.T - 323.0)) and up == -down


def test_polycrystal_goes_straight_on_outside():
    """Beyond x_M = 0 and 1 with the slope at the ends, so that a step of the solver may look there."""
    kernel, p = find_effects()['polycrystal'].kernel, type('P', (), {'spread': 1.0})
    at = [kernel(random_state(np.random.default_rng(1), [0])._replace(x=x), WIRE, p)[0] for x in (1.0, 1.1, 1.2, 0.0, -0.1)]
    end_slope = (quantile(1.0) - quantile(1.0 - 1e-6)) / 1e-6
    assert at[0] == pytest.approx(0.5) and at[3] == pytest.approx(-0.5)
    assert at[2] - at[1] == pytest.approx(0.1 * end_slope, rel=1e-4) and at[1] - at[0] == pytest.approx(at[2] - at[1])
    assert at[3] - at[4] == pytest.approx(0.1 * end_slope, rel=1e-4)


def test_fields_of_the_state_are_where_the_flow_writes_them():
    special = {'S_TIME': 't', 'S_POSE': 'U_x'}
    for name in (name for name in vars(ports) if name.startswith('S_')):
        plain = name[2:] if name[2:] in State._fields else name[2:].lower()
        field = special.get(name) or {'t_other': 'T_other', 'x_other': 'x_other'}.get(plain, plain)
        assert getattr(ports, name) == State._fields.index(field), name
    assert len(State._fields) == ports.S_POSE + 6


def test_a_wire_sees_the_other_ones_fraction():
    """Without a command, heat in proportion to the other wire's fraction warms a resting wire: rho c V dT/dt = Q."""
    effect = Effect(
        name='glow',
        port='wire_heat',
        equation='Q = 0.02 W x_other',
        source='',
        parameters=(),
        systems=('module',),
        kernel=lambda s, w, p: 0.02 * s.x_other,
    )
    found = {'glow': effect}
    for resting, other in ((2, 1), (1, 2)):  # the other one starts as martensite and transforms at once, with latent heat
        start = {f'initial__x_M_{other}': 1.0, f'initial__x_M_{resting}': 0.0, 'wire__lambda': 1.0}
        model = make_model(effects=[active('glow', found)], wire__l0=0.098, **start)
        warmed = simulate(model, module_input([0.0, 0.1], [0.0, 0.0]), np.array([0.0, 0.01]))
        x, T = warmed[f'x_M_{other}'], warmed[f'T_{resting}_K']
        assert warmed[f'mode_{resting}'][1] == 3.0 and x[0] > 1.1 * warmed[f'x_M_{resting}'][0] > 0.1
        capacity = heat_capacity(298.0, warmed[f'x_M_{resting}'][0], wire_constants(model.config.parameters))
        assert T[1] - T[0] == pytest.approx(0.02 * x.mean() * 0.01 / capacity, rel=0.01)


def test_values_of_a_sample_belong_together():
    """Lengths are those of the drawn module, their rates their slopes; a bundle's force is stress times its section."""
    run = FixedRateRun(make_model(), 1000.0, np.array([12.0, 298.0]))
    rows = []
    for _ in range(40):
        run.step(np.array([12.0, 298.0]), 10, 1)
        rows.append(run.sample.copy())
    for i in range(2):
        at = [row[WHERE.wires][i * PER_WIRE :][:PER_WIRE] for row in rows]
        length, rate, force, stress = (np.array([wire[WIRE_COLUMNS.index(c)] for wire in at]) for c in COLUMNS)
        drawn = [shape_of(*row[WHERE.pose], BEAM, 5).wires[i] for row in rows]
        assert length == pytest.approx([np.hypot(*(wire[-1] - wire[0])) for wire in drawn], rel=1e-9)
        slope = (length[2:] - length[:-2]) / 0.02
        assert rate[11:-1] == pytest.approx(slope[10:], rel=0.05, abs=1e-6)  # the first rows swing too fast for differences
        assert force == pytest.approx(stress * 10.0 * np.pi * 75e-6**2, rel=1e-9)
