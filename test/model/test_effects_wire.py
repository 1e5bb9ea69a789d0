"""Effects on the wires against formulas and equivalences that are written down apart from their kernels."""

import numpy as np
import pytest
from systems import active, evaluate, make_model, random_state
from test_energy import energy_rate, power

from sma_sim import Input, simulate
from sma_sim.model.layout import O_DX, O_EPS, O_J, O_S_A, O_S_M, O_SIGMA, O_STRAIN, O_X
from sma_sim.model.material import heat_capacity, latent_heat, sigma_A, sigma_M
from sma_sim.model.parameters import K_B

STEFAN_BOLTZMANN = 2.0 * np.pi**5 * K_B**4 / (15.0 * 6.62607015e-34**3 * 299792458.0**2)
CYCLES = Input(
    np.array([0.0, 2.0, 4.0, 6.0, 8.0, 10.0]),
    np.array([[0.02, 0.2], [0.06, 0.5], [0.01, 0.0], [0.05, 0.3], [0.0, 0.0], [0.03, 0.0]]),
    (True, False),
)
CYCLES = Input(CYCLES.times, np.column_stack([CYCLES.values, np.full(6, 300.0)]), (True, False, False))
TIMES = np.linspace(0.0, 10.0, 1001)
KINDS = pytest.mark.parametrize('kind', ['hybrid', 'mas'])


def cycled(kind, effects=(), source=CYCLES, rtol=1e-8, **parameters):
    run = simulate(make_model('wire', kind, effects, solver__rtol=rtol, **parameters), source, TIMES)
    assert run.completed
    return run


def pair(system, kind, effect, seed, mode=3, **parameters):
    """The same random state with an effect and without it."""
    rich, bare = make_model(system, kind, [effect], **parameters), make_model(system, kind, **parameters)
    state = random_state(rich, np.random.default_rng(seed), mode)
    n = len(bare.scales)
    return state, evaluate(bare, state.y[:n].copy(), state.u, state.du, state.mode, state.x_frozen), rich.compiled


def capacities(state, p):
    return np.array([heat_capacity(state.y[p.first_T + i], state.obs[i, O_X], p.wire) for i in range(p.wires)])


def test_radiation_alone_holds_the_balance_with_heating():
    """Without convection a heated wire ends at T^4 = T_E^4 + J/(emissivity sigma_SB A_s)."""
    J, T_E, emissivity = 0.01, 298.0, 0.6
    source = Input(np.array([0.0, 500.0]), np.array([[0.0, J, T_E], [0.0, J, T_E]]), (True, False, False))
    model = make_model('wire', 'hybrid', [active('radiation', emissivity=emissivity)], wire__lambda=0.0, initial__x_M_1=0.0)
    T = simulate(model, source, np.array([500.0]))['T_K'][0]
    radiated = emissivity * STEFAN_BOLTZMANN * model.compiled.wire.surface * (T**4 - T_E**4)
    assert radiated == pytest.approx(J, rel=1e-5) and T > 330.0


@KINDS
def test_crosstalk_moves_heat_from_hot_to_cold(kind):
    for seed in range(10):
        state, bare, p = pair('module', kind, active('thermal_crosstalk', G=0.05), seed)
        T = state.y[6:8]
        gained = capacities(state, p) * (state.dy[6:8] - bare.dy[6:8])
        assert gained[0] == pytest.approx(0.05 * p.wire.l0 * (T[1] - T[0]), rel=1e-8)
        assert gained.sum() == pytest.approx(0.0, abs=1e-9 * abs(gained[0]))
        assert (gained / T).sum() >= 0.0  # entropy


