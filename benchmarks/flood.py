"""Two nodes for long under a flood of commands, while clocks are paused: what they say of themselves, stamps, memory.

    python benchmarks/flood.py [--seconds 1800] [--json FILE]

`left` follows a /clock that this script publishes at 1 kHz and that stands still at times; `right` follows the computer's
clock and is paused by its service at times. Both record a bag and get 1000 commands per second. Every status on
/diagnostics is compared with what the script has done: `wrong_statuses` counts those that say anything else, apart from
the two seconds after each change. Stamps are compared with their clock at the moment when a message is published
(`stamp_lag`) and when it arrives (`stamp_delay`), both as the middleware tells them. A /clock that is late jumps over
stamps: `answers_within_2_ms_percent` counts from the moment when the clock reached a stamp, before which no node can know.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import threading
import time
from collections import Counter, deque
from typing import Any

import numpy as np
from common import report
from soak import COMMANDS, Module, resident_memory

PERIOD = 1e-3  # [s] between two commands, and between two messages of /clock
RUNNING, PAUSED = 20.0, 5.0  # [s] in turn
SETTLING = 2.5  # [s] after a change in which a status may still tell of before
ALLOWED_LAG = 2.0  # [ms] of a stamp behind its clock
KEPT_TICKS = 10_000  # of the clock, the last ten seconds
ROUNDING = 1e-8  # [s] of a stamp
SWITCH_INTERVAL = 5e-4  # [s]; the thread that publishes is not to wait for the one that listens
LOST = 0.1  # [s] that a node may be late before it says so; our own clock must be no later


class Clock:
    """The source of /clock, which can be stopped."""

    def __init__(self, client: Any) -> None:
        from rosgraph_msgs.msg import Clock as Message

        self._message, self._topic = Message, client.create_publisher(Message, '/clock', 10)
        self.now, self._last, self.stopped = 1.0, time.monotonic(), False
        self.late = 0  # how often the clock jumped by so much that a node may say so
        self._ticks: deque[tuple[float, float]] = deque(maxlen=KEPT_TICKS)  # time of the computer and of this clock [s]

    def at(self, moment: float) -> float:
        """What the clock showed at a time of the computer's clock [s]."""
        for k in range(len(self._ticks) - 1, -1, -1):
            published, shown = self._ticks[k]
            if published <= moment:
                return shown
        return self.now

    def reached(self, shown: float) -> float:
        """When the clock showed a time [s] first, by the computer's clock [s]."""
        moment = self._ticks[-1][0]
        for published, showed in reversed(tuple(self._ticks)):  # another thread adds to it
            if showed < shown - ROUNDING:
                break
            moment = published
        return moment

    def tick(self) -> None:
        """Go on by the time that has passed, unless stopped."""
        now = time.monotonic()
        passed, self._last = now - self._last, now
        self.late += passed > LOST
        if not self.stopped:
            self.now += passed
        seconds, rest = divmod(round(self.now * 1e9), 10**9)
        message = self._message()
        message.clock.sec, message.clock.nanosec = seconds, rest
        self._ticks.append((time.time(), self.now))
        self._topic.publish(message)


