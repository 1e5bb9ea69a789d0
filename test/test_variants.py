"""Variants of effects: which there are, when they are tried, and that the effect itself is preferred."""

from dataclasses import replace
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from simulated_data import config, dataset

from sma_sim import find_effects
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.diagnosis.verdict import as_data
from sma_sim.evidence.diagnosis.verdict_text import as_text
from sma_sim.evidence.estimation.calibrate import FitOptions
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection import candidate_fit, confounding, forward_selection
from sma_sim.evidence.model_selection.backward_elimination import other_effects
from sma_sim.evidence.model_selection.candidate_fit import CandidateFit, SelectionStep, best_acceptable, straightens
from sma_sim.evidence.model_selection.candidates import candidates_for, with_effect
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.evidence.model_selection.forward_selection import promising_further, with_further_candidates
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.model_selection.variants import scopes_of, variants_of
from sma_sim.model.config import Config, read_config
from sma_sim.model.effects.discovery import with_scopes
from sma_sim.model.parameter_file import parameter_file


@pytest.mark.parametrize(
    ('name', 'scopes'),
    [
        ('beam_creep', ['stretch', 'deflection', 'rotation']),
        ('beam_nonlinearity', ['deflection', 'rotation']),  # a beam that is only stretched is linear
        ('joint_friction', []),  # acts in rotation only
        ('gravity', []),  # has a parameter for each coordinate
        ('ambient_heating', ['wire_1', 'wire_2', 'shared']),
        ('functional_fatigue', ['wire_1', 'wire_2']),
        ('power_gain_mismatch', []),  # tells the wires apart by itself
        ('sensor_gain', []),  # has a parameter for each channel
        ('sensor_lag', ['U_x', 'U_y', 'alpha', 'stress']),
    ],
)
def test_variants_are_what_an_effect_is_not_by_itself(name, scopes):
    assert [scope.name for scope in scopes_of(find_effects()[name])] == scopes


def test_sensors_that_were_not_measured_have_no_variants():
    names = {candidate.name for candidate in variants_of(candidates_for(Config()), ('alpha',))}
    assert 'sensor_lag@alpha' in names and 'sensor_lag@U_y' not in names
    assert 'natural_convection@wire_1' in names and len(names) > 30


def test_an_effect_that_is_there_in_a_scope_is_no_candidate():
    names = {candidate.name for candidate in candidates_for(read_config(effects=['beam_creep@rotation']))}
    assert 'beam_creep' not in names and 'gravity' in names


def screened(name, gain):
    found = with_scopes(find_effects(), [name])[name]
    return ScreeningResult(SimpleNamespace(name=name, found=found), gain, {}, 0.01)


def test_variants_that_gain_more_than_their_effects_are_tried():
    results = [
        screened('beam_creep', 90.0), screened('beam_creep@rotation', 89.0), screened('natural_convection@wire_1', 80.0),
        screened('natural_convection@wire_2', 51.0), screened('natural_convection', 50.0),
        screened('polycrystal@wire_1', 5.0),
    ]  # fmt: skip
    nothing = SelectionStep(None, (), (), None)
    chosen = promising_further(results, nothing, 0.0)
    assert [result.candidate.name for result in chosen] == ['natural_convection@wire_1', 'natural_convection@wire_2']
    assert {result.family_p for result in chosen} == {0.01}
    assert [one.candidate.name for one in promising_further(results, nothing, 60.0)] == ['natural_convection@wire_1']
    gravity = replace(candidate('gravity', 1.5), family_p=0.002)
    chosen = promising_further(results, replace(nothing, candidate_fits=(gravity,), accepted=gravity), 50.0)
    assert [result.candidate.name for result in chosen] == [
        'beam_creep', 'natural_convection@wire_1', 'natural_convection@wire_2', 'natural_convection',
    ]  # fmt: skip
    assert {result.family_p for result in chosen} == {0.002}  # they explain more than what is as significant
    known = replace(nothing, candidate_fits=(gravity, candidate('beam_creep', 1.6)), accepted=gravity)
    assert 'beam_creep' not in [result.candidate.name for result in promising_further(results, known, 50.0)]


