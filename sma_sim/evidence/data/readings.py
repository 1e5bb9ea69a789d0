"""What the readings of a dataset show of their own noise: that they are rounded, and where they scatter more than elsewhere.

`read_dataset` asks for it on the way from files; a diagnosis asks for that of recordings that were made otherwise.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.data.noise import Noise, noise_by_channel
from sma_sim.evidence.data.recording import Dataset, Recording
from sma_sim.evidence.data.repeatability import levels_of_noise
from sma_sim.evidence.data.repeated_values import without_repeated_values
from sma_sim.evidence.data.rounding import rounding_of
from sma_sim.evidence.data.varying_noise import VaryingNoise, varying_noise
from sma_sim.model.arrays import Vector


def with_noise_of_readings(dataset: Dataset) -> Dataset:
    """The dataset with what its readings show beside the noise that is stated, and notes on it.

    As it is where that is known, or where its noise is what repeated experiments differ by.
    """
    if dataset.floor:
        return dataset
    recordings = with_rounding(dataset.recordings)
    found = {name: one for run in recordings for name, one in run.rounding.items() if name not in dataset.resolution}
    notes = [f'{name} is read in steps of {in_display_unit(name, one.step)}' for name, one in found.items()]
    channels = dataset.noise_std.keys() - dataset.resolution.keys()
    estimates = {name: one for name, one in noise_by_channel(recordings).items() if name in channels}
    coarse = {name: one for name, one in estimates.items() if one.quantised and not one.held and name not in found}
    varying = varying_by_channel(recordings, estimates, dataset.noise_std, ())
    if not (found or coarse or varying):
        return dataset
    recordings = with_varying_noise(recordings, dataset.noise_std, varying, notes)
    levels = {name: level for name, level in levels_of_noise(recordings, {}).items() if name in varying}
    rounded = {name: max(dataset.noise_std[name], estimates[name].std) for name in (*found, *coarse) if name in estimates}
    noise = {**dataset.noise_std, **levels, **rounded}
    steps = {**dataset.resolution, **{name: one.step for name, one in found.items()}}
    shown = replace(dataset, recordings=recordings, noise_std=noise, notes=(*dataset.notes, *notes), resolution=steps)
    one_row_each = without_repeated_values(shown, coarse)
    return replace(one_row_each, resolution={**dataset.resolution, **one_row_each.resolution})


def with_rounding(recordings: tuple[Recording, ...]) -> tuple[Recording, ...]:
    """The recordings with how their channels were rounded; not of quasi-static tests, whose curves are read from rows."""
    moving = [one for one in recordings if not one.structure.is_quasi_static]
    runs: dict[str, list[Vector]] = {}
    known = {name for one in moving for name in (*one.sample_std, *one.rounding)}
    for name, values in (channel for one in moving for channel in one.channels.items() if channel[0] not in known):
        runs.setdefault(name, []).append(values)
    found = {name: one for name, shown in runs.items() for one in (rounding_of(shown),) if one is not None}
    own = {one.name: {name: of for name, of in found.items() if name in one.channels} for one in moving}
    return tuple(
        replace(one, rounding={**one.rounding, **own[one.name]}) if own.get(one.name) else one for one in recordings
    )


def varying_by_channel(
    recordings: Sequence[Recording],
    estimates: Mapping[str, Noise],
    noise_std: Mapping[str, float],
    relative: Collection[str],
) -> dict[str, VaryingNoise]:
    """By channel, how its noise grows with the reading or with its speed, to more than is stated (`noise_std`).

    Not where that is stated by row or as a part of the size (`relative`), nor where readings are rounded or repeated, whose
    errors differ from row to row by themselves.
    """
    moving = [one for one in recordings if not one.structure.is_quasi_static]
    found = dict[str, VaryingNoise]()
    for name, noise in estimates.items():
        own = [one for one in moving if name in one.channels]
        known = name in relative or any(name in (*one.sample_std, *one.rounding) for one in own)
        varying = (
            None if known or noise.held or noise.quantised or not own else varying_noise(own, name, noise_std.get(name, 0.0))
        )
        if varying is not None:
            found[name] = varying
    return found


def with_varying_noise(
    recordings: Sequence[Recording], noise_std: Mapping[str, float], varying: Mapping[str, VaryingNoise], notes: list[str]
) -> tuple[Recording, ...]:
    """The recordings with the noise of each sample where it is `varying`, beside that at rest (`noise_std`)."""
    found = list[Recording]()
    for one in recordings:
        added = {name: noise.added(one.time, one.channels[name]) for name, noise in varying.items() if name in one.channels}
        stds = {name: np.hypot(noise_std[name], more) for name, more in added.items()}
        found.append(replace(one, sample_std={**one.sample_std, **stds}) if stds else one)
    for name, noise in varying.items():
        grows = f'{100.0 * noise.growth:.2g} % of the reading' if noise.growth > 0.0 else ''
        jitters = (
            f'its speed times {1e3 * noise.jitter:.2g} ms, as a clock that jitters makes it' if noise.jitter > 0.0 else ''
        )
        notes.append(f'noise of {name}: beside that, {" and ".join(filter(None, (grows, jitters)))}')
    return tuple(found)
