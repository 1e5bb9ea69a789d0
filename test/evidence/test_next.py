"""The next experiment: sequences keep their limits, utilities are what dense formulas give, designs beat the default."""

import argparse
import json
import shlex
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import permutations
from threading import Event
from types import SimpleNamespace as Some

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from simulated_data import NOISE, config, dataset, scaled

from sma_sim import Config, UserError, find_effects
from sma_sim.cli import diagnose, next
from sma_sim.cli.common.input_files import read_input_file
from sma_sim.cli.main import main
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.evidence.data.tables import write_columns
from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.experiment_design import design, refitted_utilities, utilities
from sma_sim.evidence.experiment_design.curves import best_hypothesis, hypothesis_curves
from sma_sim.evidence.experiment_design.design import (
    best_plan,
    command_grid,
    next_experiment,
    operating_limits,
    parameter_combinations,
)
from sma_sim.evidence.experiment_design.forecast import OperatingLimits, RunPrediction
from sma_sim.evidence.experiment_design.plan import DesignRequest, ParameterPrecision
from sma_sim.evidence.experiment_design.rival_fits import named_rivals
from sma_sim.evidence.experiment_design.sequences import (
    SIGNAL_SHAPES,
    CommandGrid,
    as_input,
    as_rows,
    default_sequence,
    mutated,
    quantized,
    random_sequence,
)
from sma_sim.evidence.experiment_design.utilities import (
    RivalPair,
    combination_precision,
    discrimination_utility,
    evidence_ratios,
    information_gain,
    linearized_rival,
    weak_directions,
)
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.report.html.design_page import write_design_page
from sma_sim.words.experiment_design import BEGINS_IN_MOTION, channels_sentence, indistinguishable_sentences, plan_data
from sma_sim.workflow.diagnosis import confounded

POSE = ('U_x', 'U_y', 'alpha')
SHORT = {'length': 20.0, 'hold': 0.5, 'model': 'mas', 'budget': 16}


@given(seed=some.integers(0, 2**32 - 1), cells=some.integers(4, 300), power=some.floats(0.01, 40.0))
@settings(deadline=None)
def test_sequences_keep_power_length_and_hold(seed, cells, power):
    grid, random = CommandGrid(cells, 0.25, power), np.random.default_rng(seed)
    parents = [random_sequence(grid, random), quantized(default_sequence(grid, random), grid)]
    parents += [quantized(shape(grid, random), grid) for shape in SIGNAL_SHAPES]
    for levels in [*parents, mutated(parents, grid, random)]:
        assert levels.shape == (cells,) and np.abs(levels).max() <= power
        times, rows = as_rows(levels, grid)
        assert times[0] == 0.0 and times[-1] == grid.length and rows[-1] == 0.0
        assert np.diff(times).min() >= 0.25 - 1e-9
        held = as_input(levels, grid, 298.0)
        at = np.searchsorted(held.times, 0.25 * (np.arange(cells) + 0.5), side='right') - 1
        assert np.array_equal(held.values[at, 0], levels)


def linear_model(seed, m=4, N=30):
    """A hypothesis that is linear: its centre and the derivatives by whitened unknowns."""
    random = np.random.default_rng(seed)
    G = random.normal(size=(1, m, N))
    return RunPrediction(random.normal(size=(1, N)), G, np.zeros((0, N)), 300.0, 1e8)


def test_ratio_is_the_divergence_of_the_predictive_distributions(monkeypatch):
    monkeypatch.setattr(utilities, 'POSTERIOR_DRAWS', 40_000)
    a, b = linear_model(1), linear_model(2)
    (found,) = evidence_ratios([a, b], [RivalPair(0, 1)])
    S_a, S_b = (np.eye(30) + model.jacobians[0].T @ model.jacobians[0] for model in (a, b))
    d, inverse = (a.centres - b.centres)[0], np.linalg.inv(S_b)
    dets = np.linalg.slogdet(S_b)[1] - np.linalg.slogdet(S_a)[1]
    exact = 0.5 * (d @ inverse @ d + np.trace(inverse @ S_a) - 30 + dets)
    assert found.mean == pytest.approx(exact, rel=0.02) and exact > 1.0


