"""Inputs of a run: commands, strains and ambient temperatures over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.argument_checks import as_array, as_kelvin, as_own_array, expect
from sma_sim.model.arrays import Vector
from sma_sim.model.comparable import Comparable
from sma_sim.model.errors import UserError
from sma_sim.model.parameters import is_number
from sma_sim.model.shown import Shown
from sma_sim.model.structures.structure import Structure

MAX_SAMPLES = 1e8  # of a run: their columns take 10 GB and more
INPUT_NAMES = {2: ('J_eq_W', 'T_E_K'), 3: ('strain', 'J_W', 'T_E_K')}  # by the number of columns: module, wire


@dataclass(frozen=True, eq=False, repr=False)
class Input(Shown, Comparable):
    """A piecewise linear or held input of a run.

    Attributes
    ----------
    times : array (k,)
        Times [s], increasing.
    values : array (k, 2) or (k, 3)
        Module: J_eq [W], T_E [K]. Wire: strain [-], J [W], T_E [K].
    linear : tuple of bool
        By column: linear to the next value, or held until the next time.
    names : tuple of str
        Columns of the file contract; without them those of the module (2 columns) or of a wire (3).
    """

    times: Vector
    values: NDArray[np.float64]
    linear: tuple[bool, ...]
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        expect('linear', self.linear, Sequence[bool])
        expect('names', self.names, Sequence[str])
        times, values = as_own_array('times', self.times), as_own_array('values', self.values)
        if times.ndim != 1 or values.shape != (len(times), len(self.linear)) or len(times) == 0:
            raise UserError(
                f'input: expected times (k,) and values (k, {len(self.linear)}), got {times.shape} and {values.shape}'
            )
        object.__setattr__(self, 'times', times)
        object.__setattr__(self, 'values', values)
        object.__setattr__(self, 'linear', tuple(self.linear))
        object.__setattr__(self, 'names', tuple(self.names))
        if not (np.isfinite(times).all() and np.isfinite(values).all()):
            raise UserError('input: times and values must be finite numbers')
        if len(self.columns) != len(self.linear):
            given = ', '.join(self.names) or 'none'
            raise UserError(f'input: expected a name for each of {len(self.linear)} columns in names=(...), got {given}')
        if (np.diff(times) <= 0.0).any():
            at = int(np.argmax(np.diff(times) <= 0.0))
            raise UserError(f'input: times must increase, got {times[at]:g} s and then {times[at + 1]:g} s')

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns of `values`."""
        return self.names or INPUT_NAMES.get(len(self.linear), ())

    def facts(self) -> Mapping[str, str]:
        """What is to be known at a glance."""
        ranges = (f'{n} {v.min():g} to {v.max():g}' for n, v in zip(self.columns, np.asarray(self.values).T, strict=True))
        return {'rows': f'{len(self.times)} from {self.times[0]:g} to {self.times[-1]:g} s', 'columns': ', '.join(ranges)}


def module_input(
    times: Sequence[float], J_eq: Sequence[float], T_E: float | Sequence[float] = 298.0, linear: bool = False
) -> Input:
    """A command for the module.

    Parameters
    ----------
    times : sequence of float, (k,)
        Times [s], increasing; the last one is the end of the run.
    J_eq : sequence of float, (k,)
        Command [W]: positive heats bundle 1, negative bundle 2.
    T_E : float or sequence of float, (k,)
        Ambient temperature [K], held from each time to the next.
    linear : bool
        Whether the command is linear between the times, instead of held.

    Returns
    -------
    Input
        The command, for `simulate`.

    Raises
    ------
    UserError
        If times do not increase or a value is not finite.

    Examples
    --------
    >>> import sma_sim
    >>> sma_sim.module_input([0.0, 5.0, 20.0], [0.0, 12.0, 0.0]).values.shape
    (3, 2)
    """
    return input_of(times, {'J_eq': J_eq, 'T_E': T_E}, (linear, False))


