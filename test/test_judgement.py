"""What held-out runs say of the models of a diagnosis."""

from types import SimpleNamespace

import numpy as np
import pytest

from sma_sim.evidence.diagnosis.judgement import helps_little, is_contradicted, predicts_best, verdict_after_removal
from sma_sim.evidence.model_selection.pooled_refit import PooledErrors


@pytest.mark.parametrize(
    ('train', 'held', 'effects', 'verdict'),
    [(1.0, 1.0, ('gravity',), 'missing_effect'), (3.0, 1.2, (), 'unknown_effect'), (1.0, 1.5, (), 'unknown_effect')],
)
def test_the_verdict_after_an_effect_was_taken_back(train, held, effects, verdict):
    assert verdict_after_removal(SimpleNamespace(train=train, held_out=held, effects=effects)) == verdict


@pytest.mark.parametrize(
    ('bare', 'last', 'little', 'contradicted'),
    [
        ((0.9, 0.7), (0.5, 5.0), True, True),  # predicted without the effect, and not with it
        ((3.0, 4.0), (1.0, 5.0), True, False),  # explained where they were fitted, and further runs by neither
        ((3.0, 4.0), (2.0, 5.0), True, True),
        ((3.0, 4.0), (2.0, 3.0), False, False),  # a part
        ((1.5, 1.1), (1.0, 1.2), False, False),  # predicted by both
    ],
)
def test_held_out_runs_contradict_an_effect(bare, last, little, contradicted):
    both = zip((bare, last), ((), ('gravity',)), strict=True)
    stages = [SimpleNamespace(train=train, held_out=held, effects=names) for (train, held), names in both]
    assert (helps_little(stages), is_contradicted(stages)) == (little, contradicted)


@pytest.mark.parametrize(('left', 'contradicted'), [(1.0, False), (1.2, True)])
def test_a_fit_to_all_runs_tells_whether_they_only_go_further(left, contradicted):
    """One effect explains the fitted runs, and predicts the others no better than none."""
    bare = SimpleNamespace(train=3.0, held_out=4.0, effects=())
    last = SimpleNamespace(train=1.0, held_out=5.0, effects=('gravity',))
    assert is_contradicted([bare, last], pooled=PooledErrors(1.0, left)) == contradicted
    part = SimpleNamespace(train=1.0, held_out=3.0, effects=('gravity',))
    assert not is_contradicted([bare, part], pooled=PooledErrors(1.0, left))  # it explains a part


@pytest.mark.parametrize(
    ('errors', 'counts', 'kept'),
    [
        ((3.0, 2.0, 1.5), (0, 1, 2), 2), ((3.0, 2.0, 1.9), (0, 1, 2), 1), ((2.1, 1.95), (0, 1), 0), ((3.5, 4.4), (0, 1), 0),
        ((3.0, 2.9, 1.8), (0, 1, 2), 2), ((3.0,), (0,), 0), ((np.inf, 2.0), (0, 1), 1), ((2.0, np.nan), (0, 1), 1),
        ((3.0, np.inf), (0, 1), 0),
        ((5.0, 3.0, 2.0, 2.05), (0, 1, 2, 1), 3), ((5.0, 3.0, 2.0, 2.0), (0, 1, 2, 2), 3),  # dropped, and a rival: both stay
        ((5.0, 3.0, 2.0, 3.1), (0, 1, 2, 2), 2),
    ],
)  # fmt: skip
def test_partial_explanations_that_are_worth_naming(errors, counts, kept):
    steps = [SimpleNamespace(held_out=error, effects=('a', 'b')[:n]) for error, n in zip(errors, counts, strict=True)]
    assert predicts_best(steps) == kept
