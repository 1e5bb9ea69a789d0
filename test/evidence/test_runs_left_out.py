"""Which runs a search sees, where it starts, and how well runs that it has not seen are predicted: without simulations."""

import math
from dataclasses import replace
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from test_recordings_in_fits import module_run, problem_of

from sma_sim import Config, Dataset, Recording, module_input
from sma_sim.evidence.estimation import calibrate as calibration
from sma_sim.evidence.estimation import held_out_prediction
from sma_sim.evidence.estimation.calibrate import FitOptions, StartingPoint, with_starts
from sma_sim.evidence.estimation.curve_features import CurveFeatures
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.held_out_prediction import (
    INITIAL_GUESSES,
    RunFit,
    pooled_error,
    predict_runs,
)
from sma_sim.evidence.estimation.prepared_fit import PreparedFit
from sma_sim.evidence.estimation.problem import start_point
from sma_sim.evidence.estimation.run_subset import MAX_SUBSET_RUNS, on_all_runs, run_subset, to_subset
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS, WEAKLY_DAMPED
from sma_sim.solver.beginning import Beginning
from sma_sim.words.fit_remarks import kinetics_sentence


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
    again = on_all_runs(FitResult(subset, -part, 0.0), problem, z)
    assert (to_subset(problem, again) == -part).all() and (np.abs(again) == z).all()
    assert (again > 0.0).sum() == len(z) - len(part) and len(run_subset(problem_of(3)).runs) == 3


def test_further_starts_are_spread_about_the_middle_where_runs_can_be_made(monkeypatch):
    problem, asked = problem_of(), []

    def feasible(_, z, __):
        asked.append(z)
        return len(asked) % 3 == 0

    monkeypatch.setattr(calibration, 'feasible', feasible)
    found = [point.z for point in calibration.starting_points(problem, {}, 40, 5, None)]
    assert len(found) == 40 and not found[0].any() and len(asked) == 3 * 39
    assert np.std([z[:3] for z in asked]) == pytest.approx(0.25, rel=0.15)
    assert (np.array(found[1]) == asked[2]).all()
    asked.clear()
    monkeypatch.setattr(calibration, 'feasible', lambda *_: asked.append(0))
    assert len(calibration.starting_points(problem, {}, 3, 0, None)) == 1 and len(asked) == 40


def test_what_curves_show_is_the_second_start_where_that_is_elsewhere(monkeypatch):
    problem = problem_of()
    monkeypatch.setattr(calibration, 'feasible', lambda *_: True)
    free = problem.free[1]
    for z, count in ((0.2, 0), (-1.5, 1), (1e3, 1)):  # as near as a random one; elsewhere; beyond the bounds
        found = calibration.starting_points(problem, {free.name: free.value(min(z, 20.0)), 'wire.n': 7.0}, 2, 0, None)
        assert len(found) == 2 and not found[0].z.any()
        expected = np.zeros(len(found[1].z))
        expected[1] = np.clip(z, free.low, free.high)
        assert bool(found[1].z == pytest.approx(expected)) == bool(count)


def test_runs_in_motion_are_also_fitted_from_either_end_of_the_hysteresis(monkeypatch):
    """Whose wires are as warm as in the middle of the priors; from there a fit ended 60 nats above the true valley."""
    problem = problem_of()
    monkeypatch.setattr(calibration, 'feasible', lambda *_: True)
    runs = tuple(replace(run, beginning_std=Beginning((40.0, 40.0), (0.1,), (0.1,))) for run in problem.runs)
    moving = replace(problem, runs=runs)
    middle, low, high = (point.z for point in calibration.starting_points(moving, {}, 2, 0, None))
    begins = np.array([unknown.name == 'start' for unknown in moving.unknowns])
    assert (middle == start_point(moving)).all() and not middle[begins].any()
    assert (low == np.where(begins, -0.9, middle)).all() and (high == np.where(begins, 0.9, middle)).all()
    assert len(calibration.starting_points(problem, {}, 2, 0, None)) == 2


def test_data_take_over_from_the_priors_gradually(monkeypatch):
    problem, factors = problem_of(), []

    def minimized(weighted, z, *_):
        factors.append(weighted.runs[0].weight.max() / problem.runs[0].weight.max())
        return FitResult(weighted, z + 1.0, 5.0, 3)

    monkeypatch.setattr(calibration, 'minimize', minimized)
    point = StartingPoint(np.zeros(4), calibration.GRADUALLY)
    found = calibration.minimized_from(point, problem, FROM_PRIORS, SearchContext(None, Event()), '')
    assert factors == pytest.approx(calibration.GRADUALLY) and factors[-1] == 1.0
    assert found.problem is problem and found.iterations == 12 and (found.z == 4.0).all()


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

    monkeypatch.setattr(held_out_prediction, 'minimize', minimize)
    monkeypatch.setattr(held_out_prediction, 'run_fits', fitted)
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


def fit_of(problem, error, cost=1.0, model='hybrid'):
    """A fit with this normalized RMSE, at z = 0."""
    problem = replace(problem, config=replace(problem.config, kinetics=model))
    z = np.zeros(len(problem.unknowns))
    return FitResult(problem, z, 0.5 * problem.samples * error**2 if cost is None else cost, 3)


