"""Intervals that promise no more than the recordings say, and limits that are said and moved."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from isobaric_runs import BENCH as ISOBARIC
from isobaric_runs import isobaric_tests
from simulated_data import config, dataset, scaled
from test_fit_statistics import A, informations_of, linear_of, problem_of
from test_recordings_in_fits import module_run
from test_recordings_in_fits import problem_of as module_problem

from sma_sim import FitOptions, calibrate, find_effects, read_config
from sma_sim.evidence.diagnosis import conclusion
from sma_sim.evidence.estimation.calibrate import (
    LimitReached,
    limits_from,
    limits_reached,
    multistart_search,
    within_limits,
)
from sma_sim.evidence.estimation.fit_result import FitResult, OtherStart
from sma_sim.evidence.estimation.free_parameters import BOUND_STDS, free_parameter
from sma_sim.evidence.estimation.held_out_prediction import RunFit, pooled_error
from sma_sim.evidence.estimation.levenberg_marquardt import refit
from sma_sim.evidence.estimation.prepared_fit import prepare
from sma_sim.evidence.estimation.problem import LinearizedRun, cost_of, costs_at, residuals_at
from sma_sim.evidence.estimation.residuals import Nuisance, compared
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import SETTLED
from sma_sim.evidence.estimation.uncertainty import (
    RULED_OUT,
    Interval,
    checked_by_runs,
    interval,
    uncertainty,
    with_other_minima,
)
from sma_sim.evidence.model_selection.candidates import candidate_of
from sma_sim.evidence.model_selection.model_changes import with_candidate
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.model.errors import UserError
from sma_sim.model.program_parameters import DEFAULTS
from sma_sim.words.fit_remarks import other_minima, remarks_on

SMOOTH = 'smooth_transformation:width_A=1e8,width_M=8e7'
ORIENTED = 'stress_dependent_transformation_strain:deficit=0.9,k=8e7'


def autoregressive(random, shape, memory):
    """Residuals of unit size that stay correlated over (1 + memory)/(1 - memory) samples."""
    rows = np.empty(shape)
    rows[:, 0] = random.normal(size=shape[0])
    for k in range(1, shape[1]):
        rows[:, k] = memory * rows[:, k - 1] + np.sqrt(1.0 - memory**2) * random.normal(size=shape[0])
    return rows


@pytest.mark.parametrize(('size', 'memory'), [(1.0, 0.0), (14.0, 0.0), (5.0, 0.9)])
def test_coverage_of_a_linear_model_whose_residuals_are_not_the_stated_noise(size, memory):
    """Slow sensitivities, as those of parameters are: the case in which correlation counts."""
    problem, random = problem_of(runs=1), np.random.default_rng(4)
    prior = np.where(np.arange(len(problem.unknowns)) < 2, BOUND_STDS**-2.0, 1.0)
    inside = []
    for seed in range(150):
        (run,) = linear_of(problem, seed)
        slow = autoregressive(random, (run.jacobian.shape[0] * run.jacobian.shape[1], run.jacobian.shape[2]), 0.97)
        jacobian = slow.reshape(run.jacobian.shape)
        noise = size * autoregressive(random, run.residuals.shape, memory)
        flat = jacobian.reshape(len(jacobian), -1)
        z = -np.linalg.solve(flat @ flat.T + np.diag(prior), flat @ noise.ravel())  # the truth is 0
        left = noise + np.tensordot(z, jacobian, 1)
        found = uncertainty(problem, z, informations_of(problem, [replace(run, jacobian=jacobian, residuals=left)]))
        inside += [one.low <= free.value(0.0) <= one.high for one, free in zip(found.intervals, problem.free, strict=True)]
    assert 0.88 <= np.mean(inside) <= 0.995


def test_what_a_misfit_leaves_of_a_parameter_is_not_seen():
    """Seen at the stated noise; with forty times of it, all the same value, nothing narrows the prior."""
    problem = problem_of(runs=1)
    (run,) = linear_of(problem, size=0.05)
    z = np.zeros(len(problem.unknowns))
    assert all(one.seen for one in uncertainty(problem, z, informations_of(problem, [run])).intervals)
    slow = 40.0 * np.sin(np.linspace(0.0, 9.0, run.residuals.shape[1])) * np.ones_like(run.residuals)
    found = uncertainty(problem, z, informations_of(problem, [replace(run, residuals=slow)]))
    assert not any(one.seen for one in found.intervals) and len(found.unseen) == 2


def test_no_interval_passes_a_bound():
    near = interval(A, 4.9, 0.3, True)
    assert near.seen and near.high == A.value(A.high) and near.low == pytest.approx(A.value(4.9 - 1.96 * 0.3), rel=1e-3)


def test_other_minima_are_part_of_an_interval_or_said():
    problem = problem_of(runs=1)
    known = uncertainty(problem, np.zeros(len(problem.unknowns)), informations_of(problem, linear_of(problem)))
    a, b = known.intervals
    values = {'a': 3.0 * a.value, 'b': b.value}
    near, far, ruled_out = (OtherStart(1e3, values, False, odds) for odds in (0.9 * RULED_OUT, 1.1 * RULED_OUT, 8.0))
    wide, same = with_other_minima(known, [near]).intervals
    assert (wide.low, wide.high) == (a.low, values['a']) and same == b
    assert with_other_minima(known, [far, ruled_out]) == known
    found = SimpleNamespace(other_starts=(near, far, ruled_out), values={'a': a.value, 'b': b.value}, uncertainty=None)
    said = other_minima(found)
    assert len(said) == 2 and 'the intervals hold these values too' in said[0] and 'intervals' not in said[1]
    found.uncertainty = known
    assert other_minima(found) == said


def test_another_minimum_within_a_standard_deviation_is_the_same():
    """A value near zero differs by many times itself and is the same all the same."""
    zero = Interval('g', 3e-5, 0.02, -0.04, 0.04, False, True, 'm/s^2')
    start = OtherStart(1e-3, {'g': -8e-3}, False, 0.0)
    found = SimpleNamespace(other_starts=(start,), values={'g': zero.value}, uncertainty=SimpleNamespace(intervals=(zero,)))
    assert not other_minima(found)
    found.uncertainty.intervals = (replace(zero, std=0.002),)
    assert len(other_minima(found)) == 1


def test_a_zero_with_a_prior_is_the_only_one_of_its_gauge():
    run = replace(module_run(), channels=('strain', 'F_1'), zero_std=(1e-3, 0.0), drift_std=(0.0, 0.0))
    shown = run.measured + np.array([[5e-4], [0.0]])
    one = compared(run, shown, Nuisance())
    assert compared(run, shown, Nuisance(unknown_zero=True)) == pytest.approx(one)


def test_every_estimate_at_a_limit_is_said():
    """A delay that its prior keeps 11 ms from its limit; a zero of all recordings; one of a map."""
    problem = module_problem()
    runs = tuple(replace(run, zero_std=(0.3, 0.0), drift_std=(0.0, 0.0)) for run in problem.runs)
    problem = replace(problem, runs=runs)
    z = np.zeros(len(problem.unknowns))
    z[2] = -9.78
    fits = tuple(
        RunFit(run.name, (), (), (), {}, 1.0, zero=2e-3, zeros={'alpha': zero}, quasi_static=True)
        for run, zero in zip(runs, (1.2, 0.5), strict=True)
    )
    found = {limit.name: limit for limit in limits_reached(problem, z, fits)}
    assert set(found) == {'delay', 'zero.strain', 'zero.alpha'}
    assert (found['delay'].low, found['delay'].value) == (-0.5, pytest.approx(-0.489))
    assert found['zero.strain'].recordings == ('run0', 'run1') and found['zero.alpha'].recordings == ('run0',)
    assert '--limit delay=LOW:HIGH' in found['delay'].text and 'zero_std of the map' in found['zero.alpha'].text


@pytest.mark.parametrize('robust', [False, True])
def test_costs_of_many_points_are_those_of_each(robust):
    problem = replace(module_problem(), robust=robust)
    first = np.zeros(len(problem.unknowns))
    points = [first, first + 0.3, first - 2.0]
    with ThreadPoolExecutor(2) as pool:
        found = costs_at(problem, points, pool)
        expected = [cost_of(problem, residuals_at(problem, z, pool), z) for z in points]
    assert found == pytest.approx(expected) and len({round(cost, 3) for cost in found}) == 3


def test_limits_are_the_users():
    data = dataset(scaled(config(), beam__E=0.95), [1], noise=1.0, seconds=20.0, rate=5.0, delay=0.3)
    options = FitOptions(
        free=('beam.E',), kinetics='hybrid', starts=1, limits=limits_from(['beam.E=1.95e9:3e9', 'delay=0:0.2'])
    )
    found = calibrate(data, config(), options)
    assert found.values['beam.E'] == pytest.approx(1.95e9) and found.delay == pytest.approx(0.2)
    assert set(found.at_bound) == {'beam.E', 'delay'} and found.uncertainty.intervals[0].low == pytest.approx(1.95e9)
    said = ' '.join(remarks_on(found))
    assert 'more than noise. The intervals' in said and '--limit beam.E=LOW:HIGH' in said
    free = calibrate(data, config(), replace(options, limits={}))
    assert not free.at_bound and free.delay == pytest.approx(0.3, abs=0.01) and 'finding' not in ' '.join(remarks_on(free))


def test_a_delay_within_half_a_sampling_interval_is_no_finding():
    data = dataset(config(), [1], noise=1.0, seconds=20.0, rate=5.0, delay=0.05)
    found = calibrate(data, config(), FitOptions(free=('beam.E',), kinetics='hybrid', starts=1))
    assert found.delay == pytest.approx(0.05, abs=0.01)
    assert any('within half a sampling interval (200 ms): no finding' in line for line in remarks_on(found))


@pytest.mark.parametrize(
    ('limits', 'words'),
    [
        ({'beam.L': (0.0, 1.0)}, 'a parameter that is fitted'),
        ({'wire.E_A': (2e10, 1e10)}, 'lower end first'),
        ({'wire.E_A': (-1.0, 1e10)}, 'more than 0'),
    ],
)
def test_limits_that_are_none(limits, words):
    with pytest.raises(UserError, match=words):
        within_limits(module_problem(), limits)


@pytest.mark.parametrize('word', ['delay', 'delay=1', 'delay=a:b', 'delay=1:2:3'])
def test_limits_that_cannot_be_read(word):
    with pytest.raises(UserError, match='expected NAME=LOW:HIGH'):
        limits_from([word])


def test_the_end_of_what_a_parameter_can_be_is_no_limit_to_move():
    problem = module_problem()
    free = free_parameter('wire.E_A', 1e9, DEFAULTS['wire.E_A'])  # the bounds of the declaration are nearer than the fit's
    found = limits_reached(replace(problem, free=(free,), runs=()), np.array([free.low, 0.0]), ())
    assert [(limit.name, limit.is_movable) for limit in found] == [('wire.E_A', False)]
    assert '--limit' not in found[0].text


def test_a_limit_of_an_effect_is_moved_in_a_fit_with_it():
    """`diagnose` knows no limits of effects that it may find."""
    reached = LimitReached('effects.smooth_transformation.end_M', 36.5, 1.0, 36.5, '-')
    command = 'sma-sim fit --effect smooth_transformation --limit effects.smooth_transformation.end_M=LOW:HIGH'
    assert f'(move it: {command})' in reached.text
    assert '(move it: --limit wire.E_A=LOW:HIGH)' in replace(reached, name='wire.E_A').text


def test_a_diagnosis_and_a_fit_of_the_same_effects_take_the_same_minimum(monkeypatch):
    """The last model of a search is also fitted from its nominal values; the better minimum is taken, the other one kept."""
    problem, costs = replace(module_problem(), nominal_effects=()), []
    found = FitResult(problem, np.zeros(len(problem.unknowns)), 100.0)
    monkeypatch.setattr(FitResult, 'effects', property(lambda _: ('gravity',)))
    monkeypatch.setattr(conclusion, 'overdispersion', lambda *_: 10.0)
    monkeypatch.setattr(conclusion, 'refit', lambda given, z, *_: FitResult(given, z + 0.5, costs[-1]))
    for cost, taken, kept in ((60.0, 0.5, 0.0), (160.0, 0.0, 0.5)):
        costs.append(cost)
        best = conclusion.from_defaults_too(found, SearchContext(None, Event()))
        (other,) = best.other_starts
        assert best.z[0] == taken and best.cost == min(cost, 100.0)
        assert other.values['wire.E_A'] == problem.free[0].value(kept) and not other.same
        assert other.log_odds == pytest.approx(abs(cost - 100.0) / 100.0)


def test_values_that_data_leave_open_are_those_of_a_fit_with_the_same_effects():
    """Three levels leave open at which stress the strain begins to grow: a search, whose priors are about no effect, takes
    the last stress at which that is possible, and predicts too much strain below."""
    truth = read_config(words=ISOBARIC, effects=[ORIENTED, SMOOTH])
    runs = isobaric_tests(truth, (5e7, 1.5e8, 2e8, 7e6))
    fitted, below = (replace(runs, recordings=part) for part in (runs.recordings[:3], runs.recordings[3:]))
    bare = read_config(words=ISOBARIC, effects=[SMOOTH])
    given = read_config(words=ISOBARIC, effects=[SMOOTH, ORIENTED.partition(':')[0]])
    options = FitOptions(kinetics='hybrid', starts=1)
    asked = calibrate(fitted, given, options)
    with ThreadPoolExecutor(2) as pool:
        context = SearchContext(pool, Event())
        start = multistart_search(prepare(fitted, bare, 'hybrid'), options, context)
        start = replace(start, problem=replace(start.problem, nominal_effects=('smooth_transformation',)))
        found = candidate_of(find_effects()['stress_dependent_transformation_strain'])
        screened = ScreeningResult(found, 0.0, {p.name: p.default for p in found.effect.parameters})
        searched = refit(*with_candidate(start, screened), context, SETTLED)
        data = conclusion.StageData(fitted, below, options)
        before = pooled_error(data.predicted(searched, context))[0]
        last = conclusion.final_stage(data, 'added', conclusion.as_fitted(searched, context), context)
    names = [name for name in asked.values if name.startswith('effects.stress')]
    assert [last.calibration.values[name] for name in names] == pytest.approx(
        [asked.values[name] for name in names], rel=0.05
    )
    assert last.held_out < 0.8 * before


def stage_of(effects, held_out):
    return SimpleNamespace(effects=effects, held_out=held_out, train=1.0, predicted=())


@pytest.mark.parametrize(
    ('held_out', 'together', 'rooms', 'odds', 'verdict', 'retracted'),
    [
        ((5.0, 2.0), 1.0, (), 0.0, 'missing_effect', False),  # better, and explained where it is fitted too
        ((5.0, 8.0), 1.0, (), -10.0, 'unknown_effect', False),  # worse, and fitted to all runs no better
        ((5.0, 8.0), 1.0, (), 1.0, 'missing_effect', False),  # worse, as the fitted runs left open what all runs tell
        ((5.0, 8.0), 3.0, (), 1.0, 'unknown_effect', True),
        ((5.0, 1.2), 3.0, (), 0.0, 'missing_effect', False),
        ((5.0, 8.0), 1.0, (3.0, 1.2), -10.0, 'missing_effect', False),  # worse in the room of the others only
        ((5.0, 8.0), 1.0, (3.0, 4.0), -10.0, 'unknown_effect', False),
    ],
)
def test_an_effect_that_predicts_worse_is_not_found(monkeypatch, held_out, together, rooms, odds, verdict, retracted):
    fit = FitResult(module_problem(), np.zeros(len(module_problem().unknowns)), 0.0)
    stages = [stage_of(effects, error) for effects, error in zip(((), ('gravity',)), held_out, strict=True)]
    data = SimpleNamespace(limit=1.3, under=lambda *_: SimpleNamespace(training=1, held_out=1))
    monkeypatch.setattr(conclusion, 'as_fitted', lambda fit, _: fit)
    monkeypatch.setattr(conclusion, 'provisional_stage', lambda *_: stages[0])
    monkeypatch.setattr(conclusion, 'final_stage', lambda _, kind, *__: replace_kind(stages, kind))
    pooled = conclusion.PooledErrors(together, together, {'run3': -1.2} if rooms else {})
    monkeypatch.setattr(conclusion, 'pooled_refit', lambda _, model, *__: (model, pooled))
    monkeypatch.setattr(conclusion, 'evidence_score', lambda model, *_: odds if model is last else 0.0)
    monkeypatch.setattr(conclusion, 'errors_in_own_rooms', lambda *_: rooms)
    errors = rooms or held_out  # without uncertain parameters the density falls with the error
    monkeypatch.setattr(conclusion, 'log_predictive', lambda stage, *_: -10.0 * errors[stages.index(stage)])
    monkeypatch.setattr(conclusion, 'estimated', lambda fit, *_: fit)
    monkeypatch.setattr(conclusion, 'has_terms', lambda _: False)
    posterior = SimpleNamespace(best=SimpleNamespace(components=()), unlisted=0.0, overdispersion=1.0)
    last = replace(fit)
    found = conclusion.conclusion([fit, last], False, posterior, data, SearchContext(None, Event()))
    assert found.verdict == verdict and (len(found.stages) > 2) == retracted


def replace_kind(stages, kind):
    """The stage without effects where these are retracted, else the last one."""
    return stages[0] if kind == 'retracted' else stages[1]


@pytest.mark.parametrize('jump', [0.0, 1e4])
def test_an_interval_of_a_derivative_that_is_a_jump_is_widened_to_where_the_cost_rises(monkeypatch, jump):
    """The first parameter has a derivative that is far too large at this point; the second one is as its derivatives say."""
    problem = replace(module_problem(), delay=0.0, runs=module_problem().runs[:1])
    z = np.zeros(len(problem.unknowns))
    residuals = np.ones_like(problem.runs[0].weight)
    jacobian = np.random.default_rng(1).normal(size=(len(z), *residuals.shape))
    told = jacobian.copy()
    told[0] *= 1.0 + jump
    run = LinearizedRun(np.arange(len(z)), residuals, told)
    known = uncertainty(problem, z, informations_of(problem, [run]))
    curvature = np.einsum('uck,vck->uv', jacobian, jacobian)
    monkeypatch.setattr(
        'sma_sim.evidence.estimation.uncertainty.costs_at',
        lambda _, points, __: [0.5 * float(at @ curvature @ at) for at in points],
    )
    first, second = checked_by_runs(known, problem, z, informations_of(problem, [run]), None).intervals
    assert second == known.intervals[1]
    true = uncertainty(problem, z, informations_of(problem, [replace(run, jacobian=jacobian)])).intervals[0]
    ratio = np.log(first.high / first.low) / np.log(true.high / true.low)
    assert 0.4 < ratio < 2.0 and (jump == 0.0) == (first == known.intervals[0])
