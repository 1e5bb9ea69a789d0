"""The set-up before the physics: signs, columns, units, noise and outliers are named, and nothing is invented."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Event

import numpy as np
import pytest
from isobaric_runs import BENCH as ISOBARIC
from isobaric_runs import isobaric_tests
from simulated_data import config, dataset, scaled

from sma_sim import (
    DiagnosisRequest,
    FitOptions,
    PhysicsWarning,
    Recording,
    diagnose,
    find_effects,
    module_input,
    predict,
    read_config,
)
from sma_sim.challenge.make import RecordingPlan, make_challenge
from sma_sim.evidence.diagnosis.review import reviewed
from sma_sim.evidence.estimation.calibrate import problem_for
from sma_sim.evidence.estimation.problem import residuals_at, start_point
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.evidence.set_up.check import (
    Step,
    exchanged_commands,
    faults_before_fits,
    fitted,
    is_robot,
    isolated,
    lost_command,
    outliers,
    repeats,
    symmetries,
    thinned,
    told_apart,
    without_fault,
)
from sma_sim.evidence.set_up.faults import Fault, corrected, with_command, without_faults
from sma_sim.solver.inputs import inputs_at
from sma_sim.words.diagnosis_data import as_data
from sma_sim.words.diagnosis_text import as_text
from sma_sim.words.set_up import set_up_sentences

POSE, FORCES = ('U_x', 'U_y', 'alpha'), ('F_1', 'F_2')
OPTIONS = FitOptions(starts=1)


def robot(effect='', **values):
    """A robot whose parameters are off, with or without an effect."""
    truth = scaled(config('hybrid'), wire__lambda=1.1, wire__c_V=0.93, beam__E=1.06, wire__sigma_MW0=1.04)
    return with_effect(truth, find_effects()[effect], values) if effect else truth


@pytest.fixture(scope='module')
def runs():
    return dataset(robot(), [1, 2, 3], 1.0, 20.0, rate=10.0)


@pytest.fixture(scope='module')
def with_gravity():
    return dataset(robot('gravity', g_y=-9.81), [1, 2, 3], 1.0, 20.0, rate=10.0)


def with_fault(found, *faults):
    """Recordings as they are read where something is wrong: a sign and an exchange are their own inverses."""
    for fault in faults:
        undone = replace(fault, factor=1.0 / fault.factor)
        found = replace(found, recordings=undone.in_recordings(found.recordings))
    return found


def only(found, *channels):
    """Recordings of some channels."""
    kept = (replace(one, channels={name: one.channels[name] for name in channels}) for one in found.recordings)
    return replace(found, recordings=tuple(kept))


def faults_in(found):
    """What is found to be wrong with recordings."""
    with ThreadPoolExecutor(2) as pool:
        return faults_before_fits(found, config('hybrid'), OPTIONS, SearchContext(pool, Event()))


def in_words(faults):
    return [fault.words for fault in faults]


@pytest.mark.parametrize('name', ['runs', 'with_gravity'])
def test_nothing_is_wrong_with_a_healthy_set_up(name, request):
    found = request.getfixturevalue(name)
    assert faults_in(found) == ()
    assert faults_in(only(found, *POSE)) == ()


@pytest.mark.parametrize('is_wrong', [False, True])
def test_recordings_that_are_explained_as_they_are_have_no_fault(is_wrong, with_gravity):
    """Whatever first order has promised: far from the middle of its priors a robot looks as if several things were wrong."""
    fault = Fault('sign', ('J_eq',))
    found = with_fault(with_gravity, fault) if is_wrong else with_gravity
    problem = thinned(found, config('hybrid'), OPTIONS)
    with ThreadPoolExecutor(2) as pool:
        context = SearchContext(pool, Event())
        step = Step(fault, -10.0, None, fitted(without_fault(problem, fault), context))
        assert is_robot(problem, [step], context) != is_wrong


FAULTS = [
    Fault('sign', ('J_eq',)),
    Fault('swap', FORCES, recordings=('run3',)),
    Fault('unit', ('alpha',), np.pi / 180.0, 'degrees'),
    Fault('unit', ('time',), 1e-3, 'milliseconds'),
    Fault('exchanged_commands', ('J_eq',), recordings=('run1', 'run3')),
]
FURTHER = [
    Fault('sign', ('alpha',)),
    Fault('sign', ('U_x',)),
    Fault('swap', FORCES),
    Fault('swap', ('U_x', 'U_y')),
    Fault('unit', ('U_y',), 1e-3, 'millimetres'),
    Fault('unit', ('U_x',), 1e-6, 'micrometres'),
    Fault('unit', ('J_eq',), 1e-3, 'milliwatts'),
    Fault('unit', ('J_eq',), 1e3),
    Fault('unit', ('F_1',), 9.80665e-3, 'grams of weight'),
    Fault('sign', ('J_eq',), recordings=('run1',)),
    Fault('sign', ('U_x',), recordings=('run2',)),
    Fault('unit', ('alpha',), np.pi / 180.0, 'degrees', ('run3',)),
]


def all_of(few, more):
    """Parameters of which the usual tests try few."""
    return [*few, *(pytest.param(one, marks=pytest.mark.slow) for one in more)]


@pytest.mark.parametrize('fault', all_of(FAULTS, FURTHER), ids=lambda fault: fault.words)
def test_a_wrong_column_is_found_in_all_recordings_or_in_one(fault, runs):
    found = faults_in(with_fault(runs, fault))
    assert in_words(found) == [fault.words] and found[0].corrected
    right = corrected(with_fault(runs, fault), found)
    for one, other in zip(right.recordings, runs.recordings, strict=True):
        assert {name: pytest.approx(values) for name, values in one.channels.items()} == dict(other.channels)
        np.testing.assert_allclose(one.source.values, other.source.values)
        np.testing.assert_allclose(one.time, other.time)


@pytest.mark.parametrize('fault', all_of(FAULTS[:1], [*FAULTS[1:], *FURTHER]), ids=lambda fault: fault.words)
def test_a_wrong_column_is_found_beside_a_hidden_effect(fault, with_gravity):
    assert in_words(faults_in(with_fault(with_gravity, fault))) == [fault.words]


def test_commands_go_round_three_recordings(runs):
    fault = Fault('exchanged_commands', ('J_eq',), recordings=('run1', 'run2', 'run3'))
    back = replace(fault, recordings=fault.recordings[::-1])
    wrong = replace(runs, recordings=back.in_recordings(runs.recordings))
    problem = thinned(wrong, config('hybrid'), OPTIONS)
    with ThreadPoolExecutor(2) as pool:
        residuals = residuals_at(problem, start_point(problem), pool)
    (found,) = exchanged_commands(problem, residuals)
    assert found.words == 'run1 has the command of run2, run2 has the command of run3 and run3 has the command of run1'
    for one, other in zip(found.in_recordings(wrong.recordings), runs.recordings, strict=True):
        np.testing.assert_array_equal(one.source.values, other.source.values)


def test_an_exchanged_command_leaves_the_ambient_temperature_that_was_measured():
    cool, warm = (
        module_input([0.0, 2.0, 8.0], [0.0, power, 0.0], T_E) for power, T_E in ((3.0, 290.0), (5.0, [300, 301, 302]))
    )
    times, found = [0.0, 1.0, 2.0, 7.0, 8.0], with_command(cool, warm)
    assert inputs_at(found, times)['J_eq_W'].tolist() == [0.0, 0.0, 5.0, 5.0, 0.0]
    assert inputs_at(found, times)['T_E_K'].tolist() == [290.0] * 5
    assert inputs_at(with_command(warm, cool), times)['T_E_K'].tolist() == [300.0, 300.0, 301.0, 301.0, 302.0]


def test_a_unit_of_all_recordings_is_named_though_one_lies_nearer_with_it():
    """At the middle of the priors the second run of this robot is better explained as a slow one than by its own time."""
    made = make_challenge(220042, 0, None, (), forces=True, plan=RecordingPlan(3, 40.0, 20.0))
    with pytest.warns(PhysicsWarning, match='time_s'):
        wrong = replace(made.dataset, recordings=Fault('unit', ('time',), 1e3).in_recordings(made.dataset.recordings))
    with ThreadPoolExecutor(2) as pool:
        found = faults_before_fits(wrong, made.nominal.variant(kinetics='hybrid'), OPTIONS, SearchContext(pool, Event()))
    assert in_words(found) == ['time is in milliseconds, not in seconds']


@pytest.mark.parametrize('name', [pytest.param('runs', marks=pytest.mark.slow), 'with_gravity'])
def test_a_command_that_belongs_to_another_recording_is_named_and_nothing_is_searched_for(name, request):
    found = request.getfixturevalue(name)
    first, second, third = found.recordings
    wrong = replace(found, recordings=(replace(first, source=third.source), second, third))
    (fault,) = faults_in(wrong)
    assert fault.words == 'run1 has the command of run3, not its own' and not fault.corrected
    (sentence,) = set_up_sentences([fault])
    assert (
        sentence == 'Set-up: run1 has the command of run3, not its own. Fix it: give run1 its own command, or leave it out.'
    )


def test_what_repeats_a_recording_has_its_own_command(runs):
    """However little of either a nominal model explains."""
    first, _, third = thinned(runs, config('hybrid'), OPTIONS).runs
    assert repeats(first, first) and not repeats(third, first)
    assert repeats(first, replace(first, measured=0.6 * first.measured)) and not repeats(
        first, replace(first, measured=-first.measured)
    )


def test_repeated_commands_are_no_fault(runs):
    """A wire that gets no power in a repetition is another thing."""
    first, second, third = runs.recordings
    again = replace(first, name='run4')
    with ThreadPoolExecutor(2) as pool:
        context = SearchContext(pool, Event())

        def copied(*recordings):
            return lost_command(thinned(replace(runs, recordings=recordings), config('hybrid'), OPTIONS), context)

        assert copied(first, second, third, again) is None
        for side in (1, -1):
            shown = predict(robot(), replace(first, unpowered_side=side))
            lost = replace(again, channels={name: shown[name] for name in first.channels})
            assert copied(first, second, lost) is None
        assert copied(first, second, replace(third, source=first.source)).fault.recordings == ('run3', 'run1')


@pytest.mark.slow
@pytest.mark.parametrize(('seed', 'hidden'), [(270040, ()), (273041, ('gravity',))])
def test_a_lost_command_is_found_that_is_much_like_the_one_in_its_place(seed, hidden):
    """A model explains half of what moves under the wrong one; in the second robot the opposite sign of the command does."""
    made = make_challenge(seed, len(hidden), None, hidden, forces=True, plan=RecordingPlan(3, 40.0, 20.0))
    first, second, third = made.dataset.recordings
    wrong = replace(
        made.dataset, recordings=(replace(first, source=with_command(first.source, second.source)), second, third)
    )
    with ThreadPoolExecutor(2) as pool:
        context = SearchContext(pool, Event())
        (fault,) = faults_before_fits(wrong, replace(made.nominal, kinetics='mas'), OPTIONS, context)
    assert (fault.kind, fault.recordings) == ('copied_command', ('run1', 'run2'))


@pytest.mark.slow
def test_two_faults_are_found_one_after_the_other(runs):
    faults = Fault('sign', ('U_x',)), Fault('unit', ('alpha',), np.pi / 180.0, 'degrees')
    assert set(in_words(faults_in(with_fault(runs, *faults)))) == {fault.words for fault in faults}


def test_what_leaves_the_same_recordings_is_named_together(runs):
    (found,) = told_apart([Fault('sign', ('J_eq',))], symmetries(thinned(runs, config('hybrid'), OPTIONS)))
    assert [in_words(other) for other in found.alternatives] == [
        ['F_1 and F_2 are swapped', 'U_y has the opposite sign', 'alpha has the opposite sign']
    ]
    (sentence,) = set_up_sentences([found])
    assert 'symmetric robot: F_1 and F_2 are swapped and U_y and alpha have the opposite sign)' in sentence
    known = symmetries(thinned(only(runs, 'U_x', 'alpha'), config('hybrid'), OPTIONS))
    (sentence,) = set_up_sentences(told_apart([Fault('sign', ('alpha',))], known))
    assert sentence.startswith('Set-up: alpha or J_eq has the opposite sign')
    known = symmetries(thinned(only(runs, *POSE), config('hybrid'), OPTIONS))
    y_axis = [Fault('sign', ('U_y', 'alpha'))]
    assert in_words(told_apart(y_axis, known)) == ['J_eq has the opposite sign']
    assert told_apart([Fault('sign', ('U_x',))], known)[0].alternatives == ()


def test_a_noise_that_is_stated_too_small_is_found(runs, with_gravity):
    for found in (runs, with_gravity):
        small = replace(found, noise_std={name: std / 3.0 for name, std in found.noise_std.items()})
        (fault,) = faults_in(small)
        assert set(fault.quantities) == {*POSE, *FORCES} and fault.factor == pytest.approx(3.0, rel=0.1)
    one = replace(runs, noise_std={**runs.noise_std, 'alpha': runs.noise_std['alpha'] / 3.0})
    (fault,) = faults_in(one)
    assert fault.quantities == ('alpha',) and fault.factor == pytest.approx(3.0, rel=0.15)
    assert fault.words == f'the noise of alpha is stated {fault.factor:.2g} times too small'
    assert not faults_in(replace(one, resolution={'alpha': 0.1}))  # rows are far apart there: motion looks like noise


def with_outliers(found, size, part=0.01, channel='alpha'):
    """Recordings in which a part of the samples of a channel is off by `size` times its noise."""
    random, changed = np.random.default_rng(5), []
    for one in found.recordings:
        values = one.channels[channel].copy()
        at = random.choice(len(values), int(part * len(values)), replace=False)
        values[at] += size * found.noise_std[channel] * random.choice([-1.0, 1.0], len(at))
        changed.append((replace(one, channels={**one.channels, channel: values}), set(at.tolist())))
    return replace(found, recordings=tuple(one for one, _ in changed)), {one.name: at for one, at in changed}


@pytest.mark.parametrize('size', [250.0, 1e4])
def test_all_outliers_are_found_and_nothing_else(size, with_gravity):
    wrong, where = with_outliers(with_gravity, size, 0.02)
    (fault,) = faults_in(wrong)
    assert fault.kind == 'outliers' and {name: set(at) for name, at in fault.rows.items()} == where
    assert fault.words.startswith('alpha has 12 isolated outliers, 2 % of its samples')
    missing = corrected(wrong, [fault]).recordings[0].channels['alpha']
    assert set(np.flatnonzero(np.isnan(missing)).tolist()) == where[wrong.recordings[0].name]


def test_a_sample_that_lags_behind_a_change_of_the_command_is_no_outlier(runs):
    """A model without the lag is off by 23 standard deviations in the fourth sample after a change, and bends there."""
    problem = thinned(runs, config('hybrid'), OPTIONS)
    run, k = problem.runs[0], problem.runs[0].channels.index('F_1')
    time = 0.05 * np.arange(len(run.time))
    source = module_input([0.0, 0.98, 40.0], [5.0, -9.0, -9.0])
    rows = np.zeros_like(run.measured)
    rows[k, 23:32] = [23.0, 10.6, -1.8, -7.8, -5.9, -6.5, -5.0, -4.0, -3.0]
    measured = np.full_like(rows, 600.0) / np.where(run.weight > 0.0, run.weight, 1.0)
    measured[k, 23:] -= 30.0 * np.arange(1, len(time) - 22) / run.weight[k, 23:]
    lagging = replace(run, time=time, source=source, measured=measured)
    assert isolated(time, rows[k])[23] and outliers(replace(problem, runs=(lagging,)), [rows]) == []
    rows[k, 10] = 23.0
    (found,) = outliers(replace(problem, runs=(lagging,)), [rows])
    assert found.rows == {'run1': (10,)}
    rows[k, 24:32] = 0.0  # alone in time, of a sensor that has outliers
    (found,) = outliers(replace(problem, runs=(lagging,)), [rows])
    assert found.rows == {'run1': (10, 23)}
    rows[k, 10] = 0.0
    assert outliers(replace(problem, runs=(lagging,)), [rows]) == []
    assert outliers(replace(problem, runs=(lagging,)), [rows], {'F_1'})[0].rows == {'run1': (23,)}
    rows[problem.runs[0].channels.index('alpha'), 23] = 9.0  # another sensor sees it too
    assert outliers(replace(problem, runs=(lagging,)), [rows], {'F_1'}) == []


def diagnosed(found, **options):
    request = DiagnosisRequest('hybrid', options=FitOptions(starts=1, intervals=False), **options)
    return diagnose(found, config('hybrid'), request=request)


def test_a_diagnosis_goes_on_with_what_it_has_corrected(runs, tmp_path):
    wrong = with_fault(runs, Fault('swap', FORCES, recordings=('run3',)))
    wrong, where = with_outliers(wrong, 250.0)
    small = replace(wrong, noise_std={name: std / 3.0 for name, std in wrong.noise_std.items()})
    found = diagnosed(small)
    assert found.verdict == 'none' and found.effects == () and found.stages[-1].held_out < 1.2
    data = json.loads(json.dumps(as_data(found)))
    assert [one['kind'] for one in data['set_up']] == ['swap', 'outliers', 'noise']
    assert data['noise_std']['alpha'] == pytest.approx(3.5e-4, rel=0.1)
    text = list(as_text(found))
    assert text[1].startswith('Set-up: F_1 and F_2 are swapped in run3') and '--map' in text[1]
    training = replace(small, recordings=small.recordings[:2])
    held_out = replace(small, recordings=small.recordings[2:])
    review = reviewed(found, training, held_out, config('hybrid'))
    right = without_faults(training, held_out, found.set_up)[1]
    np.testing.assert_array_equal(review.held_out.recordings[0].channels['F_1'], right.recordings[0].channels['F_1'])


def test_a_noise_that_is_stated_too_large_is_found_where_a_fit_leaves_less(runs):
    large = replace(runs, noise_std={name: 3.0 * std for name, std in runs.noise_std.items()})
    found = diagnosed(large)
    assert found.verdict == 'none'
    assert {name for fault in found.set_up for name in fault.quantities} == {*POSE, *FORCES}
    assert all(fault.kind == 'noise' and fault.factor == pytest.approx(1.0 / 3.0, rel=0.1) for fault in found.set_up)
    assert all('too large' in fault.words for fault in found.set_up)


@pytest.mark.slow
def test_a_noise_that_is_stated_too_large_is_found_beside_the_effect_that_hid_it(with_gravity):
    large = replace(with_gravity, noise_std={name: 3.0 * std for name, std in with_gravity.noise_std.items()})
    found = diagnosed(large)
    assert found.verdict == 'missing_effect' and found.effects == ('gravity',)
    assert {name for fault in found.set_up for name in fault.quantities} == {*POSE, *FORCES}
    assert all(fault.kind == 'noise' and fault.factor == pytest.approx(1.0 / 3.0, rel=0.1) for fault in found.set_up)
    assert found.stages[-1].train == pytest.approx(1.0, abs=0.1)


def test_no_effect_is_searched_for_where_it_is_not_known_what_is_wrong(runs, monkeypatch):
    module = 'sma_sim.evidence.diagnosis.diagnose.faults_before_fits'
    open_fault = Fault('sign', ('alpha',), corrected=False, alternatives=((Fault('sign', ('U_y',)),),))
    monkeypatch.setattr(module, lambda *_: (open_fault,))
    found = diagnosed(replace(runs, floor=runs.noise_std))  # with which runs are searched together, where that may tell
    text = list(as_text(found))
    assert found.verdict == 'unknown_effect' and found.effects == () and found.proposal is None
    assert found.together is None
    assert text[0] == 'The set-up has to be fixed first; no effect was searched for.'
    assert 'alpha has the opposite sign, or U_y has the opposite sign: these recordings do not say which' in text[1]
    assert isinstance(found.posterior.none, float) and len(found.posterior.models) == 1


@pytest.mark.parametrize('stated', ['as the columns are called', 'as the samples scatter'])
def test_channels_that_are_exchanged_keep_their_noise(runs, stated):
    """Noise that was estimated belongs to the samples; noise that somebody stated, to the name of the channel."""
    noisy = {name: std * (10.0 if name == 'F_2' else 1.0) for name, std in runs.noise_std.items()}
    fault, random = Fault('swap', FORCES), np.random.default_rng(3)
    recordings = []
    for one in runs.recordings:
        added = random.normal(scale=np.sqrt(99.0) * runs.noise_std['F_2'], size=len(one.time))
        recordings.append(replace(one, channels={**one.channels, 'F_2': one.channels['F_2'] + added}))
    wrong = with_fault(replace(runs, recordings=tuple(recordings), noise_std=noisy), fault)
    if stated == 'as the samples scatter':
        wrong = replace(wrong, noise_std={**noisy, 'F_1': noisy['F_2'], 'F_2': noisy['F_1']})
    right = corrected(wrong, [fault])
    assert {name: pytest.approx(std) for name, std in right.noise_std.items()} == noisy


def test_what_repeats_differ_by_stays_where_a_unit_is_corrected(runs):
    """Samples say nothing of it, and it is in SI units."""
    differing = replace(runs, noise_std={**runs.noise_std, 'alpha': 0.01}, floor={'alpha': 0.01})
    fault = Fault('unit', ('alpha',), np.pi / 180.0, 'degrees')
    assert corrected(with_fault(differing, fault), [fault]).noise_std == differing.noise_std


def test_recordings_without_samples_of_a_channel_are_checked_too(runs):
    first, *others = runs.recordings
    empty = Recording(first.name, 'module', first.time, {'alpha': first.channels['alpha']}, first.source)
    assert faults_in(replace(runs, recordings=(empty, *others))) == ()


@pytest.mark.parametrize('is_measured', [False, True])
def test_a_sample_on_the_flank_of_an_isobaric_test_is_no_outlier(is_measured):
    """A model that transforms sharply is far off there for a sample, of what was measured none stands out."""
    given = read_config(words=ISOBARIC, effects=['smooth_transformation:width_A=1e8,width_M=8e7'])
    problem = problem_for(isobaric_tests(given, (1e8,)), given, FitOptions(kinetics='hybrid'), 1)
    (run,) = problem.runs
    k = int(np.abs(np.diff(run.measured[0])).argmax())
    residuals = np.zeros_like(run.measured)
    residuals[0, k] = 1e3
    measured = run.measured + is_measured * residuals / run.weight
    found = outliers(replace(problem, runs=(replace(run, measured=measured),)), [residuals])
    assert [fault.rows for fault in found] == ([{run.name: (k,)}] if is_measured else [])


def held_still(found, seed):
    """Recordings of a robot that does not move: where it was at first, and the noise."""
    random = np.random.default_rng(seed)

    def still(one):
        noise = {name: random.normal(scale=found.noise_std[name], size=len(one.time)) for name in one.channels}
        return replace(one, channels={name: values[0] + noise[name] for name, values in one.channels.items()})

    return replace(found, recordings=tuple(map(still, found.recordings)))


@pytest.mark.parametrize('seed', range(3))
def test_a_robot_that_does_not_move_tells_nothing_else(runs, seed):
    """Many laws keep it still, some of them to the last digit: none is named."""
    still = only(held_still(runs, seed), *POSE)
    (fault,) = faults_in(still)
    assert fault.kind == 'motionless' and fault.quantities == POSE and not fault.corrected
    one_moves = replace(still, recordings=(only(runs, *POSE).recordings[0], *still.recordings[1:]))
    assert all(other.kind != 'motionless' for other in faults_in(one_moves))
    if not seed:
        found = diagnosed(still)
        assert found.verdict == 'unknown_effect' and found.effects == () and found.proposal is None
        assert 'nothing moves: U_x, U_y and alpha stay within the noise' in list(as_text(found))[1]


def test_a_noise_that_is_stated_far_too_large_hides_no_motion(runs):
    """As one in the wrong unit: what is wrong then is the noise."""
    loud = replace(runs, noise_std={name: 1e3 * std for name, std in runs.noise_std.items()})
    assert all(fault.kind != 'motionless' for fault in faults_in(loud))


def test_a_robot_that_no_command_moves_is_right(runs):
    """Without any power nothing is to be seen of it."""
    cold = replace(only(held_still(runs, 1), *POSE), recordings=tuple(
        replace(one, source=replace(one.source, values=np.where([True, False], 0.0, one.source.values)))
        for one in only(held_still(runs, 1), *POSE).recordings
    ))  # fmt: skip
    assert all(fault.kind != 'motionless' for fault in faults_in(cold))