@pytest.mark.parametrize('mode', [3, 4, 5, 0])
@pytest.mark.parametrize('system', ['wire', 'module'])
def test_scaled_latent_heat(system, mode):
    """C dT/dt = Q + k L_x dx/dt in every mode (0: MAS); x_M follows the plateau with that very heat."""
    k, kind = 1.7, 'hybrid' if mode else 'mas'
    for seed in range(10):
        state, bare, p = pair(system, kind, active('latent_heat_scale', k=k), seed, mode or 3)
        for i in range(p.wires):
            T, dx = state.y[p.first_T + i], state.obs[i, O_DX]
            L = latent_heat(T, state.obs[i, O_SIGMA], p.wire)
            into, size = power(state, i, p)
            heat = abs(L * dx) + size
            assert energy_rate(state, i, p) - into == pytest.approx((k - 1.0) * L * dx, abs=1e-11 * heat)
            if mode in (4, 5):  # dx = (a + b Q)/(c + g k L), linear in k in the denominator
                none = evaluate(make_model(system, kind, [active('latent_heat_scale', k=0.0)]), *state[:5]).obs[i, O_DX]
                assert 1 / dx - 1 / none == pytest.approx(k * (1 / bare.obs[i, O_DX] - 1 / none), rel=1e-6)


def test_heat_that_depends_on_the_rate_is_met_at_its_sign():
    """Where kernels see dx_M/dt they see that of the same instant: no heat at all is lost between T and x_M."""
    run = cycled('hybrid', [active('latent_heat_scale', k=2.0)])
    doubled = cycled('mas', [active('latent_heat_scale', k=2.0)])
    assert run['T_K'] == pytest.approx(doubled['T_K'], abs=0.6)  # MAS begins to transform 0.4 MPa early
    assert np.abs(run['T_K'] - cycled('hybrid')['T_K']).max() > 1.2


@KINDS
def test_pretension_is_a_shift_of_the_strain(kind):
    delta = 0.008
    shifted = Input(CYCLES.times, CYCLES.values - [delta / 2, 0.0, 0.0], CYCLES.linear)
    rich, bare = cycled(kind, [active('pretension_mismatch', delta=delta)]), cycled(kind, source=shifted)
    assert rich['stress_Pa'] == pytest.approx(bare['stress_Pa'], abs=1e3)
    assert rich['T_K'] == pytest.approx(bare['T_K'], abs=1e-4)


def test_pretension_differs_between_the_wires():
    state, _, p = pair('module', 'hybrid', active('pretension_mismatch', delta=0.01), 1)
    assert state.obs[:, O_STRAIN] == pytest.approx([0.005, -0.005], abs=1e-15)
    assert state.obs[0, O_EPS] - 0.005 - p.wire.eps_T * state.obs[0, O_X] == pytest.approx(
        state.obs[0, O_SIGMA] * (state.obs[0, O_X] / p.wire.E_M + (1 - state.obs[0, O_X]) / p.wire.E_A), rel=1e-12
    )


@KINDS
@pytest.mark.parametrize('others', [(), ('thermal_expansion', 'functional_fatigue', 'polycrystal')])
def test_soft_attachment_is_a_shift_of_both_compliances(kind, others):
    """Also with other strains and stresses, in every mode: the spring carries the stress of the wire."""
    C = 1e-4
    more = [active(name) for name in others]
    w = make_model('wire').compiled.wire
    c = C * w.section / w.l0
    rich = cycled(kind, [active('attachment_compliance', C=C), *more])
    soft = cycled(kind, more, wire__E_A=1.0 / (1.0 / w.E_A + c), wire__E_M=1.0 / (1.0 / w.E_M + c))
    stiff = cycled(kind, more)
    assert rich['stress_Pa'] == pytest.approx(soft['stress_Pa'], abs=2e3)
    assert rich['T_K'] == pytest.approx(soft['T_K'], abs=2e-4)
    assert rich['x_M'] == pytest.approx(soft['x_M'], abs=1e-5)
    assert np.abs(rich['stress_Pa'] - stiff['stress_Pa']).max() > 1e7


