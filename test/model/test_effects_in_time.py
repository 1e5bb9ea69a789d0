"""Effects that depend on time itself: drifts, jumps, a clamp that slips, clocks that differ; derivatives in an instant."""

import numpy as np
import pytest
from systems import active, evaluate, make_model, random_state
from test_energy import energy_rate, power

from sma_sim import Input, Model, module_input, read_config, simulate
from sma_sim.evidence.estimation.free_parameters import declared_parameters, free_parameter
from sma_sim.model.layout import O_DX, O_SIGMA, O_STRAIN
from sma_sim.model.material import latent_heat
from sma_sim.solver.sensitivities import Neighbour, simulate_with_tangents
from sma_sim.solver.simulate import new_run, new_work

KINDS = pytest.mark.parametrize('kind', ['hybrid', 'mas'])
COMMAND = module_input([0.0, 1.0, 5.0, 9.0, 12.0], [0.0, 12.0, -9.0, 0.0, 0.0])
TIMES = np.linspace(0.0, 12.0, 241)
DELTA = 1e-6


def ramp(t, instant, w):
    return 1.0 / (1.0 + np.exp(4.0 * (instant - t) / w))


def shown(*effects, source=COMMAND, times=TIMES, **parameters):
    run = simulate(make_model(effects=effects, solver__rtol=1e-8, **parameters), source, times)
    assert run.completed
    return run


@KINDS
def test_a_clamp_that_slips_is_a_wire_that_is_stretched_less(kind):
    """Stress and temperature are those of a test whose strain has the way of the clamp taken off."""
    delta, instant, w = 0.01, 2.0, 0.3
    fine = np.unique(np.concatenate([np.linspace(0.0, 6.0, 61), np.linspace(1.0, 3.0, 4001)]))
    knots = np.array([[0.02, 0.2, 298.0], [0.05, 0.2, 298.0], [0.01, 0.2, 298.0]])
    strain = np.interp(fine, [0.0, 4.0, 6.0], knots[:, 0])
    slipping = Input(np.array([0.0, 4.0, 6.0]), knots, (True, False, False))
    less = np.column_stack([strain - delta * ramp(fine, instant, w), np.full((len(fine), 2), [0.2, 298.0])])
    samples = np.linspace(0.0, 6.0, 301)
    effect = active('clamp_slip', delta=delta, t_slip=instant, w=w)
    found = simulate(make_model('wire', kind, [effect], solver__rtol=1e-8), slipping, samples)
    same = simulate(make_model('wire', kind, solver__rtol=1e-8), Input(fine, less, (True, False, False)), samples)
    assert found['stress_Pa'] == pytest.approx(same['stress_Pa'], abs=2e4)
    assert found['T_K'] == pytest.approx(same['T_K'], abs=5e-3) and np.ptp(found['T_K']) > 5.0
    assert found['x_M'] == pytest.approx(same['x_M'], abs=1e-4)


@pytest.mark.parametrize('mode', [1, 2, 3, 4, 5])
def test_what_a_slipping_clamp_takes_is_lost_there(mode):
    """dU/dt = f v + J - lambda A_s (T - T_E) - Om sigma de/dt at the instant of the slip."""
    effect = active('clamp_slip', delta=0.01, t_slip=0.0, w=0.5)
    model = make_model('wire', 'hybrid', [effect])
    for seed in range(10):
        state = random_state(model, np.random.default_rng(seed), mode)
        p, rate = model.compiled, 0.01 / 0.5
        into, size = power(state, 0, p)
        lost = p.wire.volume * state.obs[0, O_SIGMA] * rate
        size += abs(lost) + abs(latent_heat(state.y[0], state.obs[0, O_SIGMA], p.wire) * state.obs[0, O_DX])
        assert state.obs[0, O_STRAIN] == pytest.approx(0.005)
        assert energy_rate(state, 0, p, rate) == pytest.approx(into - lost, abs=1e-6 * size)
        later = evaluate(model, *state[:5], t=100.0)
        assert later.obs[0, O_STRAIN] == pytest.approx(0.01)


def test_zeros_drift_and_jump():
    truth = shown()
    drift = shown(active('sensor_drift', U_x=1e-6, U_y=2e-5, alpha=1e-3, F_1=0.1, F_2=-0.2))
    for column, rate in (('U_x_m', 1e-6), ('U_y_m', 2e-5), ('alpha_rad', 1e-3), ('F_1_N', 0.1), ('F_2_N', -0.2)):
        assert drift[column] - truth[column] == pytest.approx(rate * TIMES, rel=1e-9, abs=1e-12)
    warm = shown(active('sensor_drift', alpha=1e-3, k=0.2))
    assert warm['alpha_rad'] - truth['alpha_rad'] == pytest.approx(1e-3 * (1.0 - np.exp(-0.2 * TIMES)) / 0.2, rel=1e-9)
    jump = shown(active('sensor_jump', alpha=0.01, F_2=2.0, t_slip=4.5, w=0.05))
    for column, size in (('alpha_rad', 0.01), ('F_2_N', 2.0)):
        step = jump[column] - truth[column]
        assert step[TIMES < 4.4] == pytest.approx(0.0, abs=1e-3 * size)
        assert step[TIMES > 4.6] == pytest.approx(size, rel=1e-3)
    assert (jump['T_1_K'] == truth['T_1_K']).all()


