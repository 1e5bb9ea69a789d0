"""What acts on the simulated structure: heating, set points, the ambient temperature; and which of them are applied."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64

from sma_sim.evidence.data.rosbag.interface import AMBIENT, APPLIED
from sma_sim.model.config import Config
from sma_sim.ros.command import Ambient, SetPoint, heating_command
from sma_sim.ros.inbox import Inbox
from sma_sim.ros.messages import Messages
from sma_sim.ros.publishers import Publishers
from sma_sim.ros.qos import LAST_FEW, make_subscription
from sma_sim.ros.stamped import SUFFIX, StampedCommands


class Inputs:
    """The input of a run, step by step; what is applied is published when it changes."""

    def __init__(self, node: Node, config: Config, publishers: Publishers, messages: Messages) -> None:
        structure, numbers = config.structure, config.parameters
        self.command = heating_command(node, structure, numbers['node.J_max'], numbers['node.command_timeout'])
        self.ambient = Ambient(node, numbers['environment.T_E'])
        self.set_points = [SetPoint(node, drive, numbers['environment.T_E']) for drive in structure.drives]
        self._publishers, self._messages = publishers, messages
        self._heating_applied = f'{self.command.topic}{APPLIED}'
        self._points: list[float] = []
        self._names = structure.commands
        self.forget()

    def subscribe(self, node: Node, inbox: Inbox, now: Callable[[], int]) -> None:
        """Listen to the topics; `now` tells the time [ns] with which stamps of commands compare."""
        command = self.command
        inbox.add(make_subscription(node, command.kind, command.topic, command.receive, LAST_FEW))
        for point in self.set_points:
            inbox.add(make_subscription(node, Float64, point.topic, point.receive, LAST_FEW))
        make_subscription(node, Temperature, AMBIENT, self.ambient.receive, LAST_FEW)
        self.stamped = StampedCommands(node, command, self._names, now)
        inbox.add(self.stamped.subscription)

    @property
    def topics(self) -> dict[str, Any]:
        """Message types of the topics that are heard, by name."""
        points = {point.topic: Float64 for point in self.set_points}
        return {
            **dict(zip(self.command_topics, (self.command.kind, JointState), strict=True)),
            AMBIENT: Temperature,
            **points,
        }

    @property
    def command_topics(self) -> tuple[str, str]:
        """The topics of the heating, without a stamp and with one."""
        return self.command.topic, f'{self.command.topic}{SUFFIX}'

    @property
    def at_start(self) -> NDArray[np.float64]:
        """The input at the start: without heating, in the ambient temperature of now."""
        points = [point.initial for point in self.set_points]
        return np.array([*points, *([0.0] * self.command.size), self.ambient.T_E])

    @property
    def now(self) -> NDArray[np.float64]:
        """The input of the last step, in the ambient temperature of now."""
        return np.array([*self.vector[:-1], self.ambient.T_E])

    def clear(self) -> None:
        """Forget commands and set points."""
        self.command.clear()
        for point in self.set_points:
            point.clear()

    def forget(self) -> None:
        """Publish what is applied at the next step, whether it changes or not."""
        self._applied: tuple[float, ...] | None = None
        self._applied_T_E = math.nan
        self._applied_points = [math.nan] * len(self.set_points)
        self.vector = self.at_start

    def apply(self, t: float, stamp: int, now: int) -> None:
        """Renew `vector`, the input of the step at time t [s]; publish what has changed with a stamp and a log time [ns]."""
        J, T_E = self.command.at(t), self.ambient.T_E
        points = [point.take() for point in self.set_points] if self.set_points else self._points
        send, changed = self._publishers.send_with_variant, False
        if self._applied != J:
            self._applied, changed = J, True
            send(self._heating_applied, stamp, now, self._heating_message())
        if self._applied_T_E != T_E:
            self._applied_T_E, changed = T_E, True
            send('T_E_applied', stamp, now, Float64(data=T_E))
        for k, value in enumerate(points):
            if value != self._applied_points[k]:
                self._applied_points[k], changed = value, True
                send(f'{self.set_points[k].topic}{APPLIED}', stamp, now, Float64(data=value))
        if changed:
            self.vector = np.array([*points, *J, T_E])

    def record(self, now: int) -> None:
        """Write what is applied to a bag that begins, with the log time [ns]."""
        if self._applied is None:
            return
        self._publishers.record(self._heating_applied, now, self._heating_message())
        self._publishers.record('T_E_applied', now, Float64(data=self._applied_T_E))
        for point, value in zip(self.set_points, self._applied_points, strict=True):
            self._publishers.record(f'{point.topic}{APPLIED}', now, Float64(data=value))

    @property
    def values(self) -> dict[str, Any]:
        """What diagnostics tell of the input."""
        command, points = self.command, self.set_points
        numbers = self._applied or (math.nan,)
        values = {
            'command': command.state,
            'command timeouts': command.timeouts,
            **self.stamped.diagnostics(),
            'rejected commands': command.rejected + sum(point.rejected for point in points),
            'clipped commands': command.clipped,
            'rejected ambient temperatures': self.ambient.rejected,
            f'{command.topic} applied [W]': ', '.join(f'{number:g}' for number in numbers),
        }
        for point, value in zip(points, self._applied_points, strict=True):
            values[f'{point.topic} applied'] = f'{value:g}'
        if command.kind is not Float64 or points:
            refusals = [refusal for refusal in (command.refusal, *(point.refusal for point in points)) if refusal]
            values['last refused command'] = '; '.join(refusals) or 'none'
        return values

    def _heating_message(self) -> Any:
        J = self._applied or ()
        return Float64(data=J[0]) if self.command.kind is Float64 else self._messages.heating(J)
