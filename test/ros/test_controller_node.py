"""The controller with a model over real DDS: it follows, and it commands zero where it must."""

import math
import signal
import subprocess
import sys

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
pytest.importorskip('trajectory_msgs.msg', reason='trajectory_msgs is not installed', exc_type=ImportError)
from builtin_interfaces.msg import Duration  # noqa: E402
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402
from std_srvs.srv import SetBool  # noqa: E402
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint  # noqa: E402

ALPHA = 2
TOPICS = ((JointState, 'joint_states'), (Float64, 'J_eq'), (Float64, 'J_eq_applied'))
CONTROLLER = 'sma_sim.ros.controller_main'


class Loop(ros_client.Simulation):
    """A module, at half speed for a busy machine, and a controller with a model; `words` are the latter's."""

    ended = False

    def __init__(self, *words, watched=()):
        super().__init__('-p', 'node.real_time_factor:=0.5', '-p', 'model:=mas', topics=(*TOPICS, *watched))
        self.control = subprocess.Popen(
            [sys.executable, '-m', CONTROLLER, '--ros-args', '-p', 'control.silence:=3.0', *words],
            env={'PYTHONPATH': str(ros_client.ROOT), **self.environment}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True,
        )  # fmt: skip
        self.paths = self.node.create_publisher(JointTrajectory, 'sma_controller/joint_trajectory', 10)
        self.targets = self.node.create_publisher(Float64, 'alpha_target', 10)
        self.until(lambda: self.paths.get_subscription_count() == 1, ros_client.FIRST_MESSAGE)

    def until(self, condition, patience=ros_client.REACTION):
        """Spin until the condition holds, which needs the controller."""

        def holds():
            assert self.control.poll() is None or self.ended, self.control.stdout.read()
            return condition()

        super().until(holds, patience)

    @property
    def alpha(self):
        """The last angle [rad]."""
        return self.seen['joint_states'][-1].position[ALPHA]

    @property
    def time(self):
        """The stamp of the last angle [s]."""
        stamp = self.seen['joint_states'][-1].header.stamp
        return stamp.sec + 1e-9 * stamp.nanosec

    def last(self, topic):
        """The last number on a topic, NaN before there was one."""
        return self.seen[topic][-1].data if self.seen[topic] else math.nan

    def end(self):
        """What the controller has said, after Ctrl-C."""
        self.control.send_signal(signal.SIGINT)
        log, _ = self.control.communicate(timeout=60)
        assert self.control.returncode == 0 and 'Traceback' not in log, log
        self.ended = True
        return log

    def __exit__(self, *words):
        if self.control.poll() is None:
            self.control.kill()
        self.control.wait()
        self.control.stdout.close()
        super().__exit__(*words)


def path(*points, joint='alpha'):
    """Points of a time [s] and an angle [rad]."""
    made = JointTrajectory(joint_names=[joint])
    for time, angle in points:
        made.points.append(JointTrajectoryPoint(positions=[angle], time_from_start=Duration(sec=int(time))))
    return made


# The node does the same under both laws, and test_control.py follows trajectories under the other one.
@pytest.mark.parametrize('law', ['predictive', pytest.param('feedforward', marks=pytest.mark.slow)])
def test_follows_a_trajectory_and_ends_with_zero(law):
    with Loop('-p', f'control.law:={law}') as loop:
        loop.until(lambda: len(loop.seen['joint_states']) > 10, ros_client.FIRST_MESSAGE)
        assert not loop.seen['J_eq']  # no target yet
        loop.paths.publish(path((1.0, 0.1), joint='beta'))
        loop.targets.publish(Float64(data=math.nan))
        loop.targets.publish(Float64(data=5.0))  # degrees
        loop.paths.publish(path((2.0, 0.04), (60.0, 0.04)))
        loop.until(lambda: abs(loop.alpha - 0.04) < 2e-3, 120.0)
        loop.targets.publish(Float64(data=-0.03))
        loop.until(lambda: abs(loop.alpha + 0.03) < 2e-3, 120.0)
        log = loop.end()
        assert "joint_names = ['beta']" in log and 'alpha refused: nan' in log
        assert 'alpha refused: 5.0: expected -1.571 to 1.571' in log
        loop.until(lambda: loop.last('J_eq') == 0.0 and loop.last('J_eq_applied') == 0.0)


def test_heating_off_while_joint_states_stop():
    with Loop('-p', 'control.target:=0.05', '-p', 'control.hold:=true') as loop:
        loop.until(lambda: loop.last('J_eq') > 1.0, ros_client.FIRST_MESSAGE)
        loop.ask(SetBool, 'sma_module_sim/pause', SetBool.Request(data=True))
        loop.until(lambda: loop.last('J_eq') == 0.0)
        loop.ask(SetBool, 'sma_module_sim/pause', SetBool.Request(data=False))
        loop.until(lambda: loop.last('J_eq') > 1.0)
        assert 'no joint_states for 3 s' in loop.end()


@pytest.mark.parametrize('law', ['predictive', 'feedforward'])
def test_no_wire_burns_while_the_controller_does_not_go_on(law):
    """The computer runs other things: a command of a target that is far stays in force until the heating times out."""
    limit, simulated = 350.0, 3.0  # [K], [s]
    with Loop('-p', 'control.target:=0.15', '-p', 'control.hold:=true', '-p', f'guard.T_max:={limit}',
              '-p', f'control.law:={law}', watched=((Temperature, 'wire_1/temperature'),)) as loop:  # fmt: skip
        loop.until(lambda: loop.last('J_eq_applied') > 1.0 and loop.seen['joint_states'], ros_client.FIRST_MESSAGE)
        loop.control.send_signal(signal.SIGSTOP)
        begin = loop.time
        loop.until(lambda: loop.time > begin + simulated)
        hottest = max(message.temperature for message in loop.seen['wire_1/temperature']) + 273.15
        assert 0.6 * (limit - 298.0) < hottest - 298.0 < limit - 298.0, hottest  # it was heated for long
        loop.control.send_signal(signal.SIGCONT)
        loop.end()


def test_behind_a_guard_it_asks_for_its_command():
    topics = ((Float64, 'J_eq_requested'),)
    with ros_client.Simulation(
        '-p',
        'control.target:=0.05',
        '-p',
        'control.hold:=true',
        '-p',
        'control.behind_guard:=true',
        topics=topics,
        module=CONTROLLER,
    ) as one:
        joints = one.publisher(JointState, 'joint_states')

        def asked():
            message = JointState(name=['U_x', 'U_y', 'alpha'], position=[-5.6e-5, 0.0, 0.0])
            message.header.stamp = one.node.get_clock().now().to_msg()
            joints.publish(message)
            return any(message.data > 1.0 for message in one.seen['J_eq_requested'])

        one.until(asked)
        assert one.stop()[0] == 0


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (('control.law:=best',), "control.law = 'best': expected predictive or feedforward"),
        (('control.coordinate:=beta',), "control.coordinate = 'beta' is none of system module"),
        (('system:=spatial',), 'system = spatial'),
    ],
)
def test_what_cannot_be_controlled_is_said(words, said):
    arguments = [word for one in words for word in ('-p', one)]
    with ros_client.Simulation(*arguments, module=CONTROLLER) as one:
        assert one.process.wait(ros_client.FIRST_MESSAGE) == 2
        log = one.process.stdout.read()
    assert said in log and 'Traceback' not in log, log
