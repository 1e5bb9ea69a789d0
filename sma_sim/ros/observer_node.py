"""The node `sma_observer`: what the wires of a robot do that nobody measures, from its commands and sensors."""

from __future__ import annotations

import math
import threading
import time
from typing import Any

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import Temperature
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout, UInt8MultiArray

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.state_estimation.estimate import Estimate
from sma_sim.evidence.state_estimation.observer import Observer
from sma_sim.model.config import Config
from sma_sim.ros.command import ENVIRONMENT
from sma_sim.ros.control import Diagnostics
from sma_sim.ros.entry import model_description
from sma_sim.ros.graph_check import GraphCheck
from sma_sim.ros.messages import Messages, stamp_of
from sma_sim.ros.parameters import follow_live_parameters
from sma_sim.ros.qos import LAST_FEW, make_publisher
from sma_sim.ros.robot_clock import FILLED_IN, stamp_fault
from sma_sim.ros.robot_subscriptions import MAX_DELAY, RobotSubscriptions, Sample, robot_topics, wire_names

POLL_PERIOD = 0.002  # [s] between two looks for samples
SILENCE = 1.0  # [s] without a sample after which it is said
RESTART_AFTER = 10.0  # [s] without a sample after which the observer restarts
INCONSISTENT = 9.0  # squared innovation over its variance, in the mean: the robot is not what the observer takes it for
PREFIX = 'estimated/'


def estimated_topics(wires: int) -> dict[str, Any]:
    """Message types of what the observer publishes, by topic."""
    temperatures = {f'{PREFIX}wire_{i + 1}/temperature': Temperature for i in range(wires)}
    arrays = {f'{PREFIX}{name}': Float64MultiArray for name in ('phase_fractions', 'wire_stresses')}
    return {**temperatures, **arrays, f'{PREFIX}wire_modes': UInt8MultiArray}


def means_and_stds(what: str, mean: Any, std: Any) -> Float64MultiArray:
    """Two rows: values of all wires, and their standard deviations."""
    wires = len(mean)
    rows = MultiArrayDimension(label=f'{what}: values, then standard deviations', size=2, stride=2 * wires)
    columns = MultiArrayDimension(label=f'of {", ".join(f"wire_{i + 1}" for i in range(wires))}', size=wires, stride=wires)
    return Float64MultiArray(layout=MultiArrayLayout(dim=[rows, columns]), data=[*mean.tolist(), *std.tolist()])


