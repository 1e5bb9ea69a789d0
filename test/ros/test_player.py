"""`sma-sim play`: a client publishes /clock, stops it, and sets it back; it plays a robot that goes away."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
import rclpy  # noqa: E402
from builtin_interfaces.msg import Time  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]


class Player:
    """`sma-sim play` as a process, and the client that it commands."""

    def __init__(self, folder, *words, command='time_s,J_eq_W\n0,3\n1,-4\n2,9\n4,9\n'):
        (folder / 'c.csv').write_text(command)
        domain = str(ros_client.any_domain())
        self.said = folder / 'said.txt'
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=int(domain))
        self.node, self.heard = rclpy.create_node('robot', context=self.context), []
        self.node.create_subscription(Float64, 'J_eq', lambda message: self.heard.append(message.data), 100)
        self.clock = self.node.create_publisher(Clock, '/clock', 1)
        self.executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        command = [sys.executable, '-m', 'sma_sim.cli.main', 'play', str(folder / 'c.csv'), *words]
        environment = os.environ | {'ROS_DOMAIN_ID': domain, 'PYTHONPATH': str(ROOT)}
        with self.said.open('w') as file:
            self.process = subprocess.Popen(command, env=environment, stdout=file, stderr=file)

    def until(self, condition, t=None, measured=None):
        """Serve the client, which publishes the time `t` [s] and what is `measured`, until what was heard since fulfils a
        condition."""
        count, end = len(self.heard), time.monotonic() + ros_client.REACTION
        while not condition(self.heard[count:]):
            assert time.monotonic() < end, (self.heard, self.said.read_text())
            if t is not None:
                self.clock.publish(Clock(clock=Time(sec=int(t), nanosec=round(t % 1.0 * 1e9))))
            if measured is not None:
                measured.publish(JointState(name=['alpha'], position=[0.0]))
            self.executor.spin_once(timeout_sec=0.02)
        return self.heard[count:]

    def says(self, words):
        """The condition that it has said this."""
        return lambda _: words in self.said.read_text()

    def end(self):
        """Its exit code; all that it sent was heard."""
        self.until(lambda _: self.process.poll() is not None)
        self.until(lambda _: not self.heard or self.heard[-1] == 0.0)
        return self.process.returncode

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)


def test_a_command_goes_by_clock_and_is_off_where_it_stands_still(tmp_path):
    with Player(tmp_path, '--use-sim-time') as one:
        one.until(one.says('waiting for /clock'))
        assert not one.heard
        one.until(lambda since: 3.0 in since, 10.0)
        one.until(one.says('/clock stands still at 10.00 s, after 0.00 of 4 s'), 10.0)
        one.until(lambda since: 0.0 in since)
        assert set(one.until(lambda since: len(since) > 5)) == {0.0}  # nothing but zero while it stands
        assert set(one.until(lambda since: -4.0 in since, 11.5)) <= {0.0, -4.0}
        one.until(lambda since: 9.0 in since, 13.0)  # whatever its pace
        one.until(one.says('4 s played'), 14.5)
        assert one.end() == 0 and one.heard[-1] == 0.0


@pytest.mark.parametrize('how', ['the clock goes back', 'Ctrl-C while it stands still', 'Ctrl-C before it begins'])
def test_whatever_ends_a_command_by_clock_leaves_zero(tmp_path, how):
    with Player(tmp_path, '--use-sim-time') as one:
        if how != 'Ctrl-C before it begins':
            one.until(lambda since: 3.0 in since, 10.0)
        if how == 'the clock goes back':
            one.until(one.says('/clock went back by 5.00 s, to 5.00 s'), 5.0)
        else:
            one.until(one.says('stands still' if 'still' in how else 'waiting for /clock'))
            one.process.send_signal(signal.SIGINT)
        assert one.end() == (2 if how == 'the clock goes back' else 130)
        assert one.heard[-1] == 0.0 and 'heating off' in one.said.read_text()
        assert 'Traceback' not in one.said.read_text()


def test_a_clock_that_is_not_followed_is_said(tmp_path):
    with Player(tmp_path) as one:  # for 4 s, in which the publisher of /clock is found, however late
        one.until(one.says('--use-sim-time lets them follow /clock'), 10.0)
        one.until(one.says('4 s played'), 10.0)
        assert one.end() == 0


@pytest.mark.parametrize('how', ['it ends', 'it falls silent'])
def test_a_robot_that_is_gone_ends_the_command_whoever_else_listens(tmp_path, how):
    """This client listens to the command all along, as a recorder does; another one publishes what the robot measures."""
    with Player(tmp_path, command='time_s,J_eq_W\n0,3\n600,3\n') as one:
        joints = one.node.create_publisher(JointState, 'joint_states', 10)
        one.until(lambda since: 3.0 in since and joints.get_subscription_count(), measured=joints)
        began = time.monotonic()
        one.until(lambda _: time.monotonic() > began + 1.0, measured=joints)
        if how == 'it ends':
            one.node.destroy_publisher(joints)
        assert one.end() == 2 and one.heard[-1] == 0.0
    why = 'what published /joint_states has ended' if how == 'it ends' else 'nothing has come on /joint_states for 3 s'
    assert f'{why}: is the robot still running? Stopped after ' in one.said.read_text()
    assert 'after 0.0 of' not in one.said.read_text() and ' of 600 s; heating off' in one.said.read_text()


@pytest.mark.parametrize('words', [('--namespace', 'le ft'), ('--topic', 'J eq')])
def test_names_that_ros_does_not_take_are_said(tmp_path, words):
    with Player(tmp_path, *words) as one:
        assert one.end() == 2
    assert '(see --namespace and --topic)' in one.said.read_text() and words[1] in one.said.read_text()
