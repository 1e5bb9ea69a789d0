"""Services that pause, step and reset the simulation, and its diagnostics.

Services run in the executor's thread and only leave requests, which the simulating thread carries out between two steps.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

DIAGNOSTICS_PERIOD = 1.0  # [s]
RESET_DONE = 'everything as at the start, the ambient temperature too; heating off until the next command'
SERVICE_TIMEOUT = 5.0  # [s] that a service waits for the simulating thread


@dataclass(eq=False)
class Request:
    """What a service asks of the simulating thread (`step` or `reset`), which sets `done` afterwards.

    `refused` says why it was not carried out.
    """

    action: str
    refused: str = ''
    done: threading.Event = field(default_factory=threading.Event)


class Control:
    """Whether the simulation is paused, and the requests that wait for it."""

    def __init__(self, node: Node) -> None:
        self.paused = False
        self._requests: deque[Request] = deque()
        self._requested = threading.Event()
        node.create_service(SetBool, '~/pause', self._pause)
        node.create_service(Trigger, '~/step', self._step)
        node.create_service(Trigger, '~/reset', self._reset)

    def next_request(self) -> Request | None:
        """The oldest request that waits, which the caller must carry out; None where there is none."""
        return self._requests.popleft() if self._requests else None

    def wait(self, longest: float) -> None:
        """Return when a request arrives, after `longest` seconds at the latest."""
        self._requested.wait(longest)
        self._requested.clear()

    def refuse_requests(self, reason: str) -> None:
        """Answer the requests that wait, at a time when none can be carried out."""
        while (request := self.next_request()) is not None:
            request.refused = reason
            request.done.set()

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
        return self._ask('reset', RESET_DONE, response)

    def _ask(self, action: str, answer: str, response: Any) -> Any:
        request = Request(action)
        self._requests.append(request)
        self._requested.set()
        answered = request.done.wait(SERVICE_TIMEOUT)
        response.success = answered and not request.refused
        with suppress(ValueError):  # nobody took it
            self._requests.remove(request)
        if response.success:
            response.message = answer
        else:
            response.message = request.refused or f'the simulation did not answer within {SERVICE_TIMEOUT:g} s'
        return response


class Diagnostics:
    """A status on /diagnostics; `hardware_id` says what it is about."""

    def __init__(self, node: Node, hardware_id: str) -> None:
        self._node, self._hardware_id = node, hardware_id
        self._topic = node.create_publisher(DiagnosticArray, '/diagnostics', 10)

    def publish(self, message: str, warn: bool, values: Mapping[str, Any]) -> None:
        """One status with its values."""
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if warn else DiagnosticStatus.OK,
            name=self._node.get_fully_qualified_name(),
            message=message,
            hardware_id=self._hardware_id,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._topic.publish(array)
