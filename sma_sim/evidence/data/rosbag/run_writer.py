"""Writes a run of any structure as one mcap file with the node's topics; log time is the run's time."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.data.rosbag.interface import (
    APPLIED,
    FLOAT64,
    FLOAT64_ARRAY,
    INTERFACE,
    JOINT_STATE,
    PAIR_COMMAND,
    RESISTANCES,
    SINGLE_CHANNELS,
    TEMPERATURE,
    UINT8_ARRAY,
    Interface,
    interface_of,
    known_interfaces,
)
from sma_sim.evidence.data.rosbag.writer import BagWriter, typestore
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.model.structures.structure import Structure

Message = tuple[str, str, Any]  # topic, message type, message
Samples = Iterator[tuple[int, str, str, Any]]


def write_mcap(path: Path, columns: Mapping[str, Vector], structure: Structure | None = None) -> None:
    """Write the columns of a run, (k,) each, whole or not at all; an existing file is kept. Raises UserError.

    Without `structure`, the columns tell which one it is.
    """
    if path.exists():
        raise UserError(f'{path} exists already and is not overwritten: give the bag another name')
    interface = interface_of_columns(columns) if structure is None else interface_of(structure)
    try:
        folder = Path(tempfile.mkdtemp(prefix=f'.{path.name}.', dir=path.parent))
    except OSError as error:
        raise UserError(f'cannot write {path}: {error.strerror}') from error
    try:
        bag = BagWriter(folder / 'run', {'epoch': '0', INTERFACE: interface.as_json()})
        numbers: dict[str, int] = {}
        for nanoseconds, topic, kind, message in messages_of(columns, interface):
            if topic not in numbers:
                numbers[topic] = bag.add(f'/{topic}', kind)
            bag.write(numbers[topic], nanoseconds, bytes(typestore().serialize_cdr(message, kind)))
        bag.close()
        (folder / 'run' / 'run_0.mcap').replace(path)
    except OSError as error:
        raise UserError(f'cannot write {path}: {error.strerror}') from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def interface_of_columns(columns: Collection[str]) -> Interface:
    """The interface of the structure whose input is there, that has the most of the columns, and the fewest others.

    Where no input is there, one of a name that begins alike is looked for: messages then say what is wrong with that.
    """
    names = set(columns)
    powers = [int(found.group(1)) for name in names if (found := re.fullmatch(r'J_(?:eq_)?(\d+)_W', name))]

    def fitness(one: Interface) -> tuple[bool, int, int, int]:
        known = len(names & set(one.columns))
        alike = max(len(stem) * any(name.startswith(stem) for name in names) for stem in (*one.drives, *one.commands))
        return names.issuperset(one.drives.values() or one.heating_columns), known, alike, -len(one.columns)

    return max(known_interfaces(max(powers, default=1)), key=fitness)


def messages_of(columns: Mapping[str, Vector], interface: Interface | None = None) -> Samples:
    """Time [ns], topic, message type and message, row by row; commands only where they change."""
    of = interface or interface_of_columns(columns)
    last: dict[str, Any] = {}
    for k, time in enumerate(columns['time_s']):
        nanoseconds = round(time * 1e9)
        row = {name: float(values[k]) for name, values in columns.items() if not np.isnan(values[k])}
        for topic, kind, value in imposed(row, of):
            if last.get(topic) != value:
                last[topic] = value
                message = typestore().types[FLOAT64](data=value) if kind == FLOAT64 else array(kind, value)
                yield nanoseconds, topic, kind, message
        for topic, kind, message in sample_messages(row, header_of(nanoseconds), of):
            yield nanoseconds, topic, kind, message


def imposed(row: Mapping[str, float], of: Interface) -> Iterator[Message]:
    """Topic, message type and numbers of what is in force in one row."""
    heating = tuple(row[name] for name in of.heating_columns if name in row)
    if of.heating_topic == PAIR_COMMAND and heating:
        yield f'{PAIR_COMMAND}{APPLIED}', FLOAT64, heating[0]
    elif len(heating) == len(of.heating_columns):
        yield f'{of.heating_topic}{APPLIED}', FLOAT64_ARRAY, heating
    for topic, column in {**of.drives, 'T_E': 'T_E_K'}.items():
        if column in row:
            yield f'{topic}{APPLIED}', FLOAT64, row[column]


def sample_messages(row: Mapping[str, float], header: Any, of: Interface) -> Iterator[Message]:
    """What was measured in one row."""
    types = typestore().types
    joints = [name for name, column in of.joints.items() if column in row]
    if joints:
        position = np.array([row[of.joints[name]] for name in joints])
        nothing = np.zeros(0)
        state = types[JOINT_STATE](header=header, name=joints, position=position, velocity=nothing, effort=nothing)
        yield 'joint_states', JOINT_STATE, state
    arrays = {'wire_forces': of.wire_columns('F', '_N')} if of.joints else {}
    arrays |= {SINGLE_CHANNELS[channel]: (column,) for channel, column in of.channels.items()}
    arrays |= {RESISTANCES: of.wire_columns('R', '_ohm')}
    arrays |= {'phase_fractions': of.wire_columns('x_M'), 'wire_modes': of.wire_columns('mode')}
    for topic, names in arrays.items():
        if all(name in row for name in names):
            kind = UINT8_ARRAY if topic == 'wire_modes' else FLOAT64_ARRAY
            yield topic, kind, array(kind, [row[name] for name in names])
    for i, name in enumerate(of.wire_columns('T', '_K')):
        if name in row:
            yield f'wire_{i + 1}/temperature', TEMPERATURE, types[TEMPERATURE](header, row[name] - ZERO_CELSIUS, 0.0)


def array(kind: str, numbers: Sequence[float]) -> Any:
    """A message of some numbers."""
    layout = typestore().types['std_msgs/msg/MultiArrayLayout'](dim=[], data_offset=0)
    dtype = np.uint8 if kind == UINT8_ARRAY else np.float64
    return typestore().types[kind](layout=layout, data=np.array(numbers, dtype=dtype))


def header_of(nanoseconds: int) -> Any:
    """A stamp without a frame."""
    types = typestore().types
    stamp = types['builtin_interfaces/msg/Time'](sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
    return types['std_msgs/msg/Header'](stamp=stamp, frame_id='')
