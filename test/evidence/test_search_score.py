"""The score of models: exact where a model is linear, the same in all units and orders, and the probabilities made of it."""

from dataclasses import replace
from itertools import combinations, permutations
from math import erf, exp, inf, log, pi, sqrt
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal
from simulated_data import NOISE, command, config, recording

from sma_sim import Dataset, FitOptions, Input, find_effects, read_config
from sma_sim.challenge.files import recording_columns
from sma_sim.evidence.data.recordings import read_dataset
from sma_sim.evidence.data.tables import write_columns
from sma_sim.evidence.estimation import overdispersion as dispersion
from sma_sim.evidence.estimation.calibrate import problem_for
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import choose_free
from sma_sim.evidence.estimation.problem import LinearizedRun, NormalEquations, normal_equations, start_point
from sma_sim.evidence.estimation.recording_differences import zeros_of
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.candidates import Probe, candidates_for, with_effect
from sma_sim.evidence.model_selection.score_tests import ScreeningResult, explained
from sma_sim.evidence.residual_analysis.change_points import change_points
from sma_sim.evidence.search import beam, refine
from sma_sim.evidence.search.beam import Book, Extension, parents
from sma_sim.evidence.search.components import Catalogue, Component, catalogue_for, log_prior_of
from sma_sim.evidence.search.posterior import not_fitted, posterior_of
from sma_sim.evidence.search.prior import EVEN_PRECISION, SPARSITY, UNLISTED, prior_of_values
from sma_sim.evidence.search.refine import REFITTED, WINDOW, Model
from sma_sim.evidence.search.score import Evidence, evidence_of, unlisted_evidence
from sma_sim.evidence.search.steps import in_place_of

SHARED, OWN, CHANNELS, SAMPLES = 2, 1, 2, 8  # of a linear problem: unknowns of all runs, and of each


def evidence_at_end(z, parts, log_prior, unlisted=0.0):
    """The evidence of a fit without bounds that has ended at z, all priors N(0, 1)."""
    unbounded = np.full(len(z), inf)
    zeros = (np.zeros(0),) * len(parts)
    return Evidence(z, -unbounded, unbounded, np.ones(len(z)), parts, zeros, log_prior, 1.0, unlisted)


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('size', [1.0, 1e100, 1e203])
def test_derivatives_that_promise_more_than_there_is_put_a_model_last(size):
    """In silence: those of a model that has overflowed could promise anything."""
    z, jacobian = np.zeros(3), np.random.default_rng(0).normal(size=(3, 4))
    gradient, hessian = jacobian @ np.ones(4), jacobian @ jacobian.T
    parts = tuple(NormalEquations(np.arange(3), 2.0, pull * gradient, hessian) for pull in (1.0, size))
    bounded = replace(evidence_at_end(z, parts, 0.0), low=np.full(3, -5.0), high=np.full(3, 5.0))
    assert (bounded.score(1.0) == -inf) == (size > 1.0)


class LinearProblem:
    """Runs whose residuals over noise are a + J z, with one unknown of their own each; z has the prior N(0, 1)."""

    def __init__(self, runs=3, seed=0, shared=SHARED):
        random = np.random.default_rng(seed)
        self.size = shared + OWN * runs
        self.at_zero = random.normal(size=(runs, CHANNELS, SAMPLES))
        self.jacobians = random.normal(size=(runs, shared + OWN, CHANNELS, SAMPLES))
        self.indices = [np.array([*range(shared), shared + run]) for run in range(runs)]

    def linear(self, z):
        """The runs linearised at z."""
        return [
            LinearizedRun(at, a + np.tensordot(z[at], J, 1), J)
            for at, a, J in zip(self.indices, self.at_zero, self.jacobians, strict=True)
        ]

    def evidence(self, z, split=lambda run: run):
        """The evidence of a fit that has ended at z."""
        parts = tuple(normal_equations(split(run), False) for run in self.linear(z))
        return evidence_at_end(z, parts, 0.0)

    def stacked(self, runs):
        """a (N,) and J (N, n) of some runs."""
        a = np.concatenate([self.at_zero[run].ravel() for run in runs])
        J = np.zeros((len(a), self.size))
        for row, run in enumerate(runs):
            count = CHANNELS * SAMPLES
            J[row * count : (row + 1) * count, self.indices[run]] = self.jacobians[run].reshape(-1, count).T
        return a, J

    def exact_log_evidence(self, k, runs):
        """log N(a; 0, k^2 I + J J'), without the constant of white noise of size k."""
        a, J = self.stacked(runs)
        covariance = k**2 * np.eye(len(a)) + J @ J.T
        return multivariate_normal(np.zeros(len(a)), covariance).logpdf(a) + 0.5 * len(a) * log(2.0 * np.pi * k**2)

    def best(self, k, runs):
        """The most probable z of some runs."""
        a, J = self.stacked(runs)
        return -np.linalg.solve(J.T @ J + k**2 * np.eye(self.size), J.T @ a)


def test_held_out_runs_have_the_density_of_what_the_others_predict():
    """log N(a_2; m, V) with mean and covariance of a_2 given a_1: of joint Gaussians, log p(a) - log p(a_1)."""
    problem, k = LinearProblem(4), 1.7
    evidence = problem.evidence(np.random.default_rng(3).normal(size=problem.size))
    expected = problem.exact_log_evidence(k, range(4)) - problem.exact_log_evidence(k, [0, 2])
    assert evidence.log_predictive(k, (1, 3)) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize('k', [1.0, 3.0])
