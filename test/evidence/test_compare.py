"""Comparison: its numbers against closed forms, its words against errors that were put in, on purpose and nowhere else."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from measured_runs import CHANNELS, truth, write_isotherm, write_module_runs
from scipy import signal, stats

from sma_sim import (
    Dataset,
    DiagnosisRequest,
    FitOptions,
    Model,
    Recording,
    calibrate,
    diagnose,
    module_input,
    read_config,
    simulate,
)
from sma_sim.cli.main import main
from sma_sim.evidence.data.recordings import read_dataset
from sma_sim.evidence.data.train_test_split import split_dataset
from sma_sim.evidence.estimation.chi_square import chi_square_tail
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.residual_analysis.compare import compare
from sma_sim.evidence.residual_analysis.error_by_stratum import all_splits
from sma_sim.evidence.residual_analysis.metrics import channel_score, ljung_box
from sma_sim.evidence.residual_analysis.paired_comparison import error_changes
from sma_sim.evidence.residual_analysis.spectrum import BAND_EDGES, error_bands, welch
from sma_sim.evidence.residual_analysis.strata import band_dimension, dimensions, round_step
from sma_sim.evidence.residual_analysis.subgroups import Condition, Conditions, find_region, find_regions, trend
from sma_sim.evidence.residual_analysis.summary import find_error_regions, find_patterns, summarize
from sma_sim.evidence.residual_analysis.wire_states import RESTING, with_derived_states
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.words.comparison import comparison_data, spread_sentence
from sma_sim.words.repair_notes import grouped_notes

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return write_module_runs(tmp_path_factory.mktemp('runs'), truth())


@pytest.fixture(scope='module')
def dataset(folder):
    return read_dataset([folder], 'module', 298.0)


@pytest.fixture(scope='module')
def right(dataset):
    """Runs beside the model that made them, the last one held out."""
    fitted, held = split_dataset(dataset, ['run3'])
    return compare(fitted, truth(), held, 'right')


def with_error(comparison, channel, error, noise=1.0):
    """The comparison with `error(run)` (k,) [SI] added to what was measured, on white noise of so many sigma."""
    random = np.random.default_rng(4)

    def damaged(run):
        white = noise * run.noise[channel] * random.normal(size=len(run.time))
        return replace(run, measured={**run.measured, channel: run.predicted[channel] + white + error(run)})

    return replace(comparison, runs=tuple(damaged(run) for run in comparison.runs))


def test_the_right_model_leaves_noise(right):
    for channel in right.channels:
        for held in (False, True):
            one = channel_score(right.part(held), channel)
            assert one.over_noise == pytest.approx(1.0, abs=0.08)
            assert one.whiteness.p > 1e-4
            assert one.rmse == pytest.approx(one.over_noise * CHANNELS[channel], rel=0.01)
    assert abs(right.delay) < 2e-3
    assert find_error_regions(right) == () and find_patterns(right) == ()


def test_without_nuisances_runs_start_as_configured(dataset):
    found = compare(dataset, truth(), nuisances=False)
    assert found.delay == 0.0 and all(run.nuisance.start == () for run in found.runs)
    assert 1.0 < channel_score(found.runs, 'alpha').over_noise < 5.0  # sampled switching instants are not estimated


def test_whiteness_is_uniform_on_white_noise():
    random = np.random.default_rng(0)
    p = [ljung_box([random.normal(size=300), random.normal(size=200)]).p for _ in range(400)]
    assert 0.02 < np.mean(np.array(p) < 0.05) < 0.09
    assert 0.42 < np.mean(p) < 0.58


def test_whiteness_is_the_published_statistic():
    series = np.random.default_rng(1).normal(size=120)
    found = ljung_box([series])
    centred, k = series - series.mean(), len(series)
    rho = [np.sum(centred[h:] * centred[:-h]) / np.sum(centred**2) for h in range(1, 21)]
    assert found.statistic == pytest.approx(k * (k + 2) * sum(r**2 / (k - h) for h, r in enumerate(rho, 1)))
    assert found.lags == 20 and found.first == pytest.approx(rho[0])


def test_whiteness_sees_correlation_through_gaps():
    random = np.random.default_rng(2)
    series = np.convolve(random.normal(size=500), [1.0, 0.5], 'valid')
    series[random.integers(0, len(series), 100)] = np.nan
    found = ljung_box([series])
    assert found.p < 1e-3 and 0.1 < found.first < 0.5
    assert np.isnan(ljung_box([np.full(50, np.nan)]).p) and np.isnan(ljung_box([np.zeros(50)]).p)


@pytest.mark.parametrize('length', [64, 65])
def test_density_and_tail_are_those_of_scipy(length):
    values = np.random.default_rng(3).normal(size=500) + 1.0
    frequency, density = welch(values, 10.0, length)
    expected = signal.welch(values, 10.0, nperseg=length, detrend=False)
    assert frequency == pytest.approx(expected[0]) and density == pytest.approx(expected[1], rel=1e-9)
    for statistic, freedom in ((0.0, 1), (0.5, 1), (7.0, 3), (90.0, 40), (500.0, 2)):
        assert chi_square_tail(statistic, freedom) == pytest.approx(stats.chi2.sf(statistic, freedom), rel=1e-12)
    assert chi_square_tail(-1e-12, 2) == 1.0 and np.isnan(chi_square_tail(0.0, 0))


def test_bands_hold_what_was_put_in(right):
    size, frequency = 3e-3, 0.5
    wave = with_error(right, 'alpha', lambda run: size * np.sin(2.0 * np.pi * frequency * run.time), noise=0.0)
    found = {band.low: band for band in error_bands(wave.runs, 'alpha')}
    assert found[0.3].share > 0.98
    assert found[0.3].rms == pytest.approx(size / np.sqrt(2.0), rel=0.03)
    assert found[0.3].low in BAND_EDGES


def test_bands_of_white_noise_have_the_noise(right):
    white = with_error(right, 'alpha', lambda run: 0.0)
    found = error_bands(white.runs, 'alpha')
    assert sum(band.share for band in found) == pytest.approx(1.0)
    assert np.sqrt(sum(band.rms**2 for band in found)) == pytest.approx(CHANNELS['alpha'], rel=0.05)
    assert [band.over_noise for band in found if band.low >= 0.3] == pytest.approx(3 * [1.0], abs=0.2)


def test_shares_add_up(right):
    for split in all_splits(right):
        assert sum(share.error for share in split.shares) == pytest.approx(1.0)
        assert sum(share.time for share in split.shares) == pytest.approx(1.0)


def test_every_dimension_of_the_module_is_there(right):
    assert {way.name for way in dimensions(right)} >= {
        'mode of wire 1',
        'mode of wire 2',
        'temperature of wire 1',
        'heating or cooling of wire 2',
        'transforming wires',
        'command',
        'direction of motion',
        'amplitude',
        'time in the run',
        'run',
    }


def test_resting_wires_have_a_class_of_their_own():
    source = module_input([0.0, 20.0, 40.0, 150.0], [0.0, 10.0, 0.0, 0.0])
    run = simulate(Model(), source, 10.0)
    rests = with_derived_states(Config(), Config(), run.time, run.columns)['class_1'] == RESTING
    assert rests[run.time < 15.0].all() and rests[run.time > 140.0].all()
    assert not rests[(run.time > 20.1) & (run.time < 25.0)].any()


def in_mode_5_and_hot(run):
    return (run.states['class_1'] == 5) & (run.states['T_1_K'] > 320.0)


def test_an_error_in_a_mode_and_a_temperature_is_found(right):
    wrong = with_error(right, 'alpha', lambda run: 3e-3 * in_mode_5_and_hot(run))
    found = [region for region in find_error_regions(wrong) if region.channel == 'alpha'][0]
    inside = np.concatenate([in_mode_5_and_hot(run) for run in wrong.runs])
    squares = np.concatenate([run.residual('alpha') for run in wrong.runs]) ** 2
    assert any('wire 1' in words and ('mode 5' in words or 'above' in words) for words in found.conditions)
    assert found.share == pytest.approx(squares[inside].sum() / squares.sum(), abs=0.1)
    assert found.time == pytest.approx(inside.mean(), abs=0.05)
    assert found.bias == pytest.approx(3e-3, rel=0.2) and found.low < found.share < found.high
    assert 'measured above the model by 0.1' in found.text and re.search(r'(Confident|Likely) \(95 %', found.text)


def test_an_error_that_grows_is_said_to_grow(right):
    wrong = with_error(right, 'U_y', lambda run: 2e-4 * (run.states['J_eq_W'] > 0.0) * run.time / run.time[-1])
    told = [region for region in find_error_regions(wrong) if region.channel == 'U_y']
    assert any('grows over the run' in one.text or 'last quarter' in one.text for one in told)


def test_an_error_that_begins_late_grows_without_an_overflow():
    """Draws of blocks that have no early error are infinitely many times larger; those without late ones are zero."""
    late = np.repeat([False, False, True, True], 5)
    error, block = np.repeat([0.0, 1.0, 2.0, 2.0], 5), np.repeat(np.arange(4), 5)
    draws = np.array([[1, 1, 1, 1], [2, 0, 1, 1], [0, 1, 2, 1], [1, 3, 0, 0]])
    with np.errstate(all='raise'):
        assert trend(late, ~late, error, block, draws) == (4.0, 0.0, np.inf)


def test_evenly_spread_noise_is_no_finding(right):
    for channel in right.channels:
        wrong = with_error(right, channel, lambda run: 0.0, noise=3.0)
        assert [region.text for region in find_error_regions(wrong) if region.channel == channel] == []


def test_correlated_noise_is_seldom_a_finding(right):
    """Slow noise concentrates by chance: the search must know that."""
    random, told = np.random.default_rng(7), 0
    for _ in range(20):
        slow = with_error(right, 'alpha', lambda run: 4e-3 * ar1(random, len(run.time), 0.95), noise=1.0)
        told += len([region for region in find_error_regions(slow) if region.channel == 'alpha'])
    assert told <= 3


def ar1(random, count, rho):
    """Noise of unit variance whose neighbours are correlated by rho."""
    found = np.empty(count)
    found[0] = random.normal()
    for k in range(1, count):
        found[k] = rho * found[k - 1] + np.sqrt(1.0 - rho**2) * random.normal()
    return found


@pytest.mark.parametrize(
    ('shape', 'error', 'value', 'words'),
    [
        ('offset', lambda run: -2e-3 + 0.0 * run.time, -2e-3, 'a constant offset: measured below the model by 0.11'),
        (
            'scale',
            lambda run: 0.05 * (run.predicted['alpha'] - run.predicted['alpha'].mean()),
            0.05,
            'larger than the model by 5',
        ),
        ('lag', lambda run: -0.2 * np.gradient(run.predicted['alpha'], run.time), 0.2, 'later than the model by 0.2'),
    ],
)
def test_patterns_that_were_put_in_are_named(right, shape, error, value, words):
    found = find_patterns(with_error(right, 'alpha', error))
    assert found[0].shape == shape and found[0].channel == 'alpha'
    assert found[0].value == pytest.approx(value, rel=0.1)
    width = found[0].high - found[0].low
    assert width < 0.1 * abs(value) and found[0].low - width < value < found[0].high + width
    assert words in found[0].text


def test_an_error_that_is_spread_is_not_said_to_be_noise(right):
    """Of an error that concentrates nowhere its size is said; and that of noise is said to be noise."""
    for noise, words in (
        (1.0, 'The error is no more than noise.'),
        (28.0, 'times the noise in alpha, concentrates nowhere'),
    ):
        summary = summarize(with_error(right, 'alpha', lambda run: np.zeros(len(run.time)), noise))
        assert words in spread_sentence(summary) and summary.remarks == ()
        assert comparison_data(summary)['spread'] == spread_sentence(summary)
    assert float(spread_sentence(summary).split()[2]) == pytest.approx(28.0, rel=0.05)


def test_what_is_said_of_an_error_is_ordered_by_weight(right):
    """A large error of one channel comes before a small one of another, whatever kind of sentence it is."""
    small = with_error(right, 'U_y', lambda run: np.full(len(run.time), 2.0 * run.noise['U_y']))
    found = summarize(with_error(small, 'alpha', lambda run: 30.0 * run.noise['alpha'] * (run.time > 20.0)))
    weights = [remark.weight for remark in found.remarks]
    assert weights == sorted(weights, reverse=True) and found.remarks[0].channel == 'alpha'
    assert found.remarks[-1].channel == 'U_y' and len(found.remarks) == len(found.patterns) + len(found.findings)


def test_bands_have_round_edges():
    found = band_dimension('T', [np.array([291.3, 347.0])], 'wire 1 is {}', 'K')
    assert found.edges == (290.0, 300.0, 310.0, 320.0, 330.0, 340.0, 350.0)
    assert found.words(4, 5) == 'wire 1 is above 330 K'
    assert found.words(0, 0) == 'wire 1 is below 300 K'
    assert found.words(1, 2) == 'wire 1 is between 300 and 320 K'
    shown = band_dimension('T', [np.array([291.3, 347.0])], 'wire 1 is {}', 'deg C', 273.15)
    assert shown.words(4, 6) == 'wire 1 is above 50 deg C' and shown.classes[0].tolist() == [0, 6]
    assert round_step(0.3) == pytest.approx(0.5) and round_step(10.0) == 10.0


def test_the_nearer_of_two_configurations_is_told(dataset, right):
    fitted, held = split_dataset(dataset, ['run3'])
    off = compare(fitted, truth(beam__E=1.1), held, 'off')
    found = {(change.channel, change.held_out): change for change in error_changes(off, right)}
    assert len(found) == 10
    assert found['alpha', True].high < 1.0 and 'nearer on the runs held out' in found['alpha', True].text
    assert all(
        one.ratio == pytest.approx(1.0) and 'no significant difference' in one.text for one in error_changes(right, right)
    )


def test_missing_samples_and_channels_are_left_out(dataset):
    first, *others = dataset.recordings
    alpha = first.channels['alpha'].copy()
    alpha[50:150] = np.nan
    fewer = {name: values for name, values in first.channels.items() if name not in ('alpha', 'F_1')}
    holed = replace(dataset, recordings=(replace(first, channels={**fewer, 'alpha': alpha}), *others))
    found = compare(holed, truth())
    samples = sum(len(run.time) for run in found.runs)
    assert channel_score(found.runs, 'alpha').samples == samples - 100
    assert channel_score(found.runs, 'F_1').samples == samples - len(first.time)
    assert channel_score(found.runs[:1], 'F_1') is None
    assert {split.channel for split in all_splits(found)} == set(found.channels)


def test_a_wire_is_compared_with_its_own_dimensions(tmp_path):
    write_isotherm(tmp_path / 'a.csv', truth('wire'), 315.0)
    dataset = read_dataset([tmp_path], 'wire', 298.0, noise_std={'stress': 1e6})
    found = compare(dataset, read_config(words=['system=wire']))
    assert found.channels == ('stress',)
    assert {'mode of the wire', 'amplitude', 'direction of motion'} <= {way.name for way in dimensions(found)}
    assert channel_score(found.runs, 'stress').over_noise == pytest.approx(1.0, abs=0.1)


def test_order_of_runs_changes_no_number(dataset, right):
    fitted, held = split_dataset(dataset, ['run3'])
    turned = compare(replace(fitted, recordings=fitted.recordings[::-1]), Config(), held, 'right')
    for channel in right.channels:
        one, two = channel_score(right.part(False), channel), channel_score(turned.part(False), channel)
        assert one.over_noise == pytest.approx(two.over_noise, rel=1e-3)


def test_work_is_done_on_the_executor_that_is_given(dataset):
    with executor_or_threads(None) as pool:
        assert compare(dataset, truth(), executor=pool).label == ''


def test_command_writes_data_for_programs(folder, tmp_path, capsys):
    data = tmp_path / 'compare.json'
    (tmp_path / 'off.yaml').write_text('beam: {E: 2.2e+9}\n')
    words = ['compare', str(folder), '--config', str(tmp_path / 'off.yaml'), '--config', str(ROOT / 'config/module.yaml')]
    assert main([*words, '--hold-out', 'run3', '--json', str(data)]) == 0
    found = json.loads(data.read_text())
    first, second = found['comparisons']
    assert first['error']['held_out'] > 2.0 > 1.1 > second['error']['held_out'] > 0.9
    assert first['findings'] or first['patterns']
    assert first['channels']['held_out']['alpha']['over_noise'] > 1.0
    assert {change['channel'] for change in found['changes']} == set(first['channels']['train'])
    out = capsys.readouterr().out
    assert 'held out' in out and 'Where the error is:' in out and 'the second is nearer on the runs held out' in out


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['{runs}', '--config', 'a.yaml', '--config', 'b.yaml', '--config', 'c.yaml'], '--config was given 3 times'),
        (['{runs}', '--config', 'none.yaml'], 'cannot read none.yaml'),
        (['{runs}', '--hold-out', 'run'], '--hold-out run: no such file and no such recording'),
        (['{runs}', '--set', 'system=wire'], 'strain'),
        (['{runs}', '--report', 'page.txt'], 'page.txt: expected a name that ends in .html'),
        (
            ['{runs}', '--system', 'module', '--map', str(ROOT / 'examples/maps/nitinol_isotherm.yaml')],
            'is for --system wire',
        ),
    ],
)
def test_wrong_use_is_said(folder, words, message, capsys):
    assert main(['compare', *(word.replace('{runs}', str(folder)) for word in words)]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith('sma-sim compare: ') and message in error


def test_notes_are_said_once(dataset):
    first, *others = (replace(recording, notes=('a cut line',)) for recording in dataset.recordings)
    first = replace(first, notes=('a cut line', 'a gap'))
    found = grouped_notes([replace(dataset, recordings=(first, *others), notes=('n',))])
    assert found == ['run1, run2, run3: a cut line', 'run1: a gap', 'n']
    many = tuple(replace(others[0], name=f'r{k}') for k in range(9))
    assert grouped_notes([replace(dataset, recordings=many, notes=())]) == ['r0, r1, r2 and 6 more: a cut line']
    counted = tuple(replace(first, name=f'r{k}', notes=(f'{k + 7} cut lines', 'two sessions')) for k in range(9))
    assert grouped_notes([replace(dataset, recordings=counted, notes=())]) == [
        'r0, r1, r2 and 6 more: 7 cut lines (so in r0; other numbers in others)',
        'r0, r1, r2 and 6 more: two sessions',
    ]
    apart = replace(first, name='r', notes=('T_1: 2 rows', 'T_2: 2 rows', 'row 3 is cut', 'row 9 is cut'))
    assert grouped_notes([replace(dataset, recordings=(apart,), notes=())]) == [f'r: {note}' for note in apart.notes]


def test_hold_out_by_name_file_folder_and_session(dataset, folder, tmp_path):
    def held(*words):
        return [recording.name for recording in split_dataset(dataset, words)[1].recordings]

    assert held('run2') == held(str(folder / 'run2.csv')) == ['run2']
    assert held('run1', 'run3') == ['run1', 'run3']
    renamed = replace(
        dataset,
        recordings=tuple(
            replace(one, name=name) for one, name in zip(dataset.recordings, ('a/run', 'b/run#1', 'b/run#2'), strict=True)
        ),
    )
    assert [one.name for one in split_dataset(renamed, ['b/run'])[1].recordings] == ['b/run#1', 'b/run#2']
    assert [one.name for one in split_dataset(renamed, ['b/run#2'])[1].recordings] == ['b/run#2']
    assert split_dataset(dataset, [])[1] is None
    with pytest.raises(UserError, match='did you mean run2'):
        split_dataset(dataset, ['rum2'])


def test_regions_that_are_searched_at_once_are_those_of_searches_one_by_one():
    """Of random halves, with one, two and no conditions; a region that was put in is found."""
    random = np.random.default_rng(3)
    way = band_dimension('x', [np.arange(8.0)], 'x is {}', '')
    masks = [random.random(400) < share for share in (0.1, 0.3, 0.5, 0.7)]
    conditions = Conditions(tuple(Condition(way, k, k, mask) for k, mask in enumerate(masks)), np.array(masks, np.float32))
    errors = random.exponential(size=(30, 400)) * (1.0 + 4.0 * np.outer(np.arange(30) % 3, masks[1] & masks[2]))
    times = 1.0 * (random.random((30, 400)) < 0.5)
    errors, times = ((rows / rows.sum(axis=1, keepdims=True)) for rows in (errors * times, times))
    together = find_regions(conditions, errors, times)
    assert [{condition.first for condition in region.conditions} if region else set() for region in together[:3]] == [
        set(),
        {1, 2},
        {1, 2},
    ]
    for region, error, time in zip(together, errors, times, strict=True):
        alone = find_region(conditions, error, time)
        if region is None:
            assert alone is None
            continue
        assert region.conditions == alone.conditions and np.array_equal(region.mask, alone.mask)
        inside = np.logical_and.reduce([condition.mask for condition in region.conditions])
        assert np.array_equal(region.mask, inside)
        assert region.quality == pytest.approx((error - time)[inside].sum(), abs=1e-6)
    assert find_regions(Conditions((), np.zeros((0, 400), np.float32)), errors, times) == [None] * 30


def test_two_samples_are_few_but_no_mistake():
    """Statistics of differences, segments and frequencies have next to nothing to work with."""
    command = module_input([0.0, 2.0, 8.0, 15.0], [0.0, 10.0, 0.0, 0.0])
    run = simulate(Model(), command, np.array([0.0, 8.0]))
    recording = Recording('two', 'module', run.time, {'alpha': run['alpha_rad']}, command)
    dataset, options = Dataset((recording,), {'alpha': 3.5e-4}), FitOptions(free=('beam.E',), kinetics='hybrid', starts=1)
    assert summarize(compare(dataset, Config())).fitted_error < 0.1
    assert calibrate(dataset, Config(), options).values['beam.E'] == pytest.approx(2e9, rel=0.1)
    request = DiagnosisRequest(kinetics='hybrid', options=options, equation=False)
    assert diagnose(dataset, Config(), request=request).verdict == 'none'
