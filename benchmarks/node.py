"""The node over DDS: time to its first message, achieved rates, lost samples, share of a core.

python benchmarks/node.py [--seconds 30] [--json FILE]
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import time
from typing import Any

import numpy as np
from common import report

DOMAIN = random.randrange(1, 100)
os.environ |= {'ROS_DOMAIN_ID': str(DOMAIN), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}


def cpu_seconds(process: int) -> float:
    """Processor time that a process has used [s]."""
    with open(f'/proc/{process}/stat') as file:
        fields = file.read().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All numbers of one run."""
    import rclpy
    from sensor_msgs.msg import JointState

    rclpy.init()
    client = rclpy.create_node('benchmark')
    stamps: list[float] = []

    def receive(message: JointState) -> None:
        stamps.append(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)

    client.create_subscription(JointState, 'joint_states', receive, 1000)
    began = time.monotonic()
    node = subprocess.Popen([sys.executable, '-m', 'sma_sim.ros.main'], stderr=subprocess.DEVNULL)
    while not stamps:
        rclpy.spin_once(client, timeout_sec=0.01)
    first = time.monotonic() - began
    begin, used, seen = time.monotonic(), cpu_seconds(node.pid), len(stamps)
    while time.monotonic() - begin < arguments.seconds:
        rclpy.spin_once(client, timeout_sec=0.01)
    passed, cpu = time.monotonic() - begin, cpu_seconds(node.pid) - used
    node.send_signal(signal.SIGINT)
    code = node.wait(10)
    steps = np.diff(stamps)
    client.destroy_node()
    rclpy.shutdown()
    return {
        'node': {
            'first_message_s': first,
            'messages_per_s': (len(stamps) - seen) / passed,
            'simulated_over_wall': (stamps[-1] - stamps[seen - 1]) / passed,
            'lost_samples': int(np.sum(steps > 0.015)),
            'share_of_a_core': cpu / passed,
            'exit_code': code,
        }
    }


if __name__ == '__main__':
    report(__doc__ or '', measure, seconds=30)