@pytest.mark.parametrize('left_out', [None, 1])
def test_the_score_of_a_linear_model_is_its_log_evidence(k, left_out):
    """Wherever its fit has ended, under every overdispersion, with all runs or without one."""
    problem = LinearProblem()
    kept = [run for run in range(3) if run != left_out]
    for z in (np.zeros(problem.size), problem.best(1.0, range(3)), np.linspace(-1.0, 1.0, problem.size)):
        assert problem.evidence(z).score(k, left_out) == pytest.approx(problem.exact_log_evidence(k, kept), rel=1e-10)


@pytest.mark.parametrize('k', [1.0, 3.0])
def test_a_run_left_out_is_predicted_as_by_a_fit_without_it(k):
    """What runs share from the others, what is its own from itself."""
    problem, left_out = LinearProblem(seed=1), 1
    z = problem.best(k, [0, 2])
    a, J = problem.stacked([left_out])
    own = SHARED + left_out
    z[own] = 0.0
    z[own] = -J[:, own] @ (a + J @ z) / (J[:, own] @ J[:, own] + k**2)
    expected = np.sum((a + J @ z) ** 2)
    for at in (problem.best(1.0, range(3)), np.linspace(-1.0, 1.0, problem.size)):
        assert problem.evidence(at).squares_without(k, left_out) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize('bounds', [(0.6, 9.0), (-9.0, -0.7), (-0.1, 0.3), (-inf, 0.2), (-0.4, 30.0)])
@pytest.mark.parametrize('even', [False, True])
def test_the_score_of_a_bounded_unknown_is_its_log_evidence(bounds, even):
    """The integral over what its bounds leave it, wherever the fit has ended within them; the prior normal, or even."""
    problem, runs = LinearProblem(), range(3)
    a, J = problem.stacked(runs)
    low, high, precision = np.full(problem.size, -inf), np.full(problem.size, inf), np.ones(problem.size)
    low[0], high[0] = bounds
    precision[0] = EVEN_PRECISION if even else 1.0
    rest = np.eye(len(a)) + J[:, 1:] @ J[:, 1:].T
    of_rest = multivariate_normal(np.zeros(len(a)), rest)

    def density(x):
        return exp(of_rest.logpdf(a + J[:, 0] * x) + log_white) * (1.0 if even else exp(-0.5 * x**2))

    log_white = 0.5 * len(a) * log(2.0 * np.pi)
    within = (max(bounds[0], -30.0), min(bounds[1], 30.0))
    expected = log(quad(density, *within, epsabs=0.0, points=[min(max(0.0, within[0]), within[1])])[0])
    z = problem.best(1.0, runs)
    z[0] = np.clip(z[0], *bounds)
    found = replace(problem.evidence(z), low=low, high=high, precision=precision).score(1.0)
    assert found + 0.5 * log(2.0 * np.pi) == pytest.approx(expected, abs=1e-4)


def test_a_constant_is_no_unknown():
    """Held where it is by both bounds, it costs nothing but its prior."""
    problem = LinearProblem()
    z = problem.best(1.0, range(3))
    z[0] = -0.3
    low, high = np.full(problem.size, -inf), np.full(problem.size, inf)
    low[0] = high[0] = z[0]
    a, J = problem.stacked(range(3))
    a, J = a + J[:, 0] * z[0], J[:, 1:]
    expected = multivariate_normal(np.zeros(len(a)), np.eye(len(a)) + J @ J.T).logpdf(a) + 0.5 * len(a) * log(2.0 * np.pi)
    found = replace(problem.evidence(z), low=low, high=high)
    assert found.score(1.0) == pytest.approx(expected - 0.5 * z[0] ** 2, rel=1e-10)


def test_a_channel_that_is_there_twice_with_half_the_weight_says_the_same():
    def twice(run):
        half = np.sqrt(0.5)
        channels = [0, *range(CHANNELS)]
        weight = np.array([half, half, *[1.0] * (CHANNELS - 1)])[:, None]
        return LinearizedRun(run.indices, run.residuals[channels] * weight, run.jacobian[:, channels] * weight)

    problem = LinearProblem()
    z = problem.best(1.0, range(3))
    once, doubled = problem.evidence(z), problem.evidence(z, twice)
    for k in (1.0, 2.0):
        assert doubled.score(k) == pytest.approx(once.score(k), rel=1e-12)
        assert doubled.squares_without(k, 0) == pytest.approx(once.squares_without(k, 0), rel=1e-12)


def log_odds(truth, runs):
    """Of a model with one unknown c, data c = `truth` and unit slopes, against the model without it."""
    slope = np.ones((1, 1, 50))
    residuals = -truth * slope[0]
    part = normal_equations(LinearizedRun(np.array([0]), residuals, slope), False)
    bare = normal_equations(LinearizedRun(np.zeros(0, dtype=int), residuals, slope[:0]), False)
    with_it = evidence_at_end(np.zeros(1), (part,) * runs, -SPARSITY)
    without = evidence_at_end(np.zeros(0), (bare,) * runs, 0.0)
    return with_it.score(1.0) - without.score(1.0)


