"""What the model shows at the instants of a recording, and how far that lies from what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isclose, isnan, nan

import numpy as np
from numpy.typing import NDArray

from sma_sim.compiler.fields_read import fields_read
from sma_sim.evidence.data.noise import estimate_noise
from sma_sim.evidence.data.noise_process import NoiseProcess
from sma_sim.evidence.data.recording import GAIN, Dataset, Recording, columns_of_family, is_resistance
from sma_sim.evidence.data.rounding import Rounding
from sma_sim.evidence.estimation.prepared_fit import check_data
from sma_sim.model.argument_checks import as_array, as_difference, check_fields, checked
from sma_sim.model.arrays import Mask, Vector
from sma_sim.model.config import Config
from sma_sim.model.effects.effect import Effect
from sma_sim.model.errors import UserError
from sma_sim.model.expected_units import SLOW_STEP
from sma_sim.model.nearest import suggestion
from sma_sim.model.structures.discovery import known_structures
from sma_sim.model.structures.structure import Structure
from sma_sim.solver.beginning import AT_REST, Beginning
from sma_sim.solver.clock import seen_at
from sma_sim.solver.effect_table import channel_scales, sizes_of_states
from sma_sim.solver.inputs import Input, command_column, inputs_at
from sma_sim.solver.integrate import Run
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import (
    SimulationError,
    Trajectory,
    channels_of_all,
    copy_of_run,
    new_run,
    new_work,
    simulate,
    uninterrupted,
)
from sma_sim.solver.smoothed_input import Leeway, Stretches, smoothed
from sma_sim.solver.work import Work

Plan = tuple[Input, Vector, NDArray[np.int64]]
ZERO_STDS = 4.0  # of its prior, within which a zero of a recording lies: beyond, something else is missing
ZERO_LIMIT = 2e-3  # of strain, by which the zero of a recording may be off: grips settle, gauges are set by hand
WARMTH_STD = 40.0  # [K] of wires that were in use before: transformation takes place that far above a room
USUAL_TIME = 1.0  # [s] of a motion of wires in air
SOFTEST = 1.5e10  # [Pa] of wires: a strain that was set to zero under load lacks no more than stress over this
LATENESS = 0.2  # [s] between commands that take effect soonest and latest, as messages of a busy computer do
MAX_SWITCHES = 24  # with more changes of the command than this, all share one fraction
DIGITS = 3  # of powers that may have been rounded: with more they are known to a thousandth, which no sensor shows
SOLVER_NOISE = 0.3  # error of a sample in units of rtol times the channel's size (docs/explanation/calibration.md)
HIDDEN = 0.02  # of the noise, below which errors of the solver explain nothing that a fit could take for an effect
# Steps of a run in a search, beyond which its parameters are hopeless: in all, by second, by row of the input; and times
# which a model that was chosen, and may ring, gets
MAX_STEPS, STEPS_PER_SECOND, STEPS_PER_ROW = 1_500, 20, 20
CHOSEN_MODEL_FACTOR = 20
# Of smoothed commands: by which temperatures differ at most [K]; the most that a channel may differ by, in units of the
# noise; and the part of the rows below which a run under lines is faster
SMOOTHED_BY, LACKING, FEWER = 0.4, 0.5, 0.25


@dataclass(frozen=True)
class FitData:
    """A recording made ready for many comparisons.

    `measured` and `weight` (channels, k): samples and one over their noise, 0 where a sample is missing.
    `changed` (c,) [s] are the instants of the rows at which a sampled command had changed, `interval` (c,) [s] how
    long before each the change may have happened, `group` (c,) which fraction of the interval it takes; all are
    empty when the commands are exact. `step_limited`: for a search, in which a run of too many steps is given up.
    `initial_state`: the state in which the model is at the first time of the source; at rest without it. `zero_std`,
    `drift_std` (channels,): priors of a zero of this recording and of its drift, 0 where known; empty where all are.
    `ambient_std` [K]: prior of what its ambient temperature differs by, 0 where that is known. `beginning_std`: priors of
    what is left of a motion before it; empty where it begins at rest, or where that is known (`known_beginning`).
    `unpowered_side`: the sign of a command that heats nothing.
    `bench`: on which the wire was, by the name of its structure. `level`: the stress [Pa] of an isobaric test, NaN of
    others. `zero_range`: of an unknown zero of the strain gauge. `starts`: wires of which it is unknown where they begin
    within the hysteresis. `leeway`: how far a command that changes at every moment may be smoothed. `correction`
    (channels, k): what the weighted residuals of a run are more than those of one under the
    smoothed command, at a point nearby; without it runs are made row by row. `floor_shares`: by channel, the part of the
    variance of the noise that is what repeated experiments differ by; empty where that is not known. `rounding`: by channel
    whose rounding noise does not hide. `noise`: by channel whose noise is known to be correlated. `rounded_to`
    (powers,): multiples of what [W] the powers that were commanded, one after the other, were rounded to; empty where they
    are known. `varied`: by parameter that may be another one in this recording, the standard deviation of its logarithm.
    """

    name: str
    channels: tuple[str, ...]
    time: Vector
    measured: NDArray[np.float64]
    weight: NDArray[np.float64]
    source: Input
    changed: Vector
    interval: Vector
    group: NDArray[np.int64]
    step_limited: bool
    zero_std: tuple[float, ...]
    drift_std: tuple[float, ...]
    ambient_std: float
    unpowered_side: int
    bench: str
    level: float
    zero_range: tuple[float, float]
    starts: int
    initial_state: Run | None = None
    leeway: Leeway | None = None
    correction: NDArray[np.float64] | None = None
    floor_shares: tuple[float, ...] = ()
    beginning_std: Beginning = AT_REST
    known_beginning: Beginning = AT_REST
    rounding: Mapping[str, Rounding] = field(default_factory=dict)
    noise: Mapping[str, NoiseProcess] = field(default_factory=dict)
    rounded_to: Vector = field(default_factory=lambda: np.zeros(0))
    varied: Mapping[str, float] = field(default_factory=dict)
    _last_plan: list[tuple[Nuisance, Plan]] = field(init=False, repr=False, compare=False, default_factory=list)

    @property
    def is_quasi_static(self) -> bool:
        """Whether its time says nothing: stress and temperature then say what a wire was before."""
        return not isnan(self.level)

    @property
    def is_in_motion(self) -> bool:
        """Whether it is unknown what is left of a motion before it."""
        return not self.beginning_std.is_at_rest

    @property
    def groups(self) -> int:
        """How many fractions of the sampling interval are unknown."""
        return int(self.group.max()) + 1 if len(self.group) else 0

    @property
    def samples(self) -> int:
        """Measured values that count."""
        return int(np.count_nonzero(self.weight))

    @property
    def structure(self) -> Structure:
        """What its wires pull on."""
        return known_structures()[self.bench]

    @property
    def columns(self) -> Mapping[str, str]:
        """The columns of all channels that it may have, by channel."""
        return columns_of_family(self.structure)

    def on_bench(self, config: Config, nuisance: Nuisance | None = None) -> Config:
        """The configuration on the bench of this recording, as its robot was then."""
        return config.on_bench(self.bench).scaled(dict(nuisance.factors) if nuisance else {})


@dataclass(frozen=True)
class Nuisance:
    """Unknowns of one recording, other than parameters.

    Attributes
    ----------
    delay : float
        A sample shows the state at t - delay [s].
    start : tuple of float
        By wire, where the run begins within the hysteresis: 0 on sigma_A, 1 on sigma_M. Empty: as the configuration's
        ``initial.x_M_*`` say.
    switches : tuple of float
        By (group of) sampled change of the command: the part of its sampling interval by which it preceded its row.
    unknown_zero : bool
        Whether the zero of the strain gauge is unknown: it is then where the residuals are least, within `zero_range`.
    ambient : float
        By how much the ambient temperature was above that of the source [K].
    beginning : Beginning
        What is left at its start of a motion before it; by default the run begins at rest.
    powers : tuple of float
        Of the powers that were commanded, one after the other, by how much each was more than is written [W].
    factors : tuple of (str, float)
        Parameters that were other ones in this recording, the power of its driver (``'power'``) among them, and how many
        times as large they were.
    """

    delay: float = 0.0
    start: tuple[float, ...] = ()
    switches: tuple[float, ...] = ()
    unknown_zero: bool = False
    ambient: float = 0.0
    beginning: Beginning = AT_REST
    powers: tuple[float, ...] = ()
    factors: tuple[tuple[str, float], ...] = ()


def hidden_rtol(dataset: Dataset) -> float:
    """The relative tolerance up to which errors of the solver stay hidden in the noise of every channel."""
    found = [inf]
    for structure in {recording.structure for recording in dataset.recordings}:
        sizes = dict(zip(structure.channels, channel_scales(structure), strict=True))
        found += [
            HIDDEN * noise / (SOLVER_NOISE * sizes[name]) for name, noise in dataset.noise_std.items() if name in sizes
        ]
    return min(found)


def fit_data(
    recording: Recording, noise_std: Mapping[str, float], every: int = 1, floor: float = 0.0, step_limited: bool = False
) -> FitData:
    """A recording with its weights, every `every`-th sample of a channel. `floor`: the solver's relative error, solver.rtol.

    Raises UserError when no channel was measured, or when the noise of one is not known.
    """
    channels = tuple(name for name, values in recording.channels.items() if np.isfinite(values).any())
    if not channels:
        raise UserError(f'{recording.name}: no channel was measured; expected one of {", ".join(recording.columns)}')
    for name in channels:
        if not (np.isfinite(noise_std.get(name, np.nan)) and noise_std[name] >= 0.0):
            raise UserError(f'{recording.name}: no noise is known for channel {name}; give it as noise_std of the Dataset')
    structure = recording.structure
    sizes = dict(zip(structure.channels, channel_scales(structure), strict=True))
    rows = thinned_rows([np.isfinite(recording.channels[name]) for name in channels], every)
    measured = np.array([recording.channels[name][rows] for name in channels], dtype=float)
    noise = [
        np.maximum(
            np.hypot(sample_noise(recording, name, noise_std)[rows], SOLVER_NOISE * floor * sizes.get(name, 0.0)), 1e-12
        )
        for name in channels
    ]
    present = np.isfinite(measured)
    level = float(np.median(np.asarray(recording.source.values)[:, 0])) if structure.is_quasi_static else nan
    source, changed, interval = without_repeats(simplified_input(recording, noise_std)), *sampled_changes(recording)
    if recording.late_commands:
        source, changed, interval = with_late_changes(source, changed, interval)
    single = len(changed) > MAX_SWITCHES
    return FitData(
        name=recording.name,
        channels=channels,
        time=np.asarray(recording.time, float)[rows],
        measured=np.where(present, measured, 0.0),
        weight=without_copies(present / np.array(noise)),
        source=source,
        changed=changed,
        interval=interval,
        group=np.zeros(len(changed), dtype=np.int64) if single else np.arange(len(changed)),
        step_limited=step_limited,
        zero_std=stds_of(recording.zero_std, recording.drift_std, channels),
        drift_std=stds_of(recording.drift_std, recording.zero_std, channels),
        ambient_std=recording.ambient_std,
        unpowered_side=recording.unpowered_side,
        bench=recording.system,
        level=level,
        zero_range=zero_range(recording, level),
        starts=0 if structure.is_quasi_static else structure.wires,
        beginning_std=beginning_stds(structure) if recording.in_motion else AT_REST,
        rounding=recording.rounding,
        rounded_to=steps_of_powers(source) if recording.rounded_commands else np.zeros(0),
        varied={name: std for name, std in recording.varied.items() if std > 0.0},
    )


def without_copies(weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same weights (channels, k), in no more memory than one of each channel where those of all samples are alike."""
    first = weight[:, :1]
    return np.broadcast_to(first.copy(), weight.shape) if (weight == first).all() else weight


