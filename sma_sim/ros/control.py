"""Services that pause, step and reset the simulation, and its diagnostics.

Services run in the executor's thread and only leave requests, which the simulating thread carries out between two steps. A
service whose request takes long awaits the answer as a coroutine of the executor, which goes on with other requests
meanwhile.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from concurrent.futures import wait as wait_for
from contextlib import suppress
from typing import Any, Protocol, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.task import Future as Awaitable
from std_srvs.srv import SetBool, Trigger

T = TypeVar('T')
DIAGNOSTICS_PERIOD = 1.0  # [s]
PROMPT = 2e-3  # [s] within which most requests are carried out; the executor's own way to wait takes longer
NOT_PAUSED = 'running: pause first (~/pause, std_srvs/SetBool)'


class Refused(Exception):
    """Why a request is not carried out."""


class Simulation(Protocol):
    """What carries out requests, in its own thread."""

    def make_steps(self, most: int) -> int:
        """Make some steps at once, at most so many; their number. A longer request is carried out in several rounds."""

    def reset(self, state: bool, time: bool) -> str:
        """The state of the start, time zero, or both; what was done, in words."""

    def end(self) -> str:
        """End the node."""


class Stepping:
    """A number of steps to make while the simulation is paused.

    `answer` says what was made, or raises Refused; `on_progress` is called in the simulating thread with the steps so far.
    """

    def __init__(self, steps: int, on_progress: Callable[[int], object] | None = None) -> None:
        self.steps, self.made, self.cancelled = steps, 0, False
        self.answer: Future[str] = Future()
        self._on_progress = on_progress

    def advance(self, simulation: Simulation) -> bool:
        """Make some of the steps; whether this is over."""
        if not self.cancelled and self.made < self.steps:
            self.made += simulation.make_steps(self.steps - self.made)
            if self._on_progress is not None:
                self._on_progress(self.made)
        if self.made >= self.steps:
            self.answer.set_result('one step made' if self.steps == 1 else f'{self.steps} steps made')
        elif self.cancelled:
            self.end('cancelled')
        return self.answer.done()

    def end(self, reason: str) -> None:
        """Make no more steps."""
        self.answer.set_exception(Refused(f'{reason}: {self.made} of {self.steps} steps made'))


class Control:
    """Whether the simulation is paused, and the requests that wait for it."""

    def __init__(self, node: Node, simulation: Simulation) -> None:
        self.paused = self.stopped = False  # stopped: paused at the start
        self.steps_per_call = 1
        self._node, self._simulation = node, simulation
        self._requests: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        self._steppings: deque[Stepping] = deque()
        self._requested = threading.Event()
        self._closed = ''
        # While a service waits for its answer, the executor takes the next message or request.
        self.callback_group = ReentrantCallbackGroup()
        for kind, name, callback in (
            (SetBool, '~/pause', self._pause),
            (Trigger, '~/step', self._step),
            (Trigger, '~/reset', self._reset),
        ):
            node.create_service(kind, name, callback, callback_group=self.callback_group)

    def ask(self, work: Callable[[], T]) -> Future[T]:
        """Have `work` done by the simulating thread; its answer, or the Refused that it raised."""
        answer: Future[T] = Future()
        self._requests.append((work, answer))
        self._wake()
        return answer

    def set_paused(self, paused: bool) -> bool:
        """Pause or go on; whether it was paused."""
        was, self.paused, self.stopped = self.paused, paused, False
        return was

    def ask_reset(self, state: bool = True, time: bool = True) -> Future[str]:
        """Return to the state of the start, to time zero, or both; steps that are still to be made are not."""

        def reset() -> str:
            self.refuse_steps('ended by a reset')
            return self._simulation.reset(state, time)

        return self.ask(reset)

    def ask_stop(self) -> Future[str]:
        """Pause and return to the start."""

        def stop() -> str:
            self.refuse_steps('stopped')
            answer = self._simulation.reset(True, True)
            self.paused = self.stopped = True
            return answer

        self.paused = True
        return self.ask(stop)

    def ask_end(self) -> Future[str]:
        """End the node."""
        return self.ask(self._simulation.end)

    def ask_steps(self, steps: int, on_progress: Callable[[int], object] | None = None) -> Stepping:
        """Have steps made after those that were asked for before. Raises Refused while the simulation is not paused."""
        if not self.paused:
            raise Refused(NOT_PAUSED)
        self.stopped = False
        stepping = Stepping(steps, on_progress)
        self._steppings.append(stepping)
        self._wake()
        return stepping

    async def done(self, answer: Future[str]) -> None:
        """Return when a request is carried out or refused, for a callback of the node's executor to await."""
        if not wait_for([answer], PROMPT).done:
            await self._awaitable(answer)

    def _awaitable(self, answer: Future[str]) -> Awaitable[Future[str]]:
        """`answer` once it is done."""
        executor: Executor | None = self._node.executor
        made: Awaitable[Future[str]] = Awaitable(executor=executor)
        made.add_done_callback(lambda _: None)  # a task for the executor, which wakes it
        answer.add_done_callback(made.set_result)
        return made

    def wait(self, longest: float) -> None:
        """Return when a request arrives, after `longest` seconds at the latest."""
        self._requested.wait(longest)
        self._requested.clear()

    def carry_out(self) -> bool:
        """Carry out the oldest request, or some of the steps that are to be made; whether there was anything to do."""
        if self._requests:
            work, answer = self._requests.popleft()
            try:
                answer.set_result(work())
            except Refused as error:
                answer.set_exception(error)
            except BaseException as error:  # ends the node
                answer.set_exception(Refused(str(error)))
                raise
        elif self._steppings:
            if self._steppings[0].advance(self._simulation):
                self._steppings.popleft()
        else:
            return False
        return True

    def refuse_steps(self, reason: str) -> None:
        """Make none of the steps that are still to be made."""
        with suppress(IndexError):  # none is left: at the end of the node two threads may take them
            while True:
                self._steppings.popleft().end(reason)

    def close(self) -> None:
        """Refuse what waits and what is still to come: the simulating thread has ended."""
        self._closed = 'the node is ending'
        self._refuse_all()

    def _wake(self) -> None:
        self._requested.set()
        if self._closed:  # looked at after the request was left: close() refuses it, or this does
            self._refuse_all()

    def _refuse_all(self) -> None:
        self.refuse_steps(self._closed)
        with suppress(IndexError):
            while True:
                self._requests.popleft()[1].set_exception(Refused(self._closed))

    def _pause(self, request: Any, response: Any) -> Any:
        was = self.set_paused(bool(request.data))
        words = ('running', 'paused')
        response.success = True
        response.message = f'{words[self.paused]} (as before)' if was == self.paused else words[self.paused]
        return response

    async def _step(self, _: Any, response: Any) -> Any:
        try:
            answer = self.ask_steps(self.steps_per_call).answer
        except Refused as error:
            response.success, response.message = False, str(error)
            return response
        return await self.answered(answer, response)

    async def _reset(self, _: Any, response: Any) -> Any:
        return await self.answered(self.ask_reset(), response)

    async def answered(self, answer: Future[str], response: Any) -> Any:
        """The response (of std_srvs/Trigger) with the answer, once there is one."""
        await self.done(answer)
        error = answer.exception()
        response.success, response.message = error is None, answer.result() if error is None else str(error)
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
