"""Values that a recording repeats, because of a coarse resolution or a sensor that is slower than it, are one measurement.

While a quantity moves by less than the resolution of its sensor, the rounding error stays what it is: a thousand rows of one
value tell what one row tells. Where noise is larger than the resolution, it makes the error of each row another one.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.data.noise import Noise
from sma_sim.evidence.data.recording import Dataset, Recording
from sma_sim.model.arrays import Vector

EDGE = 9  # stretches of equal values side by side
SHORT = 0.1  # of the longest of these: what noise makes at the edge of two steps is shorter


def without_repeated_values(dataset: Dataset, estimates: Mapping[str, Noise]) -> Dataset:
    """The dataset with one row for each value that is repeated, and notes on it, by the noise that its channels show.

    All rows stay of channels whose noise hides the resolution, or decides which of two steps is read (`Rounding`), or is
    stated by row or by what repeated experiments differ by; and of quasi-static tests, whose curves are read from them.
    """
    noise = dataset.noise_std
    rounded = {name: one.step for recording in dataset.recordings for name, one in recording.rounding.items()}
    repeating = {
        name: one
        for name, one in estimates.items()
        if (one.held or 0.0 < noise[name] < one.step) and name not in dataset.floor and name not in rounded
    }
    recordings = tuple(with_one_row_each(recording, repeating) for recording in dataset.recordings)
    coarse = {name: one.step for name, one in repeating.items() if not one.held}
    recordings = with_repeated_levels(recordings, {name: noise[name] for name in coarse})
    notes = [
        note_of(name, one, samples(dataset.recordings, name), left)
        for name, one in repeating.items()
        for left in (samples(recordings, name),)
        if left < samples(dataset.recordings, name)
    ]
    return replace(dataset, recordings=recordings, notes=(*dataset.notes, *notes), resolution={**coarse, **rounded})


def without_constant_channels(dataset: Dataset, stated: Collection[str]) -> Dataset:
    """The dataset without channels that never change, unless their noise is `stated`, with a note: how far they are from
    what they show nobody knows. All stay where none changes."""
    ends = dict[str, list[float]]()
    for name, shown in (channel for one in dataset.recordings for channel in one.channels.items()):
        known = np.asarray(shown)[np.isfinite(shown)]
        ends.setdefault(name, []).extend([known.min(), known.max()] if len(known) else [])
    still = [name for name, values in ends.items() if values and min(values) == max(values) and name not in stated]
    if not still or len(still) == len(ends):
        return dataset
    recordings = tuple(
        replace(one, channels={name: shown for name, shown in one.channels.items() if name not in still})
        for one in dataset.recordings
    )
    notes = [f'{name} never changes and is left out: say its noise if it is a measurement' for name in still]
    return replace(dataset, recordings=recordings, notes=(*dataset.notes, *notes))


def with_one_row_each(recording: Recording, repeating: Mapping[str, Noise]) -> Recording:
    """The recording with these channels where their values are new; rows without any measurement are left out, but the first
    and the last one."""
    own = [name for name in repeating if is_thinned(recording, name)]
    if not own:
        return recording
    channels = dict(recording.channels)
    for name in own:
        values = np.asarray(channels[name], dtype=float)
        channels[name] = np.where(is_new(values, repeating[name].held), values, np.nan)
    rows = np.any([np.isfinite(values) for values in channels.values()], axis=0)
    rows[[0, -1]] = True
    return replace(
        recording,
        time=np.asarray(recording.time)[rows],
        channels={name: np.asarray(values)[rows] for name, values in channels.items()},
        sample_std={name: np.asarray(stds)[rows] for name, stds in recording.sample_std.items()},
    )


def with_repeated_levels(recordings: Sequence[Recording], noise: Mapping[str, float]) -> tuple[Recording, ...]:
    """Recordings in which all readings of one value tell as much as one: a robot that comes to the same rest again has the
    same error of rounding there. `noise`: of a single reading, by channel whose resolution is coarse."""
    found = list(recordings)
    for name, std in noise.items():
        own = [k for k, one in enumerate(found) if is_thinned(one, name)]
        if own:
            values = np.concatenate([np.asarray(found[k].channels[name], dtype=float) for k in own])
            _, level, count = np.unique(values, return_inverse=True, return_counts=True)
            stds = np.split(std * np.sqrt(count[level]), np.cumsum([len(found[k].time) for k in own])[:-1])
            for k, part in zip(own, stds, strict=True):
                found[k] = replace(found[k], sample_std={**found[k].sample_std, name: part})
    return tuple(found)


def is_thinned(recording: Recording, channel: str) -> bool:
    """Whether rows of a channel that repeat a value may be left out."""
    own = channel in recording.channels and channel not in recording.sample_std
    return own and not recording.structure.is_quasi_static


def is_new(values: Vector, held: bool) -> NDArray[np.bool_]:
    """The rows (k,) that stand for those of equal values beside them: the first of a slow sensor (`held`), whose values grow
    old; else the middle one, where what moves is nearest to the middle of a step of the resolution. None stands for short
    returns to the step before: at the edge of two, noise decides between them."""
    from scipy.ndimage import maximum_filter1d  # only here: it takes long to import

    known = np.flatnonzero(np.isfinite(values))
    found = np.zeros(len(values), dtype=bool)
    if len(known):
        first = np.flatnonzero(np.diff(values[known], prepend=np.nan) != 0.0)
        last = np.append(first[1:], len(known)) - 1
        rows, level = known[first if held else (first + last) // 2], values[known[first]]
        count = last - first + 1
        returns = np.zeros(len(first), dtype=bool)
        returns[1:-1] = level[:-2] == level[2:]
        at_edge = returns & (count < SHORT * maximum_filter1d(count, EDGE))
        found[rows if held else rows[~at_edge]] = True
    return found


def samples(recordings: tuple[Recording, ...], channel: str) -> int:
    """How many values of a channel the recordings have."""
    return sum(int(np.isfinite(one.channels[channel]).sum()) for one in recordings if channel in one.channels)


def note_of(channel: str, noise: Noise, before: int, after: int) -> str:
    """What was left out, in words."""
    slow = 'the sensor is slower than the recording'
    why = slow if noise.held else f'the resolution of {in_display_unit(channel, noise.step)} is coarser than the noise'
    return f'{channel}: {after} of {before} values count, the others repeat them ({why})'