def beginning_stds(structure: Structure) -> Beginning:
    """Priors of what is left of a motion before a recording: wires as warm as in use; a pose as far from its equilibrium as
    it usually goes, and as fast as wires move it. Empty for tests without time."""
    if structure.is_quasi_static:
        return AT_REST
    sizes = channel_scales(structure)[: len(structure.coordinates)]
    warmth = (WARMTH_STD,) * (structure.wires if structure.imposed_temperature < 0 else 0)
    return Beginning(warmth, tuple(sizes), tuple(size / USUAL_TIME for size in sizes))


def with_states(run: FitData, config: Config) -> Beginning:
    """The priors of what is left of a motion before a run, with those of the extra states of a model's effects: as far from
    their first values as their sizes, which is what they usually change by; one of copies that wires share. What follows
    from the time alone is as it is then."""
    on_bench = run.on_bench(config)
    effects = {active.effect.name: active.effect for active in on_bench.effects}
    every = sizes_of_states(on_bench.effects, on_bench.structure)
    sizes = {name: own for name, own in every.items() if not is_of_time(effects[name])}
    shared = [len(effects[name].states) if effects[name].scope.shared else len(own) for name, own in sizes.items()]
    states = tuple((name, own[:count]) for (name, own), count in zip(sizes.items(), shared, strict=True))
    return replace(run.beginning_std, states=states)


