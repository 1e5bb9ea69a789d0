"""Diagnosis: hidden effects are found, nothing is invented, what cannot be explained is said."""

import json
import re
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib import metadata
from itertools import permutations
from threading import Event

import numpy as np
import pytest
from simulated_data import NOISE, command, config, dataset, recording, scaled

from sma_sim import Dataset, find_effects, load
from sma_sim.challenge.files import recording_columns
from sma_sim.evidence.data.recordings import read_dataset
from sma_sim.evidence.data.tables import write_columns
from sma_sim.evidence.data.train_test_split import hold_out_last
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.diagnosis.review import reviewed, stage_change
from sma_sim.evidence.estimation import problem as problem_module
from sma_sim.evidence.estimation.calibrate import FitOptions, final_fit, problem_for
from sma_sim.evidence.estimation.levenberg_marquardt import refit
from sma_sim.evidence.estimation.problem import linearize, start_point
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection import score_tests
from sma_sim.evidence.model_selection.candidates import candidates_for, with_effect
from sma_sim.evidence.model_selection.model_changes import with_candidate, without_effect
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.evidence.model_selection.score_tests import ScoreTests, at_finite_step, in_each_wire, probe_all, screen
from sma_sim.evidence.model_selection.sketches import sketched
from sma_sim.evidence.model_selection.variants import variants_of
from sma_sim.report.error_reduction_figure import draw_error_reduction
from sma_sim.report.html.diagnosis_page import reduction_figure, write_diagnosis_page
from sma_sim.report.html.page import Provenance
from sma_sim.words.diagnosis_data import as_data
from sma_sim.words.diagnosis_text import as_text

SEEDS = [1, 2, 3]


def measured(effect='', rate=10.0, seconds=40.0, **values):
    """Three runs of a robot whose parameters are off, with or without an effect."""
    truth = scaled(config('mas'), wire__lambda=1.1, wire__c_V=0.93, beam__E=1.06, wire__sigma_MW0=1.04)
    if effect:
        truth = with_effect(truth, find_effects()[effect], values)
    return dataset(truth, SEEDS, 1.0, seconds, rate=rate)


@pytest.fixture(scope='module')
def with_gravity():
    runs = measured('gravity', seconds=25.0, g_y=-9.81)
    return runs, diagnose(runs, config(), request=DiagnosisRequest(options=FitOptions(starts=1)))


def test_a_hidden_effect_is_found_with_its_value(with_gravity):
    _, found = with_gravity
    assert found.verdict == 'missing_effect' and found.effects == ('gravity',)
    assert found.calibration.values['effects.gravity.g_y'] == pytest.approx(-9.81, rel=0.03)
    assert set(found.by_held_out_run) == {*found.training, *found.held_out}
    for verdict in found.by_held_out_run.values():
        assert (verdict.verdict, verdict.effects) == ('missing_effect', ('gravity',)) and verdict.error < 1.3
    bare, last = found.stages
    assert bare.effects == () and bare.held_out > 2.0 and last.held_out < 1.15 and last.train < 1.1
    assert found.held_out == (f'{found.held_out[0]}',) and len(found.training) == 2
    assert found.calibration.config.simulated_kinetics == 'mas'


def test_values_that_are_told_are_those_of_the_last_fit(with_gravity):
    _, found = with_gravity
    (interval,) = (one for one in found.calibration.uncertainty.intervals if one.name == 'effects.gravity.g_y')
    value = found.calibration.values['effects.gravity.g_y']
    assert value == interval.value
    expected = f'gravity.g_y = {value:.4g} m/s^2 ({interval.low:.4g} to {interval.high:.4g})'
    assert any(line.startswith(expected) for line in as_text(found))


