"""What each recording says of every parameter: right by closed forms, by chance and for a room that was warmer once."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest
from simulated_data import command, config, dataset, recording, scaled

from sma_sim import FitOptions, calibrate
from sma_sim.evidence.estimation.calibrate import problem_for
from sma_sim.evidence.estimation.homogeneity import cochran_p
from sma_sim.evidence.estimation.problem import linearize
from sma_sim.evidence.estimation.run_estimates import (
    Optimum,
    ParameterByRun,
    RunEstimate,
    cochran,
    disagreement,
    estimates_by_run,
    reduced_run,
    score_overdispersion,
)
from sma_sim.evidence.estimation.uncertainty import GAUSS_95
from sma_sim.report.html.parameters import by_run_blocks
from sma_sim.words.fit_data import by_run_data
from sma_sim.words.fit_remarks import agreement_sentence, remarks_on

FREE = ('wire.sigma_MW0', 'wire.lambda', 'beam.E')
WARM = {'noise': 1.0, 'rate': 10.0, 'channels': ('U_y', 'alpha')}
TRUTH = scaled(config(), wire__lambda=1.05, beam__E=0.96)


@pytest.fixture(scope='module')
def linear():
    """Three recordings at the optimum of data without noise."""
    runs = dataset(config(), (1, 2, 3), rate=5.0, channels=('U_y', 'alpha'))
    problem = problem_for(runs, config(), FitOptions(free=FREE), 1)
    z = np.zeros(len(problem.unknowns))
    with ThreadPoolExecutor(2) as pool:
        return problem, z, linearize(problem, z, pool)


def refitted(z, linear, residuals):
    """The optimum and the recordings there, when the residuals at z are these: all is linear."""
    hessian, gradient = np.eye(len(z)), z.copy()
    for run, rows in zip(linear, residuals, strict=True):
        flat = run.jacobian.reshape(len(run.indices), -1)
        hessian[np.ix_(run.indices, run.indices)] += flat @ flat.T
        gradient[run.indices] += flat @ rows.ravel()
    step = -np.linalg.solve(hessian, gradient)
    moved = [
        replace(run, residuals=rows + np.tensordot(step[run.indices], run.jacobian, 1))
        for run, rows in zip(linear, residuals, strict=True)
    ]
    return z + step, moved


def estimates_of(problem, z, linear):
    return estimates_by_run(
        problem, z, [reduced_run(Optimum.of(problem, z), *pair) for pair in zip(problem.runs, linear, strict=False)]
    )


def test_equal_recordings_agree_at_the_nominal_level(linear):
    problem, z, runs = linear
    random, p, agreeing = np.random.default_rng(0), [], 0
    for _ in range(300):
        found = estimates_of(problem, *refitted(z, runs, [random.normal(size=run.residuals.shape) for run in runs]))
        p.append([parameter.p for parameter in found])
        agreeing += disagreement(found) is None
    assert agreeing >= 290  # 99 % but for chance
    for column in np.array(p).T:
        assert kstest(column, 'uniform').statistic < 0.14 and 0.005 < np.mean(column < 0.05) < 0.09


def test_a_recording_with_another_value_is_found_with_it(linear):
    problem, z, runs = linear
    random, k, shift = np.random.default_rng(1), FREE.index('wire.lambda'), 0.01
    residuals = [random.normal(size=run.residuals.shape) for run in runs]
    residuals[1] -= shift * runs[1].jacobian[k]
    found = estimates_of(problem, *refitted(z, runs, residuals))
    worst = disagreement(found)
    assert worst is not None and (worst.name, worst.outlier.run) == ('wire.lambda', 'run2')
    others = np.mean([run.value for run in worst.runs if run.run != 'run2'])
    assert worst.outlier.value / others == pytest.approx(np.exp(problem.free[k].scale * shift), rel=2e-3)
    assert worst.outlier.deviation > 5.0 and by_run_data(found)['recording'] == 'run2'
    assert 'wire.lambda' in agreement_sentence(found) and 'most of all run2' in agreement_sentence(found)
    assert len(by_run_blocks(found)) == 6


def test_noise_beyond_the_stated_one_is_no_disagreement(linear):
    """Three times the noise, and slow: what would be wildly significant is not."""
    problem, z, runs = linear
    random, smooth, agreeing = np.random.default_rng(2), np.ones(8) / np.sqrt(8), 0
    for _ in range(40):
        white = [3.0 * random.normal(size=run.residuals.shape) for run in runs]
        slow = [np.array([np.convolve(row, smooth, 'same') for row in rows]) for rows in white]
        found = estimates_of(problem, *refitted(z, runs, slow))
        agreeing += disagreement(found) is None
    assert agreeing >= 38
    assert score_overdispersion(problem.runs[0], slow[0], 0, robust=False) > 9.0 * 3.0
    assert 1.0 <= score_overdispersion(problem.runs[0], white[0] / 3.0, 0, robust=False) < 2.0


def test_independent_estimates_have_cochrans_q():
    values, std = np.array([1.0, 1.4, 0.7]), np.array([0.1, 0.2, 0.3])
    weight = std**-2.0
    Q = float(weight @ (values - weight @ values / weight.sum()) ** 2)
    assert cochran(values, np.diag(std**2)) == pytest.approx(Q)
    assert cochran(values, np.diag(std**2) + 7.0) == pytest.approx(Q)  # what all share does not count
    assert cochran_p([(v, v - GAUSS_95 * s, v + GAUSS_95 * s) for v, s in zip(values, std, strict=True)]) < 0.2
    assert cochran(values[:1], np.eye(1)) == 0.0


def test_what_a_recording_does_not_see_is_not_compared(linear):
    problem, z, runs = linear
    blind = [replace(run, jacobian=run.jacobian * (np.arange(len(run.indices)) != 1)[:, None, None]) for run in runs[:2]]
    found = estimates_of(problem, z, [*blind, runs[2]])[1]
    assert [run.seen for run in found.runs] == [False, False, True] and found.dof == 0 and np.isnan(found.p)
    assert by_run_data([found])['parameters']['wire.lambda']['p'] is None
    assert estimates_of(problem, z, runs[:1]) == () and agreement_sentence(()) == '' and by_run_blocks(()) == []


@pytest.mark.parametrize(('warmer', 'odd'), [(0.0, None), (2.0, 'run3')])
def test_a_room_that_was_warmer_once_is_found(warmer, odd):
    """Written nowhere: the third recording's T_E is that of the others."""
    runs, source = dataset(TRUTH, (1, 2), **WARM), command(3)
    warm = replace(source, values=source.values + np.array([0.0, warmer]))
    third = replace(recording(TRUTH, warm, seed=3, **WARM), source=source)
    found = calibrate(
        replace(runs, recordings=(*runs.recordings, third)), config(), FitOptions(free=FREE, kinetics='hybrid', starts=1)
    )
    worst = disagreement(found.by_run)
    assert (worst.outlier.run if worst else None) == odd
    said = [line for line in remarks_on(found) if line.startswith('The recordings')]
    assert said == [agreement_sentence(found.by_run)] and ('disagree' in said[0]) == (odd is not None)


