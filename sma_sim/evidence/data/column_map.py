"""Foreign column names, scales and offsets: the file of `--map`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from sma_sim.evidence.data.imposed import without_noise
from sma_sim.evidence.data.table_format import COLUMNS, is_number
from sma_sim.evidence.data.tables import MAX_NAMES
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.model.nearest import suggestion
from sma_sim.model.parameter_yaml import UniqueKeys
from sma_sim.model.shown import listed

ENTRY_KEYS = ('column', 'value', 'scale', 'offset', 'exponent', 'zero_std', 'drift_std', 'floor', 'relative_std')
POSITIVE_KEYS = ENTRY_KEYS[4:]
TIMES, NANOSEC, STD, WHERE = 'times', 'nanosec', 'std', 'where'  # keys of an entry that name other columns
TIME = 'time'  # likewise: the times of a column that was not sampled with the others
INDEPENDENT_AFTER, NUISANCES = 'independent_after', 'nuisances'  # keys of the whole map: [s]; effects
PACE_KEYS = ('path', 'rate')
INTERVAL = 'interval'  # key of time_s: [s] between rows, where no column holds the time
TESTS, FILES, BENCH = 'tests', 'files', 'bench'  # keys of a campaign of several kinds of tests
SHEET = 'sheet'  # key of a map of workbooks: which sheets hold recordings
REST = 1e-3  # [s] between rows of a quasi-static test in which nothing changed


@dataclass(frozen=True)
class Origin:
    """Where a column of the contract comes from: ``scale * column**exponent * times + offset``, or the constant `value`.

    `times` is another column, such as a current beside a voltage; `nanosec` one that counts the nanoseconds of a time in
    seconds; `time` one that says when the column was sampled, where that was not with the others, in the unit of `time_s`.
    In a long table, `where` says which rows hold the column: names of other columns, each with its cell.

    What is known of a measured column beside the noise of its samples, in its SI unit: its zero differs from recording to
    recording by `zero_std` and drifts by `drift_std` within one, and repeated experiments differ by `floor`. The noise is
    that of each row where `std` is the column that holds it, in its unit; `relative_std` times the size adds to it.
    Time of a quasi-static test, in which nobody noted it, comes from a column that changed by `pace` per second; of regular
    rows without a time, from their `interval` [s]. `has_unit`: the map says `scale` or `offset`, whatever a table states.
    """

    column: str | None
    value: float = 0.0
    scale: float = 1.0
    offset: float = 0.0
    pace: float | None = None
    interval: float | None = None
    exponent: float = 1.0
    times: str | None = None
    nanosec: str | None = None
    where: tuple[tuple[str, str], ...] = ()
    zero_std: float = 0.0
    drift_std: float = 0.0
    floor: float = 0.0
    std: str | None = None
    relative_std: float = 0.0
    time: str | None = None
    has_unit: bool = False

    @property
    def converts(self) -> bool:
        """Whether the numbers of the column become others."""
        return (self.scale, self.offset, self.exponent) != (1.0, 0.0, 1.0) or bool(self.pace or self.times or self.nanosec)

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of the file whose numbers are taken."""
        return tuple(name for name in (self.column, self.times, self.nanosec, self.std, self.time) if name is not None)

    @property
    def unknown(self) -> tuple[float, float, float]:
        """What differs beside noise: zero, its drift, repeats."""
        return self.zero_std, self.drift_std, self.floor


@dataclass(frozen=True)
class ColumnMap:
    """Origins by the names of the contract, and the `system` that the map was written for, if it says so.

    `independent_after` [s]: how long what repeated experiments differ by lasts; 0 where it is not stated. `tests`: the maps
    of a campaign of several kinds of tests, each with the pattern of its `files` and the options of its `bench`.
    `nuisances`: by effect that belongs to the bench, the standard deviations of the priors of its parameters. `sheets`:
    those of a workbook that hold a recording each; none where it has only one. `names`: those of all columns of tables
    without a header, from left to right.
    """

    origins: Mapping[str, Origin] = field(default_factory=dict)
    system: str | None = None
    path: Path | None = None
    independent_after: float = 0.0
    tests: tuple[ColumnMap, ...] = ()
    files: str = '*'
    bench: Mapping[str, str] = field(default_factory=dict)
    nuisances: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    sheets: tuple[str, ...] = ()
    names: tuple[str, ...] = ()

    @property
    def columns(self) -> frozenset[str]:
        """Columns of a file that the map names."""
        return frozenset(name for entry in self.origins.values() for name in (*entry.columns, *dict(entry.where)))

    def of_file(self, path: Path) -> ColumnMap:
        """The map of a file: of a campaign, that of the first test whose pattern it matches. Raises UserError."""
        if not self.tests:
            return self
        found = next((test for test in self.tests if path.resolve().match(test.files)), None)
        if found is None:
            patterns = ', '.join(test.files for test in self.tests)
            raise UserError(f'{path} belongs to none of the {TESTS} of the map {self.path}; their {FILES} are {patterns}')
        return found

    def of_bench(self) -> ColumnMap:
        """Zeros and floors of all tests by column. Raises UserError where tests state different ones of a column."""
        known = dict(self.origins)
        for test in self.tests:
            for name, entry in test.origins.items():
                before = known.setdefault(name, entry)
                if before.unknown != entry.unknown:
                    if any(before.unknown) and any(entry.unknown):
                        raise UserError(
                            f'the map {self.path}, {name}: expected one zero_std, drift_std, floor in all {TESTS}'
                        )
                    known[name] = max(before, entry, key=lambda one: one.unknown)
        return replace(self, origins=known)


