"""Would the verdict be the same if another run had been held out? From the models that the search has cross-validated.

Each of them was refitted without each fitted run in turn (in groups, where there are many). Without a run, an effect is
accepted if it lowers the error of the other runs, each predicted without itself, by as much as the search asks for; the run
that was left out then judges the model, as the held-out runs do. The search itself is not repeated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import nan
from types import MappingProxyType

from sma_sim.evidence.diagnosis.model_stage import ModelStage
from sma_sim.evidence.estimation.cross_validation import interpolated, mean_error
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.model_selection.candidate_fit import SelectionStep
from sma_sim.evidence.model_selection.criteria import CRITERIA, fits_all


@dataclass(frozen=True)
class HeldOutVerdict:
    """What a diagnosis with this run held out would say, and the error over noise with which it is predicted."""

    verdict: str
    effects: tuple[str, ...]
    error: float


@dataclass(frozen=True)
class JudgedModel:
    """A model of the search: by run, the error when it was left out (`predicted`) and when all runs were fitted (`fitted`).

    `rivals`: models with another effect in the place of its last one, which the verdict does not call indistinguishable.
    """

    effects: tuple[str, ...]
    predicted: Mapping[str, float]
    fitted: Mapping[str, float] = field(default_factory=dict)
    rivals: tuple[JudgedModel, ...] = ()
    formula: bool = False

    def error_of(self, runs: Sequence[str]) -> float:
        """Error of some runs, each predicted without itself."""
        return mean_error({name: self.predicted[name] for name in runs})


def judged_model(
    fit: FitResult, stage: ModelStage, rivals: Sequence[JudgedModel] = (), formula: bool = False
) -> JudgedModel:
    """A model of the path; `stage` has the runs that were held out from all fits."""
    predicted = {**fit.left_out_errors, **{run.name: run.error for run in stage.predicted}}
    fitted = {run.name: run.error for run in stage.runs}
    return JudgedModel(fit.effects, predicted, fitted, tuple(rivals), formula)


def rivals_of(fit: FitResult, steps: Sequence[SelectionStep]) -> list[JudgedModel]:
    """The cross-validated rivals of the effect with which a step ended in this fit."""
    found = []
    for step in steps:
        if step.accepted is not None and step.after is fit:
            known = (step.accepted.name, *step.accepted.indistinguishable)
            found += [JudgedModel(candidate.fit.effects, candidate.fit.left_out_errors) for candidate in step.candidate_fits
                      if candidate.name not in known and candidate.plausible and candidate.fit.left_out_errors]  # fmt: skip
    return found


def verdicts_by_run(
    path: Sequence[JudgedModel], limit: float = CRITERIA.unexplained, levels: Mapping[str, float] = MappingProxyType({})
) -> dict[str, HeldOutVerdict]:
    """By run, fitted and held out; `path` leads from the nominal model to the last, `levels` are those of isobaric tests.

    Empty for a single fitted run, and where the first or the last model was not refitted without each run.
    """
    fitted = list(path[0].fitted)
    compared = [model for model in path if set(fitted) <= set(model.predicted)]
    if len(fitted) < 2 or len(compared) < 1 or compared[0] is not path[0] or compared[-1] is not path[-1]:
        return {}
    return {
        run: verdict_without(run, interpolated({n: levels.get(n, nan) for n in fitted if n != run}), compared, limit)
        for run in path[0].predicted
    }


def verdict_without(run: str, judges: Sequence[str], path: Sequence[JudgedModel], limit: float) -> HeldOutVerdict:
    """What the `judges` among the others say, and how that predicts the run."""
    best, least = path[0], path[0].error_of(judges)
    for model in path[1:]:
        error = model.error_of(judges)
        more = len(model.effects) > len(best.effects)
        if lowers_enough(error, least, CRITERIA.min_error_reduction if more else -CRITERIA.min_error_reduction):
            best, least = model, error
    for rival in best.rivals if run in path[0].fitted else ():  # without a run that no fit has seen, the search was as it is
        error = rival.error_of(judges)
        if lowers_enough(error, least, CRITERIA.min_error_reduction):
            best, least = rival, error
    error, together = best.predicted[run], path[-1].fitted.get(run)
    explained = error <= limit or (together is not None and together <= fits_all(limit))
    known = best.effects[:-1] if best.formula else best.effects
    verdict = 'unknown_effect' if best.formula or not explained else 'missing_effect' if known else 'none'
    return HeldOutVerdict(verdict, known, error)


def lowers_enough(error: float, before: float, fraction: float) -> bool:
    """Whether the error is lower by a fraction of that before, or of the noise where that is larger."""
    return before - error >= fraction * max(before, 1.0)


def differing(verdicts: Mapping[str, HeldOutVerdict], verdict: str, effects: Sequence[str]) -> dict[str, HeldOutVerdict]:
    """The runs that would have led to another verdict or to other effects."""
    return {
        name: found for name, found in verdicts.items() if found.verdict != verdict or set(found.effects) != set(effects)
    }
