"""What a diagnosis would say with another run held out, from the errors of its models by run."""

from math import nan

import pytest

from sma_sim.evidence.diagnosis.held_out_verdicts import HeldOutVerdict, JudgedModel, differing, verdicts_by_run
from sma_sim.evidence.estimation.cross_validation import interpolated
from sma_sim.evidence.model_selection.criteria import CRITERIA, fits_all, unexplained_above
from sma_sim.evidence.model_selection.pooled_refit import PooledErrors

RUNS = ('run1', 'run2', 'run3')
NOISE = dict.fromkeys(RUNS, 1.0)


def model(effects, errors, fitted=NOISE, rivals=(), formula=False):
    return JudgedModel(effects, dict(zip((*RUNS, 'test'), errors, strict=False)), fitted, rivals, formula)


def verdicts(*path):
    return {name: (found.verdict, found.effects) for name, found in verdicts_by_run(path).items()}


def test_an_effect_that_every_run_asks_for_is_found_without_any():
    found = verdicts(model((), (2.0, 1.8, 2.2, 1.9)), model(('gravity',), (1.01, 0.99, 1.0, 1.02)))
    assert found == dict.fromkeys((*RUNS, 'test'), ('missing_effect', ('gravity',)))


def test_nothing_missing():
    assert verdicts(model((), (1.0, 1.02, 0.99, 1.01))) == dict.fromkeys((*RUNS, 'test'), ('none', ()))


def test_an_effect_that_one_run_alone_asks_for_depends_on_it():
    path = model((), (1.0, 1.0, 2.5, 1.0)), model(('gravity',), (1.0, 1.0, 1.0, 1.0))
    found = verdicts_by_run(path)
    assert found['run1'] == HeldOutVerdict('missing_effect', ('gravity',), 1.0)
    # without it nothing is asked for, and it is not predicted; yet one model explains it together with the others
    assert found['run3'].effects == () and found['run3'].error == 2.5
    assert set(differing(found, 'missing_effect', ['gravity'])) == {'run3'}


def test_a_run_that_is_not_predicted_has_an_unknown_effect_unless_one_model_explains_all():
    errors = (1.0, 1.0, 1.7, 1.0)
    assert verdicts(model((), errors, fitted={**NOISE, 'run3': 1.6}))['run3'] == ('unknown_effect', ())
    assert verdicts(model((), errors, fitted=NOISE))['run3'] == ('none', ())
    assert verdicts(model((), (1.0, 1.0, 1.0, 1.4)))['test'] == ('unknown_effect', ())
    assert verdicts(model((), (1.0, 1.0, 1.0, 1.4), fitted={**NOISE, 'test': 1.02}))['test'] == ('none', ())


def test_a_rival_that_the_other_runs_prefer_takes_its_place():
    rival = model(('backlash',), (1.01, 1.01, 1.6))
    path = model((), (2.0, 2.0, 2.0, 2.0)), model(('gravity',), (1.3, 1.3, 1.0, 1.0), rivals=(rival,))
    found = verdicts(*path)
    assert found['run3'][1] == ('backlash',) and found['run1'][1] == ('gravity',)
    assert found['test'][1] == ('gravity',)  # no fit has seen it: the search without it was this one


def test_two_effects_that_explain_only_together():
    path = (
        model((), (2.0, 2.0, 2.0, 2.0)),
        model(('gravity',), (2.1, 2.1, 2.1, 2.1)),
        model(('gravity', 'beam_creep'), (1.0, 1.0, 1.0, 1.0)),
    )
    assert set(verdicts(*path).values()) == {('missing_effect', ('gravity', 'beam_creep'))}


def test_a_formula_stays_unknown_and_is_no_effect():
    path = model((), (3.0, 3.0, 3.0, 3.0)), model(('proposed',), (1.0, 1.0, 1.0, 1.0), formula=True)
    assert set(verdicts(*path).values()) == {('unknown_effect', ())}


@pytest.mark.parametrize('path', [
    (JudgedModel((), {}, {'run1': 1.0}),),
    (JudgedModel((), {'test': 1.0}, {'run1': 1.0}),),
    (model((), (2.0, 2.0, 2.0, 2.0)), JudgedModel(('gravity',), {'test': 1.0}, NOISE)),
])  # fmt: skip
def test_a_single_fitted_run_tells_nothing_nor_a_last_model_that_was_not_cross_validated(path):
    assert verdicts_by_run(path) == {}


def test_levels_beyond_all_others_do_not_judge():
    levels = {'low': 7e6, 'middle': 1e8, 'top': 4e8}
    assert interpolated(levels) == ['middle']
    assert interpolated({**levels, 'again': 4e8}) == ['middle', 'top', 'again']  # a repeat predicts its like
    assert interpolated({'low': 7e6, 'top': 4e8}) == ['low', 'top']  # nothing is between: all have to do
    assert interpolated({**levels, 'pulled': nan}) == ['middle', 'pulled']  # another kind of test
    assert interpolated(dict.fromkeys(RUNS, nan)) == list(RUNS)


def test_extrapolated_levels_do_not_reject_an_effect():
    """The top level is predicted worse by the right model: two levels do not tell how strain goes on."""
    path = model((), (2.0, 4.0, 3.0, 3.0)), model(('smooth',), (1.0, 9.0, 1.1, 1.0))
    levels = {'run1': 1e8, 'run2': 4e8, 'run3': 7e6}
    assert verdicts(*path)['test'] == ('unknown_effect', ())
    assert verdicts_by_run(path, levels=levels)['test'].effects == ('smooth',)


def test_a_homogeneous_wire_cannot_be_much_better():
    """A part of what strain spans counts as explained; without a span, as in all other runs, only noise does."""
    assert unexplained_above(nan) == CRITERIA.unexplained and fits_all(CRITERIA.unexplained) == CRITERIA.pooled_noise_only
    assert unexplained_above(200.0) == pytest.approx(10.0) and fits_all(10.0) == 10.0
    assert unexplained_above(5.0) == CRITERIA.unexplained  # a noisy test
    beyond = PooledErrors(train=8.0, held_out=9.0)
    assert beyond.explained(10.0) and not beyond.explained()
