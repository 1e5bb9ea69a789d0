"""Effects that wires show on test benches, and what the bench itself adds, against closed forms; their energy balance."""

from types import SimpleNamespace

import numpy as np
import pytest
from systems import active, evaluate, make_model, random_state
from test_bench import bench, isobar
from test_energy import energy_rate, power

from sma_sim import Input, simulate
from sma_sim.model.layout import O_DX, O_S_A, O_S_M, O_SIGMA, O_STRAIN, O_X
from sma_sim.model.material import latent_heat

E_A, E_M, EPS_T = 6e10, 4e10, 0.04  # of the alloy of test_bench
POLYCRYSTAL = 'polycrystal:spread=4e7'


def pull(strains, effects, T=450.0, rate=1e-4, kind='hybrid', **words):
    """Isothermal tensile test through some strains, from austenite."""
    given = [f'{name.replace("__", ".")}={value}' for name, value in words.items()]
    model = bench('strain', 'prescribed', 'initial.x_M_1=0', *given, effects=effects, kind=kind)
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(strains)))]) / rate
    values = np.column_stack([strains, np.full(len(times), T), np.zeros(len(times)), np.full(len(times), 298.0)])
    source = Input(times, values, (True, True, False, False), model.structure.input_columns)
    run = simulate(model, source, np.linspace(0.0, times[-1], 2001))
    assert run.completed
    return np.interp(run.time, times, strains), run


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_peaks_at_the_beginning_of_each_plateau(kind):
    """sigma = sigma_A + peak_A exp(-x/x_n) while martensite forms, sigma_M - peak_M exp(-(1 - x)/x_n) on the way back."""
    words = {'wire__V_L': 5e-22, 'wire__omega_x': 1e4}
    effect = 'nucleation_peak:peak_A=3e7,peak_M=1.5e7,x_n=0.1'
    strain, run = pull([0.0, 0.06, 0.0], [effect], kind=kind, **words)
    x, sigma, loading = run['x_M'], run['stress_Pa'], np.arange(len(strain)) <= 1000
    sigma_A, sigma_M = 1e8 + 6e6 * 30.0 + 0.6e8, 1e8 + 6e6 * 30.0 - 0.6e8
    expected = np.where(loading, sigma_A + 3e7 * np.exp(-x / 0.1), sigma_M - 1.5e7 * np.exp(-(1.0 - x) / 0.1))
    moving = (x > 0.01) & (x < 0.99)
    near = 2e3 if kind == 'hybrid' else 4e6  # MAS wires transform before sigma_A, by thermal activation
    assert moving.sum() > 500 and sigma[moving] == pytest.approx(expected[moving], abs=near)
    if kind == 'hybrid':
        assert sigma[loading & (x < 0.5)].max() == pytest.approx(
            sigma_A + 3e7, rel=5e-3
        )  # the instant before the first band
        half, inner = pull([0.0, 0.03, 0.02, 0.03], [effect])
        again = np.arange(len(half)) > 1500
        assert inner['stress_Pa'][again].max() < sigma_A + 1e6  # bands are there already


def test_a_peak_never_falls_faster_than_the_wire_unloads():
    for peak in (1e7, 1e8, 1e9):
        model = make_model('wire', 'hybrid', [active('nucleation_peak', peak_A=peak, peak_M=peak, x_n=1e-3)])
        w, kernel = model.compiled.wire, model.config.effects[0].effect.kernel
        p = SimpleNamespace(peak_A=peak, peak_M=peak, x_n=1e-3)
        shifts = np.array([kernel(SimpleNamespace(x=x), w, p) for x in np.linspace(0.0, 1.0, 10001)])
        assert np.abs(np.gradient(shifts, 1e-4, axis=0)).max() <= 0.5 * w.eps_T * w.E_M * (1.0 + 1e-3)


