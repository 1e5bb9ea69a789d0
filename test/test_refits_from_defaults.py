"""Refits of one wire begin at the defaults of an effect too: where they end does not hang on the shape that was probed."""

from dataclasses import replace
from threading import Event

import pytest
from isobaric_runs import BENCH, isobaric_tests

from sma_sim import FitOptions, read_config
from sma_sim.evidence.estimation.calibrate import problem_for
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.estimation.levenberg_marquardt import start_point
from sma_sim.evidence.estimation.search_context import SearchContext, silent
from sma_sim.evidence.model_selection import refit as refits
from sma_sim.evidence.model_selection.candidates import candidates_for
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.model_selection.sketches import at_defaults, with_candidate

EFFECT = 'stress_dependent_transformation_strain'
# each alone ends elsewhere
SHAPES = ({'k': 1e7, 'sigma_crit': 1.5e8, 'deficit': 0.5}, {'k': 1e7, 'sigma_crit': 0.0, 'deficit': 1.0})


@pytest.fixture(scope='module')
def nominal():
    """The model without effects on isobaric tests at three stresses that are noisier than stated."""
    truth = read_config(words=BENCH, effects=[f'{EFFECT}:deficit=0.8,k=8e7,sigma_crit=5e6'])
    problem = problem_for(isobaric_tests(truth, (7e6, 1.5e8, 2e8)), read_config(words=BENCH), FitOptions(), 1)
    with executor_or_threads(None) as pool:
        context = SearchContext(pool, Event(), silent, (), 0)
        yield refits.refit(problem, start_point(problem), context), context


def screened(fit, values):
    """The effect as a screening would have found it."""
    (candidate,) = [one for one in candidates_for(fit.problem.config) if one.name == EFFECT]
    return ScreeningResult(candidate, 1.0, values, 0.001)


def test_shapes_that_were_probed_do_not_decide_where_a_refit_ends(nominal, monkeypatch):
    fit, context = nominal
    starts, made = [], refits.refit

    def followed(problem, z, *rest):
        starts.append(z - at_defaults(problem))
        return made(problem, z, *rest)

    monkeypatch.setattr(refits, 'refit', followed)
    ends = [refits.best_refits(fit, [screened(fit, values)], context)[0] for values in SHAPES]
    assert sum(not start.any() for start in starts) == len(SHAPES)
    assert ends[0].cost == pytest.approx(ends[1].cost, rel=0.01)
    for end in ends:
        assert end.values_of(EFFECT)['k'] == pytest.approx(8e7, rel=0.15)


def test_effects_that_were_given_stay_where_they_are(nominal):
    fit, _ = nominal
    problem, z = with_candidate(fit, screened(fit, SHAPES[0]))
    free = {one.name: k for k, one in enumerate(problem.free)}
    default = problem.free[free[f'effects.{EFFECT}.deficit']]
    assert default.value(at_defaults(problem)[free[f'effects.{EFFECT}.deficit']]) == pytest.approx(0.7)
    assert not at_defaults(problem)[: len(fit.problem.free)].any() and z[: len(fit.problem.free)].any()
    given = replace(problem, nominal_effects=(EFFECT,))
    assert not at_defaults(given).any()
