"""Two nodes for long under a flood of commands, while clocks are paused: what they say of themselves, stamps, memory.

    python benchmarks/flood.py [--seconds 1800] [--json FILE]

`left` follows a /clock that this script publishes at 1 kHz and that stands still at times; `right` follows the computer's
clock and is paused by its service at times. Both record a bag and get 1000 commands per second. Every status on
/diagnostics is compared with what the script has done: `wrong_statuses` counts those that say anything else, apart from
the two seconds after each change. Stamps are compared with the clock when a message arrives, so their delay holds the
transport and this script's own.
"""

from __future__ import annotations

import argparse
import tempfile
import threading
import time
from collections import Counter
from typing import Any

import numpy as np
from common import report
from soak import COMMANDS, Module, resident_memory

PERIOD = 1e-3  # [s] between two commands, and between two messages of /clock
RUNNING, PAUSED = 20.0, 5.0  # [s] in turn
SETTLING = 2.5  # [s] after a change in which a status may still tell of before
LOST = 0.1  # [s] that a node may be late before it says so; our own clock must be no later


class Clock:
    """The source of /clock, which can be stopped."""

    def __init__(self, client: Any) -> None:
        from rosgraph_msgs.msg import Clock as Message

        self._message, self._topic = Message, client.create_publisher(Message, '/clock', 10)
        self.now, self._last, self.stopped = 1.0, time.monotonic(), False
        self.late = 0  # how often the clock jumped by so much that a node may say so

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
        self._topic.publish(message)


class Watched(Module):
    """A node, and which of its statuses are not what they should be."""

    def __init__(self, client: Any, name: str, folder: str, *words: str, clock: Clock | None = None) -> None:
        super().__init__(client, name, folder, *words)
        self.clock, self.paused, self.changed = clock, False, time.monotonic()
        self.statuses, self.wrong, self.late_by_status = 0, Counter[str](), 0.0
        self.memories: list[float] = []

    def receive(self, message: Any) -> None:
        """Note a stamp and how far it is from the clock that the node follows."""
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        self.stamps.append(stamp)
        self.delays.append((self.clock.now if self.clock else time.time()) - stamp)

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
        delays = 1e3 * np.array(self.delays)
        numbers = super().result()
        kept = ('samples', 'overruns', 'left_behind_s', 'share_of_a_core', 'recorded_messages', 'exit_code')
        return {key: numbers[key] for key in kept} | {
            'statuses': self.statuses,
            'wrong_statuses': sum(self.wrong.values()),
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


def spin(client: Any, seconds: float) -> None:
    """Take messages for so long."""
    import rclpy

    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(client, timeout_sec=0.01)


def pause(client: Any, service: Any, paused: bool) -> None:
    """Have a node pause or go on."""
    import rclpy
    from std_srvs.srv import SetBool

    answer = service.call_async(SetBool.Request(data=paused))
    rclpy.spin_until_future_complete(client, answer, timeout_sec=5.0)
    if not answer.done() or not answer.result().success:
        raise SystemExit('~/pause was not answered')


def alternate(client: Any, left: Watched, right: Watched, clock: Clock, seconds: float) -> None:
    """Let both run and stand still in turn, beginning and ending with running."""
    from std_srvs.srv import SetBool

    service = client.create_client(SetBool, '/right/sma_module_sim/pause')
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for paused, duration in ((False, RUNNING), (True, PAUSED), (False, 0.0)):
            if paused != right.paused:
                pause(client, service, paused)
                clock.stopped = paused
                left.change(paused)
                right.change(paused)
            spin(client, duration)


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Both nodes for so long."""
    import rclpy

    rclpy.init()
    client = rclpy.create_node('flood')
    stop = threading.Event()
    with tempfile.TemporaryDirectory() as folder:
        clock = Clock(client)
        left = Watched(client, 'left', folder, '-p', 'use_sim_time:=true', clock=clock)
        right = Watched(client, 'right', folder)
        thread = threading.Thread(target=flood, args=([left, right], clock, stop))
        thread.start()
        try:
            while not all(module.said and len(module.stamps) > 500 for module in (left, right)):
                rclpy.spin_once(client, timeout_sec=0.01)
            spin(client, 2.0 * SETTLING)
            clock.late = 0
            for module in (left, right):
                module.begin()
            alternate(client, left, right, clock, arguments.seconds)
            return {'left': left.result(), 'right': right.result(), 'clock': {'late_ticks': clock.late}}
        finally:
            stop.set()
            thread.join()
            client.destroy_node()
            rclpy.shutdown()


if __name__ == '__main__':
    report(__doc__ or '', measure, seconds=1800)