def is_of_time(effect: Effect) -> bool:
    """Whether the states of an effect follow from the time alone, as those of an input that is sought do."""
    read = fields_read(effect.rate)
    return 't' in read and read <= {'t', 'wire'}


def thinned_rows(known: Sequence[NDArray[np.bool_]], every: int) -> NDArray[np.bool_]:
    """Every `every`-th row (k,), and of a channel of lower rate, of which these hold less than half its share, every
    `every`-th row where it is `known`."""
    rows: NDArray[np.bool_] = np.arange(len(known[0])) % every == 0
    for here in known:
        if 2 * every * np.count_nonzero(here & rows) < np.count_nonzero(here):
            rows[np.flatnonzero(here)[::every]] = True
    return rows


def sample_noise(recording: Recording, channel: str, noise_std: Mapping[str, float]) -> Vector:
    """The standard deviation (k,) of each sample of a channel (SI)."""
    own = np.broadcast_to(recording.sample_std.get(channel, np.nan), np.shape(recording.time))
    return np.where(np.isnan(own), noise_std[channel], own)


def zero_range(recording: Recording, level: float) -> tuple[float, float]:
    """Between which values a zero of the strain gauge lies, under a stress `level` [Pa] (NaN: none that is imposed).

    A strain that is exactly 0 in a test under load was set to zero there: what the wire was strained by is in its zero too.
    """
    shown = recording.channels.get('strain')
    if level != level or shown is None or not np.any(shown == 0.0):
        return -ZERO_LIMIT, ZERO_LIMIT
    reach = ZERO_LIMIT + abs(level) / SOFTEST
    return -reach, reach


def stds_of(stds: Mapping[str, float], others: Mapping[str, float], channels: Sequence[str]) -> tuple[float, ...]:
    """Priors of the offsets of channels; none where nothing is unknown, of another kind either."""
    return tuple(stds.get(name, 0.0) for name in channels) if stds or others else ()


def without_repeats(source: Input) -> Input:
    """The same input without rows that change nothing."""
    values = np.asarray(source.values, float)
    keep = np.ones(len(values), dtype=bool)
    if not any(source.linear):
        keep[1:-1] = (np.diff(values[:-1], axis=0) != 0.0).any(axis=1)
    return Input(np.asarray(source.times, float)[keep], values[keep], source.linear, source.names)


