"""The fit without further effects, with either kinetics: where a search for missing effects begins."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import isfinite, isnan
from pathlib import Path

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.calibrate import MODELS, FitOptions, multistart_search
from sma_sim.evidence.estimation.cross_validation import cross_validated
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.nuisance_effects import with_nuisance_effects, with_temperature_gradient
from sma_sim.evidence.estimation.search_context import OnModel, SearchContext, silent_model
from sma_sim.evidence.estimation.stop_criteria import NOMINAL_MODEL
from sma_sim.evidence.model_selection.candidate_fit import is_bent
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.model.config import Config


@dataclass(frozen=True)
class DiagnosisRequest:
    """How to diagnose: kinetics (hybrid, mas or auto), folders of the user's effects, seed of the bootstrap.

    `equation`: whether to look for the equation of what no known effect explains. `variants`: whether effects are tried in
    one wire, coordinate or channel only too. `on_model`: hears of every model as it is found.
    """

    model: str = 'auto'
    folders: tuple[Path, ...] = ()
    seed: int = 0
    options: FitOptions = field(default_factory=lambda: FitOptions(starts=CRITERIA.nominal_starts))
    equation: bool = True
    variants: bool = True
    on_model: OnModel = silent_model


def nominal_fit(training: Dataset, config: Config, request: DiagnosisRequest, context: SearchContext) -> FitResult:
    """The better of the kinetics without further effects."""
    fits, config = list[FitResult](), with_nuisance_effects(config, training)
    for model in MODELS if request.model == 'auto' else (request.model,):
        context.on_progress(f'fitting the {model} model')
        best = multistart_search(training, replace(config, model=model), request.options, context, NOMINAL_MODEL)
        given = tuple(active.found.effect.name for active in config.effects)
        best = replace(best, problem=replace(best.problem, nominal_effects=given))
        fits.append(cross_validated(best, context))
        context.on_progress(f'{model}: error over noise {fits[-1].prediction_error:.2f}')
        report_model('nominal', fits[-1], context)
        if context.stop.is_set():
            break
    complete = [fit for fit in fits if isfinite(fit.cross_validated_error)] or fits  # after a stop, the last one is not
    return min(complete, key=comparable_error)


def on_uneven_specimen(
    nominal: FitResult, training: Dataset, config: Config, request: DiagnosisRequest, context: SearchContext
) -> FitResult:  # fmt: skip
    """The base of a search in isobaric tests: fitted with a difference of temperature along the specimen; else `nominal`.

    Without one the model transforms from one sample to the next, where a fit sees no way, and gradual transformation within
    these kelvins, or what imitates it, would be found in every specimen.
    """
    if isnan(nominal.problem.span) or context.stop.is_set():
        return nominal
    context.on_progress('with a difference of temperature along the specimen')
    request = replace(request, model=nominal.problem.config.model)
    found = nominal_fit(training, with_temperature_gradient(config), request, context)
    return replace(found, is_bent=is_bent(found, context))


def report_model(kind: str, fit: FitResult, context: SearchContext) -> None:
    """Tell of a model that was fitted."""
    context.on_model(kind, fit.effects, fit.problem.config.model, fit.error, fit.prediction_error)


def comparable_error(fit: FitResult) -> float:
    """The error by which kinetics are compared."""
    return fit.prediction_error * (CRITERIA.hybrid_error_ratio if fit.problem.config.model == 'mas' else 1.0)
