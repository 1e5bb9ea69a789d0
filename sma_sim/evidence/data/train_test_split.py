"""Which recordings of a dataset are fitted, and which are held out."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

from sma_sim.evidence.data.recording import Dataset, Recording, has_same_samples
from sma_sim.evidence.data.sources import recordings_in
from sma_sim.model.errors import UserError
from sma_sim.model.nearest import suggestion

MIN_RUNS_TO_HOLD_OUT = 3  # with fewer, nothing is held out unless the user asks for it


def held_out_files(words: Sequence[str]) -> list[Path]:
    """The files among the words of ``--hold-out``: they belong to the data even where only named there. Raises UserError."""
    return [file for word in words if Path(word).exists() for file in recordings_in(Path(word))]


def sorted_by_name(dataset: Dataset) -> Dataset:
    """The recordings in the order of their names, numbers in them as numbers (run2 before run10)."""

    def key(recording: Recording) -> list[tuple[int, str]]:
        parts = re.split(r'(\d+)', recording.name)
        return [(int(part), '') if part.isdecimal() else (0, part) for part in parts]

    return replace(dataset, recordings=tuple(sorted(dataset.recordings, key=key)))


def split_dataset(dataset: Dataset, words: Sequence[str]) -> tuple[Dataset, Dataset | None]:
    """The recordings to fit and those held out, which `words` name: a file, a folder or the name (stem) of a recording.

    Raises UserError for a word that names no recording, and where nothing is left to fit.
    """
    names = [recording.name for recording in dataset.recordings]
    chosen: set[str] = set()
    for word in words:
        matching = {name for name in names if matches(name, word)}
        if not matching:
            hint = suggestion(word, names)
            raise UserError(f'--hold-out {word}: no such file and no such recording{hint}; there are {", ".join(names)}')
        chosen |= matching
    training = tuple(recording for recording in dataset.recordings if recording.name not in chosen)
    held_out = tuple(recording for recording in dataset.recordings if recording.name in chosen)
    if not training:
        raise UserError(f'--hold-out {" ".join(words)}: that is all there is ({", ".join(names)}); leave some to fit')
    return replace(dataset, recordings=training), replace(dataset, recordings=held_out) if held_out else None


def matches(name: str, word: str) -> bool:
    """Whether a word of ``--hold-out`` names the recording `name` (``run``, ``run#2`` or ``folder/run``)."""
    stem = name.partition('#')[0]
    if word in (name, stem, stem.rpartition('/')[2]):
        return True
    path = Path(word)
    files = recordings_in(path) if path.exists() else []
    return any(
        stem in (recording_name(file), f'{file.resolve().parent.name}/{recording_name(file)}', str(file)) for file in files
    )


def recording_name(path: Path) -> str:
    """What a recording is called after its file (or the folder of a bag)."""
    return path.stem if path.is_file() else path.name


def hold_out_last(dataset: Dataset, held_out: Dataset | None) -> tuple[Dataset, Dataset | None]:
    """Training and held-out recordings by name: the last name of several is held out where nothing else was chosen.

    By name, so that the result does not depend on the order in which the recordings are given.
    """
    training = sorted_by_name(dataset)
    if held_out is not None:
        if not held_out.recordings:
            raise UserError('held_out: there is no recording; leave it out, or give some')
        names = {recording.name for recording in training.recordings}
        if both := [recording.name for recording in held_out.recordings if recording.name in names]:
            raise UserError(f'held_out: {", ".join(both)} is among the recordings to fit too; leave it in one of both')
        for own, fitted in product(held_out.recordings, training.recordings):
            if has_same_samples(own, fitted):
                raise UserError(
                    f'held_out: {own.name} is a copy of {fitted.name}, which is fitted: it would be predicted by itself'
                )
        return training, sorted_by_name(held_out)
    if len(training.recordings) < MIN_RUNS_TO_HOLD_OUT:
        return training, None
    *rest, last = training.recordings
    return replace(dataset, recordings=tuple(rest)), replace(dataset, recordings=(last,))


def pooled(training: Dataset, held_out: Dataset | None) -> Dataset:
    """All recordings together."""
    return replace(training, recordings=(*training.recordings, *(held_out.recordings if held_out else ())))


def apart(everything: Dataset, count: int) -> tuple[Dataset, Dataset | None]:
    """The first `count` of the recordings that were pooled, and those that were held out."""
    held_out = everything.recordings[count:]
    training = replace(everything, recordings=everything.recordings[:count])
    return training, replace(everything, recordings=held_out) if held_out else None