def sampled_changes(recording: Recording) -> tuple[Vector, Vector]:
    """Instants [s] of the rows at which a sampled command had changed, and the time since the row before."""
    times = np.asarray(recording.source.times, float)
    command = np.asarray(recording.source.values, float)[:, command_column(recording.source)]
    at = np.flatnonzero(np.diff(command)) + 1
    if recording.exact_commands:
        at = at[:0]
    at = at[~np.isin(times[at], recording.known_changes)]
    return times[at], times[at] - times[at - 1]


def with_late_changes(source: Input, changed: Vector, interval: Vector) -> tuple[Input, Vector, Vector]:
    """The input, all instants [s] at which its command changes, the first one from rest, and how long before each that may
    take effect, beside a delay of all of them; no less than the intervals of those that were sampled."""
    first = np.array(source.values[:1], float)
    if first[0, command_column(source)] != 0.0:
        first[0, command_column(source)] = 0.0
        times, values = np.append(source.times[0] - LATENESS, source.times), np.concatenate([first, source.values])
        source = Input(times, values, source.linear, source.names)
    rows = np.flatnonzero(np.diff(np.asarray(source.values, float)[:, command_column(source)])) + 1
    times = np.asarray(source.times, float)[rows]
    found = np.full(len(times), LATENESS)
    for at, span in zip(changed, interval, strict=True):
        found[times == at] = max(LATENESS, span)
    return source, times, np.minimum(found, np.diff(times, prepend=source.times[0]))


def steps_of_powers(source: Input) -> Vector:
    """To multiples of what [W] the powers of an input, one after the other, may have been rounded, (powers,); none where
    they are written with more digits than rounding would leave to be seen, or where they are too many to be estimated.

    All may have as many decimals as the one with most, or as many digits: what is coarser of these rounded it.
    """
    command = np.asarray(source.values, float)[:, command_column(source)]
    written = command[powered_rows(command)]
    if not 0 < len(written) <= MAX_SWITCHES:
        return np.zeros(0)
    decimals = np.array([next(n for n in range(-9, 330) if isclose(x, round(x, n))) for x in written.tolist()], dtype=float)
    before_point = np.floor(np.log10(np.abs(written))) + 1.0
    digits = (before_point + decimals).max()
    if digits > DIGITS:
        return np.zeros(0)
    steps: Vector = np.maximum(10.0 ** -decimals.max(), 10.0 ** (before_point - digits))
    return steps


def powered_rows(command: Vector) -> Mask:
    """Which rows of a command (k,) begin another power than none."""
    begins: Mask = np.append(True, np.diff(command) != 0.0) & (command != 0.0)
    return begins


def with_switches(run: FitData, switches: Sequence[float]) -> Input:
    """The input with each sampled change of the command moved to `switches` of its interval before its row."""
    source = run.source
    if not len(run.changed) or not len(switches):
        return source
    times, command = source.times, source.values[:, command_column(source)]
    rows = np.flatnonzero(np.diff(command)) + 1
    moved = times[rows].copy()
    known = np.isin(run.changed, moved)  # a command in another unit may round two levels to one
    moved[np.isin(moved, run.changed)] -= (run.interval * np.asarray(switches, float)[run.group])[known]
    level = np.concatenate([command[:1], command[rows]])
    times = np.union1d(times, moved)
    held = np.searchsorted(source.times, times, side='right') - 1
    values = source.values[held].copy()
    for k in np.flatnonzero(source.linear):
        values[:, k] = np.interp(times, source.times, source.values[:, k])
    values[:, command_column(source)] = level[np.searchsorted(moved, times, side='right')]
    return without_repeats(Input(times, values, source.linear, source.names))


def with_powers(source: Input, powers: Sequence[float]) -> Input:
    """The input with its powers, one after the other, by so much more than is written [W]."""
    if not len(powers):
        return source
    values, column = source.values.copy(), command_column(source)
    command = values[:, column].copy()
    values[:, column] += np.where(command != 0.0, np.append(powers, 0.0)[np.cumsum(powered_rows(command)) - 1], 0.0)
    return Input(source.times, values, source.linear, source.names)


def effective_input(source: Input, unpowered_side: int, ambient: float, gain: float = 1.0) -> Input:
    """The input with the power of the wires that were heated, `gain` times what is written, and `ambient` [K] above its
    ambient temperature."""
    if not unpowered_side and not ambient and gain == 1.0:
        return source
    values, command = source.values.copy(), command_column(source)
    values[:, command] *= gain
    values[:, command] = np.where(np.sign(values[:, command]) == unpowered_side, 0.0, values[:, command])
    values[:, -1] += ambient
    return Input(source.times, values, source.linear, source.names)


def held_until(source: Input, last: float) -> Input:
    """The input, its last values held up to `last` [s]."""
    if last <= source.times[-1]:
        return source
    return Input(np.append(source.times, last), np.vstack([source.values, source.values[-1:]]), source.linear, source.names)


