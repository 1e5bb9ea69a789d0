"""Runs of any structure from bags: the topics of a node as the columns of the file contract.

A bag that the node wrote has simulated time as its log time. In any other bag stamped messages count by their stamps, and
the rest (commands, forces) by the stamp that belongs to its log time: the clock of the recorder may run at another rate than
that of the stamps, and go on while that one stands still. Of such a bag that does not tell what was applied, the rules of
`commands` say what was in force. Where the stamps go back, another session begins, as in a table.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.rosbag.cdr import decoded_together
from sma_sim.evidence.data.rosbag.commands import UNLIMITED, CommandLimits, Times, ambient_refusal, in_force
from sma_sim.evidence.data.rosbag.interface import (
    AMBIENT,
    APPLIED,
    FLOAT64_ARRAY,
    INTERFACE,
    JOINT_STATE,
    PAIR_COMMAND,
    STAMPED,
    WIRE_COMMAND,
    Decode,
    Interface,
    command_decoders,
    interface_from,
    interface_of,
    known_interfaces,
    measured_decoders,
    prefix_of,
)
from sma_sim.evidence.data.rosbag.salvage import Bag, open_bag
from sma_sim.evidence.data.rosbag.writer import typestore
from sma_sim.evidence.data.sessions import ordered_sessions
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.model.parameters import ZERO_CELSIUS
from sma_sim.model.shown import counted
from sma_sim.model.structures.discovery import package_structures
from sma_sim.model.structures.structure import Structure

JITTER_WINDOW = 51  # stamped messages whose median delay counts: single ones arrive late, or several at once
SAME_RATE = 0.01  # by which the rates of two clocks differ without a word
SNAP_FRACTION = 0.3  # of a sample period: an unstamped message so near to a stamp belongs to it
MODE_TOPICS = ('wire_modes',)  # published at jumps too: only those at the time of a sample are kept
COMMANDS = tuple(f'{name}{suffix}' for name in (PAIR_COMMAND, WIRE_COMMAND) for suffix in ('', STAMPED, APPLIED))


@dataclass
class TopicSeries:
    """The messages of one topic: times [ns], stamps [ns] (0: it has none), and values by column, (k,) each."""

    log: Times
    stamp: Times
    values: dict[str, Vector] = field(default_factory=dict)


def namespaces(bag: Bag) -> list[str]:
    """Namespaces of the robots in a bag ('' is the root)."""
    found = set()
    for topic in bag.topics():
        for name in ('joint_states', *COMMANDS):
            if topic == name or topic.endswith(f'/{name}'):
                found.add(topic.removesuffix(name).strip('/'))
    return sorted(found)


def read_bag(
    path: Path,
    namespace: str | None = None,
    structure: Structure | None = None,
    limits: CommandLimits = UNLIMITED,
    notes: list[str] | None = None,
    one_run: bool = True,
) -> dict[str, Vector]:
    """Columns of the file contract, (k,) each, from a bag of a robot; NaN where a topic had no message at that time.

    What is imposed and the ambient temperature are held from message to message. `structure` says what the robot is, where
    the bag itself does not; without it, topics and joints tell. `limits` say what a robot accepts that does not publish what
    it has applied. What was done with commands and times is added to `notes`. Raises UserError when there is no bag, no
    command in it, or several robots and no `namespace`; and, unless `one_run` is False, where it holds several sessions.
    """
    columns = columns_of_bag(open_bag(path), namespace, structure, limits, [] if notes is None else notes)
    steps = np.diff(columns['time_s'])
    back = steps < 0.0
    if one_run and back.any():
        raise UserError(
            f'{path}: the stamps go back {counted(int(back.sum()), "time")}, first by {-steps[back][0]:.3f} s: a clock was '
            'set, or a simulator was reset. Expected one run; compare, fit and diagnose read each part, and '
            f'`sma-sim bag convert {path} FILE.csv` writes all of them, to be cut where time goes back'
        )
    return columns


def columns_of_bag(
    bag: Bag, namespace: str | None, structure: Structure | None, limits: CommandLimits, notes: list[str]
) -> dict[str, Vector]:
    """The same of a bag that is open: opening one takes a tenth of a second."""
    prefix = topic_prefix(bag, namespace)
    interface = interface_of_bag(bag, prefix, structure)
    commands, measured = command_decoders(interface), measured_decoders(interface)
    wanted = {f'{prefix}{name}': (name, *rest) for name, rest in {**commands, **measured}.items()}
    series = read_series(bag, wanted)
    take_stamped_commands(series, interface.heating_topic)
    topics = (interface.heating_topic, *interface.drives)
    if not any(name in series for topic in topics for name in (topic, f'{topic}{APPLIED}')):
        expected = ' or '.join(f'{prefix}{name}' for name in (topics[0], f'{topics[0]}{APPLIED}'))
        given = ', '.join(sorted(bag.topics()))
        raise UserError(
            f'{bag.path} has no command: expected messages on {expected}, got {given}; publish or remap the power to that '
            f'topic, or export the bag as CSV and name its columns in a map (--map)'
        )
    zero = int(bag.about['epoch']) if 'epoch' in bag.about else None
    sessions = [series] if zero is not None else sessions_of(bag.path, series, commands, notes)
    found = []
    for session in sessions:
        times = message_times(session, 'epoch' in bag.about, measured, notes)
        zero = min(int(t.min()) for t in times.values()) if zero is None else zero
        apply_command_rules(session, times, zero, interface, limits, notes)
        leave_out_refused_ambient(session, times, zero, notes)
        found.append(columns_from_series(session, times, zero, interface))
    return found[0] if len(found) == 1 else one_after_another(found, interface)


def interface_of_robot(path: Path, namespace: str | None = None) -> Interface:
    """What the topics of a robot in a bag are about. Raises UserError as `read_bag` does."""
    bag = open_bag(path)
    return interface_of_bag(bag, topic_prefix(bag, namespace))


def interface_of_bag(bag: Bag, prefix: str, structure: Structure | None = None) -> Interface:
    """What the topics of a bag are about: as the bag says, as `structure` says, or as topics and joints show."""
    if INTERFACE in bag.about:
        return interface_from(bag.about[INTERFACE], str(bag.path))
    if structure is not None:
        return interface_of(structure)
    heating, there = PAIR_COMMAND, set(bag.topics())
    if {f'{prefix}{WIRE_COMMAND}{suffix}' for suffix in ('', STAMPED, APPLIED)} & there:
        heating = WIRE_COMMAND
    names, count = first_message(bag, {f'{prefix}joint_states'}, JOINT_STATE, 'name'), 1
    if heating == WIRE_COMMAND:
        topics = {f'{prefix}{WIRE_COMMAND}', f'{prefix}{WIRE_COMMAND}{APPLIED}'}
        count = len(
            first_message(bag, topics, FLOAT64_ARRAY, 'data')
            if topics & there
            else first_message(bag, {f'{prefix}{WIRE_COMMAND}{STAMPED}'}, JOINT_STATE, 'effort')
        )
    known = [one for one in known_interfaces(count) if one.heating_topic == heating and len(one.commands) == count]
    fitting = [one for one in known if has_joints(names, tuple(one.joints))]
    if fitting:
        return max(fitting, key=lambda one: len(one.joints))
    if heating == WIRE_COMMAND and count > 1:
        return Interface('robot', {}, tuple(f'{WIRE_COMMAND}_{i + 1}' for i in range(count)), count, {}, {})
    return interface_of(package_structures()['module' if heating == PAIR_COMMAND else 'wire'])


def joints_in(bag: Bag, namespace: str | None) -> list[str]:
    """The names of the joints in a bag. Raises UserError as `read_bag` does."""
    return first_message(bag, {f'{topic_prefix(bag, namespace)}joint_states'}, JOINT_STATE, 'name')


def has_joints(names: Sequence[str], expected: Sequence[str]) -> bool:
    """Whether all expected joints are among the names, which may have a prefix."""
    return bool(expected) and (set(expected) <= set(names) or prefix_of(names, expected) != '')


def first_message(bag: Bag, topics: Collection[str], kind: str, entries: str) -> list[Any]:
    """The entries of the first message of some topics that has any and can be read."""
    for message in bag.messages(topics):
        try:
            found = list(getattr(typestore().deserialize_cdr(message.cdr, kind), entries))
        except Exception:  # whatever the parsing of a broken message stumbles over; the reader tells of it
            return []
        if found:
            return found
    return []


def topic_prefix(bag: Bag, namespace: str | None) -> str:
    """What stands before the topics' names. Raises UserError when that is not clear."""
    found = namespaces(bag)
    if not found:
        topics = ', '.join(sorted(bag.topics()))
        if not topics:
            raise UserError(f'{bag.path}: no message in it can be read: the bag is empty or broken')
        raise UserError(f'{bag.path} holds no module: expected a topic joint_states, {", ".join(COMMANDS)}, got {topics}')
    if namespace is None:
        if len(found) > 1:
            named = ', '.join(f'/{name}' for name in found)
            raise UserError(f'{bag.path} holds several modules: choose one of the namespaces {named} with --namespace')
        namespace = found[0]
    namespace = namespace.strip('/')
    if namespace not in found:
        named = ', '.join(f'/{name}' for name in found)
        raise UserError(f'{bag.path} has no module in namespace /{namespace}; there is {named}')
    return f'/{namespace}/' if namespace else '/'


