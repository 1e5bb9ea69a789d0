"""What differs between the recordings of a campaign: found, named, and never physics of the robot."""

import json
from dataclasses import replace
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from made_recordings import write_recording
from systems import active

import sma_sim
from sma_sim.cli.main import main
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS, GAIN
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.diagnosis.review import reviewed
from sma_sim.evidence.estimation.calibrate import FitOptions, problem_for
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.held_out_prediction import point_with, run_fits
from sma_sim.evidence.estimation.levenberg_marquardt import refit
from sma_sim.evidence.estimation.motion_before import begin_in_motion
from sma_sim.evidence.estimation.problem import (
    AMBIENT,
    linearize,
    residuals_at,
    start_point,
    with_difference,
    with_own_unknowns,
)
from sma_sim.evidence.estimation.recording_differences import AMBIENT as UNKNOWN_ROOM
from sma_sim.evidence.estimation.recording_differences import (
    AMBIENT_STD,
    CONVECTION,
    IN_MOTION,
    LATE_COMMANDS,
    LENGTH,
    ROUNDED_COMMANDS,
    SUPPLY,
    RecordingDifference,
    with_differences,
    zeros_of,
)
from sma_sim.evidence.estimation.residuals import Nuisance, fit_data, planned_run, predict, steps_of_powers
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS
from sma_sim.evidence.model_selection.candidates import Candidate
from sma_sim.evidence.model_selection.differing_recordings import promises
from sma_sim.evidence.model_selection.model_changes import with_candidate, without_effect
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.search.components import Component, difference_component
from sma_sim.evidence.search.refine import Model, without_difference
from sma_sim.evidence.search.score import evidence_of
from sma_sim.report.html.diagnosis_page import write_diagnosis_page
from sma_sim.solver.inputs import Input, inputs_at
from sma_sim.words.diagnosis_data import as_data
from sma_sim.words.diagnosis_text import as_text

NOISE = {'U_y': 1e-5, 'alpha': 3.5e-4, 'F_1': 0.02, 'F_2': 0.02}
COMMANDS = ((10.0, -8.0), (-9.0, 12.0), (8.0, -11.0), (-12.0, 7.0))
ROUNDED = ((0.31, 0.18), (-0.22, -0.4), (-0.35, 0.11))  # [W] by which powers were more than the file says
SPREAD = {'run1': 0.065, 'run2': 0.09, 'run3': 0.23}  # [W], standard deviation of these
OPTIONS = FitOptions(free=('beam.E', 'wire.lambda'), kinetics='hybrid', starts=1, intervals=False)
DRIVER_LAG, CREEP = active('driver_lag', tau=1.0), active('beam_creep')
UNPOWERED = RecordingDifference('the power of one side', unpowered_side=1, recordings=('run1',))
REQUEST = DiagnosisRequest(kinetics='hybrid', options=OPTIONS, equation=False, variants=False)


def recorded(k, T_E=298.0, lost=0, alpha=0.0, more=(0.0, 0.0), factors=()):
    """A recording whose file says 298 K and its whole command, with what was different in truth."""
    first, second = COMMANDS[k]
    said = sma_sim.module_input([0.0, 2.0, 8.0, 14.0, 20.0], [0.0, first, 0.0, second, 0.0])
    true = said.values.copy()
    true[[1, 3], 0] += more
    true[:, 0] = np.where(np.sign(true[:, 0]) == lost, 0.0, true[:, 0])
    true[:, 0] *= dict(factors).get(GAIN, 1.0)
    true[:, 1] = T_E
    run = sma_sim.simulate(sma_sim.Config().scaled(dict(factors)), Input(said.times, true, said.linear), 10.0)
    random = np.random.default_rng(k)
    columns = {'U_y': 'U_y_m', 'alpha': 'alpha_rad', 'F_1': 'F_1_N', 'F_2': 'F_2_N'}
    noisy = {name: run[column] + NOISE[name] * random.standard_normal(len(run.time)) for name, column in columns.items()}
    noisy['alpha'] += alpha
    return sma_sim.Recording(f'run{k + 1}', 'module', run.time, noisy, said)


def diagnosed(*recordings):
    dataset = sma_sim.Dataset(recordings, NOISE)
    return dataset, diagnose(dataset, sma_sim.Config(), request=REQUEST)