def entries_of_map(path: Path) -> dict[Any, Any]:
    """What a map says, as it is written. Raises UserError for what is no map."""
    try:
        given = yaml.load(path.read_text(encoding='utf-8-sig'), UniqueKeys)  # noqa: S506  a SafeLoader
    except OSError as error:
        raise UserError(f'cannot read the map {path}: {error.strerror}') from error
    except (yaml.YAMLError, UnicodeDecodeError, ValueError, RecursionError) as error:
        raise UserError(f'the map {path} is not YAML: {" ".join(str(error).split())}') from error
    if not isinstance(given, dict):
        raise UserError(f'the map {path}: expected lines such as "stress_Pa: {{column: stress_MPa, scale: 1e6}}"')
    return given


def read_column_map(path: Path, known: Mapping[str, Sequence[str]]) -> ColumnMap:
    """A map from YAML; `known` holds the columns of each system. Raises UserError."""
    given = entries_of_map(path)
    system = given.pop('system', None)
    if system is not None and system not in known:
        raise UserError(f'the map {path}, system: expected {" or ".join(known)}, got {system!r}')
    lasting = checked_positive(f'the map {path}', INDEPENDENT_AFTER, given.pop(INDEPENDENT_AFTER, 0.0))
    nuisances = parsed_nuisances(f'the map {path}, {NUISANCES}', given.pop(NUISANCES, {}))
    sheets = parsed_sheets(f'the map {path}', given.pop(SHEET, []))
    header = parsed_names(f'the map {path}', given.pop(COLUMNS, []))
    every = [name for columns in known.values() for name in columns]
    tests = tuple(parsed_test(path, entry, every) for entry in checked_tests(path, given.pop(TESTS, [])))
    names = known[system] if system and not tests else every
    origins = {str(name): parsed_origin(path, str(name), entry, names) for name, entry in given.items()}
    tests = tuple(
        replace(
            test,
            origins=origins | dict(test.origins),
            system=system,
            sheets=test.sheets or sheets,
            names=test.names or header,
        )
        for test in tests
    )
    return ColumnMap(origins, system, path, lasting, tests, nuisances=nuisances, sheets=sheets, names=header)


def checked_tests(path: Path, given: Any) -> list[dict[str, Any]]:
    """The kinds of tests of a campaign, as a map lists them. Raises UserError."""
    entries = given if isinstance(given, list) else [given]
    if not all(isinstance(entry, dict) and isinstance(entry.get(FILES), str) for entry in entries):
        raise UserError(
            f'the map {path}, {TESTS}: expected a list of entries with {FILES} (a pattern such as pulls/*.csv), '
            f'{BENCH} and columns, got {given!r}'
        )
    return entries


def parsed_test(path: Path, entry: Mapping[str, Any], names: Sequence[str]) -> ColumnMap:
    """One kind of test: which files, on which bench, and where their columns come from. Raises UserError."""
    bench = entry.get(BENCH, {})
    if not isinstance(bench, dict) or not all(isinstance(word, str) for word in bench.values()):
        raise UserError(
            f'the map {path}, {TESTS}, {entry[FILES]}: expected {BENCH}: {{control: stress, '
            f'temperature: prescribed}}, got {bench!r}'
        )
    columns = {str(name): column for name, column in entry.items() if name not in (FILES, BENCH, SHEET, COLUMNS)}
    origins = {name: parsed_origin(path, name, column, names) for name, column in columns.items()}
    where = f'the map {path}, {TESTS}, {entry[FILES]}'
    sheets, header = parsed_sheets(where, entry.get(SHEET, [])), parsed_names(where, entry.get(COLUMNS, []))
    options = {f'{BENCH}.{name}': word for name, word in bench.items()}
    return ColumnMap(origins, path=path, files=entry[FILES], bench=options, sheets=sheets, names=header)