def test_a_diagnosis_prints_in_a_line_shows_a_table_and_says_the_same_when_saved(with_gravity, tmp_path):
    _, found = with_gravity
    assert len(repr(found)) < 1500 and '\n' not in repr(found)
    assert found._repr_html_().startswith('<table>') and len(found._repr_html_()) < 3000
    assert re.search(r'nominal +[\d.]+ +[\d.na]+\n', found.summary()) and 'something unlisted' in found.summary()
    assert '1.000' not in found.summary()  # nothing is certain
    saved = load(found.save(tmp_path / 'why.npz'))
    assert repr(saved) == repr(found) and saved.calibration == found.calibration
    assert [stage.train for stage in saved.stages] == [stage.train for stage in found.stages]
    for one, other in zip(saved.stages, found.stages, strict=True):
        assert one.calibration.config == other.calibration.config


def test_the_last_fit_keeps_the_bounds_within_which_a_model_was_accepted(with_gravity):
    runs, found = with_gravity
    accepted = found.selection_steps[0].accepted.fit
    free = tuple(replace(p, low=p.coordinate(-5.0)) if p.name == 'effects.gravity.g_y' else p for p in accepted.problem.free)
    problem = replace(accepted.problem, free=free)
    start = replace(accepted, problem=problem, z=np.clip(accepted.z, *problem.limits()))
    options = FitOptions(free=tuple(p.name for p in free))
    with ThreadPoolExecutor(1) as pool:
        last = final_fit(hold_out_last(runs, None)[0], start, options, SearchContext(pool, Event()))
    assert last.values['effects.gravity.g_y'] == pytest.approx(-5.0)


def test_a_sketch_ends_near_the_refit_for_a_part_of_its_runs(with_gravity, monkeypatch):
    first = with_gravity[1].selection_steps[0]
    refitted = next(one.fit for one in first.candidate_fits if one.name == 'gravity')
    with ThreadPoolExecutor(1) as pool:
        named = [one for one in candidates_for(config()) if one.name == 'gravity']
        (gravity,) = screen(first.base.problem, first.base.z, named, pool)
    counts, evaluate = Counter(), problem_module.residuals_of_all

    def counted(*arguments):
        counts['runs'] += 1
        return evaluate(*arguments)

    monkeypatch.setattr(problem_module, 'residuals_of_all', counted)
    with ThreadPoolExecutor(1) as pool:
        (found,) = sketched(first.base, [gravity], SearchContext(pool, Event()))
        of_sketches = counts.pop('runs')
        refit(*with_candidate(first.base, gravity), SearchContext(pool, Event()))
    assert refitted.cost < found.cost < 1.1 * refitted.cost < 0.5 * first.base.cost
    shared = 2 * len(first.base.problem.runs) * (len(first.base.z) + 1)  # two linearisations, whatever the candidates
    assert 2 * (of_sketches - shared) < counts['runs']


def test_sketches_that_cannot_come_below_others_are_given_up(with_gravity, monkeypatch):
    base = with_gravity[1].selection_steps[0].base
    counts, evaluate = Counter(), problem_module.residuals_of_all

    def counted(*arguments):
        counts['runs'] += 1
        return evaluate(*arguments)

    with ThreadPoolExecutor(1) as pool:
        context = SearchContext(pool, Event())
        screened = screen(base.problem, base.z, candidates_for(config()), pool)[:4]
        monkeypatch.setattr(problem_module, 'residuals_of_all', counted)
        whole = sketched(base, screened, context)
        without = counts.pop('runs')
        found = sketched(base, screened, context, kept=1)
        assert counts.pop('runs') < without
        assert min(fit.cost for fit in found) == min(fit.cost for fit in whole)
        few = sketched(base, screened, context, target=0.0)
        assert counts['runs'] < 0.5 * without  # no second one where the first has led to nowhere near
    assert sum(fit.iterations for fit in few) < sum(fit.iterations for fit in whole)


def test_a_second_look_begins_some_way_from_nothing():
    """In every strength, on the first side that is probed."""
    by_name = {one.name: one for one in candidates_for(config())}
    step = by_name['thermal_crosstalk'].families[1][0]  # of three sizes
    assert at_finite_step(by_name['thermal_crosstalk']).values == {step.parameter: step.step}
    gravity = by_name['gravity'].families[0]
    assert at_finite_step(by_name['gravity']).values == {probe.parameter: probe.step for probe in gravity[::-1]}