def test_spread_of_two_estimates_is_their_difference_over_its_standard_deviation():
    """Cochran's Q of two is (a - b)^2 / var(a - b), whatever their correlation; of one it is nothing."""
    for common in (0.0, 0.5):
        covariance = np.array([[1.0, common], [common, 3.0]])
        assert cochran(np.array([1.0, 4.0]), covariance) == pytest.approx(9.0 / (4.0 - 2.0 * common))
    assert cochran(np.array([1.0]), np.eye(1)) == 0.0


def test_how_many_parameters_disagree_is_counted_over_all_that_were_tested():
    """A chance of 1 % over all: of three, 0.33 % each; one that could not be compared does not count."""

    def by_run(name, p, dof=1):
        runs = tuple(RunEstimate(f'run{k}', 1.0 + k, 0.1, 3.0 * k, True, 1.0, 0.1) for k in range(2))
        return ParameterByRun(name, 'W', 1.5, runs, 9.0, dof, p)

    found = [by_run('a', 0.0005), by_run('b', 0.003), by_run('c', 0.004), by_run('d', float('nan'), 0)]
    assert disagreement(found) is found[0] and 'disagree on a and 1 more (' in agreement_sentence(found)
    assert 'most of all run1 (2 +- 0.1 W, all together 1.5)' in agreement_sentence(found)
    assert 'disagree on a (' in agreement_sentence([found[0], *found[2:]] + [by_run('e', 0.9)])
    assert 'agree on every parameter (least on c: p = 0.004)' in agreement_sentence([found[2], by_run('e', 0.9), found[2]])
    assert agreement_sentence([found[3]]) == '' and disagreement([found[3]]) is None
