"""The integral of a normal density between bounds, against closed forms, the distribution itself and quadrature."""

from __future__ import annotations

from math import erf, expm1, inf, log, log1p, pi, sqrt
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm, truncnorm

from sma_sim.evidence.estimation.levenberg_marquardt import bounded_step
from sma_sim.evidence.search.bounded_integral import between_bounds, log_bounded_integral


def random_density(seed, n):
    """Slope, precision, and the normal density (mean, covariance, log height) that they stand for."""
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(n, n))
    precision = factor @ factor.T * 10 ** rng.uniform(-2.0, 2.0) + np.diag(10 ** rng.uniform(-2.0, 1.0, n))
    covariance = np.linalg.inv(precision)
    mean = 1.5 * rng.normal(size=n) * np.sqrt(np.diag(covariance))
    height = 0.5 * float(mean @ precision @ mean - np.linalg.slogdet(precision)[1])
    return rng, -precision @ mean, precision, mean, covariance, height


@pytest.mark.parametrize('n', [1, 2, 3, 5])
@pytest.mark.parametrize('seed', range(4))
def test_without_bounds_it_is_the_whole_integral(seed, n):
    _, slope, precision, _, _, height = random_density(seed, n)
    unbounded = np.full(n, inf)
    assert log_bounded_integral(slope, precision, -unbounded, unbounded) == pytest.approx(height, abs=1e-9)


@pytest.mark.parametrize('n', [2, 3, 5])
@pytest.mark.parametrize('seed', range(6))
def test_of_correlated_unknowns(seed, n):
    """Against the distribution; bounds on one side and on both."""
    rng, slope, precision, mean, covariance, height = random_density(seed, n)
    low, high = -rng.uniform(0.0, 3.0, n), rng.uniform(0.1, 3.0, n)
    low[rng.random(n) < 0.3] = -inf
    inside = multivariate_normal(mean, covariance).cdf(high, lower_limit=low, rng=np.random.default_rng(0))
    assert log_bounded_integral(slope, precision, low, high) == pytest.approx(height + log(inside), abs=0.05)


def test_of_independent_unknowns_it_is_exact_far_out_in_the_tails():
    slope, precision = np.array([5.0, 40.0, -300.0]), np.array([1.0, 1.0, 4.0])
    low, high = np.array([0.0, 0.0, -1.0]), np.array([inf, inf, 0.0])
    tails = norm.logsf([5.0, 40.0, 150.0]) + 0.5 * slope**2 / precision - 0.5 * np.log(precision)
    assert log_bounded_integral(slope, np.diag(precision), low, high) == pytest.approx(tails.sum(), abs=1e-6)


@pytest.mark.parametrize('correlation', [0.9, 0.999, 1.0 - 1e-6, 1.0 - 1e-10])
@pytest.mark.parametrize('pull', [1.0, 1e3, 1e6, 1e9])
def test_of_unknowns_that_data_pull_far_beyond_opposite_bounds(pull, correlation):
    """Without bounds the density would be largest where no number reaches."""
    precision = np.linalg.inv(np.array([[1.0, correlation], [correlation, 1.0]]))
    slope, low, high = np.array([pull, -0.5 * pull]), np.array([0.0, -1.0]), np.array([1.0, 0.0])
    x = np.concatenate([[0.0], np.geomspace(1e-15, 1.0, 3000)])
    weight = np.zeros_like(x)
    weight[1:] += 0.5 * np.diff(x)
    weight[:-1] += 0.5 * np.diff(x)
    first, second = x[:, None], -x[None, :]
    squares = precision[0, 0] * first**2 + 2.0 * precision[0, 1] * first * second + precision[1, 1] * second**2
    exact = log(weight @ np.exp(-slope[0] * first - slope[1] * second - 0.5 * squares) @ weight) - log(2.0 * pi)
    assert log_bounded_integral(slope, precision, low, high) == pytest.approx(exact, abs=0.02)


@pytest.mark.parametrize('seed', range(5))
def test_of_unknowns_that_data_cannot_tell_apart(seed):
    """Whose precision is that of their priors in all directions but one: rounding errors are as large."""
    n, strength = 8, 1e11
    direction = np.random.default_rng(seed).normal(size=n)
    precision = strength * np.outer(direction, direction) + 1e-6 * np.eye(n)
    low, high = np.full(n, -5.0), np.full(n, 5.0)
    found = log_bounded_integral(np.zeros(n), precision, low, high)
    size = np.linalg.norm(direction)  # across the direction the box is even: its section through 0, by its normal density
    draws = np.random.default_rng(0).uniform(-5.0, 5.0, (200_000, n)) @ direction / size
    density = (np.abs(draws) < 0.5).mean() / 1.0  # of the distance from 0 along the direction
    exact = n * log(10.0) + log(density) - 0.5 * log(strength * size**2) - 0.5 * (n - 1) * log(2.0 * pi)
    assert found == pytest.approx(exact, abs=0.3)


@pytest.mark.parametrize('width', [1e-30, 1e-9, 1e-3, 1.0, 50.0])
@pytest.mark.parametrize('slope', [0.0, 1e-3, 0.3, 7.0, 37.0, 1e3, 1e6, 1e15, 1e30])
def test_of_one_unknown_however_steep(slope, width):
    """An exponential where the slope is all, a normal density where it is not."""
    found, mean, variance = (float(one[0]) for one in between_bounds(*(np.array([v]) for v in (-slope, 1.0, 0.0, width))))
    assert 0.0 <= mean <= width and 0.0 <= variance <= 0.25 * width**2
    if slope * width > 1e-4 and slope >= 1e3:
        assert found == pytest.approx(log(-expm1(-slope * width) / slope) - 0.5 * log(2.0 * pi), abs=1e-5)
    elif slope * width < 1e-4 and width <= 1e-3:
        assert found == pytest.approx(log(width) - 0.5 * log(2.0 * pi) + log1p(-0.5 * slope * width), abs=1e-5)
    else:
        exact = truncnorm(slope, slope + width, loc=-slope)
        inside = norm.logsf(slope) + log1p(-np.exp(norm.logsf(slope + width) - norm.logsf(slope)))
        assert found == pytest.approx(inside + 0.5 * slope**2, abs=1e-6)
        if width >= 1.0:  # where those of the distribution are not rounding errors
            assert (mean, variance) == pytest.approx((exact.mean(), exact.var()), rel=1e-4)


