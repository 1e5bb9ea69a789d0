"""Recordings that begin in motion: a fit leaves the valleys in which single ones of them lie."""

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest

from sma_sim import Config, Dataset, FitOptions, calibrate
from sma_sim.evidence.estimation.beginnings import is_apart, other_beginnings, with_better_beginnings
from sma_sim.evidence.estimation.calibrate import problem_for
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.problem import start_point
from sma_sim.evidence.estimation.search_context import SearchContext

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'benchmarks'))
import intervals

RATE, BEGIN, SEED = 25.0, 33.3, 424


def recordings(begin, count=3, rate=RATE):
    """Recordings of a robot from a time [s] on."""
    truth = intervals.true_config(SEED, 'mas')
    made = [intervals.recorded(truth, SEED, run, rate) for run in range(count)]
    return Dataset(tuple(intervals.cut(one, begin) if begin else one for one in made), intervals.NOISE), truth


def middle_of(dataset):
    """The middle of all priors as a fit."""
    problem = problem_for(dataset, Config(kinetics='mas'), FitOptions(), 10)
    return FitResult(problem, start_point(problem), np.inf, 0, False)


def test_what_begins_at_rest_stays_as_it_is():
    with ThreadPoolExecutor(2) as pool:
        fit = middle_of(recordings(0.0, 1)[0])
        assert with_better_beginnings(fit, SearchContext(pool, Event()), '') is fit


def test_a_recording_alone_comes_to_other_beginnings():
    """Its own unknowns alone move: from either end of the hysteresis of each wire, to optima that differ."""
    with ThreadPoolExecutor(2) as pool:
        fit = middle_of(recordings(BEGIN, 2, 5.0)[0])
        found = other_beginnings(fit, 1, SearchContext(pool, Event()))
    own = len(fit.problem.own(fit.problem.runs[1]))
    assert found and all(one.run == 1 and one.z.shape == (own,) and np.isfinite(one.more) for one in found)
    ends = [SimpleNamespace(z=one.z) for one in found]
    assert all(is_apart(one, [other for other in ends if other is not one]) for one in ends)


@pytest.mark.slow
def test_a_fit_comes_down_to_what_the_truth_costs():
    """26 nats above it in the valley in which all recordings begin alike, with a damping of twice the true one."""
    dataset, truth = recordings(BEGIN)
    found = calibrate(dataset, Config(), FitOptions(kinetics='mas'))
    at_truth = calibrate(dataset, truth, FitOptions(kinetics='mas', free=('beam.b_x',), intervals=False))
    assert found.cost < at_truth.cost + 2.0
    interval = found.intervals['beam.b_y']
    assert interval.low < truth.parameters['beam.b_y'] < interval.high
