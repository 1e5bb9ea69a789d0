"""What the solver does with awkward inputs: long rests, short pulses, jumps together, ringing, chattering, bad endings."""

import textwrap
from itertools import pairwise

import numpy as np
import pytest
from systems import COMBINATIONS, active, make_model

from sma_sim import Config, Input, Model, UserError, find_effects, simulate
from sma_sim.cli.main import main
from sma_sim.model.automaton import EDGES, GUARD_NAMES
from sma_sim.solver.inputs import segments
from sma_sim.solver.simulate import PIECES_AT_ONCE, uninterrupted

HOUR = 3600.0
EDGE_SET = {(edge.source, edge.target, GUARD_NAMES[edge.guard]) for edge in EDGES}


def module_input(times, J_eq, T_E=298.0, ramps=False):
    J_eq = np.asarray(J_eq, float)
    return Input(np.asarray(times, float), np.column_stack([J_eq, np.broadcast_to(T_E, J_eq.shape)]), (ramps, False))


def wire_input(times, strain, J=0.0, T_E=298.0):
    strain = np.asarray(strain, float)
    columns = [strain, np.broadcast_to(J, strain.shape), np.broadcast_to(T_E, strain.shape)]
    return Input(np.asarray(times, float), np.column_stack(columns), (True, False, False))


def still(system, duration):
    return module_input([0, duration], [0, 0]) if system == 'module' else wire_input([0, duration], [0.045, 0.045])


# Long and short


@pytest.mark.parametrize(('system', 'kind'), COMBINATIONS)
def test_hours_without_power_take_few_steps(system, kind):
    run = simulate(make_model(system, kind), still(system, 4 * HOUR), np.linspace(0, 4 * HOUR, 100))
    assert run.completed
    assert run.steps < 300  # of which the first second takes 200 with MAS kinetics
    assert len(run.jumps) <= 2


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_rest_after_heating_takes_few_steps(kind):
    model = make_model('module', kind)
    active_part = simulate(model, module_input([0, 10, 60], [12, 0, 0]), np.array([60.0]))
    whole = simulate(model, module_input([0, 10, 4 * HOUR], [12, 0, 0]), np.array([60.0, 4 * HOUR]))
    assert whole.completed
    assert whole.steps < active_part.steps + 200
    assert whole['T_1_K'][-1] == pytest.approx(298.0, abs=1e-3)


def test_pulse_of_a_microsecond_heats_by_its_energy():
    """J dt/(Om rho c_V - L_T) at once, x_M at rest inside the hysteresis."""
    model = make_model('wire', initial__x_M_1=0.5)
    w, J, width = model.compiled.wire, 100.0, 1e-6
    source = wire_input([0, 1.0, 1.0 + width, 1.1], [0.042] * 4, [0, J, 0, 0])
    run = simulate(model, source, np.array([0.5, 1.0 + width]))
    x, T = run['x_M'][0], run['T_K'][0]
    capacity = w.volume * (w.rho * w.c_V + T * w.d * w.sigma_T**2 * (1 - x))
    assert run['mode'][0] == 3
    assert run['T_K'][1] - T == pytest.approx(J * width / capacity, rel=1e-4)


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_train_of_short_pulses_is_its_mean_power(kind):
    """1 us pulses of 10 kW every ms against 10 W."""
    period, width, power = 1e-3, 1e-6, 1e4
    starts = np.arange(2000) * period
    times = np.concatenate([np.column_stack([starts, starts + width]).ravel(), [2.0]])
    pulsed = simulate(make_model('module', kind), module_input(times, [power, 0.0] * 2000 + [0.0]), np.array([1.9995]))
    mean = simulate(make_model('module', kind), module_input([0, 2], [power * width / period] * 2), np.array([1.9995]))
    assert pulsed.completed
    assert pulsed['T_1_K'][0] == pytest.approx(mean['T_1_K'][0], abs=0.1)
    assert pulsed['alpha_rad'][0] == pytest.approx(mean['alpha_rad'][0], rel=0.02)


# Jumps


