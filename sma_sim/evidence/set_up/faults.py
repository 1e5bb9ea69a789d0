"""Faults of a set-up: what may be wrong with the columns of recordings, and the recordings without it.

A wire that is connected to the other amplifier, a sensor that counts the other way, a column in another unit, a noise that
is stated wrong: none of them is physics of the robot, and each looks like much of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import log, pi
from typing import Literal, TypeVar

import numpy as np

from sma_sim.evidence.data.noise import noise_by_channel
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS, Dataset, Recording
from sma_sim.evidence.data.rounding import Rounding
from sma_sim.evidence.data.train_test_split import apart, pooled
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.search.criteria import NOISE_ONLY
from sma_sim.model.shown import joined_words
from sma_sim.model.structures.structure import Structure
from sma_sim.solver.inputs import Input, inputs_at

Run = TypeVar('Run', Recording, FitData)
Kind = Literal['sign', 'swap', 'unit', 'exchanged_commands', 'copied_command', 'noise', 'outliers', 'motionless']
TIME = 'time'  # what the column of time is called
SIGNED = ('m', 'rad', 'N', 'Pa', '')  # units of channels that a sensor may count the other way; '' is strain
OTHER_UNITS = {
    'm': (('millimetres', 1e-3), ('micrometres', 1e-6), ('centimetres', 1e-2)),
    'rad': (('degrees', pi / 180.0),),
    'N': (('millinewtons', 1e-3), ('grams of weight', 9.80665e-3), ('kilograms of weight', 9.80665)),
    'Pa': (('megapascal', 1e6), ('kilopascal', 1e3)),
    '': (('per cent', 1e-2), ('microstrain', 1e-6)),
    'ohm': (('milliohms', 1e-3),),
    'W': (('milliwatts', 1e-3),),
    's': (('milliseconds', 1e-3), ('microseconds', 1e-6), ('minutes', 60.0)),
}
"""By the unit of a column: other units in which its numbers may be, and what these are to be multiplied by."""
TWICE = ('m', 'rad', 'W', 'Pa')  # units of columns that were converted though they were right: the inverse factors


@dataclass(frozen=True)
class Fault:
    """Something that is wrong with some columns, or with recordings.

    Attributes
    ----------
    kind : str
        ``'sign'``: the columns count the other way; ``'swap'``: two columns are exchanged; ``'unit'``: one is in another
        unit; ``'exchanged_commands'``: each of the `recordings` has the command of the next one, the last that of the
        first; ``'copied_command'``: the first of two `recordings` has the command of the second, its own is lost;
        ``'noise'``: it is stated wrong; ``'outliers'``: single samples of it are far off; ``'motionless'``: none of them
        changes by more than its noise, though the commands should move the robot.
    quantities : tuple of str
        Channels, commands or the time, by their names without units (``'alpha'``, ``'J_eq'``, ``'time'``).
    factor : float
        By which values (or the stated noise) are to be multiplied to be right.
    unit : str
        In which the numbers seem to be; empty where that is not known.
    recordings : tuple of str
        The recordings that have it; empty for all.
    alternatives : tuple of tuple of Fault
        Other faults that would leave the very same recordings, since the robot is symmetric.
    corrected : bool
        Whether it was corrected.
    rows : mapping
        Of outliers: by recording, which of its samples.
    share : float
        Of outliers: the part of all samples.
    """

    kind: Kind
    quantities: tuple[str, ...]
    factor: float = 1.0
    unit: str = ''
    recordings: tuple[str, ...] = ()
    alternatives: tuple[tuple[Fault, ...], ...] = field(default=(), compare=False)
    corrected: bool = True
    rows: Mapping[str, tuple[int, ...]] = field(default_factory=dict, compare=False)
    share: float = 0.0

    def applies_to(self, name: str) -> bool:
        """Whether a recording has it."""
        return not self.recordings or name in self.recordings

    @property
    def is_of_channels(self) -> bool:
        """Whether measured channels are wrong, not what was commanded or the time."""
        return all(name in CHANNEL_COLUMNS for name in self.quantities)

    @property
    def where(self) -> str:
        """In which recordings, as the end of a sentence."""
        return f' in {joined_words(self.recordings)}' if self.recordings and not self.is_of_runs else ''

    @property
    def is_of_runs(self) -> bool:
        """Whether recordings are mistaken for each other."""
        return self.kind in ('exchanged_commands', 'copied_command')

    @property
    def words(self) -> str:
        """What is wrong, as a sentence without its full stop."""
        return f'{self.phrase}{self.where}'

    @property
    def phrase(self) -> str:
        """What is wrong, whichever recordings have it."""
        names, plural = joined_words(self.quantities), len(self.quantities) > 1
        if self.kind == 'sign':
            return f'{names} {"have" if plural else "has"} the opposite sign'
        if self.kind == 'swap':
            return f'{names} are swapped'
        if self.kind == 'motionless':
            return f'nothing moves: {names} {"stay" if plural else "stays"} within the noise, whatever is commanded'
        if self.kind == 'copied_command':
            return '{} has the command of {}, not its own'.format(*self.recordings)
        if self.kind == 'exchanged_commands' and len(self.recordings) == 2:
            return f'{joined_words(self.recordings)} have the command of each other'
        if self.kind == 'exchanged_commands':
            return joined_words([f'{name} has the command of {other}' for name, other in self.has_command_of.items()])
        if self.kind == 'noise':
            size = f'{max(self.factor, 1.0 / self.factor):.2g} times too {"small" if self.factor > 1.0 else "large"}'
            return f'the noise of {names} is stated {size}'
        if self.kind == 'outliers':
            count = sum(map(len, self.rows.values()))
            ending = 's' if count > 1 else ''
            return f'{names} has {count} isolated outlier{ending}, {100.0 * self.share:.2g} % of its samples'
        if self.unit:
            return f'{names} is in {self.unit}, not in {UNIT_WORDS[unit_of(self.quantities[0])]}'
        return (
            f'{names} is {1.0 / self.factor:.3g} times too large'
            if self.factor < 1.0
            else (f'{names} is {self.factor:.3g} times too small')
        )

    @property
    def cure(self) -> str:
        """What to change."""
        columns = [column_of(name) for name in self.quantities]
        scaled = (f'{name}: {{column: {name}, scale: {self.multiplier:.9g}}}' for name in columns)
        files = f' for {joined_words(self.recordings)}' if self.recordings else ''
        if self.kind == 'swap':
            return f'in a map (--map){files}: {columns[0]}: {{column: {columns[1]}}}; {columns[1]}: {{column: {columns[0]}}}'
        if self.kind in ('sign', 'unit'):
            return f'in a map (--map){files}: {"; ".join(scaled)}'
        if self.kind == 'exchanged_commands':
            return 'give each recording its own command'
        if self.kind == 'copied_command':
            return 'give {} its own command, or leave it out'.format(*self.recordings)
        if self.kind == 'motionless':
            return 'check that power reaches the wires, that they are neither slack nor overstretched, and the sensors'
        if self.kind == 'noise':
            return 'state the noise that the samples show (noise_std in meta.json, --noise), or none at all'
        return 'check the wiring of the sensor'

    @property
    def has_command_of(self) -> dict[str, str]:
        """By recording, whose command it has."""
        return dict(zip(self.recordings, (*self.recordings[1:], *self.recordings[:1]), strict=True))

    def with_own_commands(self, runs: Sequence[Run], along: Sequence[str]) -> tuple[Run, ...]:
        """Every run with its command, and fields that go along with that, from the one that has it."""
        by_name = {one.name: one for one in runs}
        holder = {other: name for name, other in self.has_command_of.items()}
        pairs = [(one, by_name[holder.get(one.name, one.name)]) for one in runs]
        fields = [{name: getattr(other, name) for name in along} for _, other in pairs]
        return tuple(
            replace(one, source=with_command(one.source, other.source), **own)
            for (one, other), own in zip(pairs, fields, strict=True)
        )

    def in_recordings(self, recordings: Sequence[Recording]) -> tuple[Recording, ...]:
        """All recordings without it: outliers are missing samples then; noise is of a dataset."""
        if self.kind in ('noise', 'copied_command', 'motionless'):
            return tuple(recordings)
        if self.kind != 'exchanged_commands':
            return tuple(map(self.in_recording, recordings))
        return self.with_own_commands(recordings, ('exact_commands', 'known_changes'))

    def in_runs(self, runs: Sequence[FitData]) -> tuple[FitData, ...]:
        """All runs of a fit without it; outliers of all samples."""
        if self.kind != 'exchanged_commands':
            return tuple(map(self.in_run, runs))
        return self.with_own_commands(runs, ('changed', 'interval', 'group'))

    def in_recording(self, recording: Recording) -> Recording:
        """A recording without a fault of its own columns."""
        if not self.applies_to(recording.name):
            return recording
        if self.quantities == (TIME,):
            known = tuple(self.factor * instant for instant in recording.known_changes)
            source = replace(recording.source, times=self.factor * recording.source.times)
            return replace(recording, time=self.factor * recording.time, source=source, known_changes=known)
        if not self.is_of_channels:
            return replace(recording, source=self.in_input(recording.source))
        channels, rounding = dict(recording.channels), self.in_rounding(recording.rounding)
        stds = dict(recording.sample_std)
        if self.kind == 'swap':
            first, second = self.quantities
            other = {first: second, second: first}
            channels, stds = ({other.get(name, name): of for name, of in by_name.items()} for by_name in (channels, stds))
        elif self.kind == 'outliers':
            for name in self.quantities:
                channels[name] = channels[name].copy()
                channels[name][list(self.rows.get(recording.name, ()))] = np.nan
        else:
            channels |= {name: self.multiplier * channels[name] for name in self.quantities if name in channels}
            stds |= {name: abs(self.multiplier) * stds[name] for name in self.quantities if name in stds}
        return replace(recording, channels=channels, rounding=rounding, sample_std=stds)

    def in_rounding(self, rounding: Mapping[str, Rounding]) -> dict[str, Rounding]:
        """How channels without it are rounded."""
        if self.kind == 'swap':
            first, second = self.quantities
            return {{first: second, second: first}.get(name, name): one for name, one in rounding.items()}
        factor = 1.0 if self.kind == 'outliers' else self.multiplier
        return {name: one.times(factor) if name in self.quantities else one for name, one in rounding.items()}

    @property
    def multiplier(self) -> float:
        """What values are multiplied by."""
        return -1.0 if self.kind == 'sign' else self.factor

    def in_input(self, source: Input) -> Input:
        """An input without it, of a fault of commands."""
        columns = list(source.columns)
        at = [columns.index(column_of(name)) for name in self.quantities]
        values = source.values.copy()
        values[:, at] = values[:, at[::-1]] if self.kind == 'swap' else self.multiplier * values[:, at]
        return replace(source, values=values)

    def in_run(self, run: FitData) -> FitData:
        """A run of a fit, of all samples where these are outliers, without it.

        What the samples say stays what it is: a noise in the wrong unit is converted too. Outliers count as missing.
        """
        if not self.applies_to(run.name):
            return run
        if self.quantities == (TIME,):
            return replace(
                run,
                time=self.factor * run.time,
                source=replace(run.source, times=self.factor * run.source.times),
                changed=self.factor * run.changed,
                interval=self.factor * run.interval,
            )
        if not self.is_of_channels:
            return replace(run, source=self.in_input(run.source))
        at = [run.channels.index(name) for name in self.quantities if name in run.channels]
        measured, weight = run.measured.copy(), run.weight.copy()
        if self.kind == 'outliers':
            weight[np.ix_(at, self.rows[run.name])] = 0.0
            return replace(run, weight=weight)
        measured[at] = measured[at[::-1]] if self.kind == 'swap' else self.multiplier * measured[at]
        weight[at] = weight[at[::-1]] if self.kind == 'swap' else weight[at] / abs(self.multiplier)
        return replace(run, measured=measured, weight=weight, rounding=self.in_rounding(run.rounding))


def with_command(source: Input, other: Input) -> Input:
    """An input with the command of another one, and its own ambient temperature, which was measured."""
    moved = np.flatnonzero(np.diff(source.values[:, -1]))
    own = source.times[np.union1d(moved, moved + 1)]
    times = np.union1d(own[(own > other.times[0]) & (own < other.times[-1])], other.times)
    command, ambient = inputs_at(other, times), inputs_at(source, np.maximum(times, source.times[0]))
    values = np.column_stack([command[name] for name in other.columns])
    values[:, -1] = ambient[source.columns[-1]]
    return replace(other, times=times, values=values)


UNIT_WORDS = {
    'm': 'metres',
    'rad': 'radians',
    'N': 'newtons',
    'Pa': 'pascal',
    '': 'parts of 1',
    'ohm': 'ohms',
    'W': 'watts',
    's': 'seconds',
    'K': 'kelvin',
}


def column_of(name: str) -> str:
    """The column of a channel, a command or the time."""
    return CHANNEL_COLUMNS.get(name, 'time_s' if name == TIME else f'{name}_W')


def unit_of(name: str) -> str:
    """The unit in the name of a column."""
    return column_of(name).removeprefix(name).removeprefix('_')


def faults_of(structure: Structure, channels: Sequence[str]) -> Iterator[Fault]:
    """What may be wrong with recordings of these channels: signs, exchanged columns, units.

    An axis that points the other way turns two coordinates at once, and all forces have one sense.
    """
    measured = [name for name in structure.channels if name in channels]
    signed = [name for name in measured if unit_of(name) in SIGNED]
    yield from (Fault('sign', (name,)) for name in signed)
    yield from (
        Fault('sign', pair) for pair in combinations([one for one in signed if one in structure.coordinate_names], 2)
    )
    others = tuple(name for name in signed if name not in structure.coordinate_names)
    if len(others) > 1:
        yield Fault('sign', others)
    if structure.antagonistic:
        yield from (Fault('sign', (name,)) for name in structure.commands)
    for names in (measured, structure.commands):
        yield from (Fault('swap', pair) for pair in combinations(names, 2) if unit_of(pair[0]) == unit_of(pair[1]))
    for name in (*measured, *structure.commands, TIME):
        unit = unit_of(name)
        for other, factor in OTHER_UNITS.get(unit, ()):
            yield Fault('unit', (name,), factor, other)
            if unit in TWICE:
                yield Fault('unit', (name,), 1.0 / factor)


def log_share(fault: Fault, all_kinds: int, runs: int) -> float:
    """Minus the log of how many faults there are: kinds of it, and sets of recordings that may have it."""
    return -log(2.0 * all_kinds) - len(fault.recordings) * log(runs)


def corrected(dataset: Dataset, faults: Sequence[Fault]) -> Dataset:
    """A dataset without these faults, as far as they were corrected."""
    for fault in faults:
        if not fault.corrected:
            continue
        if fault.kind == 'noise':
            factors = dict.fromkeys(fault.quantities, fault.factor)
            dataset = replace(dataset, recordings=tuple(with_noise_times(factors, one) for one in dataset.recordings))
        else:
            dataset = replace(dataset, recordings=fault.in_recordings(dataset.recordings))
            factors = noise_factors(dataset, fault)
        noise = {name: factors.get(name, 1.0) * std for name, std in dataset.noise_std.items()}
        dataset = replace(dataset, noise_std=noise)
    return dataset


def with_noise_times(factors: Mapping[str, float], recording: Recording) -> Recording:
    """A recording whose samples have so many times their own noise, by channel, where they have one."""
    return replace(recording, sample_std={name: factors.get(name, 1.0) * std for name, std in recording.sample_std.items()})


def without_faults(training: Dataset, held_out: Dataset | None, faults: Sequence[Fault]) -> tuple[Dataset, Dataset | None]:
    """Training and held-out recordings without what is wrong with them, as far as it was corrected."""
    if not faults:
        return training, held_out
    return apart(corrected(pooled(training, held_out), faults), len(training.recordings))


def is_uncertain(faults: Sequence[Fault]) -> bool:
    """Whether something is wrong of which it is not known what."""
    return any(not fault.corrected for fault in faults)


def noise_factors(dataset: Dataset, fault: Fault) -> dict[str, float]:
    """What becomes of the noise of channels that were converted or exchanged: of which column it was, the samples say.

    None of those whose noise is what repeated experiments differ by, of which samples say nothing.
    """
    if fault.kind not in ('unit', 'swap') or not fault.is_of_channels:
        return {}
    seen, stated = noise_by_channel(dataset.recordings), dataset.noise_std
    ratios = {
        name: seen[name].std / stated[name]
        for name in fault.quantities
        if name in seen and stated[name] > 0.0 and name not in dataset.floor
    }
    if fault.kind == 'unit':
        return {name: ratio for name, ratio in ratios.items() if max(ratio, 1.0 / ratio) > NOISE_ONLY}
    if len(ratios) < len(fault.quantities):
        return {}
    first, second = fault.quantities
    other = stated[second] / stated[first]
    as_stated = abs(log(ratios[first])) + abs(log(ratios[second]))
    exchanged = abs(log(ratios[first] / other)) + abs(log(ratios[second] * other))
    return {first: other, second: 1.0 / other} if exchanged < as_stated else {}