def test_a_room_that_is_warmer_acts_like_an_input_that_says_so():
    run = fit_data(recorded(0), NOISE)
    warm = replace(run, source=replace(run.source, values=run.source.values + [0.0, 4.0]))
    expected = predict(sma_sim.Config(), warm, Nuisance(start=(0.4, 0.5)))
    shown = predict(sma_sim.Config(), run, Nuisance(start=(0.4, 0.5), ambient=4.0))
    assert all((shown[name] == expected[name]).all() for name in expected)


@pytest.mark.parametrize('difference', [UNKNOWN_ROOM, zeros_of({'alpha': 1e-3})])
def test_a_model_without_a_difference_is_the_one_before(difference):
    problem = problem_for(sma_sim.Dataset((recorded(0), recorded(1)), NOISE), sma_sim.Config(), OPTIONS, 5)
    z = start_point(problem) + 0.1
    differing, start = with_difference(*with_difference(problem, z, difference), UNPOWERED)
    components = (Component(difference.words, 0.0, difference), Component(UNPOWERED.words, 0.0, UNPOWERED))
    model = Model(components, FitResult(differing, start, 1.0), SimpleNamespace())
    found = without_difference(model, components[0], problem)
    only, plain = with_difference(problem, z, UNPOWERED)
    assert found.names == {UNPOWERED.words} and (found.fit.z == plain).all()
    assert found.fit.problem.differences == (UNPOWERED,) and found.fit.problem.unknowns == only.unknowns
    with executor_or_threads(None) as pool:
        for one, other in zip(residuals_at(found.fit.problem, plain, pool), residuals_at(only, plain, pool), strict=True):
            assert (one == other).all()


@pytest.mark.parametrize('side', [1, -1])
def test_power_that_is_lost(side):
    run = replace(fit_data(recorded(0), NOISE), unpowered_side=side)
    command = planned_run(run, Nuisance())[0].values[:, 0]
    assert (np.sign(command) != side).all() and (np.sign(command) == -side).any()


def test_the_derivative_in_the_room_is_that_of_the_residuals():
    dataset = with_differences(sma_sim.Dataset((recorded(0), recorded(1)), NOISE), (UNKNOWN_ROOM,))
    problem = problem_for(dataset, sma_sim.Config(), OPTIONS, 5)
    z = start_point(problem)
    assert [problem.unknowns[k] for k in (problem.indices()[0][-1], problem.indices()[1][-1])] == [AMBIENT, AMBIENT]
    with executor_or_threads(None) as pool:
        linear, side = linearize(problem, z, pool), z.copy()
        side[problem.indices()[0][-1]] = 0.05
        moved, here = residuals_at(problem, side, pool), residuals_at(problem, z, pool)
    expected = (moved[0] - here[0]) / 0.05
    assert np.abs(linear[0].jacobian[-1] - expected).max() <= 0.05 * np.abs(expected).max() and (moved[1] == here[1]).all()
    assert problem.nuisance(problem.runs[0], side[problem.indices()[0]]).ambient == pytest.approx(0.05 * AMBIENT_STD)


def test_what_is_promised_at_the_nominal_parameters():
    """At the true parameters, the difference that there is takes away most to first order, and no other as much."""
    dataset = sma_sim.Dataset((recorded(0), recorded(1, T_E=303.0), recorded(2)), NOISE)
    problem = problem_for(dataset, sma_sim.Config(), OPTIONS, 5)
    z = start_point(problem)
    with executor_or_threads(None) as pool:
        found = {one.words: gain for one, gain in promises(problem, z, SearchContext(pool, Event())).items()}
        squares = sum(float(np.vdot(run.residuals, run.residuals)) for run in linearize(problem, z, pool))
    room = found.pop('the ambient temperature')
    assert room > 0.5 * squares and room > max(found.values())