@pytest.mark.parametrize('mode', [1, 2, 3, 4, 5])
def test_soft_attachment_stores_what_the_wire_does_not_get(mode):
    """dU/dt + d/dt(Om c sigma^2/2) = work at the plate + heat."""
    for seed in range(10):
        state, _, p = pair('wire', 'hybrid', active('attachment_compliance', C=1e-4), seed, mode)
        model = make_model('wire', 'hybrid', [active('attachment_compliance', C=1e-4)])
        c, h = 1e-4 * p.wire.section / p.wire.l0, 1e-6
        ends = [evaluate(model, state.y + s * h * state.dy, state.u + s * h * state.du, *state[2:5]) for s in (-1, 1)]
        stress_rate = (ends[1].obs[0, O_SIGMA] - ends[0].obs[0, O_SIGMA]) / (2 * h)
        stored = p.wire.volume * c * state.obs[0, O_SIGMA] * stress_rate
        into, size = power(state, 0, p)
        size += abs(latent_heat(state.y[0], state.obs[0, O_SIGMA], p.wire) * state.obs[0, O_DX])
        assert energy_rate(state, 0, p, c * stress_rate) + stored == pytest.approx(into, abs=1e-5 * size)
        assert state.obs[0, O_STRAIN] == pytest.approx(c * state.obs[0, O_SIGMA], rel=1e-9)


def test_slopes_of_the_transformation_stresses():
    """sigma_A and sigma_M over temperature at the default and at extreme values; one stays above the other."""
    effect = active('clausius_clapeyron_mismatch', delta=3e5)
    for seed in range(10):
        state, bare, p = pair('wire', 'hybrid', effect, seed)
        w, T = p.wire, state.y[0]
        assert state.obs[0, O_S_A] == pytest.approx(sigma_A(w.T0, w) + (w.sigma_T + 1.5e5) * (T - w.T0), rel=1e-12)
        assert state.obs[0, O_S_M] == pytest.approx(sigma_M(w.T0, w) + (w.sigma_T - 1.5e5) * (T - w.T0), rel=1e-12)
    for delta in (-1e8, -1e6, 1e6, 1e8):
        model = make_model('wire', 'hybrid', [active('clausius_clapeyron_mismatch', delta=delta)])
        for T in (200.0, 290.0, 323.0, 380.0, 600.0):
            s = evaluate(model, np.array([T]), np.array([0.03, 0, 298.0]), np.zeros(3), np.array([3]), np.array([0.4]))
            assert s.obs[0, O_S_A] >= s.obs[0, O_S_M]


def test_r_phase_bends_the_stresses_at_its_temperature():
    q, T_R, width = 6e5, 315.0, 1.5
    model = make_model('wire', 'hybrid', [active('r_phase', q=q, T_R=T_R, w=width)])
    w = model.compiled.wire

    def levels(T):
        s = evaluate(model, np.array([T]), np.array([0.03, 0, 298.0]), np.zeros(3), np.array([3]), np.array([0.4]))
        return s.obs[0, [O_S_A, O_S_M]]

    cold, hot = (levels(250.0) - levels(249.0)), (levels(381.0) - levels(380.0))
    assert cold == pytest.approx(w.sigma_T - q, rel=1e-9) and hot == pytest.approx(w.sigma_T, rel=1e-9)
    assert levels(T_R) == pytest.approx(np.array([sigma_A(T_R, w), sigma_M(T_R, w)]) + q * width * np.log(2.0), rel=1e-12)
    assert levels(400.0) == pytest.approx([sigma_A(400.0, w), sigma_M(400.0, w)], rel=1e-12)


