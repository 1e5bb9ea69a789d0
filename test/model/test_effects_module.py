"""Effects on the structure and on what is shown: potentials, dissipation, symmetry, frames."""

from types import SimpleNamespace

import numpy as np
import pytest
from flows import called
from systems import active, make_model, random_state

from sma_sim import Input, find_effects, simulate
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.effects.meaning import acts_on
from sma_sim.model.effects.ports import State
from sma_sim.model.structures.discovery import package_structures

MODULE, WIRE = (package_structures()[name] for name in ('module', 'wire'))
COMMAND = Input(
    np.array([0.0, 1.0, 7.0, 12.0, 16.0, 20.0]),
    np.column_stack([[0.0, 12.0, -10.0, 5.0, -3.0, 0.0], np.full(6, 298.0)]),
    (False, False),
)
MIRRORED = Input(COMMAND.times, COMMAND.values * [-1.0, 1.0], COMMAND.linear)
TIMES = np.linspace(0.0, 20.0, 401)
# What becomes of a parameter when the wires are exchanged; all others stay as they are.
EXCHANGED = {
    ('pretension_mismatch', 'delta'): lambda v: -v,
    ('gravity', 'g_y'): lambda v: -v,
    ('power_gain_mismatch', 'ratio'): lambda v: 1.0 / v,
    ('sensor_bias', 'U_y'): lambda v: -v,
    ('sensor_bias', 'alpha'): lambda v: -v,
    ('sensor_misalignment', 'theta'): lambda v: -v,
    **dict.fromkeys((('sensor_drift', 'U_y'), ('sensor_drift', 'alpha')), lambda v: -v),
    **dict.fromkeys((('sensor_jump', 'U_y'), ('sensor_jump', 'alpha')), lambda v: -v),
}
ASYMMETRIC = {name for name, _ in EXCHANGED}
BEAM = make_model().constants


def kernel(name, state, constants=BEAM, memory=None, **values):
    """What the kernel of an effect returns at a state, given by the fields that matter."""
    effect = find_effects()[name]
    s = State(*[0.0] * len(State._fields))._replace(**state)
    p = SimpleNamespace(**{q.name: values.get(q.name, q.default) for q in effect.parameters})
    return np.array(called(effect, 'kernel', s, constants, p, memory or {}))


def run(effects, source=COMMAND, **parameters):
    result = simulate(make_model('module', 'hybrid', effects, solver__rtol=1e-7, **parameters), source, TIMES)
    assert result.completed
    return result


@pytest.mark.parametrize('name', sorted(n for n, e in find_effects().items() if acts_on(e, MODULE)))
def test_exchanging_the_wires_mirrors_the_motion(name):
    """alpha -> -alpha and wire 1 <-> wire 2 under the mirrored command; by the mirrored value if it tells them apart."""
    here = {name: effect_on(find_effects()[name], MODULE)}
    parameters = here[name].parameters
    other = {q.name: EXCHANGED[name, q.name](q.default) for q in parameters if (name, q.name) in EXCHANGED}
    if name == 'clamp_slip':
        other = {'delta': 0.0, 'delta_2': parameters[0].default}
    start = {'wire__l0': 99e-3}  # wires that run out of martensite show their length
    one, two = run([active(name, here)], **start), run([active(name, here, **other)], MIRRORED, **start)
    assert two['alpha_rad'] == pytest.approx(-one['alpha_rad'], abs=2e-6)
    assert two['U_y_m'] == pytest.approx(-one['U_y_m'], abs=1e-7)
    assert two['U_x_m'] == pytest.approx(one['U_x_m'], abs=1e-7)
    assert two['T_2_K'] == pytest.approx(one['T_1_K'], abs=1e-3)
    if name in ASYMMETRIC:
        same = run([active(name, here)], MIRRORED, **start)
        assert np.abs(same['alpha_rad'] + one['alpha_rad']).max() > 1e-3


def shape(q, b):
    """Slope and curvature of the beam's cubic along its length, at Gauss points, and their weights."""
    x, weight = np.polynomial.legendre.leggauss(12)
    x, weight, L = 0.5 * b.L * (1.0 + x), 0.5 * b.L * weight, b.L
    A = np.linalg.solve([[L**2, L**3], [2 * L, 3 * L**2]], q[1:])  # w = A0 x^2 + A1 x^3 with w(L) = U_y, w'(L) = alpha
    return 2 * A[0] * x + 3 * A[1] * x**2, 2 * A[0] + 6 * A[1] * x, weight


