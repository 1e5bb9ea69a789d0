"""What belongs to a bench is estimated under its priors, reported, and no finding: drifts, scale of power, lags, grips."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest

from sma_sim import FitOptions, Input, Model, PhysicsWarning, UserError, calibrate, read_config, read_dataset, simulate
from sma_sim.cli.main import main
from sma_sim.evidence.data.tables import read_columns, write_columns
from sma_sim.evidence.estimation.calibrate import problem_for
from sma_sim.evidence.estimation.held_out_prediction import evaluate_held_out
from sma_sim.evidence.estimation.prepared_fit import prepare
from sma_sim.evidence.estimation.recording_differences import AMBIENT, LENGTH, with_differences
from sma_sim.solver.inputs import inputs_at
from sma_sim.words.nuisances import ambient_sentence, factor_sentences, nuisance_data, nuisance_sentences

ALLOY = (
    'wire.E_A=4e10',
    'wire.E_M=2.5e10',
    'wire.eps_T=0.04',
    'wire.sigma_T=6e6',
    'wire.dsigma=6e7',
    'wire.sigma_MW0=3e8',
    'wire.n=1',
)
BENCH = ('system=wire', *ALLOY)
ISOTHERM = ('system=wire', 'bench.temperature=prescribed', 'initial.x_M_1=0', *ALLOY)
OFFSETS = ((2e6, -6e6), (-1e6, 4e6), (0.0, 5e6))  # [Pa] zeros of recordings, and by how much they drift
NOISE = {'stress': 1e5, 'T': 0.05}


def heated(folder, scale=1.0, effects=(), offsets=((0.0, 0.0),) * 3, rooms=(0.0,) * 3):
    """A clamped wire, heated by steps: `scale` times the power of the file, in rooms [K] off; with what the bench adds."""
    config, paths = read_config(words=BENCH, effects=effects), []
    for k, levels in enumerate(((0.3, 0.6), (0.5, 0.2), (0.15, 0.45))):
        times = np.array([0.0, 2.0, 10.0, 18.0, 30.0])
        power = np.array([0.0, *levels, 0.0, 0.0])
        values = np.column_stack([np.full(5, 0.02), power, np.full(5, 298.0)])
        source = Input(
            times,
            values * [1.0, scale, 1.0] + [0.0, 0.0, rooms[k]],
            (True, False, False),
            config.structure.input_columns,
        )
        t, random = np.arange(0.0, 30.0, 0.1), np.random.default_rng(k)
        run = simulate(Model(config), source, t)
        zero, drift = offsets[k]
        shown = {
            'stress_Pa': run['stress_Pa'] + zero + drift * (t / t[-1] - 0.5) + NOISE['stress'] * random.normal(size=len(t)),
            'T_K': run['T_K'] + NOISE['T'] * random.normal(size=len(t)),
        }
        columns = inputs_at(Input(times, values, source.linear, source.names), t) | shown
        paths.append(folder / f'run{k}.csv')
        write_columns(paths[-1], columns)
    return paths


def dataset_of(paths, mapping, system='wire', noise=NOISE):
    path = paths[0].with_name('map.yaml')
    path.write_text(f'system: wire\n{mapping}\n')
    return read_dataset(paths, system, 298.0, path, noise)


def with_noise_of_rows(paths, size):
    """Files whose temperature scatters by `size` of (t, T) beside the noise that they have, with a column of it."""
    for k, path in enumerate(paths):
        columns = read_columns(path, ('time_s', 'T_K'), with_gaps=('strain', 'J_W', 'T_E_K', 'stress_Pa'))
        random = np.random.default_rng(k)
        more = size(columns['time_s'], columns['T_K'])
        columns['T_K'] = columns['T_K'] + more * random.normal(size=len(more))
        write_columns(path, columns | {'T_std': np.hypot(more, NOISE['T'])})
    return paths


@pytest.mark.parametrize(
    ('size', 'entry'),
    [
        (lambda t, T: np.where(t % 2.0 < 1.0, 3.0, 0.0), 'T_K: {column: T_K, std: T_std}'),
        (lambda t, T: 0.01 * T, 'T_K: {column: T_K, relative_std: 0.01}'),
    ],
    ids=['of each row', 'relative'],
)
def test_noise_that_differs_from_row_to_row(tmp_path, size, entry):
    """Each sample counts by its own noise: errors are 1, and what the good ones tell is not lost among the bad ones."""
    paths = with_noise_of_rows(heated(tmp_path), size)
    options = FitOptions(free=('wire.lambda', 'wire.c_V'), kinetics='hybrid', starts=1)
    start = read_config(words=BENCH)
    noise = {'stress': 1e9} if 'std: T' in entry else NOISE  # the temperature alone tells, where its rows differ
    known = dataset_of(paths, entry, noise=noise)
    shown = known.recordings[0]
    spread = size(shown.time, shown.channels['T'])
    assert shown.sample_std['T'] == pytest.approx(np.hypot(spread, NOISE['T']), rel=1e-6)
    every = np.concatenate([one.sample_std['T'] for one in known.recordings])
    assert known.noise_std['T'] == pytest.approx(np.sqrt(np.mean(every**2)))
    found = calibrate(known, start, options)
    assert found.channel_errors['T'] == pytest.approx(1.0, abs=0.1)
    for name in options.free:
        assert found.intervals[name].low < start.parameters[name] < found.intervals[name].high
    if 'std: T' in entry:
        alike = calibrate(
            replace(known, recordings=tuple(replace(one, sample_std={}) for one in known.recordings)), start, options
        )
        assert found.intervals['wire.c_V'].std < 0.5 * alike.intervals['wire.c_V'].std
        assert 'noise of T: that of each row' in ' '.join(known.notes)
        assert not dataset_of(paths, entry).recordings[0].sample_std


def test_the_temperature_of_a_specimen_adds_to_the_noise_of_rows(tmp_path):
    """As to one of a whole channel: a thermometer is no better where the noise of strain is known by row."""
    T = np.concatenate([np.linspace(420.0, 300.0, 200), np.linspace(300.0, 420.0, 200)])
    strain = 0.04 / (1.0 + np.exp((T - 360.0) / 3.0)) + 1e-5 * np.random.default_rng(0).normal(size=len(T))
    rows = np.column_stack([2.0 * np.arange(len(T)), T, strain, np.where(T > 400.0, 3e-4, 1e-5)])
    np.savetxt(tmp_path / 'one.csv', rows, delimiter=',', header='time_s,T_K,e,e_std', comments='')
    found = []
    for entry in ('e', '{column: e, std: e_std}', '{column: e, std: e_std, relative_std: 0.01}'):
        (tmp_path / 'map.yaml').write_text(f'system: wire\nstress_Pa: {{value: 2.0e+8}}\nstrain: {entry}\n')
        (one,) = read_dataset([tmp_path / 'one.csv'], 'wire_under_load_at_T', 298.0, tmp_path / 'map.yaml').recordings
        found.append(one.sample_std['strain'])
    of_all, of_rows, relative = found
    slope = 0.04 / 3.0 / 4.0  # [1/K] at the steepest
    added = of_rows[T < 400.0].min()
    assert of_all == pytest.approx(added, rel=1e-3) and 0.1 < added / (0.5 * slope) < 0.7
    assert of_rows[T > 400.0] == pytest.approx(np.hypot(3e-4, added), rel=1e-3)
    assert relative == pytest.approx(np.hypot(of_rows, 0.01 * np.abs(strain)), rel=1e-3)


def test_noise_of_rows_that_is_none(tmp_path):
    paths = with_noise_of_rows(heated(tmp_path), lambda t, T: 0.0 * t)
    with pytest.raises(UserError, match='T_std: expected standard deviations above 0, or empty cells, got -0.05'):
        columns = read_columns(paths[1], ('time_s', 'T_K', 'T_std'), with_gaps=('strain', 'J_W'))
        write_columns(paths[1], columns | {'T_std': -columns['T_std']})
        dataset_of(paths, 'T_K: {column: T_K, std: T_std}')
    with pytest.raises(UserError, match='std and relative_std belong to measured columns, stress_Pa, T_K.*not to J_W'):
        dataset_of(paths[:1], 'J_W: {column: J_W, relative_std: 0.1}')
    with pytest.raises(UserError, match='std is the noise of one column'):
        dataset_of(paths[:1], 'T_K: {column: T_K, std: T_std, exponent: 2}')


def test_rooms_that_nobody_measured(tmp_path):
    """A map says how far they may be off: they come back, and lambda is not bent by them."""
    rooms = (-2.0, 1.5, 3.0)
    paths = heated(tmp_path, rooms=rooms)
    options = FitOptions(free=('wire.lambda', 'wire.c_V'), kinetics='hybrid', starts=1)
    start = read_config(words=BENCH)
    plain = calibrate(dataset_of(paths, ''), start, options)
    assert plain.error > 10.0 and not ambient_sentence(plain)
    known = dataset_of(paths, 'T_E_K: {column: T_E_K, zero_std: 3.0}')
    assert [one.ambient_std for one in known.recordings] == [3.0] * 3
    found = calibrate(known, start, options)
    assert found.error == pytest.approx(1.0, abs=0.05)
    assert [run.ambient for run in found.runs] == pytest.approx(rooms, abs=0.1)
    lambda_ = found.intervals['wire.lambda']
    assert lambda_.low < start.parameters['wire.lambda'] < lambda_.high
    assert 'run0 -2.0' in ambient_sentence(found) and 'run2 +3.0' in ambient_sentence(found)
    constant = dataset_of(paths, 'T_E_K: {value: 298.0, zero_std: 3.0}')
    assert constant.recordings[0].ambient_std == 3.0
    with pytest.raises(UserError, match='belong to measured columns'):
        dataset_of(paths, 'T_E_K: {column: T_E_K, zero_std: 3.0, drift_std: 1.0}')


def test_a_drifting_zero_is_that_of_the_load_cell(tmp_path):
    """Zeros and drifts of each recording come back; without them the error is many times the noise."""
    paths = heated(tmp_path, offsets=OFFSETS)
    drifting = dataset_of(paths, 'stress_Pa: {column: stress_Pa, zero_std: 2e6, drift_std: 5e6}')
    config = read_config(words=BENCH)
    found = evaluate_held_out(config, drifting)
    assert [run.zeros['stress'] for run in found] == pytest.approx([zero for zero, _ in OFFSETS], abs=5e4)
    assert [run.drifts['stress'] for run in found] == pytest.approx([drift for _, drift in OFFSETS], abs=1e5)
    assert max(run.error for run in found) < 1.15
    shifted = dataset_of(paths, 'stress_Pa: {column: stress_Pa, zero_std: 2e6}')
    assert min(run.error for run in evaluate_held_out(config, shifted)) > 5.0


def test_a_drift_stays_within_four_times_its_prior(tmp_path):
    dataset = dataset_of(heated(tmp_path, offsets=OFFSETS), 'stress_Pa: {column: stress_Pa, drift_std: 5e5}')
    found = evaluate_held_out(read_config(words=BENCH), dataset)
    assert [run.drifts['stress'] for run in found] == pytest.approx([-2e6, 2e6, 2e6]) and not found[0].zeros


def test_scale_of_power_and_lag_of_the_thermometer_come_back(tmp_path):
    """Beside material parameters, under their priors; a fit without them leaves more than noise."""
    effects = ['thermometer_lag:tau=0.4']
    paths = heated(tmp_path, 1.12, effects)
    declared = dataset_of(paths, 'nuisances: {power_scale: {k: 0.15}, thermometer_lag: {tau: 0.5}}')
    options = FitOptions(('wire.lambda', 'wire.sigma_MW0'), 'hybrid', starts=1)
    found = calibrate(declared, read_config(words=BENCH), options)
    assert found.error == pytest.approx(1.0, abs=0.1)
    truth = {'effects.power_scale.k': 1.12, 'effects.thermometer_lag.tau': 0.4, 'wire.lambda': 450.0}
    for interval in found.uncertainty.intervals:
        if interval.name in truth:
            half = 0.5 * (interval.high - interval.low)
            assert interval.low - half < truth[interval.name] < interval.high + half
    assert found.values['effects.power_scale.k'] == pytest.approx(1.12, abs=0.03)
    assert found.values['effects.thermometer_lag.tau'] == pytest.approx(0.4, abs=0.04)
    assert calibrate(dataset_of(paths, ''), read_config(words=BENCH), options).error > 3.0


def test_grips_come_back(tmp_path):
    """Toe and compliance at a tensile test: both moduli that plateaus and slopes show are those of the wire."""
    times, t = np.array([0.0, 40.0, 70.0, 120.0]), np.linspace(0.0, 120.0, 601)
    config = read_config(words=ISOTHERM, effects=['grip_toe:toe=1.5e-3,sigma_t=8e6'])
    values = np.column_stack([[0.0, 0.02, 0.01, 0.0], np.full(4, 350.0), np.zeros(4), np.full(4, 298.0)])
    source = Input(times, values, (True, True, False, False), config.structure.input_columns)
    run, random = simulate(Model(config), source, t), np.random.default_rng(3)
    path = tmp_path / 'pull.csv'
    write_columns(path, inputs_at(source, t) | {'stress_Pa': run['stress_Pa'] + 1e5 * random.normal(size=len(t))})
    noise, options = {'stress': 1e5}, FitOptions(('wire.E_A', 'wire.sigma_MW0', 'wire.dsigma'), 'hybrid', starts=1)
    declared = dataset_of([path], 'nuisances: {grip_toe: {toe: 1.0e-3, sigma_t: 5.0e+6}}', 'wire_at_T', noise)
    found = calibrate(declared, read_config(words=ISOTHERM), options)
    assert found.error == pytest.approx(1.0, abs=0.1)
    assert found.values['effects.grip_toe.toe'] == pytest.approx(1.5e-3, rel=0.1)
    assert found.values['wire.E_A'] == pytest.approx(4e10, rel=0.02)
    blind = calibrate(dataset_of([path], '', 'wire_at_T', noise), read_config(words=ISOTHERM), options)
    assert blind.error > 5.0


def test_a_nuisance_that_acts_on_nothing_measured_is_said(tmp_path):
    """A lag of the thermometer that imposes the temperature: that is taken as it is."""
    path, t = tmp_path / 'pull.csv', np.linspace(0.0, 50.0, 101)
    columns = {'strain': 1e-4 * t, 'T_K': 300.0 + t, 'stress_Pa': 1e6 * t}
    write_columns(path, {'time_s': t} | columns)
    dataset = dataset_of([path], 'nuisances: {thermometer_lag: {tau: 0.5}}', 'wire_at_T', {'stress': 1e5})
    with pytest.warns(PhysicsWarning, match='thermometer_lag acts on nothing that these recordings measure'):
        calibrate(dataset, read_config(words=ISOTHERM), FitOptions(('wire.E_A',), 'hybrid', starts=1, intervals=False))


@pytest.mark.parametrize('column', ['strain', 'T_K'])
def test_the_zero_of_what_is_imposed_is_said_to_be_taken_as_it_is(column, tmp_path):
    path, t = tmp_path / 'pull.csv', np.linspace(0.0, 50.0, 101)
    write_columns(path, {'time_s': t, 'strain': 1e-4 * t, 'T_K': 300.0 + t, 'stress_Pa': 1e6 * t})
    mapping = f'{column}: {{column: {column}, zero_std: 1e-3}}'
    with pytest.warns(PhysicsWarning, match=rf'{column}: it is imposed in pull, .* correct its zero in the file'):
        dataset_of([path], mapping, 'wire_at_T', {'stress': 1e5})
    with warnings.catch_warnings():
        warnings.simplefilter('error', PhysicsWarning)
        dataset_of([path], 'stress_Pa: {column: stress_Pa, zero_std: 1e6}', 'wire_at_T', {'stress': 1e5})


def test_what_nothing_measured_depends_on_is_said_not_to_differ(tmp_path):
    """At an imposed temperature and strain neither the room nor the length; of one recording of two, that one is named."""
    path, t = tmp_path / 'pull.csv', np.linspace(0.0, 50.0, 101)
    write_columns(path, {'time_s': t, 'strain': 1e-4 * t, 'T_K': np.full(101, 350.0), 'stress_Pa': 4e6 * t})
    dataset = with_differences(dataset_of([path], '', 'wire_at_T', {'stress': 1e5}), (AMBIENT, LENGTH))
    options = FitOptions(('wire.E_A',), 'hybrid', starts=1, intervals=False)
    found = calibrate(dataset, read_config(words=ISOTHERM), options)
    for said in (ambient_sentence(found), *factor_sentences(found)):
        assert said.endswith('nothing that was measured in pull depends on it, leave it out') and '+0.00' not in said
    (run,) = found.runs
    warm = replace(found, runs=(run, replace(run, name='hot', ambient=2.0, factors=(('wire.l0', 1.01),))))
    assert ambient_sentence(warm).endswith('[K]: hot +2.00; nothing that was measured in pull depends on it')
    assert factor_sentences(warm)[0].endswith('as a factor: hot 1.01; nothing that was measured in pull depends on it')


def test_they_are_told_apart(tmp_path):
    """In words and as data: what the model had from the start, zeros and drifts; a found effect is not among it."""
    paths = heated(tmp_path, 0.93, offsets=OFFSETS)
    mapping = 'stress_Pa: {column: stress_Pa, zero_std: 2e6, drift_std: 5e6}\nnuisances: {power_scale: {k: 0.1}}'
    found = calibrate(dataset_of(paths, mapping), read_config(words=BENCH), FitOptions(('wire.E_A',), 'hybrid', starts=1))
    data, words = nuisance_data(found, ()), nuisance_sentences(found, ())
    assert data['effects']['power_scale']['k'] == pytest.approx(0.93, abs=0.01)
    assert data['drifts']['run0']['stress'] == pytest.approx(-6e6, abs=1e5)
    assert data['zeros']['run1']['stress'] == pytest.approx(-1e6, abs=1e5)
    assert words[0].startswith('In the model from the start, no finding: power_scale, k 0.9')
    assert any(sentence.startswith('drift of stress, estimated for each recording') for sentence in words)
    assert not nuisance_data(found, ('power_scale',))['effects']


@pytest.mark.slow
def test_what_a_bench_adds_is_no_finding(tmp_path):
    """Nothing is missing: the verdict is none, whatever the bench adds."""
    paths = heated(tmp_path, 0.93, ['thermometer_lag:tau=0.3'], OFFSETS)
    (tmp_path / 'map.yaml').write_text(
        'system: wire\nstress_Pa: {column: stress_Pa, zero_std: 2e6, drift_std: 5e6}\n'
        'nuisances: {power_scale: {k: 0.1}, thermometer_lag: {tau: 0.5}}\n'
    )
    words = [word for name in BENCH for word in ('--set', name)]
    out = tmp_path / 'found.json'
    assert not main(
        [
            'diagnose',
            *map(str, paths),
            '--map',
            str(tmp_path / 'map.yaml'),
            *words,
            '--model',
            'hybrid',
            '--noise',
            'stress=1e5',
            '--noise',
            'T=0.05',
            '--no-equation',
            '--json',
            str(out),
        ]
    )
    found = json.loads(out.read_text())
    assert found['verdict'] == 'none' and found['effects'] == []
    assert found['nuisances']['effects']['thermometer_lag']['tau'] == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize(
    ('mapping', 'message'),
    [
        ('nuisances: [power_scale]', 'nuisances: expected effects such as'),
        ('nuisances: {power_scale: {k: -0.1}}', 'power_scale, k: expected a standard deviation, more than 0, got -0.1'),
        ('nuisances: {power_scale: {k: wide}}', 'power_scale, k: expected a number'),
        ('nuisances: {power_sale: {k: 0.1}}', 'power_sale is no effect on a bench; did you mean power_scale'),
        ('nuisances: {power_scale: {kk: 0.1}}', 'power_scale: no parameter kk; expected some of k'),
        ('stress_Pa: {column: stress_Pa, drift_std: -1}', 'drift_std: expected a positive number'),
    ],
)
def test_what_a_map_cannot_say(mapping, message, tmp_path):
    paths = heated(tmp_path)
    with pytest.raises(UserError, match=message):
        prepare(dataset_of(paths, mapping), read_config(words=BENCH))


def test_a_fit_of_named_parameters_has_those_of_the_bench_where_it_is_part_of_the_model(tmp_path):
    """Also a problem whose model lacks it, as that of a comparison, is well formed."""
    dataset = dataset_of(heated(tmp_path), 'nuisances: {power_scale: {k: 0.1}}')
    without, options = read_config(words=BENCH), FitOptions(('wire.E_A',), 'hybrid')
    assert [p.name for p in problem_for(dataset, without, options, 1).free] == ['wire.E_A']
    with_it = problem_for(dataset, prepare(dataset, without).config, options, 1)
    assert [(p.name, p.scale) for p in with_it.free if p.name != 'wire.E_A'] == [('effects.power_scale.k', 0.1)]
    assert not problem_for(dataset, prepare(dataset, without).config, FitOptions(()), 1).free


def test_what_is_active_already_stays(tmp_path):
    dataset = dataset_of(heated(tmp_path), 'nuisances: {power_scale: {k: 0.1}}')
    given = read_config(words=BENCH, effects=['power_scale:k=1.3'])
    assert prepare(dataset, given).config == given.variant(kinetics='hybrid')  # with which a fit begins
    (added,) = prepare(dataset, read_config(words=BENCH)).config.effects
    assert added.effect.name == 'power_scale' and added.values == (1.0,)
