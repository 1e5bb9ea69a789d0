"""What a fit says of its parameters, against linear algebra done another way: all is linear, so that it is exact."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2, norm

from sma_sim.evidence.estimation.calibrate import errors_by_channel, limits_reached
from sma_sim.evidence.estimation.chi_square import chi_square_tail
from sma_sim.evidence.estimation.free_parameters import BOUND_STDS, MAX_PRIOR_STDS, FreeParameter
from sma_sim.evidence.estimation.homogeneity import cochran_p, sentences
from sma_sim.evidence.estimation.overdispersion import overdispersion
from sma_sim.evidence.estimation.plausibility import (
    RANGE_TOLERANCE,
    implausible_parameters,
    realistic_range,
    reported_covariance,
)
from sma_sim.evidence.estimation.problem import LinearizedRun
from sma_sim.evidence.estimation.run_estimates import (
    WEAK,
    Optimum,
    OwnValues,
    ReducedRun,
    cochran,
    own_values,
    parameter_by_run,
    reduced_run,
    score_overdispersion,
)
from sma_sim.evidence.estimation.uncertainty import (
    GAUSS_95,
    MIN_BLOCKS,
    Interval,
    autocorrelation_time,
    correlation_times,
    delay_interval,
    direction,
    information_of,
    interval,
    long_run,
    uncertainty,
)
from sma_sim.model.config import Config
from sma_sim.model.parameters import Parameter
from sma_sim.solver.beginning import AT_REST
from sma_sim.words.fit_remarks import delay_sentence, limit_sentences, p_words

A = FreeParameter('a', 2.0, 0.5, -5.0, 5.0, True, 'Pa')
B = FreeParameter('b', 0.0, 4.0, -5.0, 5.0, False, '-')
DELAY = FreeParameter('delay', 0.0, 0.05, -10.0, 100.0, False, 's')
OWN = FreeParameter('start', 0.5, 0.5, -1.0, 1.0, False, '-')
SAMPLES = 400


def run_of(name, channels=('alpha', 'F_1')):
    weight = np.ones((len(channels), SAMPLES))
    return SimpleNamespace(
        name=name, channels=channels, weight=weight, samples=weight.size, ambient_std=0.0, beginning_std=AT_REST
    )


def problem_of(runs=2, delay=None, robust=False):
    """Two parameters, the delay unless it is known, and two unknowns of each run."""
    shared = (A, B) if delay is not None else (A, B, DELAY)
    unknowns = (*shared, *(OWN,) * (2 * runs))
    limits = (np.array([one.low for one in unknowns]), np.array([one.high for one in unknowns]))
    shared_at = range(len(shared))
    indices = [np.array([*shared_at, len(shared) + 2 * k, len(shared) + 2 * k + 1]) for k in range(runs)]
    return SimpleNamespace(
        free=(A, B),
        shared=shared,
        unknowns=unknowns,
        delay=delay,
        robust=robust,
        limits=lambda: limits,
        indices=lambda: indices,
        runs=tuple(run_of(f'run{k}') for k in range(runs)),
        samples=runs * 2 * SAMPLES,
    )


def linear_of(problem, seed=0, size=0.2):
    """Each run at z: random sensitivities, white residuals."""
    random, found = np.random.default_rng(seed), []
    for run, indices in zip(problem.runs, problem.indices(), strict=True):
        jacobian = size * random.normal(size=(len(indices), *run.weight.shape))
        found.append(LinearizedRun(indices, random.normal(size=run.weight.shape), jacobian))
    return found


def informations_of(problem, linear):
    return [information_of(data, run, problem.robust) for data, run in zip(problem.runs, linear, strict=True)]


def rows_of(linear, count):
    """The sensitivities of all samples to all unknowns."""
    return np.vstack([run.jacobian.reshape(len(run.indices), -1).T @ np.eye(count)[run.indices] for run in linear])


@pytest.mark.parametrize(
    ('delay', 'std', 'said', 'limits'),
    [
        (-0.5, 15e3, 'not determined by these data (between -500 ms and 5 s)', []),
        (-0.5, 0.5, '-500 ms (-500 ms to 480 ms)', ['delay = -0.5 s ended at a limit']),
        (1.2, 0.1, '1.2 s (1 s to 1.4 s)', []),
        (0.3, 0.2, '300 ms (-92 ms to 692 ms): the interval holds 0, no finding', []),
        (0.02, 0.001, '20 ms (18 ms to 22 ms), within half a sampling interval (100 ms): no finding', []),
    ],
)
def test_a_delay_that_data_do_not_determine_is_said_to_be_so(delay, std, said, limits):
    """An interval ends where the fit could go, and of one that is as wide as that nothing is known."""
    known = delay_interval(DELAY, DELAY.coordinate(delay), std / DELAY.scale)
    assert known.seen == (std < 1.0) and known.std == pytest.approx(std)
    z, reached = np.array([DELAY.coordinate(delay)]), ()
    if delay == -0.5:
        reached = limits_reached(SimpleNamespace(config=Config(), shared=(DELAY,), runs=()), z, ())
    found = SimpleNamespace(
        delay=delay,
        sampling_interval=0.1,
        limits=reached,
        at_bound=tuple(one.name for one in reached),
        uncertainty=SimpleNamespace(delay=known),
    )
    assert delay_sentence(found) == f'delay of the measurement: {said}'
    assert [one.split(' of the fit')[0] for one in limit_sentences(found)] == limits


@pytest.mark.parametrize('delay', [None, 0.1])
def test_white_residuals_give_the_intervals_of_linear_regression(delay):
    problem = problem_of(delay=delay)
    n, z = len(problem.unknowns), np.linspace(-0.4, 0.4, len(problem.unknowns))
    linear = [replace(run, residuals=0.5 * run.residuals) for run in linear_of(problem)]
    prior = np.where(np.arange(n) < 2, BOUND_STDS**-1.0, 1.0)
    covariance = np.linalg.pinv(np.vstack([rows_of(linear, n), np.diag(prior)]))
    covariance = covariance @ covariance.T
    found = uncertainty(problem, z, informations_of(problem, linear))
    std = np.sqrt(np.diag(covariance))
    for k, (one, free) in enumerate(zip(found.intervals, problem.free, strict=True)):
        assert one.seen and one.value == free.value(z[k]) and one.std == pytest.approx(free.scale * std[k])
        reach = norm.ppf(0.975) * std[k]
        assert (one.low, one.high) == pytest.approx((free.value(z[k] - reach), free.value(z[k] + reach)))
    assert found.correlation[0][0] == pytest.approx(1.0) == pytest.approx(found.correlation[1][1])
    assert found.correlation[0][1] == pytest.approx(covariance[0, 1] / (std[0] * std[1])) == found.correlation[1][0]
    assert (found.delay is None) == (delay is not None)
    assert np.isnan(found.delay_std) if delay is not None else found.delay_std == pytest.approx(0.05 * std[2])
    assert not found.unseen and [set(one.weights) for one in found.directions] == [{'a', 'b'}] * 2
    matrix = np.linalg.inv(covariance[:2, :2])
    for one in found.directions:
        vector = np.array([one.weights['a'], one.weights['b']])
        assert np.linalg.norm(vector) == pytest.approx(1.0) and vector[np.argmax(np.abs(vector))] > 0.0
        assert matrix @ vector == pytest.approx(vector / one.std**2)
    assert found.directions[0].std < found.directions[1].std


def test_correlated_residuals_widen_intervals_as_their_scores_say():
    """The sandwich with the larger of the long-run covariance of the scores, of the slowest channel, and of what white
    scores would be that scatter as each channel's residuals do."""
    problem = problem_of()
    n, z = len(problem.unknowns), np.zeros(len(problem.unknowns))
    slow = np.sin(np.linspace(0.0, 20.0, SAMPLES))
    linear = [
        LinearizedRun(run.indices, np.array([3.0 * slow, run.residuals[1]]), run.jacobian + slow)
        for run in linear_of(problem)
    ]
    times = correlation_times(informations_of(problem, linear))
    assert times['alpha'] == pytest.approx(autocorrelation_time(slow)) and times['F_1'] < 2.0 < times['alpha']
    prior = np.diag(np.where(np.arange(n) < 2, BOUND_STDS**-2.0, 1.0))
    rows, middle, scattered = rows_of(linear, n), prior.copy(), prior.copy()
    for run in linear:
        at = np.ix_(run.indices, run.indices)
        middle[at] += long_run(information_of(problem.runs[0], run, False).scores, times['alpha'])
        for row, sensitivity in zip(run.residuals, run.jacobian.transpose(1, 0, 2), strict=True):
            left = 1.0 - len(run.indices) / (2 * SAMPLES)
            factor = max(1.0, float(row @ row) / (SAMPLES * left) * autocorrelation_time(row))
            scattered[at] += factor * sensitivity @ sensitivity.T
    inverse = np.linalg.inv(rows.T @ rows + prior)
    std = np.sqrt(np.maximum(*(np.diag(inverse @ each @ inverse) for each in (middle, scattered))))
    found = uncertainty(problem, z, informations_of(problem, linear))
    assert [one.std for one in found.intervals] == pytest.approx(list(std[:2] * [0.5, 4.0]))
    assert (std[:2] > 1.5 * np.sqrt(np.diag(inverse)[:2])).all() and found.correlation_time == times