class WireObserver:
    """An `Observer` of the robot whose topics one node hears."""

    def __init__(self, node: Node, config: Config, use_sim_time: bool) -> None:
        self._node, self._config, self._logger = node, config, node.get_logger()
        structure = config.structure
        self._messages, self._wires = Messages(structure), wire_names(structure)
        warmed = Observer(config)  # compiled now, not at the first sample
        for k in range(2):
            warmed.update(0.01 * k, None, {structure.channels[0]: 0.0})
        self._fresh()
        topics = estimated_topics(structure.wires)
        self._topics = {name: make_publisher(node, kind, name, LAST_FEW) for name, kind in topics.items()}
        self._diagnostics = Diagnostics(node, 'observer of the wires')
        self._graph_check = GraphCheck(node, list(topics), robot_topics(structure))
        self._robot = RobotSubscriptions(node, config, config.parameters['observer.latency'], MAX_DELAY)
        self._input = [0.0] * (len(structure.input_columns) - 1) + [config.parameters[ENVIRONMENT]]
        self._samples = self._starts = 0
        self._moved_at = math.inf  # when a sample came whose stamp had moved on [s]
        follow_live_parameters(node, {ENVIRONMENT: self._robot.apply_T_E}, use_sim_time)

    def _fresh(self) -> None:
        self._observer, self._begin = Observer(self._config), 0
        self._before: Sample | None = None

    def begin(self, stop: threading.Event) -> None:
        """Say what runs."""
        self._logger.info(f'observing with {model_description(self._config)}; waiting for joint_states; stop with Ctrl-C')

    def spin(self, stop: threading.Event) -> None:
        """Follow the robot until `stop` is set."""
        self._robot.follow(stop, self._take, self._diagnose, POLL_PERIOD)

    def close(self) -> None:
        """Nothing is left behind."""

    def _take(self, now: Sample) -> None:
        """Take a sample, which may be older than the one before, and publish the estimate."""
        before = self._before
        if before is not None and now.time - before.time > RESTART_AFTER * 1e9:
            self._logger.warning(f'no joint_states for {(now.time - before.time) / 1e9:.3f} s: the observer restarts')
            self._robot.forget_commands()
            self._fresh()
            before = None
        if before is None:
            self._begin, self._starts = now.time, self._starts + 1
            self._tell(now.time, self._robot.T_E, self._input[-1])  # what is in force is no change, but nobody else knows
        step = math.inf if before is None else 1e-9 * (now.time - before.time)
        fault = stamp_fault(step)
        if before is not None and step == 0.0 and np.isfinite(before.joints[0] + now.joints[0]).any():
            self._robot.warn_of(fault, f'what was measured once counts once; {FILLED_IN}')
            return
        if not fault:
            self._moved_at = time.monotonic()
            for change in self._robot.changes(before, now):
                self._tell(change.stamp, change.column, change.value)
            self._before = now
        structure = self._config.structure
        measured = np.concatenate([now.joints[0], self._robot.companions(None if fault else before, now)])
        channels = {name: float(value) for name, value in zip(structure.channels, measured, strict=True)}
        estimate = self._observer.update(self._seconds(now.time), None, channels)
        self._samples += 1
        if not fault:
            self._publish(now.stamp, estimate)

    def _tell(self, time: int, column: int, value: float) -> None:
        """A column of the input has a value from a time [ns] on."""
        self._input[column] = value
        self._observer.tell(self._seconds(time), self._input[:-1], {}, self._input[-1])

    def _seconds(self, time: int) -> float:
        return (time - self._begin) / 1e9

    def _publish(self, stamp: int, estimate: Estimate) -> None:
        at = stamp_of(stamp)
        for i, wire in enumerate(self._wires):
            message = Temperature(
                header=Header(stamp=at, frame_id=wire),
                temperature=float(estimate.T[i]) - ZERO_CELSIUS,
                variance=float(estimate.T_std[i]) ** 2,
            )
            self._topics[f'{PREFIX}{wire}/temperature'].publish(message)
        fractions = means_and_stds('x_M [-]', estimate.x_M, estimate.x_M_std)
        self._topics[f'{PREFIX}phase_fractions'].publish(fractions)
        stresses = means_and_stds('stress [Pa]', estimate.stress, estimate.stress_std)
        self._topics[f'{PREFIX}wire_stresses'].publish(stresses)
        self._topics[f'{PREFIX}wire_modes'].publish(self._messages.wire_modes(estimate.modes.tolist()))

    def _diagnose(self) -> None:
        silence = self._robot.silence(SILENCE)
        problems = [*self._graph_check.problems(), *silence, *self._robot.overload()]
        standstill = time.monotonic() - self._moved_at
        if standstill > SILENCE and not silence:
            problems.append(f'the stamps of joint_states have stood still for {standstill:.0f} s: {FILLED_IN}')
        values: dict[str, Any] = {}
        if self._samples and not math.isnan(self._observer.time):
            estimate = self._observer.estimate
            if estimate.inconsistency > INCONSISTENT:
                problems.append(
                    f'the robot differs from the model by {math.sqrt(estimate.inconsistency):.1f} times what the observer '
                    'allows for: see observer.discrepancy, or fit the model'
                )
            for i, wire in enumerate(self._wires):
                T = estimate.T[i] - ZERO_CELSIUS
                values[f'temperature of {wire} [deg C]'] = f'{T:.1f} +- {estimate.T_std[i]:.1f}'
            values['squared innovation over its variance'] = f'{estimate.inconsistency:.2g}'
        values |= {
            'command': self._robot.heating_followed,
            'samples': self._samples,
            'samples waiting': self._robot.waiting,
            'messages that came too late': self._observer.too_late,
            'starts': self._starts,
            'restarts of the model': self._observer.restarts,
            **self._robot.skipped(),
            **self._robot.rejected(),
        }
        state = 'observing' if self._samples else 'waiting for joint_states'
        self._diagnostics.publish('; '.join([state, *problems]), warn=bool(problems), values=values)
