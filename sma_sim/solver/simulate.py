"""From parameters and an input to a trajectory: the Python interface of the simulator."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.compiler.compile import package_compiler
from sma_sim.compiler.fields_read import uses_time
from sma_sim.model.argument_checks import checked
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.automaton import EDGES, GUARD_NAMES
from sma_sim.model.config import Config
from sma_sim.model.errors import PhysicsWarning, UserError
from sma_sim.model.layout import (
    O_EPS,
    O_LENGTH,
    Evaluation,
    InputPoint,
    SystemState,
)
from sma_sim.model.program_parameters import DEFAULTS
from sma_sim.model.progress import progress_line
from sma_sim.model.structures.structure import Structure
from sma_sim.solver.beginning import AT_REST, Beginning
from sma_sim.solver.clock import held_until, seen_at
from sma_sim.solver.columns import are_channels, named_columns, new_samples, sampled_numbers, state_numbers
from sma_sim.solver.effect_table import own_scratch, sizes_of_states
from sma_sim.solver.end_of_run import (
    compression_note,
    limit_notes,
    melting_note,
    notes_on_commands,
    notes_on_start,
    rising_stress_note,
    stop_reason,
    warn_of_idle_effects,
)
from sma_sim.solver.equilibrium import start, take_fractions
from sma_sim.solver.inputs import Input, check_columns, inputs_at, requested_times, segments
from sma_sim.solver.integrate import (
    C_H,
    C_KEPT_UNTIL,
    C_LAST_JUMP,
    C_TIME,
    C_WINDOW,
    C_WIRES,
    COMPLETED,
    N_CHATTER,
    N_JUMPS,
    N_REJECTED,
    N_SIZE,
    N_STEPS,
    PER_WIRE_CONTROLS,
    REASONS,
    InputStretches,
    Limits,
    Log,
    Run,
    integrate,
    sample_again,
)
from sma_sim.solver.model import Model, new_findings
from sma_sim.solver.series import elimination_of
from sma_sim.solver.smoothed_input import Stretches, system_under, under_lines
from sma_sim.solver.stepper import ORDER
from sma_sim.solver.trajectory import Jump as Jump
from sma_sim.solver.trajectory import Trajectory as Trajectory
from sma_sim.solver.work import Work


class SimulationError(UserError):
    """A run that cannot be started, with the reason in words."""


NAMED_EDGES = tuple((GUARD_NAMES[guard], source, target) for source, target, guard in EDGES)  # as a jump has them
STOPPED = 'Ctrl-C'
SENSIBLE_STRAINS = (-0.05, 0.3)  # of the wires at the start
STALL_STEP = 1e-6  # [s] at the default tolerance; usual runs take 1e-1, and 1e-5 for a few ms after a command changes
MOST_STEPS = 10**18  # that integers of compiled code hold
SAME_TIME = 1e-6  # [s] that clocks tell
MAX_JUMPS = 100_000  # the log of jumps holds no more
PIECES_AT_ONCE = 2000  # stretches of input between two looks at Ctrl-C
DIFFERENCE = 1e-7  # difference steps relative to the scales
# Of a MAS wire on a test bench, whose stress follows its strain stiffly: a step of 1e-7 changes it by some 50 Pa, and rates,
# exponentials of it, by so much that their slope is wrong by 1e-4. Long steps of a stiff solver take slopes for exact.
STEEP_DIFFERENCE = 1e-8


def new_work(model: Model) -> Work:
    """Scratch memory for the runs of a model."""
    p, scales = model.compiled, model.scales
    n, is_steep = len(scales), p.mas and p.drives > 0
    return Work(
        jacobian=np.zeros((n, n)),
        matrix=np.zeros((n, n)),
        pivot=np.zeros(n, dtype=np.int64),
        elimination=elimination_of(p, model.structure, n),
        **{name: Evaluation(np.zeros(n), new_findings(p)) for name in ('first', 'stage', 'guard', 'sample')},
        f_t=np.zeros(n),
        y_stage=np.zeros(n),
        rhs=np.zeros(n),
        u=np.zeros(len(model.structure.input_columns)),
        stages=np.zeros((6, n)),
        y_new=np.zeros(n),
        y_dense=np.zeros(n),
        k=np.zeros((2, n)),
        increment=(STEEP_DIFFERENCE if is_steep else DIFFERENCE) * scales,
        weight=model.config.parameters['solver.rtol'] * scales,
    )


def new_run(
    model: Model, first_input: Vector, work: Work, parts: Sequence[float] = (), beginning: Beginning = AT_REST
) -> Run:
    """A run at its start: static equilibrium at ambient temperature, modes that admit it.

    `parts` (wires,) ask for x_M, in place of initial.x_M_*, as parts of what a resting wire can have: from 0 where
    sigma = sigma_A to 1 where sigma = sigma_M. `beginning`: what is left of a motion before, if anything. Raises
    SimulationError when there is no equilibrium.
    """
    p = own_scratch(model.compiled)
    y = np.zeros(len(work.weight))
    u = np.array(first_input, dtype=float)
    u[p.drives : -1] = 0.0
    y[p.first_T : p.first_T + p.wires] = u[p.imposed_T : p.imposed_T + p.wires] if p.imposed_T >= 0 else u[-1]
    n = p.coordinates
    y[p.first_T : p.first_T + p.wires] += np.array(beginning.warmth) if beginning.warmth else 0.0
    requested = np.array([model.config.parameters.get(f'initial.x_M_{i + 1}', np.nan) for i in range(p.wires)])
    within = np.array(parts if len(parts) else [np.nan] * p.wires, dtype=float)
    state = SystemState(y, np.zeros(p.wires, dtype=np.int64), np.zeros(p.wires))
    at_rest, hybrid = InputPoint(u, np.zeros(len(u))), p._replace(mas=False)
    if not package_compiler().function(start)(state, at_rest, requested, within, hybrid, work):
        groups = ', '.join(sorted({f'{name.partition(".")[0]}.*' for name in model.structure.declared}))
        raise SimulationError(
            f'no static equilibrium of {model.structure.title} and wires was found; check {groups}, wire.l0'
        )
    if p.coordinates > 0:
        check_start(model, work.first.obs)
    if not beginning.is_at_rest:
        y[:n] += beginning.pose or 0.0
        moved, take = moved_states(model, beginning), package_compiler().function(take_fractions)
        if not len(parts):
            ends = []
            for part in (0.0, 1.0):
                take(state, at_rest, np.full(p.wires, part), moved, hybrid, work)
                ends.append(state.x_frozen.copy())
            least, width = ends[0], ends[1] - ends[0]
            wanted = np.where(np.isnan(requested), least, requested) - least
            within = np.clip(np.divide(wanted, width, out=np.zeros(p.wires), where=width > 0.0), 0.0, 1.0)
        take(state, at_rest, within, moved, hybrid, work)
        y[n : 2 * n] = beginning.rates or 0.0
    if p.mas:
        y[p.first_x : p.first_x + p.wires] = state.x_frozen
    control = np.zeros(C_WIRES + PER_WIRE_CONTROLS * p.wires)
    control[C_H] = 1e-3
    control[C_WIRES + C_LAST_JUMP :: PER_WIRE_CONTROLS] = control[C_TIME] = -np.inf  # no jump and no step before any time
    return Run(state, control, np.zeros(N_SIZE, dtype=np.int64), np.zeros_like(work.matrix))


def moved_states(model: Model, beginning: Beginning) -> Vector:
    """By how much each state of a model (n,), of the extra ones of effects, differs from its first value."""
    sizes, known = sizes_of_states(model.config.effects, model.structure), dict(beginning.states)
    moved = [known.get(name, ()) or (0.0,) for name in sizes]
    extra = [np.tile(values, len(sizes[name]) // len(values)) for name, values in zip(sizes, moved, strict=True)]
    found = np.concatenate([np.zeros(0), *extra])
    return np.concatenate([np.zeros(len(model.scales) - len(found)), found])


def copy_of_run(model: Model, initial_state: Run) -> Run:
    """A copy of a state to continue from, its counters at zero. Raises UserError where it is of another model."""
    expected, given = len(model.scales), len(initial_state.state.y)
    if given != expected:
        raise UserError(f'initial_state: expected a state of {expected} value(s), as this model has; got {given}')
    if len(initial_state.control) != C_WIRES + PER_WIRE_CONTROLS * model.wires:
        raise UserError(
            'initial_state: it was saved by another version of sma_sim; expected one of this: make its run again'
        )
    y, mode, x_frozen = initial_state.state
    state = SystemState(y.copy(), mode.copy(), x_frozen.copy())
    return Run(state, initial_state.control.copy(), np.zeros_like(initial_state.count), initial_state.solution.copy())


def move_clock(control: Vector, begin: float) -> None:
    """Let a run go on at `begin` [s], whatever the time at which it ended: the times that it remembers move along."""
    ended = control[C_TIME]
    if np.isfinite(ended) and begin != ended:
        for at in (C_WINDOW, C_KEPT_UNTIL, slice(C_WIRES + C_LAST_JUMP, None, PER_WIRE_CONTROLS)):
            control[at] = (control[at] - ended) + begin
        control[C_TIME] = begin


def check_clock(model: Model, initial_state: Run, begin: float, are_samples: bool) -> None:
    """Raise UserError where effects read a clock that a run which goes on at `begin` [s] would set to another time."""
    ended, effects = initial_state.control[C_TIME], [active.effect for active in model.config.effects]
    if not np.isfinite(ended):
        return
    timed = [one.name for one in effects if uses_time(one)]
    if timed and abs(begin - ended) > SAME_TIME:
        raise UserError(
            f'initial_state ended at {ended:g} s and the input begins at {begin:g} s, but {", ".join(timed)} depends on '
            f'time: expected an input whose times go on at {ended:g} s'
        )
    paced = [one.name for one in effects if one.clock is not None]
    if paced and are_samples:
        raise UserError(
            f'initial_state: {", ".join(paced)} acts on the time since the beginning of a recording, which a run that '
            'goes on does not have: run the whole command at once, or leave the effect out'
        )


def stall_step(model: Model) -> float:
    """The mean step [s] below which a run is stalled: it needs 100 s of computing and more for 1 s of a robot's time."""
    tightness = min(1.0, model.config.parameters['solver.rtol'] / DEFAULTS['solver.rtol'].default)
    return float(STALL_STEP * tightness ** (1.0 / ORDER))