def test_warmer_air_is_a_warmer_input():
    """A drift of the ambient is an input whose T_E rises, in steps of a fiftieth of a second."""
    times = np.linspace(0.0, 12.0, 601)
    held = np.searchsorted([1.0, 5.0, 9.0], times, side='right')
    rising = Input(times, np.column_stack([np.array([0.0, 12.0, -9.0, 0.0])[held], 298.0 + 0.5 * times]), (False, True))
    found, same = shown(active('ambient_drift', c=0.5)), shown(source=rising)
    assert found['T_1_K'] == pytest.approx(same['T_1_K'], abs=1e-3)
    assert found['alpha_rad'] == pytest.approx(same['alpha_rad'], abs=1e-6)


@pytest.mark.parametrize('rate', [0.02, -0.02])
def test_a_clock_that_differs_shows_another_instant(rate):
    """At t what was at (1 - rate) t; beyond the end of the input its last values hold."""
    found = shown(active('clock_skew', rate=rate))
    longer = Input(np.append(COMMAND.times, 13.0), np.vstack([COMMAND.values, COMMAND.values[-1:]]), COMMAND.linear)
    expected = shown(source=longer, times=(1.0 - rate) * TIMES)
    assert (found.time == TIMES).all()
    for column in ('alpha_rad', 'F_1_N', 'T_2_K', 'x_M_1'):
        assert found[column] == pytest.approx(expected[column], rel=1e-6, abs=1e-9)


CASES = [
    (('sensor_jump:alpha=0.01,t_slip=4.57,w=0.2',), ('sensor_jump.alpha', 'sensor_jump.t_slip', 'sensor_jump.w')),
    (('sensor_drift:alpha=1e-3,k=0.1', 'sensor_lag'), ('sensor_drift.alpha', 'sensor_drift.k', 'sensor_lag.tau')),
    (('clamp_slip:delta=0.01,t_slip=4.57,w=0.2',), tuple(f'clamp_slip.{p}' for p in ('delta', 'delta_2', 't_slip'))),
    (('clock_skew:rate=0.01',), ('clock_skew.rate',)),
    (('heat_capacity_difference:r=0.3',), ('heat_capacity_difference.r', 'heat_capacity_difference.T_ref')),
    (('driver_saturation', 'ambient_drift'), ('driver_saturation.r', 'driver_saturation.p', 'ambient_drift.c')),
    (('sensor_crosstalk',), ('sensor_crosstalk.F', 'sensor_crosstalk.T')),
]


@KINDS
@pytest.mark.parametrize(('effects', 'names'), CASES, ids=[case[1][0] for case in CASES])
def test_tangents_pass_through_what_happens_at_an_instant(effects, names, kind):
    """Derivatives of all samples against central differences, extrapolated; the steps of the run are far longer than w."""
    config = read_config(words=[f'model={kind}', 'solver.rtol=1e-8', 'wire.l0=0.099'], effects=effects)
    declared, values = declared_parameters(config), config.values
    free = [free_parameter(n, values[n], declared[n]) for n in ('wire.lambda', *(f'effects.{name}' for name in names))]
    channels = ('U_y', 'alpha', 'F_1', 'T_1')

    def at(z):
        model = Model(config.variant({f.name: f.value(x) for f, x in zip(free, z, strict=True)}))
        return model, new_run(model, np.asarray(COMMAND.values[0], float), new_work(model))

    def samples(z):
        model, run = at(z)
        return np.array(list(simulate(model, COMMAND, TIMES, initial_state=run, channels=channels).columns.values()))

    units = np.eye(len(free))
    model, run = at(np.zeros(len(free)))
    found = simulate_with_tangents(model, COMMAND, TIMES, run, channels, [Neighbour(*at(DELTA * unit)) for unit in units])
    expected = []
    for one, unit in zip(free, units, strict=True):
        step = 2e-3 if one.scale < 1.0 else 2e-3 / one.scale  # of an instant 2 ms
        wide, close = ((samples(h * unit) - samples(-h * unit)) / (2.0 * h) for h in (step, 0.5 * step))
        expected.append((4.0 * close - wide) / 3.0)
    size = np.sqrt((np.array(expected) ** 2).mean(axis=2))
    error = np.sqrt(((found.tangents - expected) ** 2).mean(axis=2))
    seen = size > 1e-3 * size.max(axis=0)  # of others only what differences of runs miss
    worst = np.where(seen, error / size.clip(1e-300), 0.0)
    assert seen.any(axis=0).all() and (worst < 4e-3).all(), worst
