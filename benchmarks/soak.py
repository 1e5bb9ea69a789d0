"""The node for long: missed samples, drift against the clock, memory, share of a core; two modules beside each other too.

    python benchmarks/soak.py [--seconds 600] [--json FILE]

Each module records its own bag; the client sends a command every second. Drift compares the shortest delay of a message in
the first and in the last tenth of the time, on one computer.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import report
from node import cpu_seconds

os.environ |= {'ROS_DOMAIN_ID': str(random.randrange(1, 100)), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
COMMANDS = (8.0, -6.0, 0.0, 3.0)  # [W]
PERIOD = 0.01  # [s] between two samples


def resident_memory(process: int) -> float:
    """Memory in use [MB]."""
    pages = int(Path(f'/proc/{process}/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


class Module:
    """One node with its bag, and what a client sees of it."""

    def __init__(self, client: Any, name: str, folder: str, *arguments: str) -> None:
        from diagnostic_msgs.msg import DiagnosticArray
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64

        words = ['--ros-args', '-r', f'__ns:=/{name}', '-p', f'node.record:={folder}/{name}', *arguments]
        self.name, self.log = name, Path(folder) / f'{name}.log'
        with self.log.open('w') as log:
            self.process = subprocess.Popen([sys.executable, '-m', 'sma_sim.ros.main', *words], stderr=log)
        self.stamps: list[float] = []
        self.delays: list[float] = []
        self.said: dict[str, str] = {}
        self.command = client.create_publisher(Float64, f'/{name}/J_eq', 10)
        client.create_subscription(JointState, f'/{name}/joint_states', self.receive, 1000)
        client.create_subscription(DiagnosticArray, '/diagnostics', self.hear, 10)

    def receive(self, message: Any, info: Any) -> None:
        """Note a sample's stamp and how late it came."""
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        self.stamps.append(stamp)
        self.delays.append(1e-9 * info['received_timestamp'] - stamp)

    def hear(self, message: Any) -> None:
        """Keep the node's last words about itself."""
        if message.status[0].name.startswith(f'/{self.name}/'):
            self.said = {value.key: value.value for value in message.status[0].values}

    def is_heard(self) -> bool:
        """Whether it runs. Raises SystemExit where it has ended."""
        if self.process.poll() is not None:
            raise SystemExit(f'{self.name} ended with {self.process.returncode}:\n{self.log.read_text()}')
        return bool(self.said) and len(self.stamps) > 500

    def begin(self) -> None:
        """Count from now on."""
        self.stamps, self.delays = self.stamps[-1:], self.delays[-1:]
        self.behind, self.overruns = float(self.said['time left behind [s]']), int(self.said['overruns'])
        self.cpu, self.memory, self.wall = cpu_seconds(self.process.pid), resident_memory(self.process.pid), time.monotonic()

    def left_behind(self) -> float:
        """Time that the node says it has lost since the beginning [s]."""
        return float(self.said['time left behind [s]']) - self.behind

    def result(self) -> dict[str, Any]:
        """What happened since."""
        passed = time.monotonic() - self.wall
        part = max(1, len(self.delays) // 10)
        numbers = {
            'samples': len(self.stamps) - 1,
            'samples_lost': int(np.sum(np.diff(self.stamps) > 1.5 * PERIOD)),
            'overruns': int(self.said['overruns']) - self.overruns,
            'left_behind_s': self.left_behind(),
            'drift_unannounced_ms': 1e3 * (min(self.delays[-part:]) - min(self.delays[:part]) - self.left_behind()),
            'share_of_a_core': (cpu_seconds(self.process.pid) - self.cpu) / passed,
            'memory_growth_MB': resident_memory(self.process.pid) - self.memory,
            'recorded_messages': int(self.said['messages in the bag']),
        }
        self.process.send_signal(signal.SIGINT)
        return numbers | {'exit_code': self.process.wait(20)}


def soak(names: tuple[str, ...], seconds: float) -> dict[str, Any]:
    """Run modules in namespaces of one domain for a while."""
    import rclpy
    from std_msgs.msg import Float64

    rclpy.init()
    client, modules = rclpy.create_node('soak'), list[Module]()
    try:
        with tempfile.TemporaryDirectory() as folder:
            modules += [Module(client, name, folder) for name in names]
            while not all([module.is_heard() for module in modules]):
                rclpy.spin_once(client, timeout_sec=0.01)
            for module in modules:
                module.begin()
            end, sent = time.monotonic() + seconds, 0
            while time.monotonic() < end:
                rclpy.spin_once(client, timeout_sec=0.01)
                if time.monotonic() > end - seconds + sent:
                    for module in modules:
                        module.command.publish(Float64(data=COMMANDS[sent // 5 % len(COMMANDS)]))
                    sent += 1
            return {module.name: module.result() for module in modules}
    finally:
        for module in modules:
            module.process.terminate()
        client.destroy_node()
        rclpy.shutdown()


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """One module, then two."""
    result = {'one': soak(('one',), arguments.seconds), 'two': soak(('left', 'right'), arguments.seconds)}
    if any(module['exit_code'] for modules in result.values() for module in modules.values()):
        raise SystemExit(f'a node ended with an error: {result}')
    return result


if __name__ == '__main__':
    report(__doc__ or '', measure, seconds=600)
