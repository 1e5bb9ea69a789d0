"""A node of ours in its own process, and a plain rclpy client in a domain of their own."""

import fcntl
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager, suppress
from importlib import metadata
from itertools import cycle
from pathlib import Path

import pytest

rclpy = pytest.importorskip('rclpy', reason='rclpy is not installed: pip install "sma_sim[kilted]"')

from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
DOMAINS, DOMAINS_OF_A_PROCESS = 100, 5  # a late message of one test is not to reach the next
FIRST_MESSAGE = 300.0  # [s]; the first start ever compiles
REACTION = 60.0  # [s]
if 'fastrtps' in os.environ.get('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp'):
    # LOCALHOST would bring its shared memory back, whatever the profile says; Jazzy (7) knows the older name only
    library = 'FASTRTPS' if int(metadata.version('rclpy').split('.')[0]) < 8 else 'FASTDDS'
    os.environ[f'{library}_DEFAULT_PROFILES_FILE'] = str(ROOT / 'test' / 'loopback.xml')
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SUBNET'
else:
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'


def reserved_domains():
    """Domains that no other process of this computer has reserved, and the open file that keeps them so."""
    for first in range(1, DOMAINS, DOMAINS_OF_A_PROCESS):
        with suppress(OSError):  # another process, or another user, has them
            file = open(Path(tempfile.gettempdir()) / f'sma_sim_tests_domain_{first}', 'w')  # noqa: SIM115
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return range(first, first + DOMAINS_OF_A_PROCESS), file
    raise RuntimeError(f'all {DOMAINS} domains are reserved by other tests')


RESERVED, RESERVATION = reserved_domains()
NEXT_DOMAINS = cycle(RESERVED)


def any_domain():
    """One of the domains of this process."""
    return next(NEXT_DOMAINS)


@contextmanager
def listener(domain):
    """A plain node in a domain."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=int(domain))
    node = rclpy.create_node('listener', context=context)
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown(context=context)


class Simulation:
    """A node of ours (`sma_module_sim`) as a subprocess, with a client that collects what it publishes."""

    def __init__(self, *arguments, topics=(), namespace='', module='sma_sim.ros.main', folder=ROOT):
        self.environment = os.environ | {'ROS_DOMAIN_ID': str(any_domain())}
        command = [sys.executable, '-m', module, '--ros-args', *arguments]
        environment = {'PYTHONPATH': str(ROOT), **self.environment}
        self.process = subprocess.Popen(
            command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=int(self.environment['ROS_DOMAIN_ID']))
        self.node = rclpy.create_node('client', context=self.context, namespace=namespace)
        self.executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.seen = {topic: [] for _, topic in topics}
        for kind, topic in topics:
            kept = topic.endswith('_applied')  # published when they change only, and kept for those who come late
            quality = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL) if kept else 100
            self.node.create_subscription(kind, topic, self.seen[topic].append, quality)

    def publisher(self, kind, topic):
        """A publisher that the node has found."""
        made = self.node.create_publisher(kind, topic, 10)
        self.until(lambda: made.get_subscription_count() > 0, FIRST_MESSAGE)
        return made

    def ask(self, kind, name, request):
        """What a service answers, by the name of the service."""
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready, FIRST_MESSAGE)
        future = client.call_async(request)
        self.until(future.done)
        return future.result()

    def until(self, condition, patience=REACTION):
        """Spin until the condition holds; fail when it never does."""
        end = time.monotonic() + patience
        while not condition():
            assert self.process.poll() is None, self.process.stdout.read()
            assert time.monotonic() < end, f'waited {patience} s in vain'
            self.executor.spin_once(timeout_sec=0.05)

    def stop(self):
        """Ctrl-C; the exit code and what was logged."""
        self.process.send_signal(signal.SIGINT)
        try:
            log, _ = self.process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            self.process.kill()
            log, _ = self.process.communicate()
        return self.process.returncode, log

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
            self.process.communicate()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)