def step_limit(source: Input, step_limited: bool, rows: int = 0, samples: float = inf) -> int:
    """Of the solver in one run, six times what is usual or more: else few hopeless points take most of a search's time.

    `rows`: of the source, if not as it is; `samples`: how many are compared. Seconds count as far as somebody looked: what
    rings between samples that are slower than a wire is not seen.
    """
    rows, seconds = rows or len(source.times), min(source.times[-1] - source.times[0], SLOW_STEP * samples)
    most = MAX_STEPS + int(STEPS_PER_SECOND * seconds) + STEPS_PER_ROW * rows
    return most if step_limited else CHOSEN_MODEL_FACTOR * most


@checked
def predict(config: Config, recording: Recording | FitData, nuisance: Nuisance | None = None) -> dict[str, Vector]:
    """What the model shows at the sample times of a recording.

    Parameters
    ----------
    config : Config
        The model.
    recording : Recording
        Its input and sample times are used, its channels are not.
    nuisance : Nuisance, optional
        Delay, initial states and switching instants of the recording.

    Returns
    -------
    dict
        Arrays (k,) by channel, SI units: all channels of the system.

    Raises
    ------
    SimulationError
        If the run cannot be simulated to its end.

    Examples
    --------
    >>> import sma_sim
    >>> command = sma_sim.module_input([0.0, 2.0, 8.0, 15.0], [0.0, 10.0, 0.0, 0.0])
    >>> run = sma_sim.simulate(sma_sim.Model(), command, 4.0)
    >>> recording = sma_sim.Recording('run1', 'module', run.time, {'alpha': run['alpha_rad']}, command)
    >>> dataset = sma_sim.Dataset((recording,), {'alpha': 3.5e-4})
    >>> shown = sma_sim.predict(sma_sim.Config(), recording)
    >>> sorted(shown)
    ['F_1', 'F_2', 'R_1', 'R_2', 'T_1', 'T_2', 'U_x', 'U_y', 'alpha']
    """
    if isinstance(recording, Recording):
        check_data(Dataset((recording,)), config)
    run = prepared(recording)
    if nuisance is not None:
        check_nuisance(nuisance, run, run.on_bench(config))
    structure = run.on_bench(config).structure
    _, trajectory, index = simulated(config, run, nuisance, structure.channels)
    columns = zip(structure.channels, structure.channel_columns, strict=True)
    return {name: trajectory[column][index] for name, column in columns}


def check_nuisance(nuisance: Nuisance, run: FitData, config: Config) -> None:
    """Raise UserError for what is not known so of a recording, with a model on its bench."""
    check_fields(nuisance)
    check_fields(nuisance.beginning)
    check_delay(nuisance.delay, run.time, run.name)
    check_numbers('switches', nuisance.switches, run.groups, 'part(s) of a sampling interval')
    check_numbers('start', nuisance.start, run.starts, 'number(s) from 0 to 1, one by wire', 0.0, 1.0)
    as_difference('nuisance, ambient', nuisance.ambient)
    command = np.asarray(run.source.values, float)[:, command_column(run.source)]
    powered = int(np.count_nonzero(powered_rows(command)))
    check_numbers('powers', nuisance.powers, powered, 'difference(s) [W], one by power that was commanded')
    for name, factor in nuisance.factors:
        known = (GAIN, *config.parameters)
        if name not in known:
            raise UserError(f'nuisance, factors: no parameter {name!r}{suggestion(name, known)}')
        if not 0.0 < factor < inf:
            raise UserError(f'nuisance, factors: {factor!r} for {name}; expected a number above 0')
    beginning, structure = nuisance.beginning, config.structure
    wires, coordinates = run.starts if structure.imposed_temperature < 0 else 0, len(structure.coordinates)
    check_numbers('warmth', beginning.warmth, wires, 'difference(s) from the ambient [K], one by wire')
    check_numbers('pose', beginning.pose, coordinates, 'difference(s) (SI), one by coordinate')
    check_numbers('rates', beginning.rates, coordinates, 'rate(s) (SI), one by coordinate')
    sizes = sizes_of_states(config.effects, structure)
    for name, values in beginning.states:
        if name not in sizes:
            raise UserError(f'nuisance, states: no active effect {name!r} that has any{suggestion(name, sizes)}')
        every = len(sizes[name])
        is_single = len(values) and every % len(values) == 0  # a copy of what wires share
        check_numbers(f'states of {name}', values, len(values) if is_single else every, 'difference(s) from first values')


def check_numbers(name: str, given: Sequence[float], count: int, words: str, low: float = -inf, high: float = inf) -> None:
    """Raise UserError for numbers of a nuisance, if there are any, that are not `count`, or not from `low` to `high`."""
    values = as_array(f'nuisance, {name}', given)
    is_known = values.shape == (count,) and np.isfinite(values).all()
    if len(values) and not (is_known and ((low <= values) & (values <= high)).all()):
        raise UserError(f'nuisance, {name} = {given}: expected {count} {words}')


def check_delay(delay: float, time: Vector, name: str) -> None:
    """Raise UserError for a delay [s] that is none of a recording with these times (k,) [s]."""
    length = float(time[-1] - time[0])
    if not abs(delay) < length:
        raise UserError(f'delay = {delay:g}: expected seconds, less than the {length:g} s of {name}')


def prepared(recording: Recording | FitData) -> FitData:
    """A recording made ready, whatever its noise."""
    return recording if isinstance(recording, FitData) else fit_data(recording, dict.fromkeys(recording.channels, 1.0))


