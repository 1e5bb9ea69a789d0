"""A diagnosis beside its data: all that a report shows and that has to be simulated or evaluated first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.evidence.diagnosis.stage_change import StageChange, stage_change
from sma_sim.evidence.estimation.recording_differences import with_differences
from sma_sim.evidence.residual_analysis.compare import compared_calibration
from sma_sim.evidence.residual_analysis.summary import Summary, summarize
from sma_sim.model.parameters import DEFAULTS


@dataclass(frozen=True)
class DiagnosisReview:
    """A diagnosis, its recordings, and what was computed from both.

    `changes`: by accepted effect, where the stage that added it changed most; `remaining`: the
    last model beside all recordings; `initial_values`: parameters of the nominal model, defaults where it has none.
    """

    diagnosis: Diagnosis
    training: Dataset
    held_out: Dataset | None
    changes: Mapping[str, StageChange]
    remaining: Summary
    initial_values: Mapping[str, float]


def reviewed(diagnosis: Diagnosis, training: Dataset, held_out: Dataset | None) -> DiagnosisReview:
    """Evaluate a diagnosis on the recordings that it was made with. Raises SimulationError."""
    training = with_differences(training, diagnosis.differences)
    held_out = held_out and with_differences(held_out, diagnosis.differences)
    changes = {
        step.accepted.name: stage_change(*change, training, held_out)
        for step in diagnosis.selection_steps
        if step.accepted is not None and (change := diagnosis.change('added', step.accepted.name)) is not None
    }
    values = {name: parameter.default for name, parameter in DEFAULTS.items()} | dict(diagnosis.nominal.values)
    for parameter in diagnosis.calibration.free:
        values.setdefault(parameter.name, parameter.center)
    comparison = compared_calibration(diagnosis.calibration, training, held_out, diagnosis.predicted, 'last step')
    return DiagnosisReview(diagnosis, training, held_out, changes, summarize(comparison), values)