def test_recordings_of_which_only_one_has_unknowns_of_a_kind():
    """A run that was commanded with other digits, or without any power, promises what it can."""
    first, second = recorded(0), recorded(1, factors={'wire.lambda': 1.3})
    exact = second.source.values.copy()
    exact[[1, 3], 0] += 0.12345
    unheated = Input(second.source.times, exact * (np.arange(2) > 0), second.source.linear)
    for other in (
        replace(second, source=Input(second.source.times, exact, second.source.linear)),
        replace(second, source=unheated),
    ):
        problem = problem_for(sma_sim.Dataset((first, other), NOISE), sma_sim.Config(), OPTIONS, 5)
        with executor_or_threads(None) as pool:
            found = promises(problem, start_point(problem), SearchContext(pool, Event()))
        assert found[CONVECTION] > 0.0 and np.isfinite(list(found.values())).all()


def test_only_parameters_of_the_robot_may_vary():
    assert replace(recorded(0), varied={'wire.l0': 0.01, GAIN: 0.0}).varied[GAIN] == 0.0
    for name, std in (('wire.l_0', 0.01), (GAIN, -0.1), (GAIN, np.inf), ('beam.E', np.nan)):
        with pytest.raises(sma_sim.UserError, match=f'recording run1, varied: .* for .?{name}'):
            replace(recorded(0), varied={name: std})


def test_zeros_that_several_sensors_got_between_recordings_are_one_difference():
    """Whoever presses tare: those of two channels beside the one that promises most, and not those that have none."""
    first, second, third = recorded(0), recorded(1, alpha=0.003), recorded(2)
    third = replace(third, channels=third.channels | {'F_1': third.channels['F_1'] + 0.1})
    problem = problem_for(sma_sim.Dataset((first, second, third), NOISE), sma_sim.Config(), OPTIONS, 5)
    with executor_or_threads(None) as pool:
        found = promises(problem, start_point(problem), SearchContext(pool, Event()))
        zeros = [one for one in found if one.zeros]
        assert [one.words for one in zeros] == ['the zero of alpha', 'the zeros of alpha and F_1']
        differing, z = with_difference(problem, start_point(problem), zeros[1])
        left = promises(differing, z, SearchContext(pool, Event()))
    assert not any(one.zeros for one in left) and found[zeros[1]] > found[zeros[0]] > 100.0
    one, both = (difference_component(one, problem).log_prior for one in zeros)
    assert both == pytest.approx(one - len(NOISE) * np.log(2.0))


def test_a_zero_that_drifts_in_each_recording_by_its_own_amount_is_a_difference():
    """As of a load cell that warms: no effect of the robot, which would drift alike in all of them."""

    def drifted(number, amount):
        run = recorded(number)
        part = (run.time - run.time[0]) / np.ptp(run.time)
        return replace(run, channels=run.channels | {'F_1': run.channels['F_1'] + amount * part})

    dataset = sma_sim.Dataset((drifted(0, 0.3), drifted(1, -0.3), recorded(2)), NOISE)
    problem = problem_for(dataset, sma_sim.Config(), OPTIONS, 5)
    with executor_or_threads(None) as pool:
        context = SearchContext(pool, Event())
        found = promises(problem, start_point(problem), context)
        drift = next(one for one in found if one.drifting)
        assert drift.words == 'the drift of the zero of F_1' and found[drift] > 100.0
        differing, z = with_difference(problem, start_point(problem), drift)
        assert not any(one.zeros for one in promises(differing, z, context))
        fit = refit(differing, z, context, FROM_PRIORS)
        drifts = [run.drifts['F_1'] for run in run_fits(fit.problem, fit.z, pool)]
        alone = evidence_of(refit(problem, start_point(problem), context, FROM_PRIORS), 0.0, context)
        assert evidence_of(fit, 0.0, context).score(1.0) > alone.score(1.0) + 50.0
    assert drifts == pytest.approx([0.3, -0.3, 0.0], abs=0.05)


