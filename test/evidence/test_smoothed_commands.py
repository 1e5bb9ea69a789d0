"""Fits to runs whose command changes at every moment: trial steps under the smoothed command, corrected by what it lacks."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Event

import numpy as np
import pytest
from closed_loops import closed_loop
from systems import active, make_model

from sma_sim import Dataset, FitOptions, Recording, module_input, simulate
from sma_sim.evidence.estimation import residuals
from sma_sim.evidence.estimation.calibrate import FINAL_RTOL, calibrate, checked_nearby, final_fit, problem_for
from sma_sim.evidence.estimation.levenberg_marquardt import minimize
from sma_sim.evidence.estimation.problem import cost_at, linearize, near, near_point, residuals_at, start_point
from sma_sim.evidence.estimation.residuals import (
    LACKING,
    Nuisance,
    fit_data,
    leeway_for,
    smoothed_residuals,
    weighted_residuals,
)
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import ALL_SAMPLES, FROM_PRIORS, SETTLED
from sma_sim.evidence.estimation.uncertainty import checked_by_runs, information_of, uncertainty
from sma_sim.solver.model import Model
from sma_sim.words.fit_remarks import remarks_on

DURATION = 20.0
NOISE = {'U_y': 2e-5, 'alpha': 3.5e-4, 'F_1': 0.05, 'F_2': 0.05}
NAMES = ('wire.c_V', 'wire.lambda', 'wire.E_A', 'beam.E')


def dataset_of(model, source, seed=0):
    times, random = np.linspace(0.0, DURATION, 501), np.random.default_rng(seed)
    shown = simulate(model, source, times)
    columns = dict(zip(NOISE, ('U_y_m', 'alpha_rad', 'F_1_N', 'F_2_N'), strict=True))
    channels = {name: shown[columns[name]] + std * random.standard_normal(501) for name, std in NOISE.items()}
    return Dataset((Recording('run', 'module', times, channels, source),), NOISE)


def fitted_loop(kind):
    model = make_model('module', kind)
    return model, dataset_of(model, closed_loop(model, DURATION, 0, per_scale=40.0))


@pytest.fixture
def pool():
    with ThreadPoolExecutor(1) as threads:
        yield threads


@pytest.fixture
def row_by_row(monkeypatch):
    """Of every run whether it is made row by row."""
    made, run = [], residuals.channels_of_all

    def heard(*given):
        made.append(given[-1] is None)
        return run(*given)

    monkeypatch.setattr(residuals, 'channels_of_all', heard)
    return made


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_trial_steps_are_exact_where_they_begin_and_nearly_so_beside(kind, pool):
    """Residuals are those of the run row by row; the error beside is a small part of what changes."""
    model, dataset = fitted_loop(kind)
    problem = problem_for(dataset, model.config, FitOptions(), 1)
    z = start_point(problem) + 0.05
    (linear,) = linearize(problem, z, pool)
    nearby = near(problem, [linear.correction])
    (here,), (trial,) = residuals_at(problem, z, pool), residuals_at(nearby, z, pool)
    assert np.abs(linear.correction).max() > 0.1
    assert np.array_equal(linear.residuals, here) and np.abs(trial - here).max() < 1e-9
    (again,) = linearize(nearby, z, pool)
    assert np.array_equal(again.residuals, trial) and np.abs(again.correction - linear.correction).max() < 1e-9
    assert np.array_equal(near_point(problem, z, pool).runs[0].correction, linear.correction)
    (there,), (beside,) = residuals_at(problem, z + 0.02, pool), residuals_at(nearby, z + 0.02, pool)
    change = np.sqrt(np.mean((there - here) ** 2))
    assert change > 1.0 and np.sqrt(np.mean((beside - there) ** 2)) < 0.01 * change


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_fits_end_where_they_end_row_by_row(kind, pool, row_by_row):
    """A search so near, or lower, that the score tells no difference, the last fit to what its criteria leave open; the ends
    of intervals are checked by few runs row by row, and are the same."""
    model, dataset = fitted_loop(kind)
    options, context = FitOptions(free=NAMES), SearchContext(pool, Event())
    problem = problem_for(dataset, model.config, options, 1)
    rows = replace(problem, runs=tuple(replace(run, leeway=None) for run in problem.runs))
    assert problem.runs[0].leeway is not None
    fits = [minimize(one, start_point(one) + 0.2, FROM_PRIORS, context) for one in (problem, rows)]
    assert fits[0].cost < fits[1].cost + 0.3 and fits[0].problem is problem
    assert fits[0].cost == pytest.approx(cost_at(problem, fits[0].z, pool), abs=0.3)
    last = final_fit(dataset, fits[0], options, context)
    by_rows = minimize(last.problem, fits[1].z, ALL_SAMPLES, context)
    assert last.problem.runs[0].leeway is None and last.cost < by_rows.cost + 0.03
    (run,) = linearize(last.problem, last.z, pool)
    jacobian = run.jacobian.reshape(len(last.z), -1)
    stds = np.sqrt(np.diag(np.linalg.inv(jacobian @ jacobian.T + np.eye(len(jacobian)))))
    assert (np.abs(last.z - by_rows.z) < 0.3 * stds).all()
    informations = [information_of(last.problem.runs[0], run, False)]
    known = uncertainty(last.problem, last.z, informations)
    row_by_row.clear()
    checked = checked_nearby(known, last, informations, pool)
    assert row_by_row.count(True) == 2 and row_by_row.count(False) > 2
    assert checked == checked_by_runs(known, last.problem, last.z, informations, pool)


def test_small_steps_of_a_fit_keep_what_lines_lack(pool, row_by_row):
    """Towards its end no run row by row is made."""
    model, dataset = fitted_loop('mas')
    problem = problem_for(dataset, model.config, FitOptions(free=NAMES), 1)
    row_by_row.clear()
    found = minimize(problem, start_point(problem) + 0.2, SETTLED, SearchContext(pool, Event()))
    assert row_by_row.count(True) <= found.iterations  # which are one less than linearisations
    assert found.cost == pytest.approx(cost_at(problem, found.z, pool), abs=0.3)


def test_delay_and_starts_alone_are_not_estimated_row_by_row(pool):
    """Beside a model whose parameters are kept: one minimisation comes as near as the last fit leaves open, at the tolerance
    of the runs that are shown, and no remark says that a smaller one could not be kept."""
    model, dataset = fitted_loop('hybrid')
    options, context, iterations = FitOptions(free=()), SearchContext(pool, Event()), []
    problem = problem_for(dataset, model.config, options, 1)
    found = minimize(problem, start_point(problem), FROM_PRIORS, context)
    heard = replace(context, on_iteration=lambda _, iteration, __: iterations.append(iteration))
    last = final_fit(dataset, found, options, heard)
    assert iterations.count(0) == 1 and last.problem.runs[0].leeway is None
    by_rows = minimize(last.problem, found.z, ALL_SAMPLES, context)
    assert last.cost < by_rows.cost + 0.03 and np.abs(last.delay - by_rows.delay) < 1e-3
    assert last.problem.config.parameters['solver.rtol'] == model.config.parameters['solver.rtol']
    finer = minimize(last.problem.at_tolerance(FINAL_RTOL), found.z, ALL_SAMPLES, context)
    assert last.cost == pytest.approx(finer.cost, rel=1e-3) and last.delay == pytest.approx(finer.delay, abs=1e-4)
    remarks = remarks_on(calibrate(dataset, model.config, options, pool))
    assert not any('tolerance' in remark for remark in remarks)


def test_commands_are_smoothed_as_far_as_noise_hides_it(pool):
    """Of recordings without noise they are not, where that would be felt and gains no time."""
    model, dataset = fitted_loop('hybrid')
    run = fit_data(dataset.recordings[0], NOISE)
    leeway = leeway_for(model.config, run)
    finer = leeway_for(model.config, replace(run, weight=4.0 * run.weight))
    assert finer is None or finer.heat < 0.5 * leeway.heat
    assert leeway_for(model.config, replace(run, weight=1e3 * run.weight)) is None
    lacking = weighted_residuals(model, run) - smoothed_residuals(model, replace(run, leeway=leeway), Nuisance())
    assert 0.01 < np.sqrt(np.mean(lacking**2, axis=1)).max() < 1.5 * LACKING


def test_few_rows_are_never_smoothed(pool):
    model = make_model()
    problem = problem_for(
        dataset_of(model, module_input([0.0, 5.0, 12.0, 20.0], [0.0, 9.0, -9.0, 0.0])), model.config, FitOptions(), 1
    )
    linear = linearize(problem, start_point(problem), pool)
    assert linear[0].correction is None and near(problem, [None]) is problem


def test_what_a_line_does_not_pass_is_run_row_by_row():
    """A threshold of a heating that depends on the wire, in a fit whose corrections are those of a driver without."""
    model, dataset = fitted_loop('hybrid')
    (run,) = problem_for(dataset, model.config, FitOptions(), 1).runs
    other = Model(model.config.variant(effects=(active('driver_deadband'), active('resistance_feedback'))))
    corrected = replace(run, correction=np.ones_like(run.measured))
    assert smoothed_residuals(other, run, Nuisance()) is None
    assert np.array_equal(weighted_residuals(other, corrected), weighted_residuals(other, run))
    difference = weighted_residuals(model, corrected) - smoothed_residuals(model, run, Nuisance())
    assert difference == pytest.approx(1.0)
