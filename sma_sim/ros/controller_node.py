"""The node `sma_controller`: joint states of a robot in, the command that moves it along a target out.

Times are those of the stamps of joint_states, so that the loop is the same at any real-time factor, and go on where a clock
is set. Before there is a target nothing is commanded. Whatever stops it, but SIGKILL or a crash, leaves a command of zero
behind, as all programs that command a robot do (`ros.last_command`).
"""

from __future__ import annotations

import math
import sys
import threading
import time
from collections import deque
from typing import Any

import numpy as np
from rclpy.node import Node
from std_msgs.msg import Float64, Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from sma_sim.evidence.control.feedforward import EARLY, FeedforwardPI
from sma_sim.evidence.control.predictive import PredictiveController
from sma_sim.evidence.data.rosbag.interface import PAIR_COMMAND, interface_of
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.expected_units import REACH
from sma_sim.ros.command import ENVIRONMENT
from sma_sim.ros.control import Diagnostics
from sma_sim.ros.entry import model_description
from sma_sim.ros.graph_check import GraphCheck
from sma_sim.ros.guard_node import REQUESTED
from sma_sim.ros.joint_path import Held, JointPath, RefusedError, check
from sma_sim.ros.last_command import WARNING, LastMessage, publish_last
from sma_sim.ros.messages import Messages
from sma_sim.ros.parameters import follow_live_parameters
from sma_sim.ros.qos import LAST_FEW, make_publisher, make_subscription
from sma_sim.ros.robot_clock import FILLED_IN, stamp_fault
from sma_sim.ros.robot_subscriptions import MAX_DELAY, RobotSubscriptions, Sample, robot_topics
from sma_sim.solver.simulate import SimulationError

Law = PredictiveController | FeedforwardPI
LAWS: dict[str, type[Law]] = {'predictive': PredictiveController, 'feedforward': FeedforwardPI}
POLL_PERIOD = 0.002  # [s] between two looks for samples