def parsed_names(where: str, given: Any) -> tuple[str, ...]:
    """The names of all columns of a table without a header. Raises UserError."""
    if not isinstance(given, list) or not all(isinstance(name, str) for name in given):
        raise UserError(
            f'{where}, {COLUMNS}: expected the names of all columns from left to right, such as [time, force, "1"], '
            f'got {given!r}'
        )
    if twice := [name for name in given if name and given.count(name) > 1]:
        raise UserError(f'{where}, {COLUMNS}: {twice[0]} is there twice, expected a name for each column, or "" for none')
    return tuple(given)


def parsed_sheets(where: str, given: Any) -> tuple[str, ...]:
    """The titles of the sheets that hold recordings, one or a list of them. Raises UserError."""
    titles = given if isinstance(given, list) else [given]
    if not all(isinstance(title, str | int | float) and not isinstance(title, bool) for title in titles):
        raise UserError(f'{where}, {SHEET}: expected the title of a sheet or a list of titles, got {given!r}')
    return tuple(dict.fromkeys(map(str, titles)))


def parsed_nuisances(where: str, given: Any) -> dict[str, dict[str, float]]:
    """Effects of the bench with the standard deviations of their parameters. Raises UserError."""
    if not isinstance(given, dict) or not all(isinstance(entry, dict) and entry for entry in given.values()):
        raise UserError(f'{where}: expected effects such as {{power_scale: {{k: 0.1}}}}, got {given!r}')
    found: dict[str, dict[str, float]] = {}
    for name, entry in given.items():
        found[str(name)] = {str(key): finite_number(f'{where}, {name}', str(key), value) for key, value in entry.items()}
        for key, std in found[str(name)].items():
            if std <= 0.0:
                raise UserError(f'{where}, {name}, {key}: expected a standard deviation, more than 0, got {std:g}')
    return found


def parsed_origin(path: Path, name: str, entry: Any, names: Sequence[str]) -> Origin:
    """One line of a map. Raises UserError."""
    if name not in names:
        expected = dict.fromkeys(names)
        raise UserError(
            f'the map {path}: unknown column {name}{suggestion(name, expected)}; expected some of {", ".join(expected)}'
        )
    if isinstance(entry, str):
        return Origin(entry)
    where = f'the map {path}, {name}'
    if name == 'time_s' and isinstance(entry, dict) and 'path' in entry:
        return parsed_pace(where, entry)
    if name == 'time_s' and isinstance(entry, dict) and INTERVAL in entry:
        return parsed_interval(where, entry)
    column = entry.get('column') if isinstance(entry, dict) else entry
    if isinstance(column, bool):
        raise UserError(f'{where}: expected the name of a column, got {column}: YAML reads on, off, yes and no so; quote it')
    if not isinstance(entry, dict) or ('column' in entry) == ('value' in entry):
        raise UserError(f'{where}: expected {{column: NAME, scale: 1, offset: 0}} or {{value: 1.0}}, got {entry!r}')
    keys = (*ENTRY_KEYS, TIMES, NANOSEC, STD, TIME, WHERE)
    wrong = [key for key in entry if key not in keys]
    if wrong:
        raise UserError(f'{where}: unknown {wrong[0]!r}; expected some of {", ".join(keys)}')
    if isinstance(entry.get('scale'), str) and not is_number(entry['scale']):
        raise UserError(
            f'{where}, scale: expected a number, got {entry["scale"]!r}; for a product of two columns: '
            f'{{column: {entry.get("column")}, {TIMES}: {entry["scale"]}}}'
        )
    others = other_columns(where, name, entry)
    numbers = {key: finite_number(where, key, entry[key]) for key in ENTRY_KEYS[1:] if key in entry}
    if numbers.get('scale') == 0.0:
        raise UserError(f'{where}, scale: expected a number other than 0')
    for key in POSITIVE_KEYS:
        checked_positive(where, key, numbers.get(key, 0.0))
    beside = {*entry} - {'value'} - ({'zero_std'} if name == 'T_E_K' else set())
    if 'value' in entry and beside:
        raise UserError(f'{where}: a value is in SI units already, and is not measured; remove what stands beside it')
    origin = Origin(
        str(column) if 'column' in entry else None,
        times=others.get(TIMES),
        nanosec=others.get(NANOSEC),
        std=others.get(STD),
        time=others.get(TIME),
        where=rows_where(where, entry),
        has_unit='scale' in entry or 'offset' in entry,
    )
    known: dict[str, Any] = {**numbers}
    return replace(origin, **known)