@KINDS
def test_fatigue_follows_the_transformation_so_far(kind):
    eps_r, sigma_r, z_r = 0.01, 2e7, 2.0
    run = cycled(kind, [active('functional_fatigue', eps_r=eps_r, sigma_r=sigma_r, z_r=z_r)])
    w = make_model('wire').compiled.wire
    strain = np.interp(TIMES, CYCLES.times, CYCLES.values[:, 0])
    x, sigma = run['x_M'], run['stress_Pa']
    left = strain - w.eps_T * x - sigma * (x / w.E_M + (1 - x) / w.E_A)
    z = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x)))])
    assert left == pytest.approx(eps_r * (1.0 - np.exp(-z / z_r)), abs=2e-5)
    assert left[-1] > 3e-3 and (np.diff(left) > -1e-9).all()
    if kind == 'hybrid':
        sunk = sigma - np.where(run['mode'] == 4, sigma_A(run['T_K'], w), sigma_M(run['T_K'], w))
        moving = run['mode'] > 3
        assert sunk[moving] == pytest.approx(-sigma_r * (1.0 - np.exp(-z / z_r))[moving], abs=4e4)
        assert moving.sum() > 200


@pytest.mark.parametrize('mode', [1, 2, 3, 4, 5, 0])
@pytest.mark.parametrize('system', ['wire', 'module'])
def test_current_heats_what_has_resistance(system, mode):
    """The heating is that of the phase and temperature of this instant."""
    r, a, kind = 0.3, 8e-4, 'hybrid' if mode else 'mas'
    for seed in range(5):
        state, bare, p = pair(system, kind, active('resistance_feedback', r=r, a=a), seed, mode or 3)
        martensite, austenite = 1.0 + r / 2, 1.0 - r / 2
        for i in range(p.wires):
            x, T = state.obs[i, O_X], state.y[p.first_T + i]
            ratio = (x * martensite + (1.0 - x) * austenite) * (1.0 + a * (T - 323.0))
            assert state.obs[i, O_J] == pytest.approx(bare.obs[i, O_J] * ratio, rel=1e-12)
            into, size = power(state, i, p)
            size += abs(latent_heat(T, state.obs[i, O_SIGMA], p.wire) * state.obs[i, O_DX])
            assert energy_rate(state, i, p) == pytest.approx(into, abs=1e-12 * size)
        assert state.obs[:, O_J].max() > 0.0


def test_lag_behind_the_resistance_filters_the_true_heating():
    """Actuation is a chain: the lag gets the heating that the resistance makes."""
    effects = [active('driver_lag', tau=0.5), active('resistance_feedback', r=0.4, a=0.0)]
    model = make_model('wire', 'hybrid', effects)
    state = random_state(model, np.random.default_rng(2), 3)
    x, P = state.obs[0, O_X], state.y[-1]
    assert state.obs[0, O_J] == P
    assert state.dy[-1] == pytest.approx((state.u[1] * (1.0 + 0.4 * (x - 0.5)) - P) / 0.5, rel=1e-12)


def heatings(effect, J_eq):
    model = make_model('module', 'hybrid', [effect])
    s = random_state(model, np.random.default_rng(0), 3)
    return evaluate(model, s.y, np.array([J_eq, 298.0]), s.du, s.mode, s.x_frozen).obs[:, O_J]


def test_deadband_takes_a_constant_power():
    effect = active('driver_deadband', J_d=0.1)
    got = np.array([heatings(effect, J)[0] for J in np.linspace(0.0, 10.0, 401)])
    J = np.linspace(0.0, 1.0, 401)
    assert got[0] == 0.0 and (np.diff(got) >= 0.0).all()
    assert got[J < 0.05] == pytest.approx(0.0, abs=1e-6) and got[J > 0.15] == pytest.approx(J[J > 0.15] - 0.1, abs=1e-6)
    assert np.abs(got - np.maximum(J - 0.1, 0.0)).max() < 0.05 * 0.1
    assert heatings(effect, -8.0) == pytest.approx([0.0, 0.7], rel=1e-4)


def test_gain_ratio_of_the_bundles():
    effect = active('power_gain_mismatch', ratio=1.3)
    one, two = heatings(effect, 7.0), heatings(effect, -7.0)
    assert one[1] == 0.0 and two[0] == 0.0
    assert one[0] / two[1] == pytest.approx(1.3, rel=1e-12) and one[0] * two[1] == pytest.approx(0.7**2, rel=1e-12)
