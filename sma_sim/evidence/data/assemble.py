"""From the columns of one file to its recordings: one for each session in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.at_rest import early_motion
from sma_sim.evidence.data.imposed import without_noise
from sma_sim.evidence.data.noise import estimate_noise
from sma_sim.evidence.data.recording import (
    NEEDED_COLUMNS,
    STD_SUFFIX,
    Recording,
    is_resistance,
)
from sma_sim.evidence.data.rosbag.commands import NODE_LIMITS, CommandLimits
from sma_sim.evidence.data.sessions import (
    Rows,
    are_regular,
    command_changes,
    first_finite,
    group_starts,
    last_of_groups,
    ordered_sessions,
    rows_with_changes,
)
from sma_sim.evidence.data.stated_units import unit_of
from sma_sim.evidence.data.unit_checks import check_clock_set, check_unit, slow_sampling
from sma_sim.model.arrays import Mask, Vector
from sma_sim.model.errors import UserError
from sma_sim.model.shown import counted, listed
from sma_sim.model.structures.discovery import known_structures
from sma_sim.model.structures.structure import Structure
from sma_sim.solver.inputs import Input

NO_TIMES = np.zeros(0)
LARGEST_VALUE = 1e25  # no quantity reaches it in any unit: what is larger is infinite (instruments by SCPI: 9.9e37)
LATEST_START = 1e6  # [s] a first time beyond it is a date (seconds since 1970), not a time in the run
MIN_ROWS_WITH_SPIKES, SPIKE_RATIO, MAX_SPIKES = 100, 3.0, 0.02  # rows; beyond what lasts; part of the rows
MIN_SESSION_SAMPLES = 2  # fewer span no time
MAX_TIMES = 4  # of single rows in a note


class NothingMeasuredError(UserError):
    """A file that says what was commanded, and holds no measurement."""


@dataclass(frozen=True)
class SourceFile:
    """Which file is read, as which system, and the ambient temperature [K] where it records none.

    `stamped` says that the command has stamps of its own, as in a bag; `namespace` whose topics are read from a bag, and
    `limits` what its robot accepts; `foreign`: by our columns, those of the file that a map names for them; `converted`:
    those whose unit a map converts.
    """

    path: Path
    system: str
    T_E: float
    stamped: bool = False
    namespace: str | None = None
    limits: CommandLimits = NODE_LIMITS
    foreign: Mapping[str, str] = field(default_factory=dict)
    converted: frozenset[str] = frozenset()

    def column_of(self, name: str) -> str:
        """How the file itself calls a column of the contract."""
        return self.foreign.get(name, name)

    @property
    def structure(self) -> Structure:
        """The structure of the system."""
        return known_structures()[self.system]

    @property
    def imposed(self) -> tuple[str, ...]:
        """Columns of what is imposed beside heating."""
        return self.structure.input_columns[: len(self.structure.drives)]

    @property
    def heating(self) -> tuple[str, ...]:
        """Columns of the heating commands."""
        return self.structure.input_columns[len(self.structure.drives) : -1]


def recordings_from_columns(
    file: SourceFile, name: str, columns: dict[str, Vector], notes: list[str]
) -> tuple[Recording, ...]:
    """The sessions of a file, `columns` (k,) by the names of the file contract (emptied on the way). Raises UserError."""
    check_required_columns(file, columns)
    drop_rows_without_time(file, columns, notes)
    discard_infinities(columns, notes)
    sampled = sampled_rows(file.structure, columns)
    if not sampled.any():
        measurable = ', '.join(file.structure.channel_columns)
        raise NothingMeasuredError(f'{file.path}: nothing measured in it; expected some of the columns {measurable}')
    sessions, order_notes = ordered_sessions(file.path, columns['time_s'], sampled)
    notes += [note for note in order_notes if note not in notes]  # the reading of a bag has said it
    found = [session for session in sessions if sampled[session].sum() >= MIN_SESSION_SAMPLES]
    if len(found) < len(sessions):
        notes.append(f'{len(sessions) - len(found)} sessions with fewer than {MIN_SESSION_SAMPLES} measured rows: dropped')
    if not found:
        raise UserError(f'{file.path}: expected at least {MIN_SESSION_SAMPLES} measured rows, got {int(sampled.sum())}')
    if len(found) == 1:
        return (session_recording(file, name, selected_rows(columns, found[0], last=True), notes),)
    return tuple(
        session_recording(file, f'{name}#{number}', selected_rows(columns, session, number == len(found)), notes)
        for number, session in enumerate(found, start=1)
    )


def check_required_columns(file: SourceFile, columns: Mapping[str, Vector]) -> None:
    """Raise UserError where time or command is missing."""
    missing = [name for name in NEEDED_COLUMNS[file.system] if name not in columns]
    if missing:
        raise UserError(f'{file.path} has no {", ".join(missing)}; expected the recording of a {file.system}')


def drop_rows_without_time(file: SourceFile, columns: dict[str, Vector], notes: list[str]) -> None:
    """Leave out the rows without a finite time."""
    known = np.abs(columns['time_s']) < LARGEST_VALUE
    if known.all():
        return
    if not known.any():
        raise UserError(
            f'{file.path}, column {file.column_of("time_s")}: expected seconds, got no number; if rows are regular, a map '
            f'says how far apart they are: time_s: {{interval: SECONDS}}'
        )
    notes.append(f'{counted(int((~known).sum()), "row")} without a time: dropped')
    for name in columns:
        columns[name] = columns[name][known]


def discard_infinities(columns: dict[str, Vector], notes: list[str]) -> None:
    """Replace infinite values by NaN, in place."""
    for name, values in columns.items():
        infinite = np.abs(values) >= LARGEST_VALUE
        if infinite.any():
            notes.append(f'{name}: {int(infinite.sum())} infinite values: taken as missing')
            values[infinite] = np.nan


def sampled_rows(structure: Structure, columns: Mapping[str, Vector]) -> NDArray[np.bool_]:
    """Which rows hold a measured cell."""
    sampled = np.zeros(len(columns['time_s']), dtype=bool)
    for column in structure.channel_columns:
        if column in columns:
            sampled |= np.isfinite(columns[column])
    return sampled


def selected_rows(columns: dict[str, Vector], rows: Rows, last: bool) -> dict[str, Vector]:
    """The rows of every column; the `last` call empties `columns`, so that they are not in memory twice."""
    return {name: (columns.pop(name) if last else columns[name])[rows] for name in list(columns)}


def session_recording(file: SourceFile, name: str, columns: dict[str, Vector], notes: list[str]) -> Recording:
    """One session, its times in order. Raises UserError."""
    notes = list(notes)
    fill_inputs(file, columns, notes)
    sampled = sampled_rows(file.structure, columns)
    command = commanded(file, columns)
    changes, is_exact = command_changes(columns['time_s'], command, sampled)
    exact = file.stamped or bool(is_exact.all())
    if not exact:
        notes.append(sampled_command_note(is_exact))
    merge_equal_times(file, columns, notes)
    if len(columns['time_s']) < MIN_SESSION_SAMPLES:
        only = columns['time_s'][0]
        raise UserError(f'{file.path}, column time_s: expected times that increase, got {only:g} in every row')
    check_clock_set(file.path, file.column_of('time_s'), columns['time_s'])
    check_unit(file.path, 'time_s', columns['time_s'], file.column_of('time_s'))
    if abs(columns['time_s'][0]) > LATEST_START:
        notes.append(f'time is counted from the first row, {columns["time_s"][0]:.3f} s')
        changes = changes - columns['time_s'][0]
        columns['time_s'] = columns['time_s'] - columns['time_s'][0]
    errors = imposed_without_noise(file, columns, notes)
    source = input_from_columns(file, columns)
    time, channels, stds = measured_channels(file, columns, notes)
    if len(time) < MIN_SESSION_SAMPLES or not channels:
        raise UserError(
            f'{file.path}: expected at least {MIN_SESSION_SAMPLES} measured rows after the first command, got {len(time)}'
        )
    if file.structure.coordinates and file.structure.imposed_temperature < 0:
        notes += slow_sampling(time) + early_motion(file.heating, time, channels, source)
    known = () if exact else tuple(changes[is_exact].tolist())
    return Recording(
        name, file.system, time, channels, source, exact, tuple(notes), known, imposed_std=errors, sample_std=stds
    )


def commanded(file: SourceFile, columns: Mapping[str, Vector]) -> Vector:
    """The heating command (k,); of several a number that changes where any of them does."""
    commands = [columns[name] for name in file.heating]
    if len(commands) == 1:
        return commands[0]
    _, which = np.unique(np.column_stack(commands), axis=0, return_inverse=True)
    return np.asarray(which, float).reshape(-1)


def sampled_command_note(is_exact: NDArray[np.bool_]) -> str:
    """The note on changes of the command (c,) of which not all have exact times."""
    if not is_exact.any():
        return 'the command was sampled with the measurement: each change is uncertain within its interval'
    sampled = f'{int((~is_exact).sum())} of {len(is_exact)} changes of the command were only sampled'
    return f'{sampled}: uncertain within their interval'


def fill_inputs(file: SourceFile, columns: dict[str, Vector], notes: list[str]) -> None:
    """Inputs without gaps: commands are held, strain is interpolated, and a note says what was not recorded."""
    rows = len(columns['time_s'])
    heat_matters = file.structure.imposed_temperature < 0
    for name in file.heating:
        if name not in columns:
            if heat_matters:
                notes.append(f'{name} is not recorded: taken as 0')
            columns[name] = np.zeros(rows)
    if 'T_E_K' not in columns or not np.isfinite(columns['T_E_K']).any():
        if heat_matters:
            say = f'T_E_K: {{value: {file.T_E:g}, zero_std: KELVIN}}'
            notes.append(f'T_E_K is not recorded: taken as {file.T_E:g} K; a map says how far it may be off: {say}')
        columns['T_E_K'] = np.full(rows, file.T_E)
    for name in file.heating if not file.stamped else ():  # what has a stamp of its own was commanded
        discard_spikes(name, columns, notes)
    first = 0
    for name in file.structure.input_columns:
        values = columns[name]
        how = 'interpolated' if name in file.imposed else 'the value before holds'
        empty = int(np.isnan(values).sum())
        if name in (*file.imposed, 'T_E_K'):
            discard_outliers(name, columns['time_s'], values, how, notes)
        columns[name], unknown = forward_filled(values)
        if name in file.imposed:
            columns[name] = gaps_interpolated(columns['time_s'], values)
        if name == 'T_E_K' and unknown:
            columns[name][:unknown], unknown = columns[name][unknown], 0
        if empty > unknown:
            notes.append(f'{name}: {counted(empty - unknown, "row")} without a value: {how}')
        first = max(first, unknown)
    drop_rows_before_input(file, columns, first, notes)
    for name in file.structure.input_columns:
        check_unit(file.path, name, columns[name], file.column_of(name))
    for name in file.heating:
        if not file.structure.antagonistic and (columns[name] < 0.0).any():
            notes.append(f'{name}: slightly negative values, {columns[name].min():.3g} W at the least: taken as 0')
            columns[name] = np.maximum(columns[name], 0.0)


def discard_spikes(name: str, columns: Mapping[str, Vector], notes: list[str]) -> None:
    """NaN for spikes in a command, changed in place: single rows, far beyond all that lasts, between equal neighbours.

    A serial line that loses or doubles a character makes them.
    """
    values = columns[name]
    if len(values) < MIN_ROWS_WITH_SPIKES:
        return
    lasting = values[1:][values[1:] == values[:-1]]
    top = float(np.abs(lasting).max()) if len(lasting) else 0.0
    spikes = np.zeros(len(values), dtype=bool)
    spikes[1:-1] = (values[:-2] == values[2:]) & (np.abs(values[1:-1]) > SPIKE_RATIO * top)
    if top > 0.0 and 0 < spikes.sum() <= MAX_SPIKES * len(values):
        at = columns['time_s'][int(np.argmax(spikes))]
        notes.append(f'{name}: {int(spikes.sum())} spikes of one row, the first at {at:.6g} s: the value before holds')
        values[spikes] = np.nan


def discard_outliers(
    name: str, time: Vector, values: Vector, how: str, notes: list[str], changes: Vector = NO_TIMES
) -> None:
    """NaN for outliers in the values (k,), changed in place.

    At the end too few samples follow to tell steps from spikes: after one of the `changes` of the command [s] it is a step.
    """
    wrong = outliers(time, values)
    late = changes[changes > time[-1 - NEIGHBOURS_PER_SIDE]] if len(time) > NEIGHBOURS_PER_SIDE else NO_TIMES
    if len(late):
        wrong[time >= late[0]] = False
    if wrong.any():
        notes.append(f'{name}: {int(wrong.sum())} outliers, the first at {time[np.argmax(wrong)]:.6g} s: {how}')
        values[wrong] = np.nan


def imposed_without_noise(file: SourceFile, columns: dict[str, Vector], notes: list[str]) -> dict[str, float]:
    """Take what was imposed in place of what its sensors have shown; by column the error [SI] that their noise leaves."""
    errors = {}
    for name in file.imposed:
        given = columns[name]
        found = without_noise(given)
        columns[name] = found.values
        if found.error > 0.0:
            errors[name] = found.error
        if found.noise > 0.0:
            is_constant = np.ptp(found.values) == 0.0
            words = f'taken as constant, {found.values[0]:.6g}' if is_constant else 'taken without it'
            notes.append(f'{name}: measured with a noise of {found.noise:.3g}, which the wire has not felt: {words}')
        if found.single:
            rows = list(found.single)
            apart = float(np.abs(given - found.values)[rows].max())
            at = listed((f'{time:.6g}' for time in columns['time_s'][rows]), MAX_TIMES)
            notes.append(
                f'{name}: single rows, up to {apart:.3g} from those beside them, at {at} s: taken as noise; if the wire has '
                'felt them, record several rows while it does'
            )
    return errors


def discard_saturated(name: str, time: Vector, values: Vector, notes: list[str]) -> None:
    """NaN for the values (k,) of a sensor at the end of its range, changed in place."""
    wrong = saturated(time, values)
    if wrong.any():
        end = values[int(np.argmax(wrong))]
        notes.append(f'{name}: its sensor stops at {end:.6g}, {counted(int(wrong.sum()), "row")} there: taken as missing')
        values[wrong] = np.nan


def gaps_interpolated(time: Vector, values: Vector) -> Vector:
    """Gaps (NaN) in values (k,) at time (k,) filled linearly, but not before the first."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    return np.interp(time, time[known], values[known])


