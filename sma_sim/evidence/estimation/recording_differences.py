"""What may differ between the recordings of a campaign: unknowns of each recording, never physics of the robot."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sma_sim.evidence.data.recording import GAIN, Dataset, Recording
from sma_sim.evidence.estimation.residuals import FitData, beginning_stds, steps_of_powers, with_late_changes
from sma_sim.model.shown import joined_words

AMBIENT_STD = 3.0  # [K]: by which rooms differ from day to day
ZERO_PART = 0.05  # of what a channel usually changes by: sensors are set by hand, a larger zero is seen before recording


@dataclass(frozen=True)
class RecordingDifference:
    """Something that each recording has its own: the `zeros` of channels, each with its prior (SI), which may drift by as
    much from its first sample to the last (`drifting`); the `ambient` temperature; what is left of a motion before it
    (`in_motion`); how late each command takes effect (`late_commands`); what each power was before it was rounded
    (`rounded_commands`); a `parameter`, with the `std` of its logarithm; or a wire that gets no power, by the sign of its
    commands (`unpowered_side`), in some `recordings`.

    `words` name it.
    """

    words: str
    zeros: tuple[tuple[str, float], ...] = ()
    drifting: bool = False
    ambient: bool = False
    in_motion: bool = False
    late_commands: bool = False
    rounded_commands: bool = False
    parameter: str = ''
    std: float = 0.0
    unpowered_side: int = 0
    recordings: tuple[str, ...] = ()

    def in_run(self, run: FitData) -> FitData:
        """A run with it."""
        if self.zeros:
            none = (0.0,) * len(run.channels)
            zero = dict(zip(run.channels, run.zero_std or none, strict=True)) | dict(self.zeros)
            drift = dict(zip(run.channels, run.drift_std or none, strict=True)) | (dict(self.zeros) if self.drifting else {})
            zero_std, drift_std = (tuple(stds[name] for name in run.channels) for stds in (zero, drift))
            return replace(run, zero_std=zero_std, drift_std=drift_std)
        if self.ambient:
            return replace(run, ambient_std=AMBIENT_STD)
        if self.in_motion:
            return replace(run, beginning_std=beginning_stds(run.structure))
        if self.late_commands:
            source, changed, interval = with_late_changes(run.source, run.changed, run.interval)
            return replace(run, source=source, changed=changed, interval=interval, group=np.arange(len(changed)))
        if self.rounded_commands:
            return replace(run, rounded_to=steps_of_powers(run.source))
        if self.parameter:
            return replace(run, varied={**run.varied, self.parameter: self.std})
        return replace(run, unpowered_side=self.unpowered_side) if run.name in self.recordings else run

    def in_recording(self, recording: Recording) -> Recording:
        """A recording with it."""
        if self.zeros:
            own = {name: std for name, std in self.zeros if name in recording.channels}
            drifts = own if self.drifting else {}
            zero_std, drift_std = {**recording.zero_std, **own}, {**recording.drift_std, **drifts}
            return replace(recording, zero_std=zero_std, drift_std=drift_std)
        if self.ambient:
            return replace(recording, ambient_std=AMBIENT_STD)
        if self.in_motion:
            return replace(recording, in_motion=True)
        if self.late_commands:
            return replace(recording, late_commands=True)
        if self.rounded_commands:
            return replace(recording, rounded_commands=True)
        if self.parameter:
            return replace(recording, varied={**recording.varied, self.parameter: self.std})
        return replace(recording, unpowered_side=self.unpowered_side) if recording.name in self.recordings else recording


def zeros_of(stds: Mapping[str, float], drifting: bool = False) -> RecordingDifference:
    """The zeros of some channels, by their priors (SI)."""
    several = 's' * (len(stds) > 1)
    words = f'{f"the drift{several} of " if drifting else ""}the zero{several} of {joined_words(list(stds))}'
    return RecordingDifference(words, zeros=tuple(stds.items()), drifting=drifting)


AMBIENT = RecordingDifference('the ambient temperature', ambient=True)
IN_MOTION = RecordingDifference('how warm its wires are when it begins', in_motion=True)
LATE_COMMANDS = RecordingDifference('how late each command takes effect', late_commands=True)
# Of the logarithm: a fan, a draught or another posture (Morgan, Adv. Heat Transfer 11, 1975: a factor of two between
# correlations); a bundle that was clamped anew, by a fifth of a per cent of its length; a battery that has emptied
CONVECTION_STD, LENGTH_STD, SUPPLY_STD = 0.2, 0.002, 0.05
CONVECTION = RecordingDifference('the heat transfer to the air', parameter='wire.lambda', std=CONVECTION_STD)
LENGTH = RecordingDifference('the length of its wires', parameter='wire.l0', std=LENGTH_STD)
SUPPLY = RecordingDifference('the power that its driver gives', parameter=GAIN, std=SUPPLY_STD)
ROUNDED_COMMANDS = RecordingDifference('the rounding of commands', rounded_commands=True)
BY_NAME = {
    'ambient': AMBIENT, 'heat-transfer': CONVECTION, 'length': LENGTH, 'power': SUPPLY, 'rounded-commands': ROUNDED_COMMANDS,
}  # fmt: skip


def with_differences(dataset: Dataset, differences: Collection[RecordingDifference]) -> Dataset:
    """A dataset with what differs between its recordings."""
    recordings: Sequence[Recording] = dataset.recordings
    for difference in differences:
        recordings = [difference.in_recording(recording) for recording in recordings]
    return replace(dataset, recordings=tuple(recordings))
