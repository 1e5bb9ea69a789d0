"""The command, the set points and the ambient temperature in force, and what was wrong with those that are not.

Messages may arrive in another thread, such as the executor's; the simulating thread asks what is in force at its steps.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import Temperature
from std_msgs.msg import Float64, Float64MultiArray

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.data.rosbag.commands import ambient_refusal, clipped, refusal
from sma_sim.evidence.data.rosbag.interface import PAIR_COMMAND, WIRE_COMMAND
from sma_sim.model.structures.structure import Drive, Structure

ENVIRONMENT = 'environment.T_E'
NO_COMMAND, IN_FORCE = 'none since the start', 'in force'  # states of the command
TIMED_OUT, TURNED_OFF = 'timed out', 'timed out, heating turned off'  # the former was zero already
WARNING_PERIOD = 2.0  # [s] between two warnings of one kind
MAX_SHOWN = 8  # numbers of a message that is refused
GUARDED_TIMEOUT = 0.1  # [s] of simulated time, node.command_timeout of a robot whose commands come from a guard


class Command:
    """The command that is in force; a bad one is refused or clipped, with a warning.

    The mailbox holds the latest command that has not come into force yet. The thread that receives only puts commands into
    it, the simulating thread only takes them out, each in one atomic operation; all else belongs to the simulating thread.
    So no command can be lost, whenever it arrives. `J_max` [W] and `timeout` [s] may be set at any time, by any thread.
    A command has a number [W] for each wire, or one of either sign (`signed`) for each antagonistic pair; that of a single
    pair is J_eq, a message with one number.
    """

    def __init__(
        self, node: Node, J_max: float, timeout: float, count: int = 1, signed: bool = True, topic: str = PAIR_COMMAND
    ) -> None:
        self._logger, self.J_max, self.timeout = node.get_logger(), J_max, timeout
        self.topic, self.kind = topic, Float64 if topic == PAIR_COMMAND else Float64MultiArray
        self._signed, self._off = signed, (0.0,) * count
        self._mailbox: deque[tuple[float, ...]] = deque(maxlen=1)
        self.rejected = 0
        self.refusal = ''  # the last one
        self.clipped = 0
        self.timeouts = 0
        self.state = NO_COMMAND
        self._turn_off()

    @property
    def size(self) -> int:
        """How many numbers a command has."""
        return len(self._off)

    def receive(self, message: Any) -> None:
        """Take a command, clipped to J_max; refuse one that cannot be meant as a whole."""
        J = self.accepted(message)
        if J is not None:
            self._mailbox.append(J)

    def refuse(self, reason: str) -> None:
        """Count a command that is refused, and warn of it."""
        self.rejected += 1
        self.refusal = reason
        self._logger.warning(f'{reason}; the last good command stays in force', throttle_duration_sec=WARNING_PERIOD)

    def accepted(self, message: Any) -> tuple[float, ...] | None:
        """The command [W] that a message asks for, clipped to J_max; None for one that is refused as a whole."""
        J, reason = asked_for(message, self.size, self._signed)
        if reason:
            self.refuse(f'{self.topic} = {shown(J)} W refused: {reason}')
            return None
        limited = self.limited(J)
        if limited != J:
            self.clipped += 1
            self._logger.warning(
                f'{self.topic} = {shown(J)} W clipped to node.J_max = {self.J_max:g} W', throttle_duration_sec=WARNING_PERIOD
            )
        return limited

    def limited(self, J: tuple[float, ...]) -> tuple[float, ...]:
        """The command, none of it beyond J_max."""
        return tuple(clipped(each, self.J_max) for each in J)

    def clear(self) -> None:
        """Forget the commands so far: heating is off until the next one."""
        self._mailbox.clear()
        self.state = NO_COMMAND
        self._turn_off()

    def advance_clock(self, seconds: float) -> None:
        """Simulated time is so much later (earlier where negative) from now on, without any time having passed [s]."""
        self._taken_at += seconds

    def at(self, t: float) -> tuple[float, ...]:
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


def asked_for(message: Any, count: int, signed: bool) -> tuple[tuple[float, ...], str]:
    """The heating [W] that a Float64 or Float64MultiArray asks for, and why a robot refuses it (`refusal`)."""
    if (layout := getattr(message, 'layout', None)) is None:
        J: tuple[float, ...] = (float(message.data),)
        return J, refusal(J, count, signed)
    J = tuple(map(float, message.data))
    return J, refusal(J, count, signed, [dimension.size for dimension in layout.dim], layout.data_offset)


def shown(numbers: tuple[float, ...]) -> str:
    """Numbers in a message."""
    return ', '.join(f'{number:g}' for number in numbers[:MAX_SHOWN]) + (', ...' if len(numbers) > MAX_SHOWN else '')


def heating_command(node: Node, structure: Structure, J_max: float, timeout: float) -> Command:
    """The command of a structure: J_eq of an antagonistic pair, else one number for each wire or pair."""
    topic = PAIR_COMMAND if structure.commands == (PAIR_COMMAND,) else WIRE_COMMAND
    return Command(node, J_max, timeout, len(structure.commands), structure.antagonistic, topic)


class SetPoint:
    """What is imposed beside heating, such as the strain of a wire on a test bench: the last value holds for ever.

    Before the first it is 0, a temperature that of the air, `T_E` [K].

    As of a command, a thread that receives only puts values into the mailbox, the simulating thread only takes them out.
    """

    def __init__(self, node: Node, drive: Drive, T_E: float) -> None:
        self.topic, self._logger, self._drive = drive.name, node.get_logger(), drive
        self.initial = min(max(T_E if drive.unit == 'K' else 0.0, drive.bounds[0]), drive.bounds[1])
        self.rejected, self.refusal = 0, ''
        self._mailbox: deque[float] = deque(maxlen=1)
        self.clear()

    def receive(self, message: Float64) -> None:
        """Take a value; refuse one out of range."""
        value = self.accepted(message)
        if value is not None:
            self._mailbox.append(value)

    def accepted(self, message: Float64) -> float | None:
        """The value that a message asks for, None for one out of range."""
        value, (low, high) = float(message.data), self._drive.bounds
        if low <= value <= high and math.isfinite(value):
            return value
        self.rejected += 1
        unit = self._drive.unit.removeprefix('-')
        self.refusal = (
            f'{self.topic} = {value:g} {unit}'.rstrip() + f' refused: expected {low:g} to {high:g} {unit}'.rstrip()
        )
        self._logger.warning(f'{self.refusal}; the last good value stays in force', throttle_duration_sec=WARNING_PERIOD)
        return None

    def clear(self) -> None:
        """Forget the values so far: as at the start, which the first step does not leave."""
        self._mailbox.clear()
        self._value, self._at_start = self.initial, True

    def take(self) -> float:
        """The value in force at the next step. The first step keeps that of the start: a replay begins there too."""
        if self._at_start:
            self._at_start = False
        elif self._mailbox:  # only this thread takes from it
            self._value = self._mailbox.pop()
        return self._value


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
        celsius = float(message.temperature)
        reason = ambient_refusal(celsius)
        if not reason:
            return celsius + ZERO_CELSIUS
        self.rejected += 1
        self._logger.warning(
            f'ambient_temperature = {celsius} deg C refused: {reason}', throttle_duration_sec=WARNING_PERIOD
        )
        return None

    def _set_parameter(self, kelvin: float) -> None:
        """Set the parameter, which has `apply` called; each change of it is an event on /parameter_events."""
        if kelvin != self.T_E:
            self._node.set_parameters([Parameter(ENVIRONMENT, Parameter.Type.DOUBLE, kelvin)])