def test_what_a_rival_can_follow_is_no_evidence():
    a, b = linear_model(1), linear_model(2)
    strong = replace(b, jacobians=1e4 * b.jacobians)
    follows = replace(a, centres=b.centres + (np.array([1.0, -2.0, 0.5, 1.0]) @ b.jacobians[0])[None])
    left = linearized_rival(strong).squares_left(follows.centres - strong.centres)
    assert left[0] < 1e-6 < 1.0 < linearized_rival(b).squares_left(follows.centres - b.centres)[0]
    rest = linearized_rival(strong).residual((follows.centres - strong.centres)[0])
    assert np.abs(rest).max() < 1e-6
    assert discrimination_utility(evidence_ratios([a, a], [RivalPair(0, 1)])) == pytest.approx(0.0, abs=1.0)


def test_knowledge_is_that_of_the_joint_information():
    experiment, root = linear_model(3), np.linalg.cholesky(np.diag([0.5, 0.1]) + 0.05)
    weights = np.array([[1.0, 0.0]])
    before, then = combination_precision(weights, root), combination_precision(weights, root, experiment)
    G = experiment.jacobians[0]
    whitening = np.block([[np.linalg.inv(root), np.zeros((2, 2))], [np.zeros((2, 2)), np.eye(2)]])
    information = whitening.T @ (np.eye(4) + G @ G.T) @ whitening  # in the unknowns themselves, starts included
    assert before.std[0] == pytest.approx(np.sqrt((root @ root.T)[0, 0]))
    assert then.std[0] == pytest.approx(np.sqrt(np.linalg.inv(information)[0, 0]))
    assert information_gain(weights, root, experiment) == pytest.approx(np.log(before.std[0] / then.std[0]))


def test_weak_directions_are_those_of_large_variance():
    covariance = np.diag([1e-4, 0.3, 1e-6, 0.2])
    assert np.abs(weak_directions(covariance, 0.1, 1))[:, [1, 3]].sum() == pytest.approx(2.0)
    assert len(weak_directions(1e-6 * covariance, 0.1, 3)) == 3


def measured(effect='gravity', channels=POSE, seeds=(1, 2), seconds=40.0, **values):
    truth = scaled(config('mas'), wire__lambda=1.05, beam__E=1.04)
    if effect:
        truth = with_effect(truth, find_effects()[effect], values or {'g_y': -9.81})
    runs = dataset(truth, seeds, 1.0, seconds, rate=10.0, channels=channels)
    return replace(runs, noise_std={name: NOISE[name] for name in channels})


BETWEEN = ('gravity', 'sensor_bias')


# Rivals are refitted to one default sequence, to the best of the linear search, and to one that is mutated from it.
FEW_REFITS = {'MIN_REFITTED': 3, 'REFITTED_PARENTS': 1, 'REFITTED_DEFAULTS': 1, 'REFITTED_BATCH': 1}


@pytest.fixture(scope='module')
def rivals():
    runs = measured(seconds=20.0)
    with pytest.MonkeyPatch.context() as patch:
        for name, value in FEW_REFITS.items():
            patch.setattr(refitted_utilities, name, value)
        return runs, next_experiment(runs, config(), DesignRequest(BETWEEN, temperature=325.0, **SHORT))