def test_each_start_is_minimised_and_others_are_said_beside_the_best(monkeypatch):
    """All but the first damped less; runs beyond a subset join where it has ended."""
    problem, made, labels = problem_of(10), [], []

    def minimized(subset, z, criteria, _, label):
        made.append((len(subset.runs), criteria.damping, float(z[0])))
        labels.append(label)
        return FitResult(subset, z + 1.0, {0.0: 7.5 + 2.0, 0.1: 7.5, 0.2: 6.0}[float(z[0])], 4)

    def starts(subset, shown, count, *_):
        return [StartingPoint(np.full(len(subset.unknowns), 0.1 * k)) for k in range(count)]

    def continued(fit, whole, z, criteria, _, label):
        made.append((len(whole.runs), criteria.damping, label))
        return replace(fit, problem=whole, z=z, iterations=11)

    monkeypatch.setattr(calibration, 'problem_for', lambda *_: problem)
    monkeypatch.setattr(calibration, 'starting_points', starts)
    monkeypatch.setattr(calibration, 'minimize', minimized)
    monkeypatch.setattr(calibration, 'continued_fit', continued)
    monkeypatch.setattr(calibration, 'overdispersion', lambda *_: 2.0)
    rest = module_input([0.0, 9.0], [0.0, 0.0])
    recordings = tuple(Recording(f'run{k}', 'module', np.arange(10.0), {}, rest) for k in range(10))
    context = SearchContext(None, Event())
    found = calibration.multistart_search(start_of(Dataset(recordings)), FitOptions(starts=3), context)
    assert sorted(made[:3], key=lambda one: one[2]) == [
        (8, FROM_PRIORS.damping, 0.0),
        (8, WEAKLY_DAMPED.damping, 0.1),
        (8, WEAKLY_DAMPED.damping, 0.2),
    ]
    assert sorted(labels) == [f'hybrid, start {k}' for k in (1, 2, 3)]
    assert made[3:] == [(10, calibration.JOINING_DAMPING, 'all runs')] and found.iterations == 11
    assert found.z[:3].tolist() == [1.1] * 3 and len(found.problem.runs) == 10
    others = [(round(other.excess, 9), other.same, round(other.log_odds, 9)) for other in found.other_starts]
    assert others == [(2.0, False, 0.5), (-1.5, True, -0.375)]


@pytest.mark.parametrize(
    ('errors', 'stages'), [((0.2,), 1), ((0.05, 0.02, 1.0), 2), ((0.05, 0.001, 0.0001, 0.0), 4), ((0.05, 0.011, 0.5), 2)]
)
def test_where_the_error_is_far_below_the_noise_weights_grow(monkeypatch, errors, stages):
    """Ten, a hundred, a thousand times, as long as it stays a tenth of them; the cost is under the weights as they were."""
    problem, weights, left = problem_of(1), [], list(errors)

    def continued(fit, given, z, criteria, _, label):
        weights.append(given.runs[0].weight.max() / problem.runs[0].weight.max())
        return fit_of(given, left.pop(0), None)

    monkeypatch.setattr(calibration, 'full_problem', lambda *_: problem)
    monkeypatch.setattr(calibration, 'continued_fit', continued)
    monkeypatch.setattr(calibration, 'cost_at', lambda given, *_: 0.5 * given.samples * errors[len(weights) - 1] ** 2)
    found = calibration.final_fit(None, fit_of(problem, 1.0), FitOptions(), SearchContext(None, Event()))
    assert weights == pytest.approx([1.0, 10.0, 100.0, 1000.0][:stages])
    assert (
        found.error == pytest.approx(errors[stages - 1])
        and found.problem.runs[0].weight.max() == problem.runs[0].weight.max()
    )
    assert found.problem.config.parameters['solver.rtol'] == (1e-6 if stages == 1 else 1e-7)


def start_of(dataset, kinetics=('hybrid', 'mas')):
    """What a fit of a module without tests of its wires begins with."""
    return PreparedFit(dataset, Config(), CurveFeatures(()), kinetics)


@pytest.mark.parametrize(
    ('evidences', 'taken', 'kinetics'),
    [((-10.0, -30.0), 'hybrid', 'hybrid'), ((-30.0, -10.0), 'mas', 'mas'), ((-11.0, -10.0), 'hybrid', 'auto')],
)
def test_of_two_kinetics_the_more_probable_ones_are_taken(monkeypatch, evidences, taken, kinetics):
    problem, tried = problem_of(2), []

    def search(start, _, __):
        config = start.config
        tried.append(config.simulated_kinetics)
        return fit_of(
            replace(problem, config=config), 1.0, {'hybrid': 5.0, 'mas': 4.0}[config.kinetics], model=config.kinetics
        )

    monkeypatch.setattr(calibration, 'multistart_search', search)
    monkeypatch.setattr(calibration, 'log_evidences', lambda fits, _: evidences)
    found, probabilities = calibration.fit_with_kinetics(start_of(None), FitOptions(), SearchContext(None, Event()))
    assert tried == ['hybrid', 'mas'] and (found.config.simulated_kinetics, found.config.kinetics) == (taken, kinetics)
    odds = math.exp(evidences[1] - evidences[0])
    assert probabilities['mas'] == pytest.approx(odds / (1.0 + odds)) and sum(probabilities.values()) == pytest.approx(1.0)
    one, none = calibration.fit_with_kinetics(start_of(None, ('mas',)), FitOptions(), SearchContext(None, Event()))
    assert one.config.simulated_kinetics == 'mas' and not none
    stopped = SearchContext(None, Event())
    stopped.stop.set()
    found, unknown = calibration.fit_with_kinetics(start_of(None), FitOptions(), stopped)
    assert (found.config.kinetics, unknown) == ('auto', {})
    assert kinetics_sentence(found.config, unknown) == (
        'kinetics: none were given, and the fit was stopped before it could tell; hybrid was taken'
    )
