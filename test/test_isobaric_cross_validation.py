"""Levels of isobaric tests are left out one by one, and what the others leave open stays near its prior."""

from dataclasses import replace
from math import inf
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from isobaric_runs import BENCH, isobaric_tests

from sma_sim import FitOptions, read_config
from sma_sim.evidence.estimation import cross_validation
from sma_sim.evidence.estimation import overdispersion as dispersion
from sma_sim.evidence.estimation.calibrate import problem_for
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.estimation.levenberg_marquardt import accumulated, cost_at, minimize, normal_parts, start_point
from sma_sim.evidence.estimation.overdispersion import overdispersion
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import ADDED_EFFECT, FROM_PRIORS
from sma_sim.evidence.model_selection.kinetics_choice import better_kinetics
from sma_sim.evidence.model_selection.tempered_likelihood import nearest_to_priors

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
def test_each_level_is_left_out_alone_under_a_tempered_likelihood(monkeypatch, gradual, isobaric):
    fit, context = gradual
    problem, made = fit.problem, []
    if not isobaric:  # as other tests are
        problem = replace(problem, runs=tuple(replace(run, level=float('nan')) for run in problem.runs))

    def followed(fewer, *rest):
        made.append((len(fewer.runs), float(fewer.runs[0].weight.max() / problem.runs[0].weight.max())))
        return minimize(fewer, *rest)

    monkeypatch.setattr(cross_validation, 'minimize', followed)
    errors = cross_validation.left_out_errors(problem, fit.z, context)
    tempering = overdispersion(problem, fit.z, context.pool)
    assert set(errors) == {run.name for run in problem.runs} and tempering > 2.0
    kept, part = zip(*made, strict=True)
    assert sorted(kept) == ([6] * 7 if isobaric else [5, 5, 6, 6, 6])
    assert np.array(part) == pytest.approx(1.0 / tempering if isobaric else 1.0)


def test_what_data_leave_open_goes_back_to_its_prior(gradual):
    """Along the direction that data determine least, the optimum nearest to the priors is found again."""
    fit, context = gradual
    problem = replace(fit.problem, runs=fit.problem.runs[3:])  # high stresses say nothing of the strain at low ones
    fit = minimize(problem, fit.z, ADDED_EFFECT, context)
    _, _, hessian = accumulated(normal_parts(problem, fit.z, context.pool), fit.z)
    weakest = np.linalg.eigh(hessian)[1][:, 0]
    weakest *= np.sign(weakest @ fit.z)
    away = np.clip(fit.z + 2.0 * weakest, *problem.limits())
    astray = replace(fit, z=away, cost=cost_at(problem, away, context.pool))
    found = nearest_to_priors(astray, context)
    assert found.error <= 1.01 * astray.error and found.cost == pytest.approx(cost_at(problem, found.z, context.pool))
    assert np.linalg.norm(found.z) < 0.8 * np.linalg.norm(away)


def test_it_is_no_question_of_other_tests(gradual):
    fit, context = gradual
    other = replace(fit.problem, runs=tuple(replace(run, level=float('nan')) for run in fit.problem.runs))
    assert nearest_to_priors(replace(fit, problem=other), context).z is fit.z


def test_rates_have_no_time_in_isobaric_tests(gradual):
    fit, context = gradual
    assert fit.error > 1.1 and better_kinetics(fit, context) is fit
