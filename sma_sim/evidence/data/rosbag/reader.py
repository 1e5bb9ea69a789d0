"""Runs of a module from bags: the topics of a module as the columns of the file contract.

A bag that the node wrote has simulated time as its log time. In any other bag stamped messages count by their stamps; the
rest (commands, forces) by log time, shifted to the clock of the stamps.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.data.rosbag.raw_messages import Bag, open_bag
from sma_sim.evidence.data.rosbag.writer import typestore
from sma_sim.model.errors import UserError

Vector = NDArray[np.float64]
SNAP_FRACTION = 0.3  # of a sample period: an unstamped message so near to a stamp belongs to it
JOINT_STATE, TEMPERATURE = 'sensor_msgs/msg/JointState', 'sensor_msgs/msg/Temperature'
FLOAT64, FLOAT64_ARRAY = 'std_msgs/msg/Float64', 'std_msgs/msg/Float64MultiArray'
UINT8_ARRAY = 'std_msgs/msg/UInt8MultiArray'
POSE_COLUMNS = {'U_x': 'U_x_m', 'U_y': 'U_y_m', 'alpha': 'alpha_rad'}
WIRE_NAMES = ('wire_1', 'wire_2')

Decode = Callable[[Any], Mapping[str, float]]


def joints_decoder(columns: Mapping[str, str], values: str) -> Decode:
    """Values of a JointState by the names in it, which may all have one prefix (node.joint_prefix)."""

    @cache
    def prefixed(names: tuple[str, ...]) -> dict[str, str]:
        prefix = prefix_of(names, tuple(columns))
        return {prefix + name: column for name, column in columns.items()}

    def decode(message: Any) -> dict[str, float]:
        by_name = prefixed(tuple(message.name))
        read = zip(message.name, getattr(message, values), strict=False)
        return {by_name[name]: float(value) for name, value in read if name in by_name}

    return decode


def prefix_of(names: Collection[str], expected: Sequence[str]) -> str:
    """What stands before all expected names in `names`; nothing where some have none, or where it could be several."""
    if set(expected) & set(names):
        return ''
    found = {name.removesuffix(expected[0]) for name in names if name.endswith(expected[0])}
    whole = [prefix for prefix in found if all(prefix + name in names for name in expected)]
    return whole[0] if len(whole) == 1 else ''


def pair_decoder(*columns: str) -> Decode:
    """Two numbers, one per wire."""

    def decode(message: Any) -> dict[str, float]:
        return dict(zip(columns, map(float, message.data), strict=False))

    return decode


def number_decoder(column: str) -> Decode:
    """One number."""
    return lambda message: {column: float(message.data)}


def temperature_decoder(column: str) -> Decode:
    """A temperature, in deg C in the message (REP 103)."""
    return lambda message: {column: float(message.temperature) + ZERO_CELSIUS}


# Topic: message type, and decoder. Where two topics give the same column the first that was recorded counts.
COMMAND_TOPICS: Mapping[str, tuple[str, Decode]] = {
    'J_eq_applied': (FLOAT64, number_decoder('J_eq_W')),
    'J_eq': (FLOAT64, number_decoder('J_eq_W')),
    'T_E_applied': (FLOAT64, number_decoder('T_E_K')),
    'ambient_temperature': (TEMPERATURE, temperature_decoder('T_E_K')),
}
MEASURED_TOPICS: Mapping[str, tuple[str, Decode]] = {
    'joint_states': (JOINT_STATE, joints_decoder(POSE_COLUMNS, 'position')),
    'wire_forces': (FLOAT64_ARRAY, pair_decoder('F_1_N', 'F_2_N')),
    'wire_states': (JOINT_STATE, joints_decoder({wire: f'F_{i}_N' for i, wire in enumerate(WIRE_NAMES, 1)}, 'effort')),
    'wire_1/temperature': (TEMPERATURE, temperature_decoder('T_1_K')),
    'wire_2/temperature': (TEMPERATURE, temperature_decoder('T_2_K')),
    'phase_fractions': (FLOAT64_ARRAY, pair_decoder('x_M_1', 'x_M_2')),
    'wire_modes': (UINT8_ARRAY, pair_decoder('mode_1', 'mode_2')),
}
MODE_TOPICS = ('wire_modes',)  # published at jumps too: only those at the time of a sample are kept
COLUMN_ORDER = (
    'time_s', 'J_eq_W', 'T_E_K', *POSE_COLUMNS.values(), 'F_1_N', 'F_2_N', 'T_1_K', 'T_2_K', 'x_M_1', 'x_M_2',
    'mode_1', 'mode_2',
)  # fmt: skip


@dataclass
class TopicSeries:
    """The messages of one topic: times [ns] and values by column."""

    log: list[int] = field(default_factory=list)
    stamp: list[int] = field(default_factory=list)
    values: dict[str, list[float]] = field(default_factory=dict)


def namespaces(bag: Bag) -> list[str]:
    """Namespaces of the modules in a bag ('' is the root)."""
    found = set()
    for topic in bag.topics():
        for name in ('joint_states', 'J_eq', 'J_eq_applied'):
            if topic == name or topic.endswith(f'/{name}'):
                found.add(topic.removesuffix(name).strip('/'))
    return sorted(found)


def read_bag(path: Path, namespace: str | None = None) -> dict[str, Vector]:
    """Columns of the file contract, (k,) each, from a bag of a module; NaN where a topic had no message at that time.

    The command and the ambient temperature are held from message to message. Raises UserError when there is no bag, no
    command in it, or several modules and no `namespace`.
    """
    bag = open_bag(path)
    prefix = topic_prefix(bag, namespace)
    wanted = {f'{prefix}{name}': (name, *rest) for name, rest in {**COMMAND_TOPICS, **MEASURED_TOPICS}.items()}
    series = read_series(bag, wanted)
    if not any(name in series for name in ('J_eq', 'J_eq_applied')):
        raise UserError(f'{path} has no command: expected messages on {prefix}J_eq or {prefix}J_eq_applied')
    times = message_times(series, 'epoch' in bag.about)
    zero = int(bag.about['epoch']) if 'epoch' in bag.about else min(int(t[0]) for t in times.values())
    return columns_from_series(series, times, zero)


def topic_prefix(bag: Bag, namespace: str | None) -> str:
    """What stands before the topics' names. Raises UserError when that is not clear."""
    found = namespaces(bag)
    if not found:
        topics = ', '.join(sorted(bag.topics())) or 'none'
        raise UserError(f'{bag.path} holds no module: expected a topic joint_states, J_eq or J_eq_applied, got {topics}')
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
    found: dict[str, TopicSeries] = {}
    decode_cdr = typestore().deserialize_cdr
    for topic, kind, log_time, cdr, *_ in bag.messages(wanted):
        name, expected, decode = wanted[topic]
        if kind != expected:
            raise UserError(f'{bag.path}, topic {topic}: expected messages of {expected}, got {kind}')
        try:
            message = decode_cdr(cdr, kind)
        except Exception as error:
            raise UserError(f'{bag.path}, topic {topic}: a message of {len(cdr)} bytes is not a {kind}') from error
        series = found.setdefault(name, TopicSeries())
        series.log.append(log_time)
        header = getattr(message, 'header', None)
        series.stamp.append(header.stamp.sec * 10**9 + header.stamp.nanosec if header else 0)
        for column, value in decode(message).items():
            series.values.setdefault(column, [np.nan] * (len(series.log) - 1)).append(value)
        for values in series.values.values():
            values.extend([np.nan] * (len(series.log) - len(values)))
    return found