def read_series(bag: Bag, wanted: Mapping[str, tuple[str, str, Decode]]) -> dict[str, TopicSeries]:
    """What the wanted topics said. Raises UserError for one with another message type."""
    serialized: dict[str, tuple[list[int], list[bytes]]] = {}
    for topic, kind, log_time, cdr, *_ in bag.messages(wanted):
        if topic not in serialized:
            if kind != wanted[topic][1]:
                raise UserError(f'{bag.path}, topic {topic}: expected messages of {wanted[topic][1]}, got {kind}')
            serialized[topic] = [], []
        logs, messages = serialized[topic]
        logs.append(log_time)
        messages.append(cdr)
    found: dict[str, TopicSeries] = {}
    for topic, (logs, messages) in serialized.items():
        name, kind, decode = wanted[topic]
        found[name] = series = TopicSeries(np.array(logs, dtype=np.int64), np.zeros(len(logs), dtype=np.int64))
        try:
            groups = list(decoded_together(messages, kind))
        except ValueError as error:
            size = len(messages[error.args[0]])
            raise UserError(f'{bag.path}, topic {topic}: a message of {size} bytes is not a {kind}') from error
        for at, message in groups:
            if hasattr(message, 'header'):
                stamp = message.header.stamp
                series.stamp[at] = stamp.sec.astype(np.int64) * 10**9 + stamp.nanosec
            for column, values in decode(message).items():
                series.values.setdefault(column, np.full(len(logs), np.nan))[at] = values
    return found