def pieces(cuts=(9.0, 17.0, 28.0), length=10.0, effects=()):
    """Pieces of one long recording, whose wires are warm from before where they begin, and how warm they were [K]."""
    times, powers = [0.0, 2.0, 8.5, 14.0, 16.0, 22.0, 27.0, 33.0, 40.0], [0.0, 10.0, 0.0, -9.0, 8.0, 0.0, -12.0, 6.0, 6.0]
    model, random = sma_sim.Model(sma_sim.Config(effects=effects)), np.random.default_rng(5)
    run = sma_sim.simulate(model, sma_sim.module_input(times, powers), 10.0)
    columns = {'U_y': 'U_y_m', 'alpha': 'alpha_rad', 'F_1': 'F_1_N', 'F_2': 'F_2_N'}
    found, warm = [], {}
    for k, cut in enumerate(cuts, start=1):
        rows = np.array([cut, *(t for t in times if cut < t < cut + length), cut + length])
        said = sma_sim.module_input(rows - cut, np.array(powers)[np.searchsorted(times, rows, side='right') - 1])
        own = slice(round(10.0 * cut), round(10.0 * (cut + length)))
        noise = {name: NOISE[name] * random.standard_normal(own.stop - own.start) for name in columns}
        noisy = {name: run[column][own] + noise[name] for name, column in columns.items()}
        found.append(sma_sim.Recording(f'run{k}', 'module', run.time[own] - cut, noisy, said))
        warm[f'run{k}'] = [float(run[name][own.start]) for name in ('T_1_K', 'T_2_K')]
    return tuple(found), warm


@pytest.mark.slow
def test_recordings_that_begin_warm_are_said_to_and_lack_nothing():
    """Their wires are as warm as they were; one that is held out is predicted from its beginning."""
    recordings, true = pieces()
    request = replace(REQUEST, options=replace(OPTIONS, intervals=True))
    found = diagnose(sma_sim.Dataset(recordings, NOISE), sma_sim.Config(), request=request)
    data, text = as_data(found), '\n'.join(as_text(found))
    assert data['verdict'] == 'none' and data['effects'] == [] and data['probabilities']['none'] > 0.99
    (difference,) = data['differences']
    assert difference['what'] == 'how warm its wires are when it begins'
    for name, wires in difference['wires'].items():
        for wire, temperature in zip(wires, true[name], strict=True):
            assert wire['T'] == pytest.approx(temperature, abs=1.0)
            if name != 'run3':  # held out, without intervals
                assert wire['low'] - 0.1 < temperature < wire['high'] + 0.1  # 1 of 20 may miss
    assert 'do not begin at rest, no effect of the robot: wire_' in text and ' of run3 at ' in text
    assert data['error'][-1]['held_out'] < 1.1 < data['error'][0]['held_out']


def test_a_fit_and_a_comparison_are_told_that_recordings_may_begin_in_motion(tmp_path, capsys):
    """Then the true model explains them, and one that is held out, and the warm wires are said."""
    for one in pieces()[0]:
        command = inputs_at(one.source, one.time)['J_eq_W']
        channels = {CHANNEL_COLUMNS[name]: values for name, values in one.channels.items()}
        columns = {'time_s': one.time, 'J_eq_W': command, 'T_E_K': np.full(len(one.time), 298.0), **channels}
        write_recording(tmp_path / f'{one.name}.csv', columns)
    noise = [word for name, std in NOISE.items() for word in ('--noise', f'{name}={std}')]
    errors = []
    for words in ([], ['--in-motion']):
        path = tmp_path / 'found.json'
        command = ['compare', str(tmp_path), '--hold-out', 'run3', *noise, *words, '--json', str(path)]
        assert main(command) == 0
        errors.append(json.loads(path.read_text())['comparisons'][0]['error'])
    (rest, moving) = errors
    assert rest['train'] > 3.0 and rest['held_out'] > 3.0
    assert moving['train'] < 1.1 and moving['held_out'] < 1.2
    capsys.readouterr()
    assert main(['fit', str(tmp_path), '--free', 'beam.E', '--model', 'hybrid', '--starts', '1', *noise, '--in-motion']) == 0
    assert 'how warm wires were when recordings began, estimated for each: wire_1 of run1 at ' in capsys.readouterr().out


