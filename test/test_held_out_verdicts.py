"""What a diagnosis would say with another run held out, from the errors of its models by run."""

import pytest

from sma_sim.evidence.diagnosis.held_out_verdicts import HeldOutVerdict, JudgedModel, differing, verdicts_by_run

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
