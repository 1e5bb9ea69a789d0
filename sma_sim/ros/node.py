"""The node `sma_module_sim`: steps a structure at a fixed rate and talks to ROS. No equation lives here."""

from __future__ import annotations

import math
import threading
import time
from typing import Any

from numpy.typing import NDArray
from rclpy.node import Node

from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.structures.drawing import Sketch
from sma_sim.model.structures.links import NOWHERE
from sma_sim.ros.command import ENVIRONMENT, TURNED_OFF, WARNING_PERIOD
from sma_sim.ros.control import DIAGNOSTICS_PERIOD, Control, Diagnostics
from sma_sim.ros.entry import model_description
from sma_sim.ros.graph_check import GraphCheck
from sma_sim.ros.inbox import Inbox, clock_inbox
from sma_sim.ros.inputs import Inputs
from sma_sim.ros.messages import Messages, stamp_of
from sma_sim.ros.parameters import REAL_TIME_FACTOR, STEPS_PER_CALL, follow_live_parameters, refused_value
from sma_sim.ros.publishers import Publishers
from sma_sim.ros.recording import BagSession
from sma_sim.ros.robot_frames import RobotFrames
from sma_sim.ros.schedule import ClockSchedule, RecentCount, Schedule, Speed, WallSchedule, clock_warning
from sma_sim.solver.fixed_rate import FixedRateRun, steps_per_sample
from sma_sim.solver.model import Model

CLOCK_REMINDER_PERIOD = 5.0  # [s] between two reminders that there is none
NO_SIMULATION_INTERFACES = (
    'no standard services of simulators: the package simulation_interfaces is not installed '
    '(apt install ros-$ROS_DISTRO-simulation-interfaces); ~/pause, ~/step and ~/reset do the same'
)
OVERRUN_WINDOW = 10.0  # [s] for which /diagnostics warn of an overrun
RESET_DONE = 'everything as at the start, the ambient temperature too; heating off until the next command'
PAUSED_SLEEP = 0.01  # [s] after which a paused node looks at its clock again
CLOCK_RATE, MARKER_RATE = 100.0, 20.0  # [1/s] at the least and at the most, as far as the publishing rate allows