def test_more_data_say_more():
    """For what is there, and (more slowly) against what is not."""
    present, absent = ([log_odds(truth, runs) for runs in (1, 2, 4, 8)] for truth in (1.0, 0.0))
    assert all(np.diff(present) > 10.0) and all(np.diff(absent) < -0.3) and max(absent) < -SPARSITY


@pytest.fixture(scope='module')
def robot():
    """Two short runs of a robot that lacks gravity."""
    truth = with_effect(config('mas'), find_effects()['gravity'], {'g_y': -9.81, 'g_x': 0.0})
    channels = ('alpha', 'U_y', 'F_1')
    runs = [recording(truth, command(seed, 8.0), 4.0, 1.0, seed=seed, channels=channels) for seed in (1, 2)]
    return Dataset(tuple(runs), {name: NOISE[name] for name in channels})


def evidence_for(dataset, effects=()):
    """The evidence of the model with some effects at their defaults, and a stiffer beam."""
    given = config('mas')
    for name in effects:
        found = find_effects()[name]
        given = with_effect(given, found, {p.name: p.default for p in found.parameters})
    problem = problem_for(dataset, given, FitOptions(free=('beam.E',)), 1)
    z = start_point(problem)
    z[0] += 0.1
    with executor_or_threads(None) as pool:
        return evidence_of(FitResult(problem, z, 0.0), 0.0, SearchContext(pool, Event()))


def difference(dataset, k=1.0):
    """Log odds of a model with gravity against one without."""
    return evidence_for(dataset, ['gravity']).score(k) - evidence_for(dataset).score(k)


def test_order_of_channels_and_runs_and_units_change_nothing(robot, tmp_path):
    expected = difference(robot)
    assert expected > 100.0
    reversed_runs = replace(robot, recordings=robot.recordings[::-1])
    reversed_channels = tuple(replace(run, channels=dict(reversed(list(run.channels.items())))) for run in robot.recordings)
    assert difference(reversed_runs) == pytest.approx(expected, rel=1e-9)
    assert difference(replace(robot, recordings=reversed_channels)) == pytest.approx(expected, rel=1e-9)
    lines = ['alpha_rad: {column: "a [deg]", scale: 0.017453292519943295}', 'U_y_m: {column: "y [um]", scale: 1e-6}']
    for run in robot.recordings:
        columns = recording_columns(run)
        columns['a [deg]'] = np.rad2deg(columns.pop('alpha_rad'))
        columns['y [um]'] = 1e6 * columns.pop('U_y_m')
        write_columns(tmp_path / f'{run.name}.csv', columns)
    (tmp_path / 'map.yaml').write_text('\n'.join(lines))
    files = [tmp_path / f'{run.name}.csv' for run in robot.recordings]
    other_units = read_dataset(files, 'module', 298.0, tmp_path / 'map.yaml', robot.noise_std)
    assert difference(other_units) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(('rho', 'size'), [(0.0, 1.0), (0.9, 2.0), (0.0, 0.1), (0.9, 0.1)])
def test_overdispersion_of_correlated_residuals(monkeypatch, rho, size):
    """e sqrt((1 + rho)/(1 - rho)) of an autoregressive series of size e, or of that of the noise if this is larger."""
    random, series = np.random.default_rng(1), np.zeros((1, 20_000))
    for k in range(1, series.size):
        series[0, k] = rho * series[0, k - 1] + np.sqrt(1.0 - rho**2) * random.normal()
    monkeypatch.setattr(dispersion, 'residuals_at', lambda problem, z, pool: [size * series])
    problem = SimpleNamespace(runs=[None], samples=series.size)
    expected = max(size, 1.0) * np.sqrt((1.0 + rho) / (1.0 - rho))
    assert dispersion.overdispersion(problem, None, None) == pytest.approx(expected, rel=0.1)
    monkeypatch.setattr(dispersion, 'residuals_at', lambda problem, z, pool: [None])
    assert dispersion.overdispersion(problem, None, None) == inf


def test_instants_without_a_measurement_are_no_samples():
    """A channel that is measured at every fourth instant of the others has the overdispersion of what was measured, and as
    much evidence of something smooth."""
    random, series = np.random.default_rng(2), np.zeros(2000)
    for k in range(1, series.size):
        series[k] = 0.9 * series[k - 1] + np.sqrt(1.0 - 0.81) * random.normal()
    sparse = np.zeros(4 * series.size)
    sparse[::4] = series
    alone = dispersion.overdispersion_of_rows([series], series.size)
    assert alone > 3.0 and dispersion.overdispersion_of_rows([sparse], series.size) == alone
    assert unlisted_evidence([series[None, :]]) == unlisted_evidence([sparse[None, :]]) > 100.0


def residual_runs(seed, disturbance=0.0):
    """White noise in three channels of two runs, and something smooth in the last channel."""
    random = np.random.default_rng(seed)
    found = []
    for count in (200, 300):
        residuals = random.normal(size=(3, count))
        residuals[2] += disturbance * np.sin(np.linspace(0.0, 9.0, count) ** 1.2)
        found.append(residuals)
    return found


@pytest.mark.parametrize('seed', range(8))
def test_white_noise_is_no_function_of_time_and_what_is_smooth_is(seed):
    assert unlisted_evidence(residual_runs(seed)) < 0.0
    assert 20.0 < unlisted_evidence(residual_runs(seed, 1.0)) < unlisted_evidence(residual_runs(seed, 2.0))