def drop_rows_before_input(file: SourceFile, columns: dict[str, Vector], first: int, notes: list[str]) -> None:
    """Leave out the `first` rows, in which an input is unknown, since no command was recorded yet."""
    if first == 0:
        return
    if first >= len(columns['time_s']) - 1:
        raise UserError(f'{file.path}: expected a command before the last row, got {first} rows without one')
    notes.append(f'{counted(first, "row")} before the first command: left out')
    for name in columns:
        columns[name] = columns[name][first:]


def merge_equal_times(file: SourceFile, columns: dict[str, Vector], notes: list[str]) -> None:
    """One row for each time: the last input, the first measured value of each channel."""
    starts = group_starts(columns['time_s'])
    if starts is None:
        return
    repeated = 0
    for name, values in columns.items():
        if name.endswith(STD_SUFFIX):
            columns[name], _ = first_finite(values, starts)
        elif name in file.structure.channel_columns:
            columns[name], dropped = first_finite(values, starts)
            repeated = max(repeated, dropped)
            check_resolution_of_time(file, values, columns[name], starts)
        else:
            columns[name] = last_of_groups(values, starts)
    if repeated:
        notes.append(f'{counted(repeated, "sample")} repeat{"s" * (repeated == 1)} the time of the one before: dropped')


def check_resolution_of_time(file: SourceFile, values: Vector, kept: Vector, starts: NDArray[np.intp]) -> None:
    """Raise UserError where most samples (k,) would be lost, as they differ from the one that is `kept` of their time."""
    group = np.searchsorted(starts, np.arange(len(values)), side='right') - 1
    lost = np.isfinite(values) & (values != kept[group])
    if 2 * lost.sum() > np.isfinite(values).sum():
        raise UserError(
            f'{file.path}, column time_s: expected a time for each sample, got {len(starts)} times in {len(values)} rows: '
            f'record or export it with its fractions of a second'
        )


