"""Sends recorded commands to a node or a robot in time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_topic_name import validate_topic_name
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray

from sma_sim.evidence.data.rosbag.interface import RESISTANCES, SINGLE_CHANNELS
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.model.progress import ProgressLine
from sma_sim.ros.inbox import Inbox, clock_inbox
from sma_sim.ros.last_command import CommandSession

PLAYER_NODE = 'sma_play'
REPEAT_PERIOD = 0.1  # [s] after which a held command is sent again, so that no timeout turns the heating off
LISTENER_TIMEOUT = 10.0  # [s] for a subscriber to appear
STANDSTILL = 2.0  # [s] without a step of /clock after which nobody knows how long a command has been in force
SILENCE = 3.0  # [s] without a message of a robot that publishes; slower ones are not followed by sma_model_check either
MAX_WAIT = 0.05  # [s] for a step of /clock between two looks for a signal

# What a robot publishes all along, and nobody else in its namespace.
MEASURED: Mapping[str, Any] = {
    'joint_states': JointState,
    **dict.fromkeys(('wire_forces', RESISTANCES, *SINGLE_CHANNELS.values()), Float64MultiArray),
}

Commands = Mapping[str, Vector]  # by topic: one number per time (k,), or one for each wire (k, w)


class Played(NamedTuple):
    """What was sent: rounds of messages, seconds of the command, and the number of the signal that ended it, if one did."""

    rounds: int
    seconds: float
    stopped_by: int | None


class PlayerClock:
    """The time [s] by which commands are sent: that of /clock, or of the steady clock of this computer."""

    def __init__(self, node: Node, follows: bool) -> None:
        self._node, self._inbox = node, clock_inbox(node) if follows else None
        self._last, self._moved_at = 0.0, time.monotonic()

    def now(self) -> float:
        """Its time; 0 before /clock was heard of. Raises UserError where it went back."""
        if self._inbox is None:
            return time.monotonic()
        self._inbox.take()
        now = 1e-9 * self._node.get_clock().now().nanoseconds
        if now < self._last:
            raise UserError(
                f'/clock went back by {self._last - now:.2f} s, to {now:.2f} s: its source was restarted, or a bag plays '
                'from its start. Stopped; heating off'
            )
        if now > self._last:
            self._last, self._moved_at = now, time.monotonic()
        return now

    @property
    def stands_still(self) -> bool:
        """Whether it has not moved for long."""
        return self._inbox is not None and time.monotonic() - self._moved_at > STANDSTILL

    @property
    def is_another(self) -> bool:
        """Whether /clock is published and not followed; its publisher may be found late."""
        return self._inbox is None and self._node.count_publishers('/clock') > 0

    def wait(self, seconds: float) -> None:
        """Return after so many seconds, or earlier, when it may have moved."""
        if self._inbox is None:
            time.sleep(seconds)
        else:
            self._inbox.wait(MAX_WAIT)


class Robot:
    """Watches by what it publishes whether the robot that was there at the start still is.

    Whoever subscribes to a command need not be the robot: recorders and observers do. And one that was killed is taken for
    a subscriber for as long as its lease lasts, in which it may have been started again.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._inbox = node, Inbox(node)
        self._last: dict[str, float] = {}  # when a message came [s], by topic
        self._known: dict[str, set[tuple[int, ...]]] = {}  # the publishers of topics that come all along
        for topic, kind in MEASURED.items():
            receive = partial(self._receive, topic)
            self._inbox.add(node.create_subscription(kind, topic, receive, qos_profile_sensor_data, raw=True))

    def _receive(self, topic: str, _: bytes) -> None:
        now = time.monotonic()
        if now - self._last.get(topic, -math.inf) <= SILENCE:
            self._known.setdefault(topic, set())
        self._last[topic] = now

    def gone(self, paused: bool) -> str:
        """Why the robot is not there any more, in words; empty as long as it is. While it is paused it may be silent."""
        self._inbox.take()
        now = time.monotonic()
        for topic, known in self._known.items():
            name = self._node.resolve_topic_name(topic)
            there = {tuple(info.endpoint_gid) for info in self._node.get_publishers_info_by_topic(topic)}
            if known - there:
                return f'what published {name} has ended'
            known |= there
            if paused:
                self._last[topic] = now
            if now - self._last[topic] > SILENCE:
                return f'nothing has come on {name} for {SILENCE:g} s'
        return ''