def energy(q, stiffening, part, b):
    """Elastic energy of the nonlinear beam less that of the linear one, by quadrature."""
    slope, curvature, weight = shape(q, b)
    E_I = b.k_y * b.L**3 / 12.0
    shortening = part * (0.5 * slope**2 @ weight)
    hard = E_I * stiffening * b.L**2 / 4.0 * (curvature**4 @ weight)
    return hard + 0.5 * b.k_x * ((q[0] + shortening) ** 2 - q[0] ** 2)


def test_beam_pulls_back_as_its_energy_says():
    random = np.random.default_rng(1)
    for _ in range(20):
        q, b, c = random.normal(size=3) * [1e-4, 5e-3, 0.1], random.uniform(-3, 30), random.uniform(0, 1.2)
        got = kernel('beam_nonlinearity', dict(zip(('U_x', 'U_y', 'alpha'), q, strict=True)), b=b, c=c)
        for j, h in enumerate((1e-7, 1e-6, 1e-5)):
            e = h * np.eye(3)[j]
            slope = (energy(q + e, b, c, BEAM) - energy(q - e, b, c, BEAM)) / (2 * h)
            assert got[j] == pytest.approx(-slope, rel=1e-5, abs=1e-6 * abs(got).max())


def test_bent_to_an_arc():
    """Pure bending: the moment grows by 1 + b alpha^2, and the beam gets shorter as an arc does, L (1 - sin(a)/a)."""
    a, b = 0.1, 4.0
    arc = {'U_y': BEAM.L * a / 2, 'alpha': a, 'U_x': BEAM.L * (np.sin(a) / a - 1.0)}
    F = kernel('beam_nonlinearity', arc, b=b, c=0.0)
    assert F[2] == pytest.approx(-BEAM.k_a / 4.0 * b * a**3, rel=1e-9) and F[1] == pytest.approx(0.0, abs=1e-9)
    F = kernel('beam_nonlinearity', arc, b=0.0, c=1.0)
    assert F[0] - BEAM.k_x * arc['U_x'] == pytest.approx(0.0, abs=1e-3 * BEAM.k_x * abs(arc['U_x']))


def test_dry_friction_takes_energy_and_holds_the_plate():
    for speed in (-1.0, -1e-3, 0.0, 1e-3, 1.0):
        M = kernel('joint_friction', {'dalpha': speed}, M_c=0.03, w_s=1e-3)
        assert M[2] * speed <= 0.0 and (M[:2] == 0.0).all() and abs(M[2]) <= 0.03
    assert kernel('joint_friction', {'dalpha': 0.1}, M_c=0.03, w_s=1e-3)[2] == pytest.approx(-0.03)
    free, held = run([]), run([active('joint_friction', M_c=0.2)])
    assert np.ptp(held['alpha_rad']) < np.ptp(free['alpha_rad']) - 0.02


def test_friction_in_the_guides_takes_energy():
    wire = make_model().compiled.wire
    for F in (0.5, 2.0):
        for v in (-1e-2, -1e-5, 0.0, 1e-5, 1e-2):
            added = kernel('guide_friction', {'F': F, 'v': v}, wire, mu=0.2)
            assert added * v >= 0.0
    assert kernel('guide_friction', {'F': 2.0, 'v': 1.0}, wire, mu=0.2) == pytest.approx(2.0 * (np.exp(0.2) - 1.0))


def test_creep_takes_energy():
    """Power of the beam and of the effect is the change of stored energy less phi (q - z) K (q - z)/tau."""
    phi, tau, random = 0.3, 2.0, np.random.default_rng(3)
    b = BEAM
    K = np.array([[b.k_x, 0, 0], [0, b.k_y, -b.k_ya], [0, -b.k_ya, b.k_a]])
    for _ in range(20):
        q, z, dq = random.normal(size=(3, 3)) * [1e-4, 1e-3, 0.1]
        state = dict(zip(('U_x', 'U_y', 'alpha'), q, strict=True))
        F = kernel('beam_creep', state, b, {'z': z}, phi=phi, tau=tau) - K @ q
        dz = (q - z) / tau
        stored = (1 - phi) * dq @ K @ q + phi * (dq - dz) @ K @ (q - z)
        lost = -(F @ dq + stored)
        assert lost == pytest.approx(phi * (q - z) @ K @ (q - z) / tau, abs=1e-9 * abs(F @ dq)) and lost >= 0.0