def take_stamped_commands(series: dict[str, TopicSeries], topic: str) -> None:
    """Put the commands with a stamp among those without: a robot takes both, as they arrive, whenever they were made."""
    stamped = series.pop(f'{topic}{STAMPED}', None)
    if stamped is None:
        return
    both = [stamped, *([series[topic]] if topic in series else [])]
    log = np.concatenate([one.log for one in both])
    order = np.argsort(log, kind='stable')
    values = {name: np.concatenate([one.values[name] for one in both])[order] for name in stamped.values}
    series[topic] = TopicSeries(log[order], np.zeros_like(log), values)


def sessions_of(
    path: Path, series: Mapping[str, TopicSeries], commands: Collection[str], notes: list[str]
) -> list[dict[str, TopicSeries]]:
    """The messages of each session: where stamps go back, the rules are those of the rows of a table.

    Those without a stamp belong to the session in which they were logged. The last of the `commands` (topics) before it
    began is in force in it. Raises UserError where two recordings seem to be mixed.
    """
    stamps = {name: topic.stamp for name, topic in series.items() if topic.stamp.any()}
    if not stamps or not any((np.diff(each) < 0).any() for each in stamps.values()):
        return [dict(series)]
    pace = max(stamps, key=lambda name: len(stamps[name]))
    rows = {name: rows_of_sessions(path, stamp, notes if name == pace else []) for name, stamp in stamps.items()}
    begins = np.array([series[pace].log[each[0]] for each in rows[pace]][1:])
    sessions = []
    for number in range(len(rows[pace])):
        session = {}
        for name, topic in series.items():
            of_topic = np.searchsorted(begins, topic.log, side='right')
            chosen = np.flatnonzero(of_topic == number)
            if name == pace or name in rows and len(rows[name]) == len(rows[pace]):
                chosen = rows[name][number]
            held = np.setdiff1d(np.flatnonzero(of_topic < number)[-1:], chosen) if name in commands else chosen[:0]
            at = np.concatenate([held, chosen])
            if len(at):
                log, stamp = topic.log[at], topic.stamp[at]
                if number:
                    log = np.maximum(log, begins[number - 1])
                if len(held) and name in stamps:
                    stamp[0] = stamps[pace][rows[pace][number][0]]
                session[name] = TopicSeries(log, stamp, {key: each[at] for key, each in topic.values.items()})
        sessions.append(session)
    return sessions


