"""The rules by which formulas compete with listed effects, and one replaces the other."""

import math
from dataclasses import replace
from threading import Event
from types import SimpleNamespace

import pytest

from sma_sim.evidence.diagnosis.conclusion import leaves_room
from sma_sim.evidence.model_selection.candidate_fit import SelectionStep
from sma_sim.evidence.model_selection.forward_selection import adds_little, points_beyond_library, with_unrealistic_values
from sma_sim.evidence.symbolic_regression.propose import is_better


@pytest.mark.parametrize(('effects', 'fitted', 'predicted', 'limit', 'bent', 'room'), [
    ((), 1.2, 1.2, 1.3, False, True),
    ((), 1.05, 1.08, 1.3, True, True),
    ((), 1.0, 1.7, 1.3, False, False),  # the fitted runs do not determine the parameters
    ((), 1.05, 1.08, 1.3, False, False),  # a formula would have to take away a tenth
    (('slack',), 1.02, 1.02, 1.3, False, True),
    (('slack',), 1.0, 1.01, 1.3, False, False),
    (('slack',), 1.0, 1.2, 1.3, False, False),  # nothing can fit better by odds that are no chance
    (('slack',), 1.0, 1.01, 1.3, True, False),  # one cause explains all
    (('slack', 'gravity'), 1.0, 1.01, 1.3, True, True),
    (('slack',), 4.0, 4.1, 5.0, True, False),  # a quasi-static test: as good as a model of one homogeneous wire can be
])  # fmt: skip
def test_formulas_compete_where_effects_leave_more_than_noise(effects, fitted, predicted, limit, bent, room):
    last = SimpleNamespace(effects=effects, error=fitted, prediction_error=predicted, is_bent=bent)
    assert leaves_room([SimpleNamespace(error=5.0, effects=()), last], limit) == room


@pytest.mark.parametrize(('bare', 'room'), [(5.0, True), (60.0, False)])
def test_no_formula_is_sought_for_the_last_per_cent_of_an_effect(bare, room):
    """0.2 beyond the noise are a twenty-fifth of an error of 5, and no hundredth of one of 60."""
    last = SimpleNamespace(effects=('slack',), error=1.02, prediction_error=1.02, is_bent=False)
    assert leaves_room([SimpleNamespace(error=bare, effects=()), last], 1.3) == room


@pytest.mark.parametrize(('first', 'room'), [(1.13, True), (2.0, False)])
def test_of_two_effects_the_second_may_make_up_for_the_form_of_the_first(first, room):
    """What one effect leaves below 1.3 may be its form: one formula may explain all."""
    last = SimpleNamespace(effects=('slack', 'gravity'), error=1.0, prediction_error=1.0, is_bent=False)
    alone, bare = SimpleNamespace(effects=('slack',), error=first), SimpleNamespace(effects=(), error=5.0)
    assert leaves_room([bare, alone, last], 1.3) == room
    assert leaves_room([bare, alone, last, last], 1.3) == room  # compared again with the rivals of both


@pytest.mark.parametrize(('accepted', 'imitating', 'before', 'beyond'), [
    (1.2, 1.1, 1, False),  # nothing that a model of the system may not leave
    (3.0, 1.4, 0, True),  # an unrealistic value explains most
    (3.0, 2.5, 0, False),
    (3.0, None, 0, False),
    (3.0, None, 1, True),  # a second effect
    (None, None, 0, True),  # no effect
])  # fmt: skip
def test_where_a_law_that_is_not_listed_may_explain_alone(accepted, imitating, before, beyond):
    fits = [
        SimpleNamespace(plausible=False, fit=SimpleNamespace(error=error, cost=error**2)) for error in (imitating,) if error
    ]
    chosen = SimpleNamespace(plausible=True, fit=SimpleNamespace(error=accepted, cost=accepted**2)) if accepted else None
    base = SimpleNamespace(error=5.0, cost=25.0, problem=SimpleNamespace(span=math.nan))
    step = SelectionStep(base, (), (*fits, *([chosen] if chosen else [])), chosen)
    assert points_beyond_library(step, before) == beyond
    assert not points_beyond_library(replace(step, stopped=True), before)


