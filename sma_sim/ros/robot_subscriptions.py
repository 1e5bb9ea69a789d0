"""What a robot publishes, as numbers with times, until the model catches up with it.

Commands and forces carry no stamps. They get one from when they arrived here between two samples of joint_states, so
that no clock but this computer's is compared with itself.
"""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64, Float64MultiArray

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.monitoring.live_model import J_EQ, T_E, InputChange
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.parameters import DEFAULTS
from sma_sim.model.structures.module import STRUCTURE as MODULE
from sma_sim.ros.command import WARNING_PERIOD, Ambient, Command
from sma_sim.ros.qos import LATEST

Vector = NDArray[np.float64]
JOINT_NAMES, WIRE_NAMES = MODULE.coordinate_names, ('wire_1', 'wire_2')
Queue = deque[tuple[int, Any]]

MAX_QUEUED_MESSAGES = 10_000  # messages of a topic; older ones give way
SENSOR_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)  # hears reliable publishers too
COMMAND_DEPTH = 100
ROBOT_TOPICS: Mapping[str, Any] = {
    'joint_states': JointState,
    'J_eq': Float64,
    'J_eq_applied': Float64,
    'ambient_temperature': Temperature,
    'T_E_applied': Float64,
    'wire_forces': Float64MultiArray,
    'wire_1/temperature': Temperature,
    'wire_2/temperature': Temperature,
}
APPLIED_TOPICS = {'J_eq_applied': J_EQ, 'T_E_applied': T_E}  # what is in force, and so replaces what was asked for


class Sample(NamedTuple):
    """One message of joint_states: arrival and stamp [ns]; position, velocity, effort (rows) of U_x, U_y, alpha."""

    arrival: int
    stamp: int
    joints: Vector


class Event(NamedTuple):
    """An input heard of: when [ns], which column, its value, and whether it is in force (or only requested)."""

    arrival: int
    column: int
    value: float
    applied: bool


