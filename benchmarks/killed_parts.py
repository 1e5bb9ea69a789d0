"""How long it takes until a robot's power is zero after a part of its control was killed; false stops with lost messages.

    python benchmarks/killed_parts.py [--kills 10] [--seconds 60] [--lost 0.1] [--json FILE]

Robot, observer, guard and controller are processes of their own, the controller a plain node, over what each takes by itself
(FASTDDS_BUILTIN_TRANSPORTS=DEFAULT in the environment: shared memory for all), with the default silences and the
robot's node.command_timeout as `closed_loop.launch.py guard:=true` sets it. Each is killed (SIGKILL) so many times while it
heats; counted is the time until the robot's power is zero, for the robot until the guard commands zero. Then everything runs
for so many seconds while a part of all messages between the processes is lost, and zeros of the guard are counted.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import time
from typing import Any

import numpy as np
from common import report

os.environ |= {'ROS_DOMAIN_ID': str(random.randrange(1, 100)), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
MODULES = {'robot': 'sma_sim.ros.main', 'observer': 'sma_sim.ros.observer_main', 'guard': 'sma_sim.ros.guard_main'}
PATIENCE = 300.0  # [s]; the first start compiles
SETTLED = 3.0  # [s] of running before a part is killed
LASTING = 2.0  # [s] in which no heating may follow the zero
ESTIMATED = (
    ('Temperature', 'estimated/wire_1/temperature'),
    ('Temperature', 'estimated/wire_2/temperature'),
    ('Float64MultiArray', 'estimated/phase_fractions'),
    ('Float64MultiArray', 'estimated/wire_stresses'),
    ('UInt8MultiArray', 'estimated/wire_modes'),
)
SENT = {
    'robot': (('JointState', 'joint_states'),),
    'observer': ESTIMATED,
    'guard': (('Float64', 'J_eq'),),
    'controller': (('Float64', 'J_eq_requested'),),
}
CONTROLLER = """
import sys, rclpy
from std_msgs.msg import Float64
rclpy.init()
node = rclpy.create_node('controller')
publisher = node.create_publisher(Float64, sys.argv[1], 10)
node.create_timer(0.02, lambda: publisher.publish(Float64(data=4.0)))
rclpy.spin(node)
"""
RELAY = """
import random, sys, rclpy
from functools import partial
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64, Float64MultiArray, UInt8MultiArray
rclpy.init()
node, lost = rclpy.create_node('relay'), float(sys.argv[1])
def pass_on(publisher, message):
    if random.random() >= lost:
        publisher.publish(message)
for word in sys.argv[2:]:
    kind, topic = word.split('=')
    publisher = node.create_publisher(globals()[kind], topic, 10)
    pass_this_on = partial(pass_on, publisher)
    node.create_subscription(globals()[kind], 'sent/' + topic, pass_this_on, qos_profile_sensor_data, raw=True)
rclpy.spin(node)
"""


class Processes:
    """Robot, observer, guard and controller, and a client that hears commands and power. `lost`: part of all messages."""

    def __init__(self, lost: float = 0.0) -> None:
        import rclpy
        from std_msgs.msg import Float64

        from sma_sim.ros.command import GUARDED_TIMEOUT

        self.lost, self.timeout = lost, GUARDED_TIMEOUT
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('client', context=self.context)
        self.executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.heard: dict[str, list[tuple[float, float]]] = {'sent/J_eq' if lost else 'J_eq': [], 'J_eq_applied': []}
        self.command = next(iter(self.heard))
        for topic, heard in self.heard.items():
            self.node.create_subscription(
                Float64, topic, lambda message, to=heard: to.append((time.monotonic(), message.data)), 100
            )
        self.parts: dict[str, subprocess.Popen[bytes]] = {}
        if lost:
            topics = [f'{kind}={topic}' for sent in SENT.values() for kind, topic in sent]
            self.parts['relay'] = subprocess.Popen([sys.executable, '-c', RELAY, str(lost), *topics])
        for part in SENT:
            self.start(part)

    def start(self, part: str) -> None:
        """Start a part."""
        if part == 'controller':
            topic = 'sent/J_eq_requested' if self.lost else 'J_eq_requested'
            words = ['-c', CONTROLLER, topic]
        else:
            words = [
                '-m',
                MODULES[part],
                '--ros-args',
                '-p',
                'guard.T_max:=450.0',
                '-p',
                f'node.command_timeout:={self.timeout}',
            ]
            for _, topic in SENT[part] if self.lost else ():
                words += ['-r', f'{topic}:=sent/{topic}']
        self.parts[part] = subprocess.Popen([sys.executable, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def wait_for(self, topic: str, heating: bool) -> None:
        """Until the last that was heard is heating, or none; the robot says what is applied when it changes."""
        heard, end = self.heard[topic], time.monotonic() + PATIENCE
        while not heard or (heard[-1][1] != 0.0) != heating:
            if time.monotonic() > end:
                raise RuntimeError(f'{topic}: waited {PATIENCE:g} s in vain')
            self.executor.spin_once(timeout_sec=0.005)

    def zero_since(self, topic: str) -> float:
        """When the zero was heard [s] that heating did not follow."""
        heard = self.heard[topic]
        return heard[1 + max(k for k, (_, value) in enumerate(heard) if value != 0.0)][0]

    def run(self, seconds: float) -> None:
        """Listen for so long."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.005)

    def kill(self, part: str) -> None:
        """SIGKILL; the end is not waited for, so that what is heard meanwhile has its time."""
        self.parts[part].kill()

    def close(self) -> None:
        """End all."""
        import rclpy

        for part in self.parts:
            self.kill(part)
        for process in self.parts.values():
            process.wait()
        rclpy.shutdown(context=self.context)


def time_to_zero(part: str) -> float:
    """From the kill of a part to zero [s]."""
    processes = Processes()
    try:
        topic = 'J_eq' if part == 'robot' else 'J_eq_applied'
        processes.wait_for('J_eq', True)
        processes.run(SETTLED)
        processes.wait_for('J_eq_applied', True)
        began = time.monotonic()
        processes.kill(part)
        processes.run(LASTING)
        processes.wait_for(topic, False)
        return max(processes.zero_since(topic) - began, 0.0)
    finally:
        processes.close()


def false_stops(seconds: float, lost: float) -> dict[str, float]:
    """Zeros of the guard, and of the robot's power, within so many seconds while messages are lost."""
    processes = Processes(lost)
    try:
        processes.wait_for(processes.command, True)
        processes.run(SETTLED)
        for heard in processes.heard.values():
            heard.clear()
        processes.run(seconds)
        zeros = {topic: [value == 0.0 for _, value in heard] for topic, heard in processes.heard.items()}
        begins = {topic: sum(b and not a for a, b in zip([False, *of], of, strict=False)) for topic, of in zeros.items()}
        commands = len(processes.heard[processes.command])
        return {
            'stops of the guard': begins[processes.command],
            'of the power': begins['J_eq_applied'],
            'commands': commands,
        }
    finally:
        processes.close()


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All parts."""
    found: dict[str, Any] = {}
    for part in SENT:
        times = [time_to_zero(part) for _ in range(arguments.kills)]
        found[f'{part} killed'] = {'median [s]': float(np.median(times)), 'longest [s]': max(times)} if times else {}
        print(part, [round(one, 3) for one in times], flush=True)
    if arguments.seconds:
        found[f'{100.0 * arguments.lost:.0f} % of messages lost'] = false_stops(arguments.seconds, arguments.lost)
    return found


if __name__ == '__main__':
    report('Killed parts and lost messages', measure, kills=10, seconds=60, lost=0.1)