def rows_of_sessions(path: Path, stamp: Times, notes: list[str]) -> list[NDArray[np.intp]]:
    """Which messages of a topic make up each session, in the order of their log times."""
    found, words = ordered_sessions(path, (stamp - stamp[0]) / 1e9, np.ones(len(stamp), dtype=bool))
    notes += words
    return [np.sort(np.arange(len(stamp))[rows]) for rows in found]


def one_after_another(sessions: Sequence[Mapping[str, Vector]], of: Interface) -> dict[str, Vector]:
    """The columns of sessions, in which time goes back where one begins; what is not in all of them is missing there, but
    for what was not commanded yet."""
    zero = (*of.drives.values(), *of.heating_columns)
    names = [name for name in of.columns if any(name in columns for columns in sessions)]
    return {
        name: np.concatenate(
            [columns.get(name, np.full(len(columns['time_s']), 0.0 if name in zero else np.nan)) for columns in sessions]
        )
        for name in names
    }


def message_times(
    series: Mapping[str, TopicSeries], ours: bool, measured: Collection[str], notes: list[str]
) -> dict[str, NDArray[np.int64]]:
    """When each message counts [ns]; unstamped ones of `measured` topics belong to the stamp next to them."""
    logs = {name: topic.log for name, topic in series.items()}
    if ours:
        return logs
    stamps = {name: topic.stamp for name, topic in series.items() if topic.stamp.any()}
    if not stamps:
        return logs
    pace = max(stamps, key=lambda name: len(stamps[name]))
    unstamped = [name for name in logs if name not in stamps]
    shifted, rate = stamps_at([logs[name] for name in unstamped], logs[pace], stamps[pace])
    if abs(rate - 1.0) > SAME_RATE and unstamped:
        notes.append(
            f'the stamps advance {rate:.3g} s per second of the log times: {", ".join(unstamped)}, which have none, '
            'get those that belong to their log times'
        )
    by_topic = dict(zip(unstamped, shifted, strict=True))
    period = float(np.median(np.diff(np.sort(stamps[pace])))) if len(stamps[pace]) > 1 else 0.0
    for name in by_topic:
        if name in measured:
            by_topic[name] = snapped(by_topic[name], np.sort(stamps[pace]), SNAP_FRACTION * period)
    return {**stamps, **by_topic}


def stamps_at(logs: Sequence[Times], known_log: Times, known_stamp: Times) -> tuple[list[Times], float]:
    """The stamps [ns] that belong to log times, by messages that have both, (k,) in the order of their log times; and the
    rate of the clock of the stamps.

    A line through the pairs, and the median of what the pairs around deviate from it by: a late message moves nothing, and
    the map follows a clock that stops or changes its rate.
    """
    from scipy.ndimage import median_filter  # only here: it takes long to import

    log_zero, stamp_zero = known_log[0], known_stamp[0]
    log, stamp = known_log - log_zero, (known_stamp - stamp_zero).astype(float)
    half = len(log) // 2
    spans = log[half:] - log[: len(log) - half]
    apart = spans > 0
    rises = stamp[half:] - stamp[: len(log) - half]
    rate = float(np.median(rises[apart] / spans[apart])) if half and apart.any() else 1.0
    deviation = median_filter(stamp - rate * log, min(JITTER_WINDOW, len(log)), mode='nearest')
    found = [rate * (times - log_zero) + np.interp(times - log_zero, log, deviation) for times in logs]
    return [stamp_zero + np.round(times).astype(np.int64) for times in found], rate


