"""From files to a dataset: CSV files and bags, their sessions, what was repaired, and the noise of the channels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from math import hypot, sqrt
from pathlib import Path

import numpy as np

from sma_sim.evidence.data.assemble import NothingMeasuredError, SourceFile, recordings_from_columns
from sma_sim.evidence.data.at_rest import different_beginnings, stressed_beginnings
from sma_sim.evidence.data.column_map import ColumnMap, read_column_map
from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.data.noise import Noise, noise_by_channel
from sma_sim.evidence.data.quasi_static import ACCURACY, noise_over_temperature, slopes_over_temperature, temperature_noise
from sma_sim.evidence.data.readings import varying_by_channel, with_rounding, with_varying_noise
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS, Dataset, Recording, has_same_samples, in_order
from sma_sim.evidence.data.repeatability import levels_of_noise, relative_noise, with_bench
from sma_sim.evidence.data.repeated_values import without_constant_channels, without_repeated_values
from sma_sim.evidence.data.rosbag.bag_files import is_bag
from sma_sim.evidence.data.rosbag.commands import NODE_LIMITS, CommandLimits
from sma_sim.evidence.data.sources import COLUMNS_BY_SYSTEM, checked_noise, read_noise_file, read_source, recordings_in
from sma_sim.evidence.data.workbook import SUFFIX as WORKBOOK
from sma_sim.model.argument_checks import checked
from sma_sim.model.arrays import Vector
from sma_sim.model.effects.ports import CHANNELS
from sma_sim.model.errors import UserError
from sma_sim.model.shown import listed
from sma_sim.model.structures.discovery import known_structures

NEGLIGIBLE_FRACTION = 1e-4  # of what a channel spans: smaller noise is below the error of any model
# [SI] for channels whose samples are too few or all the same: what common sensors have.
ASSUMED_NOISE = {'U_x': 1e-6, 'U_y': 1e-6, 'alpha': 1e-4, 'stress': 1e5, 'T': 0.1, 'strain': 1e-5}
PACKED_SUFFIXES = ('.gz', '.zip', '.bz2', '.xz')
MAX_NAMES = 5  # of files in a note
RESPONDING = ('strain',)  # channels of quasi-static tests that follow the temperature
# Of other channels, by the unit in their columns' names.
ASSUMED_NOISE_IN = {'m': 1e-5, 'rad': 1e-4, 'N': 0.01, 'K': 0.1, 'ohm': 1e-3}


@checked
def read_dataset(
    paths: str | Path | Sequence[str | Path],
    system: str = 'module',
    T_E: float = 298.0,
    mapping: str | Path | None = None,
    noise_std: Mapping[str, float] | None = None,
    namespace: str | None = None,
    limits: CommandLimits = NODE_LIMITS,
) -> Dataset:
    """Read recordings and determine the noise of their channels.

    Parameters
    ----------
    paths : str or Path, or several
        CSV files, bags (folder or file), or folders of them.
    system : str
        What was measured: the name of a structure, such as ``'module'``.
    T_E : float
        Ambient temperature [K] of files that do not record it.
    mapping : Path, optional
        A YAML file that names foreign columns and their units.
    noise_std : mapping, optional
        Standard deviation of the noise by channel, SI units. Channels that are not in it have the noise of the folder's
        meta.json; otherwise it is estimated.
    namespace : str, optional
        The module to read, in bags of several.
    limits : CommandLimits, optional
        What the robot accepts, where a bag has its commands, but not what it has applied (default: the node's defaults).

    Returns
    -------
    Dataset
        The recordings, their noise, and notes on everything that was repaired.

    Raises
    ------
    UserError
        For a file that cannot be read or whose content is not plausible; the message names file, row and column.

    Examples
    --------
    >>> import sma_sim, tempfile
    >>> from pathlib import Path
    >>> file = Path(tempfile.mkdtemp()) / 'run1.csv'
    >>> rows = [f'{k / 10},{12 if k > 20 else 0},{1e-4 * k % 0.02}' for k in range(100)]
    >>> _ = file.write_text('\\n'.join(['time_s,J_eq_W,alpha_rad', *rows, '']))
    >>> dataset = sma_sim.read_dataset([file], 'module', 298.0, noise_std={'alpha': 3.5e-4})
    >>> dataset.recordings[0].name, len(dataset.recordings[0].time), dataset.noise_std
    ('run1', 100, {'alpha': 0.00035})
    """
    if hasattr(paths, 'to_csv'):  # a table of pandas, whose columns would be taken for files
        raise UserError(
            'paths: expected files or folders, got a table; write it with to_csv, or make a sma_sim.Recording of it'
        )
    files_and_folders = [Path(paths)] if isinstance(paths, str | Path) else [Path(path) for path in paths]
    columns = column_map_for(system, None if mapping is None else Path(mapping))
    channels = tuple(dict.fromkeys((*known_structures()[system].channels, *CHANNELS)))
    given = checked_noise((noise_std or {}).items(), 'noise_std', channels)
    notes: list[str] = []
    files = unique_files(files_and_folders, notes)
    found = [
        (path, recording)
        for path, named in files
        for file in (source_file(path, system, T_E, columns, namespace, limits),)
        for recording in sessions_in_file(file, columns.of_file(path), named, notes)
    ]
    if not found:
        raise UserError(
            f'{", ".join(map(str, files_and_folders))}: no measurement in it; expected measured columns such as alpha_rad'
        )
    recordings = without_copies(with_distinct_names(found), notes)
    notes += different_beginnings(recordings) + stressed_beginnings(recordings)
    stated = noise_from_folders([path for path, _ in files], channels, notes) | given
    recordings = tuple(map(partial(without_sample_noise, channels=given), recordings))
    recordings = with_rounding(recordings)
    estimates = noise_by_channel(recordings)
    varying = varying_by_channel(recordings, estimates, stated, relative_noise(columns.of_bench(), recordings))
    estimates |= {name: replace(estimates[name], std=one.std) for name, one in varying.items()}
    noise = dataset_noise(recordings, stated, estimates, notes)
    recordings = with_varying_noise(recordings, noise, varying, notes)
    noise |= levels_of_noise(recordings, {})
    for name in set(RESPONDING) & set(noise):
        recordings, noise[name] = with_temperature_error(name, recordings, noise[name], name in stated, notes)
    dataset = without_constant_channels(Dataset(recordings, noise, tuple(notes)), stated)
    return without_repeated_values(with_bench(dataset, columns.of_bench()), estimates)


def read_recording(path: Path, system: str, T_E: float, mapping: Path | None = None) -> tuple[Recording, ...]:
    """The recordings of one file: one, or `name#1`, `name#2` where time starts again. Raises UserError."""
    columns = column_map_for(system, mapping)
    return recordings_in_file(source_file(Path(path), system, T_E, columns), columns.of_file(Path(path)))


def source_file(
    path: Path,
    system: str,
    T_E: float,
    mapping: ColumnMap,
    namespace: str | None = None,
    limits: CommandLimits = NODE_LIMITS,
) -> SourceFile:
    """A file on the bench that its map says. Raises UserError."""
    return SourceFile(path, bench_of(system, mapping.of_file(path)), T_E, namespace=namespace, limits=limits)


def bench_of(system: str, test: ColumnMap) -> str:
    """The structure with the options that a test names, others as those of the `system`. Raises UserError."""
    if not test.bench:
        return system
    own, known = known_structures()[system], known_structures()
    family = [member for member in known.values() if member.is_like(own)]
    wanted = {**own.options, **test.bench}
    found = next((member.name for member in family if dict(member.options) == wanted), None)
    if found is None:
        choices = {name: sorted({member.options[name] for member in family}) for name in own.options}
        words = ', '.join(f'{name}: {" or ".join(values)}' for name, values in choices.items())
        raise UserError(f'the map {test.path}, {test.files}: bench {dict(test.bench)!r}; expected {words or "no bench"}')
    return found


def recordings_in_file(file: SourceFile, mapping: ColumnMap) -> tuple[Recording, ...]:
    """The recordings of one file, of each sheet that the map names of a workbook."""
    sheets = mapping.sheets if file.path.suffix.lower() == WORKBOOK else ()
    return tuple(chain.from_iterable(recordings_in_sheet(file, mapping, sheet) for sheet in sheets or ('',)))


def recordings_in_sheet(file: SourceFile, mapping: ColumnMap, sheet: str) -> tuple[Recording, ...]:
    """The recordings of a file that is no workbook or has one sheet, or of the sheet that is named."""
    try:
        columns, notes = read_source(file.path, file.system, mapping, file.namespace, file.limits, sheet)
    except UserError as error:
        if not sheet:
            raise
        raise type(error)(f'sheet {sheet!r}: {error}') from error
    foreign = {name: entry.column for name, entry in mapping.origins.items() if entry.column is not None}
    converted = frozenset(name for name, entry in mapping.origins.items() if entry.converts)
    file = replace(file, stamped=is_bag(file.path), foreign=foreign, converted=converted)
    name = file.path.stem if file.path.is_file() else file.path.name
    return recordings_from_columns(file, f'{name}#{sheet}' if sheet else name, columns, notes)


def column_map_for(system: str, path: Path | None) -> ColumnMap:
    """The map, if there is one, for the system. Raises UserError."""
    if system not in COLUMNS_BY_SYSTEM:
        raise UserError(f'system: expected one of {", ".join(COLUMNS_BY_SYSTEM)}, got {system!r}')
    if path is None:
        return ColumnMap()
    family = known_structures()[system].family
    mapping = read_column_map(path, {**COLUMNS_BY_SYSTEM, family: COLUMNS_BY_SYSTEM[system]})
    if mapping.system not in (None, family) and not same_options(str(mapping.system), system):
        raise UserError(
            f'the map {path} is for --system {mapping.system}, expected one for {system}; say --system {mapping.system}'
        )
    for test in mapping.tests or (mapping,):
        columns = COLUMNS_BY_SYSTEM[bench_of(system, test)]
        foreign = [name for name in test.origins if name not in columns]
        if foreign:
            raise UserError(f'the map {path}: a {system} has no column {foreign[0]}; expected {", ".join(columns)}')
    return mapping


def same_options(one: str, other: str) -> bool:
    """Whether two systems are one structure with different options."""
    known = known_structures()
    return one in known and other in known and known[one].is_like(known[other])


def unique_files(paths: Sequence[Path], notes: list[str]) -> list[tuple[Path, bool]]:
    """Every file once, and whether it was named itself rather than found in a folder. Raises UserError."""
    if not paths:
        raise UserError('expected at least one recording: CSV files, bags, or folders of them')
    files: dict[Path, tuple[Path, bool]] = {}
    for path in map(Path, paths):
        for file in recordings_in(path):
            if file.resolve() in files:
                notes.append(f'{file} was given twice: read once')
                continue
            files[file.resolve()] = (file, file == path)
        packed = sorted(one.name for one in path.glob('*') if one.suffix in PACKED_SUFFIXES) if path.is_dir() else []
        if packed:
            notes.append(f'{path}: {listed(packed, MAX_NAMES)} left out: packed')
    return list(files.values())


def sessions_in_file(file: SourceFile, mapping: ColumnMap, named: bool, notes: list[str]) -> tuple[Recording, ...]:
    """The recordings of one file; one that holds only commands may lie in a folder, but not be asked for."""
    try:
        return recordings_in_file(file, mapping)
    except NothingMeasuredError:
        if named:
            raise
        notes.append(f'{file.path}: nothing measured in it, left out')
        return ()


def with_distinct_names(found: Sequence[tuple[Path, Recording]]) -> tuple[Recording, ...]:
    """Recordings of the same name in different folders are told apart by the folder."""
    count = Counter(recording.name for _, recording in found)
    renamed = [
        replace(recording, name=f'{path.resolve().parent.name}/{recording.name}') if count[recording.name] > 1 else recording
        for path, recording in found
    ]
    count = Counter(recording.name for recording in renamed)
    return tuple(
        replace(recording, name=str(path) + recording.name[len(recording.name.split('#')[0]) :])
        if count[recording.name] > 1
        else recording
        for (path, _), recording in zip(found, renamed, strict=True)
    )


def without_copies(recordings: Sequence[Recording], notes: list[str]) -> tuple[Recording, ...]:
    """The recordings without those that are copies of one before: nothing is measured twice, nor predicted by its copy."""
    kept = list[Recording]()
    for recording in recordings:
        if original := next((one for one in kept if has_same_samples(one, recording)), None):
            notes.append(f'{recording.name} is a copy of {original.name}, sample by sample: left out')
        else:
            kept.append(recording)
    return tuple(kept)


def noise_from_folders(files: Sequence[Path], channels: Sequence[str], notes: list[str]) -> dict[str, float]:
    """Noise that the meta.json beside the files states; the root mean square where folders differ."""
    stated: dict[str, list[float]] = {}
    for folder in dict.fromkeys(file.parent for file in files):
        for name, value in read_noise_file(folder, channels).items():
            stated.setdefault(name, []).append(value)
    differing = [name for name, values in stated.items() if max(values) > 1.001 * min(values)]
    if differing:
        notes.append(f'the folders state different noise of {", ".join(differing)}: its root mean square is taken')
    return {name: sqrt(sum(value**2 for value in values) / len(values)) for name, values in stated.items()}


def without_sample_noise(recording: Recording, channels: Collection[str]) -> Recording:
    """A recording without the noise of its samples in channels of which the caller says another."""
    return replace(recording, sample_std={name: stds for name, stds in recording.sample_std.items() if name not in channels})


def dataset_noise(
    recordings: Sequence[Recording], given: Mapping[str, float], estimated: Mapping[str, Noise], notes: list[str]
) -> dict[str, float]:
    """The noise of every channel that was measured: as given, or `estimated`, with a note."""
    noise: dict[str, float] = {}
    for name in in_order({name for recording in recordings for name in recording.channels}, recordings[0].system):
        own = [recording.sample_std[name] for recording in recordings if name in recording.sample_std]
        if own:
            noise[name] = sqrt(float(np.nanmean(np.concatenate(own) ** 2)))
            notes.append(f'noise of {name}: that of each row, root mean square {in_display_unit(name, noise[name])}')
            continue
        if name in given:
            noise[name] = given[name]
            continue
        least = max(
            NEGLIGIBLE_FRACTION * value_range(recording.channels[name])
            for recording in recordings
            if name in recording.channels
        )
        estimate = estimated.get(name)
        if estimate is None or max(estimate.std, least) == 0.0:
            noise[name] = assumed_noise(name)
            value = in_display_unit(name, noise[name])
            notes.append(f'noise of {name}: {value} assumed, the samples are too few or all the same')
        elif estimate.std < least:
            noise[name] = least
            notes.append(f'noise of {name}: not visible, 1e-4 of its range is taken, {in_display_unit(name, least)}')
        else:
            noise[name] = estimate.std
            reason = f', most of it the resolution {in_display_unit(name, estimate.step)}' if estimate.quantised else ''
            if any(name in recording.rounding for recording in recordings):
                reason = f', read in steps of {in_display_unit(name, estimate.step)}, which fits allow for'
            reason += ', values are repeated: the sensor is slower than the recording' if estimate.held else ''
            notes.append(f'noise of {name}: {in_display_unit(name, estimate.std)}, estimated from the data{reason}')
    return noise


def with_temperature_error(
    channel: str, recordings: tuple[Recording, ...], noise: float, stated: bool, notes: list[str]
) -> tuple[tuple[Recording, ...], float]:
    """The recordings and the `noise` of a channel of quasi-static tests, with what the temperature of a specimen, known so
    well, adds to it, or to that of each row. A noise that is `stated` for all rows stays as it is.

    To ACCURACY it counts as its root mean square: such an error may last. The noise of a thermometer counts as what it does
    to each row: it comes anew in every cycle, and must not pass for an effect.
    """
    tests = [
        one
        for one in recordings
        if one.structure.is_quasi_static and channel in one.channels
        if channel in one.sample_std or not stated
    ]
    squares = [
        np.nanmean(slopes**2)
        for one in tests
        for slopes in (slopes_over_temperature(one, channel),)
        if np.isfinite(slopes).any()
    ]
    if not squares:
        return recordings, noise
    usual, found = ACCURACY * sqrt(float(np.mean(squares))), dict[str, Recording]()
    stds = [temperature_noise(one) for one in tests]
    for one, std in zip(tests, stds, strict=True):
        own = np.broadcast_to(one.sample_std.get(channel, noise), one.time.shape)
        left = noise_over_temperature(one, channel, std)
        rows = np.sqrt(np.where(np.isnan(own), noise, own) ** 2 + usual**2 + left**2)
        found[one.name] = replace(one, sample_std={**one.sample_std, channel: rows})
    level = levels_of_noise(tuple(found.values()), {})[channel]
    known = hypot(ACCURACY, sqrt(float(np.mean(np.square(stds)))))
    words = f'noise of {channel}: {in_display_unit(channel, level)} with a temperature of the specimen that is known to'
    notes.append(f'{words} {known:.2g} K')
    return tuple(found.get(one.name, one) for one in recordings), hypot(noise, usual)


def value_range(values: Vector) -> float:
    """From the least to the largest of the values (k,), NaN where missing."""
    return float(np.nanmax(values) - np.nanmin(values))


def assumed_noise(channel: str) -> float:
    """What a common sensor of a channel has, in its unit."""
    return ASSUMED_NOISE.get(channel) or ASSUMED_NOISE_IN.get(CHANNEL_COLUMNS[channel].rpartition('_')[2], 1e-5)