def check_start(model: Model, found: Any) -> None:
    """Raise SimulationError when the wires are far too long or too short for the structure; `found` as `new_findings`."""
    worst = int(np.argmax(np.abs(found[:, O_EPS])))
    if not SENSIBLE_STRAINS[0] < found[worst, O_EPS] < SENSIBLE_STRAINS[1]:
        l0, structure, length = model.config.parameters['wire.l0'], model.structure, found[worst, O_LENGTH]
        given = f'the {length:g} m that the {structure.title} gives wire {worst + 1}'
        if structure.size_parameter:
            given = f'{structure.size_parameter} = {model.config.parameters[structure.size_parameter]:g} m'
        raise SimulationError(
            f'a wire is strained by {100.0 * found[worst, O_EPS]:.0f} % at rest: check wire.l0 = {l0:g} m against {given}'
        )


@checked
def simulate(
    model: Model | Config,
    source: Input,
    sample_times: Vector | Sequence[float] | float,
    max_step: float = np.inf,
    max_steps: float = 10_000_000,
    progress: Callable[[float], None] | None = None,
    initial_state: Run | Trajectory | None = None,
    channels: str | Sequence[str] | None = None,
) -> Trajectory:
    """Run a model under an input.

    Parameters
    ----------
    model : Model or Config
        The model.
    source : Input
        The input, from `module_input` or `wire_input`, with the columns of the system.
    sample_times : array (k,) or float
        Times [s] within those of the input, increasing, or a rate [1/s].
    max_step : float
        Upper limit of the step size [s].
    max_steps : float
        The run ends after so many steps, with that reason.
    progress : callable, optional
        Called with the finished share of the run, 0 to 1; without it a terminal or a notebook shows it where it takes long.
    initial_state : Run or Trajectory, optional
        An earlier run, or its `Trajectory.state`, to continue from it, at whatever time the input begins; without it the
        run starts at rest.
    channels : str or sequence of str, optional
        Sensor channels to sample, as 'alpha' or 'F_1', in place of all columns: this takes less time.

    Returns
    -------
    Trajectory
        Samples up to the end, or up to where the run had to stop (see its `reason`), also after Ctrl-C.

    Raises
    ------
    UserError
        For samples outside the input, an input of another system, a channel that the system does not have, or a run that
        goes on at another time where effects depend on time.
    SimulationError
        If the model has no static equilibrium to start from.

    Examples
    --------
    >>> import sma_sim
    >>> command = sma_sim.module_input([0.0, 5.0, 25.0, 60.0], [0.0, 12.0, 0.0, 0.0])
    >>> run = sma_sim.simulate(sma_sim.Model(), command, 10.0)
    >>> run.reason, len(run.time), round(run['T_1_K'].max())
    ('end of the input', 601, 357)
    >>> run.jumps[0].guard
    'sigma < sigma_M'
    """
    model = Model(model) if isinstance(model, Config) else model
    initial_state = initial_state.state if isinstance(initial_state, Trajectory) else initial_state
    channels = [channels] if isinstance(channels, str) else channels
    check_columns(model.structure, source)
    if initial_state is None and channels is None:  # as a user calls it
        if len(source.times) < 2:
            raise UserError(f'input: expected at least two rows, the last one gives the end of the run, got {source.times}')
        warn_of_idle_effects(model.config)
    if not max_step > 0.0:
        raise UserError(f'max_step = {max_step!r}: expected more than 0 s')
    if not max_steps >= 1.0:
        raise UserError(f'max_steps = {max_steps!r}: expected a number of steps, 1 or more')
    times, values, slopes = segments(source)
    work = new_work(model)
    run = copy_of_run(model, initial_state) if initial_state else new_run(model, values[0], work)
    notes = (() if initial_state else notes_on_start(model, run)) + notes_on_commands(model, source)
    asked, begin = requested_times(source, sample_times), float(source.times[0])
    if initial_state:
        check_clock(model, run, begin, bool(len(asked)))
        move_clock(run.control, begin)
    seen = seen_at(model, asked, begin)
    times, values, slopes = held_until((times, values, slopes), seen)
    limits = Limits(float(max_step), int(min(max_steps, MOST_STEPS)), min(stall_step(model), 0.1 * max_step))
    compiled, integrate_stretches = own_scratch(model.compiled), package_compiler().function(integrate)
    reason = REASONS[COMPLETED]
    sampled = sampled_numbers(channels, model.structure)
    log = new_log(model, seen, sampled)
    with progress_line('simulating') as line:
        try:
            for first in range(0, max(len(times) - 1, 1), PIECES_AT_ONCE):
                part = slice(first, first + PIECES_AT_ONCE + 1)
                stretches = InputStretches(times[part], values[part], slopes[part], model.uses_time)
                status = integrate_stretches(stretches, run, compiled, work, limits, log)
                reason = stop_reason(status, model, run)
                if status != COMPLETED:
                    break
                (line if progress is None else progress)(min(1.0, (first + PIECES_AT_ONCE) / len(times)))
        except KeyboardInterrupt:
            reason = STOPPED
    return trajectory(model, log, asked, run, reason, notes, source)