def input_from_columns(file: SourceFile, columns: Mapping[str, Vector]) -> Input:
    """The input: all rows where something is imposed, which is linear between rows; else those at which one changed."""
    names = file.structure.input_columns
    keep: NDArray[np.bool_] | slice = slice(None)
    if not file.imposed:
        keep = rows_with_changes([columns[name] for name in names])
    values = np.column_stack([columns[name][keep] for name in names])
    return Input(columns['time_s'][keep], values, tuple(name in file.imposed for name in names), names)


def measured_channels(
    file: SourceFile, columns: dict[str, Vector], notes: list[str]
) -> tuple[Vector, dict[str, Vector], dict[str, Vector]]:
    """Times and channels of the rows that hold a measurement, outliers taken out, and their noise where the file has it."""
    names = dict(zip(file.structure.channel_columns, file.structure.channels, strict=True))
    found = [name for name in names if name in columns]
    sampled = sampled_rows(file.structure, columns)
    time = columns['time_s'][sampled] if not sampled.all() else columns['time_s']
    switched = (columns['time_s'][1:][np.diff(columns[name]) != 0.0] for name in file.heating)
    changes = np.sort(np.concatenate([NO_TIMES, *switched]))
    channels, stds = dict[str, Vector](), dict[str, Vector]()
    for name, channel in names.items():
        values = columns.pop(name, np.empty(0))
        if not np.isfinite(values).any():
            continue
        channels[channel] = values = values[sampled] if not sampled.all() else values
        discard_outliers(name, time, values, 'taken as missing', notes, changes)
        discard_saturated(name, time, values, notes)
        like = [one for one in found if unit_of(one) == unit_of(name) and not {one, name} & file.converted]
        check_unit(file.path, name, values, file.column_of(name), {one: file.column_of(one) for one in like})
        if (noise := columns.pop(name + STD_SUFFIX, None)) is not None:
            stds[channel] = noise[sampled]
    notes += gap_notes(time, channels) + rate_note(time, channels)
    usual = [channel for channel in file.structure.channels if not is_resistance(channel)]
    missing = [channel for channel in usual if channel not in channels]
    if missing:
        notes.append(f'not measured: {", ".join(missing)}')
    return time, channels, stds