@pytest.mark.parametrize('stress', [1e8, 3e8])
def test_ratchet_is_logarithmic_and_in_proportion_to_stress(stress):
    """At constant stress e = c sigma z_p ln(1 + z/z_p) after transformation z, 2 for each cycle."""
    c, z_p, cycles = 3e-12, 4.0, 4
    effects = [POLYCRYSTAL, f'transformation_plasticity:c={c},z_p={z_p}']
    model = bench('stress', 'prescribed', effects=effects)
    times = np.linspace(0.0, 2000.0 * cycles, 400 * cycles + 1)
    T = 620.0 - 320.0 * np.abs((times / 1000.0) % 2.0 - 1.0)
    values = np.column_stack([np.full(len(times), stress), T, np.zeros(len(times)), np.full(len(times), 298.0)])
    run = simulate(model, Input(times, values, (True, True, False, False), model.structure.input_columns), times)
    x = run['x_M']
    left = run['strain'] - EPS_T * x - stress * (x / E_M + (1.0 - x) / E_A)
    z = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x)))])
    assert z[-1] == pytest.approx(2.0 * cycles, abs=0.1)
    expected = c * stress * z_p * np.log1p(z / z_p)
    assert left - left[0] == pytest.approx(expected, abs=2e-3 * expected[-1] + 2e-7)
    by_cycle = np.diff(left[200::400])
    assert (by_cycle > 0.0).all() and (np.diff(by_cycle) < 0.0).all()  # never nothing, the less the more there was


@pytest.mark.parametrize('stress', [5e6, 2e7, 1e8])
def test_r_phase_gives_strain_before_martensite(stress):
    """Cooled austenite: e = eps_R sigma/(sigma + sigma_R)/(1 + exp((T - T_R)/w)), back on heating; martensite has none."""
    effect = 'r_phase_strain:eps_R=0.006,T_R=430,w=4,sigma_R=1e7'
    T, run = isobar(bench('stress', 'prescribed', 'wire.sigma_MW0=2e8', effects=[effect]), stress, 395.0, 480.0)
    _, plain = isobar(bench('stress', 'prescribed', 'wire.sigma_MW0=2e8'), stress, 395.0, 480.0)
    assert np.ptp(plain['x_M'][200:600]) == 0.0 and run['x_M'] == pytest.approx(plain['x_M'], abs=0.02)
    parent = 1.0 - run['x_M']
    expected = 0.006 * parent * stress / (stress + 1e7) / (1.0 + np.exp((T - 430.0) / 4.0))
    apart = run['strain'] - EPS_T * run['x_M'] - stress * (run['x_M'] / E_M + parent / E_A)
    assert apart == pytest.approx(expected, abs=3e-6)


def test_toe_and_compliance_carry_the_stress_of_the_wire():
    """eps = sigma/E_A + c sigma + toe sigma/(sigma + sigma_t) in austenite: effects in series see one stress."""
    effects = ['attachment_compliance:C=2e-5', 'grip_toe:toe=2e-3,sigma_t=8e6', 'r_phase_strain:eps_R=4e-3,T_R=460,w=3']
    strain, run = pull([0.0, 0.006], effects, T=470.0)
    sigma, w = run['stress_Pa'], bench('strain', 'prescribed').compiled.wire
    c = 2e-5 * w.section / w.l0
    r_phase = 4e-3 * sigma / (sigma + 1e7) / (1.0 + np.exp(10.0 / 3.0))
    assert run['x_M'].max() == 0.0 and sigma[-1] > 1e8
    assert sigma / E_A + c * sigma + 2e-3 * sigma / (sigma + 8e6) + r_phase == pytest.approx(strain, abs=1e-12)


def test_what_forms_has_the_strain_of_its_stress_and_austenite_has_none():
    """eps_T x + e = integral of H(sigma) dx on a plateau that rises, in proportion to x on the way back."""
    oriented = 'stress_dependent_transformation_strain:deficit=0.8,k=1e8,sigma_crit=2e7'
    strain, run = pull([0.0, 0.03, 0.0], [POLYCRYSTAL, oriented], T=420.0, wire__dsigma=8e7)
    sigma, x, loading = run['stress_Pa'], run['x_M'], np.arange(len(strain)) <= 1000
    own = strain - sigma * (x / E_M + (1.0 - x) / E_A)
    H = EPS_T * (1.0 - 0.8 * np.exp(-np.maximum(sigma - 2e7, 0.0) / 1e8))
    forming = np.concatenate([[0.0], np.cumsum(0.5 * (H[1:] + H[:-1]) * np.diff(x))])
    back = ~loading & (x > 0.01)
    assert x.max() > 0.8 and np.ptp(H[loading & (x > 0.05) & (x < 0.7)]) > 0.03 * EPS_T
    assert own[loading] == pytest.approx(forming[loading], abs=2e-6)
    assert own[back] / x[back] == pytest.approx(own[1000] / x[1000], rel=1e-4)
    assert x[-1] == 0.0 and own[-1] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize('effect', ['stress_dependent_transformation_strain:deficit=0.7,k=1.2e8', 'r_phase_strain:T_R=300'])
