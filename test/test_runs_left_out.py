"""Which runs a search sees, where it starts, and how well runs that it has not seen are predicted: without simulations."""

from dataclasses import replace
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from test_recordings_in_fits import module_run, problem_of

from sma_sim import Config
from sma_sim.evidence.estimation import calibrate as calibration
from sma_sim.evidence.estimation import cross_validation
from sma_sim.evidence.estimation.calibrate import FitOptions, starting_points
from sma_sim.evidence.estimation.cross_validation import (
    INITIAL_GUESSES,
    RunFit,
    cross_validated,
    folds,
    interpolated,
    left_out_errors,
    pooled_error,
    predict_runs,
    with_starts,
)
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.run_subset import MAX_SUBSET_RUNS, from_subset, run_subset, subset_indices, to_subset
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.solver.simulate import SimulationError


def test_a_subset_is_spread_over_the_runs_from_the_first_to_the_last():
    problem = problem_of(20)
    subset = run_subset(problem)
    assert len(subset.runs) == MAX_SUBSET_RUNS == 8
    assert (subset.runs[0], subset.runs[-1]) == (problem.runs[0], problem.runs[-1])
    z = np.arange(float(len(problem.unknowns)))
    part = to_subset(problem, z)
    for run, at in zip(subset.runs, subset.indices(), strict=True):
        k = problem.runs.index(run)
        assert (part[at] == z[problem.indices()[k]]).all()
    again = from_subset(problem, z, -part)
    assert (again[subset_indices(problem)] == -part).all() and (np.abs(again) == z).all()
    assert (again > 0.0).sum() == len(z) - len(part) and len(run_subset(problem_of(3)).runs) == 3


def test_further_starts_are_spread_about_the_middle_where_runs_can_be_made(monkeypatch):
    problem, asked = problem_of(), []

    def feasible(_, z, __):
        asked.append(z)
        return len(asked) % 3 == 0

    monkeypatch.setattr(calibration, 'feasible', feasible)
    found = starting_points(problem, FitOptions(starts=40, seed=5), None)
    assert len(found) == 40 and not found[0].any() and len(asked) == 3 * 39
    assert np.std([z[:3] for z in asked]) == pytest.approx(0.25, rel=0.15)
    assert (np.array(found[1]) == asked[2]).all()
    asked.clear()
    monkeypatch.setattr(calibration, 'feasible', lambda *_: asked.append(0))
    assert len(starting_points(problem, FitOptions(starts=3), None)) == 1 and len(asked) == 40


def test_every_run_is_left_out_once():
    for count in (2, 5, 13):
        groups = folds(count)
        assert len(groups) == min(count, 5) and sorted(k for group in groups for k in group) == list(range(count))
        assert max(map(len, groups)) - min(map(len, groups)) <= 1
    assert folds(7, 7) == [[k] for k in range(7)]


def test_levels_between_others_judge():
    nan = float('nan')
    assert interpolated({'a': 1.0, 'b': 2.0, 'c': 3.0, 'd': nan}) == ['b', 'd']
    assert interpolated({'a': 1.0, 'b': 1.0, 'c': 3.0}) == ['a', 'b']
    assert interpolated({'a': 1.0, 'b': 2.0}) == ['a', 'b'] == interpolated({'a': nan, 'b': nan})


def test_runs_left_out_are_predicted_by_what_the_others_say(monkeypatch):
    problem = problem_of(3)
    z = np.arange(float(len(problem.unknowns)))
    seen = []

    def minimize(fewer, start, _, __):
        seen.append(([run.name for run in fewer.runs], start.tolist()))
        return SimpleNamespace(config=Config(), delay=0.5, error=2.0)

    def predict(_, out, delay, __, error):
        assert (delay, error) == (0.5, 2.0)
        return tuple(SimpleNamespace(name=run.name, error=float(run.name[-1])) for run in out)

    monkeypatch.setattr(cross_validation, 'minimize', minimize)
    monkeypatch.setattr(cross_validation, 'predict_runs', predict)
    context = SearchContext(None, Event())
    assert left_out_errors(problem, z, context) == {'run0': 0.0, 'run1': 1.0, 'run2': 2.0}
    for names, start in seen:
        kept = [k for k, run in enumerate(problem.runs) if run.name in names]
        own = [x for k in kept for x in problem.indices()[k][3:]]
        assert len(kept) == 2 and start == [0.0, 1.0, 2.0, *own]
    fit = FitResult(problem, z, 1.0)
    assert cross_validated(fit, context).cross_validated_error == pytest.approx(np.sqrt(5.0 / 3.0))
    assert np.isnan(cross_validated(replace(fit, problem=problem_of(1)), context).cross_validated_error)
    monkeypatch.setattr(cross_validation, 'minimize', raising)
    assert cross_validated(fit, context).cross_validated_error == np.inf
    context.stop.set()
    assert np.isnan(cross_validated(fit, context).cross_validated_error)


def raising(*_):
    raise SimulationError('no run')


@pytest.mark.parametrize(
    ('errors', 'expected'), [((1.05, 0.1, 0.2), 1.05), ((3.0, 1.5, 2.0), 1.5), ((3.0, 1.05, 0.2), 1.05)]
)
def test_a_predicted_run_begins_in_several_places_until_one_is_good(monkeypatch, errors, expected):
    tried = []

    def minimize(_, z, *__):
        tried.append(z.tolist())
        return SimpleNamespace(z=z)

    def fitted(_, z, __):
        return (RunFit('run', (), (), (), {}, errors[len(tried) - 1]),)

    monkeypatch.setattr(cross_validation, 'minimize', minimize)
    monkeypatch.setattr(cross_validation, 'run_fits', fitted)
    run = replace(module_run(exact_commands=False), ambient_std=1.0)
    (found,) = predict_runs(Config(), (run,), 0.0, SearchContext(None, Event()))
    assert found.error == expected and len(tried) == (3 if min(errors[:2]) > 1.1 else errors.index(expected) + 1)
    assert [z[:2] for z in tried] == [[guess, guess] for guess in INITIAL_GUESSES[: len(tried)]]
    assert all(z[2:] == [0.0] * 3 for z in tried)
    tried.clear()
    assert predict_runs(Config(), (run,), 0.0, SearchContext(None, Event()), 9.0)[0].error == errors[0] and len(tried) == 1


def test_errors_of_runs_are_pooled_by_channel():
    fits = [
        RunFit('a', (), (0.2, 0.4), (), {'alpha': 3.0, 'F_1': 1.0}, 1.0),
        RunFit('b', (), (0.4, 0.6), (), {'alpha': 4.0}, 1.0),
    ]
    error, by_channel = pooled_error(fits)
    assert by_channel == {'alpha': pytest.approx(np.sqrt(12.5)), 'F_1': 1.0} and error == pytest.approx(np.sqrt(6.75))
    started = with_starts(Config(), (*fits, RunFit('c', (), (), (), {}, 1.0))).parameters
    assert (started['initial.x_M_1'], started['initial.x_M_2']) == pytest.approx((0.3, 0.5))
