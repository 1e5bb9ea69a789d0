"""Whether recordings begin at rest, as every model does: else what a wire did before passes for missing physics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.data.recording import Recording
from sma_sim.model.arrays import Vector
from sma_sim.model.shown import listed
from sma_sim.solver.inputs import Input

MIN_RESTING = 10  # samples that tell where a robot rests, and that it has left
EARLY_MOTION = 0.1  # of what a channel spans is no drift
NOT_AT_REST = (
    'every model begins at rest in ambient temperature, and will be wrong where wires are warm from before, unless a '
    'diagnosis finds how warm, or fit, compare and next are told by --in-motion'
)
MAX_NAMES = 5  # of recordings in a note
MAX_LATE_COMMAND = 0.2  # [s] beyond the delays of sensors and messages that a fit estimates


def early_motion(powers: Sequence[str], time: Vector, channels: Mapping[str, Vector], source: Input) -> list[str]:
    """A note where a robot that rests begins to move clearly before its first command: commands are missing there.

    A recorder that hears of a controller late misses its first commands. What moves from the first sample on may cool from
    an earlier run, or drift: that is said too.
    """
    heating = source.values[:, [source.columns.index(name) for name in powers]]
    on = np.asarray((heating != 0.0).any(axis=1))
    if not on.any() or on[0]:
        return []
    commanded_at = float(source.times[int(np.argmax(on))])
    found, cooling = {}, []
    for channel, values in channels.items():
        known = np.isfinite(values)
        before = known & (time < commanded_at)
        if before.sum() < MIN_RESTING:
            continue
        t, y = time[before], values[before]
        clear = EARLY_MOTION * float(np.ptp(values[known]))
        resting = max(MIN_RESTING, len(t) // 4)
        lasting = np.ptp(y[:resting]) * (t - t[0]) / (t[resting - 1] - t[0])  # had it gone on as in the beginning
        away = np.abs(y - y[0]) > clear + lasting
        if away[-MIN_RESTING:].all():
            found[channel] = float(t[len(away) - int(np.argmin(away[::-1]))])
        elif (np.abs(y[-MIN_RESTING:] - y[0]) > clear).all():
            cooling.append(channel)
    if found and commanded_at - min(found.values()) >= MAX_LATE_COMMAND:
        begin = f'{", ".join(found)}: in motion from {min(found.values()):.6g} s on'
        return [
            f'{begin}, but the first command is at {commanded_at:.6g} s: earlier ones were not recorded (a recorder may '
            'hear of a controller late), and the model will be wrong; leave this recording out'
        ]
    if cooling:
        return [
            f'{", ".join(cooling)}: in motion at the first sample, before any command: {NOT_AT_REST}; if nothing was '
            'commanded before either, something drifts'
        ]
    return []


def different_beginnings(recordings: Sequence[Recording]) -> list[str]:
    """Notes where recordings of one robot begin at clearly different coordinates, or a wire is clearly warmer than the air:
    as those do that are cut out of a long one, or follow each other too soon."""
    notes = list[str]()
    for structure in dict.fromkeys(one.structure for one in recordings):
        for channel in structure.channels if structure.imposed_temperature < 0 else ():
            is_temperature = channel.partition('_')[0] == 'T'
            if not is_temperature and channel not in structure.coordinate_names:
                continue
            having = [one for one in recordings if one.system == structure.name and channel in one.channels]
            runs = [one for one in having if channel not in one.zero_std and np.isfinite(one.channels[channel]).any()]
            if not runs:
                continue
            known = [one.channels[channel][np.isfinite(one.channels[channel])] for one in runs]
            clear = EARLY_MOTION * float(np.ptp(np.concatenate(known)))
            first = {one.name: float(values[0]) for one, values in zip(runs, known, strict=True)}
            if is_temperature:
                above = {one.name: first[one.name] - float(one.source.values[0, -1]) for one in runs}
                notes += [
                    f'{channel} of {name} begins {in_display_unit(channel, apart)} above that of the air: {NOT_AT_REST}'
                    for name, apart in above.items()
                    if abs(apart) > clear
                ]
                continue
            low, high = min(first, key=first.__getitem__), max(first, key=first.__getitem__)
            if (apart := first[high] - first[low]) > clear:
                notes.append(f'{channel} of {high} begins {in_display_unit(channel, apart)} above {low}: {NOT_AT_REST}')
    return notes


def stressed_beginnings(recordings: Sequence[Recording]) -> list[str]:
    """A note where wires whose strain is imposed begin clearly away from zero stress, as pieces of a longer pull do."""
    stresses = {one.name: one.channels['stress'] for one in recordings if 'stress' in one.channels}
    known = {name: values[np.isfinite(values)] for name, values in stresses.items() if np.isfinite(values).any()}
    clear = EARLY_MOTION * float(np.ptp(np.concatenate(list(known.values())))) if known else 0.0
    stressed = [
        f'{in_display_unit("stress", float(values[0]))} in {name}'
        for name, values in known.items()
        if abs(float(values[0])) > clear
    ]
    if not stressed:
        return []
    return [
        f'stress begins at {listed(stressed, MAX_NAMES)}: every model begins as a first pull from zero stress arrives '
        'there, and will be wrong where the wire was stretched further, let back or heated before; give the recording '
        'whole, or leave such a piece out'
    ]