def message_times(series: Mapping[str, TopicSeries], ours: bool) -> dict[str, NDArray[np.int64]]:
    """When each message counts [ns]."""
    logs = {name: np.array(topic.log, dtype=np.int64) for name, topic in series.items()}
    if ours:
        return logs
    stamps = {name: np.array(topic.stamp, dtype=np.int64) for name, topic in series.items() if any(topic.stamp)}
    if not stamps:
        return logs
    pace = max(stamps, key=lambda name: len(stamps[name]))
    shift = np.int64(np.median(stamps[pace] - logs[pace]))
    period = float(np.median(np.diff(np.sort(stamps[pace])))) if len(stamps[pace]) > 1 else 0.0
    shifted = {name: log + shift for name, log in logs.items() if name not in stamps}
    for name in shifted:
        if name in MEASURED_TOPICS:
            shifted[name] = snapped(shifted[name], np.sort(stamps[pace]), SNAP_FRACTION * period)
    return {**stamps, **shifted}


def snapped(times: NDArray[np.int64], stamps: NDArray[np.int64], reach: float) -> NDArray[np.int64]:
    """Times moved to the nearest stamp within reach."""
    after = np.clip(np.searchsorted(stamps, times), 1, max(len(stamps) - 1, 1))
    candidates = stamps[np.stack([after - 1, np.minimum(after, len(stamps) - 1)])]
    nearest = np.take_along_axis(candidates, np.abs(candidates - times).argmin(axis=0)[None], axis=0)[0]
    return np.where(np.abs(nearest - times) <= reach, nearest, times)


def columns_from_series(
    series: Mapping[str, TopicSeries], times: Mapping[str, NDArray[np.int64]], zero: int
) -> dict[str, Vector]:
    """All series on the union of their times, seconds after `zero`."""
    every = np.unique(np.concatenate([times[name] for name in series if name not in MODE_TOPICS]))
    columns: dict[str, Vector] = {}
    for name in (*MEASURED_TOPICS, *COMMAND_TOPICS):
        if name not in series:
            continue
        for column, values in series[name].values.items():
            if column in columns:
                continue
            filled = np.full(len(every), np.nan)
            at = np.searchsorted(every, times[name])
            known = (at < len(every)) & (every[np.minimum(at, len(every) - 1)] == times[name])
            order = slice(None, None, 1 if name in COMMAND_TOPICS else -1)  # at one time: the last command, the first sample
            filled[at[known][order]] = np.array(values)[known][order]
            columns[column] = filled
    columns['J_eq_W'] = hold_last_value(columns['J_eq_W'], 0.0)
    if 'T_E_K' in columns:
        given = columns['T_E_K'][~np.isnan(columns['T_E_K'])]
        columns['T_E_K'] = hold_last_value(columns['T_E_K'], given[0])
    columns['time_s'] = (every - zero) / 1e9
    return {name: columns[name] for name in COLUMN_ORDER if name in columns}


def hold_last_value(values: Vector, before: float) -> Vector:
    """Each gap filled with the value before it."""
    last = np.maximum.accumulate(np.where(np.isnan(values), -1, np.arange(len(values))))
    return np.where(last >= 0, values[np.maximum(last, 0)], before)