def test_a_design_tells_more_than_the_default_and_keeps_all_limits(rivals):
    runs, plan = rivals
    assert {(ratio.true, ratio.rival) for ratio in plan.expected} == set(permutations(BETWEEN))
    assert plan.expected[0].designed > plan.expected[0].default > 0.0
    assert np.abs(plan.levels).max() <= max(np.abs(recording.source.values[:, 0]).max() for recording in runs.recordings)
    assert plan.limits.temperature == 325.0 >= max(prediction.temperature for prediction in plan.predictions)
    assert all(prediction.is_within(plan.limits) for prediction in plan.predictions)
    assert plan.evaluated == 11 and not plan.interrupted
    assert plan.limits_from == {
        'power': 'the largest command in the recordings',
        'temperature': 'given',
        'stress': 'a tenth above what the recordings reached in the model',
    }
    data = json.loads(json.dumps(plan_data(plan), allow_nan=False))
    assert data['kind'] == 'rivals' and data['sequence']['time_s'][-1] == SHORT['length']
    assert data['reached']['temperature_K'] <= data['limits']['temperature_K']


def test_curves_are_what_the_hypotheses_predict_and_their_page_is_written(rivals, tmp_path):
    _, plan = rivals
    first, second = curves = hypothesis_curves(plan)
    best, rival = (first, second) if first.remainder is None else (second, first)
    assert plan.hypotheses[best_hypothesis(plan)].name == best.name and best.remainder is None
    weight, scale = plan.run.weight, np.sqrt(plan.every)
    difference = (best.mean - rival.mean) * weight / scale
    assert rival.remainder.shape == difference.shape == first.std.shape == (len(POSE), len(plan.run.time))
    assert 0.0 < np.sum(rival.remainder**2) < np.sum(difference**2)  # refitting follows a part
    assert (first.std > 0.0).any() and np.isfinite(first.std).all()
    write_design_page(tmp_path / 'next.html', plan, curves)
    page = (tmp_path / 'next.html').read_text()
    assert 'What a refitted rival cannot follow' in page
    assert plan.further_channels[0].decides and channels_sentence(plan.further_channels) in page


@pytest.mark.slow
def test_the_same_seed_and_limits_give_the_same_sequence():
    """Limits that are given count like those that are found."""
    runs, names = measured(''), ('wire.lambda', 'beam.E')
    plan = next_experiment(runs, config(), DesignRequest((), names, **SHORT))
    given = {'power': plan.grid.power, 'temperature': plan.limits.temperature, 'stress': plan.limits.stress}
    again = next_experiment(runs, config(), DesignRequest((), names, **given, **SHORT))
    assert np.array_equal(again.levels, plan.levels)
    assert again.limits == OperatingLimits(given['temperature'], given['stress']) and set(again.limits_from.values()) == {
        'given'
    }


def test_limits_that_are_given_replace_those_found(rivals):
    runs, plan = rivals
    request = DesignRequest(BETWEEN, power=20.0, temperature=330.0, stress=3e8, **SHORT)
    with ThreadPoolExecutor(1) as pool:
        assert operating_limits(plan.hypotheses, request, pool)[0] == OperatingLimits(330.0, 3e8) != plan.limits
    assert command_grid(runs, request, config().structure)[0].power == 20.0 > plan.grid.power


@pytest.mark.slow
def test_what_the_equations_confound_is_said():
    """A spring in series is an equal shift of 1/E_A and 1/E_M, which every fit is free to make."""
    runs = measured('')
    plan = next_experiment(runs, config(), DesignRequest(('nothing', 'attachment_compliance'), **SHORT))
    assert plan.indistinguishable == (('attachment_compliance', 'nothing'),)
    (words,) = indistinguishable_sentences(plan)
    assert words.startswith('no experiment on these channels tells attachment_compliance from nothing apart')


def designed(rivals, request, on_progress=lambda words: None):
    """A design between the rivals that are fitted already."""
    runs, plan = rivals
    with ThreadPoolExecutor(2) as pool:
        return best_plan(runs, plan.hypotheses, request, SearchContext(pool, Event(), on_progress))


@pytest.mark.slow
def test_ctrl_c_gives_the_best_so_far(rivals):
    def on_progress(words):
        if 'sequences evaluated' in words:
            raise KeyboardInterrupt

    plan = designed(rivals, DesignRequest(BETWEEN, **(SHORT | {'budget': 24})), on_progress)
    assert plan.interrupted and plan.evaluated < 24 and plan.expected[0].designed > 0.0


