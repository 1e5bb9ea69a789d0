"""The command and the ambient temperature in force, and what was wrong with those that are not.

Messages may arrive in another thread, such as the executor's; the simulating thread asks what is in force at its steps.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import Temperature
from std_msgs.msg import Float64

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.data.rosbag.commands import clipped, refusal
from sma_sim.evidence.data.rosbag.interface import PAIR_COMMAND
from sma_sim.model.parameters import DEFAULTS

ENVIRONMENT = 'environment.T_E'
NO_COMMAND, IN_FORCE = 'none since the start', 'in force'  # states of the command
TIMED_OUT, TURNED_OFF = 'timed out', 'timed out, heating turned off'  # the former was zero already
WARNING_PERIOD = 2.0  # [s] between two warnings of one kind
GUARDED_TIMEOUT = 0.15  # [s] of simulated time, node.command_timeout of a robot whose commands come from a guard


class Command:
    """The command that is in force; a bad one is refused or clipped, with a warning.

    The mailbox holds the latest command that has not come into force yet. The thread that receives only puts commands into
    it, the simulating thread only takes them out, each in one atomic operation; all else belongs to the simulating thread.
    So no command can be lost, whenever it arrives. `J_max` [W] and `timeout` [s] may be set at any time, by any thread.
    This one is J_eq, which heats either wire of an antagonistic pair.
    """

    topic: str = PAIR_COMMAND
    kind: Any = Float64

    def __init__(self, node: Node, J_max: float, timeout: float, off: Any = 0.0) -> None:
        self._logger, self.J_max, self.timeout, self._off = node.get_logger(), J_max, timeout, off
        self._mailbox: deque[Any] = deque(maxlen=1)
        self.rejected = 0
        self.refusal = ''  # the last one
        self.clipped = 0
        self.timeouts = 0
        self.state = NO_COMMAND
        self._turn_off()

    @property
    def size(self) -> int:
        """How many numbers a command has."""
        return 1 if isinstance(self._off, float) else len(self._off)

    def receive(self, message: Any) -> None:
        """Take a command, clipped to J_max; refuse one that is not a finite number."""
        J = self.accepted(message)
        if J is not None:
            self._mailbox.append(J)

    def refuse(self, reason: str) -> None:
        """Count a command that is refused, and warn of it."""
        self.rejected += 1
        self.refusal = reason
        self._logger.warning(f'{reason}; the last good command stays in force', throttle_duration_sec=WARNING_PERIOD)

    def accepted(self, message: Any) -> Any:
        """The command [W] that a message asks for, clipped to J_max; None for one that is not a finite number."""
        J_eq = float(message.data)
        if reason := refusal([J_eq], 1, signed=True):
            self.refuse(f'J_eq = {J_eq} W refused: {reason}')
            return None
        if abs(J_eq) > self.J_max:
            self.clipped += 1
            self._logger.warning(
                f'J_eq = {J_eq:g} W clipped to node.J_max = {self.J_max:g} W', throttle_duration_sec=WARNING_PERIOD
            )
        return self.limited(J_eq)

    def limited(self, J: Any) -> Any:
        """The command, not beyond J_max."""
        return clipped(J, self.J_max)

    def clear(self) -> None:
        """Forget the commands so far: heating is off until the next one."""
        self._mailbox.clear()
        self.state = NO_COMMAND
        self._turn_off()

    def advance_clock(self, seconds: float) -> None:
        """Simulated time is so much later (earlier where negative) from now on, without any time having passed [s]."""
        self._taken_at += seconds

    def at(self, t: float) -> Any:
        """The command in force [W] at simulated time t [s]; zero after `timeout` seconds without one."""
        if self._mailbox:  # only this thread takes from it, so there is still one below
            self._J, self._taken_at = self._mailbox.pop(), t
            self.state = IN_FORCE
        elif self.timeout > 0.0 and t - self._taken_at > self.timeout:
            self._logger.warning(
                f'no command for node.command_timeout = {self.timeout:g} s: heating is off until the next one'
            )
            self.state = TURNED_OFF if self._off != self._J else TIMED_OUT
            self.timeouts += 1
            self._turn_off()
        self._J = self.limited(self._J)  # J_max may have been lowered since
        return self._J

    def _turn_off(self) -> None:
        self._J, self._taken_at = self._off, math.inf


class Ambient:
    """The ambient temperature T_E [K] in force, which the parameter environment.T_E always shows."""

    def __init__(self, node: Node, T_E: float) -> None:
        self._node, self._logger = node, node.get_logger()
        self.T_E = self._initial = T_E
        self.rejected = 0

    def receive(self, message: Temperature) -> None:
        """Take a temperature in deg C; refuse one out of range."""
        T_E = self.accepted(message)
        if T_E is not None:
            self._set_parameter(T_E)

    def reset(self) -> None:
        """The temperature of the start again."""
        self._set_parameter(self._initial)

    def apply(self) -> None:
        """Take the parameter's value. It is read here, so that what is set last is in force, from whichever thread."""
        self.T_E = float(self._node.get_parameter(ENVIRONMENT).value)

    def accepted(self, message: Temperature) -> float | None:
        """The temperature [K] that a message tells, None for one out of range."""
        low, high = DEFAULTS[ENVIRONMENT].bounds
        kelvin = float(message.temperature) + ZERO_CELSIUS
        if low <= kelvin <= high:
            return kelvin
        self.rejected += 1
        self._logger.warning(
            f'ambient_temperature = {message.temperature} deg C refused: expected {low - ZERO_CELSIUS:g} to '
            f'{high - ZERO_CELSIUS:g} deg C',
            throttle_duration_sec=WARNING_PERIOD,
        )
        return None

    def _set_parameter(self, kelvin: float) -> None:
        """Set the parameter, which has `apply` called; each change of it is an event on /parameter_events."""
        if kelvin != self.T_E:
            self._node.set_parameters([Parameter(ENVIRONMENT, Parameter.Type.DOUBLE, kelvin)])
