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
from sma_sim.model.errors import UserError
from sma_sim.model.parameters import DEFAULTS
from sma_sim.ros import messages
from sma_sim.ros.control import DIAGNOSTICS_PERIOD, Control, Diagnostics
from sma_sim.ros.schedule import Schedule, Speed
from sma_sim.solver.fixed_rate import FixedRateRun, steps_per_sample
from sma_sim.solver.simulate import Model

WARNING_PERIOD = 2.0  # [s] between two warnings of one kind
IDLE = 0.01  # [s] between two looks for a wish while paused


class Command:
    """The command that is in force, and what was wrong with those that are not."""

    def __init__(self, node: Node, J_max: float, timeout: float) -> None:
        self._logger, self._J_max, self._timeout = node.get_logger(), J_max, timeout
        self.clear()
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
        self._fresh = True

    def clear(self) -> None:
        """No command: heating off, until the next one."""
        self._J_eq, self._arrived, self._fresh = 0.0, math.inf, False

    def at(self, t: float) -> float:
        """The command in force [W] at simulated time t [s]; zero after `timeout` seconds without one."""
        if self._fresh:
            self._arrived, self._fresh = t, False
        if self._timeout > 0.0 and t - self._arrived > self._timeout:
            self._logger.warning(
                f'no command for node.command_timeout = {self._timeout:g} s: heating is off until the next one'
            )
            self.clear()
        return self._J_eq


class ModuleSimulation:
    """The simulated module behind the topics of one node."""

    def __init__(self, node: Node, config: Config, settings: Mapping[str, float]) -> None:
        self._node, self._rate = node, settings['integration_rate']
        try:
            self._every = steps_per_sample(self._rate, settings['publish_rate'])
        except UserError as error:
            raise UserError(f'node.publish_rate and node.integration_rate: {error}') from error
        self._ambient = config.parameters['environment.T_E']
        self._model = Model(config)
        self._run = FixedRateRun(self._model, self._rate, np.array([0.0, self._ambient]))
        for note in self._run.notes:
            node.get_logger().info(note)
        self.command = Command(node, settings['J_max'], settings['command_timeout'])
        self._schedule, self._speed = Schedule(self._rate, settings['real_time_factor']), Speed()
        self._control, self._diagnostics = Control(node), Diagnostics(node)
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
        self._begin()
        diagnose_at = time.monotonic() + DIAGNOSTICS_PERIOD
        while not stop.is_set():
            if self._control.take_wish() == 'reset':
                self._reset()
                self._control.fulfil()
            elif self._control.paused:
                self._idle()
            else:
                self._step_in_time()
            if time.monotonic() >= diagnose_at:
                diagnose_at += DIAGNOSTICS_PERIOD
                self._diagnose()

    def _begin(self) -> None:
        self._epoch = self._node.get_clock().now().nanoseconds
        seconds, nanoseconds = divmod(self._epoch, 10**9)
        self._node.get_logger().info(f'simulated time 0 has the stamp {seconds}.{nanoseconds:09d}')
        self._schedule.restart()
        self._publish()

    def _reset(self) -> None:
        self.command.clear()
        self._speed = Speed()
        self._run = FixedRateRun(self._model, self._rate, np.array([0.0, self._ambient]))
        self._begin()

    def _idle(self) -> None:
        if self._control.take_wish() == 'step':
            self._step()
            self._control.fulfil()
        else:
            time.sleep(IDLE)
        self._schedule.restart()

    def _step_in_time(self) -> None:
        moved = self._schedule.wait()
        if moved > 0.0:
            self._node.get_logger().warning(
                f'{moved:.2f} s behind the clock: simulated time stands still for as long',
                throttle_duration_sec=WARNING_PERIOD,
            )
        self._step()

    def _diagnose(self) -> None:
        factor = self._speed.since_last(self._run.time)
        values = {
            'simulated time [s]': f'{self._run.time:.3f}',
            'real-time factor': f'{factor:.4f}',
            'overruns': self._schedule.overruns,
            'rejected commands': self.command.rejected,
            'J_eq applied [W]': f'{self._applied:g}',
        }
        words = 'paused' if self._control.paused else 'running'
        self._diagnostics.publish(words, warn=self._schedule.overruns > 0, values=values)

    def _step(self) -> None:
        J_eq = self.command.at(self._run.time)
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
        stamp = messages.stamp_of(self._epoch + round(self._run.k * 1e9 / self._rate))
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