def test_a_fit_is_told_what_recordings_differ_in(tmp_path, capsys):
    """In one of them the driver gives 7 % less than was commanded."""
    for one in pieces()[0][:2]:
        factor = 0.93 if one.name == 'run2' else 1.0
        command = inputs_at(one.source, one.time)['J_eq_W'] / factor
        channels = {CHANNEL_COLUMNS[name]: values for name, values in one.channels.items()}
        columns = {'time_s': one.time, 'J_eq_W': command, 'T_E_K': np.full(len(one.time), 298.0), **channels}
        write_recording(tmp_path / f'{one.name}.csv', columns)
    noise, path = [word for name, std in NOISE.items() for word in ('--noise', f'{name}={std}')], tmp_path / 'found.json'
    command = ['fit', str(tmp_path), '--free', 'beam.E', '--model', 'hybrid', '--starts', '1', '--in-motion', *noise]
    assert main([*command, '--differ', 'power,ambient', '--json', str(path)]) == 0
    said = capsys.readouterr().out
    factors = {name: run['factors'][GAIN] for name, run in json.loads(path.read_text())['error']['runs'].items()}
    assert factors['run2'] / factors['run1'] == pytest.approx(0.93, abs=0.005)
    assert f'the power that its driver gives, estimated for each recording as a factor: run1 {factors["run1"]:.4g}' in said
    assert main([*command, '--differ', 'lenght']) == 2
    assert '--differ lenght: expected ambient, heat-transfer, length' in capsys.readouterr().err


def test_the_derivatives_in_what_is_left_of_a_motion_are_those_of_the_residuals():
    """Of the states of an effect too, such as the power that a driver still gives."""
    dataset = with_differences(sma_sim.Dataset(pieces()[0][:1], NOISE), (IN_MOTION,))
    problem = problem_for(dataset, sma_sim.Config(effects=(DRIVER_LAG,)), OPTIONS, 5, step_limited=False)
    z = start_point(problem)
    own = range(len(z) - len(problem.beginning_std(problem.runs[0]).values), len(z))
    z[own] = [0.5, 0.2, 0.0, 0.1, 0.1, 0.0, 0.0, 0.0, 0.3, 1.0]
    with executor_or_threads(None) as pool:
        (linear,) = linearize(problem, z, pool)
        for k in (*own[:5], *own[-2:]):
            moved = [
                residuals_at(problem.at_tolerance(1e-7), z + step * np.eye(len(z))[k], pool)[0] for step in (1e-3, -1e-3)
            ]
            expected = (moved[0] - moved[1]) / 2e-3
            assert linear.jacobian[k] == pytest.approx(expected, abs=0.02 * np.abs(expected).max())


def test_the_states_of_effects_begin_where_a_recording_says():
    """A held-out one from its first tenth: a driver that is still at the power of a command before it heats on."""
    moving = tuple(replace(one, in_motion=True) for one in pieces(effects=(DRIVER_LAG,))[0])
    found = sma_sim.evaluate_held_out(sma_sim.Config(effects=(DRIVER_LAG,)), sma_sim.Dataset(moving, NOISE))
    assert max(fit.error for fit in found) < 1.1
    (name, powers), *_ = found[0].beginning.states
    assert name == 'driver_lag' and len(powers) == 2


def test_the_unknown_states_of_an_effect_come_and_go_with_it():
    """Whatever stands behind them among the unknowns keeps its value; of a recording at rest there are none."""
    screened, own = ScreeningResult(Candidate(DRIVER_LAG.effect, ()), 0.0, {'tau': 0.5}), ['states.driver_lag'] * 2
    at_rest = problem_for(sma_sim.Dataset(pieces()[0][:2], NOISE), sma_sim.Config(effects=(CREEP,)), OPTIONS, 5)
    for problem in (at_rest, with_difference(at_rest, start_point(at_rest), IN_MOTION)[0]):
        z = np.arange(0.1, len(problem.unknowns) / 10.0 + 0.05, 0.1)
        larger, there = with_candidate(FitResult(problem, z, 1.0), screened)
        states = own * (len(larger.unknowns) - len(problem.unknowns) > 2)
        names = [[unknown.name for unknown in one.own(one.runs[1])] for one in (problem, larger)]
        behind = next((k for k, name in enumerate(names[0]) if name == 'states.beam_creep'), len(names[0]))
        assert names[1] == [*names[0][:behind], *states, *names[0][behind:]] and (problem is at_rest) == (not states)
        assert len(there) == len(larger.unknowns)
        again, back = without_effect(FitResult(larger, there, 1.0), 'driver_lag')
        assert again.unknowns == problem.unknowns and (back == z).all()