class Watched(Module):
    """A node, and which of its statuses are not what they should be."""

    def __init__(self, client: Any, name: str, folder: str, *words: str, clock: Clock | None = None) -> None:
        super().__init__(client, name, folder, *words)
        self.clock, self.paused, self.changed = clock, False, time.monotonic()
        self.statuses, self.wrong, self.late_by_status = 0, Counter[str](), 0.0
        self.memories: list[float] = []
        self.lags: list[float] = []
        self.answers: list[float] = []

    def begin(self) -> None:
        """Count from now on."""
        super().begin()
        self.lags, self.answers = self.lags[-1:], self.answers[-1:]

    def receive(self, message: Any, info: Any) -> None:
        """Note a stamp and how far it is behind the clock that the node follows, when published and when received."""
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        published, received = 1e-9 * info['source_timestamp'], 1e-9 * info['received_timestamp']
        self.stamps.append(stamp)
        self.lags.append((self.clock.at(published) if self.clock else published) - stamp)
        self.answers.append(published - (self.clock.reached(stamp) if self.clock else stamp))
        self.delays.append((self.clock.at(received) if self.clock else received) - stamp)

    def hear(self, message: Any) -> None:
        """Compare a status with what was done to the node."""
        super().hear(message)
        status = message.status[0]
        if not status.name.startswith(f'/{self.name}/') or time.monotonic() - self.changed < SETTLING:
            return
        self.statuses += 1
        self.memories.append(resident_memory(self.process.pid))
        expected = 'paused' if self.paused and not self.clock else 'running'
        factor, still = float(self.said['real-time factor']), self.paused
        if status.message != expected:
            self.wrong[f'{status.message} instead of {expected}'] += 1
        if abs(factor - (0.0 if still else 1.0)) > 0.1:
            self.wrong['real-time factor'] += 1
        if self.said['command'] != 'in force' or self.said['rejected commands'] != '0':
            self.wrong['command'] += 1
        if not self.said['recording'].startswith('yes'):
            self.wrong['recording'] += 1
        if not still:
            self.late_by_status = max(self.late_by_status, abs(float(self.said['stamps behind the clock [s]'])))

    def change(self, paused: bool) -> None:
        """Say that the node's time stands still from now on, or runs again."""
        self.paused, self.changed = paused, time.monotonic()

    def result(self) -> dict[str, Any]:
        """What was seen since the beginning."""
        tenth = max(1, len(self.memories) // 10)
        delays, lags = 1e3 * np.array(self.delays), 1e3 * np.array(self.lags)
        numbers = super().result()
        kept = ('samples', 'overruns', 'left_behind_s', 'share_of_a_core', 'recorded_messages', 'exit_code')
        return {key: numbers[key] for key in kept} | {
            'statuses': self.statuses,
            'wrong_statuses': sum(self.wrong.values()),
            'stamp_lag_median_ms': float(np.median(lags)),
            'stamp_lag_99_percent_ms': float(np.percentile(lags, 99)),
            'stamps_within_2_ms_percent': 100.0 * float(np.mean(lags <= ALLOWED_LAG)),
            'answers_within_2_ms_percent': 100.0 * float(np.mean(1e3 * np.array(self.answers) <= ALLOWED_LAG)),
            'stamp_delay_median_ms': float(np.median(delays)),
            'stamp_delay_99_percent_ms': float(np.percentile(delays, 99)),
            'largest_lag_by_status_ms': 1e3 * self.late_by_status,
            'memory_first_tenth_MB': float(np.mean(self.memories[:tenth])),
            'memory_last_tenth_MB': float(np.mean(self.memories[-tenth:])),
            'wrong': '; '.join(f'{words} ({count})' for words, count in self.wrong.items()) or 'none',
        }


def flood(modules: list[Watched], clock: Clock, stop: threading.Event) -> None:
    """Publish commands and the clock, 1000 times a second, until `stop` is set."""
    from std_msgs.msg import Float64

    due = time.monotonic()
    while not stop.is_set():
        clock.tick()
        for module in modules:
            module.command.publish(Float64(data=COMMANDS[int(due) // 5 % len(COMMANDS)]))
        due = max(due + PERIOD, time.monotonic() - LOST)
        time.sleep(max(0.0, due - time.monotonic()))


def spin(executor: Any, seconds: float) -> None:
    """Take messages for so long."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.01)


def pause(executor: Any, service: Any, paused: bool) -> None:
    """Have a node pause or go on."""
    from std_srvs.srv import SetBool

    answer = service.call_async(SetBool.Request(data=paused))
    executor.spin_until_future_complete(answer, timeout_sec=5.0)
    if not answer.done() or not answer.result().success:
        raise SystemExit('~/pause was not answered')


def alternate(executor: Any, service: Any, left: Watched, right: Watched, clock: Clock, seconds: float) -> None:
    """Let both run and stand still in turn, beginning and ending with running; `service` pauses `right`."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for paused, duration in ((False, RUNNING), (True, PAUSED), (False, 0.0)):
            if paused != right.paused:
                pause(executor, service, paused)
                clock.stopped = paused
                left.change(paused)
                right.change(paused)
            spin(executor, duration)


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Both nodes for so long."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from std_srvs.srv import SetBool

    rclpy.init()
    sys.setswitchinterval(SWITCH_INTERVAL)
    client, executor = rclpy.create_node('flood'), SingleThreadedExecutor()
    executor.add_node(client)
    stop = threading.Event()
    with tempfile.TemporaryDirectory() as folder:
        clock = Clock(client)
        left = Watched(client, 'left', folder, '-p', 'use_sim_time:=true', clock=clock)
        right = Watched(client, 'right', folder)
        thread = threading.Thread(target=flood, args=([left, right], clock, stop))
        thread.start()
        try:
            while not all(module.said and len(module.stamps) > 500 for module in (left, right)):
                executor.spin_once(timeout_sec=0.01)
            spin(executor, 2.0 * SETTLING)
            clock.late = 0
            for module in (left, right):
                module.begin()
            service = client.create_client(SetBool, '/right/sma_module_sim/pause')
            alternate(executor, service, left, right, clock, arguments.seconds)
            return {'left': left.result(), 'right': right.result(), 'clock': {'late_ticks': clock.late}}
        finally:
            stop.set()
            thread.join()
            for module in (left, right):
                if module.process.poll() is None:  # an error, or Ctrl-C, has come before their results
                    module.process.terminate()
            client.destroy_node()
            rclpy.shutdown()


if __name__ == '__main__':
    report(__doc__ or '', measure, seconds=1800)
