"""Isobaric tests are fitted under a tempered likelihood: what the levels leave open stays near its prior."""

from dataclasses import replace
from math import inf
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from isobaric_runs import BENCH, isobaric_tests

from sma_sim import FitOptions, read_config
from sma_sim.evidence.diagnosis.model_stage import with_noise_of_its_size
from sma_sim.evidence.estimation import cross_validation
from sma_sim.evidence.estimation import overdispersion as dispersion
from sma_sim.evidence.estimation.calibrate import problem_for
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.estimation.levenberg_marquardt import accumulated, cost_at, minimize, normal_parts, start_point
from sma_sim.evidence.estimation.overdispersion import overdispersion
from sma_sim.evidence.estimation.problem import residuals_at
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS
from sma_sim.evidence.model_selection.kinetics_choice import better_kinetics
from sma_sim.evidence.model_selection.tempered_likelihood import tempered

ORIENTED, GRADUAL = 'stress_dependent_transformation_strain', 'polycrystal'
TRUTH = [f'{ORIENTED}:deficit=0.8,k=8e7,sigma_crit=5e6', f'{GRADUAL}:spread=8e7']


@pytest.fixture(scope='module')
def gradual():
    """A fit to seven levels whose temperature is off by some kelvins, with the right effects."""
    tests = isobaric_tests(read_config(words=BENCH, effects=TRUTH), np.linspace(7e6, 4e8, 7), error_of_temperature=3.0)
    problem = problem_for(tests, read_config(words=BENCH, effects=[ORIENTED, GRADUAL]), FitOptions(), 1)
    with executor_or_threads(None) as pool:
        context = SearchContext(pool, Event())
        yield minimize(problem, start_point(problem), FROM_PRIORS, context), context


@pytest.mark.parametrize(('rho', 'size'), [(0.0, 1.0), (0.9, 2.0)])
def test_overdispersion_of_correlated_residuals(monkeypatch, rho, size):
    """e sqrt((1 + rho)/(1 - rho)) of an autoregressive series of standard deviation e."""
    random, series = np.random.default_rng(1), np.zeros((1, 20_000))
    for k in range(1, series.size):
        series[0, k] = rho * series[0, k - 1] + np.sqrt(1.0 - rho**2) * random.normal()
    monkeypatch.setattr(dispersion, 'residuals_at', lambda problem, z, pool: [size * series])
    problem = SimpleNamespace(runs=[None], samples=series.size)
    assert overdispersion(problem, None, None) == pytest.approx(size * np.sqrt((1.0 + rho) / (1.0 - rho)), rel=0.1)
    monkeypatch.setattr(dispersion, 'residuals_at', lambda problem, z, pool: [None])
    assert overdispersion(problem, None, None) == inf


@pytest.mark.parametrize('isobaric', [True, False])
def test_each_level_is_left_out_alone(monkeypatch, gradual, isobaric):
    fit, context = gradual
    problem, made = fit.problem, []
    if not isobaric:  # as other tests are
        problem = replace(problem, runs=tuple(replace(run, level=float('nan')) for run in problem.runs))

    def followed(fewer, *rest):
        made.append(len(fewer.runs))
        return minimize(fewer, *rest)

    monkeypatch.setattr(cross_validation, 'minimize', followed)
    errors = cross_validation.left_out_errors(problem, fit.z, context)
    assert set(errors) == {run.name for run in problem.runs}
    assert sorted(made) == ([6] * 7 if isobaric else [5, 5, 6, 6, 6])


@pytest.fixture(scope='module')
def astray(gradual):
    """A fit that went where data say least: high stresses say nothing of the strain at low ones."""
    fit, context = gradual
    problem = replace(fit.problem, runs=fit.problem.runs[3:])
    hessian = accumulated(normal_parts(problem, fit.z, context.pool), fit.z, 1.0)[2]
    weakest = np.linalg.eigh(hessian)[1][:, 0]
    away = np.clip(fit.z + 2.0 * np.sign(weakest @ fit.z) * weakest, *problem.limits())
    return replace(fit, problem=problem, z=away, cost=cost_at(problem, away, context.pool)), context


def test_what_data_leave_open_goes_back_to_its_prior(astray):
    """The cost is half the squares and k^2 times half the prior's, k being the overdispersion."""
    fit, context = astray
    found = tempered(fit, context)
    k = overdispersion(fit.problem, fit.z, context.pool)
    assert found.problem.tempering == k > 2.0
    squares = sum(float(np.vdot(run, run)) for run in residuals_at(found.problem, found.z, context.pool))
    assert found.squares == pytest.approx(squares)
    assert found.cost == pytest.approx(0.5 * squares + 0.5 * k**2 * float(found.z @ found.z))
    assert found.cost < cost_at(found.problem, fit.z, context.pool)
    assert np.linalg.norm(found.z) < 0.8 * np.linalg.norm(fit.z) and found.error < 1.05 * fit.error


def test_a_tempered_fit_of_weighted_residuals_is_the_same(gradual):
    """Squares over k^2 beside the priors are squares beside k^2 times the priors."""
    fit, context = gradual
    found = tempered(fit, context)
    k = found.problem.tempering
    weighted = replace(found.problem.weighted(1.0 / k), tempering=1.0)
    assert k**2 * cost_at(weighted, found.z, context.pool) == pytest.approx(found.cost)


def test_the_last_fit_has_noise_of_the_size_of_what_it_leaves(gradual):
    fit, context = gradual
    assert with_noise_of_its_size(fit) is fit
    found = tempered(fit, context)
    assert with_noise_of_its_size(found).problem.tempering == found.error < found.problem.tempering


def test_it_is_no_question_of_other_tests(gradual):
    fit, context = gradual
    other = replace(fit.problem, runs=tuple(replace(run, level=float('nan')) for run in fit.problem.runs))
    astray = replace(fit, problem=other)
    assert tempered(astray, context) is astray


def test_rates_have_no_time_in_isobaric_tests(gradual):
    fit, context = gradual
    assert fit.error > 1.1 and better_kinetics(fit, context) is fit