def test_a_candidate_frees_no_parameters_of_channels_that_nothing_measures():
    effect = sma_sim.find_effects()['sensor_drift']
    screened = ScreeningResult(Candidate(effect, ()), 0.0, {p.name: p.default for p in effect.parameters})
    problem = problem_for(sma_sim.Dataset(pieces()[0][:1], NOISE), sma_sim.Config(), OPTIONS, 5)
    larger, there = with_candidate(FitResult(problem, start_point(problem), 1.0), screened)
    more = [one.name.removeprefix('effects.sensor_drift.') for one in larger.free[len(problem.free) :]]
    assert more == [name for name in ('U_x', 'U_y', 'alpha', 'F_1', 'F_2') if name in NOISE] + ['k']
    assert len(there) == len(larger.unknowns)


def test_a_motion_before_is_proposed_where_first_samples_are_not_those_at_rest():
    """Whatever a fit has made of the other parameters; of a single recording too."""
    with executor_or_threads(None) as pool:
        for recordings, begins_warm in (
            ((recorded(0), recorded(1)), False),
            (pieces()[0][:2], True),
            (pieces()[0][:1], True),
        ):
            problem = problem_for(sma_sim.Dataset(recordings, NOISE), sma_sim.Config(), OPTIONS, 5)
            bent = start_point(problem) + 0.3 * (np.arange(len(start_point(problem))) < len(problem.free))
            found = promises(problem, bent, SearchContext(pool, Event()))
            motion = found[IN_MOTION]
            assert (motion > 100.0) == begins_warm
            assert begin_in_motion(problem, SearchContext(pool, Event())) == begins_warm == (motion > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('recordings', 'words', 'expected'),
    [
        ((recorded(0), recorded(1, alpha=0.01), recorded(2)), 'the zero of alpha', {'run1': 0.0, 'run2': 0.01, 'run3': 0.0}),
        ((recorded(0), recorded(1, T_E=303.0), recorded(2)), 'the ambient temperature', {'run1': 0, 'run2': 5, 'run3': 0}),
        (tuple(recorded(k, more=more) for k, more in enumerate(ROUNDED)), 'the rounding of commands', SPREAD),
        (
            (recorded(0), recorded(1, factors={'wire.lambda': 1.3}), recorded(2)),
            'the heat transfer to the air',
            {'run1': -0.12, 'run2': 0.145, 'run3': -0.12},
        ),
        (
            (recorded(0), recorded(1), recorded(2, lost=-1), recorded(3, lost=-1)),
            'the power of the wires that negative commands heat',
            {'run1': False, 'run2': False, 'run3': True, 'run4': True},
        ),
    ],
)
def test_differences_are_named_and_nothing_is_missing(recordings, words, expected):
    dataset, found = diagnosed(*recordings)
    data, text = as_data(found), list(as_text(found))
    assert data['verdict'] == 'none' and data['effects'] == []
    (difference,) = data['differences']
    assert difference['what'] == words and words in text[0]
    sizes = {'the ambient temperature': 0.5, 'the rounding of commands': 0.03, 'the heat transfer to the air': 0.01}
    tolerance = sizes.get(words, 1e-3)
    assert difference['by_recording'] == pytest.approx(expected, abs=tolerance)
    assert data['error'][-1]['held_out'] < 1.1
    held_out = replace(dataset, recordings=dataset.recordings[-1:])
    review = reviewed(found, replace(dataset, recordings=dataset.recordings[:-1]), held_out, sma_sim.Config())
    assert max(review.remaining.comparison.runs[-1].measured) and review.diagnosis is found


def test_rooms_are_told_by_their_differences_with_intervals_that_hold_them():
    """Half a kelvin between three runs, the last one held out."""
    true = {'run1': 0.0, 'run2': 0.5, 'run3': 0.0}
    recordings = tuple(recorded(k, T_E=298.0 + above) for k, above in enumerate(true.values()))
    request = replace(REQUEST, options=replace(OPTIONS, intervals=True))
    found = diagnose(sma_sim.Dataset(recordings, NOISE), sma_sim.Config(), request=request)
    (difference,) = as_data(found)['differences']
    assert difference['what'] == 'the ambient temperature' and found.verdict == 'none'
    assert list(difference['above_first']) == list(true)
    for name, there in difference['above_first'].items():
        assert there['low'] <= true[name] <= there['high'] and there['high'] - there['low'] < 0.3
    assert any('run2 +0.' in line and '(+0.' in line for line in as_text(found))