def write_runs(folder, runs):
    folder.mkdir()
    for run in runs.recordings:
        at = np.searchsorted(run.source.times, run.time, side='right') - 1
        columns = {'time_s': run.time, 'J_eq_W': run.source.values[at, 0]}
        write_columns(folder / f'{run.name}.csv', columns | {CHANNEL_COLUMNS[c]: v for c, v in run.channels.items()})
    (folder / 'meta.json').write_text(json.dumps({'noise_std': dict(runs.noise_std)}))


def test_the_command_knows_parameters_better(tmp_path, capsys):
    write_runs(tmp_path / 'data', measured('', seconds=12.0))
    out, told, page = (tmp_path / name for name in ('next.csv', 'next.json', 'next.html'))
    words = ['next', str(tmp_path / 'data'), '--parameters', 'wire.lambda', 'beam.E', '--length', '12', '--tries', '8']
    assert main([*words, '--model', 'mas', '-o', str(out), '--json', str(told), '--report', str(page)]) == 0
    shown = capsys.readouterr().out
    assert 'wire.lambda' in shown and 'time above limits: none' in shown and 'temperature of wire 1 (T_1)' in shown
    source = read_input_file(out, Config(), False)
    assert source.times[-1] == 12.0 and source.values[-1, 0] == 0.0
    data = json.loads(told.read_text())
    assert data['kind'] == 'parameters' and data['information_nat']['designed'] > data['information_nat']['default'] > 0.0
    for parameter in data['parameters'].values():
        assert parameter['std_designed'] <= parameter['std_now'] * (1 + 1e-9)
    channels = data['further_channels']
    assert {channel['channel'] for channel in channels if channel['measured']} == set(POSE) and len(channels) == 9
    assert all(channel['information_nat'] > 0.0 for channel in channels)
    assert 'J_eq [W]' in page.read_text() and 'One sensor more' in page.read_text()


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['--between', 'gravity'], 'at least two'),
        (['--between', 'gravity', 'gravity'], 'different explanations'),
        (['--between', 'gravity', 'nothing', '--parameters', 'beam.E'], 'one of them'),
        (['--length', '1', '--parameters', 'beam.E'], 'at least four holds'),
        (['--max-power', '-1'], 'power = -1 W: expected'),
        (['--tries', '0'], 'tries'),
    ],
)
def test_mistakes_are_said_at_once(tmp_path, capsys, words, message):
    write_runs(tmp_path / 'data', measured('', seeds=(1,)))
    assert main(['next', str(tmp_path / 'data'), *words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_mistakes_that_need_the_fit(rivals):
    runs, plan = rivals
    with ThreadPoolExecutor(1) as pool, pytest.raises(UserError, match='gravity'):
        named_rivals(plan.hypotheses[1].fitted, ('gravitation', 'sensor_bias'), SearchContext(pool, Event()))
    with pytest.raises(UserError, match='beam.E'):
        parameter_combinations(plan.hypotheses[0], DesignRequest((), ('beam.X',), **SHORT))
    with pytest.raises(UserError, match='allow a higher temperature'):
        designed(rivals, DesignRequest(BETWEEN, temperature=290.0, **(SHORT | {'length': 4.0, 'budget': 4})))
    with pytest.raises(UserError, match='wire'):
        next_experiment(runs, config(system='wire'), DesignRequest(**SHORT))


@pytest.mark.slow
def test_without_names_the_leading_explanations_are_told_apart():
    """A weak weight of the plate, which a bias of the sensors explains nearly as well."""
    runs = measured(channels=('alpha',), seeds=(1,), g_y=-0.3)
    plan = next_experiment(runs, config(), DesignRequest(**SHORT))
    names = {hypothesis.name for hypothesis in plan.hypotheses}
    assert names & {'gravity', 'sensor_bias'} and plan.discriminates == (len(names) > 1)
    assert len(plan.expected) == len(names) * (len(names) - 1)


def diagnosis(*rounds, effects, given=(), system='module'):
    """What is read of a diagnosis: by round the effects before it, the accepted one and what explains as well."""
    made = [
        Some(base=Some(effects=(*given, *before)), accepted=Some(name=name, indistinguishable=indistinguishable))
        for before, name, indistinguishable in rounds
    ]
    found = Some(calibration=Some(config=Config(system=system)), selection_steps=made, effects=effects)
    return Some(**vars(found), deciding_steps=Diagnosis.deciding_steps.fget(found))


def test_a_diagnosis_offers_what_it_left_confounded():
    first = ((), 'gravity', ('sensor_bias',))
    second = (('gravity',), 'radiation', ('natural_convection',))
    sure = (('gravity',), 'radiation', ())
    assert confounded(diagnosis(first, effects=('gravity',))) == ('gravity', 'sensor_bias')
    found = diagnosis(first, second, effects=('gravity', 'radiation'), given=('driver_lag',))
    assert confounded(found) == ('gravity+radiation', 'gravity+natural_convection')
    assert confounded(diagnosis(first, sure, effects=('gravity', 'radiation'))) == ('gravity', 'sensor_bias')
    assert confounded(diagnosis(sure, effects=('radiation',))) == ()
    assert confounded(diagnosis(first, effects=('gravity',), system='wire')) == ()


def test_the_offered_command_is_one_that_next_takes():
    parser = argparse.ArgumentParser()
    verbs = parser.add_subparsers(dest='verb')
    diagnose.add_parser(verbs)
    next.add_parser(verbs)
    words = ['diagnose', 'two words.csv', 'more', '--config', 'robot.yaml', '--set', 'beam.E=2e9', '--noise', 'alpha=1e-3']
    in_motion, at_rest = (Some(differences=(Some(in_motion=said),)) for said in (True, False))
    command = diagnose.next_command(parser.parse_args(words), ('a+b', 'a+c'), in_motion)
    program, *rest = shlex.split(command)
    taken = parser.parse_args(rest)
    assert program == 'sma-sim' and taken.verb == 'next' and taken.between == ['a+b', 'a+c']
    assert [str(path) for path in taken.data] == ['two words.csv', 'more'] and str(taken.config) == 'robot.yaml'
    assert taken.words == ['beam.E=2e9'] and taken.noise == ['alpha=1e-3'] and str(taken.out) == 'next.csv'
    assert taken.in_motion and '--in-motion' not in diagnose.next_command(parser.parse_args(words), ('a', 'b'), at_rest)


def test_a_design_from_recordings_that_do_not_begin_at_rest_says_so(monkeypatch, rivals, tmp_path):
    runs, plan = rivals
    assert not plan.in_motion and BEGINS_IN_MOTION not in '\n'.join(next.plan_text(plan, ()))
    for name, found in (('hypotheses_for', plan.hypotheses), ('best_plan', plan), ('begin_in_motion', True)):
        monkeypatch.setattr(design, name, lambda *given, found=found: found)
    moving = next_experiment(runs, config(), DesignRequest(BETWEEN, **SHORT))
    assert moving.in_motion and plan_data(moving)['in_motion'] and [*next.plan_text(moving, ())][0] == BEGINS_IN_MOTION
    write_design_page(tmp_path / 'page.html', moving, hypothesis_curves(moving))
    assert BEGINS_IN_MOTION in (tmp_path / 'page.html').read_text()


def test_a_parameter_that_a_default_sequence_tells_better_is_named():
    def known(name, designed):
        return ParameterPrecision(name, '', True, 0.1, 0.05, designed)

    plan = Some(precision=(known('beam.E', 0.02), known('wire.c_V', 0.06)), gain=Some(designed=2.0, default=1.0))
    said = list(next.precision_text(plan, ('beam.E', 'wire.c_V')))
    assert said[-1].startswith('A default sequence would tell wire.c_V better')
    assert list(next.precision_text(plan, ('beam.E',)))[-1].startswith('information on what was asked for')