# What is missing or wrong in the columns of one session: gaps, outliers, held inputs; each repair makes a note.
NEIGHBOURS_PER_SIDE = 4  # enough that two adjacent outliers do not hide each other
OUTLIER_RANGES = 6.0  # an outlier is farther from its neighbours than so many times their own range
OUTLIER_NOISE_STDS = 10.0  # ... and farther than so many standard deviations of the noise
OUTLIER_SPAN_FRACTION = 0.01  # ... and farther than this part of what the channel spans
MAX_PASSES = 3  # an outlier may hide another one until it is taken out
MIN_SATURATED = 3.0  # a sensor at its end shows one value for so many times as long as ...
USUAL_LENGTHS = 0.95  # ... this quantile of how long other values last
SLOPE_LEVELS = 3  # different values before and after it, by which the signal runs into it
PASSED_STEPS = 4.0  # of the resolution, by which the signal would have passed its end: a round peak has two
ROWS_PER_BLOCK = 1 << 16  # bounds the memory for the neighbours of each row


def outliers(time: Vector, values: Vector) -> Mask:
    """Which of the values (k,), NaN where missing, are spikes that no wire or beam could make; `time` (k,) [s].

    A sample counts when it lies outside the range of its eight neighbours (the farthest one on each side left out, so that
    two spikes do not hide each other) by six times that range, ten times the noise and 1 % of what the channel spans.
    A step, a kink and a decay with a half-life of a sample keep neighbours in between and pass.
    """
    wrong = np.zeros(len(values), dtype=bool)
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < 5 * NEIGHBOURS_PER_SIDE:
        return wrong
    noise = estimate_noise(time, values)
    low, high = np.percentile(values[known], [1.0, 99.0])
    floor = max(OUTLIER_NOISE_STDS * noise.std if noise else 0.0, OUTLIER_SPAN_FRACTION * float(high - low))
    if noise:
        floor = max(floor, 2.0 * noise.step)
    for _ in range(MAX_PASSES):
        found = known[spikes(values[known], floor)]
        if len(found) == 0:
            break
        wrong[found] = True
        known = known[~wrong[known]]
    return wrong