def test_a_model_whose_recordings_differ_is_said_to_be_one_wherever_it_is_shown(tmp_path):
    """In the verdict, in its data, and on the page: beside the one whose recordings do not."""
    recordings = (recorded(0), recorded(1, alpha=0.01), recorded(2))
    dataset, found = diagnosed(*recordings)
    assert [one['differences'] for one in as_data(found)['error']] == [[], ['the zero of alpha']]
    rows = [line.split('  ')[1] for line in as_text(found) if line.startswith('  nominal model')]
    assert rows == ['nominal model (hybrid)', 'nominal model, recordings differ (hybrid)']
    write_diagnosis_page(tmp_path / 'why.html', reviewed(found, dataset, None, sma_sim.Config()))
    page = (tmp_path / 'why.html').read_text()
    assert 'that the recordings differ in the zero of alpha.' in page and 'recordings<br>that differ' in page


def test_a_held_out_run_in_another_room_is_no_effect():
    """Nothing differs between the fitted runs, so that the room of the last one can be told when all are fitted only."""
    found = diagnosed(recorded(0), recorded(1), recorded(2), recorded(3, T_E=303.0))[1]
    assert found.verdict == 'none' and found.effects == () and found.stages[-1].held_out > 1.3
    assert found.pooled_errors is not None and found.pooled_errors.explained()
    ambient = dict(found.pooled_errors.ambient)
    warmest = ambient.pop('run4')
    assert warmest - np.mean(list(ambient.values())) == pytest.approx(5.0, abs=0.5)
    assert any(f'run4 {warmest:+.2g}' in line for line in as_text(found))


def test_commands_that_are_late_by_differing_times():
    """Drawn between 0 and 0.1 s: the model with one more unknown for each begins where it was, and they promise most."""
    random, late = np.random.default_rng(3), list[sma_sim.Recording]()
    for k in range(3):
        said = recorded(k).source
        times = said.times.copy()
        times[1:] += random.uniform(0.0, 0.1, len(times) - 1)
        run = sma_sim.simulate(sma_sim.Model(), Input(times, said.values, said.linear), 10.0)
        columns = {'U_y': 'U_y_m', 'alpha': 'alpha_rad', 'F_1': 'F_1_N', 'F_2': 'F_2_N'}
        noisy = {name: run[column] + NOISE[name] * random.standard_normal(len(run.time)) for name, column in columns.items()}
        late.append(sma_sim.Recording(f'run{k + 1}', 'module', run.time, noisy, said))
    problem = problem_for(sma_sim.Dataset(tuple(late), NOISE), sma_sim.Config(), OPTIONS, 1)
    z = start_point(problem)
    z[len(problem.free)] = 1.0
    differing, start = with_difference(problem, z, LATE_COMMANDS)
    with executor_or_threads(None) as pool:
        for one, other in zip(residuals_at(problem, z, pool), residuals_at(differing, start, pool), strict=True):
            assert one == pytest.approx(other, abs=0.05)
        found = promises(problem, z, SearchContext(pool, Event()))
        assert max(found, key=found.get) == LATE_COMMANDS and found[LATE_COMMANDS] > 100.0
        assert LATE_COMMANDS not in promises(differing, start, SearchContext(pool, Event()))
    assert with_own_unknowns(differing, start, problem) == pytest.approx(z)


@pytest.mark.parametrize(
    ('powers', 'steps'),
    [
        ((3.7, 12.4, -0.4), (0.1, 0.1, 0.1)),
        ((3.7, 12.0, 0.38), (0.1, 1.0, 0.01)),
        ((0.1 * 3, 1.2e-3), (1e-2, 1e-4)),
        ((10.0, 20.0), (10.0, 10.0)),
        ((12.43, 7.5), ()),
        ((np.pi, 2.0), ()),
        ((0.0,), ()),
        (tuple(1.0 + k % 2 for k in range(30)), ()),
    ],
)
def test_to_what_powers_may_have_been_rounded(powers, steps):
    """To as many decimals or to as many digits, whichever is coarser; not with four digits, nor thirty of them."""
    said = sma_sim.module_input(np.arange(len(powers) + 2.0), [0.0, *powers, 0.0])
    assert steps_of_powers(said) == pytest.approx(steps)


