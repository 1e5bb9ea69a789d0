"""A command that changes at every moment, as that of a controller does, in fewer stretches: for the tangents of a run.

The heat capacity C of a wire smooths what it is given. Over a stretch of the input the heating P of every wire is replaced
by the line of the same mean and the same first moment, its least-squares line. Of the difference w = P - line the integral
E(t) = int w dt from the beginning is then zero at both ends, and so is that of E. The temperature differs by D(t), with
C dD/dt = w - C D/tau where tau > 0 is the time constant of the heat balance, hence

    D(t) = E(t)/C - (1/tau) int exp(-(t - s)/tau) E(s)/C ds,      |D| <= 2 max |E|/C,

and at the end of the stretch only int (1 - exp(-(h - s)/tau)) E ds/(C tau) is left, of order h/tau^2. Neighbouring rows are
taken together as long as max |E|/C is small. Latent heat adds to C, and makes D smaller. The ambient temperature acts as
lambda A T_E. An antagonistic command becomes the heating of each wire, so that a change of its sign is no kink. What a
driver makes of the command alone, as a threshold or a saturation does, is computed row by row before: lines are of what it
passes on, over the rows that can be taken together without it, so that they move evenly with its parameters.

Derivatives of a run need no more, since they keep three digits; the run itself is made row by row. A fit tries more: where
it is known at one point what a run shows beyond that under lines, a run under lines nearby and this difference tell what the
run there shows, at a part of its cost, even for lines of many rows (`Leeway`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.compiler.compile import package_compiler
from sma_sim.compiler.effect_kernels import kernel_types, own_kernels
from sma_sim.compiler.fields_read import WIRE, fields_read
from sma_sim.compiler.kernel_text import parameter_fields
from sma_sim.model.arrays import Integers, Matrix, Vector
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import ACTUATION, PORT_NAMES, S_J, S_OTHERS, S_WIRE, call_effect
from sma_sim.model.layout import System
from sma_sim.model.parameters import WireConstants
from sma_sim.model.structures.structure import Structure, record
from sma_sim.solver.effect_table import TEMPERATURE_SCALE, acting_order, own_scratch
from sma_sim.solver.inputs import Input, segments
from sma_sim.solver.integrate import InputStretches
from sma_sim.solver.model import Model

Arrays = NDArray[np.float64]  # of three dimensions
SMOOTHED = 2.0  # the most of max |E|/C, in units of solver.rtol times that scale
MAX_ROWS = 4096  # in a stretch
PROBED = np.linspace(0.0, 1.0, 9)  # of the largest heating, where effects must be linear in it
PROBED_STATES, T_E = (0.3, 0.9), 298.0  # of the scales of states; [K]
STEP = 1e-6  # of the largest heating, for the slope of what a driver passes on
LINEAR = 1e-9  # what is left of a linear function, relative to its values


class Leeway(NamedTuple):
    """How far what lines bring may be ahead of what rows bring, at most, or behind it: max |E|."""

    heat: float  # [J] of a bundle
    ambient: float  # [K s] of T_E

    @classmethod
    def of(cls, wire: WireConstants, kelvin: float) -> Leeway:
        """By which the temperature of a wire differs by `kelvin`, twice this at the most."""
        heat, lost = kelvin * wire.volume * wire.rho * wire.c_V, wire.lambda_ * wire.surface
        return cls(wire.n * heat, heat / lost if lost else inf)


class Stretches(NamedTuple):
    """An input in stretches (k,), each `value` + `slope` (t - time) (k, columns), and their derivatives in unknowns (k, P,
    columns). `times` (k + 1,) has the end too; `passed`: effects of the actuation chain that it has passed already."""

    times: Vector
    values: Matrix
    slopes: Matrix
    value_shifts: Arrays
    slope_shifts: Arrays
    passed: int = 0


class Shifts(NamedTuple):
    """Derivatives of an input in unknowns: of the times of its rows (k, P), of its values and slopes at the same time
    (k, P, columns; no rows where these stay)."""

    times: Matrix
    values: Arrays
    slopes: Arrays

    def held_until(self, rows: int) -> Shifts:
        """With as many rows, the last one held."""
        further = ((0, rows - len(self.times)), (0, 0))
        held = (np.pad(one, (*further, (0, 0)), mode='edge') if len(one) else one for one in self[1:])
        return Shifts(np.pad(self.times, further), *held)


class Moved(NamedTuple):
    """The models in which an unknown, by its number, is `delta` more."""

    models: Mapping[int, Model]
    delta: float


NOT_MOVED = Moved({}, 1.0)


class Partition(NamedTuple):
    """Rows of an input that are taken together: `first` (k + 1,) of each stretch and of the end, and the line of each."""

    times: Vector  # (rows,)
    heating: Matrix  # (rows, columns)
    first: Integers
    lines: Matrix  # (k, columns)
    tilts: Matrix

    def behind_driver(self, heating: Matrix) -> Partition:
        """The same rows with the `heating` that a driver passes on."""
        lines, tilts = np.zeros_like(self.lines), np.zeros_like(self.tilts)
        package_compiler().function(lines_through)(self.times, heating, self.first, lines, tilts)
        return self._replace(heating=heating, lines=lines, tilts=tilts)


class Identity:
    """An input as a key: the same is not partitioned twice."""

    def __init__(self, source: Input) -> None:
        self.source = source

    def __hash__(self) -> int:
        return id(self.source)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Identity) and self.source is other.source


def smoothed(
    model: Model,
    source: Input,
    until: float,
    leeway: Leeway | None = None,
    shifts: Shifts | None = None,
    moved: Moved = NOT_MOVED,
) -> Stretches | None:
    """The heating of every wire and T_E [W, K] in fewer stretches; None where none can be taken together.

    The last values are held up to the time `until` [s]. `shifts`: derivatives of the rows in unknowns; those in parameters
    of a driver are of the models in which these are `moved`. Without `leeway` temperatures may differ by as much as the
    tolerance of the model allows.
    """
    p, wire = model.compiled, model.wire
    if p.drives or not p.coordinates or any(source.linear):
        return None
    leeway = leeway or Leeway.of(wire, SMOOTHED * model.config.parameters['solver.rtol'] * TEMPERATURE_SCALE)
    found = partition(Identity(source), p.wires, p.antagonistic, leeway)
    if found is None:
        return None
    largest = float(found.heating[:, :-1].max()) / wire.n
    passed = passed_before(model.config.effects, model.structure, wire, largest)
    if passed is None:
        return None
    if shifts is None:
        shifts = Shifts(np.zeros((len(found.times), 0)), *np.zeros((2, 0, 0, source.values.shape[1])))
    by_heating = shifts_of_heating(shifts.values, found.heating, p.antagonistic)
    if passed:
        heating = driven(model, found.heating, passed)
        by_heating = shifts_behind_driver(model, passed, found.heating, heating, by_heating, moved, shifts.times.shape[1])
        found = found.behind_driver(heating)
    of_lines = shifts_of_lines(found, shifts.times, by_heating)
    made = Stretches(found.times[found.first], found.lines, found.tilts, *of_lines, passed)
    return made if until <= made.times[-1] else held_lines(made, found.heating[-1], by_heating[-1:], until)


@lru_cache(64)
def partition(key: Identity, wires: int, antagonistic: bool, leeway: Leeway) -> Partition | None:
    """The rows of an input that can be taken together; None where none can."""
    times, values, _ = segments(key.source)
    if len(times) < 3:
        return None
    heating = heating_of_wires(values, wires, antagonistic)
    most = np.array([leeway.heat] * wires + [leeway.ambient])
    first = np.zeros(len(times), dtype=np.int64)
    lines, tilts = np.zeros(heating.shape), np.zeros(heating.shape)
    count = package_compiler().function(take_together)(times, heating, most, first, lines, tilts)
    if count == len(times) - 1:
        return None
    first[count] = len(times) - 1
    return Partition(times, heating, first[: count + 1].copy(), lines[:count].copy(), tilts[:count].copy())  # views keep all


def held_lines(made: Stretches, heating: Vector, shift: Arrays, until: float) -> Stretches:
    """With one stretch more, in which the heating (columns,) and its derivatives (1, P, columns) stay up to a time [s]."""
    none = np.zeros_like(made.value_shifts[:1])
    shifts = np.concatenate([made.value_shifts, shift if len(shift) else none]), np.concatenate([made.slope_shifts, none])
    values, slopes = np.vstack([made.values, heating]), np.vstack([made.slopes, np.zeros_like(heating)])
    return Stretches(np.append(made.times, until), values, slopes, *shifts, made.passed)


def under_lines(lines: Stretches) -> InputStretches:
    """The input of a run under lines: as one that depends on time, so that no row is crossed otherwise than by a run with
    tangents, and both are the same to the last bit."""
    return InputStretches(lines.times, lines.values, lines.slopes, True)


def system_under(lines: Stretches, p: System) -> System:
    """The equations of a model under lines, which heat every wire, and have passed the first effects on actuation."""
    starts = p.effects.port_start.copy()
    starts[ACTUATION] += lines.passed
    return p._replace(antagonistic=False, effects=p.effects._replace(port_start=starts))


def shifts_behind_driver(
    model: Model, passed: int, given: Matrix, left: Matrix, shifts: Arrays, moved: Moved, unknowns: int
) -> Arrays:
    """Derivatives of what has `left` the first effects of the actuation chain in unknowns (rows, P, columns), from those of
    the heating that they were `given` (rows, columns), if there are any."""
    own = driver_parameters(model, passed)
    changes = {
        j: (driven(other, given, passed) - left) / moved.delta
        for j, other in moved.models.items()
        if not np.array_equal(driver_parameters(other, passed), own)
    }
    if len(shifts):
        step = STEP * float(given[:, :-1].max())
        slope = (driven(model, given + step, passed) - left) / step
        shifts = shifts * np.where(given > 0.0, slope, 0.0)[:, None, :]
    elif changes:
        shifts = np.zeros((len(given), unknowns, given.shape[1]))
    for j, change in changes.items():
        shifts[:, j] += change
    return shifts


def driver_parameters(model: Model, passed: int) -> Vector:
    """The parameters of the first effects of the actuation chain."""
    e = model.compiled.effects
    return e.parameters[: [*e.parameter_start, len(e.parameters)][passed]]


def driven(model: Model, heating: Matrix, passed: int) -> Matrix:
    """What leaves the first effects on actuation (rows, columns) where the bundles are given this heating; the last column,
    T_E, is as it was."""
    made = heating.copy()
    package_compiler().function(pass_through)(made, passed, own_scratch(model.compiled), np.zeros(len(model.scales)))
    return made


def pass_through(heating: Matrix, passed: int, p: System, y: Vector) -> None:
    """Put the heating of bundles, of each wire its part, through the first effects of the actuation chain."""
    e = p.effects
    for row in range(heating.shape[0]):
        for i in range(p.wires):
            e.s[i, S_WIRE], e.s[i, S_OTHERS], e.s[i, S_J] = i, p.wires - 1, heating[row, i] / p.wire.n
            for k in range(passed):
                call_effect(e.value[k], k, i, y, e)
                e.s[i, S_J] = e.out[0]
            heating[row, i] = e.s[i, S_J] * p.wire.n


def lines_through(times: Vector, heating: Matrix, first: Integers, lines: Matrix, tilts: Matrix) -> None:
    """Write the line of every stretch of rows; where it would be negative, the steepest of the same mean that is not."""
    for k in range(first.shape[0] - 1):
        length = times[first[k + 1]] - times[first[k]]
        for column in range(heating.shape[1]):
            value, slope = line_through(first[k], first[k + 1] - first[k], column, times, heating)
            mean = value + 0.5 * slope * length
            slope = min(max(slope, -2.0 * mean / length), 2.0 * mean / length)
            lines[k, column], tilts[k, column] = mean - 0.5 * slope * length, slope


def heating_of_wires(values: Matrix, wires: int, antagonistic: bool) -> Matrix:
    """The heating of the bundles, and T_E (k, wires + 1), from the columns of an input."""
    power = power_of_wires(values, wires, antagonistic)
    return np.ascontiguousarray(np.hstack([np.maximum(power, 0.0), values[:, -1:]]))


def power_of_wires(columns: Matrix | Arrays, wires: int, antagonistic: bool) -> NDArray[np.float64]:
    """What the columns of an input (..., columns) mean for each bundle (..., wires): less than nothing heats none."""
    power = columns[..., :-1]
    return np.stack([power, -power], axis=-1).reshape(*power.shape[:-1], wires) if antagonistic else power


def shifts_of_heating(shifts: Arrays, heating: Matrix, antagonistic: bool) -> Arrays:
    """Derivatives of the `heating` of the bundles, and of T_E (k, P, wires + 1), from those of the columns of an input, if
    there are any."""
    power = power_of_wires(shifts, heating.shape[1] - 1, antagonistic)
    return np.concatenate([np.where(heating[: len(shifts), None, :-1] > 0.0, power, 0.0), shifts[..., -1:]], axis=2)


def take_together(times: Vector, heating: Matrix, most: Vector, first: Integers, lines: Matrix, tilts: Matrix) -> int:
    """Write the first row of every stretch, and its line; how many there are."""
    rows = times.shape[0] - 1
    k, count = 0, 0
    while k < rows:
        size = 1
        while 2 * size <= min(rows - k, MAX_ROWS) and is_smooth(k, 2 * size, times, heating, most):
            size *= 2
        first[count] = k
        for column in range(heating.shape[1]):
            lines[count, column], tilts[count, column] = line_through(k, size, column, times, heating)
        k += size
        count += 1
    return count


def line_through(k: int, size: int, column: int, times: Vector, heating: Matrix) -> tuple[float, float]:
    """Value at the beginning and slope of the line with the mean and the first moment of `size` rows from row `k` on."""
    if size == 1:
        return heating[k, column], 0.0
    length = times[k + size] - times[k]
    mean, moment = 0.0, 0.0
    for row in range(k, k + size):
        part = heating[row, column] * (times[row + 1] - times[row])
        mean += part
        moment += part * (0.5 * (times[row] + times[row + 1] - times[k]) - 0.5 * length - 0.5 * times[k])
    mean /= length
    slope = 12.0 * moment / length**3
    return mean - 0.5 * slope * length, slope


def is_smooth(k: int, size: int, times: Vector, heating: Matrix, most: Vector) -> bool:
    """Whether `size` rows from row `k` on are a line to the wires, and one that is not negative."""
    length = times[k + size] - times[k]
    for column in range(heating.shape[1]):
        value, slope = line_through(k, size, column, times, heating)
        if value < 0.0 or value + slope * length < 0.0:
            return False
        passed = 0.0
        for row in range(k, k + size):
            passed += heating[row, column] * (times[row + 1] - times[row])
            t = times[row + 1] - times[k]
            if not abs(passed - (value + 0.5 * slope * t) * t) <= most[column]:
                return False
    return True


def shifts_of_lines(partition: Partition, row_shift: Matrix, value_shift: Arrays) -> tuple[Arrays, Arrays]:
    """Derivatives of the lines in unknowns (k, P, columns), from those of the times (rows, P) and of the heating (rows, P,
    columns; no rows where it stays) of their rows; none where neither changes.

    A row at which the heating rises by d and that comes later by s brings d s less at its time: an impulse. A stretch takes
    those of its rows, that of its beginning too, and what these bring more, as the line with their sum and first moment.
    """
    times, heating, first = partition[:3]
    count, columns = len(first) - 1, heating.shape[1]
    if not (row_shift.any() or len(value_shift)):
        empty = np.zeros((0, row_shift.shape[1], columns))
        return empty, empty
    values, slopes = np.zeros((2, count, row_shift.shape[1], columns))
    rise = np.diff(heating, axis=0, prepend=heating[:1])
    lengths, brought = np.diff(times), [(times, -row_shift[:, :, None] * rise[:, None, :])]
    if len(value_shift):
        brought.append((times[:-1] + 0.5 * lengths, value_shift[:-1] * lengths[:, None, None]))
    for k in range(count):
        rows = slice(first[k], first[k + 1])
        length = times[first[k + 1]] - times[first[k]]
        center = times[first[k]] + 0.5 * length
        for at, amounts in brought:
            slopes[k] += 12.0 * np.tensordot(at[rows] - center, amounts[rows], 1) / length**3
            values[k] += amounts[rows].sum(axis=0) / length
        values[k] -= 0.5 * slopes[k] * length
    return values, slopes


def passed_before(effects: Sequence[ActiveEffect], structure: Structure, wire: WireConstants, largest: float) -> int | None:
    """How many effects at the beginning of the actuation chain a command up to `largest` [W] of one wire has to pass before
    it goes in lines, so that what the wires get is linear in it; None where it cannot, or where something else needs it.

    A threshold or a saturation is not linear: the mean of what it passes on is not what it makes of the mean. What it does
    has to depend on the command alone.
    """
    chain = [effects[k] for k in acting_order([one.effect for one in effects], structure)]
    others = [one.effect for one in chain if one.effect.port != PORT_NAMES[ACTUATION]]
    if any('J' in fields_read(effect.kernel) | fields_read(effect.rate) for effect in others):
        return None
    chain = [one for one in chain if one.effect.port == PORT_NAMES[ACTUATION]]
    bent = [k for k, one in enumerate(chain, start=1) if not is_linear(one, structure, wire, largest)]
    passed = max(bent, default=0)
    return passed if all(is_of_command(one.effect) for one in chain[:passed]) else None


def is_of_command(effect: Effect) -> bool:
    """Whether what an effect on actuation passes on depends on the command, the number of the wire and its own parameters
    alone."""
    return not effect.states and fields_read(effect.kernel) <= {'J', 'wire'} and not fields_read(effect.kernel, WIRE)


def is_linear(active: ActiveEffect, structure: Structure, wire: WireConstants, largest: float) -> bool:
    """Whether an effect on actuation, and the rates of its states, are linear in the command; not where they fail."""
    effect = active.effect
    kind = kernel_types(effect, structure if own_kernels(effect, structure) else None).state
    further = {p.name: p.neutral for p in (*(each.parameter for each in effect.each_bundle), *effect.in_space)}
    fields = parameter_fields(effect)
    parameters = record('Parameters', fields)(*((further | active.by_short_name)[name] for name in fields))
    memory = record('Memory', effect.states)
    for part in PROBED_STATES:
        state = kind(*[part] * len(kind._fields))._replace(T=T_E + TEMPERATURE_SCALE * part, T_E=T_E)
        states = [state._replace(J=J) for J in largest * PROBED]
        kept = (memory(*(part * scale for scale in effect.scale)),) if effect.states else ()
        for kernel in (effect.kernel, effect.rate):
            if kernel is not None and not bend(kernel, states, (wire, parameters, *kept)) <= LINEAR:
                return False
    return True


def bend(kernel: Callable[..., Any], states: Sequence[Any], given: tuple[Any, ...]) -> float:
    """How much a kernel bends over equally spaced states, relative to its values; infinite where it fails."""
    try:
        found = np.array([kernel(state, *given) for state in states], dtype=float)
    except (ArithmeticError, ValueError):
        return np.inf
    return float(np.abs(np.diff(found, n=2, axis=0)).max()) / (float(np.abs(found).max()) or 1.0)