class RobotSubscriptions:
    """Subscriptions to a robot. They fill queues in the executor's thread; another thread takes from them.

    Raises UserError for names of joints that are not different.
    """

    def __init__(self, node: Node, config: Config) -> None:
        parameters = config.parameters
        self._logger = node.get_logger()
        self._names = [str(config.settings[f'check.name_{joint}']) for joint in JOINT_NAMES]
        if len(set(self._names)) < len(self._names):
            raise UserError(f'check.name_*: expected three different names, got {", ".join(self._names)}')
        self._latency = round(parameters['check.latency'] * 1e9)
        self._timeout = parameters['node.command_timeout']
        self._command = Command(node, parameters['node.J_max'], self._timeout)
        self.ambient = Ambient(node, parameters['environment.T_E'])
        self.counts: Counter[str] = Counter()  # of what was wrong, by words for it
        self._warned_at: dict[str, float] = {}
        self.applied = [False, False]  # whether the robot publishes the J_EQ, T_E that are in force
        self._commanded = math.inf  # stamp [ns] of the last command that was asked for
        self._heard: deque[Event] = deque()
        self._events: list[Event] = []
        self._samples: deque[Sample] = deque(maxlen=MAX_QUEUED_MESSAGES)
        self._companions: list[Queue] = [deque(maxlen=MAX_QUEUED_MESSAGES) for _ in range(3)]  # forces, temperatures
        self._subscribe(node)

    @property
    def waiting(self) -> int:
        """Samples that arrived and were not yet taken."""
        return len(self._samples)

    def ready(self) -> Iterator[Sample]:
        """Samples that have waited for `check.latency`, in the order of their arrival."""
        while self._samples and not 0 <= time.time_ns() - self._samples[0].arrival < self._latency:
            yield self._samples.popleft()

    def forget_commands(self) -> None:
        """Forget the last command: the stamps start again."""
        self._commanded = math.inf

    def changes(self, before: Sample | None, now: Sample) -> list[InputChange]:
        """Inputs that were heard of until a sample, with stamps between those of the sample `before` and its own."""
        while self._heard:
            self._events.append(self._heard.popleft())
        due = sorted(event for event in self._events if event.arrival <= now.arrival)
        self._events = [event for event in self._events if event.arrival > now.arrival]
        changes = []
        for event in due:
            if self.applied[event.column] and not event.applied:
                continue
            changes.append(InputChange(self._stamp(event.arrival, before, now), event.column, event.value))
            if event.column == J_EQ:
                self._commanded = math.inf if event.applied else changes[-1].stamp
        if self._timeout > 0.0 and now.stamp > self._commanded + self._timeout * 1e9:
            changes.append(InputChange(round(self._commanded + self._timeout * 1e9), J_EQ, 0.0))
            self._commanded = math.inf
        return changes

    def companions(self, before: Sample | None, now: Sample) -> Vector:
        """F_1, F_2 [N], T_1, T_2 [K] that belong to a sample, NaN where there are none (4,)."""
        if before is None:
            return np.full(4, np.nan)
        forces, *temperatures = self._companions
        values = [nearest(forces, now.arrival, (now.arrival - before.arrival) // 2, (math.nan, math.nan))]
        half = (now.stamp - before.stamp) // 2
        values += [(nearest(queue, now.stamp, half, math.nan),) for queue in temperatures]
        return np.concatenate(values)

    def apply_T_E(self) -> None:
        """Take the new value of the parameter environment.T_E."""
        self.ambient.apply()
        self._hear(time.time_ns(), T_E, self.ambient.T_E, applied=False)

    def rejected(self) -> dict[str, int]:
        """How often what was wrong, by words for it."""
        return {
            'rejected commands': self._command.rejected,
            'clipped commands': self._command.clipped,
            'rejected ambient temperatures': self.ambient.rejected,
            **self.counts,
        }

    def warn_of(self, words: str, advice: str) -> None:
        """Count what was wrong with a message, and warn of it now and then."""
        self.counts[words] += 1
        now = time.monotonic()
        if now > self._warned_at.get(words, -math.inf) + WARNING_PERIOD:  # the logger's own throttle knows lines, not words
            self._warned_at[words] = now
            self._logger.warning(f'{words}: {advice}')

    def _subscribe(self, node: Node) -> None:
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        receivers: dict[str, Callable[[Any, Any], None]] = {
            'joint_states': self._take_joints,
            'J_eq': partial(self._take, J_EQ, self._command.accepted),
            'ambient_temperature': partial(self._take, T_E, self.ambient.accepted),
            'wire_forces': self._take_forces,
            **{f'{wire}/temperature': partial(self._take_temperature, i) for i, wire in enumerate(WIRE_NAMES)},
            **{topic: partial(self._take_applied, topic) for topic in APPLIED_TOPICS},
        }
        for topic, kind in ROBOT_TOPICS.items():
            asked = topic in ('J_eq', 'ambient_temperature')
            qualities = (
                [LATEST, SENSOR_QOS]
                if topic in APPLIED_TOPICS
                else [QoSProfile(depth=COMMAND_DEPTH)]
                if asked
                else [SENSOR_QOS]
            )
            for quality in qualities:  # no one quality hears both what was kept for late subscribers and what was not
                node.create_subscription(kind, topic, receivers[topic], quality, event_callbacks=quiet)

    def _stamp(self, arrival: int, before: Sample | None, now: Sample) -> int:
        if before is None:
            return now.stamp
        if arrival < before.arrival:
            self.counts['commands later than check.latency'] += 1
        part = (arrival - before.arrival) / max(now.arrival - before.arrival, 1)
        return before.stamp + round(min(max(part, 0.0), 1.0) * (now.stamp - before.stamp))

    def _hear(self, arrival: int, column: int, value: float, applied: bool) -> None:
        self._heard.append(Event(arrival, column, value, applied))

    def _take(self, column: int, accepted: Callable[[Any], float | None], message: Any, info: Any) -> None:
        value = accepted(message)
        if value is not None:
            self._hear(arrival_of(info), column, value, applied=False)

    def _take_applied(self, topic: str, message: Float64, info: Any) -> None:
        column = APPLIED_TOPICS[topic]
        low, high = DEFAULTS['environment.T_E'].bounds if column == T_E else (-math.inf, math.inf)
        if not (math.isfinite(message.data) and low <= message.data <= high):
            self.warn_of(f'{topic} that cannot be used', f'got {message.data}')
            return
        if not self.applied[column]:
            self.applied[column] = True
            self._logger.info(f'{topic} is published: the model follows it, and no other topic, in this')
        self._hear(arrival_of(info), column, float(message.data), applied=True)

    def _take_joints(self, message: JointState, info: Any) -> None:
        joints = np.full((3, 3), math.nan)
        at = {name: k for k, name in enumerate(message.name)}
        for row, values in enumerate((message.position, message.velocity, message.effort)):
            for column, name in enumerate(self._names):
                if at.get(name, len(values)) < len(values):
                    joints[row, column] = values[at[name]]
        if not any(name in at for name in self._names):
            there, expected = ', '.join(message.name) or 'none', ', '.join(self._names)
            self.warn_of(
                'joint_states without the joints that are expected', f'got {there}, expected {expected}: see check.name_*'
            )
            return
        if len(message.position) < len(message.name):
            self.warn_of('joint_states with too few positions', 'what is missing is not compared')
        if not np.isfinite(joints).all() and not np.isfinite(message.position).all():
            self.warn_of('joint_states that are not finite', 'they are not compared')
        joints[np.isinf(joints)] = math.nan
        if len(self._samples) == MAX_QUEUED_MESSAGES:
            self.warn_of('joint_states dropped', 'they come faster than the model runs')
        self._samples.append(Sample(arrival_of(info), nanoseconds(message.header.stamp), joints))

    def _take_forces(self, message: Float64MultiArray, info: Any) -> None:
        values = tuple(message.data)
        if len(values) != 2 or not all(map(math.isfinite, values)):
            self.warn_of('wire_forces that cannot be used', f'expected two finite numbers, got {list(values)[:5]}')
            return
        self._companions[0].append((arrival_of(info), values))

    def _take_temperature(self, wire: int, message: Temperature, _: Any) -> None:
        if not math.isfinite(message.temperature):
            self.warn_of(f'temperatures of {WIRE_NAMES[wire]} that are not finite', 'they are not compared')
            return
        self._companions[1 + wire].append((nanoseconds(message.header.stamp), message.temperature + ZERO_CELSIUS))


def arrival_of(info: Mapping[str, Any]) -> int:
    """When a message arrived at this computer [ns]; now, where the middleware does not say."""
    return int(info['received_timestamp']) or time.time_ns()


def nanoseconds(stamp: Any) -> int:
    """A stamp as one number [ns]."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def nearest(queue: Queue, at: int, within: int, missing: Any) -> Any:
    """The value with the time [ns] nearest to `at`, if that is near enough; what is older leaves the queue."""
    while len(queue) > 1 and abs(queue[1][0] - at) <= abs(queue[0][0] - at):
        queue.popleft()
    return queue[0][1] if queue and abs(queue[0][0] - at) <= within else missing