def test_a_cold_wire_under_a_dead_weight_starts_as_martensite(effect):
    """A sharp transformation has no equilibrium at a constant load, however its strain depends on the fraction."""
    _, run = isobar(bench('stress', 'prescribed', effects=[effect]), 7e6)
    assert run['x_M'][0] == 1.0 and run['strain'][0] > 0.005 and run['x_M'][400] == 0.0
    assert run['strain'][-1] == pytest.approx(run['strain'][0], abs=1e-4)


@pytest.mark.parametrize('x_M', [0.0, 0.5, 1.0])
@pytest.mark.parametrize(('T', 'sigma'), [(300.0, 1e6), (300.0, 1e8), (310.0, 1e8)])
def test_a_wide_gradual_hysteresis_starts_where_its_stress_is(T, sigma, x_M):
    """Widths of gigapascals, as sparse steps are fitted by, put sigma_A beyond -eps_T/d."""
    effect = 'smooth_transformation:width_A=1.76e9,width_M=2e9,start_A=3.7,end_A=14.6,start_M=14.1,end_M=20.4'
    words = ('E_A=5.9e10', 'E_M=1.56e10', 'eps_T=0.033', 'sigma_T=7.15e6', 'sigma_MW0=3e8', 'dsigma=1.56e8', 'T0=445')
    model = bench('stress', 'prescribed', f'initial.x_M_1={x_M}', *(f'wire.{word}' for word in words), effects=[effect])
    source = Input([0.0, 10.0], [[sigma, T, 0.0, 298.0]] * 2, (True, True, False, False), model.structure.input_columns)
    run = simulate(model, source, [0.0, 10.0])
    assert run['stress_Pa'] == pytest.approx(sigma, rel=1e-6)
    elastic = sigma * (run['x_M'] / 1.56e10 + (1.0 - run['x_M']) / 5.9e10)
    assert run['strain'] == pytest.approx(elastic + 0.033 * run['x_M'], rel=1e-6)
    assert np.all(run['x_M'] > 0.98)


@pytest.mark.parametrize('m', [0.3, 0.9, 0.98])
@pytest.mark.parametrize('mode', [4, 5])
def test_the_fraction_is_found_where_it_hardly_strains_the_wire(m, mode):
    """sigma(eps - e, x) = sigma_A + s_A (or M) to rounding: what is left would be noise in every derivative."""
    effects = [active('stress_dependent_transformation_strain'), active('polycrystal', spread=2e7)]
    model, random = make_model('wire', 'hybrid', effects), np.random.default_rng(4)
    for _ in range(20):
        state = random_state(model, random, mode)
        state.y[1] = m
        found = evaluate(model, state.y, *state[1:5])
        if 0.0 < found.obs[0, O_X] < 1.0:
            assert abs(found.obs[0, O_SIGMA] - found.obs[0, O_S_A if mode == 4 else O_S_M]) < 1e-3


NAMES = ('transformation_plasticity', 'r_phase_strain', 'grip_toe', 'stress_dependent_transformation_strain')


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('mode', [2, 3, 4, 5])
def test_work_of_a_strain_is_what_the_balance_leaves_out(name, mode):
    """dU/dt with the strain of the effect taken off is what flows in less Om sigma de/dt."""
    model, h = make_model('wire', 'hybrid', [active(name)]), 1e-6
    p, random = model.compiled, np.random.default_rng(8)
    for _ in range(10):
        state = random_state(model, random, mode)
        ends = [evaluate(model, state.y + s * h * state.dy, state.u + s * h * state.du, *state[2:5]) for s in (-1, 1)]
        rate = (ends[1].obs[0, O_STRAIN] - ends[0].obs[0, O_STRAIN]) / (2 * h)
        into, size = power(state, 0, p)
        size += abs(latent_heat(state.y[0], state.obs[0, O_SIGMA], p.wire) * state.obs[0, O_DX])
        missing = energy_rate(state, 0, p, rate) - into
        assert missing == pytest.approx(-p.wire.volume * state.obs[0, O_SIGMA] * rate, abs=1e-5 * size)


