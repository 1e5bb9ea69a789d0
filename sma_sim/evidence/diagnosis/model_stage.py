"""The stages of a diagnosis: the models from the nominal one to the last, each with what it leaves of the error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.train_test_split import pooled
from sma_sim.evidence.estimation.calibrate import (
    SAME_OPTIMUM,
    Calibration,
    FitOptions,
    calibration_of,
    final_calibration,
    full_problem,
)
from sma_sim.evidence.estimation.fit_result import FitResult, OtherStart
from sma_sim.evidence.estimation.held_out_prediction import RunFit, evaluate_held_out, pooled_error
from sma_sim.evidence.estimation.overdispersion import overdispersion
from sma_sim.evidence.estimation.recording_differences import RecordingDifference, with_differences
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS
from sma_sim.evidence.model_selection.criteria import CRITERIA, unexplained_above
from sma_sim.evidence.model_selection.refit import refit
from sma_sim.evidence.model_selection.sketches import at_defaults
from sma_sim.model.config import Config
from sma_sim.model.structures.discovery import known_structures

StageKind = Literal['nominal', 'added', 'retracted', 'formula']


@dataclass(frozen=True)
class ModelStage:
    """A model of a diagnosis: its fit, and the held-out runs as it predicts them (none where no run is held out).

    `kind`, compared with the stage before: `nominal` is the first; an effect was `added`, or `retracted` because held-out
    runs are predicted better without it; a `formula` was added for what no known effect explains.
    """

    kind: StageKind
    effects: tuple[str, ...]
    calibration: Calibration
    predicted: tuple[RunFit, ...]

    @property
    def model(self) -> str:
        """`hybrid` or `mas`."""
        return self.config.simulated_kinetics

    @property
    def config(self) -> Config:
        """The configuration with the fitted parameters."""
        return self.calibration.config

    @property
    def delay(self) -> float:
        """The fitted delay of the measurement [s]."""
        return self.calibration.delay

    @property
    def values(self) -> Mapping[str, float]:
        """The fitted parameters by name (SI)."""
        return self.calibration.values

    @property
    def runs(self) -> tuple[RunFit, ...]:
        """The training runs under the model."""
        return self.calibration.runs

    @property
    def train(self) -> float:
        """Normalized RMSE of the training runs."""
        return self.calibration.error

    @property
    def channel_errors(self) -> Mapping[str, float]:
        """Normalized RMSE of the training runs, by channel."""
        return self.calibration.channel_errors

    @property
    def held_out(self) -> float:
        """Normalized RMSE of the held-out runs, NaN without any."""
        return pooled_error(self.predicted)[0]

    @property
    def held_out_channel_errors(self) -> Mapping[str, float]:
        """Normalized RMSE of the held-out runs, by channel."""
        return pooled_error(self.predicted)[1]


@dataclass(frozen=True)
class StageData:
    """What all stages are fitted to, what they predict, and how they are fitted."""

    training: Dataset
    held_out: Dataset | None
    options: FitOptions

    @property
    def limit(self) -> float:
        """The normalized RMSE above which something is missing that no accepted effect explains."""
        structures = [known_structures()[recording.system] for recording in self.training.recordings]
        if not all(structure.is_quasi_static for structure in structures) or 'strain' not in self.training.noise_std:
            return CRITERIA.unexplained
        span = max(
            float(np.nanmax(run.channels['strain']) - np.nanmin(run.channels['strain']))
            for run in self.training.recordings
            if 'strain' in run.channels
        )
        return unexplained_above(span / self.training.noise_std['strain'])

    def predicted_by(self, fit: FitResult, context: SearchContext) -> tuple[RunFit, ...]:
        """The held-out runs under a model."""
        return self.under(fit, context).predicted(fit, context)

    def predicted(self, fit: FitResult | Calibration, context: SearchContext) -> tuple[RunFit, ...]:
        """The held-out runs, as they are here, under a model."""
        return evaluate_held_out(fit.config, self.held_out, fit.delay, context.pool, fit.error) if self.held_out else ()

    def under(self, fit: FitResult, context: SearchContext) -> StageData:
        """The same with what differs between the recordings in a model; of held-out runs that is what predicts them best."""
        differences, held_out = fit.problem.differences, self.held_out
        if not differences:
            return self
        held_out = None if held_out is None else with_differences(held_out, differences)
        for side in {difference.unpowered_side for difference in differences} - {0}:
            held_out = None if held_out is None else with_lost_power(held_out, side, fit, context)
        return replace(self, training=with_differences(self.training, differences), held_out=held_out)

    def differences(self, fit: FitResult, context: SearchContext) -> tuple[RecordingDifference, ...]:
        """What differs between the recordings in a model, the held-out ones among them."""
        data = self.under(fit, context)
        recordings = pooled(data.training, data.held_out).recordings
        sides = {one.name: one.unpowered_side for one in recordings if one.unpowered_side}
        return tuple(
            replace(difference, recordings=tuple(name for name, side in sides.items() if side == difference.unpowered_side))
            for difference in fit.problem.differences
        )


def with_lost_power(dataset: Dataset, side: int, fit: FitResult, context: SearchContext) -> Dataset:
    """Held-out runs, without the power of commands of one sign where a model predicts them better so."""
    without = replace(dataset, recordings=tuple(replace(one, unpowered_side=side) for one in dataset.recordings))
    errors = [
        [run.error for run in evaluate_held_out(fit.config, runs, fit.delay, context.pool)] for runs in (dataset, without)
    ]
    pairs = zip(dataset.recordings, without.recordings, *errors, strict=True)
    return replace(dataset, recordings=tuple(lost if less < error else one for one, lost, error, less in pairs))


def provisional_stage(data: StageData, kind: StageKind, fit: FitResult, context: SearchContext) -> ModelStage:
    """A model as it was fitted in the search; its errors are those of all samples."""
    data = data.under(fit, context)
    whole = replace(fit, problem=full_problem(data.training, fit, data.options))
    found = calibration_of(whole, context)
    return ModelStage(kind, fit.effects, found, data.predicted(fit, context))


def final_stage(data: StageData, kind: StageKind, fit: FitResult, context: SearchContext) -> ModelStage:
    """A model fitted on all samples, with intervals."""
    context.on_progress('the last fit, on all samples')
    data, fit = data.under(fit, context), with_noise_of_its_size(fit)
    fit = fit if kind == 'formula' else from_defaults_too(fit, context)
    options = replace(data.options, free=tuple(p.name for p in fit.problem.free))
    found = final_calibration(data.training, fit, options, context)
    return ModelStage(kind, fit.effects, found, data.predicted(found, context))


def from_defaults_too(fit: FitResult, context: SearchContext) -> FitResult:
    """A model with effects, or the better minimum to which it leads from the nominal values with these at their defaults.

    A search comes to its last model from those with fewer effects, a fit that asks for all of them does not: both are to
    give the same answer. The minimum that is not taken is kept as another start.
    """
    if not fit.effects or context.stop.is_set():
        return fit
    context.on_progress('the same model from its nominal values')
    other = refit(fit.problem, at_defaults(fit.problem), context, FROM_PRIORS)
    if other is None:
        return fit
    best, worse = (other, fit) if other.cost < fit.cost - SAME_OPTIMUM else (fit, other)
    more, k = worse.cost - best.cost, overdispersion(best.problem, best.z, context.pool)
    start = OtherStart(more, worse.values, abs(more) < SAME_OPTIMUM, more / k**2)
    return replace(fit, z=best.z, cost=best.cost, other_starts=(*fit.other_starts, start))


def with_noise_of_its_size(fit: FitResult) -> FitResult:
    """A tempered fit whose noise has the size of what it leaves: in the end no candidates are compared by their priors."""
    problem = fit.problem
    return replace(fit, problem=replace(problem, tempering=max(1.0, fit.error))) if problem.tempering > 1.0 else fit
