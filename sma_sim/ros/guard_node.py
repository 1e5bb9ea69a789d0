"""The node `sma_guard`: what a controller asks for, less the heating that would spoil a wire.

It publishes a command for every estimate that `sma_observer` publishes, less and less while the next one does not come, and
zero whenever the controller, the robot or the observer is silent. Whatever stops it, but SIGKILL or a crash, leaves
a command of zero behind, as all programs that command a robot do (`ros.last_command`); after those the robot's own
`node.command_timeout` must.
"""

from __future__ import annotations

import math
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.utilities import get_rmw_implementation_identifier
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64, Float64MultiArray, UInt8MultiArray

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.data.rosbag.interface import PAIR_COMMAND, interface_of
from sma_sim.evidence.state_estimation.estimate import Estimate
from sma_sim.evidence.state_estimation.guard import REFUSED, Counters, Decision, Guard
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.structures.structure import numbers, record
from sma_sim.ros.command import ENVIRONMENT, Ambient, asked_for, shown
from sma_sim.ros.control import DIAGNOSTICS_PERIOD, Diagnostics
from sma_sim.ros.graph_check import GraphCheck
from sma_sim.ros.last_command import WARNING, LastMessage, publish_last
from sma_sim.ros.messages import Messages, seconds_of
from sma_sim.ros.observer_node import PREFIX, estimated_topics
from sma_sim.ros.parameters import follow_live_parameters
from sma_sim.ros.qos import LAST_FEW, make_publisher, make_subscription
from sma_sim.ros.robot_clock import RobotClock
from sma_sim.ros.robot_subscriptions import REMINDER_PERIOD, SENSOR_QOS, arrival_of, wire_names
from sma_sim.ros.stamped import SUFFIX
from sma_sim.ros.transport import late_commands
from sma_sim.solver.model import Model

POLL_PERIOD = 0.002  # [s] between two looks for messages
REPEAT_PERIOD = 0.05  # [s] between two commands of zero
AGAIN_AFTER = 1.0  # [s] after which the end of an intervention is said, and another one of its kind anew
REQUESTED = '_requested'
COMPLETE = f'{PREFIX}wire_modes'  # the last message of an estimate