def fit(error, prediction, effects=(), cost=100.0):
    config_ = SimpleNamespace(system='module', effects=())
    runs = (SimpleNamespace(channels=('alpha',)),)
    problem = SimpleNamespace(free=(1,) * len(effects), config=config_, runs=runs, samples=1000, tempering=1.0)
    return SimpleNamespace(
        error=error, prediction_error=prediction, effects=effects, problem=problem, cost=cost, squares=2.0 * cost, z=(),
        is_bent=False, values_of=lambda name: {},
    )  # fmt: skip


def candidate(name, prediction, cost=100.0):
    found = with_scopes(find_effects(), [name])[name]
    return CandidateFit(found, fit(1.0, prediction, (name,), cost), -100.0, 0.5, 0.5, 0.9, 0.01, True, {})


@pytest.mark.parametrize(
    ('prediction', 'cost', 'taken'),
    [
        (1.008, 50.0, False),  # predicts no better
        (1.03, 95.0, False),  # predicts better by chance: it fits no better
        (1.03, 50.0, True),
    ],
)
def test_a_variant_must_predict_and_fit_better_than_every_effect(prediction, cost, taken):
    plain, variant = candidate('beam_creep', prediction), candidate('beam_creep@rotation', 1.0, cost)
    assert best_acceptable([variant, plain]) is (variant if taken else plain)
    assert best_acceptable([variant, replace(plain, plausible=False)]) is variant


@pytest.mark.parametrize(('cost', 'taken'), [(80.0, True), (95.0, False)])
def test_where_runs_left_out_are_not_determined_the_odds_in_all_fitted_runs_decide(cost, taken):
    right = replace(candidate('natural_convection', 2.3), fit=fit(1.0, 2.3, ('natural_convection',), cost))
    imitation = replace(candidate('radiation', 1.1), fit=fit(1.05, 1.1, ('radiation',), 100.0))
    assert best_acceptable([right, imitation]) is (right if taken else imitation)


@pytest.mark.parametrize(('cost', 'taken'), [(50.0, True), (95.0, False)])
def test_another_exponent_is_a_variant(cost, taken):
    """An effect whose exponent is not the realistic one: it must fit better than every effect that is as it is listed."""
    other = candidate('natural_convection', 1.0, cost)
    other.fit.values_of = {'natural_convection': {'k': 4.0, 'm': 0.8}}.get
    listed = candidate('natural_convection', 1.0)
    listed.fit.values_of = {'natural_convection': {'k': 40.0, 'm': 0.3}}.get
    assert other.is_variant and not listed.is_variant
    plain = candidate('radiation', 1.03)
    assert best_acceptable([other, plain]) is (other if taken else plain)


@pytest.mark.parametrize(
    ('cost', 'prediction', 'implausible', 'found'),
    [(480.0, 1.0, (), True), (495.0, 1.0, (), False), (480.0, 1.03, (), False), (480.0, 1.0, ('wire.E_M',), False)],
)
def test_what_makes_implausible_parameters_plausible(monkeypatch, cost, prediction, implausible, found):
    monkeypatch.setattr(candidate_fit, 'implausible_in', lambda fit, context: implausible)
    base = fit(1.01, 1.01, cost=500.0)
    assert not straightens(base, fit(1.0, prediction, cost=cost), None)  # nothing is wrong with it
    base.is_bent = True
    assert straightens(base, fit(1.0, prediction, cost=cost), None) == found


@pytest.mark.parametrize(
    ('left', 'variants', 'tried'),
    [(fit(1.0, 1.01), True, False), (fit(1.2, 1.3), True, True), (fit(1.0, 1.1), True, True), (fit(1.2, 1.3), False, True)],
)
def test_variants_are_tried_where_effects_leave_more_than_noise(monkeypatch, left, variants, tried):
    base, calls = fit(5.0, 5.0, cost=12500.0), []
    start = fit(9.0, 9.0, cost=40500.0)  # the base where gravity has led

    def screen(problem, z, candidates, pool, seed):
        assert problem is start.problem
        calls.append([one.name for one in candidates])
        return (screened('natural_convection@wire_1', 20000.0),)

    def step_with(of, results, chosen, context, begin, limit):
        assert of is base and begin is start and limit == pytest.approx(CRITERIA.sketch_cost_ratio * left.cost)
        return SelectionStep(of, results, (candidate('natural_convection@wire_1', 1.0, 50.0),), None)

    monkeypatch.setattr(forward_selection, 'screen', screen)
    monkeypatch.setattr(forward_selection, 'step_with', step_with)
    monkeypatch.setattr(forward_selection, 'without_accepted', lambda accepted, context: start)
    effect = replace(candidate('gravity', left.prediction_error), fit=left)
    first = SelectionStep(base, (), (effect,), effect)
    context = SearchContext(None, Event(), variants=variants)
    step = with_further_candidates(first, candidates_for(Config()), context)
    assert bool(calls) is tried and all(any('@' in name for name in names) is variants for names in calls)
    assert step.accepted.name == ('natural_convection@wire_1' if tried else 'gravity')
    assert len(step.candidate_fits) == (2 if tried else 1)