def other_columns(where: str, name: str, entry: Mapping[str, Any]) -> dict[str, str]:
    """The second column of a product, that of nanoseconds, that of the noise and that of times. Raises UserError."""
    found = {key: entry[key] for key in (TIMES, NANOSEC, STD, TIME) if key in entry}
    for key, column in found.items():
        if not isinstance(column, str):
            raise UserError(f'{where}, {key}: expected the name of a column, got {column!r}')
    if NANOSEC in found and name != 'time_s':
        raise UserError(f'{where}: {NANOSEC} belongs to time_s')
    if TIME in found and (name == 'time_s' or STD in found):
        raise UserError(f'{where}: {TIME} is of a measured column whose rows have one noise')
    if STD in found and (TIMES in found or entry.get('exponent', 1) != 1):
        raise UserError(f'{where}: {STD} is the noise of one column, not of a product or a power')
    return found


def rows_where(where: str, entry: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    """Which rows of a long table hold a column. Raises UserError."""
    given = entry.get(WHERE, {})
    cells = list(given.values()) if isinstance(given, dict) else [None]
    if not all(isinstance(cell, str | int | float) for cell in cells):
        raise UserError(f'{where}, {WHERE}: expected another column and its cell, such as {{source: 1}}, got {given!r}')
    return tuple((str(column), str(cell)) for column, cell in given.items())


def parsed_pace(where: str, entry: Mapping[str, Any]) -> Origin:
    """Time by what moves at a known pace. Raises UserError."""
    pace = finite_number(where, 'rate', entry.get('rate'))
    if set(entry) != set(PACE_KEYS) or pace <= 0.0:
        raise UserError(f'{where}: expected {{path: COLUMN, rate: CHANGE PER SECOND}} with a positive rate, got {entry!r}')
    return Origin(str(entry['path']), pace=pace)


def parsed_interval(where: str, entry: Mapping[str, Any]) -> Origin:
    """Time of regular rows. Raises UserError."""
    interval = finite_number(where, INTERVAL, entry[INTERVAL])
    if set(entry) != {INTERVAL} or interval <= 0.0:
        raise UserError(f'{where}: expected {{{INTERVAL}: SECONDS}} between rows, more than 0, got {entry!r}')
    return Origin(None, interval=interval)


def checked_positive(where: str, key: str, given: Any) -> float:
    """A finite number that is not negative. Raises UserError."""
    value = finite_number(where, key, given)
    if value < 0.0:
        raise UserError(f'{where}, {key}: expected a positive number, got {given!r}')
    return value


def finite_number(where: str, key: str, given: Any) -> float:
    """A finite number; also 1e6 without a point, which YAML reads as text. Raises UserError."""
    try:
        value = float('x' if isinstance(given, bool) else given)
    except (TypeError, ValueError):
        value = float('nan')
    if not np.isfinite(value):
        raise UserError(f'{where}, {key}: expected a number, got {given!r}')
    return value


def column_origins(path: Path, mapping: ColumnMap, names: Sequence[str], present: Sequence[str]) -> dict[str, Origin]:
    """The origin of every column among `names` that the file (with the columns `present`) or the map has."""
    found = {name: Origin(name) for name in names if name in present} | dict(mapping.origins)
    for name, entry in found.items():
        missing = [column for column in (*entry.columns, *dict(entry.where)) if column not in present]
        if missing:
            raise UserError(
                f'{path} has no column {missing[0]}, which the map {mapping.path} names for {name}'
                f'{suggestion(missing[0], present)}; its columns are {listed(present, MAX_NAMES)}'
            )
    return found


def column_in_si(entry: Origin, columns: Mapping[str, Vector], rows: int) -> Vector:
    """The column (rows,) of the contract, in SI units."""
    if entry.interval is not None:
        return np.linspace(0.0, entry.interval * (rows - 1), rows)
    if entry.column is None:
        return np.full(rows, entry.value)
    values = columns[entry.column]
    if entry.pace is not None:
        return time_along(without_noise(values).values, entry.pace)
    if entry.exponent != 1.0:
        values = np.sign(values) * np.abs(values) ** entry.exponent
    if entry.times is not None:
        values = values * columns[entry.times]
    if entry.scale != 1.0 or entry.offset != 0.0:
        with np.errstate(over='ignore', invalid='ignore'):  # the reader discards infinite numbers, with a note
            values = entry.scale * values + entry.offset
    return values if entry.nanosec is None else values + 1e-9 * columns[entry.nanosec]


def time_along(values: Vector, pace: float) -> Vector:
    """Times (k,) [s] of a test in which `values` (k,) changed by `pace` per second, up or down; NaN where one is missing."""
    known = np.isfinite(values)
    times = np.full(len(values), np.nan)
    times[known] = np.concatenate([[0.0], np.cumsum(np.maximum(np.abs(np.diff(values[known])) / pace, REST))])[: known.sum()]
    return times
