"""The rules by which formulas compete with listed effects, and one replaces the other."""

from types import SimpleNamespace

import pytest

from sma_sim.evidence.diagnosis.diagnose import leaves_room
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
    assert leaves_room(last, limit) == room


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
