"""Programs that command a robot, stopped at any instant: a listener over real DDS hears zero last."""

import os
import random
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from rclpy._rclpy_pybind11 import RCLError  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64, Float64MultiArray  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
PLAY = ('-m', 'sma_sim.cli.main', 'play')
AFTER_THE_START, AFTER_A_COMMAND = 2.0, 0.5  # [s] within which a signal comes

# by name: arguments, type and topic of the command
PROGRAMS = {
    'play': ([*PLAY, 'module.csv'], Float64, 'J_eq'),
    'play_of_wires': ([*PLAY, 'slider.csv'], Float64MultiArray, 'J'),
    'controller': (['examples/controller.py', '--ros-args', '-p', 'alpha_target:=0.05'], Float64, 'J_eq'),
    'trajectory_follower': (['examples/trajectory_follower.py', '--ros-args', '-p', 'alpha_target:=0.05'], Float64, 'J_eq'),
    **{
        law: (
            [
                '-m',
                'sma_sim.ros.controller_main',
                '--ros-args',
                '-p',
                'control.target:=0.05',
                '-p',
                'control.hold:=true',
                '-p',
                f'control.law:={law}',
            ],
            Float64,
            'J_eq',
        )
        for law in ('predictive', 'feedforward')
    },
    'step_response': (['examples/step_response.py'], Float64, 'J_eq'),
    'sine_target': (['examples/sine_target.py'], Float64, 'alpha_target'),
}
SESSION = """
import os, signal, sys, time
import rclpy
from rclpy.signals import SignalHandlerOptions, install_signal_handlers
from std_msgs.msg import Float64
from sma_sim.ros.last_command import CommandSession
with CommandSession() as session:
    node = rclpy.create_node('commands')
    command = node.create_publisher(Float64, 'J_eq', 10)
    session.end_with(command, Float64(data=0.0))
    while command.get_subscription_count() == 0:
        time.sleep(0.01)
    for _ in range(20):  # a listener may know of the publisher later than it knows of the listener
        command.publish(Float64(data=12.0))
        time.sleep(0.02)
    {end}
"""
HEARS = """
import rclpy
from std_msgs.msg import Float64
rclpy.init()
node = rclpy.create_node('hears')
node.create_subscription(Float64, 'J_eq', lambda _: print('heard', flush=True), 10)
rclpy.spin(node)
"""
ENDS = {
    'an exception': 'raise ValueError("mine")',
    'sys.exit': 'sys.exit(3)',
    'a context that was shut down': 'rclpy.shutdown()',
    'a publisher that was destroyed': 'node.destroy_node()',
    'handlers of rclpy': 'install_signal_handlers(SignalHandlerOptions.ALL); '
    'os.kill(os.getpid(), signal.SIGTERM); session.spin(node)',
}


class Robot:
    """What a commanding program talks to: hears its commands and, where it asks for them, answers with joint states."""

    def __init__(self, node, context, kind, topic):
        self.heard = []
        self._executor = ros_client.rclpy.executors.SingleThreadedExecutor(context=context)
        self._executor.add_node(node)
        node.create_subscription(kind, topic, lambda message: self.heard.append(numbers_of(message)), 1000)
        self._joints, self._stamp = node.create_publisher(JointState, 'joint_states', 10), 0.0

    def serve(self, condition, patience=ros_client.REACTION):
        """Until the condition holds; joint states at rest, one simulated second in twenty of them."""
        end = time.monotonic() + patience
        while not condition():
            assert time.monotonic() < end, 'waited in vain'
            self._stamp += 0.05
            message = JointState(name=['U_x', 'U_y', 'alpha'], position=[0.0] * 3)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(round(1e9 * self._stamp), 10**9)
            with suppress(RCLError):  # where the middleware has no time for it, as on a busy computer
                self._joints.publish(message)
            self._executor.spin_once(timeout_sec=0.01)

    def drain(self):
        """What has arrived and was not looked at yet."""
        count = -1
        while count != len(self.heard):
            count = len(self.heard)
            self._executor.spin_once(timeout_sec=0.2)


def numbers_of(message):
    return [message.data] if isinstance(message, Float64) else list(message.data)


