"""Messages that the simulating thread takes by itself, so that no executor has to wake up for each of them.

An executor of rclpy looks at every service, timer and event of its node for every message, which takes about half a
millisecond. A thread that looks for messages a thousand times a second anyway takes them in a few microseconds each.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile
from rosgraph_msgs.msg import Clock

MAX_AT_ONCE = 1000  # messages of a subscription that keeps all


class TakenElsewhere(CallbackGroup):
    """Keeps its entities away from the executor."""

    def can_execute(self, entity: Any) -> bool:
        """Whether the executor may have to do with an entity."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Permission to execute it."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing is executed, so nothing ends."""


class Inbox:
    """Subscriptions of one node whose callbacks are called by the thread that calls `take`."""

    def __init__(self, node: Node) -> None:
        self.subscriptions: list[Any] = []
        self._node, self._group = node, TakenElsewhere()

    def add(self, subscription: Any) -> None:
        """Take the messages of a subscription here, from now on.

        Its events are taken nowhere: an executor that waits for them wakes up for every message. GraphCheck tells of
        publishers whose quality of service does not match.
        """
        for entity in (subscription, *subscription.event_handlers):
            entity.callback_group = self._group
        self.subscriptions.append(subscription)

    def take(self) -> None:
        """Call the callbacks with all messages that have arrived, whatever their topics, in the order of their arrival.

        Those that arrive meanwhile wait for the next time.
        """
        waiting: list[tuple[int, Any, Callable[[Any], None]]] = []
        for subscription in self.subscriptions:
            with subscription.handle:
                for _ in range(max_waiting(subscription.qos_profile)):
                    if (taken := self._take_one(subscription)) is None:
                        break
                    waiting.append((taken[1]['received_timestamp'], taken[0], subscription.callback))
        for _, message, callback in sorted(waiting, key=lambda one: one[0]):
            callback(message)

    def wait(self, longest: float) -> None:
        """Return when there is a message, after `longest` seconds at the latest."""
        handles = [subscription.handle for subscription in self.subscriptions]
        context: Any = self._node.context.handle
        with ExitStack() as kept:
            for handle in (*handles, context):
                kept.enter_context(handle)  # not destroyed meanwhile
            wait_set = rclpy_implementation.WaitSet(len(handles), 0, 0, 0, 0, 0, context)
            wait_set.clear_entities()
            for handle in handles:
                wait_set.add_subscription(handle)
            wait_set.wait(round(longest * 1e9))

    def _take_one(self, subscription: Any) -> tuple[Any, Any] | None:
        """A message and what is known of it; None where there is none."""
        try:
            taken: tuple[Any, Any] | None = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        except Exception as error:  # a message that cannot be read must not end the simulation
            self._node.get_logger().error(f'a message on {subscription.topic_name} was lost: {error}')
            return None
        return taken


def max_waiting(profile: QoSProfile) -> int:
    """How many messages can wait at most: with more taken, a flood of them would keep the one who takes them for ever."""
    return int(profile.depth) if profile.history == HistoryPolicy.KEEP_LAST and profile.depth else MAX_AT_ONCE


def clock_inbox(node: Node) -> Inbox:
    """The inbox of the /clock that a node follows; without messages where it follows none."""
    inbox = Inbox(node)
    for subscription in node.subscriptions:
        if subscription.msg_type is Clock:
            inbox.add(subscription)
    return inbox
