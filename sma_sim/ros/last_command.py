"""A program that commands a robot: whatever stops it, the last that it publishes is zero."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, NamedTuple

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions

from sma_sim.ros.stop_signals import Handlers, give_back, ignore_at_exit, take_stop_signals
from sma_sim.ros.transport import prefer_udp

SPIN_PERIOD = 0.1  # [s] between two looks for a signal
CONFIRMATION = 5.0  # [s] for the listeners to confirm the last message; DDS asks them every 3 s
REPEATS, REPEAT_PERIOD = 3, 0.02  # [s] of the last message, for listeners that confirm none
DISCOVERY = 10.0  # [s] for a second publisher to find a listener
FURTHER_LISTENERS = 1.0  # [s] for the others, then
WARNING = 'which turns the heating off: see that it is'


class LastMessage(NamedTuple):
    """What a publisher is to publish last, and what another one needs to do so for it."""

    publisher: Any
    message: Any
    topic: str
    domain: int


class CommandSession:
    """The frame of a program that commands a robot: ``with CommandSession() as session: ...``.

    At the end of the block the messages of `end_with` are published, and listeners confirm them: after a return, an
    exception, and any of the signals SIGINT (Ctrl-C), SIGTERM, SIGHUP and SIGQUIT, of which `stopped_by` tells the number.
    rclpy's own handlers would invalidate the context first, so that nothing could be published any more; they are not
    installed. Where a context has become invalid all the same, a second one publishes. After a signal, further ones are
    ignored until the program ends. Nothing can be published after SIGKILL or a crash, nor while SIGSTOP lasts: the robot's
    own timeout must then turn the heating off.

    Parameters
    ----------
    arguments : sequence of str or None
        ROS arguments; None for those of the command line.
    context : rclpy.Context or None
        What is initialized and shut down; None for rclpy's default.
    """

    def __init__(self, arguments: Sequence[str] | None = None, context: Any = None) -> None:
        self.context: Any = rclpy.get_default_context() if context is None else context
        self._arguments = None if arguments is None else list(arguments)
        self._signals: list[int] = []  # no Event: a signal that interrupts another one would wait for its lock for ever
        self._last: list[LastMessage] = []

    @property
    def stopped_by(self) -> int | None:
        """The number of the first signal that asked to stop; None before one has."""
        return self._signals[0] if self._signals else None

    def end_with(self, publisher: Any, message: Any) -> None:
        """Publish a message last; call this before anything is published."""
        self._last.append(LastMessage(publisher, message, publisher.topic_name, self.context.get_domain_id()))

    def spin(self, node: Any, until: Callable[[], object] = lambda: False) -> None:
        """Serve a node until a signal asks to stop, its context ends, or `until` holds."""
        try:
            while self.stopped_by is None and self.context.ok() and not until():
                rclpy.spin_once(node, timeout_sec=SPIN_PERIOD)
        except ExternalShutdownException:  # somebody else has ended the context
            pass

    def __enter__(self) -> CommandSession:
        self._handlers: Handlers = take_stop_signals(self._signals.append)
        prefer_udp()
        try:
            rclpy.init(args=self._arguments, context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        except BaseException:
            give_back(self._handlers)
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            for topic in [last.topic for last in self._last if not publish_last(last)]:
                print(f'{topic}: not every listener has confirmed the last message, {WARNING}', file=sys.stderr)
        finally:
            if self.context.ok():
                # uninstalling handlers, also none, sets the default for a moment, in which Ctrl-C kills
                rclpy.shutdown(context=self.context, uninstall_handlers=False)
            if self._signals:
                ignore_at_exit(self._handlers)
            else:
                give_back(self._handlers)


def publish_last(last: LastMessage) -> bool:
    """Publish a last message, by another publisher where its own cannot any more; whether it was confirmed."""
    try:
        return publish_confirmed(last.publisher, last.message)
    except Exception:  # the context or the publisher is invalid: rclpy has several classes for that
        try:
            return publish_anew(last)
        except Exception:  # the caller says that it was not confirmed, and goes on with other topics
            return False


def publish_confirmed(publisher: Any, message: Any) -> bool:
    """Publish a message to all listeners; whether those that confirm messages have confirmed this one."""
    for _ in range(REPEATS):
        publisher.publish(message)
        time.sleep(REPEAT_PERIOD)
    return bool(publisher.wait_for_all_acked(Duration(seconds=CONFIRMATION)))


def publish_anew(last: LastMessage) -> bool:
    """Publish a message from a context of its own, to every listener that is found; whether one was, and all confirmed."""
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=last.domain)
    try:
        node = rclpy.create_node('last_command', context=context, use_global_arguments=False, start_parameter_services=False)
        publisher = node.create_publisher(last.publisher.msg_type, last.topic, last.publisher.qos_profile)
        end = time.monotonic() + DISCOVERY
        while publisher.get_subscription_count() == 0 and time.monotonic() < end:
            time.sleep(REPEAT_PERIOD)
        end = time.monotonic() + FURTHER_LISTENERS
        while time.monotonic() < end:
            publisher.publish(last.message)
            time.sleep(SPIN_PERIOD)
        return publisher.get_subscription_count() > 0 and publish_confirmed(publisher, last.message)
    finally:
        rclpy.shutdown(context=context, uninstall_handlers=False)