@contextmanager
def start(words, folder, domain):
    """A program as a process, which does not outlive the block: another test may use its domain."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell ignores it in the background
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup ignores it, and a program that is run by it is to go on
    environment = os.environ | {'ROS_DOMAIN_ID': str(domain), 'PYTHONPATH': str(ROOT)}
    words = [str(ROOT / word) if word.startswith('examples/') else word for word in words]
    with subprocess.Popen(
        [sys.executable, *words], cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as program:
        try:
            yield program
        finally:
            program.kill()


def stop_at_random(name, folder, number, chance, repeated=False):
    """Start a program and send it a signal, once or until it ends; its numbers as heard, its exit code, what it said."""
    (folder / 'module.csv').write_text('time_s,J_eq_W\n0,12\n60,12\n')
    (folder / 'slider.csv').write_text('time_s,J_1_W,J_2_W\n0,1.5,0.5\n60,1.5,0.5\n')
    words, kind, topic = PROGRAMS[name]
    domain = ros_client.any_domain()
    with ros_client.listener(domain) as node, start(words, folder, domain) as program:
        robot = Robot(node, node.context, kind, topic)
        if chance.random() < 0.7:
            robot.serve(lambda: any(map(any, robot.heard)) or program.poll() is not None, ros_client.FIRST_MESSAGE)
            instant = time.monotonic() + chance.uniform(0.0, AFTER_A_COMMAND)
        else:
            instant = time.monotonic() + chance.uniform(0.0, AFTER_THE_START)
        robot.serve(lambda: time.monotonic() >= instant)
        assert program.poll() is None, program.stdout.read()
        program.send_signal(number)
        while repeated and program.poll() is None:
            program.send_signal(number)
            time.sleep(0.001)
        robot.serve(lambda: program.poll() is not None)
        robot.drain()
        return robot.heard, program.returncode, program.stdout.read()


def ends_at_zero(heard):
    """Whether the last that was heard is zero, or nothing was."""
    return not heard or not any(heard[-1])


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('name', PROGRAMS)
def test_last_command_is_zero(tmp_path, name, number):
    chance = random.Random(f'{name} {number}')
    for repeated in (False, True):
        heard, code, said = stop_at_random(name, tmp_path, number, chance, repeated)
        assert ends_at_zero(heard), (heard[-3:], code, said)
        assert not any(map(any, heard)) or 'Traceback' not in said and 'not every listener' not in said, said


@pytest.mark.slow
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('name', PROGRAMS)
def test_last_command_is_zero_at_50_instants(tmp_path, name, number):
    chance = random.Random(f'{name} {number} slow')
    runs = [stop_at_random(name, tmp_path, number, chance, repeated=chance.random() < 0.3) for _ in range(50)]
    hot = [(heard[-3:], code, said) for heard, code, said in runs if not ends_at_zero(heard)]
    assert not hot, f'{len(hot)} of 50 ended hot: {hot}'
    assert sum(any(map(any, heard)) for heard, *_ in runs) > 10  # most signals come while it commands


@pytest.mark.parametrize('number', [signal.SIGHUP, signal.SIGQUIT])
def test_play_ends_at_zero_when_its_terminal_does(tmp_path, number):
    class AfterACommand:
        random, uniform = staticmethod(lambda: 0.0), staticmethod(lambda low, high: 0.2)

    heard, code, said = stop_at_random('play', tmp_path, number, AfterACommand)
    assert any(map(any, heard)) and ends_at_zero(heard)
    assert code == 128 + number and f'stopped by {signal.Signals(number).name} after ' in said and 'heating off' in said


@pytest.mark.parametrize('end', ENDS)
def test_session_ends_with_zero_after(tmp_path, end):
    domain = ros_client.any_domain()
    words = ['-c', SESSION.format(end=ENDS[end])]
    with ros_client.listener(domain) as node, start(words, tmp_path, domain) as program:
        robot = Robot(node, node.context, Float64, 'J_eq')
        robot.serve(lambda: program.poll() is not None)
        robot.drain()
        said = program.stdout.read()
    assert robot.heard[0] == [12.0] and robot.heard[-1] == [0.0], said
    assert program.returncode == {'an exception': 1, 'sys.exit': 3}.get(end, 0), said


def test_unconfirmed_zero_is_said(tmp_path):
    """Of a listener whose process stands still, and so confirms nothing."""
    domain = ros_client.any_domain()
    words = ['-c', SESSION.format(end='session.spin(node)')]
    with start(['-c', HEARS], tmp_path, domain) as robot, start(words, tmp_path, domain) as program:
        assert robot.stdout.readline() == 'heard\n'
        robot.send_signal(signal.SIGSTOP)
        program.send_signal(signal.SIGTERM)
        said, _ = program.communicate(timeout=60)
    assert '/J_eq: not every listener has confirmed the last message' in said, said


def test_play_stops_when_nobody_listens_any_more(tmp_path):
    (tmp_path / 'module.csv').write_text('time_s,J_eq_W\n0,12\n600,12\n')
    domain = ros_client.any_domain()
    with start(['-c', HEARS], tmp_path, domain) as robot, start([*PLAY, 'module.csv'], tmp_path, domain) as program:
        assert robot.stdout.readline() == 'heard\n'
        robot.send_signal(signal.SIGINT)
        said, _ = program.communicate(timeout=60)
    gone = '/J_eq any more: is the robot still running? Stopped after '
    assert program.returncode == 2 and f'nobody listens to {gone}' in said and ' of 600 s; heating off' in said, said
    assert 'Traceback' not in said
