"""Messages with a header for topics whose messages have none, and the command with a stamp.

ROS has no stamped Float64. JointState names its numbers and is known to every tool: forces are its `effort`, the command is
the effort of the actuator `J_eq` (in W), states without a unit are its `position`. The names are those of the columns of
recordings, not of joints, so that no robot_state_publisher takes them for such. A temperature has a message of its own.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from rclpy.node import Node
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64, Header

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.ros.command import WARNING_PERIOD, Command
from sma_sim.ros.qos import LAST_FEW, make_subscription

COMMAND = 'J_eq'
STAMPED_COMMAND = 'J_eq_stamped'
SUFFIX = '_stamped'
MOST_DELAYS = 10_000  # kept between two looks
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


VARIANTS: Mapping[str, Variant] = {  # by the topic without a header
    'wire_forces': efforts('F_1', 'F_2'),
    'phase_fractions': positions('x_M_1', 'x_M_2'),
    'wire_modes': positions('mode_1', 'mode_2'),
    'J_eq_applied': efforts(COMMAND),
    'T_E_applied': Variant(
        Temperature, lambda header, message: Temperature(header=header, temperature=message.data - ZERO_CELSIUS)
    ),
}


class StampedCommands:
    """Takes commands with a stamp [W], the effort of `J_eq` in a JointState, and measures how late they are."""

    def __init__(self, node: Node, command: Command, now: Callable[[], int]) -> None:
        self._logger, self._command, self._now = node.get_logger(), command, now
        self._delays: deque[float] = deque(maxlen=MOST_DELAYS)  # [s], since the last look
        self._last = math.nan
        self.subscription = make_subscription(node, JointState, STAMPED_COMMAND, self.receive, LAST_FEW)

    def receive(self, message: JointState) -> None:
        """Put the command in force, as one on `J_eq`; refuse a message without one."""
        J_eq = commanded_effort(message.name, message.effort)
        if J_eq is None:
            self._command.rejected += 1
            self._logger.warning(
                f'{STAMPED_COMMAND} refused: expected one effort [W] of {COMMAND}, got the names {list(message.name)} and '
                f'{len(message.effort)} efforts; the last good command stays in force',
                throttle_duration_sec=WARNING_PERIOD,
            )
            return
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        if stamp:
            self._delays.append((self._now() - stamp) / 1e9)
        self._command.receive(Float64(data=J_eq))

    def diagnostics(self) -> dict[str, str]:
        """The delay of the last command, and the largest since this was last asked for [s]."""
        delays = [self._delays.popleft() for _ in range(len(self._delays))]
        if delays:
            self._last = delays[-1]
        values = {LAST_DELAY: self._last, LARGEST_DELAY: max(delays, default=math.nan)}
        return {key: NO_DELAY if math.isnan(value) else f'{value:.4f}' for key, value in values.items()}


def commanded_effort(names: Sequence[str], efforts: Sequence[float]) -> float | None:
    """The effort of `J_eq`, or the only one of a message without names; None where there is none."""
    if not names and len(efforts) == 1:
        return float(efforts[0])
    if COMMAND in names and len(efforts) == len(names):
        return float(efforts[list(names).index(COMMAND)])
    return None