def model_columns(config: Config, recording: Recording | FitData, nuisance: Nuisance | None = None) -> dict[str, Vector]:
    """The model's columns (file contract, inputs included) at the recording's sample times, (k,) each.

    Before the run began (by the delay) it is its first sample. Raises SimulationError when a run cannot be made.
    """
    source, trajectory, index = simulated(config, recording, nuisance)
    shown = inputs_at(source, trajectory.time) | trajectory.columns
    resistances = (recording.columns[name] for name in recording.channels if is_resistance(name))
    shown |= {column: trajectory[column] for column in resistances}
    columns = {name: column[index] for name, column in shown.items()}
    if nuisance and nuisance.unknown_zero and isinstance(recording, FitData):
        columns['strain'] = columns['strain'] + strain_zero(recording, columns['strain'])
    if isinstance(recording, FitData) and recording.zero_std:
        names = [recording.columns[name] for name in recording.channels]
        rows = np.array([columns[name] for name in names])
        columns |= dict(zip(names, rows + baseline(recording, rows), strict=True))
    for name, rounding in recording.rounding.items():
        column = recording.columns[name]
        columns[column] = rounding.expected(columns[column])
    return columns


def simulated(
    config: Config, recording: Recording | FitData, nuisance: Nuisance | None = None, channels: Sequence[str] | None = None
) -> tuple[Input, Trajectory, NDArray[np.int64]]:
    """The input, its run, all columns or some channels, and the row of it that each sample of the recording (k,) shows.

    Raises SimulationError when a run cannot be made.
    """
    nuisance = nuisance or Nuisance()
    run = prepared(recording)
    config = run.on_bench(config, nuisance)
    source, asked, index = planned_run(run, nuisance)
    source, model = held_until(source, float(asked[-1])), Model(config)
    initial_state = run.initial_state or start_of(model, source, nuisance)
    limit = step_limit(source, run.step_limited, samples=len(run.time))
    trajectory = simulate(model, source, asked, max_steps=limit, initial_state=initial_state, channels=channels)
    if not uninterrupted(trajectory).completed:
        raise SimulationError(f'{run.name}: the run ended after {trajectory.end:g} s: {trajectory.reason}')
    return source, trajectory, index


def planned_run(run: FitData, nuisance: Nuisance) -> Plan:
    """The input of a run, the times [s] to sample, and the sample that each of the recording (k,) shows.

    Times may be later than the input, whose last values are then held. The last plan is kept: many models are run by it.
    """
    for known, plan in run._last_plan:
        if known == nuisance:
            return plan
    times = run.time - nuisance.delay
    commanded = with_powers(with_switches(run, nuisance.switches), nuisance.powers)
    source = effective_input(commanded, run.unpowered_side, nuisance.ambient, dict(nuisance.factors).get(GAIN, 1.0))
    early = int(np.searchsorted(times, source.times[0], side='right'))
    asked = np.concatenate([source.times[:1], times[early:]])
    plan = source, asked, np.maximum(np.arange(len(times)) - early + 1, 0)
    run._last_plan[:] = [(nuisance, plan)]
    return plan


def weighted_residuals(config: Config | Model, run: FitData, nuisance: Nuisance | None = None) -> NDArray[np.float64]:
    """(model - measured)/noise, (channels, k), 0 where a sample is missing; a model is on the bench of the run already,
    as its robot was then.

    Raises SimulationError.
    """
    model = config if isinstance(config, Model) else Model(run.on_bench(config, nuisance))
    return residuals_of_all([model], run, nuisance or Nuisance())[0]


def residuals_of_all(models: Sequence[Model], run: FitData, nuisance: Nuisance) -> list[NDArray[np.float64]]:
    """As `weighted_residuals`, of models that differ in effects which only show (`solver.simulate.channels_of_all`)."""
    absent = [name for name in run.channels if name not in models[0].structure.channels]
    if absent:
        raise UserError(f'{run.name}: the model of system {models[0].config.system!r} has no channel {absent[0]}')
    lines = None if run.correction is None else smoothed_command(models[0], run, nuisance)
    found = [compared(run, shown, nuisance) for shown in shown_by_all(models, run, nuisance, lines)]
    return found if lines is None or run.correction is None else [one + run.correction for one in found]


def smoothed_residuals(model: Model, run: FitData, nuisance: Nuisance) -> NDArray[np.float64] | None:
    """As `weighted_residuals` under the smoothed command, (channels, k); None where it cannot be smoothed."""
    lines = smoothed_command(model, run, nuisance)
    return None if lines is None else compared(run, shown_by_all([model], run, nuisance, lines)[0], nuisance)


def smoothed_command(model: Model, run: FitData, nuisance: Nuisance) -> Stretches | None:
    """The command of a run smoothed within its leeway; None where that cannot be."""
    source, asked, _ = planned_run(run, nuisance)
    seen = seen_at(model, asked[-1:], float(source.times[0]))
    return None if run.leeway is None else smoothed(model, source, float(seen[-1]), run.leeway)


