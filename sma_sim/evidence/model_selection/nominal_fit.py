"""The fit without further effects, with either kinetics: where a search for missing effects begins."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path

from sma_sim.evidence.data.recording import Campaign
from sma_sim.evidence.estimation.calibrate import MODELS, Options, search
from sma_sim.evidence.estimation.levenberg_marquardt import FIRST
from sma_sim.evidence.model_selection.forward_selection import SearchContext, prediction_error
from sma_sim.evidence.model_selection.refit import FitResult, validated
from sma_sim.model.config import Config

STARTS = 2  # of the nominal fit
NOMINAL = replace(FIRST, most=12, gain=1e-3)  # a model that lacks an effect creeps along valleys that end nowhere
PREFERENCE = 0.8  # of the hybrid model's error for that of MAS


@dataclass(frozen=True)
class DiagnosisRequest:
    """How to diagnose: kinetics (hybrid, mas or auto), folders of the user's effects, seed of the bootstrap.

    `equation`: whether to look for the equation of what no known effect explains.
    """

    model: str = 'auto'
    folders: tuple[Path, ...] = ()
    seed: int = 0
    options: Options = field(default_factory=lambda: Options(starts=STARTS))
    equation: bool = True


def nominal_fit(training: Campaign, config: Config, request: DiagnosisRequest, context: SearchContext) -> FitResult:
    """The better of the kinetics without further effects."""
    found = []
    for model in MODELS if request.model == 'auto' else (request.model,):
        context.on_progress(f'fitting the {model} model')
        best = search(training, replace(config, model=model), request.options, context.pool, context.stop, None, NOMINAL)
        found.append(validated(FitResult(best.problem, best.best.z, best.best.cost), context.pool, context.stop))
        context.on_progress(f'{model}: error over noise {prediction_error(found[-1]):.2f}')
        if context.stop.is_set():
            break
    whole = [one for one in found if isfinite(one.validated)] or found  # stopped on the way, the last one is not
    # MAS has the hybrid model as a limit (V_L large), so that the hybrid one must be clearly better to be taken
    return min(whole, key=lambda one: prediction_error(one) * (PREFERENCE if one.problem.config.model == 'mas' else 1.0))
