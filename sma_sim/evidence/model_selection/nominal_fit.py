"""The fit without further effects, with either kinetics: where a search for missing effects begins."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import isnan
from pathlib import Path

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.calibrate import FitOptions, check_kinetics, kinetics_to_try, multistart_search
from sma_sim.evidence.estimation.cross_validation import cross_validated
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.log_evidence import more_probable
from sma_sim.evidence.estimation.nuisance_effects import with_nuisance_effects, with_temperature_gradient
from sma_sim.evidence.estimation.search_context import OnModel, SearchContext, silent_model
from sma_sim.evidence.estimation.stop_criteria import NOMINAL_MODEL
from sma_sim.evidence.model_selection.candidate_fit import is_bent
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.model.config import Config
from sma_sim.model.expected import as_folders
from sma_sim.model.renamed import renamed


@renamed(model='kinetics')
@dataclass(frozen=True)
class DiagnosisRequest:
    """How to diagnose.

    Attributes
    ----------
    kinetics
        ``'hybrid'``, ``'mas'``, or ``'auto'`` for the more probable of both; None: as the configuration says.
    folders
        Folders of effects of your own, which are looked for too.
    seed
        Seed of the significance tests.
    options
        Of the fits.
    equation
        Whether to look for the equation of what no known effect explains.
    variants
        Whether effects are tried in one wire, coordinate or channel only, too.
    on_model
        Called with every model as it is found.
    """

    kinetics: str | None = None
    folders: tuple[Path, ...] = ()
    seed: int = 0
    options: FitOptions = field(default_factory=lambda: FitOptions(starts=CRITERIA.nominal_starts))
    equation: bool = True
    variants: bool = True
    on_model: OnModel = silent_model

    def __post_init__(self) -> None:
        check_kinetics(self.kinetics)
        object.__setattr__(self, 'folders', tuple(as_folders('folders', self.folders)))


def nominal_fit(training: Dataset, config: Config, request: DiagnosisRequest, context: SearchContext) -> FitResult:
    """The fit without further effects, with the more probable of the kinetics."""
    fits, config = list[FitResult](), with_nuisance_effects(config, training)
    tried = kinetics_to_try(request.kinetics, config)
    context.on_progress(f'kinetics: {tried[0]}, as given' if len(tried) == 1 else 'kinetics: not given, both are fitted')
    for model in tried:
        context.on_progress(f'fitting the {model} model')
        known = config.variant(kinetics=model)
        best = multistart_search(training, known, request.options, context, NOMINAL_MODEL)
        given = tuple(active.found.effect.name for active in config.effects)
        if not (fits and context.stop.is_set()):  # after a stop, the last one is not complete
            fits.append(replace(best, problem=replace(best.problem, nominal_effects=given)))
        if context.stop.is_set():
            break
    chosen = more_probable(fits, context.pool)
    found = cross_validated(chosen, context)
    context.on_progress(f'{found.problem.config.simulated_kinetics}: error over noise {found.prediction_error:.2f}')
    for fit in fits:
        report_model('nominal', found if fit is chosen else fit, context)
    return found


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
    request = replace(request, kinetics=nominal.problem.config.simulated_kinetics)
    found = nominal_fit(training, with_temperature_gradient(config), request, context)
    return replace(found, is_bent=is_bent(found, context))


def report_model(kind: str, fit: FitResult, context: SearchContext) -> None:
    """Tell of a model that was fitted."""
    context.on_model(kind, fit.effects, fit.problem.config.simulated_kinetics, fit.error, fit.prediction_error)
