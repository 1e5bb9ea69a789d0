"""Services that pause, step and reset the simulation, and its diagnostics.

They run in the executor's thread and only leave wishes, which the simulating thread fulfils between two steps.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

DIAGNOSTICS_PERIOD = 1.0  # [s]
PATIENCE = 5.0  # [s] that a service waits for the simulating thread


class Control:
    """What was asked of the simulation."""

    def __init__(self, node: Node) -> None:
        self.paused = False
        self._wish, self._done = '', threading.Event()
        node.create_service(SetBool, '~/pause', self._pause)
        node.create_service(Trigger, '~/step', self._step)
        node.create_service(Trigger, '~/reset', self._reset)

    def take_wish(self) -> str:
        """`step`, `reset` or nothing; call `fulfil` afterwards."""
        return self._wish

    def fulfil(self) -> None:
        """Say that the wish came true."""
        self._wish = ''
        self._done.set()

    def _pause(self, request: Any, response: Any) -> Any:
        was, self.paused = self.paused, bool(request.data)
        words = ('running', 'paused')
        response.success = True
        response.message = f'{words[self.paused]} (as before)' if was == self.paused else words[self.paused]
        return response

    def _step(self, _: Any, response: Any) -> Any:
        if not self.paused:
            response.success, response.message = False, 'running: pause first (~/pause, std_srvs/SetBool)'
            return response
        return self._ask('step', 'one step made', response)

    def _reset(self, _: Any, response: Any) -> Any:
        return self._ask('reset', 'at the start again, heating off until the next command', response)

    def _ask(self, wish: str, done: str, response: Any) -> Any:
        self._done.clear()
        self._wish = wish
        response.success = self._done.wait(PATIENCE)
        self._wish = ''
        response.message = done if response.success else f'the simulation did not answer within {PATIENCE:g} s'
        return response


class Diagnostics:
    """A status on /diagnostics."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._topic = node.create_publisher(DiagnosticArray, '/diagnostics', 10)

    def publish(self, message: str, warn: bool, values: Mapping[str, Any]) -> None:
        """One status with its values."""
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if warn else DiagnosticStatus.OK,
            name=self._node.get_fully_qualified_name(),
            message=message,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._topic.publish(array)