def spikes(values: Vector, floor: float) -> Mask:
    """Which of the values (k,) stand out of their neighbours by more than `floor` and six times their range."""
    count, width = len(values), 2 * NEIGHBOURS_PER_SIDE + 1
    found = np.zeros(count, dtype=bool)
    if count < width:
        return found
    for start in range(0, count, ROWS_PER_BLOCK):
        rows = np.arange(start, min(start + ROWS_PER_BLOCK, count))
        first = np.clip(rows - NEIGHBOURS_PER_SIDE, 0, count - width)
        index = first[:, None] + np.arange(width - 1)
        index += index >= rows[:, None]  # all but the row itself
        around = np.sort(values[index], axis=1)
        low, high = around[:, 1], around[:, -2]
        beyond = np.maximum(values[rows] - high, low - values[rows])
        found[rows] = beyond > np.maximum(OUTLIER_RANGES * (high - low), floor)
    return found


def saturated(time: Vector, values: Vector) -> Mask:
    """Which of the values (k,), NaN where missing, are those of a sensor at the end of its range; `time` (k,) [s].

    Its largest or smallest value, repeated for longer than others, which the samples before and after run into so steeply
    that, going on, they would have passed it by many steps of the resolution. What comes to rest slows down before, and a
    peak is round. Not 0, which a wire that is slack shows.
    """
    found = np.zeros(len(values), dtype=bool)
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < 5 * NEIGHBOURS_PER_SIDE:
        return found
    time, values = time[known], values[known]
    starts = np.flatnonzero(np.append(True, np.diff(values) != 0.0))
    lengths, levels = np.diff(np.append(starts, len(values))), values[starts]
    resolution = float(np.min(np.diff(np.unique(values)), initial=np.inf))
    for sign in (1.0, -1.0):
        top = float((sign * levels).max())
        if top == 0.0:
            continue
        at_top = sign * levels == top
        usual = float(np.quantile(lengths[~at_top], USUAL_LENGTHS)) if not at_top.all() else np.inf
        for k in np.flatnonzero(at_top & (lengths >= MIN_SATURATED * usual)):
            before, after = k - SLOPE_LEVELS, k + SLOPE_LEVELS
            if before < 0 or after >= len(levels):
                continue
            first, last = starts[k], starts[k] + lengths[k] - 1
            passed = []
            for level, away in ((before, time[first] - time[starts[before]]), (after, time[starts[after]] - time[last])):
                ahead = min(1.0, 0.5 * (time[last] - time[first]) / away)  # no further than the slope is known for
                passed.append(ahead * (top - sign * levels[level]))
            if min(passed) > PASSED_STEPS * resolution:
                found[known] |= sign * values >= top
    return found


