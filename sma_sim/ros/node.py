"""The node `sma_module_sim`: steps the module at a fixed rate and talks to ROS. No equation lives here."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64, Float64MultiArray, UInt8MultiArray

from sma_sim.model.config import Config
from sma_sim.model.parameters import DEFAULTS
from sma_sim.ros import messages
from sma_sim.solver.fixed_rate import FixedRateRun, steps_per_sample
from sma_sim.solver.simulate import Model

WARNING_PERIOD = 2.0  # [s] between two warnings of one kind
LATENESS_TO_MAKE_UP = 0.1  # [s]; beyond it the schedule moves, so that an overrun is not answered with a burst


class Command:
    """The command that is in force, and what was wrong with those that are not."""

    def __init__(self, node: Node, J_max: float, timeout: float) -> None:
        self._logger, self._J_max, self._timeout = node.get_logger(), J_max, timeout
        self._J_eq, self._arrived = 0.0, math.inf
        self.rejected = 0

    def receive(self, message: Float64) -> None:
        """Take a command, clipped to J_max; refuse one that is not a finite number."""
        J_eq = float(message.data)
        if not math.isfinite(J_eq):
            self.rejected += 1
            self._logger.warning(
                f'J_eq = {J_eq} W refused: expected a finite number; the last good command stays in force',
                throttle_duration_sec=WARNING_PERIOD,
            )
            return
        if abs(J_eq) > self._J_max:
            self._logger.warning(
                f'J_eq = {J_eq:g} W clipped to node.J_max = {self._J_max:g} W', throttle_duration_sec=WARNING_PERIOD
            )
        self._J_eq = min(max(J_eq, -self._J_max), self._J_max)
        self._arrived = time.monotonic()

    def now(self) -> float:
        """The command in force [W]; zero after `timeout` seconds without one."""
        if self._timeout > 0.0 and time.monotonic() - self._arrived > self._timeout:
            self._logger.warning(
                f'no command for node.command_timeout = {self._timeout:g} s: heating is off until the next one'
            )
            self._J_eq, self._arrived = 0.0, math.inf
        return self._J_eq


class ModuleSimulation:
    """The simulated module behind the topics of one node."""

    def __init__(self, node: Node, config: Config, settings: Mapping[str, float]) -> None:
        self._node, self._rate = node, settings['integration_rate']
        self._every = steps_per_sample(self._rate, settings['publish_rate'])
        self._ambient = config.parameters['environment.T_E']
        self.overruns = 0
        self._run = FixedRateRun(Model(config), self._rate, np.array([0.0, self._ambient]))
        for note in self._run.notes:
            node.get_logger().info(note)
        self.command = Command(node, settings['J_max'], settings['command_timeout'])
        self._senses = any(one.found.effect.port == 'sensing' for one in config.effects)
        self._advertise()
        node.create_subscription(Float64, 'J_eq', self.command.receive, 10)
        node.create_subscription(Temperature, 'ambient_temperature', self._receive_ambient, 10)
        node.add_on_set_parameters_callback(self._set_parameters)
        self._applied = math.nan
        self._modes = [int(m) for m in messages.of_wires(self._run.sample, 'mode')]

    def _advertise(self) -> None:
        def publisher(kind: Any, topic: str, qos: Any = 10) -> Any:
            return self._node.create_publisher(kind, topic, qos)

        self._joints = publisher(JointState, 'joint_states')
        self._true_joints = publisher(JointState, 'true_joint_states') if self._senses else None
        self._wires = publisher(JointState, 'wire_states')
        self._forces = publisher(Float64MultiArray, 'wire_forces')
        self._modes_topic = publisher(UInt8MultiArray, 'wire_modes')
        self._temperatures = [publisher(Temperature, f'{wire}/temperature') for wire in messages.WIRES]
        self._fractions = publisher(Float64MultiArray, 'phase_fractions')
        latest = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._applied_topic = publisher(Float64, 'J_eq_applied', latest)

    def spin(self, stop: threading.Event) -> None:
        """Step in time until `stop` is set. Raises SimulationError."""
        self._epoch = self._node.get_clock().now().nanoseconds // 1000 * 1e-6  # whole microseconds: exact in a log
        start = time.monotonic()
        self._node.get_logger().info(f'simulated time 0 has the stamp {self._epoch:.9f}')
        self._publish()
        while not stop.is_set():
            wait = start + (self._run.k + 1) / self._rate - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
            elif wait < -LATENESS_TO_MAKE_UP:
                self.overruns += 1
                start -= wait
                self._node.get_logger().warning(
                    f'{-wait:.2f} s behind the clock: simulated time stands still for as long',
                    throttle_duration_sec=WARNING_PERIOD,
                )
            self._step()

    def _step(self) -> None:
        J_eq = self.command.now()
        if J_eq != self._applied:
            self._applied = J_eq
            self._applied_topic.publish(Float64(data=J_eq))
        self._run.step(np.array([J_eq, self._ambient]))
        for jump in self._run.take_jumps():
            self._modes[jump.wire - 1] = jump.target
            self._modes_topic.publish(messages.wire_modes(self._modes))
        if self._run.k % self._every == 0:
            self._publish()

    def _publish(self) -> None:
        row = self._run.sample
        stamp = messages.stamp_of(self._epoch + self._run.time)
        self._joints.publish(messages.joint_state(stamp, row, sensed=True))
        if self._true_joints is not None:
            self._true_joints.publish(messages.joint_state(stamp, row, sensed=False))
        self._wires.publish(messages.wire_state(stamp, row))
        self._forces.publish(messages.wire_forces(row))
        for wire, topic in enumerate(self._temperatures):
            topic.publish(messages.temperature(stamp, row, wire))
        self._fractions.publish(messages.phase_fractions(row))
        self._modes = [int(mode) for mode in messages.of_wires(row, 'mode')]
        self._modes_topic.publish(messages.wire_modes(self._modes))

    def _receive_ambient(self, message: Temperature) -> None:
        kelvin = message.temperature + messages.FREEZING
        low, high = DEFAULTS['environment.T_E'].bounds
        if not low <= kelvin <= high:
            self._node.get_logger().warning(
                f'ambient_temperature = {message.temperature} deg C refused: expected {low - messages.FREEZING:g} to '
                f'{high - messages.FREEZING:g} deg C',
                throttle_duration_sec=WARNING_PERIOD,
            )
            return
        self._ambient = kelvin

    def _set_parameters(self, parameters: list[Any]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name == 'environment.T_E':
                self._ambient = float(parameter.value)
        return SetParametersResult(successful=True)
