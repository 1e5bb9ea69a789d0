"""What the held-out runs say of the models that a search has found: which of them stands, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan

from sma_sim.evidence.diagnosis.model_stage import ModelStage
from sma_sim.evidence.model_selection.criteria import CRITERIA, fits_all
from sma_sim.evidence.model_selection.pooled_refit import PooledErrors


def predicts_best(stages: Sequence[ModelStage]) -> int:
    """The last stage that takes a part worth naming from the held-out error; the last of all without held-out runs.

    What imitates something else takes little, or comes and goes with the run that is held out. A stage without more effects
    (one was replaced or dropped) is undone only if it costs as much.
    """
    if isnan(stages[-1].held_out):
        return len(stages) - 1
    best = 0
    for k, stage in enumerate(stages):
        more = len(stage.effects) > len(stages[best].effects)
        reduction = CRITERIA.min_named_reduction if more else -CRITERIA.min_named_reduction
        if stage.held_out <= (1.0 - reduction) * stages[best].held_out:
            best = k
    return best


def reaches_beyond_fitted(last: ModelStage, limit: float = CRITERIA.unexplained) -> bool:
    """Whether the fitted runs are explained, and those held out are not."""
    return last.train <= max(CRITERIA.noise_only, fits_all(limit)) and last.held_out > limit


def helps_little(stages: Sequence[ModelStage], limit: float = CRITERIA.unexplained) -> bool:
    """Whether the last stage leaves much in the held-out runs, and takes no part worth naming from it."""
    return verdict_of(stages[-1], None, limit) == 'unknown_effect' and predicts_best(stages) < len(stages) - 1


def is_contradicted(
    stages: Sequence[ModelStage], limit: float = CRITERIA.unexplained, pooled: PooledErrors | None = None
) -> bool:
    """Whether held-out runs that are left unexplained speak against effects that were added after the stage that predicts
    them best.

    Where all fitted runs are explained and no stage predicts those held out, these may only go further than the fitted ones:
    a fit to all runs (`pooled`) tells, and speaks against the effects if it leaves as much.
    """
    beyond = reaches_beyond_fitted(stages[-1], limit) and stages[predicts_best(stages)].held_out > limit
    return helps_little(stages, limit) and not (beyond and (pooled is None or pooled.explained(limit)))


def verdict_of(last: ModelStage, pooled: PooledErrors | None, limit: float = CRITERIA.unexplained) -> str:
    """`none`, `missing_effect`, or `unknown_effect` where much is left unexplained.

    Without a held-out run the error of the fitted ones counts: that of runs left out in turn is large where one run alone
    cannot determine the parameters, which is no sign of an effect. Nor is a held-out run that the model explains when it is
    fitted to all runs (`pooled`).
    """
    error = last.train if isnan(last.held_out) else last.held_out
    if error > limit and not (pooled is not None and pooled.explained(limit)):
        return 'unknown_effect'
    return 'missing_effect' if last.effects else 'none'


def verdict_after_removal(last: ModelStage, limit: float = CRITERIA.unexplained) -> str:
    """The verdict on a model from which effects were taken back: what is left in the fitted runs asked for them."""
    return 'unknown_effect' if last.train > limit else verdict_of(last, None, limit)
