"""What is made of the models that a search has found: the held-out runs are read, and the verdict is given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isnan, sqrt

from sma_sim.evidence.diagnosis.model_stage import ModelStage, StageData, StageKind, final_stage, provisional_stage
from sma_sim.evidence.estimation.calibrate import FitOptions
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.criteria import CRITERIA, fits_all
from sma_sim.evidence.model_selection.pooled_refit import PooledErrors, pooled_refit
from sma_sim.evidence.search.beam import Book
from sma_sim.evidence.search.equations import has_terms
from sma_sim.evidence.search.posterior import EVEN, Posterior
from sma_sim.evidence.search.refine import Model

ModelPath = Sequence[tuple[StageKind, FitResult]]  # the models from the nominal one to the last


@dataclass(frozen=True)
class Conclusion:
    """The verdict, the last model, and what the held-out runs have said of it."""

    verdict: str
    last: FitResult
    stages: tuple[ModelStage, ...]
    pooled_errors: PooledErrors | None


@dataclass(frozen=True)
class HeldOutVerdict:
    """What a diagnosis with this run held out would say, and the normalized RMSE with which it is predicted."""

    verdict: str
    effects: tuple[str, ...]
    error: float = field(default=float('nan'))


def conclusion(
    path: ModelPath, posterior: Posterior, data: StageData, options: FitOptions, context: SearchContext
) -> Conclusion:
    """Read the held-out runs once: they confirm the last model, or speak for an earlier one."""
    stages = [provisional_stage(data, kind, fit, context) for kind, fit in path]
    stages[-1] = final_stage(data, *path[-1], context)
    last, pooled = path[-1][1], None
    known = data.under(last, context)
    if known.held_out and reaches_beyond_fitted(stages[-1], data.limit):
        pooled = pooled_refit((known.training, known.held_out), last, stages[-1].predicted, options, context, data.limit)
    explained = pooled is not None and pooled.explained(data.limit)
    best = predicts_best(stages)
    if best < len(stages) - 1 and stages[-1].held_out > data.limit and not explained:
        context.on_progress('the held-out runs are predicted better with fewer components')
        last = path[best][1]
        stages.append(final_stage(data, 'retracted', last, context))
        return Conclusion('unknown_effect', last, tuple(stages), None)
    return Conclusion(verdict_of(stages[-1], pooled, posterior, data.limit), last, tuple(stages), pooled)


def predicts_best(stages: Sequence[ModelStage]) -> int:
    """The stage that predicts the held-out runs best; the last one without any."""
    if isnan(stages[-1].held_out):
        return len(stages) - 1
    return min(range(len(stages)), key=lambda k: (stages[k].held_out, -k))


def reaches_beyond_fitted(last: ModelStage, limit: float) -> bool:
    """Whether the fitted runs are explained, and those held out are not."""
    return last.train <= max(CRITERIA.noise_only, fits_all(limit)) and last.held_out > limit


def verdict_of(last: ModelStage, pooled: PooledErrors | None, posterior: Posterior, limit: float) -> str:
    """`none`, `missing_effect`, or `unknown_effect` where much is left, or where no listed effect is what is missing.

    Without a held-out run the error of the fitted ones counts. A held-out run that the model explains when it is fitted to
    all runs (`pooled`) only goes further than the fitted ones.
    """
    error = last.train if isnan(last.held_out) else last.held_out
    explained = error <= limit or (pooled is not None and pooled.explained(limit))
    if has_terms(posterior.best) or not explained:
        return 'unknown_effect'
    if last.effects:
        return 'missing_effect'
    return 'unknown_effect' if limit <= CRITERIA.unexplained and posterior.unlisted > EVEN else 'none'


def verdicts_by_run(book: Book, posterior: Posterior, data: StageData, last: Conclusion) -> Mapping[str, HeldOutVerdict]:
    """By recording, the verdict if it were held out: the best model by the evidence of the others, which then predicts it.

    Evidence and prediction follow from the derivatives of each fit, to second order; no search is repeated. With a run that
    no fit has seen the verdict is as it is. Empty for a single fitted run.
    """
    problem, k = book.best.fit.problem, posterior.overdispersion
    if len(problem.runs) < 2:
        return {}
    found = {}
    for number, run in enumerate(problem.runs):
        best = max(book.models.values(), key=lambda model: model.evidence.score(k, number))
        error = sqrt(best.evidence.squares_without(k, number) / max(1, run.samples))
        effects = tuple(one.name for one in best.components if not (one.is_difference or one.is_formula))
        found[run.name] = HeldOutVerdict(verdict_without(best, error, effects, data.limit), effects, error)
    for fit in last.stages[-1].predicted:
        effects = tuple(name for name in last.last.effects if name in posterior.effects)
        found[fit.name] = HeldOutVerdict(last.verdict, effects, fit.error)
    return found


def verdict_without(best: Model, error: float, effects: Sequence[str], limit: float) -> str:
    """The verdict on the model that is best without one run."""
    if has_terms(best) or error > limit:
        return 'unknown_effect'
    if effects:
        return 'missing_effect'
    return 'unknown_effect' if best.lacks_unlisted else 'none'
