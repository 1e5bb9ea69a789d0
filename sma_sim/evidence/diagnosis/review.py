"""A diagnosis beside its data: all that a report shows and that has to be simulated or evaluated first."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.train_test_split import pooled
from sma_sim.evidence.diagnosis.conclusion import ModelStage
from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.evidence.estimation.held_out_prediction import nuisances_of
from sma_sim.evidence.estimation.recording_differences import with_differences
from sma_sim.evidence.residual_analysis.compare import ComparedRun, Comparison, compare, compared_calibration, compared_run
from sma_sim.evidence.residual_analysis.metrics import ChannelScore, channel_scores, total_error
from sma_sim.evidence.residual_analysis.summary import Summary, summarize
from sma_sim.evidence.set_up.faults import without_faults
from sma_sim.model.config import Config


@dataclass(frozen=True)
class DiagnosisReview:
    """A diagnosis, its recordings, and what was computed from both.

    `given`: the user's model as it is beside all recordings, and `given_values` its parameters, defaults of effects that it
    does not have. `nominal_values`: those of the same model calibrated, which is bent towards what it lacks. `changes`: by
    accepted effect, where the stage that added it changed most; `remaining`: the last model beside all recordings.
    """

    diagnosis: Diagnosis
    training: Dataset
    held_out: Dataset | None
    given: Comparison
    given_values: Mapping[str, float]
    nominal_values: Mapping[str, float]
    changes: Mapping[str, StageChange]
    remaining: Summary

    @property
    def given_errors(self) -> tuple[float, float]:
        """Normalized RMSE of the user's model in the fitted and in the held-out runs; NaN without any."""
        return tuple(total_error(self.scores(held_out)) for held_out in (False, True))  # type: ignore[return-value]

    def scores(self, held_out: bool) -> list[ChannelScore]:
        """How well the user's model does, by channel."""
        return list(channel_scores(self.given.part(held_out), self.given.channels).values())


def reviewed(diagnosis: Diagnosis, dataset: Dataset, held_out: Dataset | None, given: Config) -> DiagnosisReview:
    """Evaluate a diagnosis on the recordings that it was made with, from the model as it was `given`.

    `dataset`, `held_out`: as they were given to `diagnose`. Raises SimulationError and UserError.
    """
    named = {recording.name: recording for recording in pooled(dataset, held_out).recordings}
    fitted, rest = (tuple(named[name] for name in names) for names in (diagnosis.training, diagnosis.held_out))
    other = replace(held_out or dataset, recordings=rest) if rest else None
    training, held_out = without_faults(replace(dataset, recordings=fitted), other, diagnosis.set_up)
    as_it_is = compare(training, given, held_out, 'the model as it was given')
    training = with_differences(training, diagnosis.differences)
    held_out = held_out and with_differences(held_out, diagnosis.differences)
    changes = {
        step.accepted.name: stage_change(*change, training, held_out)
        for step in diagnosis.selection_steps
        if step.accepted is not None and (change := diagnosis.change('added', step.accepted.name)) is not None
    }
    given_values = given.values
    for parameter in diagnosis.calibration.free:
        given_values.setdefault(parameter.name, parameter.center)
    comparison = compared_calibration(diagnosis.calibration, training, held_out, diagnosis.predicted, 'last step')
    nominal_values = given_values | dict(diagnosis.nominal.calibration.values)
    return DiagnosisReview(
        diagnosis, training, held_out, as_it_is, given_values, nominal_values, changes, summarize(comparison)
    )


@dataclass(frozen=True)
class StageChange:
    """The channel whose squared error decreased most, in the run where it was largest.

    `errors`: over noise, before and after.
    """

    channel: str
    held_out: bool
    before: ComparedRun
    after: ComparedRun
    errors: tuple[float, float]


def stage_change(before: ModelStage, after: ModelStage, training: Dataset, held_out: Dataset | None) -> StageChange:
    """The change from one stage to the next: in a held-out run where both can be run. Raises SimulationError."""
    predicted = bool(before.predicted) and bool(after.predicted) and math.isfinite(before.held_out + after.held_out)
    out = held_out is not None and predicted
    dataset = held_out if held_out is not None and out else training
    first, then = (one.predicted if out else one.calibration.runs for one in (before, after))
    errors, left = (one.held_out_channel_errors if out else one.channel_errors for one in (before, after))
    channel = max((name for name in errors if name in left), key=lambda name: errors[name] ** 2 - left[name] ** 2)
    worst = max((fit for fit in first if channel in fit.channel_errors), key=lambda fit: fit.channel_errors[channel])
    same = next(fit for fit in then if fit.name == worst.name)
    k = [recording.name for recording in dataset.recordings].index(worst.name)
    run_before = compared_run(dataset, k, before.config, nuisances_of(before.calibration.delay, first))
    run_after = compared_run(dataset, k, after.config, nuisances_of(after.calibration.delay, then))
    return StageChange(channel, out, run_before, run_after, (worst.channel_errors[channel], same.channel_errors[channel]))