def test_heat_goes_from_hot_to_cold():
    wire = make_model().compiled.wire
    for name in ('radiation', 'natural_convection'):
        for T in (250.0, 298.0, 350.0, 600.0):
            assert kernel(name, {'T': T, 'T_E': 298.0}, wire) * (T - 298.0) <= 0.0


def test_a_slack_wire_does_not_push():
    wire = make_model().compiled.wire
    F = np.concatenate([[-1e3], np.linspace(-0.2, 0.2, 81), [1e3]])
    for F_s in (1e-3, 0.02):
        passed = F + np.array([kernel('slack', {'F': f}, wire, F_s=F_s) for f in F])
        assert passed == pytest.approx(F_s * np.logaddexp(0.0, F / F_s), abs=1e-12)
        assert (passed >= 0.0).all() and (np.diff(passed) >= 0.0).all()
    cold = {'wire__sigma_MW0': 45e6}
    pushing, slack = run([], **cold), run([active('slack')], **cold)
    assert pushing['F_1_N'].min() < -0.1 and slack['F_1_N'].min() > -1e-9
    half = kernel('slack', {'F': -0.5}, wire, part=0.5, F_s=1e-3)
    assert half == pytest.approx(0.25, abs=1e-6)


def test_sensors_show_the_truth_through_gain_and_bias():
    truth = run([])
    gains = {'U_x': 0.9, 'U_y': 1.1, 'alpha': 1.2}
    offsets = {'U_x': 1e-5, 'U_y': -3e-4, 'alpha': 0.02}
    shown = run([active('sensor_bias', **offsets), active('sensor_gain', **gains)])
    for name, unit in (('U_x', 'm'), ('U_y', 'm'), ('alpha', 'rad')):
        column = f'{name}_{unit}'
        assert shown[column] == pytest.approx(gains[name] * truth[column] + offsets[name], rel=1e-12)
    for column in ('F_1_N', 'F_2_N', 'T_1_K', 'T_2_K'):
        assert (shown[column] == truth[column]).all()


def test_load_cell_of_the_wire():
    source = Input(np.array([0.0, 5.0]), np.array([[0.0, 0.1, 298.0], [0.05, 0.1, 298.0]]), (True, False, False))
    times = np.linspace(0.0, 5.0, 50)
    truth = simulate(make_model('wire'), source, times)
    shown = simulate(
        make_model('wire', effects=[active('sensor_bias', stress=3e6), active('sensor_gain', stress=0.9)]), source, times
    )
    assert shown['stress_Pa'] == pytest.approx(0.9 * truth['stress_Pa'] + 3e6, rel=1e-12)
    assert (shown['T_K'] == truth['T_K']).all()
    bias, wire = find_effects()['sensor_bias'], package_structures()['wire']
    saved = effect_on(bias, wire).derived(parameters=bias.parameters)  # by a version in which it had those of the module
    shown = simulate(make_model('wire', effects=[ActiveEffect(saved, (0.1, 0.2, 0.3, 3e6))]), source, times)
    assert shown['stress_Pa'] == pytest.approx(truth['stress_Pa'] + 3e6, rel=1e-12)


def test_turned_camera_turns_the_picture():
    theta = 0.07
    truth, shown = run([]), run([active('sensor_misalignment', theta=theta)])
    seen = (truth['U_x_m'] + 1j * truth['U_y_m']) * np.exp(-1j * theta)
    assert shown['U_x_m'] == pytest.approx(seen.real, abs=1e-15) and shown['U_y_m'] == pytest.approx(seen.imag, abs=1e-15)
    assert shown['alpha_rad'] == pytest.approx(truth['alpha_rad'] - theta, abs=1e-15)
    assert (shown['F_1_N'] == truth['F_1_N']).all()
    lagging = run([active('sensor_lag', tau=0.1), active('sensor_misalignment', theta=theta)])
    assert lagging['alpha_rad'][0] == pytest.approx(truth['alpha_rad'][0] - theta, abs=1e-12)


def test_effects_without_meaning_leave_a_wire_alone():
    names = [n for n, e in find_effects().items() if not acts_on(e, WIRE)]
    assert {'gravity', 'thermal_crosstalk', 'power_gain_mismatch', 'sensor_misalignment'} <= set(names)
    bare, rich = make_model('wire'), make_model('wire', effects=[active(name) for name in names])
    assert len(bare.scales) == len(rich.scales)
    state = random_state(bare, np.random.default_rng(0))
    again = random_state(rich, np.random.default_rng(0))
    assert (state.dy == again.dy).all() and (state.obs == again.obs).all()