def test_what_data_do_not_show_is_said_and_has_the_width_of_the_fit():
    problem = problem_of()
    linear = linear_of(problem)
    for run in linear:
        run.jacobian[1] = 0.0
    found = uncertainty(problem, np.zeros(7), informations_of(problem, linear))
    assert [one.seen for one in found.intervals] == [True, False] and found.unseen == ('b has no visible effect',)
    assert (found.intervals[1].low, found.intervals[1].high) == (-20.0, 20.0)
    assert found.directions[1].std == pytest.approx(BOUND_STDS) and found.directions[1].weights['b'] == pytest.approx(1.0)


def test_blocks_of_scores_are_sums_over_neighbours():
    """Bartlett's kernel: the sum over all lags shorter than a block, weighted by how much two blocks overlap."""
    random = np.random.default_rng(4)
    linear = LinearizedRun(np.arange(2), random.normal(size=(2, 300)), random.normal(size=(2, 2, 300)))
    scores = np.einsum('uck,ck->uk', linear.jacobian, linear.residuals)
    for time, block in ((1.0, 10), (5.0, 20), (50.0, 300 // MIN_BLOCKS)):
        expected = scores @ scores.T
        for lag in range(1, block):
            product = scores[:, lag:] @ scores[:, :-lag].T
            expected = expected + (1.0 - lag / block) * (product + product.T)
        assert long_run(scores, time) == pytest.approx(expected)
    outlier = LinearizedRun(np.arange(2), np.full((1, 300), 6.0), linear.jacobian[:, :1])
    capped = LinearizedRun(np.arange(2), np.full((1, 300), 3.0), linear.jacobian[:, :1])
    data = run_of('run', ('alpha',))
    found, expected = information_of(data, outlier, True), information_of(data, capped, False)
    assert found.scores == pytest.approx(expected.scores)  # as Huber's slope has it


def test_a_long_recording_keeps_few_scores_and_says_the_same():
    """Neighbours are added up, of white and of correlated residuals alike."""
    random, count = np.random.default_rng(6), 40_000
    white = random.normal(size=(1, count))
    slow = np.cumsum(white, axis=1) - np.roll(np.cumsum(white, axis=1), 15, axis=1)  # sums of 15: correlated over them
    jacobian = np.array([np.ones((1, count)), np.sin(np.linspace(0.0, 30.0, count))[None]])
    data = SimpleNamespace(channels=('alpha',), weight=np.ones((1, count)), samples=count)
    for residuals, time in ((white, 1.0), (slow[:, 15:], 15.0)):
        linear = LinearizedRun(np.arange(2), residuals, jacobian[..., : residuals.shape[1]])
        found = information_of(data, linear, False)
        exact = np.einsum('uck,ck->uk', linear.jacobian, residuals)
        assert found.together > 20 and found.scores.shape[1] < 1000
        assert found.scores.sum(axis=1) == pytest.approx(exact.sum(axis=1))
        kept, whole = long_run(found.scores, time, found.together), long_run(exact, time)
        assert np.diag(kept) == pytest.approx(np.diag(whole), rel=0.15)


def test_correlation_ends_with_the_first_pair_that_is_noise():
    """As Geyer's sum: by hand from the autocovariance, for even and odd counts."""
    random = np.random.default_rng(5)
    for count in (200, 201, 5):
        series = np.cumsum(random.normal(size=count)) * np.exp(-np.arange(count) / 80.0) if count > 5 else np.ones(5)
        covariance = np.array([series[lag:] @ series[: count - lag] for lag in range(count)])
        rho, total, lag = covariance / covariance[0], 1.0, 1
        while lag + 1 < count and rho[lag] + rho[lag + 1] >= 3.0 * np.sqrt(2.0 / count):
            total, lag = total + 2.0 * (rho[lag] + rho[lag + 1]), lag + 2
        assert autocorrelation_time(series) == pytest.approx(total)
    assert autocorrelation_time(np.zeros(10)) == 1.0


def test_an_interval_ends_where_knowledge_does():
    edge = BOUND_STDS / GAUSS_95
    assert interval(A, 0.0, 0.99 * edge, True).seen and not interval(A, 0.0, 1.01 * edge, True).seen
    assert not interval(A, 0.0, 0.1, False).seen and interval(B, 1.0, 0.25, True).std == 1.0
    assert direction((A, B), np.array([0.6, -0.8]), 4.0).weights == {'a': -0.6, 'b': 0.8}
    assert direction((A, B), np.array([0.6, -0.8]), 4.0).std == pytest.approx(0.5)


def marginal(H, g, s, own_prior, own_z):
    """Information and gradient of the first `s` unknowns where the others are at their best, by the whole inverse."""
    whole = H + np.diag(np.concatenate([np.zeros(s), own_prior]))
    pull = g + np.concatenate([np.zeros(s), own_prior * own_z])
    covariance = np.linalg.inv(whole + 1e-9 * np.eye(len(H)))
    information = np.linalg.inv(covariance[:s, :s])
    return information, information @ (covariance @ pull)[:s]


def test_a_recordings_own_unknowns_are_eliminated():
    """What is left is what the whole inverse says; an unknown on its bound stays there; both are over the same noise."""
    problem = problem_of(runs=1)
    (linear,), z = linear_of(problem, seed=6), np.array([0.3, -0.2, 0.1, 0.4, -0.3])
    flat = linear.jacobian.reshape(5, -1)
    H, g = flat @ flat.T, flat @ linear.residuals.ravel()
    for at_bound in (False, True):
        at = np.append(z[:4], 1.0 if at_bound else z[4])
        keep = 4 if at_bound else 5
        information, gradient = marginal(H[:keep, :keep], g[:keep], 3, np.ones(keep - 3), at[3:keep])
        prior = np.diag([WEAK] * 3 + [1.0] * (keep - 3))
        step = np.zeros(5)
        step[:keep] = -np.linalg.solve(H[:keep, :keep] + prior, g[:keep] + np.append(np.zeros(3), at[3:keep]))
        left = linear.residuals + np.tensordot(step, linear.jacobian, 1)
        noise = score_overdispersion(problem.runs[0], left, keep, False)
        found = reduced_run(Optimum.of(problem, at), problem.runs[0], linear)
        assert found.information == pytest.approx(information / noise, rel=1e-5)
        assert found.gradient == pytest.approx(gradient / noise, rel=1e-5)


def test_a_recording_alone_is_a_gauss_newton_step_under_the_priors():
    random = np.random.default_rng(7)
    rows, residuals, z = random.normal(size=(30, 3)), random.normal(size=30), np.array([0.5, -0.3, 0.2])
    run = ReducedRun('run', rows.T @ rows, rows.T @ residuals)
    value, std = run.alone(np.append(z, 9.0))
    best = np.linalg.lstsq(np.vstack([rows, np.eye(3)]), -np.concatenate([residuals, z]), rcond=None)[0]
    assert value == pytest.approx(z + best)
    assert std == pytest.approx(np.sqrt(np.diag(np.linalg.inv(rows.T @ rows + np.eye(3)))))


@pytest.mark.parametrize('k', [0, 1, 2])
def test_a_parameter_of_each_recordings_own_is_found_with_all_else_shared(k):
    """As least squares over all unknowns at once say: one value by recording, the others common."""
    random, z = np.random.default_rng(8), np.array([0.4, -0.1, 0.2])
    rows, residuals = random.normal(size=(3, 20, 3)) * [[[1.0]], [[2.0]], [[0.5]]], random.normal(size=(3, 20))
    runs = [ReducedRun(str(r), rows[r].T @ rows[r], rows[r].T @ residuals[r]) for r in range(3)]
    others = [j for j in range(3) if j != k]
    whole, target = np.zeros((60 + 5, 5)), np.zeros(65)
    for r in range(3):
        whole[20 * r : 20 * r + 20, r], whole[20 * r : 20 * r + 20, 3:] = rows[r][:, k], rows[r][:, others]
        target[20 * r : 20 * r + 20] = -residuals[r]
    whole[60:] = np.sqrt(WEAK) * np.eye(5)
    target[63:] = -np.sqrt(WEAK) * z[others]
    best = np.linalg.lstsq(whole, target, rcond=None)[0]
    found = own_values(k, z, runs)
    assert found.shifts == pytest.approx(best[:3]) and found.covariance == pytest.approx(
        np.linalg.inv(whole.T @ whole)[:3, :3]
    )
    assert found.information == pytest.approx([run.information[k, k] + WEAK for run in runs])


def test_differences_from_the_mean_have_their_own_errors():
    """Of independent estimates whose weights are their information: var(x_i - mean) = var_i - 1/sum."""
    information = np.array([4.0, 1.0, 0.25])
    own = OwnValues(np.array([1.0, 2.0, 4.0]), np.diag(1.0 / information), information)
    away, std = own.differences()
    assert away == pytest.approx(own.shifts - (information @ own.shifts) / information.sum())
    assert std == pytest.approx(np.sqrt(1.0 / information - 1.0 / information.sum()))


def test_recordings_that_see_a_parameter_are_compared_by_cochrans_q():
    information = np.array([25.0, 16.0, 1e-3])
    own = OwnValues(np.array([0.5, -0.2, 0.0]), np.diag(1.0 / information), information)
    found = parameter_by_run(A, 0.1, ('x', 'y', 'z'), own, ((1.0, 0.1), (2.0, 0.2), (3.0, 0.3)))
    away, std = own.differences()
    Q = 0.7**2 / (1 / 25 + 1 / 16)
    assert (found.Q, found.dof, found.value) == (pytest.approx(Q), 1, A.value(0.1))
    assert found.p == pytest.approx(chi2.sf(Q, 1)) and [run.seen for run in found.runs] == [True, True, False]
    assert [run.deviation for run in found.runs] == pytest.approx([away[0] / std[0], away[1] / std[1], 0.0])
    assert [run.value for run in found.runs] == pytest.approx([A.value(0.1 + a) for a in away])
    assert [(run.value_alone, run.std_alone) for run in found.runs] == [(1.0, 0.1), (2.0, 0.2), (3.0, 0.3)]
    assert found.outlier.run == 'x' and p_words(0.012345) == 'p = 0.012' and p_words(1e-17) == 'p < 1e-16'


def test_estimates_that_agree_have_no_spread():
    correlated = np.array([[1.0, 0.3, 0.1], [0.3, 2.0, 0.2], [0.1, 0.2, 0.5]])
    assert cochran(np.full(3, 7.0), correlated) == pytest.approx(0.0, abs=1e-12)
    assert cochran(np.array([1.0, 1.1]), np.diag([1.0, 3.0])) == pytest.approx(0.01 / 4.0)


def test_chi_square_tails_are_those_of_scipy():
    for freedom in (1, 2, 7):
        assert chi_square_tail(3.7, freedom) == pytest.approx(chi2.sf(3.7, freedom))
    assert chi_square_tail(-1e-12, 3) == 1.0 and np.isnan(chi_square_tail(1.0, 0))


def test_values_with_intervals_are_compared_by_cochrans_q():
    values = [(1.0, 0.8, 1.2), (1.5, 1.1, 1.9), (0.9, 0.3, 1.5)]
    std = np.array([0.4, 0.8, 1.2]) / (2.0 * GAUSS_95)
    x, weight = np.array([1.0, 1.5, 0.9]), std**-2.0
    Q = (weight * (x - np.average(x, weights=weight)) ** 2).sum()
    assert cochran_p(values) == pytest.approx(chi2.sf(Q, 2))


def test_slopes_are_said_of_runs_at_different_temperatures():
    def run(T, level):
        return SimpleNamespace(name=f'at{T}', temperature=T, sigma_MW=(level, 0.0, 0.0), dsigma=(1e7, 0.0, 0.0))

    apart = sentences([run(300.0, 1e8), run(301.0, 1e8), run(311.0, 1.5e8)], 0.5, 0.001)
    assert 'does not fit' in apart[0] and 'rises by 5 MPa/K from 301 to 311 K:' in apart[1] and 'fits all' in apart[1]
    near = sentences([run(300.0, 1e8), run(301.0, 1.1e8)], 0.001, 0.5)
    assert 'rises' not in near[1] and 'does not fit all' in near[1] and 'one dsigma fits all' in near[0]


def test_errors_of_a_channel_count_by_samples():
    runs = [run_of('x'), run_of('y', ('alpha',))]
    runs[0].weight[0, 100:] = 0.0
    runs[0].weight[1] = 0.0
    fits = [SimpleNamespace(channel_errors={'alpha': 3.0}), SimpleNamespace(channel_errors={'alpha': 1.0})]
    found = errors_by_channel(SimpleNamespace(runs=runs), fits)
    assert found == {'alpha': pytest.approx(np.sqrt((100 * 9.0 + 400) / 500))}


def test_overdispersion_is_size_times_the_root_of_the_correlation_time(monkeypatch):
    problem = problem_of(runs=1)
    slow, white = 3.0 * np.sin(np.linspace(0.0, 20.0, SAMPLES)), (-1.0) ** np.arange(SAMPLES)
    for shown, expected in (
        (np.array([slow, slow]), np.sqrt((slow**2).mean() * autocorrelation_time(slow))),
        (1e-3 * np.array([slow, slow]), np.sqrt(autocorrelation_time(slow))),  # as if of the size of the noise
        (1e-3 * np.array([white, white]), 1.0),
        (None, np.inf),
    ):
        monkeypatch.setattr('sma_sim.evidence.estimation.overdispersion.residuals_at', lambda *_, s=shown: [s])
        assert overdispersion(problem, np.zeros(5), None) == pytest.approx(expected)


def test_scatter_counts_by_channel_and_robustly():
    """The channel that scatters most; samples that are missing do not count; an outlier only as far as Huber has it."""
    run = run_of('x')
    run.weight[1, ::2] = 0.0
    run.samples = int(np.count_nonzero(run.weight))
    white = np.random.default_rng(9).normal(size=(2, SAMPLES)) * (run.weight > 0)
    white[1] *= 2.0
    expected = (white[1] ** 2).sum() / 200 * autocorrelation_time(white[1])
    assert score_overdispersion(run, white, 0, False) == pytest.approx(max(1.0, expected))
    spoilt = white.copy()
    spoilt[0, 7] = 300.0
    weighted = spoilt * np.minimum(1.0, 3.0 / np.maximum(np.abs(spoilt), 1e-9)) ** 0.5
    rows = [(row @ row) / n * autocorrelation_time(row) for row, n in zip(weighted, (400, 200), strict=True)]
    assert score_overdispersion(run, spoilt, 0, True) == pytest.approx(max(rows))


def test_what_data_do_not_see_has_no_covariance_to_speak_of():
    known = [Interval('a', 2.0, 0.1, 1.8, 2.2, True, True, 'Pa'), Interval('b', 0.0, 0.1, -1.0, 1.0, False, False, '-')]
    found = reported_covariance((A, B), SimpleNamespace(intervals=known, correlation=((1.0, 0.5), (0.5, 1.0))))
    assert found[0, 0] == pytest.approx((0.1 / 0.5) ** 2) and found[1, 1] == pytest.approx((1e3 * BOUND_STDS) ** 2)
    assert found[0, 1] == pytest.approx(0.5 * 0.2 * 1e3 * BOUND_STDS) == found[1, 0]


@pytest.mark.parametrize(
    ('neutral', 'realistic', 'expected'),
    [(0.0, (2.0, 4.0), (0.0, 4.0)), (5.0, (2.0, 4.0), (2.0, 5.0)), (None, (2.0, 4.0), (2.0, 4.0)), (0.0, None, None)],
)
def test_a_realistic_range_holds_what_changes_nothing(neutral, realistic, expected):
    assert realistic_range(Parameter('k', 3.0, 'N', (0.0, 9.0), '', neutral=neutral, realistic=realistic)) == expected


def test_a_value_is_implausible_from_where_its_whole_interval_is_outside(monkeypatch):
    """By the distance from nominal, or beyond the realistic range and a tenth of it, to either side."""
    ranged = Parameter('b', 0.0, '-', (-20.0, 20.0), '', neutral=0.0, realistic=(-4.0, 8.0))
    plain = Parameter('a', 2.0, 'Pa', (0.1, 100.0), '')
    module = 'sma_sim.evidence.estimation.plausibility'
    monkeypatch.setattr(f'{module}.declared_parameters', lambda _: {'a': plain, 'b': ranged})
    two_wires = SimpleNamespace(wires=2)
    config, std = SimpleNamespace(parameters={'wire.E_A': 2.0, 'wire.E_M': 1.0}, structure=two_wires), 0.1
    low, high = (-4.0 - 12.0 * RANGE_TOLERANCE) / 4.0, (8.0 + 12.0 * RANGE_TOLERANCE) / 4.0
    for k, ends, reason in ((0, (-MAX_PRIOR_STDS, MAX_PRIOR_STDS), 'nominal'), (1, (low, high), 'realistic')):
        for side, end in zip((-1.0, 1.0), ends, strict=True):
            for more, said in ((-1e-3, 0), (1e-3, 1)):
                z = np.zeros(3)
                z[k] = end + side * (GAUSS_95 * std + more)
                found = implausible_parameters(config, (A, B), z, np.diag([std**2] * 2))
                assert len(found) == said
                if found:
                    free = (A, B)[k]
                    assert (found[0].name, found[0].reason, found[0].nominal) == (free.name, reason, free.center)
                    assert (found[0].value, found[0].low, found[0].high) == pytest.approx(
                        (free.value(z[k]), free.value(ends[0]), free.value(ends[1]))
                    )
