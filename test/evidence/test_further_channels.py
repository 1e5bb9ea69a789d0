"""What one sensor more would tell: predictions, derivatives and information are those of the model itself."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from simulated_data import NOISE, config, dataset

from sma_sim import FitOptions, find_effects, predict
from sma_sim.evidence.estimation.calibrate import problem_for
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import RESISTIVITY_NAMES
from sma_sim.evidence.estimation.problem import linearize
from sma_sim.evidence.estimation.residuals import Nuisance
from sma_sim.evidence.experiment_design.further_channels import further_channels, sensed
from sma_sim.evidence.experiment_design.rival_fits import ModelHypothesis
from sma_sim.evidence.experiment_design.utilities import RivalPair
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.words.experiment_design import channel_data, channels_sentence

FREE = ('wire.lambda', 'beam.E')
PAIRS = (RivalPair(0, 1), RivalPair(1, 0))
RUNS = replace(dataset(config(), (1, 2), rate=5.0, channels=('alpha',)), noise_std={'alpha': NOISE['alpha'], 'T_1': 0.5})


@pytest.fixture(scope='module')
def pool():
    with ThreadPoolExecutor(2) as threads:
        yield threads


def hypothesis(name, given, noise_factor=1.0):
    """An explanation at the middle of its priors, as if it had been fitted there."""
    problem = problem_for(RUNS, given, FitOptions(free=FREE), 1).weighted(1.0 / noise_factor)
    nothing = np.zeros(0)
    fitted = FitResult(problem, np.zeros(len(problem.unknowns)), 0.0)
    return ModelHypothesis(name, fitted, 0.0, nothing, nothing, nothing, noise_factor)


def test_a_sensor_shows_what_the_model_predicts(pool):
    noise = {'alpha': NOISE['alpha'], 'T_1': 0.5}
    one = hypothesis('nothing', config(), noise_factor=2.0)
    found = sensed(one, noise, pool)
    for name, std in noise.items():
        shown = [predict(config(), run, Nuisance(start=(0.5, 0.5)))[name] / (2.0 * std) for run in RUNS.recordings]
        np.testing.assert_allclose(found[name].prediction.centres[0], np.concatenate(shown), rtol=1e-3, atol=0.05)
    assert found['alpha'].root.shape == (3, 3)  # two parameters and the delay


def test_a_second_sensor_doubles_the_information(pool):
    """As computed from the whole problem: the recordings once, and twice."""
    one = hypothesis('nothing', config())
    found = {c.channel: c for c in further_channels([one], RUNS.noise_std, (), np.eye(3)[:2], pool)}
    problem, z = one.fitted.problem, one.fitted.z
    variances = []
    for times in (1.0, 2.0):
        hessian = np.eye(len(z))
        for run in linearize(problem.weighted(np.sqrt(times)), z, pool, np.full(len(z), 1e-3), central=True):
            flat = run.jacobian.reshape(len(run.indices), -1)
            hessian[np.ix_(run.indices, run.indices)] += flat @ flat.T
        variances.append(np.linalg.slogdet(np.linalg.inv(hessian)[:2, :2])[1])
    assert found['alpha'].information == pytest.approx(0.5 * (variances[0] - variances[1]), rel=0.05)
    assert [name for name, channel in found.items() if channel.measured] == ['alpha']
    assert found['T_1'].noise_std == 0.5 and found['T_2'].noise_std == config().parameters['check.noise_T_2']
    assert 'would tell most of these parameters' in channels_sentence(tuple(found.values()))


def test_a_resistance_tells_what_its_resistivities_leave(pool):
    """As computed from the whole problem, in which they are unknown too; more where they were known."""
    one = hypothesis('nothing', config())
    found = {c.channel: c for c in further_channels([one], RUNS.noise_std, (), np.eye(3)[:2], pool)}
    std = config().parameters['check.noise_R_1']
    seen = replace(
        RUNS,
        recordings=tuple(
            replace(run, channels={**run.channels, 'R_1': predict(config(), run)['R_1']}) for run in RUNS.recordings
        ),
        noise_std=RUNS.noise_std | {'R_1': std},
    )
    gains = []
    for free in ((*FREE, *RESISTIVITY_NAMES), FREE):
        problem = problem_for(seen, config(), FitOptions(free=free), 1)
        z, logs = np.zeros(len(problem.unknowns)), []
        parts = linearize(problem, z, pool, np.full(len(z), 1e-3), central=True)
        for channels in (('alpha',), ('alpha', 'R_1')):
            hessian = np.eye(len(z))
            for run, part in zip(problem.runs, parts, strict=True):
                rows = [run.channels.index(name) for name in channels]
                flat = part.jacobian[:, rows].reshape(len(part.indices), -1)
                hessian[np.ix_(part.indices, part.indices)] += flat @ flat.T
            logs.append(np.linalg.slogdet(np.linalg.inv(hessian)[:2, :2])[1])
        gains.append(0.5 * (logs[0] - logs[1]))
    assert found['R_1'].information == pytest.approx(gains[0], rel=0.05)
    assert gains[0] < 0.9 * gains[1] and not found['R_1'].measured


def test_explanations_that_predict_the_same_stay_open(pool):
    same = [hypothesis('one', config()), hypothesis('other', config())]
    found = further_channels(same, RUNS.noise_std, PAIRS, np.zeros((0, 0)), pool)
    assert len(found) == 9 and not any(channel.decides for channel in found)
    assert channels_sentence(found).startswith('No further channel along these recordings separates all explanations')
    assert channels_sentence(()) == ''


def test_what_differs_in_temperature_is_told_by_its_sensor(pool):
    """Two explanations of which one heats the wires more: their order is that of the utility."""
    warm = with_effect(config(), find_effects()['radiation'], {'emissivity': 0.9})
    both = [hypothesis('nothing', config()), hypothesis('radiation', warm)]
    found = further_channels(both, RUNS.noise_std, PAIRS, np.zeros((0, 0)), pool)
    assert [c.utility for c in found] == sorted((c.utility for c in found), reverse=True)
    told = {channel.channel: channel for channel in found}
    noisy = further_channels(both, RUNS.noise_std | {'T_1': 50.0}, PAIRS, np.zeros((0, 0)), pool)
    blunt = {channel.channel: channel for channel in noisy}
    assert told['T_1'].least > blunt['T_1'].least and told['F_1'].least == pytest.approx(blunt['F_1'].least, rel=1e-6)
    data = channel_data(found[0])
    assert {(ratio['true'], ratio['rival']) for ratio in data['expected_log_evidence_ratio']} == {
        ('nothing', 'radiation'),
        ('radiation', 'nothing'),
    }
    assert found[0].decides and 'would separate the explanations' in channels_sentence(found)
