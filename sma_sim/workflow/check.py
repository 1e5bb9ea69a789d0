"""What was read: runs, channels, what is missing or was repaired, and the noise, as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sma_sim.evidence.data.recording import Dataset, Recording, in_order
from sma_sim.solver.inputs import inputs_at
from sma_sim.words.repair_notes import grouped_notes


@dataclass(frozen=True)
class DataCheck:
    """Recordings as they were read, and the names of those that are held out."""

    dataset: Dataset
    held_out: tuple[str, ...]

    def as_data(self) -> dict[str, Any]:
        """The check for JSON, SI units: ``runs``, ``noise_std`` by channel and ``notes`` in words."""
        noise = self.dataset.noise_std
        return {
            'system': self.dataset.system,
            'runs': [run_data(recording, recording.name in self.held_out) for recording in self.dataset.recordings],
            'noise_std': {name: noise[name] for name in in_order(noise, self.dataset.system)},
            'notes': grouped_notes([self.dataset]),
        }


def data_check(dataset: Dataset, held_out: Dataset | None) -> DataCheck:
    """The check of a dataset of which some recordings are held out."""
    return DataCheck(dataset, tuple(recording.name for recording in held_out.recordings) if held_out else ())


def run_data(recording: Recording, held_out: bool) -> dict[str, Any]:
    """One run: its time, its channels with the samples that are missing, its input."""
    steps = np.diff(recording.time)
    inputs = inputs_at(recording.source, recording.time)
    return {
        'name': recording.name,
        'held_out': held_out,
        'samples': len(recording.time),
        'begin': float(recording.time[0]),
        'end': float(recording.time[-1]),
        'sample_time': float(np.median(steps)) if len(steps) else None,
        'longest_gap': float(steps.max()) if len(steps) else None,
        'channels': {name: range_data(values) for name, values in recording.channels.items()},
        'inputs': {name: range_data(values) for name, values in inputs.items()},
        'notes': list(recording.notes),
    }


def range_data(values: Any) -> dict[str, Any]:
    """Samples that are there and missing, the least and the largest value."""
    known = values[np.isfinite(values)]
    return {
        'samples': len(known),
        'missing': len(values) - len(known),
        'least': float(known.min()) if len(known) else None,
        'largest': float(known.max()) if len(known) else None,
    }