def test_what_repeats_differ_by_is_no_function_that_is_missing():
    """Where the noise is mostly what repeated experiments differ by, which lasts, residuals of its size that last tell
    nothing; what is larger does, and as much that lasts in white noise."""
    shares, within, beyond, white = ((0.99,), (0.99,)), [], [], []
    for seed in range(12):
        random, rows = np.random.default_rng(seed), np.zeros((2, 60))
        rows[:, 0] = random.normal(size=2)
        for k in range(1, 60):
            rows[:, k] = 0.85 * rows[:, k - 1] + np.sqrt(1.0 - 0.85**2) * random.normal(size=2)
        runs, larger = ([size * row[None, :] for row in rows] for size in (1.0, 4.0))
        within.append(unlisted_evidence(runs, shares))
        beyond.append(unlisted_evidence(larger, shares))
        white.append(unlisted_evidence(runs))
    assert max(within) < 0.0 and min(beyond) > 100.0 and np.median(white) > 10.0


def test_values_beyond_what_is_realistic_cost_nats(robot):
    """The prior of a value is a density: even in the realistic range, less the further beyond."""
    found = find_effects()['radiation']
    given = with_effect(config('mas'), found, {'emissivity': 0.5})
    name = 'effects.radiation.emissivity'
    problem = problem_for(robot, given, FitOptions(free=('beam.E', name)), 1)
    number = [p.name for p in problem.free].index(name)
    (declared,) = (p for p in found.parameters if p.name == 'emissivity')
    low, high = (problem.free[number].coordinate(value) for value in declared.realistic)

    def density(at):
        z = np.zeros(len(problem.unknowns))
        z[number] = at
        _, _, _, log_density = prior_of_values(problem, z)
        return exp(log_density) / sqrt(2.0 * pi)

    width = high - low
    inside = [density(low + part * width) for part in (0.0, 0.3, 1.0)]
    assert inside == pytest.approx([inside[0]] * 3) and inside[0] > 1.5 * density(high + 0.1 * width) > 0.0
    beyond = [density(high + part * width) for part in (0.1, 0.5, 1.0, 2.0)]
    assert all(np.diff(beyond) < 0.0) and log(inside[0] / beyond[-1]) > 5.0
    tails = quad(density, high, high + 30.0 * width)[0] + quad(density, low - 30.0 * width, low)[0]
    assert quad(density, low, high)[0] + tails == pytest.approx(1.0, abs=0.01)
    z = np.zeros(len(problem.unknowns))
    z[1 - number] = 3.0  # of the nominal model: not an effect
    bounds = problem.limits()
    for at in (z, 0.0 * z):
        low, high, precision, log_density = prior_of_values(problem, at)
        assert log_density == pytest.approx(log(density(0.0) * sqrt(2.0 * pi)))
        assert (low[1 - number], high[1 - number], precision[1 - number]) == (*(b[1 - number] for b in bounds), 1.0)


CATALOGUE = Catalogue(candidates_for(config()), ())
BY_NAME = {candidate.name: candidate for candidate in CATALOGUE.effects}


def component(name):
    """An effect, or a difference between recordings."""
    if name in BY_NAME:
        return CATALOGUE.component(ScreeningResult(BY_NAME[name], 1.0, {}))
    return Component(name, -SPARSITY, zeros_of({'U_y': 1e-5}))


def model(names, squares, kinetics='mas', unlisted=-inf):
    """A model that leaves so many squares."""
    components = tuple(component(name) for name in names)
    part = normal_equations(LinearizedRun(np.zeros(0, dtype=int), np.full((1, 1), squares**0.5), np.zeros((0, 1, 1))), False)
    evidence = evidence_at_end(np.zeros(0), (part,), log_prior_of(components), unlisted)
    problem = SimpleNamespace(config=SimpleNamespace(simulated_kinetics=kinetics), tempering=1.0)
    return Model(components, SimpleNamespace(cost=0.5 * squares, squares=squares, problem=problem), evidence)


def posterior(*models):
    book = Book(CATALOGUE, True)
    book.add(models)
    return posterior_of(book)


MODELS = (
    model((), 30.0), model((), 26.0, 'hybrid'), model(('gravity',), 4.0), model(('gravity',), 14.0),
    model(('radiation',), 6.0), model(('gravity', 'radiation'), 1.0), model(('the zero of U_y',), 12.0),
    model(('driver_lag',), 90.0),
)  # fmt: skip


def test_weights_and_probabilities_are_those_of_the_scores():
    found = posterior(*MODELS)
    assert sum(found.weights) == pytest.approx(1.0) and list(found.weights) == sorted(found.weights, reverse=True)
    scores = [one.score(1.0) for one in found.models]
    assert found.weights == pytest.approx(np.exp(np.array(scores) - scores[0]) * found.weights[0])
    assert all(scores[0] - score <= WINDOW for score in scores)
    assert 'driver_lag' not in found.effects and found.unlisted < 1e-300
    by_names = {(tuple(sorted(one.names)), one.key[1]): w for one, w in zip(found.models, found.weights, strict=True)}
    both = by_names.get((('gravity', 'radiation'), 'mas'), 0.0)
    assert found.effects['gravity'] == pytest.approx(by_names[('gravity',), 'mas'] + both)
    # a model lacks nothing, or one of the two, or both; what differs between recordings is nothing that it lacks
    assert found.none + found.effects['gravity'] + found.effects['radiation'] - both == pytest.approx(1.0)
    assert found.none >= by_names[('the zero of U_y',), 'mas'] > 0.0