def test_bundles_that_switch_together():
    """No heating, the room warms up and cools down: both bundles jump at the same instants and nothing bends.

    It does not last until they have settled: rounding decides then which of them stops first.
    """
    source = module_input([0, 5, 8, 11], [0, 0, 0, 0], [298.0, 330.0, 290.0, 290.0])
    run = simulate(make_model(), source, np.linspace(0, 11, 801))
    assert run.completed
    assert len(run.jumps) >= 4
    for first, second in zip(run.jumps[::2], run.jumps[1::2], strict=True):
        assert {first.wire, second.wire} == {1, 2}
        assert first.t == pytest.approx(second.t, abs=1e-6)
        assert (first.source, first.target) == (second.source, second.target)
    assert np.abs(run['alpha_rad']).max() < 1e-9
    assert (run['mode_1'] == run['mode_2']).mean() > 0.999
    assert run['x_M_1'] == pytest.approx(run['x_M_2'], abs=1e-9)


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize('system', ['wire', 'module'])
def test_log_of_jumps_replays_to_the_modes(system, seed):
    random = np.random.default_rng(seed)
    times = np.concatenate([[0], np.cumsum(random.uniform(0.5, 4.0, 10))])
    if system == 'module':
        source = module_input(times, random.uniform(-25, 25, 11), ramps=bool(seed % 2))
    else:
        source = wire_input(times, random.uniform(0.005, 0.07, 11), random.uniform(0, 1.5, 11))
    run = simulate(make_model(system), source, np.linspace(0, times[-1], 5000))
    assert run.completed and len(run.jumps) > 5
    assert [jump.j for jump in run.jumps] == list(range(len(run.jumps)))
    assert all(a.t <= b.t for a, b in pairwise(run.jumps))
    assert all((jump.source, jump.target, jump.guard) in EDGE_SET for jump in run.jumps)
    for wire in range(1, 3 if system == 'module' else 2):
        log = [jump for jump in run.jumps if jump.wire == wire]
        modes = run['mode' if system == 'wire' else f'mode_{wire}']
        assert all(a.target == b.source for a, b in pairwise(log))
        replayed = np.array([log[0].source] + [jump.target for jump in log])
        expected = replayed[np.searchsorted([jump.t for jump in log], run.time, side='right')]
        assert (modes == expected).all()


@pytest.mark.parametrize('system', ['wire', 'module'])
def test_fractions_and_stresses_stay_where_modes_want_them(system):
    random = np.random.default_rng(11)
    times = np.concatenate([[0], np.cumsum(random.uniform(0.5, 4.0, 12))])
    if system == 'module':
        source = module_input(times, random.uniform(-30, 30, 13))
    else:
        source = wire_input(times, random.uniform(0.001, 0.09, 13), random.uniform(0, 1.5, 13))
    model = make_model(system)
    w = model.compiled.wire
    run = simulate(model, source, np.linspace(0, times[-1], 4000))
    for end in ('',) if system == 'wire' else ('_1', '_2'):
        x, mode = run['x_M' + end], run['mode' + end]
        assert x.min() >= -1e-9 and x.max() <= 1 + 1e-9
        assert (x[mode == 1] == 0.0).all() and (x[mode == 2] == 1.0).all()
        T = run['T_K'] if system == 'wire' else run[f'T{end}_K']
        sigma = run['stress_Pa'] if system == 'wire' else run[f'F{end}_N'] / (w.n * w.section)
        above_M = (sigma - (w.sigma_MW0 + w.sigma_T * (T - w.T0) - 0.5 * w.dsigma)) / w.dsigma
        assert above_M[mode == 4] == pytest.approx(1.0, abs=1e-9)
        assert above_M[mode == 5] == pytest.approx(0.0, abs=1e-9)
        assert above_M[mode == 3].min() > -1e-6 and above_M[mode == 3].max() < 1 + 1e-6
        assert above_M[mode == 1].max(initial=0.0) < 1 + 1e-6 and above_M[mode == 2].min(initial=1.0) > -1e-6


def test_swings_across_a_guard():
    """Strain that swings by ever more about the edge of the hysteresis: each swing outwards transforms, none is lost."""
    t = np.linspace(0, 0.2, 401)
    strain = 0.045 + 1e-5 * np.sin(2 * np.pi * 50 * t) * np.exp(3 * t)
    run = simulate(make_model('wire'), wire_input(t, strain), np.linspace(0, 0.2, 2001))
    assert run.completed
    assert [(jump.source, jump.target) for jump in run.jumps] == [(3, 4), (4, 3)] * 10
    assert (np.diff(run['x_M']) >= -1e-12).all()
    assert run.chattering == 0