def leeway_for(config: Config, run: FitData) -> Leeway | None:
    """How far the command of a run may be smoothed: so that the run differs by little of the noise, and takes far less time.

    None for commands of few rows, and where that is not possible.
    """
    model = Model(run.on_bench(config))
    widest = Leeway.of(model.wire, SMOOTHED_BY)
    smooth = replace(run, leeway=widest)
    try:
        shown = smoothed_residuals(model, smooth, Nuisance())
        if shown is None:
            return None
        lacking = error_over_noise(weighted_residuals(model, run) - shown, run)
    except SimulationError:
        return None
    part = min(1.0, LACKING / max(*lacking.values(), LACKING))
    leeway = Leeway(part * widest.heat, part * widest.ambient)
    lines = smoothed(model, run.source, run.source.times[-1], leeway)
    return leeway if lines is not None and len(lines.times) < FEWER * len(run.source.times) else None


def shown_by_all(
    models: Sequence[Model], run: FitData, nuisance: Nuisance, lines: Stretches | None
) -> list[NDArray[np.float64]]:
    """What the channels of a run show under models on its bench, (channels, k) each, under `lines` in place of its command,
    if any. Raises SimulationError."""
    model, (source, asked, index) = models[0], planned_run(run, nuisance)
    work = new_work(model)
    first = np.asarray(source.values[0], float)
    begin = (
        copy_of_run(model, run.initial_state)
        if run.initial_state
        else new_run(model, first, work, nuisance.start, nuisance.beginning)
    )
    try:
        limit = step_limit(source, run.step_limited, 0 if lines is None else len(lines.times), len(run.time))
        samples = channels_of_all(models, source, asked, run.channels, limit, begin, work, lines)
    except SimulationError as error:
        raise SimulationError(f'{run.name}: {error}') from error
    return [np.ascontiguousarray(one[index].T) for one in samples]


def compared(run: FitData, shown: NDArray[np.float64], nuisance: Nuisance | None) -> NDArray[np.float64]:
    """(model - measured)/noise of what a model shows, (channels, k), with the zeros of the recording, as it is read."""
    return (as_read(run, as_shown(run, shown, nuisance)) - run.measured) * run.weight


def as_shown(run: FitData, shown: NDArray[np.float64], nuisance: Nuisance | None) -> NDArray[np.float64]:
    """What a model shows, (channels, k), with the zeros of the recording."""
    if nuisance and nuisance.unknown_zero and 'strain' in run.channels:
        k = run.channels.index('strain')
        shown = shown.copy()
        shown[k] += strain_zero(run, shown[k])
    if run.zero_std:
        shown = shown + baseline(run, shown)
    return shown


def as_read(run: FitData, shown: NDArray[np.float64]) -> NDArray[np.float64]:
    """The mean reading of what is shown, (channels, k), where it is rounded."""
    rounded = [(k, run.rounding[name]) for k, name in enumerate(run.channels) if name in run.rounding]
    shown = shown.copy() if rounded else shown
    for k, rounding in rounded:
        shown[k] = rounding.expected(shown[k])
    return shown


def slopes_of_readings(run: FitData, shown: NDArray[np.float64]) -> NDArray[np.float64]:
    """By how much mean readings, (channels, k), change with what is shown."""
    slopes = np.ones_like(shown)
    for k, name in enumerate(run.channels):
        if name in run.rounding:
            slopes[k] = run.rounding[name].slope(shown[k])
    return slopes


def zero_of(config: Config, run: FitData, nuisance: Nuisance) -> float:
    """What the strain gauge of a run shows too much beside the model [-]. Raises SimulationError."""
    _, trajectory, index = simulated(config, run, nuisance, ('strain',))
    return strain_zero(run, trajectory['strain'][index])


def strain_zero(run: FitData, shown: Vector) -> float:
    """What the strain gauge of a recording shows too much, when the model's is `shown` (k,): the weighted mean of the
    difference.

    0 where the zero has a prior of its own (`baseline`): one thing is estimated once.
    """
    k = run.channels.index('strain') if 'strain' in run.channels else -1
    if k < 0 or (run.zero_std and run.zero_std[k] > 0.0):
        return 0.0
    known = run.weight[k] > 0.0
    mean = np.average(run.measured[k][known] - shown[known], weights=run.weight[k][known] ** 2)
    return float(np.clip(mean, *run.zero_range))


def offsets(run: FitData, shown: NDArray[np.float64]) -> NDArray[np.float64]:
    """What each channel of a recording shows too much beside the model's `shown` (channels, k): its zero, and by how much
    that drifts from the first to the last sample. The least-squares values (channels, 2) under their priors, within
    ZERO_STDS of them; 0 where nothing is unknown."""
    prior = np.column_stack([run.zero_std, run.drift_std])
    basis = prior[:, :, None] * np.array([np.ones_like(run.time), elapsed(run)])  # (channels, 2, k)
    weighted = run.weight[:, None, :] * basis
    normal = weighted @ weighted.transpose(0, 2, 1) + np.eye(2)
    pull = weighted @ (run.weight * (run.measured - shown))[:, :, None]
    stds: NDArray[np.float64] = np.clip(np.linalg.solve(normal, pull)[:, :, 0], -ZERO_STDS, ZERO_STDS)
    return prior * stds


