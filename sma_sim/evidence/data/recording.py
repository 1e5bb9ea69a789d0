"""What was measured: one recording of a robot or of a wire, and the recordings of a dataset."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import chain
from math import inf

import numpy as np

from sma_sim.evidence.data.rounding import Rounding
from sma_sim.evidence.data.unit_checks import array_mismatch, slow_sampling
from sma_sim.model.archive import Saved
from sma_sim.model.argument_checks import as_difference, as_own_array, check_fields, expect
from sma_sim.model.arrays import Vector
from sma_sim.model.comparable import Comparable
from sma_sim.model.errors import PhysicsWarning, UserError
from sma_sim.model.frozen import frozen
from sma_sim.model.nearest import suggestion
from sma_sim.model.renamed import renamed
from sma_sim.model.shown import Shown, listed
from sma_sim.model.structures.discovery import known_structures
from sma_sim.model.structures.structure import Structure
from sma_sim.solver.inputs import Input, check_columns, fault_of_times

MAX_OUTSIDE = 0.5  # of the samples, before or after the source: there its first and last values hold; more is another unit
FIRST = ('module', 'wire')  # their channels come first wherever channels of several systems are listed


class OfSystems(Mapping[str, tuple[str, ...]]):
    """Names by system, of all structures that are known by now."""

    def __init__(self, names_of: Callable[[Structure], tuple[str, ...]]) -> None:
        self._names_of = names_of

    def __getitem__(self, system: str) -> tuple[str, ...]:
        return self._names_of(known_structures()[system])

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(known_structures(), key=lambda name: (FIRST.index(name) if name in FIRST else len(FIRST), name)))

    def __len__(self) -> int:
        return len(known_structures())


class ColumnsOfChannels(Mapping[str, str]):
    """The column of the file contract that holds a measured channel, of all structures that are known by now.

    For messages and names; what is computed of a recording reads the `columns` of its own structure.
    """

    def _columns(self) -> dict[str, str]:
        known = known_structures()
        every = (zip(known[name].channels, known[name].channel_columns, strict=True) for name in NEEDED_COLUMNS)
        return dict(chain.from_iterable(every))

    def __getitem__(self, channel: str) -> str:
        return self._columns()[channel]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns())

    def __len__(self) -> int:
        return len(self._columns())


# Columns of the file contract that every recording has, by system.
NEEDED_COLUMNS = OfSystems(lambda structure: ('time_s', *structure.needed_columns))
CHANNEL_COLUMNS = ColumnsOfChannels()
ROUNDING = 1e-9  # relative: a floor that was computed may be all of the noise
GAIN = 'power'  # among the parameters of a recording: by how much more power its driver gives than is written
STD_SUFFIX = ' std'  # of the column with the noise of each row, while a file is read
HIDDEN_COLUMN = re.compile(r'(x_M|mode)(_\d+)?')  # no sensor shows them: not compared
ESTIMATE_COLUMN = re.compile(r'x_M(_\d+)?_std')  # their uncertainty: only files that `sma-sim observe` wrote have it


@lru_cache(64)  # every run of a fit asks
def columns_of_family(structure: Structure) -> Mapping[str, str]:
    """By channel of a structure, as they stand in its files, and after them of its other benches: the column."""
    benches = (structure, *(one for one in known_structures().values() if one.is_like(structure)))
    return {name: column for one in benches for name, column in zip(one.channels, one.channel_columns, strict=True)}


def channels_of_family(system: str) -> list[str]:
    """The channels of a system as they stand in its files; those of its other benches after them."""
    return list(columns_of_family(known_structures()[system]))


def in_order(channels: Collection[str], system: str) -> list[str]:
    """Some channels in that order."""
    return [name for name in channels_of_family(system) if name in channels]


def is_resistance(channel: str) -> bool:
    """Whether a channel is the electrical resistance of a wire."""
    return channel.partition('_')[0] == 'R'


@renamed(lost_side='unpowered_side')
@dataclass(frozen=True, eq=False, repr=False)
class Recording(Shown, Saved, Comparable):
    """One run: what was measured, under which input.

    Attributes
    ----------
    name, system : str
        Name of the file or session; that of a structure, such as ``'module'`` or ``'wire'``, of your own once a
        ``Config(system=...)`` was made of it.
    time : array (k,)
        Sample times [s], increasing.
    channels : mapping
        Arrays (k,) by channel (U_x, U_y, alpha, F_1, F_2, T_1, T_2; stress, T), SI units, NaN where a sample is missing.
        A channel that was not measured is absent; they stand in the order of the system's files.
    source : Input
        The input of the run; samples before and after it show its beginning and its end held.
    exact_commands : bool
        Whether the input changed exactly at the rows of `source`. Otherwise it was only sampled, and each change happened
        somewhere between its row and the row before, except those of `known_changes` [s].
    notes : tuple of str
        What was repaired on the way from the file.
    zero_std : mapping
        By channel whose zero is not known, by how much it differs from recording to recording (SI).
    drift_std : mapping
        By channel whose zero drifts, by how much it does so from the first to the last sample (SI).
    ambient_std : float
        By how much the ambient temperature may differ from that of `source` [K]; 0 where it is known.
    late_commands : bool
        Whether each command may have taken effect later than another one, by up to 0.2 s.
    rounded_commands : bool
        Whether the powers that were commanded are written with so few digits that they may have been others.
    varied : mapping
        By parameter of the robot that may have been another one in this recording, the standard deviation of its logarithm.
    in_motion : bool
        Whether wires may be warm, and the pose not in equilibrium, at its beginning: else it begins at rest.
    unpowered_side : int
        The sign of a command that heats nothing in this recording, 0 where all wires are heated.
    imposed_std : mapping
        By column of what was imposed and measured with noise, how well it is known all the same (SI).
    sample_std : mapping
        By channel whose noise differs from sample to sample, its standard deviations (k,) (SI); NaN: that of the dataset.
    rounding : mapping
        By channel whose rounding noise does not hide, how its readings were rounded; `read_dataset` and `diagnose` find it.

    Warns
    -----
    PhysicsWarning
        Where numbers cannot be in SI units, or hardly. A diagnosis finds which they are in; all else refuses what cannot be.
    """

    name: str
    system: str
    time: Vector
    channels: Mapping[str, Vector]
    source: Input
    exact_commands: bool = True
    notes: tuple[str, ...] = ()
    known_changes: tuple[float, ...] = ()
    zero_std: Mapping[str, float] = field(default_factory=dict)
    drift_std: Mapping[str, float] = field(default_factory=dict)
    ambient_std: float = 0.0
    unpowered_side: int = 0
    imposed_std: Mapping[str, float] = field(default_factory=dict)
    sample_std: Mapping[str, Vector] = field(default_factory=dict)
    in_motion: bool = False
    late_commands: bool = False
    rounded_commands: bool = False
    rounding: Mapping[str, Rounding] = field(default_factory=dict)
    varied: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.name:
            raise UserError("recording: expected a name, such as 'run1', got ''")
        if self.system not in known_structures():
            hint = suggestion(self.system, known_structures())
            raise UserError(
                f'recording {self.name}: system {self.system!r}{hint}; expected one of {", ".join(NEEDED_COLUMNS)}, or the '
                'name of a structure of your own, once Config(system=...) or load(..., structures=[...]) has been given it'
            )
        time = as_own_array(f'recording {self.name}, time', self.time)
        if fault := fault_of_times(time):
            raise UserError(f'recording {self.name}: time (k,) [s] must increase, got {fault}')
        known = list(self.columns)
        for name, values in self.channels.items():
            if name not in known:
                raise UserError(
                    f'recording {self.name}: no channel {name!r}{suggestion(name, known)}; it may have {", ".join(known)}'
                )
            if np.shape(values) != time.shape:
                raise UserError(
                    f'recording {self.name}, channel {name}: expected {len(time)} samples as there are times, '
                    f'got an array of shape {np.shape(values)}'
                )
        check_columns(self.structure, self.source)
        first, last = self.source.times[0], self.source.times[-1]
        if len(time) and np.mean((time < first) | (time > last)) > MAX_OUTSIDE:
            raise UserError(
                f'recording {self.name}: time goes from {time[0]:g} to {time[-1]:g} s, source from {first:g} to {last:g} s; '
                'expected a source that covers most samples, in seconds as they are'
            )
        drives = self.structure.input_columns
        for field_name, by, names in (
            ('zero_std', 'channel', known),
            ('drift_std', 'channel', known),
            ('imposed_std', 'column', drives),
            ('varied', 'parameter', [*self.structure.default_values, GAIN]),
        ):
            for name, std in getattr(self, field_name).items():
                of = f'recording {self.name}, {field_name}: expected standard deviations (SI)'
                if name not in names:
                    raise UserError(
                        f'{of} by {by}, of {", ".join(names)}; got {std!r} for {name!r}{suggestion(name, names)}'
                    )
                if not 0.0 <= std < inf:
                    raise UserError(f'{of}, 0 or more; got {std!r} for {name}')
        if not np.isfinite(self.known_changes).all():
            raise UserError(f'recording {self.name}, known_changes: expected times [s], got {self.known_changes}')
        for name, stds in self.sample_std.items():
            if name not in self.channels or np.shape(stds) != time.shape or np.any(np.asarray(stds) <= 0.0):
                raise UserError(
                    f'recording {self.name}, sample_std of {name!r}: expected a standard deviation above 0 (SI) for each '
                    f'of the {len(time)} samples of a channel that was measured'
                )
        for name in self.rounding:
            if name not in self.channels:
                expected = ', '.join(self.channels)
                raise UserError(
                    f'recording {self.name}, rounding: no channel {name!r} was measured; expected some of {expected}'
                )
        if not as_difference(f'recording {self.name}, ambient_std', self.ambient_std) >= 0.0:
            raise UserError(f'recording {self.name}, ambient_std = {self.ambient_std:g}: expected kelvin, 0 or more')
        if self.unpowered_side not in (-1, 0, 1):
            raise UserError(f'recording {self.name}, unpowered_side = {self.unpowered_side}: expected -1, 0 or 1')
        numbers = {name: as_own_array(f'recording {self.name}, {name}', values) for name, values in self.channels.items()}
        for name, values in numbers.items():
            if np.isinf(values).any():
                raise UserError(
                    f'recording {self.name}, channel {name}: expected numbers, and NaN where a sample is missing'
                )
            column = self.columns[name]
            if column.endswith('_K') and (words := array_mismatch(column, values)):  # a diagnosis corrects other units
                raise UserError(f'recording {self.name}, channel {name}: {words}')
        object.__setattr__(self, 'time', time)
        object.__setattr__(self, 'channels', frozen({name: numbers[name] for name in known if name in numbers}))
        doubts, structure = [words] if (words := self.unit_mismatch()) else [], self.structure
        if structure.coordinates and structure.imposed_temperature < 0 and len(time) > 1:
            doubts += [f'recording {self.name}: {note}' for note in slow_sampling(time) if note not in self.notes]
        for doubt in doubts:
            warnings.warn(doubt, PhysicsWarning, stacklevel=4)  # at the line that calls `Recording`

    @property
    def structure(self) -> Structure:
        """What its wires pull on."""
        return known_structures()[self.system]

    @property
    def columns(self) -> Mapping[str, str]:
        """The columns of all channels that it may have, by channel."""
        return columns_of_family(self.structure)

    def unit_mismatch(self) -> str:
        """Where numbers cannot be in SI units, as it is for files, and what converts them; single outliers aside."""
        names, source = self.structure.input_columns, self.source
        columns = [('time', 'time_s', self.time, False)]
        columns += [(f'channel {name}', self.columns[name], values, True) for name, values in self.channels.items()]
        inputs = zip(names, source.values.T, source.linear, strict=True)
        columns += [(f'source, {name}', name, values, is_measured) for name, values, is_measured in inputs]
        for where, name, values, is_measured in columns:
            if words := array_mismatch(name, values, is_measured):
                return f'recording {self.name}, {where}: {words}'
        return ''

    def facts(self) -> Mapping[str, str]:
        """What is to be known at a glance."""
        first, last = (float(self.time[k]) if len(self.time) else float('nan') for k in (0, -1))
        found = {'name': self.name, 'system': self.system, 'samples': f'{len(self.time)} from {first:g} to {last:g} s'}
        found['channels'] = ', '.join(self.columns[name] for name in self.channels)
        return found | ({'notes': '; '.join(self.notes)} if self.notes else {})


def has_same_samples(one: Recording, other: Recording) -> bool:
    """Whether two recordings have the very same numbers, of which some change: noise makes others when a run is repeated."""
    if one.system != other.system or one.channels.keys() != other.channels.keys() or len(one.time) != len(other.time):
        return False
    if not all(np.array_equal(own, other.channels[name], equal_nan=True) for name, own in one.channels.items()):
        return False
    return any(np.ptp(own[np.isfinite(own)]) > 0.0 for own in one.channels.values() if np.isfinite(own).any())


@renamed()
@dataclass(frozen=True, eq=False, repr=False)
class Dataset(Shown, Saved, Comparable):
    """Recordings of one robot or wire.

    Attributes
    ----------
    recordings : sequence of Recording
        The runs; a single one may stand alone.
    noise_std : mapping
        Standard deviation of the noise by channel, SI units.
    notes : tuple of str
        Where the noise comes from and what was left out; those of a recording are in the recording.
    floor : mapping
        By channel, what repeated experiments differ by, which `noise_std` contains; empty where it is not known.
    nuisances : mapping
        By effect that belongs to the bench, the standard deviations of the priors of its parameters (SI).
    resolution : mapping
        By channel that is rounded to steps which its noise does not hide, that step (SI).
    """

    recordings: tuple[Recording, ...]
    noise_std: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    floor: Mapping[str, float] = field(default_factory=dict)
    nuisances: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    resolution: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        expect('recordings', self.recordings, Recording | Collection[Recording])
        given = (self.recordings,) if isinstance(self.recordings, Recording) else tuple(self.recordings)
        object.__setattr__(self, 'recordings', given)
        check_fields(self)
        names = [recording.name for recording in given]
        if doubled := next((name for name in names if names.count(name) > 1), ''):
            raise UserError(f'recordings: {doubled!r} is there twice; give each recording a name of its own')
        for field_name in ('noise_std', 'floor', 'resolution'):
            for name, std in getattr(self, field_name).items():
                if name not in (self.possible_channels if field_name != 'noise_std' else CHANNEL_COLUMNS):
                    known = sorted(self.channels)
                    raise UserError(
                        f'{field_name}: no channel {name!r}{suggestion(name, known)}; expected some of {", ".join(known)}'
                    )
                if not 0.0 <= std < inf:
                    raise UserError(
                        f'{field_name} of {name} = {std!r}: expected a standard deviation in SI units, 0 or more'
                    )
        for name, std in self.floor.items():
            if std > self.noise_std.get(name, std) * (1.0 + ROUNDING):
                raise UserError(
                    f'floor of {name} = {std:g}: expected a part of its noise_std, {self.noise_std[name]:g} or less'
                )
        for effect, stds in self.nuisances.items():
            for name, std in stds.items():
                if not 0.0 < std < inf:
                    raise UserError(f'nuisances, {effect}.{name} = {std!r}: expected a standard deviation, more than 0')

    @property
    def system(self) -> str:
        """`module` or `wire`."""
        return self.recordings[0].system

    @property
    def possible_channels(self) -> set[str]:
        """Names of the channels that its recordings may have; those of all systems where there is none."""
        return {name for recording in self.recordings for name in recording.columns} or set(CHANNEL_COLUMNS)

    @property
    def benches(self) -> set[str]:
        """The systems of all recordings: several where a wire was on several benches."""
        return {recording.system for recording in self.recordings}

    @property
    def channels(self) -> frozenset[str]:
        """Names of the channels that any recording has."""
        return frozenset(name for recording in self.recordings for name in recording.channels)

    def facts(self) -> Mapping[str, str]:
        """What is to be known at a glance."""
        if not self.recordings:
            return {'recordings': 'none'}
        columns, names = self.recordings[0].columns, listed(recording.name for recording in self.recordings)
        noise = (f'{columns[name]} {self.noise_std[name]:.3g}' for name in in_order(self.noise_std, self.system))
        return {'system': self.system, 'recordings': f'{len(self.recordings)} ({names})', 'noise (std)': listed(noise)}
