"""What a robot publishes, as numbers with times, until the model catches up with it.

Commands and forces carry no stamps. They get one from when they arrived here between two samples of joint_states, so
that no clock but this computer's is compared with itself.
"""

from __future__ import annotations

import math
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64, Float64MultiArray

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.data.rosbag.interface import APPLIED, PAIR_COMMAND, RESISTANCES, interface_of
from sma_sim.evidence.monitoring.live_model import InputChange
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.program_parameters import DEFAULTS
from sma_sim.model.structures.structure import Structure
from sma_sim.ros.command import WARNING_PERIOD, Ambient, SetPoint, heating_command
from sma_sim.ros.control import DIAGNOSTICS_PERIOD
from sma_sim.ros.qos import LATEST
from sma_sim.ros.robot_clock import RobotClock

Queue = deque[tuple[int, Any]]

REMINDER_PERIOD = 10.0  # [s] between two warnings of what lasts
MAX_DELAY = 0.02  # [s] for a node that acts on the robot: a period of a command
RESTART = 10**9  # [ns] without a sample from which on the robot may be another one: a program takes as long to start
MAX_AHEAD = 10**9  # [ns] of a value before the sample that it belongs to
MAX_QUEUED_MESSAGES = 10_000  # messages of a topic; older ones give way
SENSOR_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)  # hears reliable publishers too
COMMAND_DEPTH = 100
OF_WIRES = {'wire_forces': 0, RESISTANCES: -1}  # topics with a number for each wire, and their queue
NUMBERS = {2: 'two', 3: 'three'}  # in messages


class Sample(NamedTuple):
    """One message of joint_states: arrival and stamp [ns]; position, velocity, effort (rows) of every coordinate.

    `jumped` [ns] is by how much the clock of the stamps was set so far.
    """

    arrival: int
    stamp: int
    joints: Vector
    jumped: int = 0

    @property
    def time(self) -> int:
        """The stamp of a clock that was never set [ns]: the wires of a robot do not jump with its clock."""
        return self.stamp - self.jumped


class Event(NamedTuple):
    """An input heard of: when [ns], which column, its value, and whether it is in force (or only requested)."""

    arrival: int
    column: int
    value: float
    applied: bool


def robot_topics(structure: Structure) -> dict[str, Any]:
    """Message types of the topics of a robot that are heard, by name."""
    topic = interface_of(structure).heating_topic
    asked = {
        topic: Float64 if topic == PAIR_COMMAND else Float64MultiArray,
        **{drive.name: Float64 for drive in structure.drives},
    }
    return {
        'joint_states': JointState,
        **{f'{name}{suffix}': kind for name, kind in asked.items() for suffix in ('', APPLIED)},
        'ambient_temperature': Temperature,
        'T_E_applied': Float64,
        **dict.fromkeys(OF_WIRES, Float64MultiArray),
        **{f'{wire}/temperature': Temperature for wire in wire_names(structure)},
    }


def wire_names(structure: Structure) -> list[str]:
    """What the topics of the wires begin with."""
    return [f'wire_{i + 1}' for i in range(structure.wires)]