@pytest.mark.parametrize(('before', 'after', 'little'), [
    (1.29, 1.22, True),
    (1.29, 1.14, False),  # more than a tenth
    (1.15, 1.08, False),  # only noise is left
    (1.4, 1.35, False),  # much is left, which effects may explain together
    (1.29, None, False),
])  # fmt: skip
def test_an_effect_that_takes_little_of_little_may_imitate_what_is_not_listed(before, after, little):
    chosen = None if after is None else SimpleNamespace(fit=SimpleNamespace(error=after))
    assert adds_little(SelectionStep(SimpleNamespace(error=before), (), (), chosen)) == little


@pytest.mark.parametrize(('error', 'cost', 'changes', 'taken'), [
    (1.2, 600.0, {}, True),
    (1.03, 600.0, {}, True),
    (1.0, 600.0, {}, False),  # what is realistic leaves only noise
    (1.2, 505.0, {}, False),  # it fits hardly worse
    (1.2, 600.0, {'plausible': True}, False),
    (1.2, 600.0, {'convincing': False}, False),
    (1.2, 600.0, {'predicted': math.nan}, False),  # a single run, or one that could not win
    (1.2, 600.0, {'error': 1.03}, False),
    (1.2, 600.0, {'predicted': 1.03}, False),
])  # fmt: skip
def test_an_effect_with_unrealistic_values_is_taken_only_where_nothing_realistic_explains(error, cost, changes, taken):
    one = {'plausible': False, 'convincing': True, 'error': 1.0, 'predicted': 1.01} | changes
    problem = SimpleNamespace(span=math.nan, runs=())
    fit = SimpleNamespace(error=one['error'], cross_validated_error=one['predicted'], cost=489.0, problem=problem)
    candidate = SimpleNamespace(name='slack', fit=fit, **one)
    realistic = SimpleNamespace(plausible=True, fit=SimpleNamespace(error=error, cost=cost))
    last = SimpleNamespace(error=error, prediction_error=error, cost=cost, problem=problem)
    first = SelectionStep(SimpleNamespace(error=5.0, cost=1e4), (), (candidate, realistic), realistic, last)
    steps, place = (first, SelectionStep(last, (), (), None)), SimpleNamespace(stop=Event(), on_progress=str)
    found = with_unrealistic_values(steps, place)
    if not taken:
        assert found == steps
        return
    step, end = found
    assert step.accepted is candidate and step.after is fit and end.base is fit and end.accepted is None
    place.stop.set()
    assert with_unrealistic_values(steps, place) == steps


@pytest.mark.parametrize(('known', 'formula', 'better'), [
    (((), 2.0, 500.0), (1.7, 400.0), True),
    (((), 2.0, 500.0), (1.9, 400.0), False),  # a further cause for hardly anything
    ((('slack',), 1.1, 500.0), (1.02, 470.0), True),
    ((('slack',), 1.1, 500.0), (1.02, 485.0), False),  # by chance, as a listed effect would have been
    ((('slack',), 1.5, 500.0), (1.42, 400.0), False),  # neither explains
    ((('slack', 'gravity'), 1.02, 500.0), (1.02, 505.0), True),  # one cause instead of two
    ((('slack', 'gravity'), 1.02, 500.0), (1.02, 515.0), False),  # they fit better by more than chance
    ((('slack', 'gravity'), 1.02, 500.0), (1.05, 490.0), False),
])  # fmt: skip
def test_a_formula_against_listed_effects(known, formula, better):
    names, predicted, cost = known
    effects = SimpleNamespace(effects=names, prediction_error=predicted, cost=cost, is_bent=False)
    error, cost = formula
    with_formula = SimpleNamespace(effects=('formula',), error=error, prediction_error=error, cost=cost, is_bent=False)
    assert is_better(with_formula, effects) == better


def test_a_formula_that_needs_no_implausible_parameters():
    bent = SimpleNamespace(effects=('slack',), prediction_error=1.0, error=1.0, cost=500.0, is_bent=True)
    straight = SimpleNamespace(effects=('formula',), prediction_error=1.0, error=1.0, cost=470.0, is_bent=False)
    assert is_better(straight, bent) and not is_better(straight, replace_in(bent, is_bent=False))
    assert not is_better(replace_in(straight, cost=490.0), bent) and not is_better(replace_in(straight, is_bent=True), bent)
    assert not is_better(replace_in(straight, prediction_error=1.02), bent)


def replace_in(fit, **changes):
    return SimpleNamespace(**{**vars(fit), **changes})
