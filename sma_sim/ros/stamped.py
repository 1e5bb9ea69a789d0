"""Messages with a header for topics whose messages have none, and the command with a stamp.

ROS has no stamped Float64. JointState names its numbers and is known to every tool: forces are its `effort`, the command is
the effort of the actuator `J_eq` (in W), states without a unit are its `position`. The names are those of the columns of
recordings, not of joints, so that no robot_state_publisher takes them for such. A temperature has a message of its own.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from rclpy.node import Node
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64, Float64MultiArray, Header

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.data.rosbag.commands import commanded_positions
from sma_sim.evidence.data.rosbag.interface import APPLIED, RESISTANCES, SINGLE_CHANNELS, STAMPED, interface_of
from sma_sim.model.structures.structure import Structure
from sma_sim.ros.command import Command
from sma_sim.ros.qos import LAST_FEW, make_subscription

SUFFIX = STAMPED
MAX_DELAYS = 10_000  # kept between two looks
LAST_DELAY, LARGEST_DELAY = 'delay of the last stamped command [s]', 'largest delay since the last report [s]'
NO_DELAY = 'none'


class Variant(NamedTuple):
    """The message type of a stamped variant, and what makes its message of a header and the message without one."""

    kind: Any
    make: Callable[[Header, Any], Any]


def efforts(*names: str) -> Variant:
    """Numbers as efforts; of a message with one number or an array."""
    return Variant(JointState, lambda header, message: JointState(header=header, name=names, effort=numbers_of(message)))


def positions(*names: str) -> Variant:
    """States as positions."""
    return Variant(JointState, lambda header, message: JointState(header=header, name=names, position=numbers_of(message)))


def numbers_of(message: Any) -> list[float]:
    """The numbers of a message with a field `data`."""
    return [float(message.data)] if isinstance(message, Float64) else [float(number) for number in message.data]


def celsius(header: Header, message: Float64) -> Temperature:
    """A temperature [K] in deg C."""
    return Temperature(header=header, temperature=message.data - ZERO_CELSIUS)


def variants_of(structure: Structure, resistances: bool = False) -> dict[str, Variant]:
    """The variants of a structure, by the topic without a header."""
    of = interface_of(structure)
    measured = {SINGLE_CHANNELS[channel]: positions(channel) for channel in of.channels}
    if of.joints:
        measured['wire_forces'] = efforts(*of.wire_columns('F'))
    if resistances:
        measured[RESISTANCES] = positions(*of.wire_columns('R'))
    return {
        **measured,
        'phase_fractions': positions(*of.wire_columns('x_M')),
        'wire_modes': positions(*of.wire_columns('mode')),
        f'{of.heating_topic}{APPLIED}': efforts(*of.commands),
        **{f'{drive}{APPLIED}': positions(drive) for drive in of.drives},
        'T_E_applied': Variant(Temperature, celsius),
    }


class StampedCommands:
    """Takes commands with a stamp [W], efforts of `J_eq` (or J_1, J_2, ...) in a JointState; measures how late they are."""

    def __init__(self, node: Node, command: Command, names: Sequence[str], now: Callable[[], int]) -> None:
        self._logger, self._command, self._names, self._now = node.get_logger(), command, tuple(names), now
        self._topic = f'{command.topic}{SUFFIX}'
        self._delays: deque[float] = deque(maxlen=MAX_DELAYS)  # [s], since the last look
        self._last = math.nan
        self.subscription = make_subscription(node, JointState, self._topic, self.receive, LAST_FEW)

    def receive(self, message: JointState) -> None:
        """Put the command in force, as one on `J_eq`; refuse a message without one."""
        J = commanded_efforts(message.name, message.effort, self._names)
        if J is None:
            expected = 'one effort [W] of' if len(self._names) == 1 else 'efforts [W] of'
            self._command.refuse(
                f'{self._topic} refused: expected {expected} {", ".join(self._names)}, got the names {list(message.name)} '
                f'and {len(message.effort)} efforts'
            )
            return
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        if stamp:
            self._delays.append((self._now() - stamp) / 1e9)
        self._command.receive(Float64(data=J[0]) if self._command.kind is Float64 else Float64MultiArray(data=J))

    def diagnostics(self) -> dict[str, str]:
        """The delay of the last command, and the largest since this was last asked for [s]."""
        delays = [self._delays.popleft() for _ in range(len(self._delays))]
        if delays:
            self._last = delays[-1]
        values = {LAST_DELAY: self._last, LARGEST_DELAY: max(delays, default=math.nan)}
        return {key: NO_DELAY if math.isnan(value) else f'{value:.4f}' for key, value in values.items()}


def commanded_efforts(names: Sequence[str], efforts: Sequence[float], wanted: Sequence[str]) -> list[float] | None:
    """The efforts of the wanted names, or those of a message without names; None where some are missing."""
    positions = commanded_positions(names, len(efforts), wanted)
    return None if positions is None else [float(efforts[at]) for at in positions]
