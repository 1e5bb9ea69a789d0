"""Commands of structures other than an antagonistic pair: the heating of every wire, and set points of what is imposed."""

from __future__ import annotations

import math
from collections import deque

from rclpy.node import Node
from std_msgs.msg import Float64, Float64MultiArray

from sma_sim.evidence.data.rosbag.commands import clipped, refusal
from sma_sim.evidence.data.rosbag.interface import PAIR_COMMAND, WIRE_COMMAND
from sma_sim.model.structures.structure import Drive, Structure
from sma_sim.ros.command import WARNING_PERIOD, Command

MAX_SHOWN = 8  # numbers of a message that is refused


class WireCommands(Command):
    """The heating of every wire [W] that is in force, one number each, not negative; else as `Command`.

    Of antagonistic pairs in series one number for each pair, of either sign.
    """

    topic, kind = WIRE_COMMAND, Float64MultiArray

    def __init__(self, node: Node, J_max: float, timeout: float, count: int, signed: bool = False) -> None:
        self._count, self._signed = count, signed
        super().__init__(node, J_max, timeout, (0.0,) * count)

    def accepted(self, message: Float64MultiArray) -> tuple[float, ...] | None:
        """The heating [W] that a message asks for, clipped to J_max; None for one that is refused as a whole."""
        J = tuple(map(float, message.data))
        reason = self._wrong(J, message)
        if reason:
            self.refuse(reason)
            return None
        if self.limited(J) != J:
            self.clipped += 1
            self._logger.warning(
                f'J = {shown(J)} W clipped to node.J_max = {self.J_max:g} W', throttle_duration_sec=WARNING_PERIOD
            )
        return self.limited(J)

    def limited(self, J: tuple[float, ...]) -> tuple[float, ...]:
        """The heating, none of it above J_max."""
        return tuple(clipped(each, self.J_max) for each in J)

    def _wrong(self, J: tuple[float, ...], message: Float64MultiArray) -> str:
        """What is wrong with a message; empty where nothing is."""
        layout = message.layout
        reason = refusal(J, self._count, self._signed, [dimension.size for dimension in layout.dim], layout.data_offset)
        return f'J = {shown(J)} W refused: {reason}' if reason else ''


def shown(numbers: tuple[float, ...]) -> str:
    """Numbers in a message."""
    return ', '.join(f'{number:g}' for number in numbers[:MAX_SHOWN]) + (', ...' if len(numbers) > MAX_SHOWN else '')


def heating_command(node: Node, structure: Structure, J_max: float, timeout: float) -> Command:
    """The command of a structure: J_eq of an antagonistic pair, else one number for each wire or pair."""
    if structure.commands == (PAIR_COMMAND,):
        return Command(node, J_max, timeout)
    return WireCommands(node, J_max, timeout, len(structure.commands), structure.antagonistic)


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
