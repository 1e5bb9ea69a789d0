"""Of many runs a part is searched first: nothing is lost by it."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from simulated_data import config, dataset, scaled

from sma_sim import FitOptions, calibrate, find_effects
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation import run_subset
from sma_sim.evidence.estimation.calibrate import SAME_OPTIMUM, problem_for
from sma_sim.evidence.estimation.executors import in_turn
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.run_subset import on_all_runs, to_subset
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest

FEW = FitOptions(free=('wire.lambda', 'beam.E'), kinetics='mas', starts=1, intervals=False)
TRUTH = scaled(config('mas'), wire__lambda=1.1, beam__E=0.95)


@pytest.fixture(scope='module')
def many():
    """Six runs."""
    return dataset(TRUTH, range(1, 7), noise=1.0, rate=2.0)


@pytest.fixture(autouse=True)
def some_are_many(monkeypatch):
    """A part of three."""
    monkeypatch.setattr(run_subset, 'MAX_SUBSET_RUNS', 3)


def test_the_part_is_spread_over_the_runs_and_finds_its_place_again(many):
    problem = problem_for(many, config(), FEW, 1)
    part, z = run_subset.run_subset(problem), np.random.default_rng(1).normal(size=len(problem.unknowns))
    names = [run.name for run in part.runs]
    assert len(names) == 3 and names[0] == problem.runs[0].name and names[-1] == problem.runs[-1].name
    small = to_subset(problem, z)
    assert len(small) == len(part.unknowns) and np.array_equal(on_all_runs(FitResult(part, small, 0.0), problem, z), z)
    changed = on_all_runs(FitResult(part, small + 1.0, 0.0), problem, z)
    assert np.count_nonzero(changed != z) == len(small)
    for run, own in zip(part.runs, part.indices(), strict=True):
        k = [one.name for one in problem.runs].index(run.name)
        assert np.array_equal(z[problem.indices()[k]], small[own])


def test_few_runs_are_searched_all():
    problem = problem_for(dataset(TRUTH, [1, 2, 3], rate=2.0), config(), FEW, 1)
    assert [run.name for run in run_subset.run_subset(problem).runs] == [run.name for run in problem.runs]


def test_a_calibration_of_many_runs_ends_where_one_of_all_at_once_does(many, monkeypatch):
    found = calibrate(many, config(), FEW)
    monkeypatch.setattr(run_subset, 'MAX_SUBSET_RUNS', 100)
    at_once = calibrate(many, config(), FEW)
    assert abs(found.cost - at_once.cost) < 0.1 * SAME_OPTIMUM  # descents end where the next step is predicted to gain less
    for name, value in at_once.values.items():
        assert found.values[name] == pytest.approx(value, rel=2e-3)


def test_runs_are_linearized_a_few_at_a_time():
    """So that memory does not grow with the number of runs: what is reduced as it comes is not kept."""
    under_way, most = set(), 0

    class Counting(ThreadPoolExecutor):
        def submit(self, together, work, tasks):
            nonlocal most
            under_way.update(tasks)
            most = max(most, len(under_way))
            return super().submit(together, work, tasks)

    with Counting(2) as pool:
        found = []
        for result in in_turn(pool, lambda task: task**2, range(50)):
            under_way.remove(len(found))
            found.append(result)
    assert found == [k**2 for k in range(50)] and most <= 4 and not under_way


@pytest.mark.slow
def test_a_hidden_effect_is_found_in_many_runs():
    robot = with_effect(TRUTH, find_effects()['gravity'], {'g_y': -9.81})
    runs = dataset(robot, range(1, 5), noise=1.0, rate=2.0)
    request = DiagnosisRequest('mas', options=replace(FEW, free=None), equation=False)
    found = diagnose(runs, config(), request=request)
    assert found.effects == ('gravity',) and found.stages[-1].train < 1.15
    assert found.selection_steps[0].candidate_fits[0].fit.problem.runs == found.selection_steps[0].base.problem.runs
