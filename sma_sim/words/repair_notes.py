"""What was repaired in the recordings of a dataset, each note once."""

from __future__ import annotations

from collections.abc import Sequence

from sma_sim.evidence.data.recording import Dataset

MAX_NAMES = 3


def grouped_notes(datasets: Sequence[Dataset]) -> list[str]:
    """The notes of all recordings, equal ones joined, then those of the datasets."""
    names: dict[str, list[str]] = {}
    for recording in (recording for dataset in datasets for recording in dataset.recordings):
        for note in recording.notes:
            names.setdefault(note, []).append(recording.name)
    common = dict.fromkeys(note for dataset in datasets for note in dataset.notes)
    return [*(f'{abbreviated_list(found)}: {note}' for note, found in names.items()), *common]


def abbreviated_list(names: Sequence[str]) -> str:
    """A few names, and how many more."""
    more = f' and {len(names) - MAX_NAMES} more' if len(names) > MAX_NAMES else ''
    return ', '.join(names[:MAX_NAMES]) + more