def test_commands_that_were_rounded():
    """The model with one more unknown for each power begins where it was, they promise most, and a fit finds them; a run
    that was held out as well."""
    recordings = tuple(recorded(k, more=more) for k, more in enumerate(ROUNDED))
    problem = problem_for(sma_sim.Dataset(recordings[:2], NOISE), sma_sim.Config(), OPTIONS, 1)
    z = start_point(problem)
    differing, start = with_difference(problem, z, ROUNDED_COMMANDS)
    with executor_or_threads(None) as pool:
        context = SearchContext(pool, Event())
        for one, other in zip(residuals_at(problem, z, pool), residuals_at(differing, start, pool), strict=True):
            assert (one == other).all()
        found = promises(problem, z, context)
        assert max(found, key=found.get) == ROUNDED_COMMANDS and found[ROUNDED_COMMANDS] > 1000.0
        assert ROUNDED_COMMANDS not in promises(differing, start, context)
        fit = refit(differing, start, context)
        for run, indices, more in zip(differing.runs, differing.indices(), ROUNDED, strict=False):
            assert differing.nuisance(run, fit.z[indices]).powers == pytest.approx(more, abs=0.03)
        runs = run_fits(differing, fit.z, pool)
    assert point_with(differing, fit.z[: len(differing.shared)], runs) == pytest.approx(fit.z)
    held_out = with_differences(sma_sim.Dataset(recordings[2:], NOISE), (ROUNDED_COMMANDS,))
    (predicted,) = sma_sim.evaluate_held_out(sma_sim.Config(), held_out)
    assert predicted.error < 1.1 and predicted.powers == pytest.approx(ROUNDED[2], abs=0.03)
    assert sma_sim.evaluate_held_out(sma_sim.Config(), sma_sim.Dataset(recordings[2:], NOISE))[0].error > 3.0


@pytest.mark.parametrize(('difference', 'factor'), [(CONVECTION, 1.25), (LENGTH, 0.998), (SUPPLY, 0.94)])
def test_a_parameter_that_is_another_one_in_a_recording(difference, factor):
    """Its derivative is that of the residuals, it promises most, and a fit finds the quotient of two recordings."""
    name, varied = difference.parameter, {difference.parameter: factor}
    problem = problem_for(sma_sim.Dataset((recorded(0), recorded(1, factors=varied)), NOISE), sma_sim.Config(), OPTIONS, 1)
    z = start_point(problem)
    differing, start = with_difference(problem, z, difference)
    (at,) = [k for k, one in enumerate(differing.own(differing.runs[0])) if name in one.name]
    with executor_or_threads(None) as pool:
        context = SearchContext(pool, Event())
        for one, other in zip(residuals_at(problem, z, pool), residuals_at(differing, start, pool), strict=True):
            assert (one == other).all()
        for k, run in enumerate(linearize(differing, start, pool)):
            own = differing.indices()[k][len(differing.shared) + at]
            sides = [
                residuals_at(differing, start + step * (np.arange(len(start)) == own), pool)[k] for step in (1e-3, -1e-3)
            ]
            slope = (sides[0] - sides[1]) / 2e-3
            assert run.jacobian[len(differing.shared) + at] == pytest.approx(slope, abs=0.02 * float(np.abs(slope).max()))
        found = promises(problem, z, context)
        assert max(found, key=found.get) == difference and difference not in promises(differing, start, context)
        fit = refit(differing, start, context)
        runs = run_fits(differing, fit.z, pool)
    first, second = (dict(run.factors)[name] for run in runs)
    assert second / first == pytest.approx(factor, abs=0.1 * abs(factor - 1.0))
    assert point_with(differing, fit.z[: len(differing.shared)], runs) == pytest.approx(fit.z)
    held_out = with_differences(sma_sim.Dataset((recorded(2, factors=varied),), NOISE), (difference,))
    (predicted,) = sma_sim.evaluate_held_out(sma_sim.Config(), held_out)
    assert predicted.error < 1.1 and dict(predicted.factors)[name] == pytest.approx(factor, abs=0.1 * abs(factor - 1.0))