def uninterrupted(run: Trajectory) -> Trajectory:
    """A run as `simulate` returns it, for whoever works on with it: one that Ctrl-C cut short ends that work too."""
    if run.reason == STOPPED:
        raise KeyboardInterrupt
    return run


def channels_of_all(
    models: Sequence[Model],
    source: Input,
    times: Vector,
    channels: Sequence[str],
    max_steps: int,
    begin: Run,
    work: Work,
    lines: Stretches | None = None,
) -> list[Matrix]:
    """What sensor channels of models show at times (k,) [s], as (k, channels) each: what `simulate` samples, without names.

    For fits, which make thousands of runs. Models may differ in effects which only show (`Effect.only_shows`), without
    states: one run, that of the first, serves all. Nothing is checked; `begin`, the state in which the run begins, becomes
    that in which it ends, and `work` is scratch memory; `lines` take the place of the source (`smoothed_command`). Raises
    SimulationError where the run does not come to its end.
    """
    model, numbers = models[0], sampled_numbers(channels, models[0].structure)
    seen = seen_at(model, times, float(source.times[0]))
    if lines is None:
        stretches = InputStretches(*held_until(segments(source), seen), model.uses_time)
    else:
        stretches, work = under_lines(lines), work._replace(u=np.zeros(lines.values.shape[1]))
    systems = [own_scratch(one.compiled if lines is None else system_under(lines, one.compiled)) for one in models]
    log = new_log(model, seen, numbers if len(models) == 1 else np.append(numbers, state_numbers(model.structure, begin)))
    limits = Limits(np.inf, max_steps, stall_step(model))
    status = package_compiler().function(integrate)(stretches, begin, systems[0], work, limits, log)
    if status != COMPLETED:
        end = times[: int(log.written[0])][-1:].sum()
        raise SimulationError(f'the run ended after {end:g} s: {stop_reason(status, model, begin)}')
    found, states = [np.ascontiguousarray(part) for part in np.split(log.samples, [len(numbers)], axis=1)]
    others = [new_log(model, seen, numbers) for _ in models[1:]]
    for system, other in zip(systems[1:], others, strict=True):
        package_compiler().function(sample_again)(stretches, states, begin.state, system, work, other)
    return [found, *(other.samples for other in others)]