def forward_filled(values: Vector) -> tuple[Vector, int]:
    """Gaps (NaN) filled with the value before, and how many rows before the first value are left."""
    known = np.isfinite(values)
    if known.all():
        return values, 0
    first = int(np.argmax(known)) if known.any() else len(values)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), 0))
    return values[last], first


def gap_notes(time: Vector, channels: Mapping[str, Vector]) -> list[str]:
    """Samples that are missing in each channel's own grid; channels with the same gaps share a note."""
    same: dict[tuple[int, int, float, float], list[str]] = {}
    for name, values in channels.items():
        times = times_with_values(time, values)
        steps = np.diff(times)
        usual = float(np.median(steps)) if len(steps) else 0.0
        at = np.flatnonzero(steps > 1.5 * usual)
        if len(at) == 0 or 2 * len(at) > len(steps) or not are_regular(steps[steps <= 1.5 * usual]):
            continue
        missing = int(np.rint(steps[at] / usual - 1.0).sum())
        longest = int(np.argmax(steps))
        key = (missing, len(at), float(steps[longest]), float(times[longest]))
        same.setdefault(key, []).append(name)
    return [
        f'{", ".join(names)}: {counted(missing, "sample")} missing in {counted(gaps, "gap")}, the longest of '
        f'{longest:.3g} s from {start:.6g} s on'
        for (missing, gaps, longest, start), names in same.items()
    ]


def times_with_values(time: Vector, values: Vector) -> Vector:
    """The times at which there is a value."""
    known = np.isfinite(values)
    return time if known.all() else time[known]


def rate_note(time: Vector, channels: Mapping[str, Vector]) -> list[str]:
    """One note where channels have different rates."""
    rates: dict[str, float] = {}
    for name, values in channels.items():
        times = times_with_values(time, values)
        if len(times) > 2:
            rates[name] = 1.0 / float(np.median(np.diff(times)))
    if not rates or max(rates.values()) < 1.1 * min(rates.values()):
        return []
    return ['channels have different rates: ' + ', '.join(f'{name} {rate:.3g} Hz' for name, rate in rates.items())]
