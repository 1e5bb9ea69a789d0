"""What was repaired in the recordings of a dataset, each note once."""

from __future__ import annotations

import re
from collections.abc import Sequence

from sma_sim.evidence.data.recording import Dataset
from sma_sim.model.shown import listed

MAX_NAMES = 3
NUMBER = re.compile(r'(?<![\w.])\d+(\.\d+)?(e[-+]?\d+)?')  # not that of a name such as T_1


def grouped_notes(datasets: Sequence[Dataset]) -> list[str]:
    """The notes of all recordings, those that differ in their numbers only joined; then those of the datasets."""
    alike: dict[str, list[tuple[str, str]]] = {}
    for recording in (recording for dataset in datasets for recording in dataset.recordings):
        shapes = [NUMBER.sub('0', note) for note in recording.notes]
        for shape, note in zip(shapes, recording.notes, strict=True):
            alike.setdefault(note if shapes.count(shape) > 1 else shape, []).append((recording.name, note))
    common = dict.fromkeys(note for dataset in datasets for note in dataset.notes)
    return [*map(joined, alike.values()), *common]


def joined(notes: Sequence[tuple[str, str]]) -> str:
    """Notes of recordings (name, note) as one, with the numbers of the first."""
    (first, note), *others = notes
    differ = any(other != note for _, other in others)
    names = listed([name for name, _ in notes], MAX_NAMES)
    return f'{names}: {note}' + (f' (so in {first}; other numbers in others)' if differ else '')