def wire_input(
    times: Sequence[float], strain: Sequence[float], J: float | Sequence[float] = 0.0, T_E: float | Sequence[float] = 298.0
) -> Input:
    """An imposed strain and heating for a single wire.

    Parameters
    ----------
    times : sequence of float, (k,)
        Times [s], increasing; the last one is the end of the run.
    strain : sequence of float, (k,)
        Strain [-], linear between the times.
    J : float or sequence of float, (k,)
        Heating of the wire [W], held.
    T_E : float or sequence of float, (k,)
        Ambient temperature [K], held.

    Returns
    -------
    Input
        The input, for `simulate` with ``system='wire'``.

    Raises
    ------
    UserError
        If times do not increase or a value is not finite.

    Examples
    --------
    >>> import sma_sim
    >>> source = sma_sim.wire_input([0.0, 60.0], [0.0, 0.06])
    >>> run = sma_sim.simulate(sma_sim.Model(sma_sim.Config(system='wire')), source, 1.0)
    >>> run.completed, sorted(run.columns)
    (True, ['T_K', 'mode', 'stress_Pa', 'x_M'])
    """
    return input_of(times, {'strain': strain, 'J': J, 'T_E': T_E}, (True, False, False))


def input_of(times: Sequence[float], columns: Mapping[str, float | Sequence[float]], linear: tuple[bool, ...]) -> Input:
    """An input of columns by name, each of one value, or of one for each of the times (k,) [s]. Raises UserError."""
    at, made = as_array('times', times, '[s]'), []
    if at.ndim != 1:
        raise UserError(f'times: expected times (k,) [s], got {times!r}')
    for name, given in columns.items():
        values = as_array(name, given)
        if values.shape not in ((), at.shape):
            raise UserError(
                f'{name}: expected one value, or {len(at)} as there are times; got an array of shape {values.shape}'
            )
        made.append(np.broadcast_to(values, at.shape))
    return Input(at, np.column_stack(made), linear)


def check_columns(structure: Structure, source: Input) -> None:
    """Raise UserError where an input has not the columns of a structure, or its temperatures are not kelvin."""
    expected, given = structure.input_columns, source.columns
    heats_one = not source.names and expected == ('J_W', 'T_E_K') and (source.values[:, 0] >= 0.0).all()  # as J_eq does
    if given != expected and not (heats_one and given == INPUT_NAMES[2]):
        if not source.names and expected == ('J_W', 'T_E_K'):
            raise UserError(
                f'the input has a command of {source.values[:, 0].min():g} W; system {structure.family!r} takes J_W, T_E_K, '
                'which only heat: expected 0 or more'
            )
        makers = {INPUT_NAMES[2]: 'sma_sim.module_input(...)', INPUT_NAMES[3]: 'sma_sim.wire_input(...)'}
        how = makers.get(expected, f'sma_sim.Input(times, values, linear, names={expected!r})')
        raise UserError(
            f'the input has the columns {", ".join(given)}; system {structure.family!r} takes {", ".join(expected)}: '
            f'make it with {how}'
        )
    for name, values in zip(expected, source.values.T, strict=True):
        if name.endswith('_K'):
            as_kelvin(f'input: {name}', float(values.min()))
            as_kelvin(f'input: {name}', float(values.max()))


def command_column(source: Input) -> int:
    """Where the electrical command is among the columns of an input."""
    return len(source.linear) - 2


def input_between(source: Input, first: float, last: float) -> Input:
    """The rows of an input from time `first` to `last` [s], which are times of rows."""
    rows = (source.times >= first) & (source.times <= last)
    return Input(source.times[rows], source.values[rows], source.linear, source.names)


def inputs_at(source: Input, times: Vector) -> dict[str, Vector]:
    """The times (k,) [s] and the input in force at each, by the names of the file contract, (k,) each."""
    held = np.searchsorted(source.times, times, side='right') - 1
    columns = {'time_s': times}
    for k, name in enumerate(source.columns):
        values = source.values[:, k]
        columns[name] = np.interp(times, source.times, values) if source.linear[k] else values[held]
    return columns


def regular_times(source: Input, rate: float) -> Vector:
    """Times at `rate` [1/s] from the first to the last of an input."""
    first, last = source.times[0], source.times[-1]
    count = int(np.floor((last - first) * rate + 1e-9)) + 1
    times: Vector = np.minimum(first + np.arange(count) / rate, last)
    return times


