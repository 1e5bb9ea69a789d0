"""Sends recorded commands to a node or a robot in time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import rclpy
from std_msgs.msg import Float64, Float64MultiArray

from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.ros.command_session import CommandSession

PLAYER_NODE = 'sma_play'
REPEAT_PERIOD = 0.1  # [s] after which a held command is sent again, so that no timeout turns the heating off
LISTENER_TIMEOUT = 10.0  # [s] for a subscriber to appear

Commands = Mapping[str, Vector]  # by topic: one number per time (k,), or one for each wire (k, w)


class Played(NamedTuple):
    """What was sent: rounds of messages, seconds of the command, and the number of the signal that ended it, if one did."""

    rounds: int
    seconds: float
    stopped_by: int | None


def play(
    times: Vector, heating: str, commands: Commands, namespace: str, speed: float, on_progress: Callable[[float], None]
) -> Played:
    """Send commands at `times` (k,) [s], each held until the next; the last time ends it.

    The topic `heating` [W] is turned off at the end, also at an early one; set points stay. `on_progress` gets the fraction
    that is done. Raises UserError when nobody subscribes, or nobody does any more: a robot that restarts in the middle
    of a command is not where the command takes it to be.
    """
    with CommandSession([], rclpy.Context()) as session:
        node = rclpy.create_node(PLAYER_NODE, namespace=namespace, context=session.context)
        publishers = {topic: node.create_publisher(kind_of(values), topic, 10) for topic, values in commands.items()}
        session.end_with(publishers[heating], message_of(0.0 * commands[heating][0]))
        for publisher in publishers.values():
            wait_for_listener(publisher, session)

        def send(row: int) -> None:
            for topic, values in commands.items():
                publishers[topic].publish(message_of(values[row]))
            if publishers[heating].get_subscription_count() == 0:
                part = f'{times[row] - times[0]:g} of {times[-1] - times[0]:g} s'
                raise UserError(
                    f'nobody listens to {publishers[heating].topic_name} any more: stopped after {part}; heating off'
                )

        rounds, seconds = send_all(times, speed, send, session, on_progress)
    return Played(rounds, seconds, session.stopped_by)


def kind_of(values: Vector) -> Any:
    """The message type of a topic's values."""
    return Float64 if values.ndim == 1 else Float64MultiArray


def message_of(value: Any) -> Any:
    """One number, or one for each wire, as a message."""
    if np.ndim(value) == 0:
        return Float64(data=float(value))
    numbers: Sequence[float] = [float(number) for number in value]
    return Float64MultiArray(data=numbers)


def wait_for_listener(publisher: Any, session: CommandSession) -> None:
    """Wait until somebody subscribes, or the session is to stop. Raises UserError when nobody does."""
    end = time.monotonic() + LISTENER_TIMEOUT
    while session.stopped_by is None and publisher.get_subscription_count() == 0:
        if time.monotonic() > end:
            raise UserError(
                f'nobody listens to {publisher.topic_name}: is sma_module_sim running, with this ROS_DOMAIN_ID and '
                'namespace? (see --namespace and --topic)'
            )
        time.sleep(0.02)


def send_all(
    times: Vector, speed: float, send: Callable[[int], None], session: CommandSession, on_progress: Callable[[float], None]
) -> tuple[int, float]:
    """Send each row at its time, and again while it holds, until the session is to stop; how often, and up to when [s]."""
    start, sent, played = time.monotonic() - times[0] / speed, 0, 0.0
    for row, until in enumerate(times[1:]):
        end = start + until / speed
        while (left := end - time.monotonic()) > 0.0:
            played = speed * (time.monotonic() - start) - times[0]
            if session.stopped_by is not None:
                return sent, played
            send(row)
            sent += 1
            on_progress(min(1.0, played / (times[-1] - times[0])))
            time.sleep(max(0.0, min(left, REPEAT_PERIOD)))
    return sent, times[-1] - times[0]
