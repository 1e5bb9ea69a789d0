"""The fit without further effects, with either kinetics: where a search for missing effects begins."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from sma_sim.evidence.estimation.calibrate import FitOptions, multistart_search
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.log_evidence import more_probable
from sma_sim.evidence.estimation.prepared_fit import PreparedFit, agreed_kinetics
from sma_sim.evidence.estimation.search_context import OnModel, SearchContext, silent_model
from sma_sim.evidence.estimation.stop_criteria import NOMINAL_MODEL
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.model.argument_checks import as_folders, check_fields
from sma_sim.model.config import Config
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.discovery import package_effects
from sma_sim.model.renamed import renamed

GRADIENT = 'temperature_gradient'  # the effect of a specimen that is not equally warm
NOMINAL_STARTS = 2  # one may end in a valley that the other one avoids


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
    options: FitOptions = field(default_factory=lambda: FitOptions(starts=NOMINAL_STARTS))
    equation: bool = True
    variants: bool = True
    on_model: OnModel = silent_model

    def __post_init__(self) -> None:
        check_fields(self)
        object.__setattr__(self, 'kinetics', agreed_kinetics(self.kinetics, self.options.kinetics))
        object.__setattr__(self, 'folders', tuple(as_folders('folders', self.folders)))


def nominal_fits(start: PreparedFit, options: FitOptions, context: SearchContext) -> list[FitResult]:
    """The fits without further effects, with each of the kinetics to try; those that were complete before a stop.

    Isobaric tests are fitted with a difference of temperature along the specimen: without one the model transforms from one
    sample to the next, where a fit sees no way, and gradual transformation would be found in every specimen.
    """
    fits, tried = list[FitResult](), start.kinetics
    context.on_progress(f'kinetics: {tried[0]}, as given' if len(tried) == 1 else 'kinetics: not given, both are fitted')
    for kinetics in tried:
        context.on_progress(f'fitting the {kinetics} model')
        model = start.with_kinetics(kinetics)
        best = nominal_fit_of(model, options, context)
        if best.problem.is_isobaric and not context.stop.is_set():
            context.on_progress('with a difference of temperature along the specimen')
            best = nominal_fit_of(replace(model, config=with_temperature_gradient(model.config)), options, context)
        if not (fits and context.stop.is_set()):
            fits.append(best)
        if context.stop.is_set():
            break
    for fit in fits:
        report_model('nominal', fit, context)
    return fits


def nominal_fit_of(start: PreparedFit, options: FitOptions, context: SearchContext) -> FitResult:
    """One of them; what is active from the start is no finding."""
    best = multistart_search(start, options, context, NOMINAL_MODEL)
    given = tuple(active.effect.name for active in start.config.effects)
    return replace(best, problem=replace(best.problem, nominal_effects=given))


def nominal_fit(start: PreparedFit, options: FitOptions, context: SearchContext) -> FitResult:
    """The fit without further effects, with the more probable of the kinetics."""
    return more_probable(nominal_fits(start, options, context), context.pool)


def report_model(kind: str, fit: FitResult, context: SearchContext) -> None:
    """Tell of a model that was fitted."""
    context.on_model(kind, fit.effects, fit.problem.config.simulated_kinetics, fit.error)


def with_temperature_gradient(config: Config) -> Config:
    """The configuration of a specimen whose temperature may differ from end to end; itself where one is active already."""
    if any(given.effect.name == GRADIENT for given in config.effects):
        return config
    effect = effect_on(package_effects()[GRADIENT], config.structure, config.parameters)
    return with_effect(config, effect, {p.name: p.default for p in effect.parameters})