@pytest.mark.parametrize('curvature', [0.0, 1e-3, 4.0, 1e6])
def test_what_was_not_fitted_has_the_weight_that_a_model_with_it_would_have(curvature):
    """An effect that the data do not see is as probable as before them; the stronger it would show, the less it is."""
    book, most = Book(CATALOGUE, True), 3.0
    book.add([model((), 30.0), model(('gravity',), 34.0)])
    lines = {'gravity': (0.0, 1e9, most), 'radiation': (0.0, curvature, most)}
    tested = tuple(ScreeningResult(BY_NAME[name], 0.0, {}, (line,)) for name, line in lines.items())
    book.extended[frozenset(), 'mas'] = Extension(15.0, frozenset(), tested)
    found = posterior_of(book)
    size = sqrt(0.5 * curvature)
    seen = 0.5 * sqrt(pi) * erf(most * size) / (most * size) if curvature else 1.0
    expected = exp(CATALOGUE.log_prior(BY_NAME['radiation'])) * seen
    assert found.other / found.none == pytest.approx(expected, rel=1e-6)
    assert set(found.effects) == {'gravity'}  # which was fitted, and does not count twice
    assert found.none + found.effects['gravity'] + found.other == pytest.approx(1.0)


def test_what_was_sketched_counts_no_more_than_the_last_one_that_was_fitted():
    """Score tests promise to first order what sketches have looked at."""
    book = Book(CATALOGUE, False)
    last = model(('gravity',), 34.0)
    book.add([model((), 30.0), last])
    tested = (ScreeningResult(BY_NAME['radiation'], 60.0, {}, ((-60.0, 60.0, 3.0),)),)
    book.extended[frozenset(), 'mas'] = Extension(15.0, frozenset({'gravity', 'radiation'}), tested)
    assert not_fitted(book.ranked(0)[0], book) == {'radiation': last.score(book.overdispersion)}


def test_what_was_promised_beside_a_fit_that_has_come_down_since_counts_from_there():
    """A nominal fit that came down by 120 nats had a probability of 0.005 beside what its score tests had promised."""
    book = Book(CATALOGUE, False)
    book.add([model((), 30.0)])
    tested = (ScreeningResult(BY_NAME['radiation'], 60.0, {}, ((-60.0, 60.0, 3.0),)),)
    scores = []
    for cost in (15.0, 19.0):
        book.extended[frozenset(), 'mas'] = Extension(cost, frozenset(), tested)
        scores.append(not_fitted(book.ranked(0)[0], book)['radiation'])
    assert scores[0] - scores[1] == pytest.approx(4.0 / book.overdispersion**2)


def test_the_order_in_which_models_were_found_decides_nothing():
    """Of two fits of one model the better one stays, whichever came first."""
    expected = posterior(*MODELS)
    for order in list(permutations(MODELS[:5]))[::7]:
        found = posterior(*order, *MODELS[5:])
        assert found.effects == pytest.approx(expected.effects) and found.none == pytest.approx(expected.none)
        assert [one.key for one in found.models] == [one.key for one in expected.models]
        assert found.weights == pytest.approx(expected.weights) and found.overdispersion == expected.overdispersion
        assert min(one.fit.cost for one in found.models if one.names == {'gravity'}) == 2.0


@pytest.mark.parametrize('evidence', [-2.0, SPARSITY + UNLISTED, 40.0, 1e6])
def test_what_is_left_beside_the_nominal_model_is_not_listed(evidence):
    """Even odds where the data say as much for it as it costs."""
    found = posterior(model((), 10.0, unlisted=evidence))
    assert found.weights == (1.0,) and found.none + found.unlisted == pytest.approx(1.0)
    assert found.unlisted == pytest.approx(1.0 / (1.0 + exp(min(700.0, SPARSITY + UNLISTED - evidence))))
    beside = posterior(model(('gravity',), 10.0, unlisted=evidence))
    assert beside.effects == {'gravity': 1.0} and beside.none == 0.0
    assert beside.unlisted == beside.best.unlisted


def test_all_effects_cost_the_same_and_share_it_with_their_scopes():
    costs = {CATALOGUE.log_prior(candidate) for candidate in CATALOGUE.effects}
    assert costs == {-SPARSITY - log(len(CATALOGUE.effects))}
    assert sum(exp(CATALOGUE.log_prior(one)) for one in CATALOGUE.effects) == pytest.approx(exp(-SPARSITY))


def test_effects_of_the_driver_are_sought_where_power_was_commanded():
    """A wire that is pulled and never heated says nothing of its driver, nor of the clock of commands: it has none."""
    for power, is_sought in ((0.0, False), (1.0, True)):
        source = Input(
            np.arange(3.0),
            np.array([[0.0, power * k, 298.0] for k in range(3)]),
            (True, False, False),
            ('strain', 'J_W', 'T_E_K'),
        )
        problem = SimpleNamespace(
            config=read_config(words=['system=wire']), runs=[SimpleNamespace(source=source, channels=('stress',))]
        )
        catalogue = catalogue_for(SimpleNamespace(problem=problem), SimpleNamespace(folders=(), variants=False))
        names = {candidate.name for candidate in catalogue.effects}
        of_driver = {'driver_lag', 'driver_deadband', 'driver_saturation', 'clock_skew'}
        assert (of_driver <= names) == is_sought
        assert is_sought or not names & {*of_driver, 'resistance_feedback'}


