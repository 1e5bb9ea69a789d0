"""Two missing effects, each hidden by the other: they are judged by what they explain together."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Event
from types import SimpleNamespace

import pytest
from simulated_data import config, dataset, scaled

from sma_sim import find_effects
from sma_sim.evidence.estimation.calibrate import FitOptions
from sma_sim.evidence.estimation.cross_validation import cross_validated
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.backward_elimination import best_replacement, eliminate_backward
from sma_sim.evidence.model_selection.candidate_fit import SelectionStep, best_acceptable
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.evidence.model_selection.forward_selection import pair_steps, selection_step, with_another_lead
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest, nominal_fit
from sma_sim.report.html.candidates import decision, elimination_section

QUICK = DiagnosisRequest('mas', options=FitOptions(starts=1))


@pytest.fixture(scope='module')
def place():
    """Where the work is done."""
    with ThreadPoolExecutor(2) as pool:
        yield SearchContext(pool, Event())


def one_that_accepts_nothing(place, seconds=40.0, **hidden):
    """The first round on two runs of a robot that has these effects, as if none of them were acceptable by itself."""
    truth = scaled(config('mas'), wire__lambda=1.05, beam__E=0.96)
    for name, values in hidden.items():
        truth = with_effect(truth, find_effects()[name], values)
    first = selection_step(nominal_fit(dataset(truth, [1, 2], 1.0, seconds, rate=5.0), config(), QUICK, place), place)
    assert first.candidate_fits
    return replace(first, accepted=None)


@pytest.fixture(scope='module')
def first(place):
    """The first round on a robot that has two effects."""
    return one_that_accepts_nothing(place, gravity={'g_y': -9.81}, driver_lag={'tau': 0.3})


@pytest.mark.slow
def test_two_effects_are_accepted_for_what_they_explain_together(place, first):
    lead, second = pair_steps(first, place)
    assert lead.only_together and lead.accepted.name == 'gravity' and lead.after is lead.accepted.fit
    assert second.accepted.name == 'driver_lag' and second.base is lead.after
    assert second.accepted.fit.prediction_error < (1.0 - CRITERIA.strong_error_reduction) * first.base.prediction_error
    known = [replace(one, plausible=False) for one in first.candidate_fits]
    assert pair_steps(replace(first, candidate_fits=tuple(known)), place) == (replace(first, candidate_fits=tuple(known)),)


@pytest.mark.slow
def test_two_effects_take_the_place_of_one_that_imitates_both(place, first):
    """Beside what imitates both nothing is found, and it leaves more than noise."""
    gravity = next(one for one in first.candidate_fits if one.name == 'gravity')
    imitation = next(one for one in first.candidate_fits if one.plausible and one is not gravity)
    imitating = replace(first, accepted=imitation, candidate_fits=(imitation, replace(gravity, error_reduction=0.5)))
    steps = imitating, SelectionStep(imitation.fit, (), (), None)
    lead, second, end = with_another_lead(steps, imitation.fit, place)
    assert (lead.accepted.name, second.accepted.name, end.accepted) == ('gravity', 'driver_lag', None)
    assert second.base is lead.after and end.base is second.after and end.base.error <= CRITERIA.pooled_noise_only
    assert with_another_lead(steps, end.base, place) == steps  # what leaves only noise stands
    assert with_another_lead(steps, imitation.fit, place, lambda bare: bare is first.base) == steps  # an equation does


@pytest.mark.slow
def test_a_rival_takes_the_place_of_what_was_accepted_while_another_effect_was_missing(place, first):
    by_name = {one.name: one for one in first.candidate_fits}
    bias = cross_validated(by_name['sensor_bias'].fit, place)  # as one that is accepted has been
    wrong = replace(first, accepted=replace(by_name['sensor_bias'], fit=bias), after=bias)
    right = by_name['gravity'].fit
    second = selection_step(wrong.after, place)
    assert second.accepted.name == 'driver_lag'
    last, (again,) = eliminate_backward(second.accepted.fit, (wrong, second), place)
    assert last.effects == ('gravity', 'driver_lag') and last.error < 0.9 * second.accepted.fit.error
    assert again.effect == 'sensor_bias' and again.base.effects == ('driver_lag',)
    assert again.accepted.name == 'gravity' and again.after is last
    assert last.values_of('gravity')['g_y'] == pytest.approx(-9.81, rel=0.1)
    names = [p.name for p in last.problem.free]
    assert len(last.z) - len(names) == len(right.z) - len(right.problem.free) and len(set(names)) == len(names)
    section = elimination_section(again, SimpleNamespace(confounding={}))
    assert section.title == 'Again: sensor_bias' and section.blocks[0].text.endswith('gravity takes its place.')
    others = [one for one in again.candidate_fits if one.name != 'gravity']
    assert (
        best_replacement('gravity', [replace(again.accepted, plausible=False), *others]).name == 'gravity'
    )  # they are worse


@pytest.mark.slow
def test_a_second_lead_is_followed_where_the_first_does_not_lead_to_the_noise(place, first):
    others = [one for one in first.candidate_fits if one.name != 'driver_lag']
    best, wrong, *_ = sorted(others, key=lambda one: (one.name != 'gravity', one.fit.cost))
    ahead = replace(wrong, plausible=True, family_p=0.01, fit=replace(wrong.fit, cost=0.5 * best.fit.cost))
    lead, second = pair_steps(replace(first, candidate_fits=(ahead, best)), place)
    assert lead.accepted.name == 'gravity' and second.accepted.name == 'driver_lag'


@pytest.fixture(scope='module')
def only_gravity(place):
    """The first round on a robot that has one effect."""
    return one_that_accepts_nothing(place, 20.0, gravity={'g_y': -9.81})


@pytest.mark.slow
def test_a_lead_beside_which_nothing_explains_is_not_accepted(place, only_gravity):
    assert pair_steps(only_gravity, place) == (only_gravity,)


def test_what_leaves_but_noise_in_all_fitted_runs_is_accepted_though_one_left_out_goes_beyond_the_others(only_gravity):
    (gravity,) = (one for one in only_gravity.candidate_fits if one.name == 'gravity')
    others = [one for one in only_gravity.candidate_fits if one is not gravity]
    far_off = replace(gravity.fit, cross_validated_error=12.0)
    far = replace(gravity, error_ratio=3.0, error_reduction=-2.0, family_p=0.2, fit=far_off)
    better = [replace(one, plausible=True, family_p=0.01, error_reduction=0.5, error_ratio=0.5) for one in others]
    assert better and all(one.acceptable and one.fit.error > CRITERIA.noise_only for one in better)
    assert not far.predicts_better and best_acceptable([*better, far]) is far
    rival = replace(far, fit=replace(far.fit, cost=1.05 * far.fit.cost, cross_validated_error=11.9))  # 2 % more
    assert best_acceptable([rival, far]) is far
    predicts_better = replace(rival, fit=replace(rival.fit, cross_validated_error=1.2))
    assert best_acceptable([predicts_better, far]) is far  # the runs that are left do not determine it: the odds decide
    less_badly = replace(rival, fit=replace(rival.fit, cost=far.fit.cost + 11.0, cross_validated_error=6.0))
    assert best_acceptable([less_badly, far]) is far  # neither predicts: the odds in the fitted runs decide
    as_likely = replace(less_badly, fit=replace(less_badly.fit, cost=far.fit.cost + 5.0))
    assert best_acceptable([as_likely, far]) is as_likely
    half = replace(far, explained=0.2)  # little was left without it: then the runs left out decide
    assert not half.acceptable and best_acceptable([*better, half]) in better


def test_what_leaves_only_noise_is_found_by_its_odds_where_the_score_test_does_not_see_it(only_gravity):
    """A score test is of first order; the odds of two fits are not."""
    (gravity,) = (one for one in only_gravity.candidate_fits if one.name == 'gravity')
    unseen = replace(gravity, error_reduction=0.1, explained=0.2, family_p=0.7)
    assert unseen.delta_bic < -20.0 and unseen.fit.error <= CRITERIA.noise_only and unseen.acceptable
    assert not replace(unseen, delta_bic=-19.0).acceptable and not replace(unseen, error_reduction=0.02).acceptable
    others = [one for one in only_gravity.candidate_fits if one.fit.error > CRITERIA.noise_only]
    assert others and not any(replace(unseen, fit=other.fit).acceptable for other in others)


def test_the_report_says_why_what_explains_more_alone_is_not_taken(only_gravity):
    (gravity,) = (one for one in only_gravity.candidate_fits if one.name == 'gravity')
    lead = next(replace(one, plausible=True, family_p=0.01) for one in only_gravity.candidate_fits if one is not gravity)
    assert gravity.acceptable and gravity.error_ratio < lead.error_ratio
    alone = replace(lead, indistinguishable=())
    assert f'more than {lead.name} alone, but less than it does with' in decision(gravity, alone)
    better = replace(lead, error_reduction=0.5)
    assert 'explains less than gravity' in decision(better, gravity)