def test_a_peak_keeps_the_first_law():
    for mode in (2, 3, 4, 5):
        model = make_model('wire', 'hybrid', [active('nucleation_peak')])
        for seed in range(10):
            state = random_state(model, np.random.default_rng(seed), mode)
            into, size = power(state, 0, model.compiled)
            size += abs(latent_heat(state.y[0], state.obs[0, O_SIGMA], model.compiled.wire) * state.obs[0, O_DX])
            assert energy_rate(state, 0, model.compiled) == pytest.approx(into, abs=1e-12 * size)


def test_toe_gives_back_what_it_took():
    """Elastic: no work over a closed cycle, toe sigma_t (ln(1 + sigma/sigma_t) - sigma/(sigma + sigma_t)) on the way."""
    toe, sigma_t = 2e-3, 8e6
    strain, run = pull([0.0, 0.005, 0.0], [f'grip_toe:toe={toe},sigma_t={sigma_t}'])
    sigma, x = run['stress_Pa'], run['x_M']
    own = strain - EPS_T * x - sigma * (x / E_M + (1.0 - x) / E_A)
    work = np.concatenate([[0.0], np.cumsum(0.5 * (sigma[1:] + sigma[:-1]) * np.diff(own))])
    expected = toe * sigma_t * (np.log1p(sigma / sigma_t) - sigma / (sigma + sigma_t))
    assert work == pytest.approx(expected, abs=2e-3 * expected.max()) and abs(work[-1]) < 1e-3 * expected.max()


def test_a_specimen_with_a_gradient_transforms_over_its_kelvins_both_ways():
    """x_M is linear in T over dT about the temperature at which all would transform at once; the hysteresis is as wide."""
    dT, stress = 3.0, 1e8
    T, run = isobar(bench('stress', 'prescribed', effects=[f'temperature_gradient:dT={dT}']), stress, rows=4001)
    _, even = isobar(bench('stress', 'prescribed'), stress, rows=4001)
    for way in (slice(None, np.argmax(T) + 1), slice(np.argmax(T), None)):
        jump = np.argmax(np.abs(np.diff(even['x_M'][way])))
        middle, x = 0.5 * (T[way][jump] + T[way][jump + 1]), run['x_M'][way]
        moving = (x > 0.02) & (x < 0.98)
        assert moving.sum() > 5
        assert T[way][moving] == pytest.approx(middle + dT * (0.5 - x[moving]), abs=np.abs(np.diff(T)).max())


@pytest.mark.parametrize('rate', [0.1, 10.0])
def test_rate_does_not_matter_where_stress_and_temperature_are_imposed(rate):
    """Isobaric tests a hundred times faster or slower: the same strain over temperature, memory and peaks included."""
    effects = [
        'smooth_transformation:width_A=1e8,width_M=1.5e8',
        'stress_dependent_transformation_strain',
        'transformation_plasticity:c=1e-11',
        'r_phase_strain:T_R=400',
        'nucleation_peak:peak_A=1e7',
    ]
    model = bench('stress', 'prescribed', effects=effects)
    T, expected = isobar(model, 1e8)
    times = np.linspace(0.0, 4000.0 / rate, len(T))
    values = np.column_stack([np.full(len(T), 1e8), T, np.zeros(len(T)), np.full(len(T), 298.0)])
    run = simulate(model, Input(times, values, (True, True, False, False), model.structure.input_columns), times)
    assert run['strain'] == pytest.approx(expected['strain'], abs=5e-5)


def test_rate_does_not_matter_at_an_imposed_strain_and_temperature():
    strains, effects = [0.0, 0.05, 0.02, 0.04], [POLYCRYSTAL, 'transformation_plasticity:c=1e-11']
    _, slow = pull(strains, effects, rate=1e-6)
    _, fast = pull(strains, effects, rate=1e-2)
    assert fast['stress_Pa'] == pytest.approx(slow['stress_Pa'], abs=1e4)
