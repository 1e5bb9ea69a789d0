"""What a bench adds to the noise of its sensors: zeros that differ from recording to recording, repeats that differ.

Two recordings of the same command differ by more than noise: grips settle, the air moves. No model of the experiment can be
closer than this floor. What they differ by lasts, so that neighbouring samples say it again: as many samples are kept as
are independent, each with noise and floor together, and priors keep the weight that they have beside so little.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import hypot, sqrt

import numpy as np

from sma_sim.evidence.data.column_map import INDEPENDENT_AFTER, ColumnMap
from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.data.recording import Dataset, Recording
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import PhysicsWarning, UserError
from sma_sim.model.shown import joined_words

SAME_COMMAND = 0.02  # of the energy that was commanded: two recordings repeat each other as long as it differs by less
AMBIENT = 'T_E_K'  # the column whose zero is that of the ambient temperature of each recording
MIN_COMMON, COMPARED = 0.25, 1000  # part of the shorter recording that must be common; instants that are compared
VISIBLE = 3.0  # times the noise: floors below are not told


@dataclass(frozen=True)
class Repeatability:
    """What recordings of the same command differ by in a channel (SI, standard deviation of each), and for how long [s]."""

    channel: str
    floor: float
    lasting: float
    names: tuple[str, ...]


def with_bench(dataset: Dataset, mapping: ColumnMap) -> Dataset:
    """The dataset with what its map says of the bench, and notes on it. Raises UserError."""
    channels = channels_in(dataset.recordings)
    stated = {name: entry for name, entry in mapping.origins.items() if entry.zero_std or entry.drift_std or entry.floor}
    room = stated.get(AMBIENT)
    ambient_std = stated.pop(AMBIENT).zero_std if room and room.unknown == (room.zero_std, 0.0, 0.0) else 0.0
    for name in stated:
        if name not in channels:
            raise UserError(
                f'the map {mapping.path}, {name}: zero_std, drift_std and floor belong to measured columns, expected some '
                f'of {", ".join(channels)}'
            )
    warn_of_imposed(stated, channels, dataset.recordings, mapping)
    measured = {channel for recording in dataset.recordings for channel in recording.channels}
    zeros = {channels[name]: entry.zero_std for name, entry in stated.items() if entry.zero_std}
    floor = {channels[name]: entry.floor for name, entry in stated.items() if entry.floor and channels[name] in measured}
    if floor and mapping.independent_after <= 0.0:
        raise UserError(
            f'the map {mapping.path}: a floor needs {INDEPENDENT_AFTER}, the time in seconds for which what '
            'repeated experiments differ by lasts'
        )
    relative = relative_noise(mapping, dataset.recordings)
    drifts = {channels[name]: entry.drift_std for name, entry in stated.items() if entry.drift_std}
    dataset, recordings = replace(dataset, nuisances=mapping.nuisances), dataset.recordings
    if zeros or drifts or ambient_std:
        recordings = tuple(
            replace(
                one,
                zero_std=zeros,
                drift_std=drifts,
                ambient_std=0.0 if one.structure.imposed_temperature >= 0 else ambient_std,
            )
            for one in recordings
        )
    known = dataset.noise_std
    recordings = tuple(with_sample_noise(one, known, relative, floor) for one in recordings)
    dataset = replace(dataset, noise_std={**known, **levels_of_noise(recordings, floor)})
    notes = [*dataset.notes, *map(note_of_repeats, repeatability(recordings, dataset.noise_std) if mapping.path else ())]
    if not floor:
        return replace(dataset, recordings=recordings, notes=tuple(notes))
    noise = {name: hypot(std, floor.get(name, 0.0)) for name, std in dataset.noise_std.items()}
    words = ', '.join(f'{name} {in_display_unit(name, value)}' for name, value in floor.items())
    notes.append(f'repeats differ by {words}, which counts as noise: one sample in {mapping.independent_after:g} s is kept')
    kept = tuple(thinned(recording, mapping.independent_after) for recording in recordings)
    return replace(dataset, recordings=kept, noise_std=noise, notes=tuple(notes), floor=floor)


def warn_of_imposed(
    stated: Collection[str], channels: Mapping[str, str], recordings: Iterable[Recording], mapping: ColumnMap
) -> None:
    """Warn of columns whose zero, drift or floor a map states, and which recordings have as what their bench imposes."""
    for name in stated:
        imposing = [
            one.name for one in recordings if channels[name] not in one.channels and name in one.structure.input_columns
        ]
        if imposing:
            words = (
                f'the map {mapping.path}, {name}: it is imposed in {joined_words(imposing)}, and zero_std, drift_std and '
                'floor act on what is measured. What is imposed is taken as it is: correct its zero in the file, or with an '
                'offset in the map'
            )
            warnings.warn(words, PhysicsWarning, stacklevel=4)


def channels_in(recordings: Iterable[Recording]) -> dict[str, str]:
    """By column, the channels that some recordings may have."""
    return {column: name for recording in recordings for name, column in recording.columns.items()}


def relative_noise(mapping: ColumnMap, recordings: Iterable[Recording]) -> dict[str, float]:
    """By channel of recordings, of which a map says that its noise is relative to its size, by which part."""
    channels = channels_in(recordings)
    return {channels[name]: entry.relative_std for name, entry in mapping.origins.items() if entry.relative_std}


def with_sample_noise(
    recording: Recording, noise_std: Mapping[str, float], relative: Mapping[str, float], floor: Mapping[str, float]
) -> Recording:
    """A recording with the noise of each sample of channels whose noise is `relative` to their size, or stated by row, and
    with what repeats differ by (SI)."""
    found = {}
    for name in (channel for channel in recording.channels if channel in (*relative, *recording.sample_std)):
        own = np.broadcast_to(recording.sample_std.get(name, noise_std[name]), recording.time.shape)
        own = np.where(np.isnan(own), noise_std[name], own)
        size = np.nan_to_num(np.abs(recording.channels[name]))
        found[name] = np.sqrt(own**2 + (relative.get(name, 0.0) * size) ** 2 + floor.get(name, 0.0) ** 2)
    return replace(recording, sample_std=found)


def levels_of_noise(recordings: Sequence[Recording], floor: Mapping[str, float]) -> dict[str, float]:
    """By channel with a noise of each sample, the root mean square of it over all samples, but for the `floor` (SI)."""
    found = dict[str, list[Vector]]()
    for recording in recordings:
        for name, stds in recording.sample_std.items():
            found.setdefault(name, []).append(stds)
    squares = {name: float(np.nanmean(np.concatenate(own) ** 2)) - floor.get(name, 0.0) ** 2 for name, own in found.items()}
    return {name: sqrt(square) for name, square in squares.items()}


def thinned(recording: Recording, interval: float) -> Recording:
    """The recording with one sample in each interval [s]; its input stays."""
    time = np.asarray(recording.time, float)
    rows = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], interval)))
    channels = {name: values[rows] for name, values in recording.channels.items()}
    stds = {name: values[rows] for name, values in recording.sample_std.items()}
    return replace(recording, time=time[rows], channels=channels, sample_std=stds)


def repeatability(recordings: Sequence[Recording], noise_std: Mapping[str, float]) -> tuple[Repeatability, ...]:
    """By channel, what pairs of recordings differ by as long as their commands agree; nothing that noise explains."""
    found = []
    for channel in dict.fromkeys(name for recording in recordings for name in recording.channels):
        differences, lasting, names = list[Vector](), list[float](), dict[str, None]()
        for one, other in combinations([r for r in recordings if channel in r.channels], 2):
            until = common_time(one, other)
            if until is None:
                continue
            difference, step = difference_until(one, other, channel, until)
            differences.append(difference)
            lasting.append(step * integral_scale(difference))
            names |= dict.fromkeys((one.name, other.name))
        if differences:
            floor = sqrt(0.5 * float(np.mean(np.concatenate(differences) ** 2)))
            if floor > VISIBLE * noise_std.get(channel, 0.0):
                found.append(Repeatability(channel, floor, float(np.median(lasting)), tuple(names)))
    return tuple(found)


def note_of_repeats(found: Repeatability) -> str:
    """The repeatability of a channel in words."""
    size = in_display_unit(found.channel, found.floor)
    return (
        f'{", ".join(found.names)} repeat one command and differ in {found.channel} by {size}, for '
        f'{found.lasting:.2g} s: no model can be closer (floor and {INDEPENDENT_AFTER} of a map)'
    )


def energy(recording: Recording, times: Vector) -> Vector:
    """What all wires were commanded to take until each of the times (k,) [J]."""
    source, held = recording.source, times[1:] - np.diff(times)
    wires = [k for k, name in enumerate(source.names) if name.startswith('J')]
    rows = np.clip(np.searchsorted(source.times, held, side='right') - 1, 0, None)
    power = np.abs(np.asarray(source.values, float)[rows][:, wires]).sum(axis=1)
    return np.concatenate([[0.0], np.cumsum(power * np.diff(times))])


def common_time(one: Recording, other: Recording) -> float | None:
    """Until when [s] two recordings had the same command, None where that is short or nothing was commanded until then."""
    first, last = max(one.time[0], other.time[0]), min(one.time[-1], other.time[-1])
    if last <= first:
        return None
    times = np.linspace(first, last, COMPARED)
    a, b = energy(one, times), energy(other, times)
    most = max(float(a[-1]), float(b[-1]))
    apart = np.flatnonzero(np.abs(a - b) > SAME_COMMAND * most)
    end = int(apart[0]) - 1 if len(apart) else COMPARED - 1
    if end < MIN_COMMON * COMPARED or min(a[end], b[end]) <= SAME_COMMAND * most:
        return None
    return float(times[end])


def difference_until(one: Recording, other: Recording, channel: str, until: float) -> tuple[Vector, float]:
    """What a channel differs by at common instants (COMPARED,) until then, their zeros removed where unknown; their step."""
    times = np.linspace(max(one.time[0], other.time[0]), until, COMPARED)
    shown = []
    for recording in (one, other):
        values = np.asarray(recording.channels[channel], float)
        known = np.isfinite(values)
        shown.append(np.interp(times, np.asarray(recording.time, float)[known], values[known]))
    difference = shown[0] - shown[1]
    if channel in one.zero_std:
        difference = difference - difference.mean()
    return difference, float(times[1] - times[0])


def integral_scale(values: Vector) -> float:
    """For how many samples values (k,) stay like themselves: the sum of their autocorrelation until it vanishes."""
    around = values - values.mean()
    size = float(around @ around)
    if size == 0.0:
        return 1.0
    spectrum = np.abs(np.fft.rfft(around, 2 * len(around))) ** 2
    correlation = np.fft.irfft(spectrum)[: len(around)] / size
    below = np.flatnonzero(correlation <= 0.0)
    return float(2.0 * correlation[: below[0] if len(below) else None].sum() - 1.0)
