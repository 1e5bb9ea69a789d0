"""The node `sma_module_sim`: steps the module at a fixed rate and talks to ROS. No equation lives here."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64

from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.structures.beam_links import beam_links
from sma_sim.ros import messages
from sma_sim.ros.command import ENVIRONMENT, TURNED_OFF, WARNING_PERIOD, Ambient, Command
from sma_sim.ros.control import DIAGNOSTICS_PERIOD, Control, Diagnostics
from sma_sim.ros.entry import model_description
from sma_sim.ros.graph_check import GraphCheck
from sma_sim.ros.inbox import Inbox, clock_inbox
from sma_sim.ros.parameters import REAL_TIME_FACTOR, follow_live_parameters
from sma_sim.ros.publishers import Publishers
from sma_sim.ros.qos import LAST_FEW, make_subscription
from sma_sim.ros.recording import BagSession
from sma_sim.ros.robot_frames import RobotFrames
from sma_sim.ros.schedule import ClockSchedule, RecentCount, Schedule, Speed, WallSchedule, clock_warning
from sma_sim.ros.stamped import COMMAND, STAMPED_COMMAND, StampedCommands
from sma_sim.solver.fixed_rate import FixedRateRun, steps_per_sample
from sma_sim.solver.model import Model

CLOCK_REMINDER_PERIOD = 5.0  # [s] between two reminders that there is none
NO_SIMULATION_INTERFACES = (
    'no standard services of simulators: the package simulation_interfaces is not installed '
    '(apt install ros-$ROS_DISTRO-simulation-interfaces); ~/pause, ~/step and ~/reset do the same'
)
AMBIENT = 'ambient_temperature'
INPUT_TOPICS = {COMMAND: Float64, AMBIENT: Temperature}
OVERRUN_WINDOW = 10.0  # [s] for which /diagnostics warn of an overrun
RESET_DONE = 'everything as at the start, the ambient temperature too; heating off until the next command'
PAUSED_SLEEP = 0.01  # [s] after which a paused node looks at its clock again
CLOCK_RATE, MARKER_RATE = 100.0, 20.0  # [1/s] at the least and at the most, as far as the publishing rate allows


class ModuleSimulation:
    """The simulated module behind the topics of one node."""

    def __init__(self, node: Node, config: Config, settings: Mapping[str, float], use_sim_time: bool) -> None:
        self._node, self._config, self._rate, self._settings = node, config, settings['integration_rate'], dict(settings)
        self._logger = node.get_logger()
        self._commands, self._clock = Inbox(node), clock_inbox(node)
        try:
            self._every = steps_per_sample(self._rate, settings['publish_rate'])
        except UserError as error:
            raise UserError(f'node.publish_rate and node.integration_rate: {error}') from error
        self._is_clock = bool(config.settings['node.publish_clock'])
        if self._is_clock and use_sim_time:
            raise UserError('node.publish_clock and use_sim_time: a node is the source of /clock or follows it, not both')
        self._clock_every = largest_divisor(self._every, self._rate / CLOCK_RATE)
        self._picture_every = self._every * math.ceil(settings['publish_rate'] / MARKER_RATE)
        self._model = Model(config)
        self._ambient = Ambient(node, config.parameters['environment.T_E'])
        self._new_run()
        for note in self._run.notes:
            self._logger.info(note)
        self.command = Command(node, settings['J_max'], settings['command_timeout'])
        self._schedule = self._new_schedule(use_sim_time)
        self._running = False  # until there is a clock
        self._follows, self._anchor = use_sim_time, self._schedule.anchor
        self._publishers = Publishers(node, config, self._is_clock)
        self._frames = RobotFrames(node, beam_links(config.parameters), config.settings)
        self._recording = BagSession(node, config, self._publishers, self._record_state)
        self._diagnostics = Diagnostics(node, 'simulated SMA module')
        self._commands.add(make_subscription(node, Float64, COMMAND, self.command.receive, LAST_FEW))
        make_subscription(node, Temperature, AMBIENT, self._ambient.receive, LAST_FEW)
        owned = ['joint_states', *(['/clock'] if self._is_clock else [])]
        self._stamped_commands = StampedCommands(node, self.command, self._stamp_clock)
        self._commands.add(self._stamped_commands.subscription)
        inputs = INPUT_TOPICS | {STAMPED_COMMAND: JointState}
        self._graph_check = GraphCheck(node, owned, inputs, COMMAND, self._commands.subscriptions)
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
        self._logger.info(
            f'running: {model_description(self._config)}, {self._rate:g} steps/s, '
            f'{self._settings["publish_rate"]:g} messages/s per topic; waiting for J_eq [W]; stop with Ctrl-C'
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
            self.command.clear()
            self._ambient.reset()
            self._new_run(0 if time else self._run.k)
        elif self._running:
            self.command.advance_clock(-self._run.time)
            self._run.restart_clock(np.array([np.nan_to_num(self._applied), self._ambient.T_E]))
            self._forget_applied()  # for the next bag
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
        self._set_steps_per_call()
        try:
            from sma_sim.ros.simulation_services import SimulationServices
        except ImportError:
            self._logger.info(NO_SIMULATION_INTERFACES)
        else:
            self._simulation_services = SimulationServices(node, self._control)
        live = {
            ENVIRONMENT: self._ambient.apply,
            'node.J_max': self._set_J_max,
            'node.command_timeout': self._set_command_timeout,
            'node.steps_per_call': self._set_steps_per_call,
            REAL_TIME_FACTOR: lambda: self._control.ask(self._set_pace),
        }
        follow_live_parameters(node, live, self._follows)

    def _value(self, name: str) -> float:
        """The number that a parameter has now; the post-set callback reads it here, so that what is set last is in force."""
        return float(self._node.get_parameter(name).value)

    def _set_J_max(self) -> None:
        self.command.J_max = self._value('node.J_max')

    def _set_command_timeout(self) -> None:
        self.command.timeout = self._value('node.command_timeout')

    def _set_steps_per_call(self) -> None:
        self._control.steps_per_call = round(self._value('node.steps_per_call'))

    def _set_pace(self) -> str:
        """Another real-time factor, between two steps; the counts of overruns go on."""
        before, self._settings['real_time_factor'] = self._schedule, self._value(REAL_TIME_FACTOR)
        self._schedule = self._new_schedule(self._follows)
        self._schedule.overruns, self._schedule.lost = before.overruns, before.lost
        return ''

    def _new_schedule(self, use_sim_time: bool) -> Schedule:
        if not use_sim_time:
            factor = self._settings['real_time_factor']
            follows = factor == 1.0 and not self._is_clock and bool(self._config.settings['node.stamps_follow_clock'])
            return WallSchedule(self._rate, factor, self._now if follows else None)
        if self._settings['real_time_factor'] != 1.0:
            self._logger.warning('use_sim_time: /clock sets the pace, node.real_time_factor is not used')
        return ClockSchedule(self._rate, self._now, self._clock.wait)

    def _new_run(self, k: int = 0) -> None:
        self._run = FixedRateRun(self._model, self._rate, np.array([0.0, self._ambient.T_E]), k)
        self._modes = [int(mode) for mode in messages.wire_values(self._run.sample, 'mode')]
        self._forget_applied()

    def _forget_applied(self) -> None:
        """Publish what is applied at the next step, whether it changes or not."""
        self._applied, self._applied_T_E = math.nan, math.nan

    def _begin(self, at_zero: bool = True) -> None:
        """A new state or simulated time 0: a new bag, the stamp of time 0, the first sample."""
        self._running = True
        if at_zero:
            self._log_epoch = 0 if self._is_clock else self._now()
        self._recording.begin(self._log_epoch)  # before the clock of the steps starts: it takes a while
        self._schedule.restart()
        if at_zero:
            self._set_epoch()
        self._speed = Speed(self._run.time)
        self._publish()

    def _set_epoch(self) -> None:
        """The stamp of simulated time 0."""
        self._anchor = self._schedule.anchor
        self._epoch = 0 if self._is_clock else self._anchor or self._now()
        seconds, nanoseconds = divmod(self._epoch, 10**9)
        self._logger.info(f'simulated time 0 has the stamp {seconds}.{nanoseconds:09d}')

    def _record_state(self) -> None:
        """Write to a bag that begins what is in force: a part of a run can be read without the one before."""
        now = self._time(self._log_epoch)
        if not math.isnan(self._applied):
            self._publishers.record('J_eq_applied', now, Float64(data=self._applied))
            self._publishers.record('T_E_applied', now, Float64(data=self._applied_T_E))

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
        """Make steps; nothing that is published or that changes the input is passed over."""
        while steps > 0:
            count = min(steps, self._clock_every - self._run.k % self._clock_every)
            self._apply()
            self._run.step(np.array([self._applied, self._applied_T_E]), count, self._every)
            for jump in self._run.take_jumps():
                self._modes[jump.wire - 1] = jump.target
                t, modes = round(jump.t * 1e9), messages.wire_modes(self._modes)
                self._publishers.send_with_variant('wire_modes', self._epoch + t, self._log_epoch + t, modes)
            if self._run.k % self._every == 0:
                self._publish()
            elif self._run.k % self._clock_every == 0:
                self._publishers.send_clock(self._time(self._epoch))
            steps -= count

    def _apply(self) -> None:
        """Apply the input of the next steps; publish it when it changes."""
        self._commands.take()
        J_eq, T_E = self.command.at(self._run.time), self._ambient.T_E
        stamp, now = self._time(self._epoch), self._time(self._log_epoch)
        if J_eq != self._applied:
            self._applied = J_eq
            self._publishers.send_with_variant('J_eq_applied', stamp, now, Float64(data=J_eq))
        if self._applied_T_E != T_E:
            self._applied_T_E = T_E
            self._publishers.send_with_variant('T_E_applied', stamp, now, Float64(data=T_E))

    def _now(self) -> int:
        """The time of the clock of the node [ns]; 0 before /clock was heard of."""
        self._clock.take()
        return int(self._node.get_clock().now().nanoseconds)

    def _time(self, epoch: int) -> int:
        """The time [ns] of the end of the last step."""
        return epoch + round(self._run.k * 1e9 / self._rate)

    def _publish(self) -> None:
        row, stamp, log_time = self._run.sample, self._time(self._epoch), self._time(self._log_epoch)
        self._modes = [int(mode) for mode in messages.wire_values(row, 'mode')]
        self._publishers.send_clock(stamp)
        self._publishers.send_sample(stamp, log_time, row, self._modes)
        self._frames.send(messages.stamp_of(stamp), messages.coordinates(row))
        if self._run.k % self._picture_every == 0:
            self._publishers.send_markers(stamp, log_time, row, self._modes)

    def _diagnose(self) -> None:
        schedule = self._schedule
        overruns = self._recent_overruns(schedule.overruns)
        values = {
            'simulated time [s]': f'{self._run.time:.3f}',
            'real-time factor': f'{self._speed.since_last(self._run.time):.4f}',
            'overruns': schedule.overruns,
            'time left behind [s]': f'{schedule.lost:.3f}',
            'stamps behind the clock [s]': self._lag(),
            'command': self.command.state,
            'command timeouts': self.command.timeouts,
            **self._stamped_commands.diagnostics(),
            'rejected commands': self.command.rejected,
            'clipped commands': self.command.clipped,
            'rejected ambient temperatures': self._ambient.rejected,
            'J_eq applied [W]': f'{self._applied:g}',
            **self._recording.values,
        }
        problems = [
            f'{overruns} overruns in the last {OVERRUN_WINDOW:g} s' if overruns else '',
            f'command {self.command.state}' if self.command.state == TURNED_OFF else '',
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
