"""What was repaired in the recordings of a dataset, each note once."""

from __future__ import annotations

from collections.abc import Sequence

from sma_sim.evidence.data.recording import Dataset
from sma_sim.model.shown import listed

MAX_NAMES = 3


def grouped_notes(datasets: Sequence[Dataset]) -> list[str]:
    """The notes of all recordings, equal ones joined, then those of the datasets."""
    names: dict[str, list[str]] = {}
    for recording in (recording for dataset in datasets for recording in dataset.recordings):
        for note in recording.notes:
            names.setdefault(note, []).append(recording.name)
    common = dict.fromkeys(note for dataset in datasets for note in dataset.notes)
    return [*(f'{listed(found, MAX_NAMES)}: {note}' for note, found in names.items()), *common]