class ModuleSimulation:
    """The simulated structure behind the topics of one node."""

    def __init__(self, node: Node, config: Config, use_sim_time: bool) -> None:
        self._node, self._config, numbers = node, config, config.parameters
        self._rate, self._factor = numbers['node.integration_rate'], numbers[REAL_TIME_FACTOR]
        self._logger = node.get_logger()
        self._commands, self._clock = Inbox(node), clock_inbox(node)
        try:
            self._every = steps_per_sample(self._rate, numbers['node.publish_rate'])
        except UserError as error:
            raise UserError(f'node.publish_rate and node.integration_rate: {error}') from error
        self._is_clock = bool(config.settings['node.publish_clock'])
        if self._is_clock and use_sim_time:
            raise UserError('node.publish_clock and use_sim_time: a node is the source of /clock or follows it, not both')
        self._clock_every = largest_divisor(self._every, self._rate / CLOCK_RATE)
        self._picture_every = self._every * math.ceil(numbers['node.publish_rate'] / MARKER_RATE)
        self._model = Model(config)
        structure = self._model.structure
        self._messages = Messages(structure, bool(config.settings['node.publish_resistances']))
        self._publishers = Publishers(node, config, self._is_clock, self._messages)
        self._inputs = Inputs(node, config, self._publishers, self._messages)
        self._new_run()
        for note in self._run.notes:
            self._logger.info(note)
        self._schedule = self._new_schedule(use_sim_time)
        self._running = False  # until there is a clock
        self._follows, self._anchor = use_sim_time, self._schedule.anchor
        self._sketch = Sketch(structure, config.parameters)
        self._free = any(joint.free for joint in self._sketch.tree.joints)
        self._frames = RobotFrames(node, self._sketch.tree, config.settings)
        self._recording = BagSession(node, config, self._publishers, self._record_state)
        self._diagnostics = Diagnostics(node, f'simulated SMA {structure.name}')
        self._inputs.subscribe(node, self._commands, self._stamp_clock)
        owned = ['joint_states' if structure.coordinates else 'wire_states', *(['/clock'] if self._is_clock else [])]
        self._graph_check = GraphCheck(
            node, owned, self._inputs.topics, self._inputs.command_topics, self._commands.subscriptions
        )
        self._recent_overruns = RecentCount(OVERRUN_WINDOW)
        self._serve(node)

    def begin(self, stop: threading.Event) -> None:
        """Publish the start, once there is a clock, and make the bag. Raises UserError where it cannot be made."""
        self._stop = stop
        while self._follows and self._now() == 0 and not stop.is_set():
            self._logger.info('use_sim_time: waiting for /clock', throttle_duration_sec=CLOCK_REMINDER_PERIOD)
            self._control.refuse_steps('waiting for /clock: nothing runs yet')
            self._commands.take()
            if not self._control.carry_out():
                self._control.wait(PAUSED_SLEEP)
        if stop.is_set():
            return
        self._begin()
        topic, rate = self._inputs.command.topic, self._config.parameters['node.publish_rate']
        self._logger.info(
            f'running: {model_description(self._config)}, {self._rate:g} steps/s, {rate:g} messages/s per topic; '
            f'waiting for {topic} [W]; stop with Ctrl-C'
        )

    def spin(self, stop: threading.Event) -> None:
        """Step in time until `stop` is set. Raises SimulationError."""
        diagnose_at = time.monotonic() + DIAGNOSTICS_PERIOD
        while not stop.is_set():
            if self._control.carry_out():
                pass
            elif self._control.paused:
                self._control.wait(PAUSED_SLEEP)
                self._commands.take()
                self._schedule.restart()
            else:
                self._step_in_time()
            if time.monotonic() >= diagnose_at:
                diagnose_at += DIAGNOSTICS_PERIOD
                self._diagnose()

    def close(self) -> None:
        """Refuse what is still asked, and end the bag, if one is being written."""
        self._control.close()
        self._recording.close()

    def make_steps(self, most: int) -> int:
        """Make the steps until the next sample, at most so many; their number."""
        steps = min(most, self._every - self._run.k % self._every)
        self._advance(steps)
        self._schedule.restart()
        return steps

    def reset(self, state: bool, time: bool) -> str:
        """The initial state, without a command, in the ambient temperature of the start; time zero; or both."""
        if state:
            self._commands.take()  # those that were sent before are forgotten
            self._inputs.clear()
            self._inputs.ambient.reset()
            self._new_run(0 if time else self._run.k)
        elif self._running:
            self._inputs.command.advance_clock(-self._run.time)
            self._run.restart_clock(self._inputs.now)
            self._inputs.forget()  # for the next bag
        if not self._running:
            return f'{RESET_DONE}; waiting for /clock'
        self._begin(time)
        return RESET_DONE

    def end(self) -> str:
        """End the node."""
        self._stop.set()
        return 'the node is ending'

    def _serve(self, node: Node) -> None:
        """Offer services, and take parameters that are set while the node runs."""
        self._control = Control(node, self)
        self._recording.serve(node, self._control)
        wrong = refused_value(STEPS_PER_CALL, self._config.parameters[STEPS_PER_CALL], self._follows)
        if wrong:
            raise UserError(wrong)
        self._set_steps_per_call()
        try:
            from sma_sim.ros.simulation_services import SimulationServices
        except ImportError:
            self._logger.info(NO_SIMULATION_INTERFACES)
        else:
            self._simulation_services = SimulationServices(node, self._control)
        live = {
            ENVIRONMENT: self._inputs.ambient.apply,
            'node.J_max': self._set_J_max,
            'node.command_timeout': self._set_command_timeout,
            STEPS_PER_CALL: self._set_steps_per_call,
            REAL_TIME_FACTOR: lambda: self._control.ask(self._set_pace),
        }
        follow_live_parameters(node, live, self._follows)

    def _value(self, name: str) -> float:
        """The number that a parameter has now; the post-set callback reads it here, so that what is set last is in force."""
        return float(self._node.get_parameter(name).value)

    def _set_J_max(self) -> None:
        self._inputs.command.J_max = self._value('node.J_max')

    def _set_command_timeout(self) -> None:
        self._inputs.command.timeout = self._value('node.command_timeout')

    def _set_steps_per_call(self) -> None:
        self._control.steps_per_call = round(self._value(STEPS_PER_CALL))

    def _set_pace(self) -> str:
        """Another real-time factor, between two steps; the counts of overruns go on."""
        before, self._factor = self._schedule, self._value(REAL_TIME_FACTOR)
        self._schedule = self._new_schedule(self._follows)
        self._schedule.overruns, self._schedule.lost = before.overruns, before.lost
        return ''

    def _new_schedule(self, use_sim_time: bool) -> Schedule:
        if not use_sim_time:
            follows = self._factor == 1.0 and not self._is_clock and bool(self._config.settings['node.stamps_follow_clock'])
            return WallSchedule(self._rate, self._factor, self._now if follows else None)
        if self._factor != 1.0:
            self._logger.warning('use_sim_time: /clock sets the pace, node.real_time_factor is not used')
        return ClockSchedule(self._rate, self._now, self._clock.wait)

    def _new_run(self, k: int = 0) -> None:
        self._run = FixedRateRun(self._model, self._rate, self._inputs.at_start, k)
        self._modes = self._messages.modes(self._run.sample)
        self._inputs.forget()

    def _begin(self, at_zero: bool = True) -> None:
        """A new state or simulated time 0: a new bag, the stamp of time 0, the first sample."""
        self._running = True
        self._recording.prepare()  # before the clock of the steps starts: it takes a while
        self._schedule.restart()
        if at_zero:
            self._set_epoch()
        self._recording.begin(self._log_epoch)
        self._speed = Speed(self._run.time)
        self._apply()  # so that what is in force is known, and in the bag, also where no step follows
        self._publish()

    def _set_epoch(self) -> None:
        """The stamp of simulated time 0."""
        self._anchor = self._schedule.anchor
        self._epoch = self._log_epoch = 0 if self._is_clock else self._anchor or self._now()
        seconds, nanoseconds = divmod(self._epoch, 10**9)
        self._logger.info(f'simulated time 0 has the stamp {seconds}.{nanoseconds:09d}')

    def _record_state(self) -> None:
        """Write to a bag that begins what is in force: a part of a run can be read without the one before."""
        self._inputs.record(self._time(self._log_epoch))

    def _step_in_time(self) -> None:
        due = self._schedule.wait()
        if self._schedule.anchor != self._anchor:  # stamps are those of the clock that is followed
            self._anchor = self._schedule.anchor
            epoch = self._anchor - round(self._run.k * 1e9 / self._rate)
            # The computer's clock may be behind the stamps, after many single steps: stamps go back with /clock only.
            self._epoch = epoch if self._follows else max(epoch, self._epoch)
        warning = clock_warning(due, self._follows, self._schedule.anchor)
        if due.back > 0.0:
            self._logger.warning(warning)
        elif due.moved > 0.0:
            self._logger.warning(warning, throttle_duration_sec=WARNING_PERIOD)
        if due.steps:
            self._advance(due.steps)

    def _advance(self, steps: int) -> None:
        """Make steps; nothing that is published or that changes the input is skipped."""
        while steps > 0:
            count = min(steps, self._clock_every - self._run.k % self._clock_every)
            self._apply()
            self._run.step(self._inputs.vector, count, self._every)
            for jump in self._run.take_jumps():
                self._modes[jump.wire - 1] = jump.target
                t, modes = round(jump.t * 1e9), self._messages.wire_modes(self._modes)
                self._publishers.send_with_variant('wire_modes', self._epoch + t, self._log_epoch + t, modes)
            if self._run.k % self._every == 0:
                self._publish()
            elif self._run.k % self._clock_every == 0:
                self._publishers.send_clock(self._time(self._epoch))
            steps -= count

    def _apply(self) -> None:
        """Apply the input of the next steps; publish it when it changes."""
        self._commands.take()
        self._inputs.apply(self._run.time, self._time(self._epoch), self._time(self._log_epoch))

    def _now(self) -> int:
        """The time of the clock of the node [ns]; 0 before /clock was heard of."""
        self._clock.take()
        return int(self._node.get_clock().now().nanoseconds)

    def _time(self, epoch: int) -> int:
        """The time [ns] of the end of the last step."""
        return epoch + round(self._run.k * 1e9 / self._rate)

    def _publish(self) -> None:
        row, stamp, log_time = self._run.sample, self._time(self._epoch), self._time(self._log_epoch)
        self._modes = self._messages.modes(row)
        self._publishers.send_clock(stamp)
        self._publishers.send_sample(stamp, log_time, row, self._modes)
        self._send_frames(stamp, row)
        if self._run.k % self._picture_every == 0:
            self._publishers.send_markers(stamp, log_time, row, self._modes)

    def _send_frames(self, stamp: int, row: NDArray[Any]) -> None:
        """Publish where the links are, and the ends of wires that no joint moves."""
        coordinates, places = self._messages.coordinates(row), NOWHERE
        if self._free:
            lines = self._sketch.lines(coordinates, self._messages.wire_values(row, 'length'))
            places = self._sketch.ends(lines)
        self._frames.send(stamp_of(stamp), coordinates, places)

    def _diagnose(self) -> None:
        schedule, command = self._schedule, self._inputs.command
        overruns = self._recent_overruns(schedule.overruns)
        values = {
            'simulated time [s]': f'{self._run.time:.3f}',
            'real-time factor': f'{self._speed.since_last(self._run.time):.4f}',
            'overruns': schedule.overruns,
            'time left behind [s]': f'{schedule.lost:.3f}',
            'stamps behind the clock [s]': self._lag(),
            **self._inputs.values,
            **self._recording.values,
        }
        problems = [
            f'overruns in the last {OVERRUN_WINDOW:g} s: {overruns}' if overruns else '',
            f'command {command.state}' if command.state == TURNED_OFF else '',
            f'recording {values["recording"]}' if self._recording.problem else '',
            *self._graph_check.problems(),
        ]
        words = ['paused' if self._control.paused else 'running', *(words for words in problems if words)]
        self._diagnostics.publish('; '.join(words), warn=len(words) > 1, values=values)

    def _lag(self) -> str:
        """By how much the last stamp is behind the clock of the node [s]."""
        return f'{(self._stamp_clock() - self._time(self._epoch)) / 1e9:.3f}'

    def _stamp_clock(self) -> int:
        """The time [ns] with which stamps compare: that of the node's clock, or of its /clock where it is the source."""
        return self._time(0) if self._is_clock else self._now()


def largest_divisor(number: int, most: float) -> int:
    """The largest divisor of `number` that is not larger than `most` (at least 1)."""
    return max(d for d in range(1, number + 1) if number % d == 0 and (d == 1 or d <= most))