def new_log(model: Model, times: Vector, numbers: NDArray[np.int64]) -> Log:
    """Room for samples of these numbers (solver.columns) at these times (k,) [s], and for jumps."""
    samples = new_samples(len(times), numbers, model.structure)
    return Log(samples, times, np.zeros(1, dtype=np.int64), np.empty((MAX_JUMPS, 3)), numbers)


def trajectory(
    model: Model, log: Log, times: Vector, run: Run, reason: str, notes: tuple[str, ...], source: Input | None = None
) -> Trajectory:
    """What a run left behind, with names; `times` (k,) [s] at which samples are shown, and their `source`.

    Warns of wires that would have melted or buckled, and of coordinates beyond their limits.
    """
    written = slice(int(log.written[0]))
    columns, resistances = named_columns(model.structure, log.samples[written], log.numbers)
    time, inputs, is_fit = times[written], dict[str, Vector](), are_channels(log.numbers, model.structure)
    for doubt in () if is_fit else doubts_of(model, columns, run):  # a fit tries much
        warnings.warn(doubt, PhysicsWarning, stacklevel=4)  # at the line that calls `simulate`
        notes = (*notes, doubt)
    if source is not None and not is_fit:
        inputs = {name: values for name, values in inputs_at(source, time).items() if name != 'time_s'}
    for shown in (time, *inputs.values(), *columns.values(), *resistances.values()):
        shown.flags.writeable = False
    return Trajectory(
        time=time,
        inputs=inputs,
        units={name: unit_of(name, model.structure) for name in (*inputs, *columns, *resistances)},
        columns=columns,
        resistances=resistances,
        jumps=named_jumps(log.jumps, int(run.count[N_JUMPS])),
        reason=reason,
        completed=reason == REASONS[COMPLETED],
        steps=int(run.count[N_STEPS]),
        rejected=int(run.count[N_REJECTED]),
        chattering=int(run.count[N_CHATTER]),
        state=run,
        notes=notes,
    )