def segments(source: Input) -> tuple[Vector, NDArray[np.float64], NDArray[np.float64]]:
    """Times, values and slopes of the stretches of an input, equal neighbours joined.

    A linear column is split where it crosses zero: heating as a function of J_eq has a kink there.
    """
    moving = any(source.linear)
    times, values = (
        with_zero_crossings(source) if moving else (np.asarray(source.times, float), np.asarray(source.values, float))
    )
    slopes = np.zeros(values.shape)
    if moving and len(times) > 1:
        linear = np.array(source.linear)
        slopes[:-1, linear] = (np.diff(values[:, linear], axis=0).T / np.diff(times)).T
    keep = np.ones(len(times), dtype=bool)
    if len(times) > 2:
        still = (slopes == 0).all(axis=1)
        keep[1:-1] = ~(still[1:-1] & still[:-2] & (values[1:-1] == values[:-2]).all(axis=1))
    kept = [np.ascontiguousarray(part[keep]) for part in (times, values, slopes)]  # one layout: one version is compiled
    return kept[0], kept[1], kept[2]


def with_zero_crossings(source: Input) -> tuple[Vector, NDArray[np.float64]]:
    """Times and values with a row where a linear column passes through zero."""
    times, values = np.asarray(source.times, float), np.asarray(source.values, float)
    for column in np.flatnonzero(source.linear):
        before, after = values[:-1, column], values[1:, column]
        at = np.flatnonzero(before * after < 0.0)
        if len(at) == 0:
            continue
        part = before[at] / (before[at] - after[at])
        rows = values[at].copy()
        for other in np.flatnonzero(source.linear):
            rows[:, other] += part * (values[at + 1, other] - values[at, other])
        rows[:, column] = 0.0
        when = times[at] + part * (times[at + 1] - times[at])
        inside = (when > times[at]) & (when < times[at + 1])
        times = np.insert(times, at[inside] + 1, when[inside])
        values = np.insert(values, at[inside] + 1, rows[inside], axis=0)
    return times, values


def requested_times(source: Input, samples: Vector | Sequence[float] | float) -> Vector:
    """Sample times from a rate [1/s] or as given: increasing, within the input's. Raises UserError."""
    single = samples.item() if isinstance(samples, np.ndarray) and samples.ndim == 0 else samples
    if is_number(single):
        samples = float(cast(float, single))
        if not 0.0 < samples < np.inf:
            raise UserError(
                f'sample_times = {samples:g}: expected a rate of more than 0 per second, or an array of times [s]'
            )
        if (length := float(source.times[-1] - source.times[0])) * samples > MAX_SAMPLES:
            raise UserError(
                f'sample_times = {samples:g}: {length:g} s would have {length * samples:g} samples; expected a rate [1/s] '
                f'that makes {MAX_SAMPLES:g} at most'
            )
        return regular_times(source, samples)
    times = np.array(as_array('sample_times', samples, 'per second, or times [s]'))
    first, last = source.times[0], source.times[-1]
    if times.ndim == 0:
        raise UserError(f'sample_times: expected a rate [1/s] or times (k,) [s], got {samples!r}')
    if fault := fault_of_times(times):
        raise UserError(f'sample_times: expected a rate [1/s] or times (k,) [s] that increase, got {fault}')
    if len(times) and not first <= times[0] <= times[-1] <= last:
        raise UserError(
            f'sample_times from {times[0]:g} to {times[-1]:g} s: expected times of the input, {first:g} to {last:g} s'
        )
    return times


def fault_of_times(times: NDArray[np.float64]) -> str:
    """Where times are not (k,) that increase, '' where they are."""
    if times.ndim != 1:
        return f'an array of shape {times.shape}'
    wrong = np.flatnonzero(~np.isfinite(times))
    if len(wrong):
        return f'{times[wrong[0]]} at number {wrong[0] + 1}'
    back = np.flatnonzero(np.diff(times) <= 0.0)
    return f'{times[back[0]]:.9g} s and then {times[back[0] + 1]:.9g} s' if len(back) else ''
