"""The node `sma_model_check`: runs the model beside a robot and warns when it has left the measurement."""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header
from std_srvs.srv import Trigger

from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.data.rosbag.interface import APPLIED
from sma_sim.evidence.monitoring.live_model import (
    Announcements,
    ComparedSample,
    DepartureDetector,
    LiveHistory,
    LiveModel,
    RunningError,
)
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.ros.cause_watch import CauseWatch
from sma_sim.ros.command import ENVIRONMENT
from sma_sim.ros.control import Diagnostics
from sma_sim.ros.entry import model_description
from sma_sim.ros.graph_check import GraphCheck
from sma_sim.ros.messages import Messages, array_layout, stamp_of
from sma_sim.ros.parameters import follow_live_parameters
from sma_sim.ros.qos import LAST_FEW, make_publisher
from sma_sim.ros.robot_clock import FILLED_IN, stamp_fault
from sma_sim.ros.robot_subscriptions import REMINDER_PERIOD, RobotSubscriptions, Sample, robot_topics
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import SimulationError

if TYPE_CHECKING:
    from sma_sim.evidence.monitoring.live_diagnosis import LiveFinding


POLL_PERIOD = 0.005  # [s] between two looks for samples
AT_REST = 'Zero of a sensor, gravity or another load, or initial.*?'  # what is wrong then
HISTORY = 300.0  # [s] of the past beside which a model that takes another's place is run
SILENCE = 3.0  # [s] without a sample after which it is said: slower robots are not followed
OUTPUT_TOPICS: Mapping[str, Any] = {
    'model_joint_states': JointState,
    'residuals': JointState,
    'channel_residuals': Float64MultiArray,
    'error_over_noise': Float64MultiArray,
}


class Observer(Protocol):
    """Hears of every comparison, and once a second how the check is."""

    def sample(self, stamp: int, measured: Vector, model: Vector, error: Vector) -> None:
        """A comparison at `stamp` [ns], arrays (channels,)."""

    def state(self, state: str, problems: Sequence[str], samples: int) -> None:
        """What the check is doing, what is wrong, how many samples were compared."""

    def replaced(self, samples: Sequence[tuple[int, Vector, Vector, Vector]], failed: str) -> None:
        """Another model has taken the place of the one before: all comparisons anew, as in `sample`; or why it has not."""

    def cause(self, found: LiveFinding) -> None:
        """What may have changed on the robot; from a thread of its own."""

    def close(self) -> None:
        """The check has ended."""