def apply_command_rules(
    series: Mapping[str, TopicSeries],
    times: dict[str, Times],
    zero: int,
    of: Interface,
    limits: CommandLimits,
    notes: list[str],
) -> None:
    """Put what was in force in the place of the heating that was asked for, where the bag tells no more."""
    topic, columns = of.heating_topic, of.heating_columns
    if topic not in series or f'{topic}{APPLIED}' in series:
        return
    asked, end = series[topic], max(int(each.max()) for each in times.values())
    order = np.argsort(times[topic], kind='stable')
    when, J = times[topic][order], np.column_stack([asked.values[column] for column in columns])[order]
    refused, beyond = ~np.isfinite(J).all(axis=1), (np.abs(J) > limits.J_max).any(axis=1)
    changes, powers = in_force(when, J, limits, end)
    off = np.setdiff1d(changes, when)

    def first(chosen: Times) -> str:
        return f'the first at {(int(chosen[0]) - zero) / 1e9:.6g} s'

    if refused.any():
        words = f'{topic}: {refused.sum()} commands refused (not finite, or not one number for each wire)'
        notes.append(f'{words}, {first(when[refused])}: the one before stays in force')
    if beyond.any():
        words = f'{topic}: {beyond.sum()} commands beyond node.J_max = {limits.J_max:g} W'
        notes.append(f'{words}, {first(when[beyond])}: clipped')
    if len(off):
        words = f'{topic}: no command for node.command_timeout = {limits.timeout:g} s, {len(off)} times'
        notes.append(f'{words}, {first(off)}: heating off until the next one (0: the robot has no timeout)')
    times[topic] = changes
    asked.values = dict(zip(columns, powers.T, strict=True))


def leave_out_refused_ambient(
    series: dict[str, TopicSeries], times: Mapping[str, Times], zero: int, notes: list[str]
) -> None:
    """Leave out ambient temperatures that a robot refuses, where the bag does not tell what was in force."""
    if AMBIENT not in series or 'T_E_applied' in series:
        return
    values = series[AMBIENT].values['T_E_K']
    reasons = [ambient_refusal(celsius) for celsius in (values - ZERO_CELSIUS).tolist()]
    refused = np.array([bool(reason) for reason in reasons])
    if not refused.any():
        return
    first = int(refused.argmax())
    at = f'{(int(times[AMBIENT][first]) - zero) / 1e9:.6g} s'
    left = 'environment.T_E counts' if refused.all() else 'the one before stays in force'
    got = f'{values[first] - ZERO_CELSIUS:g} deg C, {reasons[first]}'
    notes.append(f'{AMBIENT}: {refused.sum()} messages refused, the first at {at}: {got}; {left}')
    values[refused] = np.nan
    if refused.all():
        del series[AMBIENT]


def snapped(times: NDArray[np.int64], stamps: NDArray[np.int64], reach: float) -> NDArray[np.int64]:
    """Times moved to the nearest stamp within reach."""
    after = np.clip(np.searchsorted(stamps, times), 1, max(len(stamps) - 1, 1))
    candidates = stamps[np.stack([after - 1, np.minimum(after, len(stamps) - 1)])]
    nearest = np.take_along_axis(candidates, np.abs(candidates - times).argmin(axis=0)[None], axis=0)[0]
    return np.where(np.abs(nearest - times) <= reach, nearest, times)


def columns_from_series(
    series: Mapping[str, TopicSeries], times: Mapping[str, NDArray[np.int64]], zero: int, interface: Interface
) -> dict[str, Vector]:
    """All series on the union of their times, seconds after `zero`."""
    every = np.unique(np.concatenate([times[name] for name in series if name not in MODE_TOPICS]))
    columns: dict[str, Vector] = {}
    commands = command_decoders(interface)
    for name in (*measured_decoders(interface), *commands):
        if name not in series:
            continue
        for column, values in series[name].values.items():
            if column in columns:
                continue
            filled = np.full(len(every), np.nan)
            at = np.searchsorted(every, times[name])
            known = (at < len(every)) & (every[np.minimum(at, len(every) - 1)] == times[name]) & ~np.isnan(values)
            order = slice(None, None, 1 if name in commands else -1)  # at one time: the last command, the first sample
            filled[at[known][order]] = values[known][order]
            columns[column] = filled
    for name in (*interface.drives.values(), *interface.heating_columns):
        if name in columns:
            columns[name] = hold_last_value(columns[name], 0.0)
    if 'T_E_K' in columns:
        given = columns['T_E_K'][~np.isnan(columns['T_E_K'])]
        columns['T_E_K'] = hold_last_value(columns['T_E_K'], given[0])
    columns['time_s'] = (every - zero) / 1e9
    return {name: columns[name] for name in interface.columns if name in columns}


def hold_last_value(values: Vector, before: float) -> Vector:
    """Each gap filled with the value before it."""
    last = np.maximum.accumulate(np.where(np.isnan(values), -1, np.arange(len(values))))
    return np.where(last >= 0, values[np.maximum(last, 0)], before)
