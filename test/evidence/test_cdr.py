"""Messages that are decoded together are those that rosbags decodes one by one."""

from __future__ import annotations

import numpy as np
import pytest

from sma_sim.evidence.data.rosbag.cdr import decoded_together
from sma_sim.evidence.data.rosbag.interface import FLOAT64, FLOAT64_ARRAY, JOINT_STATE, TEMPERATURE, UINT8_ARRAY
from sma_sim.evidence.data.rosbag.writer import typestore


def message(kind, **fields):
    return typestore().types[kind](**fields)


def header(rng, frame):
    stamp = message('builtin_interfaces/msg/Time', sec=int(rng.integers(2**31)), nanosec=int(rng.integers(10**9)))
    return message('std_msgs/msg/Header', stamp=stamp, frame_id=frame)


def layout(rng, labels):
    kind = 'std_msgs/msg/MultiArrayDimension'
    dims = [message(kind, label=label, size=int(rng.integers(9)), stride=int(rng.integers(9))) for label in labels]
    return message('std_msgs/msg/MultiArrayLayout', dim=dims, data_offset=int(rng.integers(9)))


def some_messages(kind, rng):
    """Messages of one kind whose texts and lengths differ here and there."""
    for _ in range(60):
        count, words = int(rng.integers(4)), rng.permutation(['', 'a', 'wire_1', 'forces'])
        if kind == FLOAT64:
            yield message(kind, data=rng.normal())
        elif kind == TEMPERATURE:
            yield message(kind, header=header(rng, words[0]), temperature=rng.normal(), variance=rng.normal())
        elif kind == JOINT_STATE:
            numbers = {name: rng.normal(size=count) for name in ('position', 'velocity', 'effort')}
            numbers['effort'] = numbers['effort'][:1]
            yield message(kind, header=header(rng, words[0]), name=list(words[:count]), **numbers)
        else:
            whole = kind == UINT8_ARRAY
            data = rng.integers(256, size=count).astype(np.uint8) if whole else rng.normal(size=count)
            yield message(kind, layout=layout(rng, words[: int(rng.integers(3))]), data=data)


def same(together, i, single):
    """Whether entry i of what stands for a group is a message."""
    if isinstance(single, str):
        return together == single
    if isinstance(single, list):
        return len(together) == len(single) and all(same(a, i, b) for a, b in zip(together, single, strict=True))
    if isinstance(single, np.ndarray):
        return len(together) == len(single) and np.array_equal(together[:, i], single)
    if hasattr(single, '__dataclass_fields__'):
        names = [name for name in single.__dataclass_fields__ if name != '__msgtype__']
        return all(same(getattr(together, name), i, getattr(single, name)) for name in names)
    return together[i] == single


@pytest.mark.parametrize('little_endian', [True, False])
@pytest.mark.parametrize('kind', [FLOAT64, FLOAT64_ARRAY, UINT8_ARRAY, JOINT_STATE, TEMPERATURE])
def test_messages_decoded_together_are_those_decoded_one_by_one(kind, little_endian):
    singles = list(some_messages(kind, np.random.default_rng(5)))
    raw = [bytes(typestore().serialize_cdr(single, kind, little_endian=little_endian)) for single in singles]
    seen = []
    for at, together in decoded_together(raw, kind):
        for i, index in enumerate(at):
            assert same(together, i, singles[index]), (kind, index)
        seen.extend(at)
    assert sorted(seen) == list(range(len(singles)))


def test_a_message_that_is_none_of_the_type_is_named():
    good = bytes(typestore().serialize_cdr(message(FLOAT64, data=1.0), FLOAT64))
    for broken in (good[:-1], good + bytes(9), good[:2], b'\x07\x07' + good[2:]):
        with pytest.raises(ValueError, match='^1$'):
            list(decoded_together([good, broken, good], FLOAT64))
    array = message(FLOAT64_ARRAY, layout=layout(np.random.default_rng(0), []), data=np.ones(2))
    endless = bytearray(typestore().serialize_cdr(array, FLOAT64_ARRAY))
    endless[12:16] = b'\xff' * 4  # a length of four thousand million
    with pytest.raises(ValueError, match='^0$'):
        list(decoded_together([bytes(endless)], FLOAT64_ARRAY))