def test_a_score_test_sees_what_a_delay_leaves_of_a_lag(monkeypatch):
    """Linear in a lag is what the fitted delay absorbs: from the middle of the realistic range little seems to be left."""
    monkeypatch.setattr(score_tests, 'nearer_probes', lambda result: ())
    nominal = config('mas')
    found = next(one for one in candidates_for(nominal) if one.name == 'driver_lag')
    middle = replace(found, families=found.families[len(found.families) // 2 :][:1])
    truth = with_effect(nominal, found.effect, {'tau': 0.03})
    runs = [recording(truth, command(seed, 40.0), 20.0, 1.0, seed=seed, channels=('alpha', 'U_y')) for seed in (1, 2)]
    noise = {name: NOISE[name] for name in ('alpha', 'U_y')}
    problem = problem_for(Dataset(tuple(runs), noise), nominal, FitOptions(free=('wire.sigma_T',)), 1)
    with ThreadPoolExecutor(2) as pool:
        fit = refit(problem, start_point(problem), SearchContext(pool, Event()))
        assert fit is not None
        gains = [screen(fit.problem, fit.z, [one], pool) for one in (middle, found)]
    of_middle, of_all = (max((one.gain for one in gain), default=0.0) for gain in gains)
    assert of_all > 20.0 and of_all > 2.0 * of_middle


def test_a_score_test_probes_a_weak_effect_at_its_own_strength():
    """Its response over the usual step is not ten times that over a tenth."""
    nominal, found = config('mas'), next(one for one in candidates_for(config('mas')) if one.name == 'thermal_crosstalk')
    truth, channels = with_effect(nominal, found.effect, {'G': 3e-3}), ('alpha', 'U_y')
    runs = [recording(truth, command(seed, 60.0), 20.0, 1.0, seed=seed, channels=channels) for seed in (1, 2)]
    dataset = Dataset(tuple(runs), {name: NOISE[name] for name in channels})
    problem = problem_for(dataset, nominal, FitOptions(free=('beam.E',)), 1)
    z = start_point(problem)
    with ThreadPoolExecutor(1) as pool:
        (result,) = screen(problem, z, [found], pool)
    assert result.values['G'] == pytest.approx(3e-3, rel=0.1)


def test_in_place_of_what_changes_much_first_order_is_that_where_the_fit_lies(with_gravity):
    """Of a small effect it says what the model without it says. Unknowns that would have to absorb more of its response than
    they can are held back."""
    fit = with_gravity[1].selection_steps[0].accepted.fit
    base, z = without_effect(fit, 'gravity')
    candidates = [one for one in candidates_for(config()) if one.name in ('gravity', 'sensor_bias', 'beam_creep')]
    with ThreadPoolExecutor(1) as pool:
        tests = ScoreTests(fit.problem, fit.z, pool)
        in_place = {one.candidate.name: one for one in tests.in_place(base, z, candidates)}
        found, own = tests.in_tangent(base, candidates, worth=0.0)
        held, most = tests.in_tangent(base, candidates, worth=np.inf)
    assert own == pytest.approx(in_place['gravity'].gain, rel=0.2)
    gains = {one.candidate.name: one.gain for one in found}
    assert 'gravity' not in gains and gains['sensor_bias'] == pytest.approx(in_place['sensor_bias'].gain, rel=0.3)
    assert most > own and all(one.gain <= most for one in held)


def test_what_may_stand_in_place_of_an_effect_is_told_by_responses_beside_it(with_gravity, monkeypatch):
    """As score tests without the effect tell it, to first order; what the model lacks beside it asks for few more."""
    fit, counts = with_gravity[1].selection_steps[0].accepted.fit, Counter()
    base, z = without_effect(fit, 'gravity')
    candidates = [
        one for one in candidates_for(config()) if one.name in ('gravity', 'sensor_bias', 'beam_creep', 'radiation')
    ]
    with ThreadPoolExecutor(1) as pool:
        tests = ScoreTests(fit.problem, fit.z, pool)
        in_place = {one.candidate.name: one for one in tests.in_place(base, z, candidates)}
        alone = {one.candidate.name: one for one in screen(base, z, candidates, pool)}
        evaluate = problem_module.residuals_of_all

        def counted(models, *arguments):
            counts['models'] += len(models)
            return evaluate(models, *arguments)

        monkeypatch.setattr(problem_module, 'residuals_of_all', counted)
        others = [one for one in candidates if one.name != 'gravity']
        beside = tests.beside(others)
        of_nearer = counts.pop('models', 0)
        again = ScoreTests(fit.problem, fit.z, pool).beside(others)
    assert 'gravity' in in_place and in_place['gravity'].gain == pytest.approx(alone['gravity'].gain, rel=0.05)
    large = [name for name, one in alone.items() if one.gain > 0.1 * alone['gravity'].gain]
    assert len(large) > 1
    for name in large:
        assert in_place[name].gain == pytest.approx(alone[name].gain, rel=0.2)
    assert [one.candidate.name for one in beside] == [one.candidate.name for one in again]
    assert of_nearer < 0.3 * counts['models']


@pytest.mark.parametrize('name', ['natural_convection', 'guide_friction'])
def test_an_effect_in_all_wires_responds_with_the_sum_of_its_parts(with_gravity, name):
    """To first order, and without a run of its own; alone it is run."""
    fit = with_gravity[1].selection_steps[0].accepted.fit
    whole = [one for one in candidates_for(fit.config) if one.name == name]
    parts = [one for one in variants_of(whole, fit.problem.runs[0].channels) if one.effect.scope.wire >= 0]
    assert len(parts) == 2 and set(in_each_wire([*whole, *parts])) == set(whole[0].probes)
    assert not in_each_wire([*whole, parts[0]])
    with ThreadPoolExecutor(1) as pool:
        linear = linearize(fit.problem, fit.z, pool)
        summed = probe_all(fit.problem, fit.z, [*whole, *parts], linear, pool)
        run = probe_all(fit.problem, fit.z, whole, linear, pool)
    for probe, response in run.items():
        assert np.linalg.norm(summed[probe] - response) < 0.25 * np.linalg.norm(response)


def cannot_be_made(run):
    return replace(run, error=np.inf, channel_errors=dict.fromkeys(run.channel_errors, np.inf))


def test_a_model_that_cannot_make_the_held_out_run_is_shown_on_the_fitted_ones(with_gravity):
    runs, found = with_gravity
    assert set(found.by_held_out_run) == {*found.training, *found.held_out}
    for verdict in found.by_held_out_run.values():
        assert (verdict.verdict, verdict.effects) == ('missing_effect', ('gravity',)) and verdict.error < 1.3
    bare, last = found.stages
    datasets = hold_out_last(runs, None)
    broken = replace(bare, predicted=tuple(cannot_be_made(run) for run in bare.predicted))
    assert stage_change(bare, last, *datasets).held_out and not stage_change(broken, last, *datasets).held_out
    assert np.isfinite(reduction_figure(replace(found, stages=(broken, last))).layout.yaxis.range).all()


def test_the_report_has_the_model_as_it_was_given_beside_the_calibrated_one(with_gravity, tmp_path):
    """What calibration bends is not what the user gave: both stand in figures, and in the table of parameters."""
    runs, found = with_gravity
    given = scaled(config(), wire__lambda=1.3)  # a file that is off by a third in what a calibration finds
    review = reviewed(found, runs, None, given)
    bare, errors = found.nominal, review.given_errors
    assert errors[0] > 2.0 * bare.train and np.isfinite(errors[1])
    assert review.given_values['wire.lambda'] == given.parameters['wire.lambda']
    assert review.nominal_values['wire.lambda'] == bare.calibration.values['wire.lambda'] != given.parameters['wire.lambda']
    figure = reduction_figure(found, errors)
    held_out, fitted = figure.data[:2]
    assert fitted.x[0] == 'your model,<br>as given' and fitted.y[0] == errors[0] and held_out.y[0] == errors[1]
    assert fitted.y[1] == bare.train
    page = tmp_path / 'why.html'
    write_diagnosis_page(
        page,
        review,
        provenance=Provenance('sma-sim diagnose <x> & y', {'mine.yaml': 'wire: {a: 1}  # <b>'}, time.monotonic() - 7320.0),
    )
    text = page.read_text()
    assert 'done in 2 h ' in text
    for words in ('as given', 'calibrated without', 'sma-sim diagnose &lt;x&gt; &amp; y', 'wire: {a: 1}  # &lt;b&gt;'):
        assert words in text, words
    assert re.search(rf'Made on \d{{4}}-\d\d-\d\d at .* by sma_sim {re.escape(metadata.version("sma_sim"))}\.', text)


@pytest.mark.parametrize('errors', [(3.0, 0.02), (1e-4, 1e-5), (40.0, 1.0)])
def test_no_error_lies_beyond_the_axis(with_gravity, errors):
    """Where the stated noise is too large, errors lie far below it."""
    bare, last = with_gravity[1].stages
    stages = tuple(
        replace(stage, calibration=replace(stage.calibration, error=error), predicted=())
        for stage, error in zip((bare, last), errors, strict=True)
    )
    found = replace(with_gravity[1], stages=stages)
    low, high = (10.0**end for end in reduction_figure(found, (2.0 * errors[0], np.nan)).layout.yaxis.range)
    assert low < min(errors) and 2.0 * errors[0] < high and low < 1.0 < high
    steps = [{'effects': (), 'train': error, 'held_out': None} for error in errors]
    low, high = draw_error_reduction(steps).axes[0].get_ylim()
    assert low < min(errors) < max(errors) < high


@pytest.mark.slow
def test_a_held_out_run_that_goes_further_than_the_fitted_ones_is_said():
    """Another beam in the held-out run: nothing in the fitted ones tells what that is, so no equation is made up."""
    runs = measured()
    other = dataset(scaled(config('mas'), beam__E=1.4), SEEDS, noise=1.0, rate=10.0).recordings[-1]
    changed = replace(runs, recordings=(*runs.recordings[:-1], other))
    found = diagnose(changed, config(), request=DiagnosisRequest('mas', options=FitOptions(starts=1, intervals=False)))
    assert found.verdict == 'unknown_effect' and found.effects == () and found.proposal is None
    assert found.stages[-1].train < 1.1 and found.stages[-1].held_out > 1.3
    assert found.pooled_errors is not None and not found.pooled_errors.explained()
    assert any(line.startswith('The fitted runs are explained') for line in as_text(found))


@pytest.mark.slow
def test_an_effect_that_a_held_out_run_contradicts_is_taken_back(tmp_path):
    """The robot stood askew by nine degrees in the fitted runs, and level in the held-out one."""
    askew = measured('gravity', seconds=25.0, g_y=-1.5)
    levelled = replace(askew, recordings=(*askew.recordings[:-1], measured().recordings[-1]))
    quick = DiagnosisRequest('mas', options=FitOptions(starts=1, intervals=False), equation=False)
    found = diagnose(levelled, config(), request=quick)
    assert found.selection_steps[0].accepted.name == 'gravity'
    assert found.retracted == ('gravity',) == tuple(as_data(found)['retracted'])
    assert found.verdict == 'unknown_effect' and found.effects == found.calibration.config.effects == ()
    bare, worse, last = found.stages
    assert worse.effects == ('gravity',) and worse.held_out > 1.3 > bare.held_out and last.effects == ()
    assert last.held_out == pytest.approx(bare.held_out, rel=0.03)
    assert any(line.startswith('Retracted: gravity') and f'{worse.held_out:.2f} with' in line for line in as_text(found))
    write_diagnosis_page(tmp_path / 'why.html', reviewed(found, levelled, None, config()))
    labels = ('the same,<br>calibrated<br>(mas)', '+ gravity<br>(mas)', '- gravity<br>(mas)')
    assert (tmp_path / 'why.html').exists() and reduction_figure(found).data[0].x == labels


@pytest.mark.slow
def test_a_held_out_run_beyond_what_the_fitted_ones_tell_is_no_effect(tmp_path):
    """Weak commands tell little of the martensite; a strong one is predicted badly, and one model explains them all."""
    truth = scaled(config('mas'), wire__lambda=1.1, wire__c_V=0.93, wire__eps_T=1.5, wire__E_M=0.6)
    powers = {1: 0.75, 2: 0.75, 3: 15.0}
    runs = [recording(truth, command(seed, power=power), 10.0, 1.0, seed=seed) for seed, power in powers.items()]
    request = DiagnosisRequest('mas', options=FitOptions(starts=1, intervals=False))
    weakly_driven = Dataset(tuple(runs), dict(NOISE))
    found = diagnose(weakly_driven, config(), request=request)
    assert found.verdict == 'none' and found.effects == () and found.stages[-1].held_out > 1.3
    pooled = found.pooled_errors
    assert pooled is not None and max(pooled.train, pooled.held_out) < 1.05
    together = as_data(found)['fitted_together']
    assert together['train'] == pooled.train and together['held_out'] == pooled.held_out and together['ambient'] == {}
    assert together['unlisted'] == pooled.unlisted < 0.1
    assert any(line.startswith('The held-out runs depend on parameters') for line in as_text(found))
    write_diagnosis_page(tmp_path / 'why.html', reviewed(found, weakly_driven, None, config()))
    assert 'except in runs that one model explains together' in (tmp_path / 'why.html').read_text()


def test_the_verdict_for_programs(with_gravity):
    _, found = with_gravity
    data = json.loads(json.dumps(as_data(found), allow_nan=False))
    first = data['ranking'][0]
    assert data['verdict'] == 'missing_effect' and data['effects'] == ['gravity'] and data['model'] == 'mas'
    assert first['effect'] == 'gravity' and first['plausible'] and first['delta_bic'] < 0.0
    assert 0.0 < first['held_out_error_ratio'] < 1.0 and first['log_odds'] > 10.0
    value = first['parameters']['g_y']
    assert value['unit'] == 'm/s^2' and abs(value['value'] + 9.81) < 5.0 * value['std'] + 0.3
    assert [step['effects'] for step in data['error']] == [[], ['gravity']]
    assert set(data['error'][0]['channels']) == set(NOISE) == set(data['noise_std'])
    assert data['parameters']['effects.gravity.g_y'] < -9.0 and data['seconds'] > 0.0
    biases = [one['parameters'] for one in data['ranking'] if one['effect'] == 'sensor_bias']
    assert biases and all(set(parameters) <= set(NOISE) for parameters in biases), (
        'no bias of the stress of a wire on a bench'
    )
    assert any('gravity.g_y' in line and 'realistic' in line for line in as_text(found))


def test_probabilities_and_models_for_programs(with_gravity):
    """What is said of each model and each effect, the heaviest first; what was not fitted has the rest of the weight."""
    _, found = with_gravity
    data = json.loads(json.dumps(as_data(found), allow_nan=False))
    probabilities, models = data['probabilities'], data['models']
    assert set(probabilities) == {'none', 'unlisted', 'effects', 'other'} and probabilities['effects']['gravity'] > 0.95
    assert probabilities['none'] < 1e-3 and probabilities['unlisted'] < 0.1
    assert list(probabilities['effects'].values()) == sorted(probabilities['effects'].values(), reverse=True)
    assert all({'effects', 'formula', 'probability', 'error'} <= set(one) for one in models)
    weights = [one['probability'] for one in models]
    assert weights == sorted(weights, reverse=True) and sum(weights) < 1.0
    assert 0.0 < probabilities['other'] <= 1.0 - sum(weights) + 1e-9 and sum(weights) > 0.95
    assert models[0]['effects'] == ['gravity'] and models[0]['formula'] is None and models[0]['error'] < 1.1
    for name, probability in probabilities['effects'].items():
        fitted = sum(one['probability'] for one in models if name in one['effects'])
        assert fitted - 1e-9 <= probability <= fitted + 1.0 - sum(weights) + 1e-9


FOREIGN = {
    'time_s': ('t [ms]', 1e-3),
    'J_eq_W': ('mW', 1e-3),
    'alpha_rad': ('deg', float(np.pi / 180.0)),
    'U_x_m': ('x [mm]', 1e-3),
}


def in_foreign_files(runs, home):
    """The runs as CSV files with foreign names and units, read through a map in another order."""
    lines = []
    for one in runs.recordings:
        columns = recording_columns(one)
        foreign = {name: FOREIGN.get(name, (f'my {name}', 1.0)) for name in columns}
        write_columns(home / f'{one.name}.csv', {foreign[name][0]: columns[name] / foreign[name][1] for name in columns})
        lines = [f'{name}: {{column: "{other}", scale: {scale!r}}}' for name, (other, scale) in foreign.items()]
    (home / 'map.yaml').write_text('\n'.join(lines))
    files = [home / f'{one.name}.csv' for one in reversed(runs.recordings)]
    return read_dataset(files, 'module', 298.0, home / 'map.yaml', NOISE)


@pytest.mark.slow
def test_order_names_units_and_seeds_change_nothing(with_gravity, tmp_path):
    runs, first = with_gravity
    dressed = in_foreign_files(runs, tmp_path)
    assert [one.name for one in dressed.recordings] == [one.name for one in runs.recordings[::-1]]
    found = diagnose(
        dressed,
        config(),
        request=DiagnosisRequest('mas', seed=7, options=FitOptions(starts=1, seed=7, intervals=False)),
    )
    assert (found.verdict, found.effects, found.held_out) == (first.verdict, first.effects, first.held_out)
    assert found.stages[0].held_out == pytest.approx(first.stages[0].held_out, rel=0.02)


@pytest.mark.slow
def test_decimation_changes_nothing(with_gravity):
    runs, first = with_gravity
    halved = tuple(
        replace(one, time=one.time[::2], channels={name: values[::2] for name, values in one.channels.items()})
        for one in runs.recordings
    )
    found = diagnose(
        replace(runs, recordings=halved), config(), request=DiagnosisRequest('mas', options=FitOptions(starts=1))
    )
    assert (found.verdict, found.effects) == (first.verdict, first.effects) and found.stages[-1].held_out < 1.2


@pytest.mark.slow
def test_nothing_missing_is_said():
    found = diagnose(measured(), config())
    assert found.verdict == 'none' and found.effects == () and len(found.stages) == 1
    assert found.stages[0].held_out < 1.15 and found.selection_steps[0].accepted is None


def test_what_no_effect_explains_is_unknown():
    """A shake of the angle that no effect of the library has anything of."""
    runs = measured(seconds=10.0)
    shaken = tuple(
        replace(one, channels={**one.channels, 'alpha': one.channels['alpha'] + 2e-3 * np.sin(7.0 * one.time**1.2)})
        for one in runs.recordings
    )
    quick = DiagnosisRequest('mas', options=FitOptions(starts=1, intervals=False), equation=False, variants=False)
    found = diagnose(replace(runs, recordings=shaken), config(), request=quick)
    assert found.verdict == 'unknown_effect' and found.stages[-1].held_out > 1.3
    assert any('of alpha' in line for line in as_text(found))


@pytest.mark.slow
def test_a_single_run_has_no_held_out_one():
    runs = measured('gravity', g_y=-9.81)
    request = DiagnosisRequest('mas', options=FitOptions(starts=1), equation=False)
    found = diagnose(Dataset(runs.recordings[:1], NOISE), config(), request=request)
    assert found.effects[:1] == ('gravity',) and found.held_out == () and np.isnan(found.stages[-1].held_out)
    assert as_data(found)['error'][0]['held_out'] is None


def test_held_out_by_default_and_by_wish():
    """Without a wish the last by name, whatever the order in which runs are given; numbers in names are numbers."""
    runs = measured()
    names = ('run2', 'run10', 'run9')
    renamed = tuple(replace(one, name=name) for one, name in zip(runs.recordings, names, strict=True))
    named = replace(runs, recordings=renamed)
    for order in permutations(named.recordings):
        training, held = hold_out_last(replace(named, recordings=order), None)
        assert [one.name for one in (*training.recordings, *held.recordings)] == ['run2', 'run9', 'run10']
    chosen = replace(runs, recordings=named.recordings[1:2])
    assert hold_out_last(training, chosen) == (training, chosen)
    assert hold_out_last(training, None) == (training, None)
