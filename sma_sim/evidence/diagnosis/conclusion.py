"""What is made of the models that a search has found: formulas beside them, the held-out runs, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt

from sma_sim.evidence.diagnosis.judgement import (
    helps_little,
    is_contradicted,
    predicts_best,
    reaches_beyond_fitted,
    verdict_after_removal,
    verdict_of,
)
from sma_sim.evidence.diagnosis.model_stage import ModelStage, StageData, StageKind, final_stage, provisional_stage
from sma_sim.evidence.estimation.calibrate import FitOptions
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.candidate_fit import is_bent
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.evidence.model_selection.forward_selection import leaves_something
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.evidence.model_selection.pooled_refit import PooledErrors, pooled_refit
from sma_sim.evidence.symbolic_regression.propose import FormulaSearch, Proposal, propose

ModelPath = list[tuple[StageKind, FitResult]]  # the models from the nominal one to the last


@dataclass(frozen=True)
class Conclusion:
    """What is made of the models that were found: the verdict, the last of them without a formula, and the rest of a
    `Diagnosis` that follows from both."""  # fmt: skip

    verdict: str
    last: FitResult
    stages: tuple[ModelStage, ...]
    pooled_errors: PooledErrors | None
    proposal: Proposal | None


def conclusion(
    path: ModelPath, data: StageData, request: DiagnosisRequest, formulas: FormulaSearch | None, context: SearchContext
) -> Conclusion:
    """Let formulas compete with the effects where these leave more than noise, and read the held-out runs."""
    stages = [provisional_stage(data, kind, fit, context) for kind, fit in path]
    fits, proposal = [fit for _, fit in path], None
    if formulas is not None and not context.stop.is_set():
        fits[-1] = replace(fits[-1], is_bent=is_bent(fits[-1], context))
        proposal = propose(fits, formulas) if leaves_room(fits, data.limit) else None
    if proposal is not None:
        last = next(fit for _, fit in path if fit.effects == proposal.fit.effects[:-1])
        stage = final_stage(data, 'formula', proposal.fit, context)
        if not helps_little([*stages, stage], data.limit):
            return Conclusion('unknown_effect', last, (*stages, stage), None, proposal)
        context.on_progress('the held-out runs are predicted as well without the formula')
    if is_contradicted(stages, data.limit):
        return taken_back(path, stages, data, context)
    stages[-1] = final_stage(data, *path[-1], context)
    last, pooled = explained_together(path, stages, data, request.options, context)
    if is_contradicted(stages, data.limit, pooled):
        return taken_back(path, stages, data, context)
    if last.effects != path[-1][1].effects:
        stages.append(final_stage(data, 'taken_back', last, context))
    return Conclusion(verdict_of(stages[-1], pooled, data.limit), last, tuple(stages), pooled, None)


def taken_back(path: ModelPath, stages: Sequence[ModelStage], data: StageData, context: SearchContext) -> Conclusion:
    """The model that predicts the held-out runs best, without the effects that were added after it."""
    context.on_progress('the held-out runs are predicted better with fewer effects')
    fewer = path[predicts_best(stages)][1]
    stage = final_stage(data, 'taken_back', fewer, context)
    return Conclusion(verdict_after_removal(stage, data.limit), fewer, (*stages, stage), None, None)


def explained_together(
    path: ModelPath, stages: Sequence[ModelStage], data: StageData, options: FitOptions, context: SearchContext
) -> tuple[FitResult, PooledErrors | None]:
    """The last model and its errors when it is fitted to the held-out runs too; None where it does not miss these.

    Where ambient temperatures had to differ for that, it is a model with fewer effects if one explains all runs so too.
    """
    last = path[-1][1]
    known = data.under(last, context)
    if not (known.held_out and reaches_beyond_fitted(stages[-1], data.limit)):
        return last, None
    datasets = known.training, known.held_out
    pooled = pooled_refit(datasets, last, stages[-1].predicted, options, context, data.limit)
    for (_, fit), stage in zip(path[:-1], stages, strict=False) if pooled is not None and pooled.ambient else ():
        if len(fit.effects) < len(last.effects):
            fewer = pooled_refit(datasets, fit, stage.predicted, options, context, data.limit)
            if fewer is not None and fewer.explained(data.limit):
                context.on_progress('ambient temperatures that differ explain all runs with fewer effects')
                return fit, fewer
    return last, pooled


def leaves_room(path: Sequence[FitResult], limit: float) -> bool:
    """Whether a formula could explain better than the effects of the last model of a path: it leaves much in the fitted
    runs, or is bent.

    A formula that stands alone has to explain a part of the error that only more than noise can have, in fitted runs too:
    where these do not determine the parameters, it predicts better by chance. One effect that leaves only noise there, or
    nearly nothing of what the bare model leaves, stands, however it predicts and however far other parameters are from the
    nominal ones: nothing fits better by odds that are no chance. Several may imitate one formula: also where they leave
    only noise, if the last of them adds little to the others.
    """
    bare, last = path[0], path[-1]
    if limit > CRITERIA.unexplained and last.error <= limit:
        return False
    if len(last.effects) > 1:
        before = [fit.error for fit in path if len(fit.effects) < len(last.effects)][-1]
        return last.is_bent or leaves_something(last) or before <= CRITERIA.unexplained
    if last.effects:
        beyond_noise = sqrt(max(0.0, last.error**2 - 1.0))
        return last.error > CRITERIA.other_kinetics_above and beyond_noise > CRITERIA.min_error_reduction * bare.error
    return last.is_bent or (last.error > CRITERIA.pooled_noise_only and last.prediction_error > CRITERIA.noise_only)