class WireGuard:
    """A `Guard` between the topics of a controller and those of a robot."""

    def __init__(self, node: Node, config: Config, use_sim_time: bool) -> None:
        self._node, self._logger, structure = node, node.get_logger(), config.structure
        if not structure.coordinates:
            raise UserError(f'system = {config.system}: the guard needs joint_states, and a {config.system} has no joints')
        self._silence = config.parameters['guard.silence']
        path = str(config.settings['guard.counters'])
        self._path = Path(path).expanduser() if path else None
        counters = Counters.read(self._path, structure.wires) if self._path else None
        self._guard, self._structure = Guard(config, counters), structure
        self._saved = self._written()
        self._constants, self._values = Model(config).constants, config.parameters
        self._pose = record('Pose', structure.coordinate_names)
        self._names = [str(config.settings[f'check.name_{joint}']) for joint in structure.coordinate_names]
        self._messages, self._wires = Messages(structure), wire_names(structure)
        self._pair = interface_of(structure).heating_topic == PAIR_COMMAND
        self._heard: dict[str, tuple[float, Any]] = {}  # the last message of a topic, and when it arrived [s]
        self._new: deque[str] = deque(maxlen=100)  # topics of messages that were not looked at yet
        self.ambient = Ambient(node, config.parameters['environment.T_E'])
        self._robot, self._horizon = RobotClock(), config.parameters['guard.horizon']
        self._connect(node, interface_of(structure).heating_topic)
        self._diagnostics = Diagnostics(node, 'guard of the wires')
        self._decision = Decision((0.0,) * len(structure.commands), 1.0, '', '')
        self._said: dict[str, float] = {}  # when an intervention of a kind was in force last [s]
        self._commands, self._published_at = 0, -math.inf
        self._estimate: Estimate | None = None
        self._is_estimated = False  # what was heard last
        follow_live_parameters(node, {ENVIRONMENT: self._apply_T_E}, use_sim_time)

    def _connect(self, node: Node, topic: str) -> None:
        kind = Float64 if self._pair else Float64MultiArray
        self.topic, self._request = topic, f'{topic}{REQUESTED}'
        self._command = make_publisher(node, kind, topic, LAST_FEW)
        own = {self._request: kind, **estimated_topics(self._structure.wires)}
        for name, message_kind in own.items():
            make_subscription(node, message_kind, name, partial(self._receive, name), LAST_FEW)
        node.create_subscription(JointState, 'joint_states', partial(self._receive, 'joint_states'), SENSOR_QOS)
        make_subscription(node, Temperature, 'ambient_temperature', self.ambient.receive, LAST_FEW)
        heard = {**own, 'joint_states': JointState, 'ambient_temperature': Temperature}
        self._graph_check, self._past = GraphCheck(node, [], heard, [self._request]), ''

    def begin(self, stop: threading.Event) -> None:
        """Say what is limited."""
        late = late_commands(os.environ) if 'fastrtps' in get_rmw_implementation_identifier() else ''
        if late:
            self._logger.warning(f'{late}; see docs/how-to/guard-the-wires.md')
        self._logger.info(
            f'{self._request} -> {self.topic}: no heating until robot, observer and controller send data; stop with Ctrl-C'
        )

    def spin(self, stop: threading.Event) -> None:
        """Pass commands on until `stop` is set."""
        diagnose_at = time.monotonic()
        while not stop.is_set():
            now = time.monotonic()
            self.look(now)
            if now >= diagnose_at:
                diagnose_at = now + DIAGNOSTICS_PERIOD
                self._diagnose()
            time.sleep(POLL_PERIOD)

    def look(self, now: float) -> Decision:
        """Look at the messages that have come until `now` [s] and publish what they ask for; what is in force then."""
        due = False
        while self._new:
            topic = self._new.popleft()
            self._is_estimated = self._is_estimated and topic != COMPLETE
            due = topic in (COMPLETE, self._request) or due
        due = due or now >= self._published_at + self._again_after
        silent = self._silent(now) or self._too_fast() or self._past
        if silent:
            self._turn_off(silent, now)
        elif due:
            self._pass_on(now)
        return self._decision

    def close(self) -> None:
        """Leave zero behind, and the counts."""
        domain = self._node.context.get_domain_id() if self._node.context.ok() else 0
        last = LastMessage(self._command, self._message([0.0] * len(self._structure.commands)), self.topic, domain)
        if not publish_last(last):
            print(f'{self.topic}: not every listener has confirmed the last message, {WARNING}', file=sys.stderr)
        self._save()

    def hear(self, topic: str, message: Any, arrival: float) -> None:
        """A message of a topic arrived at a time [s] that does not go back."""
        self._heard[topic] = (arrival, message)
        if topic == 'joint_states':
            self._robot.hear(seconds_of(message.header.stamp), arrival)
        self._new.append(topic)

    def _receive(self, topic: str, message: Any, info: Any) -> None:
        """Messages wait where this computer is busy, and are that much older."""
        waited = max(time.time_ns() - arrival_of(info), 0)
        self.hear(topic, message, time.monotonic() - 1e-9 * waited)

    @property
    def _again_after(self) -> float:
        """Seconds after which a command is judged anew without any message: half the horizon, in the robot's time."""
        return 0.5 * self._horizon / self._robot.pace

    def _too_fast(self) -> str:
        """Why no command can be judged as often as the horizon asks for, in words; empty where one can."""
        if self._again_after >= POLL_PERIOD:
            return ''
        most = 0.5 * self._horizon / POLL_PERIOD
        return (
            f'the robot is too fast: its time passes {self._robot.pace:.1f} times as fast as a clock, and guard.horizon = '
            f'{self._horizon:g} s of it allows {most:g} times'
        )

    def _apply_T_E(self) -> None:
        self.ambient.apply()
        self._guard.T_E = self.ambient.T_E

    def _silent(self, now: float) -> str:
        """Who is silent, in words; empty where nobody is."""
        for who, topics in (
            ('the controller', [self._request]),
            ('the robot', ['joint_states']),
            ('the observer', list(estimated_topics(self._structure.wires))),
        ):
            ages = [now - self._heard[topic][0] if topic in self._heard else math.inf for topic in topics]
            if max(ages) > self._silence:
                return f'{who} is silent: no {topics[ages.index(max(ages))]} for {self._silence:g} s (guard.silence)'
        return ''

    def _pass_on(self, now: float) -> None:
        """The command that is asked for, as far as it may be in force."""
        asked, wrong = asked_for(self._heard[self._request][1], len(self._structure.commands), self._structure.antagonistic)
        if wrong:
            self._turn_off(f'{REFUSED}: {self._request} = {shown(asked)} W, {wrong}', now)
            return
        if not self._is_estimated:
            self._estimate, self._is_estimated = self._read(), True
        estimate, at = self._estimate, 0.0
        if estimate:
            # Its age on arrival is told by the pose that the robot has shown since, however busy observer and network are.
            at = max(estimate.time + self._robot.pace * (now - self._heard[COMPLETE][0]), self._robot.at(now))
            self._guard.pace = self._robot.pace
            if at > estimate.time + self._silence * self._robot.pace:
                behind = f'its estimate is {at - estimate.time:.2f} s older than the pose of the robot'
                self._turn_off(f'the observer is behind: {behind} (guard.silence {self._silence:g} s)', now)
                return
        self._publish(self._guard.limit(asked, estimate, at), now)

    def _turn_off(self, why: str, now: float) -> None:
        off = Decision((0.0,) * len(self._structure.commands), 0.0, why.partition(':')[0], why)
        if self._decision.kind != off.kind:
            self._guard.counters.interventions[off.kind] += 1
        if self._decision.kind != off.kind or now >= self._published_at + REPEAT_PERIOD:
            self._publish(off, now)

    def _publish(self, decision: Decision, now: float) -> None:
        self._command.publish(self._message(decision.J_eq))
        self._commands, self._published_at = self._commands + 1, now
        kind, before = decision.kind, self._decision.kind
        if kind and now > self._said.get(kind, -math.inf) + AGAIN_AFTER:
            self._logger.warning(f'{decision.reason}: {self._part(decision)} of {self._request} is in force')
        if kind:
            self._said[kind] = now
        self._decision = decision
        if kind != before and kind:
            self._diagnose()

    def _part(self, decision: Decision) -> str:
        return f'{100.0 * decision.scale:.0f} %' if decision.scale > 0.0 else 'nothing'

    def _message(self, J: Sequence[float]) -> Any:
        return Float64(data=float(J[0])) if self._pair else self._messages.heating([float(one) for one in J])

    def _read(self) -> Estimate | None:
        """The estimate that the observer has published last; None for one that cannot be used."""
        wires, last = self._structure.wires, {topic: message for topic, (_, message) in self._heard.items()}
        temperatures = [last[f'{PREFIX}{wire}/temperature'] for wire in self._wires]
        arrays = [list(last[f'{PREFIX}{name}'].data) for name in ('phase_fractions', 'wire_stresses')]
        modes: UInt8MultiArray = last[f'{PREFIX}wire_modes']
        if any(len(array) != 2 * wires for array in arrays) or len(modes.data) != wires:
            return None
        T = np.array([message.temperature + ZERO_CELSIUS for message in temperatures])
        (x_M, x_M_std), (stress, stress_std) = (np.reshape(array, (2, wires)) for array in arrays)
        variances = np.concatenate([[message.variance for message in temperatures], x_M_std**2, stress_std**2])
        return Estimate(
            seconds_of(temperatures[0].header.stamp),
            T,
            x_M,
            stress,
            np.array(list(modes.data), dtype=np.int64),
            np.diag(variances),
            self._strain(last['joint_states']),
            math.nan,
        )

    def _strain(self, joints: JointState) -> Vector:
        """Strains of the wires in the pose that the robot shows; NaN where it shows none."""
        positions = dict(zip(joints.name, joints.position, strict=False))
        q = self._pose(*(positions.get(name, math.nan) for name in self._names))
        lengths = self._structure.lengths
        assert lengths is not None
        strains = self._structure.strains(numbers(lengths(q, self._constants)), self._values)
        return np.array([strain for strain, _ in strains])

    def _written(self) -> str:
        return repr(self._guard.counters)

    def _save(self) -> None:
        if self._path is None or self._written() == self._saved:
            return
        try:
            self._guard.counters.save(self._path)
            self._saved = self._written()
        except UserError as error:
            self._logger.error(str(error), throttle_duration_sec=10.0)

    def _not_obeyed(self) -> list[str]:
        """Limits that wires have passed although nothing had to be taken away, which the log says too."""
        passed = self._guard.passed(self._estimate) if self._estimate and not self._decision.kind else []
        if not passed:
            return []
        words = f'{"; ".join(passed)}, at {self.topic} = {shown(self._decision.J_eq)} W: does the robot obey it?'
        self._logger.warning(words, throttle_duration_sec=REMINDER_PERIOD)
        return [words]

    def _diagnose(self) -> None:
        stamped, count = f'{self.topic}{SUFFIX}', self._graph_check.publishers
        past = [topic for topic, own in ((self.topic, 1), (stamped, 0)) if count(topic) > own]
        self._past = (
            f'another node publishes {" and ".join(past)} past the guard, which cannot limit it: let it publish '
            f'{self._request}, of the type of {self.topic} (-r {self.topic}:={self._request})'
            if past
            else ''
        )
        decision, counters = self._decision, self._guard.counters
        problems = [*self._not_obeyed(), *self._graph_check.problems()]
        values: dict[str, Any] = {
            'part of the command in force': f'{decision.scale:.3f}',
            'reason': decision.reason or 'none',
            'commands': self._commands,
            **{f'interventions: {kind}': count for kind, count in sorted(counters.interventions.items())},
            **{f'cycles of {wire}': f'{n:g}' for wire, n in zip(self._wires, counters.cycles, strict=True)},
        }
        words = [decision.reason or 'all that is asked for is in force', *problems]
        self._diagnostics.publish('; '.join(words), warn=bool(decision.kind or problems), values=values)
        self._save()