def test_instants_at_which_something_happens():
    """A mean that changes for good, and a transient of which nothing lasts: a fit has bent its parameters to the rest."""
    random, time = np.random.default_rng(3), np.arange(0.0, 100.0, 0.05)
    runs = [SimpleNamespace(time=time, channels=('alpha', 'U_y'), weight=np.ones((2, len(time)))) for _ in range(2)]
    residuals = [random.normal(size=(2, len(time))) for _ in runs]
    for rows in residuals:
        rows[0] += 0.3 * (time >= 62.0)
        late = np.maximum(0.0, time - 45.0)
        rows[1] += 6.0 * np.sin(20.0 * late) * np.exp(-late / 0.2)
    linear = [LinearizedRun(np.zeros(0, dtype=int), rows, np.zeros((0, *rows.shape))) for rows in residuals]
    found = change_points(SimpleNamespace(runs=runs), linear)
    assert found[0] == pytest.approx(62.0, abs=0.5) and found[-1] == pytest.approx(45.0, abs=0.3)


def test_probes_together_explain_what_the_best_set_of_sides_does():
    """Of each parameter one side, up or down, by a positive amount: no such set gains more."""
    random = np.random.default_rng(5)
    probes = [Probe(name, 0.0, step, {}) for name in ('a', 'b', 'c') for step in (1.0, -2.0)]
    responses = random.normal(size=(6, 40))
    residuals = -0.7 * responses[1] - 1.2 * responses[2] - 0.4 * responses[5] + 0.1 * random.normal(size=40)
    gain, amounts = explained(probes, responses, residuals)
    fits = {
        sides: np.linalg.lstsq(responses[list(sides)].T, -residuals, rcond=None)[0]
        for size in (1, 2, 3)
        for sides in combinations(range(6), size)
        if len({k // 2 for k in sides}) == size
    }
    lost = {sides: np.sum((residuals + x @ responses[list(sides)]) ** 2) for sides, x in fits.items() if (x > 0.0).all()}
    best = min(lost, key=lost.get)
    assert gain == pytest.approx(residuals @ residuals - lost[best]) and best == (1, 2, 5)
    assert np.flatnonzero(amounts).tolist() == list(best) and amounts[list(best)] == pytest.approx(fits[best])


@pytest.mark.parametrize('k', [1.0, 3.0])
def test_gain_of_the_optimum(k):
    """What is gained by moving from where a fit has ended to where it is best under an overdispersion."""
    problem = LinearProblem()
    a, J = problem.stacked(range(3))

    def log_density(z):
        return -0.5 * np.sum((a + J @ z) ** 2) / k**2 - 0.5 * z @ z

    best = problem.best(k, range(3))
    for z in (best, np.zeros(problem.size), np.linspace(-1.0, 1.0, problem.size)):
        assert problem.evidence(z).gain(k) == pytest.approx(log_density(best) - log_density(z), rel=1e-9, abs=1e-9)


def test_what_lies_beyond_bounds_is_no_gain():
    """A fit that has ended at its best within them promises nothing, whatever lies beyond; near them, as far as they are."""
    problem = LinearProblem()
    best = problem.best(1.0, range(3))
    found = problem.evidence(np.zeros(problem.size))
    reach = np.full(problem.size, 1e-3)
    near = replace(found, low=-reach, high=reach)
    at_end = replace(found, low=np.minimum(best, 0.0), high=np.zeros(problem.size))
    slope = found._sums(range(3))[1]
    assert 0.0 < near.gain(1.0) <= 1e-3 * np.abs(slope).sum() < found.gain(1.0)
    held = replace(at_end, low=np.where(slope < 0.0, -1.0, 0.0), high=np.where(slope < 0.0, 0.0, 1.0))
    assert held.gain(1.0) == 0.0


def test_an_effect_at_its_neutral_value_is_absent():
    """All that makes it act is there; shapes do not count."""
    (found,) = (candidate.effect for candidate in CATALOGUE.effects if candidate.name == 'guide_friction')
    given = with_effect(config(), found, {'mu': 0.0, 'v_s': 1e-4})
    names = ('beam.E', 'effects.guide_friction.mu', 'effects.guide_friction.v_s')
    free, _ = choose_free(given, names)
    problem = SimpleNamespace(free=free)
    for z, absent in (([0.3, 0.0, 0.7], True), ([0.3, 1e-6, 0.7], False)):
        assert component('guide_friction').is_absent(SimpleNamespace(problem=problem, z=np.array(z))) == absent
    assert not component('the zero of U_y').is_absent(SimpleNamespace(problem=problem, z=np.zeros(3)))


def test_kinetics_that_tie_are_both_extended():
    """That first which leaves least; without a tie only the better one."""
    for squares, expected in ((34.0, ['hybrid', 'mas']), (90.0, ['hybrid'])):
        book = Book(CATALOGUE, True)
        book.add([model((), squares), model((), 30.0, 'hybrid')])
        assert [one.key[1] for one in parents(book, 0)] == expected


@pytest.mark.parametrize(('squares', 'expected'), [(1.0, ['gravity']), (30.0, ['gravity', 'radiation'])])
def test_a_level_ends_where_the_best_of_all_leaves_nothing(monkeypatch, squares, expected):
    """One that leaves nothing, and is less probable than a model with fewer components, ends nothing."""
    book, extended = Book(CATALOGUE, False), []
    book.add([model(('gravity',), 20.0, unlisted=1.0), model(('radiation',), 20.5, unlisted=1.0)])

    def expand(parent, known, _):
        extended.extend(parent.names)
        known.add([model((*parent.names, 'driver_lag'), squares)])

    monkeypatch.setattr(beam, 'expand', expand)
    beam.expand_level(2, book, SimpleNamespace(stop=Event()))
    assert extended == expected


@pytest.mark.parametrize(('left', 'restarted'), [(-1.0, 0), (1.0, 1)])
def test_what_leaves_nothing_with_the_other_kinetics_is_in_no_wrong_valley(monkeypatch, left, restarted):
    """Models that leave something with either of the kinetics are fitted from further starts."""
    book, asked = Book(CATALOGUE, True), []
    book.add([model((), 500.0, kinetics, unlisted=9.0) for kinetics in ('hybrid', 'mas')])
    first = model(('gravity',), 100.0, 'hybrid', unlisted=5.0)

    def further(parent, models, *_):
        asked.append([one.names for one in models])
        return [model(('gravity',), 90.0, 'hybrid', unlisted=5.0)]

    monkeypatch.setattr(beam, 'extended', lambda *_: [first])
    monkeypatch.setattr(beam, 'in_other_kinetics', lambda *_: model(('gravity',), 80.0, 'mas', unlisted=left))
    monkeypatch.setattr(beam, 'further_fits', further)
    monkeypatch.setattr(beam, 'report_model', lambda *_: None)
    context = SimpleNamespace(stop=Event(), on_progress=lambda _: None)
    parent = book.ranked(0)[0]
    (found,) = beam.add_extended(parent, [component('gravity')], book, context)
    beam.fit_again(parent, [found], book, context)
    assert len(asked) == restarted
    assert book.models[found.key].fit.squares == (90.0 if restarted else 100.0)


def test_what_promises_most_is_fitted_though_its_sketch_has_failed(monkeypatch):
    names = [one.name for one in CATALOGUE.effects][: REFITTED + 3]
    costs = dict(zip(names, [90.0, *range(10, 10 + len(names))], strict=False))
    monkeypatch.setattr(
        refine, 'sketched', lambda base, some, *_: [FitResult(None, None, costs[one.candidate.name]) for one in some]
    )
    found = refine.best_by_sketch(None, [component(name) for name in names], None, 100.0, 100.0)
    assert [one.name for one, *_ in found] == [*names[1 : REFITTED + 1], names[0]]


def test_what_its_sketch_shows_to_be_hopeless_is_not_fitted(monkeypatch):
    """A sketch may end at some times the cost of its fit; further starts are asked the same."""
    costs, fitted = {'gravity': 20.0, 'radiation': 70.0, 'driver_lag': 900.0}, []
    starts = [(component(name), name, np.zeros(1), cost) for name, cost in costs.items()]
    monkeypatch.setattr(refine, 'best_by_sketch', lambda *_: starts)
    monkeypatch.setattr(refine, 'refit', lambda problem, *_: fitted.append(problem))
    monkeypatch.setattr(refine, 'model_of', lambda some, fits, _: model(tuple(one.name for one in some), 30.0))
    parent, context = model((), 500.0), SimpleNamespace(stop=Event())
    found = refine.extended(parent, [one for one, *_ in starts], context)
    assert fitted == ['gravity', 'radiation'] and {name for one in found for name in one.names} == {*fitted}
    monkeypatch.setattr(refine, 'restarted', lambda fit, one, *_: fitted.append(one.names) or [])
    refine.further_fits(parent, [model(('driver_lag',), 900.0, unlisted=1.0)], context, target=20.0)
    assert len(fitted) == 2


def test_what_has_weight_with_other_kinetics_is_fitted_with_those_of_the_best(monkeypatch):
    """The right equation had been found with the wrong kinetics, and two effects with the right ones were better."""
    book, asked = Book(CATALOGUE, True), []
    pair = ('gravity', 'radiation')
    book.add([model((), 500.0), model((), 500.0, 'hybrid'), model(pair, 4.0), model(('driver_lag',), 20.0, 'hybrid')])
    book.add([model(('clamp_slip',), 90.0, 'hybrid')])

    def refitted(one, fewer, _):
        asked.append((set(one.names), fewer.key[1]))
        return model(tuple(one.names), 3.0)

    monkeypatch.setattr(beam, 'in_other_kinetics', refitted)
    beam.add_in_kinetics_of_best(book, SimpleNamespace(stop=Event()))
    assert asked == [({'driver_lag'}, 'mas')] and book.best.key == (frozenset({'driver_lag'}), 'mas')


@pytest.mark.parametrize('k', [1.0, 3.0])
def test_a_promise_counts_until_a_fit_has_gone_on_to_the_end(k):
    """What derivatives still promise there is no evidence; where a fit has ended at its optimum they promise nothing."""
    problem = LinearProblem()
    for away in (0.0, 1.0):
        found = problem.evidence(problem.best(k, range(3)) + away)
        fit = SimpleNamespace(problem=SimpleNamespace(tempering=k))
        open_one, ended = Model((), fit, found), Model((), fit, found, is_settled=True)
        assert open_one.score(k) == found.score(k)
        taken = open_one.score(k) - ended.score(k)
        assert taken == pytest.approx(found.gain(k), abs=1e-9) and (taken > 0.1) == (away > 0.0)


@pytest.mark.parametrize(('led', 'again'), [(40.0, True), (399.0, False)])
def test_what_a_model_is_made_of_is_fitted_again_where_that_has_led_far(monkeypatch, led, again):
    """A fit that stops early is taken for one that lacks something, and the one that goes on wins by an effect that does
    nothing. Here the true pair had ended at 500 squares, and its model with a third effect goes on from 400."""
    pair, triple = ('gravity', 'natural_convection'), ('gravity', 'natural_convection', 'clamp_slip')
    book, asked = Book(CATALOGUE, False), []
    book.add([model(pair, 500.0), model(triple, 400.0)])

    def settled(fitted, k, _):
        return replace(model(triple, led) if fitted.names == {*triple} else fitted, is_settled=True)

    def without(whole, dropped, _):
        asked.append(dropped.name)
        return model(
            [one.name for one in whole.components if one is not dropped], 41.0 if dropped.name == 'clamp_slip' else 1e4
        )

    monkeypatch.setattr(beam, 'settled', settled)
    monkeypatch.setattr(beam, 'without', without)
    beam.settle(book, SimpleNamespace(stop=Event(), on_progress=lambda _: None))
    assert set(asked) == ({*triple} if again else set())
    assert book.best.names == ({*pair} if again else {*triple}) and book.best.is_settled


@pytest.mark.parametrize(
    ('apart', 'more', 'is_copy'),
    [(0.5, (), True), (3.0, (), True), (3.4, (), False), (40.0, (), False), (0.5, ('driver_lag',), False)],
)
def test_an_equation_that_predicts_what_a_listed_effect_does_is_no_unlisted_law(monkeypatch, apart, more, is_copy):
    """To within a tie, 10 squares over the noise, it is that effect in other words; beyond, and where it takes two effects
    to imitate it, the score decides."""
    gravity, radiation = model(('gravity', *more), 4.0), model(('radiation',), 40.0)
    term = replace(gravity.components[0], name='proposed', term=SimpleNamespace())
    equation = replace(gravity, components=(term,))  # alone
    book, rows = Book(CATALOGUE, False), {id(gravity): 0.0, id(equation): apart, id(radiation): 2.0 * apart}
    models = (gravity, equation, radiation)
    models = tuple(replace(one, fit=SimpleNamespace(**vars(one.fit), z=rows[id(one)])) for one in models)
    book.add(models)
    monkeypatch.setattr(beam, 'residuals_at', lambda problem, z, pool: [np.array([[z, 0.0]])])
    beam.leave_out_copies(book, SimpleNamespace(stop=Event(), pool=None))
    assert (models[1].key in book.models) != is_copy
    assert models[0].key in book.models and models[2].key in book.models


@pytest.mark.parametrize(
    ('squares', 'less', 'said'),
    [(4.0, 8.0, True), (4.1, 8.0, False), (12.0, 0.0, True), (16.0, 0.0, False), (1.0, 30.0, True)],
)
def test_an_effect_that_explains_as_well_is_said_however_improbable_it_was_before(squares, less, said):
    """What has more free parameters is less probable by these, though it leaves less; what is tied is said in any case."""
    best, rival = model(('gravity',), 4.0), model(('radiation',), squares)
    rival = replace(rival, evidence=replace(rival.evidence, log_prior=rival.evidence.log_prior - less))
    book = Book(CATALOGUE, False)
    book.add([model((), 90.0), best, rival])
    found = in_place_of(best.components[0], best, book, posterior_of(book))
    assert [one.name for one in found] == ['radiation'] * said


@pytest.mark.parametrize(
    ('names', 'singles', 'nominal', 'unlisted', 'expected'),
    [
        ((), (), 30.0, -1.0, False),
        (('gravity',), (), 1030.0, -1.0, True),
        (('gravity',), (), 9030.0, -1.0, False),
        (('gravity',), (), 9030.0, 20.0, True),
        (('gravity', 'radiation'), (4030.0, 4030.0), 9030.0, -1.0, False),
        (('gravity', 'radiation'), (4030.0, 430.0), 9030.0, -1.0, True),
        (('gravity', 'radiation'), (), 9030.0, -1.0, True),
    ],
)
def test_where_an_unlisted_law_may_be_behind_the_best_model(names, singles, nominal, unlisted, expected):
    """Not where nothing is missing, nor where each effect explains thousands of nats beside the others: where two imitate
    another law, the second explains the small part by which the first differs from it."""
    book = Book(CATALOGUE, False)
    book.add([model((), nominal), model(names, 30.0, unlisted=unlisted)])
    book.add(model((name,), squares) for name, squares in zip(names, singles, strict=False))
    assert beam.may_be_unlisted(book) == expected
