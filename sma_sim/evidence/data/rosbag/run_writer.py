"""Writes a run of a module as one mcap file with the node's topics; log time is the run's time."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.data.rosbag.reader import (
    FLOAT64,
    FLOAT64_ARRAY,
    JOINT_STATE,
    POSE_COLUMNS,
    TEMPERATURE,
    UINT8_ARRAY,
)
from sma_sim.evidence.data.rosbag.writer import BagWriter, typestore
from sma_sim.model.errors import UserError

Vector = NDArray[np.float64]
PAIR_TOPICS = {'wire_forces': 'F', 'phase_fractions': 'x_M', 'wire_modes': 'mode'}
PAIR_SUFFIXES = {'F': '_N', 'x_M': '', 'mode': ''}
Message = tuple[str, str, Any]  # topic, message type, message


def write_mcap(path: Path, columns: Mapping[str, Vector]) -> None:
    """Write the columns of a module's run, (k,) each, whole or not at all; an existing file is kept. Raises UserError."""
    if path.exists():
        raise UserError(f'{path} exists already and is not overwritten: give the bag another name')
    try:
        folder = Path(tempfile.mkdtemp(prefix=f'.{path.name}.', dir=path.parent))
    except OSError as error:
        raise UserError(f'cannot write {path}: {error.strerror}') from error
    try:
        bag = BagWriter(folder / 'run', {'epoch': '0'})
        numbers: dict[str, int] = {}
        for nanoseconds, topic, kind, message in messages_of(columns):
            if topic not in numbers:
                numbers[topic] = bag.add(f'/{topic}', kind)
            bag.write(numbers[topic], nanoseconds, bytes(typestore().serialize_cdr(message, kind)))
        bag.close()
        (folder / 'run' / 'run_0.mcap').replace(path)
    except OSError as error:
        raise UserError(f'cannot write {path}: {error.strerror}') from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def messages_of(columns: Mapping[str, Vector]) -> Iterator[tuple[int, str, str, Any]]:
    """Time [ns], topic, message type and message, row by row; commands only where they change."""
    held = {'J_eq_applied': 'J_eq_W', 'T_E_applied': 'T_E_K'}
    last: dict[str, float] = {}
    number = typestore().types[FLOAT64]
    for k, time in enumerate(columns['time_s']):
        nanoseconds = round(time * 1e9)
        row = {name: float(values[k]) for name, values in columns.items() if not np.isnan(values[k])}
        for topic, column in held.items():
            if column in row and last.get(topic) != row[column]:
                last[topic] = row[column]
                yield nanoseconds, topic, FLOAT64, number(data=row[column])
        for topic, kind, message in sample_messages(row, header_of(nanoseconds)):
            yield nanoseconds, topic, kind, message


def sample_messages(row: Mapping[str, float], header: Any) -> Iterator[Message]:
    """What was measured in one row."""
    types = typestore().types
    joints = [name for name, column in POSE_COLUMNS.items() if column in row]
    if joints:
        position = np.array([row[POSE_COLUMNS[name]] for name in joints])
        nothing = np.zeros(0)
        state = types[JOINT_STATE](header=header, name=joints, position=position, velocity=nothing, effort=nothing)
        yield 'joint_states', JOINT_STATE, state
    for topic, name in PAIR_TOPICS.items():
        pair = [row.get(f'{name}_{wire}{PAIR_SUFFIXES[name]}', np.nan) for wire in (1, 2)]
        if not np.isnan(pair).any():
            kind, dtype = (UINT8_ARRAY, np.uint8) if topic == 'wire_modes' else (FLOAT64_ARRAY, np.float64)
            layout = types['std_msgs/msg/MultiArrayLayout'](dim=[], data_offset=0)
            yield topic, kind, types[kind](layout=layout, data=np.array(pair, dtype=dtype))
    for wire in (1, 2):
        if f'T_{wire}_K' in row:
            degrees = row[f'T_{wire}_K'] - ZERO_CELSIUS
            yield f'wire_{wire}/temperature', TEMPERATURE, types[TEMPERATURE](header, degrees, 0.0)


def header_of(nanoseconds: int) -> Any:
    """A stamp without a frame."""
    types = typestore().types
    stamp = types['builtin_interfaces/msg/Time'](sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
    return types['std_msgs/msg/Header'](stamp=stamp, frame_id='')