def test_ringing_module():
    """Almost no damping: the axial mode (1 kHz) rings while bundles switch."""
    model = make_model('module', beam__b_x=0.02, beam__b_y=0.02)
    run = simulate(model, module_input([0, 0.2, 0.4, 1], [30, -30, 30, 30]), np.linspace(0, 1, 1001))
    assert run.completed
    assert run.chattering == 0
    assert run.steps < 50_000


EFFECT = '''
from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter
import math
EFFECT = Effect(
    name='probe', equation='-', source='-',
    parameters=(Parameter('a', 1.0, '-', (-1e12, 1e12), '-', '', 0.0, (0.0, 1.0)),),
    {rest}
)
'''


def probe(tmp_path, rest, a=1.0):
    """An active effect of the user's own file."""
    (tmp_path / 'probe.py').write_text(EFFECT.format(rest=textwrap.dedent(rest)))
    return active('probe', find_effects([tmp_path]), a=a)


def test_chattering_is_counted_and_the_run_ends(tmp_path):
    """An effect that breaks d(sigma - sigma_A)/dx < 0: transforming softens the wire faster than it unloads it."""
    softening = probe(
        tmp_path,
        """port='transformation_stress', states=('m',), scale=(1.0,), rate=lambda s, w, p, m: abs(s.dx),
        kernel=lambda s, w, p, m: (-p.a * m.m, -p.a * m.m)""",
        a=5e9,
    )
    model = make_model('wire', effects=[softening])
    run = simulate(model, wire_input([0, 1, 2], [0.03, 0.05, 0.03]), np.linspace(0, 2, 201), max_steps=500_000)
    assert run.completed
    assert run.chattering > 100
    assert run.steps < 2_000
    assert np.isfinite(run['stress_Pa']).all()


# Input


def test_ramp_through_zero_is_split_there():
    times, values, slopes = segments(module_input([0, 1, 3, 4], [1.0, -3.0, 1.0, 1.0], ramps=True))
    assert times.tolist() == [0.0, 0.25, 1.0, 2.5, 3.0, 4.0]
    assert values[:, 0].tolist() == [1.0, 0.0, -3.0, 0.0, 1.0, 1.0]
    assert slopes[:, 0].tolist() == [-4.0, -4.0, 2.0, 2.0, 0.0, 0.0]


def test_ramp_through_zero_heats_one_bundle_and_then_the_other():
    model = make_model('module', wire__lambda=0.0, wire__sigma_T=0.0, initial__x_M_1=0.5, initial__x_M_2=0.5)
    run = simulate(model, module_input([0, 2], [5.0, -5.0], ramps=True), np.array([0.0, 2.0]))
    w = model.compiled.wire
    warmer = 2.5 / w.n / (w.volume * w.rho * w.c_V)  # adiabatic, no latent heat: 2.5 J each
    assert run['T_1_K'][1] - 298.0 == pytest.approx(warmer, rel=1e-4)
    assert run['T_2_K'][1] - 298.0 == pytest.approx(warmer, rel=1e-4)


def test_equal_rows_are_joined():
    times, values, _ = segments(module_input([0, 1, 2, 3, 4], [5, 5, 5, 2, 2]))
    assert times.tolist() == [0, 3, 4]
    assert values[:, 0].tolist() == [5, 2, 2]


@pytest.mark.parametrize('rows', ['0,0\n1,5\n1,6\n2,0\n', '0,0\n2,5\n1,0\n'])
def test_times_that_do_not_increase_are_refused(rows, tmp_path, capsys):
    file = tmp_path / 'input.csv'
    file.write_text('time_s,J_eq_W\n' + rows)
    assert main(['simulate', '--input', str(file), '--out', str(tmp_path / 'out.csv')]) == 2
    said = capsys.readouterr().err
    assert 'input.csv' in said and 'row 4' in said and 'time_s' in said
    assert not (tmp_path / 'out.csv').exists()


@pytest.mark.parametrize('ramps', [False, True])
@pytest.mark.parametrize('times', [[0, 1, 1, 2], [0, 2, 1, 3], [0, 1, np.nan, 2]])
def test_times_that_do_not_increase_are_refused_in_python(times, ramps):
    with pytest.raises(UserError, match='increase|finite'):
        simulate(make_model(), module_input(times, [0, 1, 2, 3], ramps=ramps), np.array([0.0]))