def test_effects_are_screened_from_the_base_where_the_model_does_not_run_without_the_accepted_one(monkeypatch):
    base, seen = fit(5.0, 5.0, cost=12500.0), []
    monkeypatch.setattr(forward_selection, 'screen', lambda problem, *rest: seen.append(problem) or ())
    monkeypatch.setattr(forward_selection, 'without_accepted', lambda accepted, context: fit(9.0, 9.0, cost=np.inf))
    effect = replace(candidate('gravity', 1.3), fit=fit(1.2, 1.3))
    first = SelectionStep(base, (), (effect,), effect)
    step = with_further_candidates(first, candidates_for(Config()), SearchContext(None, Event()))
    assert seen == [base.problem] and step.accepted.name == 'gravity'


def test_no_variant_stands_beside_its_effect():
    both = SimpleNamespace(problem=SimpleNamespace(config=read_config(effects=['beam_creep@rotation', 'gravity'])))
    assert other_effects(both, 'gravity') == {'beam_creep'}
    assert other_effects(both, 'beam_creep@rotation') == {'gravity'}


@pytest.mark.slow
def test_an_effect_in_one_wire_is_found(tmp_path):
    name = 'driver_deadband@wire_2'
    found = with_scopes(find_effects(), [name])[name]
    runs = dataset(with_effect(config(), found, {'J_d': 0.15}), [1, 2, 3], noise=1.0, rate=5.0, channels=('alpha', 'U_y'))
    options = FitOptions(free=('beam.E', 'wire.lambda'), starts=1, intervals=False)
    result = diagnose(runs, config(), request=DiagnosisRequest('hybrid', options=options, equation=False))
    data = as_data(result)
    assert data['verdict'] == 'missing_effect' and data['effects'] == ['driver_deadband']
    assert data['variants'] == {'driver_deadband': 'in wire 2 only'}
    assert data['error'][-1]['held_out'] < 1.1 and result.search_ended
    assert any('a deadband of the driver, in wire 2 only' in line for line in as_text(result))
    file = tmp_path / 'robot.yaml'
    file.write_text(parameter_file(result.calibration.config))
    assert read_config(file).effects[0].found.effect.name == name


def test_the_listed_effect_with_the_most_similar_signature(monkeypatch):
    responses = {'base': [1.0, 1.0], 'formula': [3.0, 2.0], 'gravity': [2.0, 1.5], 'radiation': [1.0, 2.0], 'slack': [1.0]}
    monkeypatch.setattr(confounding, 'response', lambda fit, pool: np.array(responses[fit]))
    fits = [SimpleNamespace(found=find_effects()[name], fit=name) for name in ('radiation', 'gravity', 'slack')]
    first = SimpleNamespace(base='base', candidate_fits=fits)
    similar = confounding.most_similar('formula', first, None)
    assert similar.effect.name == 'gravity' and similar.cosine == pytest.approx(1.0)
    assert confounding.most_similar('formula', SimpleNamespace(base='base', candidate_fits=[]), None) is None


@pytest.mark.parametrize(('cost', 'tempering', 'richer'), [(85.0, 1.0, True), (92.0, 1.0, False), (85.0, 9.0, False)])
def test_of_those_that_predict_equally_well_the_richer_one_wins_by_odds(cost, tempering, richer):
    """More parameters, a better fit: by e^15 and e^8; where what is left is no white noise, odds count less."""
    simple, rich = candidate('polycrystal', 1.0), candidate('smooth_transformation', 1.0, cost)
    simple.fit.problem.tempering = rich.fit.problem.tempering = tempering
    rich.fit.problem.free = (1,) * 6
    assert best_acceptable([simple, rich]) is (rich if richer else simple)
