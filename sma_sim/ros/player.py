"""Sends recorded commands to a node or a robot in time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import rclpy
from numpy.typing import NDArray
from std_msgs.msg import Float64, Float64MultiArray

from sma_sim.model.errors import UserError

PLAYER_NODE = 'sma_play'
REPEAT_PERIOD = 0.1  # [s] after which a held command is sent again, so that no timeout turns the heating off
LISTENER_TIMEOUT = 10.0  # [s] for a subscriber to appear
LAST_MESSAGE_TIME = 0.1  # [s] for the last message to leave

Vector = NDArray[np.float64]
Commands = Mapping[str, Vector]  # by topic: one number per time (k,), or one for each wire (k, w)


def play(
    times: Vector, heating: str, commands: Commands, namespace: str, speed: float, on_progress: Callable[[float], None]
) -> int:
    """Send commands at `times` (k,) [s], each held until the next; the last time ends it. Rounds of messages sent.

    The topic `heating` [W] is turned off at the end, also at an early one; set points stay. `on_progress` gets the fraction
    that is done. Raises UserError when nobody subscribes.
    """
    rclpy.init(args=[])
    try:
        node = rclpy.create_node(PLAYER_NODE, namespace=namespace)
        publishers = {topic: node.create_publisher(kind_of(values), topic, 10) for topic, values in commands.items()}
        for publisher in publishers.values():
            wait_for_listener(publisher)

        def send(row: int) -> None:
            for topic, values in commands.items():
                publishers[topic].publish(message_of(values[row]))

        try:
            return send_all(times, speed, send, on_progress)
        finally:
            if heating in publishers:
                publishers[heating].publish(message_of(0.0 * commands[heating][0]))
            time.sleep(LAST_MESSAGE_TIME)
    finally:
        rclpy.try_shutdown()


def kind_of(values: Vector) -> Any:
    """The message type of a topic's values."""
    return Float64 if values.ndim == 1 else Float64MultiArray


def message_of(value: Any) -> Any:
    """One number, or one for each wire, as a message."""
    if np.ndim(value) == 0:
        return Float64(data=float(value))
    numbers: Sequence[float] = [float(number) for number in value]
    return Float64MultiArray(data=numbers)


def wait_for_listener(publisher: Any) -> None:
    """Wait until somebody subscribes. Raises UserError when nobody does."""
    end = time.monotonic() + LISTENER_TIMEOUT
    while publisher.get_subscription_count() == 0:
        if time.monotonic() > end:
            raise UserError(
                f'nobody listens to {publisher.topic_name}: is sma_module_sim running, with this ROS_DOMAIN_ID and '
                'namespace? (see --namespace and --topic)'
            )
        time.sleep(0.02)


def send_all(times: Vector, speed: float, send: Callable[[int], None], on_progress: Callable[[float], None]) -> int:
    """Send each row at its time, and again while it holds; how often."""
    start, sent = time.monotonic() - times[0] / speed, 0
    for row, until in enumerate(times[1:]):
        end = start + until / speed
        while (left := end - time.monotonic()) > 0.0:
            send(row)
            sent += 1
            on_progress(min(1.0, (time.monotonic() - start - times[0] / speed) * speed / (times[-1] - times[0])))
            time.sleep(max(0.0, min(left, REPEAT_PERIOD)))
    return sent
