"""Where a stage of a diagnosis changed most: one channel of one run, before and after."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.diagnosis.model_stage import ModelStage
from sma_sim.evidence.estimation.held_out_prediction import nuisances_of
from sma_sim.evidence.residual_analysis.compare import ComparedRun, compared_run


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
    first, then = (before.predicted, after.predicted) if out else (before.runs, after.runs)
    channel = most_changed(before, after, out)
    worst = max((fit for fit in first if channel in fit.channel_errors), key=lambda fit: fit.channel_errors[channel])
    same = next(fit for fit in then if fit.name == worst.name)
    k = [recording.name for recording in dataset.recordings].index(worst.name)
    run_before = compared_run(dataset, k, before.config, nuisances_of(before.delay, first))
    run_after = compared_run(dataset, k, after.config, nuisances_of(after.delay, then))
    return StageChange(channel, out, run_before, run_after, (worst.channel_errors[channel], same.channel_errors[channel]))


def most_changed(before: ModelStage, after: ModelStage, out: bool) -> str:
    """The channel whose squared error over noise decreased most."""
    if out:
        first, then = before.held_out_channel_errors, after.held_out_channel_errors
    else:
        first, then = before.channel_errors, after.channel_errors
    return max((name for name in first if name in then), key=lambda name: first[name] ** 2 - then[name] ** 2)