def test_a_mean_between_the_bounds():
    found, mean, variance = (float(one[0]) for one in between_bounds(*(np.array([v]) for v in (0.0, 1.0, -0.3, 1.2))))
    exact = truncnorm(-0.3, 1.2)
    inside = 0.5 * (erf(1.2 / sqrt(2.0)) + erf(0.3 / sqrt(2.0)))
    assert (np.exp(found), mean, variance) == pytest.approx((inside, exact.mean(), exact.var()))


def test_derivatives_of_any_size_leave_the_integral_as_it_is():
    """Of a model that is no longer one (a fit of guide friction): its bounds are far, and it is the whole integral."""
    case = np.load(Path(__file__).with_name('exploding_derivatives.npz'))
    slope, precision, low, high = (case[name] for name in ('slope', 'precision', 'low', 'high'))
    unit = 1.0 / np.sqrt(np.diag(precision))
    pull, scaled = unit * slope, np.outer(unit, unit) * precision
    whole = 0.5 * float(pull @ np.linalg.solve(scaled, pull) - np.linalg.slogdet(scaled)[1]) + float(np.log(unit).sum())
    assert log_bounded_integral(slope, precision, low, high) == pytest.approx(whole, abs=0.01)


@pytest.mark.parametrize('correlation', [0.9, 0.99, 0.999, 0.9999])
@pytest.mark.parametrize('away', [(-30.0, 40.0), (30.0, -40.0), (25.0, 60.0)])
def test_in_a_corner_it_falls_from_both_bounds(away, correlation):
    """Data that pull far beyond bounds: the density about its highest point is exp(-g x) of either unknown."""
    size, low, high = np.array([200.0, 1000.0]), np.full(2, -2.0), np.full(2, 3.0)
    precision = np.outer(size, size) * np.array([[1.0, correlation], [correlation, 1.0]]) + np.eye(2)
    slope = -precision @ away
    corners = [np.array([x, y]) for x in (-2.0, 3.0) for y in (-2.0, 3.0)]
    heights = [-float(slope @ at + 0.5 * at @ precision @ at) for at in corners]
    at = corners[int(np.argmax(heights))]
    exact = max(heights) - np.log(np.abs(slope + precision @ at)).sum() - log(2.0 * pi)
    assert log_bounded_integral(slope, precision, low, high) == pytest.approx(exact, abs=0.02)


@pytest.mark.parametrize('seed', range(10))
def test_it_is_never_more_than_the_whole_density_about_its_highest_point(seed):
    """Of many unknowns that data hardly tell apart, a fit being far from its end: rounds that began elsewhere swung to
    thousands of nats more, and a model that left 3.4 times the noise was certain."""
    rng, n = np.random.default_rng(seed), 15
    derivatives = rng.normal(size=(n + 3, n)) * 10.0 ** rng.uniform(-3.0, 2.0, (n + 3, 1))
    size = 10.0 ** rng.uniform(-1.0, 4.0, n) / np.linalg.norm(derivatives, axis=0)
    precision = (derivatives * size).T @ (derivatives * size) + np.eye(n)
    slope, low, high = precision @ (30.0 * rng.normal(size=n)), -rng.uniform(0.0, 8.0, n), rng.uniform(0.0, 8.0, n)
    at = bounded_step(slope, precision, 0.0, low, high)
    whole = -float(slope @ at + 0.5 * at @ precision @ at) - 0.5 * float(np.linalg.slogdet(precision)[1])
    assert whole - 400.0 < log_bounded_integral(slope, precision, low, high) <= whole + 1e-6 * abs(whole)


@pytest.mark.parametrize('seed', range(3))
def test_unknowns_that_data_do_not_tell_apart_have_an_integral(seed):
    """Two of which only the sum is known beside an even prior of either; also where no number holds their difference."""
    rng, n = np.random.default_rng(seed), 12
    derivatives = rng.normal(size=(40, n))
    derivatives[:, 1] = derivatives[:, 0]
    low, high, even = np.full(n, -3.0), np.full(n, 3.0), 1e-6 * np.eye(n)
    share = log(6.0) - 0.5 * log(2.0 * pi)  # of the second one, from bound to bound
    for size in (1e2, 1e4):
        precision = size**2 * derivatives.T @ derivatives + even
        known = -0.5 * float(np.linalg.slogdet(np.delete(np.delete(precision, 1, 0), 1, 1))[1])
        assert log_bounded_integral(np.zeros(n), precision, low, high) == pytest.approx(known + share, abs=0.7)
    assert np.isfinite(log_bounded_integral(np.zeros(n), 1e18 * derivatives.T @ derivatives + even, low, high))


def test_a_precision_for_which_one_way_to_its_eigenvalues_fails():
    """LAPACK's divide and conquer, which `numpy.linalg.eigh` calls, gives up on that of a candidate in the third round."""
    case = np.load(Path(__file__).with_name('eigenvalues_not_converging.npz'))
    whole = -0.5 * float(np.linalg.slogdet(case['precision'])[1])
    found = log_bounded_integral(case['slope'], case['precision'], case['low'], case['high'])
    assert whole - 20.0 < found <= whole
