"""Sends a recorded command to `J_eq` in time."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from numpy.typing import NDArray
from std_msgs.msg import Float64

from sma_sim.model.errors import UserError

PLAYER_NODE = 'sma_play'
REPEAT_PERIOD = 0.1  # [s] after which a held command is sent again, so that no timeout turns the heating off
LISTENER_TIMEOUT = 10.0  # [s] for a subscriber to appear
LAST_MESSAGE_TIME = 0.1  # [s] for the last message to leave

Vector = NDArray[np.float64]


def play(times: Vector, J_eq: Vector, topic: str, namespace: str, speed: float, on_progress: Callable[[float], None]) -> int:
    """Send `J_eq` (k,) [W] at `times` (k,) [s], each held until the next; the last time ends it. Messages sent.

    The heating is turned off at the end, also at an early one. `on_progress` gets the fraction that is done. Raises
    UserError when nobody subscribes.
    """
    rclpy.init(args=[])
    try:
        node = rclpy.create_node(PLAYER_NODE, namespace=namespace)
        publisher = node.create_publisher(Float64, topic, 10)
        wait_for_listener(publisher)
        try:
            return send_all(times, J_eq, speed, lambda value: publisher.publish(Float64(data=float(value))), on_progress)
        finally:
            publisher.publish(Float64(data=0.0))
            time.sleep(LAST_MESSAGE_TIME)
    finally:
        rclpy.try_shutdown()


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


def send_all(
    times: Vector, J_eq: Vector, speed: float, send: Callable[[float], None], on_progress: Callable[[float], None]
) -> int:
    """Send each value at its time, and again while it holds; the number of messages."""
    start, sent = time.monotonic() - times[0] / speed, 0
    for value, until in zip(J_eq[:-1], times[1:], strict=True):
        end = start + until / speed
        while (left := end - time.monotonic()) > 0.0:
            send(value)
            sent += 1
            on_progress(min(1.0, (time.monotonic() - start - times[0] / speed) * speed / (times[-1] - times[0])))
            time.sleep(max(0.0, min(left, REPEAT_PERIOD)))
    return sent