def elapsed(run: FitData) -> Vector:
    """The part of a recording that has passed at its samples (k,), about its middle: -1/2 to 1/2."""
    first, last = run.time[0], run.time[-1]
    part: Vector = (run.time - first) / (last - first) - 0.5
    return part


def baseline(run: FitData, shown: NDArray[np.float64]) -> NDArray[np.float64]:
    """What the channels show too much at each sample (channels, k)."""
    found = offsets(run, shown)
    return found[:, :1] + found[:, 1:] * elapsed(run)


def offsets_of(config: Config, run: FitData, nuisance: Nuisance) -> tuple[dict[str, float], dict[str, float]]:
    """The zeros and the drifts of a run by channel (SI), of those that are not known. Raises SimulationError."""
    if not run.zero_std:
        return {}, {}
    _, trajectory, index = simulated(config, run, nuisance, run.channels)
    zero, drift = offsets(run, np.array([trajectory[run.columns[name]][index] for name in run.channels])).T
    return (
        {name: float(z) for name, z, std in zip(run.channels, zero, run.zero_std, strict=True) if std > 0.0},
        {name: float(z) for name, z, std in zip(run.channels, drift, run.drift_std, strict=True) if std > 0.0},
    )


def error_over_noise(residuals: NDArray[np.float64], run: FitData) -> dict[str, float]:
    """Normalized RMSE by channel, from weighted residuals (channels, k)."""
    counts = np.count_nonzero(run.weight, axis=1)
    return {
        name: float(np.sqrt(np.sum(row**2) / count))
        for name, row, count in zip(run.channels, residuals, counts, strict=True)
        if count
    }


# Where runs begin within the hysteresis.
def with_start(config: Config, source: Input, start: Sequence[float]) -> Config:
    """The configuration with the x_M of a start given as parts of the hysteresis."""
    run = start_of(Model(config), source, Nuisance(start=tuple(start)))
    if run is None:
        return config
    initial = {f'initial.x_M_{i + 1}': float(x) for i, x in enumerate(run.state.x_frozen)}
    return config.variant(initial)


def start_of(model: Model, source: Input, nuisance: Nuisance, work: Work | None = None) -> Run | None:
    """Where a run begins that has a start as parts of the hysteresis, or a motion before it; None as the configuration says.

    `work`: scratch memory of a model with the same states.
    """
    if not len(nuisance.start) and nuisance.beginning.is_at_rest:
        return None
    first = np.asarray(source.values[0], float)
    return new_run(model, first, work or new_work(model), nuisance.start, nuisance.beginning)


# What is imposed and was measured, as an input: fewer straight stretches, where rows between say no more than noise.
#
# The solver must stop at every kink of its input. A gauge's noise makes one at each row, and steps by the thousand that no
# measured stress can tell from a straight line.
MAX_STIFFNESS = 6e10  # [Pa] as stiff as a wire is along a strain: what a change of strain does to the stress, at the most
JITTER_WIDTH = 4.0  # of the jitter, in its standard deviations
WIDEST = {'stress': 1e5, 'T': 0.1}  # [Pa], [K]: what neither moves a strain by 1e-5 nor a transformation by much
ROUNDING = 1e-12  # of the largest value: lines of exact numbers have no corners
STRESS_WIDTH = 2.0  # of the stress, in standard deviations of its noise


def simplified_input(recording: Recording, noise_std: Mapping[str, float]) -> Input:
    """The recording's input without rows at which what is imposed is within its jitter of a straight line.

    Of a strain also within the stress's noise. Rows at which heating or the ambient temperature changes stay. `noise_std`
    [SI] by channel; an input of which nothing is imposed stays as it is.
    """
    source = recording.source
    drives = recording.structure.drives
    times, values = np.asarray(source.times, float), np.asarray(source.values, float)
    others = values[:, len(drives) :]
    keep = np.zeros(len(times), dtype=bool)
    for k, drive in enumerate(drives):
        jitter = estimate_noise(times, values[:, k])
        if jitter is None:
            return source
        widest = WIDEST.get(drive.name, STRESS_WIDTH * noise_std.get('stress', np.inf) / MAX_STIFFNESS)
        rounding = ROUNDING * float(np.abs(values[:, k]).max())
        keep |= corners(times, values[:, k], max(rounding, min(JITTER_WIDTH * jitter.std, widest)))
    if not drives:
        return source
    keep[1:] |= (np.diff(others, axis=0) != 0.0).any(axis=1)
    return Input(times[keep], values[keep], source.linear, source.names)


def corners(times: Vector, values: Vector, width: float) -> NDArray[np.bool_]:
    """Which of the points (k,) a polyline needs that passes all others within `width` (Douglas and Peucker 1973)."""
    keep = np.zeros(len(times), dtype=bool)
    keep[[0, -1]] = True
    stretches = [(0, len(times) - 1)]
    while stretches:
        first, last = stretches.pop()
        slope = (values[last] - values[first]) / (times[last] - times[first])
        inside = slice(first + 1, last)
        apart = np.abs(values[inside] - values[first] - slope * (times[inside] - times[first]))
        if not len(apart) or apart.max() <= width:
            continue
        corner = first + 1 + int(apart.argmax())
        keep[corner] = True
        stretches += [(first, corner), (corner, last)]
    return keep