class ModelCheck:
    """The model beside the robot whose topics one node hears."""

    def __init__(self, node: Node, config: Config, use_sim_time: bool, observer: Observer | None = None) -> None:
        self._observer = observer
        self._node, self._config, self._rate = node, config, config.parameters['node.integration_rate']
        if not config.structure.coordinates:
            raise UserError(
                f'system = {config.system}: the live check takes its pace from joint_states, and a {config.system} has no '
                'joints; compare recordings with sma-sim compare'
            )
        self._logger, self._model = node.get_logger(), Model(config)
        structure = self._model.structure
        self._messages, self._channels = Messages(structure), structure.channels
        self._values = {name.removeprefix('check.'): value for name, value in config.parameters.items()}
        self._noise = np.array([self._values[f'noise_{channel}'] for channel in self._channels])
        self._input = [0.0] * (len(structure.input_columns) - 1) + [config.parameters['environment.T_E']]
        for note in FixedRateRun(self._model, self._rate, np.array(self._input)).notes:
            self._logger.info(note)
        self._error = RunningError(self._values['window'], len(self._channels))
        self._live: LiveModel | None = None
        self._before: Sample | None = None
        self._starts, self._samples = 0, 0
        self._compared_at = math.inf  # when a channel was compared last, or could first have been [s]
        self._announcements = Announcements(REMINDER_PERIOD)
        self._reset_requested = threading.Event()
        self._others: queue.SimpleQueue[tuple[Config, Model]] = queue.SimpleQueue()
        self._history = LiveHistory(HISTORY if observer is not None else 0.0)
        self._causes = CauseWatch(
            node, config, self._noise, self._values['diagnosis_period'], None if observer is None else observer.cause
        )
        self._heated: set[int] = set()  # wires that were heated since the model started
        self._forget_verdict()
        self._topics = {name: make_publisher(node, kind, name, LAST_FEW) for name, kind in OUTPUT_TOPICS.items()}
        self._diagnostics = Diagnostics(node, 'robot beside the model')
        self._graph_check = GraphCheck(node, ['joint_states', *OUTPUT_TOPICS], robot_topics(structure))
        self._robot = RobotSubscriptions(node, config)
        follow_live_parameters(node, {ENVIRONMENT: self._robot.apply_T_E}, use_sim_time)
        node.create_service(Trigger, '~/reset', self._reset)

    def begin(self, stop: threading.Event) -> None:
        """Say what runs."""
        self._logger.info(
            f'beside the robot: {model_description(self._config)}, {self._rate:g} steps/s; waiting for joint_states; '
            'stop with Ctrl-C'
        )

    def spin(self, stop: threading.Event) -> None:
        """Follow the robot until `stop` is set."""
        self._robot.follow(stop, self._take, self._diagnose, POLL_PERIOD, self._replace_model)

    def use(self, config: Config, model: Model) -> None:
        """Put another model of the same structure in the place of this one, beside the same past; any thread may ask."""
        self._others.put((config, model))

    def close(self) -> None:
        """Look for causes no more; tell the observer, if there is one."""
        self._causes.close()
        if self._observer is not None:
            self._observer.close()

    def _reset(self, _: Any, response: Any) -> Any:
        self._reset_requested.set()
        response.success, response.message = True, 'the model restarts with the next sample'
        return response

    def _forget_verdict(self) -> None:
        self._error.clear()
        self._departure = DepartureDetector(self._values['threshold'], self._values['window'], len(self._channels))
        self._announcements.restart()
        self._follows = False
        self._settled_at = math.inf  # [s] since the start of the model
        self._rest: NDArray[np.bool_] | None = None  # channels that are away before anything is heated; None: not known yet
        self._last_error = np.full(len(self._channels), np.nan)

    def _take(self, now: Sample) -> None:
        """Bring the model to a sample and compare."""
        before = self._before
        step = (now.stamp - before.stamp) / 1e9 if before is not None else 0.0
        if before is not None and step > -self._values['latency'] and (fault := stamp_fault(step)):
            self._robot.warn_of(fault, f'they are not compared; {FILLED_IN}')
            return
        reason = self._restart_reason(step)
        self._before = now
        try:
            if self._live is None or reason:
                self._start(now, reason)
            else:
                changes = self._inputs(before, now)
                row = self._live.advance(now.stamp, changes)
                measured = np.concatenate([now.joints[0], self._robot.companions(before, now)])
                sample = ComparedSample(now.stamp, changes, measured)
                if self._observer is not None:
                    self._history.add(sample)
                self._compare(now, row, measured)
                self._causes.add(sample, row[self._messages.where.sensed], not math.isinf(self._settled_at))
        except SimulationError as error:
            self._live = None
            self._robot.warn_of('the model cannot go on', f'{error}; it restarts with the next sample')

    def _restart_reason(self, step: float) -> str:
        """Why the model cannot continue from the sample before, `step` seconds ago; empty if it can."""
        if self._reset_requested.is_set():
            self._reset_requested.clear()  # before the restart: a request that arrives during it makes another one
            return '~/reset was called'
        if step < 0.0:
            return f'the stamps of joint_states went back by {-step:.3f} s'
        if step > self._values['longest_gap']:
            return f'nothing was measured for {step:.1f} s (check.longest_gap {self._values["longest_gap"]:g} s)'
        return ''

    def _replace_model(self) -> None:
        """Let the model that was asked for last take the place of this one, if it can be run beside the past."""
        config, model = self._config, None
        while not self._others.empty():
            config, model = self._others.get()
        if model is None:
            return
        before, after = (one.parameters['environment.T_E'] for one in (self._config, config))
        if self._input[-1] == before:  # nobody has said otherwise
            self._input[-1] = after
            self._history.set_first(-1, after)
        samples: list[tuple[int, Vector, Vector, Vector]] = []
        try:
            live, rows = self._history.beside(model, self._rate) if self._live is not None else (None, [])
        except SimulationError as error:
            self._tell_replaced(samples, str(error))
            return
        self._config, self._model, self._live = config, model, live
        self._forget_verdict()
        self._causes.use(config)
        if live is not None:
            self._causes.start(live.begin, live.first)
        for sample, row in rows:
            t, predicted = self._seconds(sample.stamp), row[self._messages.where.sensed]
            self._add_error(t, sample.measured - predicted)
            self._causes.add(sample, predicted, not math.isinf(self._settled_at))
            if t >= self._settled_at:
                self._departure.update(t, self._last_error)
            samples.append((sample.stamp, sample.measured, predicted, self._last_error))
        self._tell_replaced(samples, '')

    def _tell_replaced(self, samples: Sequence[tuple[int, Vector, Vector, Vector]], failed: str) -> None:
        if self._observer is not None:
            self._observer.replaced(samples, failed)

    def _inputs(self, before: Sample | None, now: Sample) -> Any:
        changes = self._robot.changes(before, now)
        for change in changes:
            self._input[change.column] = change.value
            if change.column in self._robot.heating and change.value != 0.0:
                number = change.column - self._robot.heating[0]
                if self._model.structure.antagonistic:
                    number = 2 * number + (change.value < 0.0)  # J_eq < 0 heats the second one of a pair
                self._heated.add(number)
        return changes

    def _start(self, now: Sample, reason: str) -> None:
        if reason:
            self._robot.forget_commands()
            self._logger.warning(f'{reason}: the model restarts')
        self._heated.clear()
        self._inputs(None, now)
        self._forget_verdict()
        self._live = LiveModel(self._model, self._rate, now.stamp, self._input)
        self._history.start(now.stamp, self._input)
        self._causes.start(now.stamp, self._input)
        if reason or not self._starts:
            self._compared_at = time.monotonic()
        self._starts += 1
        self._logger.info(
            'the model starts from rest (initial.*), which the robot may not be in: no verdict for check.burn_in = '
            f'{self._values["burn_in"]:g} s'
        )

    def _seconds(self, stamp: int) -> float:
        """Time since the model started [s]."""
        assert self._live is not None
        return (stamp - self._live.begin) / 1e9

    def _add_error(self, t: float, residual: Vector) -> None:
        if math.isinf(self._settled_at) and t >= self._values['burn_in']:
            self._error.clear()
            self._settled_at = t
        self._last_error = self._error.add(t, residual / self._noise)

    def _compare(self, now: Sample, row: Vector, measured: Vector) -> None:
        model = row[self._messages.where.sensed]
        t, residual = self._seconds(now.stamp), measured - model
        if np.isfinite(residual).any():
            self._compared_at = time.monotonic()
        self._add_error(t, residual)
        if t >= self._settled_at:
            self._judge(t)
        elif self._rest is None and t >= self._values['window']:
            self._compare_at_rest(residual)
        self._samples += 1
        self._publish(now, row, residual)
        if self._observer is not None:
            self._observer.sample(now.stamp, measured, model, self._last_error)

    def _compare_at_rest(self, residual: Vector) -> None:
        """Say once what is away although no wire was heated yet: a burn-in changes nothing in that."""
        above = self._last_error > self._values['threshold']
        self._rest = above if not self._heated else np.zeros_like(above)
        if self._rest.any():
            offsets = ', '.join(
                f'{self._channels[k]} {self._last_error[k]:.3g} times the noise '
                f'({in_display_unit(self._channels[k], residual[k])})'
                for k in np.flatnonzero(self._rest)
            )
            self._logger.warning(
                f'at rest, before any wire is heated, the robot differs from the model: {offsets}. {AT_REST}'
            )

    def _judge(self, t: float) -> None:
        self._departure.update(t, self._last_error)
        window = self._values['window']
        near = self._last_error <= self._values['threshold']  # of a channel that is not measured nothing is known
        self._follows = t >= self._settled_at + window and bool((near | np.isnan(self._last_error)).all() and near.any())
        due = self._announcements.due(time.monotonic(), bool(self._departure.left.any()), self._follows)
        if due == 'left':
            self._logger.warning(self._departed())
        elif due:
            words = 'follows the measurement' if due == 'follows' else 'is back in the measurement'
            errors = zip(self._channels, self._last_error, strict=True)
            numbers = ', '.join(f'{name} {error:.3g}' for name, error in errors if not math.isnan(error))
            self._logger.info(f'the model {words}: normalized RMSE {numbers} over the last {window:g} s')

    def _departed(self) -> str:
        which = np.flatnonzero(self._departure.left)
        errors = [(self._channels[k], self._last_error[k]) for k in which]
        worst = ', '.join(f'{name} {"not measured any more" if math.isnan(x) else f"{x:.3g}"}' for name, x in errors)
        wires = self._model.wires
        which_ones = {1: 'the bundle was not', 2: 'not both bundles were'}.get(wires, 'not all bundles were')
        caveat = ''
        if self._rest is not None and self._rest[which].all():
            caveat = f'; it was so at rest, before any wire was heated. {AT_REST}'
        elif len(self._heated) < wires:
            caveat = f'; {which_ones} heated since the model started, so its start (initial.*) may be what is wrong'
        if reason := self._causes.reason():
            caveat += f'; {reason}'
        return (
            f'the model has left the measurement: normalized RMSE {worst} over the last {self._values["window"]:g} s '
            f'(check.threshold {self._values["threshold"]:g}){caveat}'
        )

    def _publish(self, now: Sample, row: Vector, residual: Vector) -> None:
        stamp = stamp_of(now.stamp)
        self._topics['model_joint_states'].publish(self._messages.joint_state(stamp, row, sensed=True))
        rates, tau = row[self._messages.where.rates], row[self._messages.where.tau]
        position, velocity, effort = residual[: len(rates)], now.joints[1] - rates, now.joints[2] - tau
        message = JointState(
            header=Header(stamp=stamp),
            name=self._messages.joint_names,
            position=position.tolist(),
            velocity=values_or_none(velocity),
            effort=values_or_none(effort),
        )
        self._topics['residuals'].publish(message)
        for topic, what, values in (
            ('channel_residuals', 'measured - model of {} [SI]', residual),
            ('error_over_noise', 'running normalized RMSE of {} [-]', self._last_error),
        ):
            layout = array_layout(what.format(', '.join(self._channels)), len(self._channels))
            self._topics[topic].publish(Float64MultiArray(layout=layout, data=values.tolist()))

    def _nothing_compared(self) -> list[str]:
        """What is wrong where joint_states arrive and none could be compared for longer than SILENCE."""
        since = time.monotonic() - self._compared_at
        if since <= SILENCE:
            return []
        advice = f'do stamps move on ({FILLED_IN}), and are positions numbers?'
        return [f'nothing was compared for {since:.0f} s although joint_states arrive: {advice}']

    def _diagnose(self) -> None:
        problems = [*self._graph_check.problems()]
        judged = not math.isinf(self._settled_at)
        if self._departure.left.any():
            problems.insert(0, self._departed())
        quiet = self._robot.silence(SILENCE) or self._nothing_compared()
        problems += quiet
        command, heating = self._robot.command_topic, self._robot.heating
        state = 'waiting for joint_states' if self._live is None else 'comparing' if judged else 'burn-in'
        left = self._departure.left.any()
        follows = self._follows and not quiet
        verdict = 'has left the measurement' if left else 'follows the measurement' if follows else 'none yet'
        errors = zip(self._channels, self._last_error, strict=True)
        values = {
            'state': state,
            'verdict on the model': verdict,
            'cause of a deviation': 'none' if self._causes.last is None else str(self._causes.last),
            **{f'error over noise of {name}': 'not measured' if math.isnan(x) else f'{x:.3g}' for name, x in errors},
            'samples compared': self._samples,
            'samples waiting': self._robot.waiting,
            'starts of the model': self._starts,
            'command': f'{command}{APPLIED}' if self._robot.applied[heating[0]] else command,
            f'{command} [W]': ', '.join(f'{self._input[column]:g}' for column in heating),
            'T_E [K]': f'{self._input[-1]:g}',
            **self._robot.rejected(),
        }
        good = ['the model follows the measurement'] if verdict.startswith('follows') else []
        self._diagnostics.publish('; '.join([state, *good, *problems]), warn=bool(problems), values=values)
        if self._observer is not None:
            self._observer.state(state, problems, self._samples)


def values_or_none(values: Vector) -> list[float]:
    """The values, or none where the robot tells none of them."""
    return [] if np.isnan(values).all() else list(values.tolist())