class RobotSubscriptions:
    """Subscriptions to a robot. They fill queues in the executor's thread; another thread takes from them.

    `latency` [s] is how long a sample waits for what belongs to it, check.latency where nothing is said. One that is later
    than that by `max_delay` [s] is skipped where another one waits: what acts on a robot has to know it as it is now,
    and goes on where its clock was set (`Sample.time`). Raises UserError for names of joints that are not different.
    """

    def __init__(self, node: Node, config: Config, latency: float | None = None, max_delay: float = math.inf) -> None:
        parameters, structure = config.parameters, config.structure
        self._max_delay = max_delay * 1e9
        self._skipped = self._told_of = self._jumped = 0
        self._clock = RobotClock() if math.isfinite(max_delay) else None
        self._node, self._logger, self._structure = node, node.get_logger(), structure
        self._names = [str(config.settings[f'check.name_{joint}']) for joint in structure.coordinate_names]
        if len(set(self._names)) < len(self._names):
            count = NUMBERS.get(len(self._names), str(len(self._names)))
            raise UserError(f'check.name_*: expected {count} different names, got {", ".join(self._names)}')
        drives, columns = len(structure.drives), len(structure.input_columns)
        self.heating, self.T_E = range(drives, columns - 1), columns - 1  # columns of the input
        self._latency = round((parameters['check.latency'] if latency is None else latency) * 1e9)
        self._timeout = parameters['node.command_timeout']
        self._command = heating_command(node, structure, parameters['node.J_max'], self._timeout)
        self._set_points = [SetPoint(node, drive, parameters['environment.T_E']) for drive in structure.drives]
        self.ambient = Ambient(node, parameters['environment.T_E'])
        self.counts: Counter[str] = Counter()  # of what was wrong, by words for it
        self._warned_at: dict[str, float] = {}
        self.applied = [False] * columns  # whether the robot publishes what is in force in a column
        self._of_applied: dict[str, tuple[int, ...]] = {}  # topics that say so, and their columns
        self._kept: list[Any] = []  # subscriptions to what a robot keeps for late subscribers
        self._commanded = math.inf  # stamp [ns] of the last command that was asked for
        self._ready_at, self._arrived = time.monotonic(), math.inf  # [s]; of the last sample [ns]
        self._heard: deque[Event] = deque()
        self._events: list[Event] = []
        self._samples: deque[Sample] = deque(maxlen=MAX_QUEUED_MESSAGES)
        self._companions: list[Queue] = [
            deque(maxlen=MAX_QUEUED_MESSAGES) for _ in range(2 + structure.wires)
        ]  # forces, the temperature of each wire, resistances
        self._subscribe()

    @property
    def command_topic(self) -> str:
        """The topic of the heating that is asked for."""
        return self._command.topic

    @property
    def heating_followed(self) -> str:
        """The topic of the heating that counts: what is in force, where the robot publishes it."""
        return f'{self.command_topic}{APPLIED}' if self.applied[self.heating[0]] else self.command_topic

    @property
    def waiting(self) -> int:
        """Samples that arrived and were not yet taken."""
        return len(self._samples)

    def ready(self) -> Iterator[Sample]:
        """Samples that have waited for the latency, in the order of their arrival."""
        while self._samples and not 0 <= (age := time.time_ns() - self._samples[0].arrival) < self._latency:
            sample = self._samples.popleft()
            if self._samples and age > self._latency + self._max_delay:
                self._skipped += 1  # commands since the last one that was taken count for the next
                continue
            yield sample

    def follow(
        self,
        stop: threading.Event,
        take: Callable[[Sample], None],
        diagnose: Callable[[], None],
        poll_period: float,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> None:
        """Until `stop` is set `take` every sample that is ready, and `diagnose` once a second, also while it lags behind.

        `meanwhile` is called between two looks for samples, which are `poll_period` [s] apart.
        """
        diagnose_at = self._ready_at = time.monotonic()
        while not stop.is_set():
            meanwhile()
            for sample in self.ready():
                self._ready_at = time.monotonic()
                take(sample)
                if time.monotonic() >= diagnose_at:
                    break
            if time.monotonic() >= diagnose_at:
                diagnose_at += DIAGNOSTICS_PERIOD
                self._look_for_publishers()
                diagnose()
            time.sleep(poll_period)

    def skipped(self) -> dict[str, int]:
        """How many samples were skipped, in words."""
        return {'samples skipped': self._skipped}

    def overload(self) -> list[str]:
        """What is wrong where samples were skipped since the last call, which the log says too."""
        count, self._told_of = self._skipped - self._told_of, self._skipped
        if not count:
            return []
        words = f'joint_states come faster than this computer takes them: {count} skipped'
        self._logger.warning(words, throttle_duration_sec=REMINDER_PERIOD)
        return [words]

    def silence(self, longest: float) -> list[str]:
        """What is wrong where no sample was ready for more than `longest` [s], which the log says too."""
        silence = time.monotonic() - self._ready_at
        if silence <= longest:
            return []
        self._logger.warning(
            'no joint_states: is the robot running, in this namespace?', throttle_duration_sec=REMINDER_PERIOD
        )
        return [f'no joint_states for {silence:.0f} s']

    def forget_commands(self) -> None:
        """Forget the last command: the stamps start again."""
        self._commanded = math.inf

    def changes(self, before: Sample | None, now: Sample) -> list[InputChange]:
        """Inputs that were heard of until a sample, with times between those of the sample `before` and its own."""
        while self._heard:
            self._events.append(self._heard.popleft())
        due = sorted(event for event in self._events if event.arrival <= now.arrival)
        self._events = [event for event in self._events if event.arrival > now.arrival]
        changes = []
        for event in due:
            if self.applied[event.column] and not event.applied:
                continue
            changes.append(InputChange(self._stamp(event.arrival, before, now), event.column, event.value))
            if event.column in self.heating:
                self._commanded = math.inf if event.applied else changes[-1].stamp
        if self._timeout > 0.0 and now.time > self._commanded + self._timeout * 1e9:
            changes += [InputChange(round(self._commanded + self._timeout * 1e9), column, 0.0) for column in self.heating]
            self._commanded = math.inf
        return changes

    def companions(self, before: Sample | None, now: Sample) -> Vector:
        """Forces [N], temperatures [K] and resistances [ohm] of the wires that belong to a sample, NaN where there are none
        (3 wires,)."""
        wires = self._structure.wires
        if before is None:
            return np.full(3 * wires, np.nan)
        forces, *temperatures, resistances = self._companions
        none, half = (math.nan,) * wires, (now.arrival - before.arrival) // 2
        values = [nearest(forces, now.arrival, half, none)]
        stamped_half = (now.time - before.time) // 2
        values += [(nearest(queue, now.stamp, stamped_half, math.nan),) for queue in temperatures]
        values.append(nearest(resistances, now.arrival, half, none))
        return np.concatenate(values)

    def apply_T_E(self) -> None:
        """Take the new value of the parameter environment.T_E."""
        self.ambient.apply()
        self._hear(time.time_ns(), (self.T_E,), (self.ambient.T_E,), applied=False)

    def rejected(self) -> dict[str, int]:
        """How often what was wrong, by words for it."""
        return {
            'rejected commands': self._command.rejected + sum(point.rejected for point in self._set_points),
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

    def _look_for_publishers(self) -> None:
        """What is asked for counts again where nobody publishes any more what is in force."""
        for topic, columns in self._of_applied.items():
            if self.applied[columns[0]] and not self._node.get_publishers_info_by_topic(topic):
                self._believe_no_longer(columns)
                self._logger.warning(f'{topic} is not published any more: the model follows what is asked for')

    def _believe_no_longer(self, columns: Sequence[int]) -> None:
        """What was in force was so with a robot that may be gone."""
        if columns[0] == self.T_E and self.applied[self.T_E]:
            self._hear(time.time_ns(), columns, (self.ambient.T_E,), applied=False)  # nobody has to ask for it
        for column in columns:
            self.applied[column] = False

    def _ask_what_is_in_force(self) -> None:
        """Begin anew with what robots keep for late subscribers.

        One that is there says it again to a subscription that is new; one that was killed does not, and DDS takes it for
        alive for another 20 s.
        """
        for subscription in self._kept:
            self._node.destroy_subscription(subscription)
        for columns in self._of_applied.values():
            self._believe_no_longer(columns)
        kinds = robot_topics(self._structure)
        self._kept = [
            self._listen(kinds[topic], topic, partial(self._take_applied, topic, columns), LATEST)
            for topic, columns in self._of_applied.items()
        ]

    def _listen(self, kind: Any, topic: str, receive: Callable[[Any, Any], None], quality: QoSProfile) -> Any:
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        return self._node.create_subscription(kind, topic, receive, quality, event_callbacks=quiet)

    def _subscribe(self) -> None:
        heating = (self._command.topic, tuple(self.heating), self._command.accepted)
        points = [(point.topic, (k,), point.accepted) for k, point in enumerate(self._set_points)]
        receivers: dict[str, Callable[[Any, Any], None]] = {
            'joint_states': self._take_joints,
            'ambient_temperature': partial(self._take, (self.T_E,), self.ambient.accepted),
            **{topic: partial(self._take_numbers, topic, queue) for topic, queue in OF_WIRES.items()},
        }
        self._of_applied = {f'{topic}{APPLIED}': columns for topic, columns, _ in (heating, *points)}
        self._of_applied['T_E_applied'] = (self.T_E,)
        for topic, columns, accepted in (heating, *points):
            receivers[topic] = partial(self._take, columns, accepted)
        for topic, columns in self._of_applied.items():
            receivers[topic] = partial(self._take_applied, topic, columns)
        for i, wire in enumerate(wire_names(self._structure)):
            receivers[f'{wire}/temperature'] = partial(self._take_temperature, i)
        asked = {'ambient_temperature', *(topic for topic, *_ in (heating, *points))}
        for topic, kind in robot_topics(self._structure).items():
            self._listen(kind, topic, receivers[topic], QoSProfile(depth=COMMAND_DEPTH) if topic in asked else SENSOR_QOS)
        self._ask_what_is_in_force()  # no one quality hears both what was kept for late subscribers and what was not

    def _stamp(self, arrival: int, before: Sample | None, now: Sample) -> int:
        if before is None:
            return now.time
        if arrival < before.arrival:
            self.counts['commands later than check.latency'] += 1
        part = (arrival - before.arrival) / max(now.arrival - before.arrival, 1)
        return before.time + round(min(max(part, 0.0), 1.0) * (now.time - before.time))

    def _hear(self, arrival: int, columns: Sequence[int], values: Sequence[float], applied: bool) -> None:
        self._heard.extend(Event(arrival, column, value, applied) for column, value in zip(columns, values, strict=True))

    def _take(self, columns: Sequence[int], accepted: Callable[[Any], Any], message: Any, info: Any) -> None:
        value = accepted(message)
        if value is not None:
            self._hear(arrival_of(info), columns, value if isinstance(value, tuple) else (value,), applied=False)

    def _take_applied(self, topic: str, columns: Sequence[int], message: Any, info: Any) -> None:
        values = [message.data] if isinstance(message, Float64) else list(message.data)
        low, high = DEFAULTS['environment.T_E'].bounds if columns == (self.T_E,) else (-math.inf, math.inf)
        if len(values) != len(columns) or not all(math.isfinite(value) and low <= value <= high for value in values):
            got = ', '.join(map(str, values[:5]))
            self.warn_of(f'{topic} that cannot be used', f'got {got}')
            return
        if not self.applied[columns[0]]:
            for column in columns:
                self.applied[column] = True
            self._logger.info(f'{topic} is published: the model follows it, not what is asked for')
        self._hear(arrival_of(info), columns, [float(value) for value in values], applied=True)

    def _take_joints(self, message: JointState, info: Any) -> None:
        joints = np.full((3, len(self._names)), math.nan)
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
        arrival, stamp = arrival_of(info), nanoseconds(message.header.stamp)
        if arrival - self._arrived > RESTART:
            self._ask_what_is_in_force()
        self._arrived = arrival
        if self._clock is not None and (jump := self._clock.hear(1e-9 * stamp, 1e-9 * arrival)):
            self._jumped += round(1e9 * jump)
            self.warn_of(
                'stamps of joint_states that jump',
                f'by {jump:+.3f} s: a clock was set or began again, or two robots publish; what is known of the wires stays',
            )
        self._samples.append(Sample(arrival, stamp, joints, self._jumped))

    def _take_numbers(self, topic: str, queue: int, message: Float64MultiArray, info: Any) -> None:
        values = tuple(message.data)
        wires = self._structure.wires
        if len(values) != wires or not all(map(math.isfinite, values)):
            expected = 'one finite number' if wires == 1 else f'{NUMBERS.get(wires, wires)} finite numbers'
            self.warn_of(f'{topic} that cannot be used', f'expected {expected}, got {list(values)[:5]}')
            return
        self._companions[queue].append((arrival_of(info), values))

    def _take_temperature(self, wire: int, message: Temperature, _: Any) -> None:
        if not math.isfinite(message.temperature):
            self.warn_of(f'temperatures of wire_{wire + 1} that are not finite', 'they are not compared')
            return
        self._companions[1 + wire].append((nanoseconds(message.header.stamp), message.temperature + ZERO_CELSIUS))


def arrival_of(info: Mapping[str, Any]) -> int:
    """When a message arrived at this computer [ns]; now, where the middleware does not say."""
    return int(info['received_timestamp']) or time.time_ns()


def nanoseconds(stamp: Any) -> int:
    """A stamp as one number [ns]."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def nearest(queue: Queue, at: int, within: int, missing: Any) -> Any:
    """The value with the time [ns] nearest to `at`, if that is near enough; what is older leaves the queue, and what is of
    a clock that has gone back since."""
    while len(queue) > 1 and (abs(queue[1][0] - at) <= abs(queue[0][0] - at) or queue[0][0] - at > MAX_AHEAD):
        queue.popleft()
    return queue[0][1] if queue and abs(queue[0][0] - at) <= within else missing