@pytest.mark.parametrize('values', [[[0.0, np.nan]] * 2, [[np.inf, 298.0]] * 2, [[0.0]] * 2, [[0.0, 298.0, 0.0]] * 2])
def test_values_that_make_no_input_are_refused(values):
    with pytest.raises(UserError):
        simulate(make_model(), Input(np.array([0.0, 1.0]), np.array(values), (False, False)), np.array([0.0]))


# Ends


def test_step_limit():
    run = simulate(make_model(), module_input([0, 100], [10, 10]), np.linspace(0, 100, 1001), max_steps=20)
    assert (run.completed, run.reason, run.steps) == (False, 'step limit reached', 20)
    assert 0 < len(run.time) < 1001
    assert np.isfinite(run['alpha_rad']).all()


def test_rate_that_is_not_finite(tmp_path):
    broken = probe(tmp_path, "port='wire_heat', kernel=lambda s, w, p: math.nan if s.t > 1.0 else 0.0")
    run = simulate(make_model(effects=[broken]), module_input([0, 2], [5, 5]), np.linspace(0, 2, 201))
    assert not run.completed
    assert run.reason.startswith('a rate is not a finite number here')
    assert run.end == pytest.approx(1.0, abs=0.011)


def test_state_that_is_not_finite(tmp_path):
    broken = probe(
        tmp_path,
        """port='wire_heat', states=('m',), scale=(1.0,), start=lambda s, w, p: math.inf,
        rate=lambda s, w, p, m: 0.0, kernel=lambda s, w, p, m: 0.0""",
    )
    run = simulate(make_model('wire', effects=[broken]), still('wire', 1.0), np.linspace(0, 1, 11))
    assert (run.completed, run.reason) == (False, 'a state is no longer finite')


def test_no_equilibrium():
    with pytest.raises(UserError, match='no static equilibrium'):
        broken = Config().variant({'beam.E': float('nan')})  # a fit may come there, a file may not
        simulate(Model(broken), module_input([0, 1], [0, 0]), np.array([0.0]))


def test_control_c_returns_what_there_is():
    source = module_input(np.linspace(0, 10, 3 * PIECES_AT_ONCE), 5 + np.arange(3 * PIECES_AT_ONCE) % 2)
    samples = np.linspace(0, 10, 101)

    def press(part):
        raise KeyboardInterrupt

    run = simulate(make_model(), source, samples, progress=press)
    whole = simulate(make_model(), source, samples)
    assert (run.completed, run.reason) == (False, 'Ctrl-C')
    assert 30 < len(run.time) < 40
    assert (run['alpha_rad'] == whole['alpha_rad'][: len(run.time)]).all()
    assert uninterrupted(whole) is whole
    with pytest.raises(KeyboardInterrupt):
        uninterrupted(run)


def test_looks_at_control_c_change_nothing():
    """Runs of many stretches are cut into parts between which the interpreter is asked: bit for bit the same."""
    times = np.linspace(0, 10, 2 * PIECES_AT_ONCE + 5)
    source = module_input(times, 5 + np.arange(len(times)) % 3)
    told = []
    run = simulate(make_model(), source, np.array([10.0]), progress=told.append)
    assert run.completed and told == sorted(told) and told[-1] == 1.0 and len(told) == 3


def test_sampling_does_not_change_the_run():
    source = module_input([0, 3, 10], [15, -10, 0])
    model = make_model()
    coarse, fine = (simulate(model, source, np.linspace(0, 10, n)) for n in (11, 10001))
    assert coarse.steps == fine.steps
    assert coarse.jumps == fine.jumps
    assert coarse['alpha_rad'] == pytest.approx(fine['alpha_rad'][::1000], abs=1e-15)


def test_one_model_may_run_in_many_threads():
    from concurrent.futures import ThreadPoolExecutor

    model: Model = make_model(effects=[active('natural_convection'), active('polycrystal'), active('beam_creep')])
    sources = [module_input([0, 5, 30], [J, -J, 0]) for J in np.linspace(5, 25, 8)]
    samples = np.linspace(0, 30, 301)
    alone = [simulate(model, source, samples) for source in sources]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda source: simulate(model, source, samples), sources * 4))
    for k, run in enumerate(together):
        assert (run['alpha_rad'] == alone[k % 8]['alpha_rad']).all()