class ModelController:
    """A controller with a model, of the robot whose topics one node hears."""

    def __init__(self, node: Node, config: Config, use_sim_time: bool) -> None:
        self._config, self._logger = config, node.get_logger()
        structure, given = config.structure, config.parameters
        law = str(config.settings['control.law'])
        if law not in LAWS:
            raise UserError(f'control.law = {law!r}: expected {" or ".join(LAWS)}')
        self._make = LAWS[law]
        tried = self._make(config)  # compiled now, not at the first sample
        tried.step(0.0, {tried.coordinate: 0.0}, np.zeros_like)
        self._structure, self._messages, self._coordinate = structure, Messages(structure), tried.coordinate
        self._period, self._silence = 1.0 / given['control.rate'], given['control.silence']
        self._column = structure.coordinate_names.index(tried.coordinate)
        followed = structure.coordinates[self._column]
        self._limit = min(followed.limit, REACH.get(followed.unit, math.inf))
        self._joint = str(config.settings[f'check.name_{tried.coordinate}'])
        topic = interface_of(structure).heating_topic
        self._pair = topic == PAIR_COMMAND
        self.topic = f'{topic}{REQUESTED}' if config.settings['control.behind_guard'] else topic
        self._command = make_publisher(node, Float64 if self._pair else Float64MultiArray, self.topic, LAST_FEW)
        self._domain = node.context.get_domain_id()
        asked = {f'{tried.coordinate}_target': Float64, '~/joint_trajectory': JointTrajectory}
        self._heard: deque[Any] = deque(maxlen=100)  # targets that were not looked at yet
        for name, kind in asked.items():
            make_subscription(node, kind, name, self._hear, LAST_FEW)
        self._target: Held | JointPath | None = None
        if config.settings['control.hold']:
            self._heard.append(Float64(data=given['control.target']))
        self._robot = RobotSubscriptions(node, config, 0.0, MAX_DELAY)
        self._diagnostics = Diagnostics(node, 'controller of the robot')
        self._graph_check = GraphCheck(node, [self.topic], {**robot_topics(structure), **asked})
        self._input = [0.0] * len(structure.commands)
        self._commands, self._starts, self._longest = 0, 0, 0.0
        self._error, self._arrived = math.nan, math.inf
        self._lacking = ''  # what joint_states have lacked since the last sample that could be answered
        self._newest: Sample | None = None  # ever
        self._before: Sample | None = None  # of this start
        self._start(0)
        follow_live_parameters(node, {ENVIRONMENT: self._robot.apply_T_E}, use_sim_time)

    def begin(self, stop: threading.Event) -> None:
        """Say what runs."""
        self._logger.info(
            f'{self._coordinate} by {self._make.__name__} with {model_description(self._config)}: joint_states -> '
            f'{self.topic}; waiting for joint_states and a target; stop with Ctrl-C'
        )

    def spin(self, stop: threading.Event) -> None:
        """Control the robot until `stop` is set."""
        self._robot.follow(stop, self._take, self._diagnose, POLL_PERIOD, self._watch)

    def close(self) -> None:
        """Leave zero behind."""
        if not publish_last(LastMessage(self._command, self._message(0.0), self.topic, self._domain)):
            print(f'{self.topic}: not every listener has confirmed the last message, {WARNING}', file=sys.stderr)

    def _hear(self, message: Any) -> None:
        self._heard.append(message)

    def _start(self, time: int) -> None:
        """A controller that takes the robot to be at rest at a time [ns]."""
        self._law: Law = self._make(self._config)
        self._first, self._due = time, 0.0
        if self._target is not None:
            self._target = Held(self._target.at(1e-9 * time)[0])

    def _take(self, now: Sample) -> None:
        """Answer a sample with a command, `control.rate` times per second."""
        before, began = self._before, time.monotonic()
        if self._newest is None:
            self._newest = now  # whether its stamps move on shows with the next one
            return
        later = 1e-9 * (now.time - self._newest.time)
        fault = stamp_fault(later) if later > -self._silence else ''
        if fault:
            self._lack(fault, f'they are no new samples; {FILLED_IN}')
            return
        self._newest = now
        known = math.isfinite(now.joints[0][self._column])
        if known:
            self._arrived, self._lacking = began, ''
        else:
            self._lack(f'joint_states without {self._coordinate}', f'expected a finite position of {self._joint}')
            if self._before is None:
                return  # nothing is commanded, and no start is to be known by it
        if before is None or not 0.0 < later < self._silence:
            if before is not None:
                self._logger.warning('the stamps of joint_states have a gap: the controller restarts')
            self._robot.forget_commands()
            self._start(now.time)
            before, self._starts = None, self._starts + 1
        for change in self._robot.changes(before, now):
            self._tell(self._seconds(change.stamp), change.column, change.value)
        self._before = now
        if known:
            self._take_targets(1e-9 * now.time, 1e-9 * now.jumped)
        channels = np.concatenate([now.joints[0], self._robot.companions(before, now)])
        try:
            self._act(self._seconds(now.time), dict(zip(self._structure.channels, channels.tolist(), strict=True)), known)
        except SimulationError as error:
            self._logger.warning(f'{error}: heating off, and the controller restarts', throttle_duration_sec=1.0)
            self._turn_off()
        self._longest = max(self._longest, time.monotonic() - began)

    def _lack(self, words: str, advice: str) -> None:
        """Joint states have come that cannot be answered: heating off once there have been no others for long."""
        self._robot.warn_of(words, advice)
        self._lacking = self._lacking or words
        self._turn_off_in_silence()

    def _act(self, t: float, channels: dict[str, float], known: bool) -> None:
        """Command what the law says, where target and coordinate are known and a period has passed."""
        target, first = self._target, 1e-9 * self._first
        if target is None or not known or t < self._due - EARLY:
            self._law.observe(t, None, channels)
            return
        self._due = max(self._due + self._period, t)
        self._publish(self._law.step(t, channels, lambda times: target(first + times)))
        self._error = target.at(first + t)[0] - channels[self._coordinate]

    def _tell(self, t: float, column: int, value: float) -> None:
        """A column of the input has a value from a time [s] on."""
        if column == self._robot.T_E:
            self._law.observe(t, None, None, value)
            return
        self._input[column] = value
        self._law.observe(t, self._input[0])

    def _take_targets(self, now: float, ahead: float) -> None:
        """Targets that have arrived since the sample before, by the time `now` [s] of this one; stamps are `ahead` [s]."""
        while self._heard:
            message, limit = self._heard.popleft(), self._limit
            try:
                if isinstance(message, JointTrajectory):
                    check(message, self._joint, -limit, limit)
                    motion = self._target.at(now) if self._target else [self._measured(), 0.0, 0.0]
                    self._target = JointPath(message, now, motion, ahead) if message.points else Held(motion[0])
                elif -limit <= message.data <= limit:
                    self._target = Held(message.data)
                else:
                    raise RefusedError('', f'{message.data}: expected {-limit:.4g} to {limit:.4g}')
            except RefusedError as error:
                self._logger.warning(f'target of {self._coordinate} refused: {error.args[1]}')

    def _measured(self) -> float:
        """Where the coordinate was at the last sample."""
        assert self._before is not None
        return float(self._before.joints[0][self._column])

    def _seconds(self, time: int) -> float:
        return 1e-9 * (time - self._first)

    def _watch(self) -> None:
        """Heating off once joint states have stopped; those that wait may be the ones that are missed."""
        if not self._robot.waiting:
            self._turn_off_in_silence()

    def _turn_off_in_silence(self) -> None:
        """Heating off where no sample could be answered for long."""
        if self._before is not None and time.monotonic() - self._arrived > self._silence:
            missed = f'new joint_states ({self._lacking})' if self._lacking else 'joint_states'
            self._logger.warning(f'no {missed} for {self._silence:g} s (control.silence): heating off until they come back')
            self._turn_off()

    def _turn_off(self) -> None:
        """Command zero; the next sample is the first of a new start."""
        self._publish(0.0)
        self._before, self._error = None, math.nan

    def _publish(self, J: float) -> None:
        self._command.publish(self._message(J))
        self._commands += 1

    def _message(self, J: float) -> Any:
        return Float64(data=J) if self._pair else self._messages.heating([J])

    def _diagnose(self) -> None:
        problems = [*self._graph_check.problems(), *self._robot.silence(self._silence), *self._robot.overload()]
        if self._before is None and self._lacking:
            problems.append(f'{self._lacking}: heating off')
        state = (
            'waiting for a target' if self._target is None else 'following' if self._before else 'waiting for joint_states'
        )
        values: dict[str, Any] = {
            'error': f'{self._error:.3g}',
            'commands': self._commands,
            'starts': self._starts,
            'longest step [ms]': f'{1e3 * self._longest:.1f}',
            **self._robot.skipped(),
            **self._robot.rejected(),
        }
        self._longest = 0.0
        self._diagnostics.publish('; '.join([state, *problems]), warn=bool(problems), values=values)