def play(
    times: Vector,
    heating: str,
    commands: Commands,
    namespace: str,
    speed: float,
    follows_clock: bool,
    progress: ProgressLine,
) -> Played:
    """Send commands at `times` (k,) [s], each held until the next; the last time ends it.

    They go by /clock where it is followed: before it is published, and while it stands still, the heating is off. The topic
    `heating` [W] is turned off at the end, also at an early one; set points stay. Raises UserError for names that topics
    cannot have; when nobody subscribes, or nobody does any more, or the robot has stopped publishing: one that restarts in
    the middle of a command is not where the command takes it to be; and where /clock goes back.
    """
    check_names(namespace, commands)
    with CommandSession([], rclpy.Context()) as session:
        follow = [Parameter('use_sim_time', value=follows_clock)]
        node = rclpy.create_node(PLAYER_NODE, namespace=namespace, context=session.context, parameter_overrides=follow)
        publishers = {topic: node.create_publisher(kind_of(values), topic, 10) for topic, values in commands.items()}
        off = message_of(0.0 * commands[heating][0])
        session.end_with(publishers[heating], off)
        robot = Robot(node)
        for publisher in publishers.values():
            wait_for_listener(publisher, session)

        def send(row: int | None, played: float) -> None:
            words = robot.gone(paused=row is None)
            if publishers[heating].get_subscription_count() == 0:
                words = f'nobody listens to {publishers[heating].topic_name} any more'
            if words:
                part = f'{max(played, 0.0):.1f} of {times[-1] - times[0]:g} s'
                raise UserError(f'{words}: is the robot still running? Stopped after {part}; heating off')
            if row is None:
                publishers[heating].publish(off)
            else:
                for topic, values in commands.items():
                    publishers[topic].publish(message_of(values[row]))

        clock = PlayerClock(node, follows_clock)
        rounds, seconds = send_all(times, speed, clock, send, session, progress)
    return Played(rounds, seconds, session.stopped_by)


def check_names(namespace: str, topics: Iterable[str]) -> None:
    """Raise UserError for names that ROS does not take."""
    try:
        validate_namespace(namespace if namespace.startswith('/') else f'/{namespace}')
        for topic in topics:
            validate_topic_name(topic)
    except NameValidationException as error:
        what, name, *_ = map(str.strip, str(error).splitlines())
        raise UserError(f'{what} {name} (see --namespace and --topic)') from error


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
    times: Vector,
    speed: float,
    clock: PlayerClock,
    send: Callable[[int | None, float], None],
    session: CommandSession,
    progress: ProgressLine,
) -> tuple[int, float]:
    """Send each row at its time, and again while it holds, until the session is to stop; how often, and up to when [s].

    `send` gets a row, None for no heating while the clock stands still, and how many seconds were played.
    """
    sent, played, said = 0, 0.0, False
    while clock.now() == 0.0 and session.stopped_by is None:
        if clock.stands_still and not said:
            said = True
            progress.note('waiting for /clock, which nobody publishes: nothing is sent')
        clock.wait(MAX_WAIT)
    start = clock.now() - times[0] / speed
    for row, until in enumerate(times[1:]):
        end, due = start + until / speed, -np.inf
        while (left := end - (now := clock.now())) > 0.0:
            played = speed * (now - start) - times[0]
            if session.stopped_by is not None:
                return sent, played
            if clock.stands_still:
                if due > -np.inf:
                    part = f'{played:.2f} of {times[-1] - times[0]:g} s'
                    progress.note(f'/clock stands still at {now:.2f} s, after {part}: heating off until it moves')
                send(None, played)
                due = -np.inf
            elif now >= due:
                send(row, played)
                sent, due = sent + 1, now + REPEAT_PERIOD
                if not said and clock.is_another:
                    said = True
                    progress.note(
                        "/clock is published; commands go by this computer's clock: --use-sim-time lets them follow /clock"
                    )
                progress(min(1.0, played / (times[-1] - times[0])))
            clock.wait(max(0.0, min(left, REPEAT_PERIOD)))
    return sent, times[-1] - times[0]