def doubts_of(model: Model, columns: Mapping[str, Vector], run: Run) -> list[str]:
    """What in a run no robot would survive, or no wire do."""
    melting = melting_note(temperatures_of(model, columns, run))
    found = [melting, rising_stress_note(model, run), compression_note(model, columns), *limit_notes(model, columns)]
    return [doubt for doubt in found if doubt]


def unit_of(column: str, structure: Structure) -> str:
    """The unit of a column of a structure's files."""
    units = {one.column: one.unit for one in structure.coordinates} | {one.column: one.unit for one in structure.drives}
    found = re.search(r'_(W|N|K|Pa|ohm)$', column)
    return units.get(column) or (found[1] if found else '-')


def temperatures_of(model: Model, columns: Mapping[str, Vector], run: Run) -> NDArray[np.float64]:
    """The temperatures of the wires (k, wires) [K] in the samples, the last one at the end of the run."""
    first = model.compiled.first_T
    last = run.state.y[None, first : first + model.wires]
    names = [f'T{suffix}_K' for suffix in model.structure.wire_suffixes]
    return np.vstack([np.column_stack([columns[name] for name in names]), last]) if set(names) <= columns.keys() else last


def named_jumps(jumps: Any, count: int) -> tuple[Jump, ...]:
    """The log of jumps with names; j counts the jumps before it."""
    return tuple(
        Jump(t, j, int(wire) + 1, *NAMED_EDGES[int(edge)]) for j, (t, wire, edge) in enumerate(jumps[:count].tolist())
    )
