"""The example that follows trajectories: its paths, and the topic and the action over real DDS."""

import importlib.util
import math
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
pytest.importorskip('trajectory_msgs.msg', reason='trajectory_msgs is not installed', exc_type=ImportError)
from builtin_interfaces.msg import Duration, Time  # noqa: E402
from rcl_interfaces.srv import GetParameters  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint  # noqa: E402

from sma_sim.ros.joint_path import JointPath, RefusedError, check, seconds  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / 'examples' / 'trajectory_follower.py'
sys.path.insert(0, str(EXAMPLE.parent))
SPEC = importlib.util.spec_from_file_location('trajectory_follower', EXAMPLE)
follower = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(follower)
ALPHA = 2


def duration(time):
    return Duration(sec=int(time), nanosec=round(1e9 * (time - int(time))))


def trajectory(*points, joint='alpha', stamp=0.0):
    """Points of a time [s] and an angle, a rate, an acceleration."""
    made = JointTrajectory(joint_names=[joint])
    made.header.stamp = Time(sec=int(stamp), nanosec=round(1e9 * (stamp - int(stamp))))
    for time, *values in points:
        message = follower.point(values)
        message.time_from_start = duration(time)
        made.points.append(message)
    return made


def test_positions_are_joined_by_lines():
    path = JointPath(trajectory((2.0, 0.1), (3.0, -0.1)), 10.0, [0.02, 0.5, 7.0])
    assert path.at(10.0)[0] == pytest.approx(0.02) and path.at(11.0) == pytest.approx([0.06, 0.04, 0.0])
    assert path.at(12.5)[:2] == pytest.approx([0.0, -0.2]) and path.at(13.0) == path.at(99.0) == [-0.1, 0.0, 0.0]


@pytest.mark.parametrize('orders', [2, 3])
def test_derivatives_are_met_at_every_point(orders):
    points = [(1.0, 0.1, 0.05, -0.2), (2.5, -0.05, 0.02, 0.3), (4.0, 0.0, 0.0, 0.0)]
    start = [0.03, -0.04, 0.6]
    path = JointPath(trajectory(*(point[: 1 + orders] for point in points)), 5.0, start)
    assert path.at(5.0)[:orders] == pytest.approx(start[:orders])
    for time, *values in points[:-1]:
        for side in (-1e-9, 1e-9):
            assert path.at(5.0 + time + side)[:orders] == pytest.approx(values[:orders], abs=1e-6)


def test_a_stamp_says_when_the_times_start():
    late = JointPath(trajectory((1.0, 0.1), stamp=12.0), 10.0, [0.0, 0.0, 0.0])
    assert late.end == 13.0 and late.at(11.5)[0] == pytest.approx(0.05)
    late_start = JointPath(trajectory((1.0, 0.3), (4.0, 0.1), stamp=8.0), 10.0, [0.0, 0.0, 0.0])
    assert late_start.end == 12.0 and late_start.at(11.0)[0] == pytest.approx(0.05)  # what is in the past is left out
    with pytest.raises(RefusedError) as refused:
        JointPath(trajectory((1.0, 0.1), stamp=3.0), 10.0, [0.0, 0.0, 0.0])
    assert refused.value.args[0] == 'OLD_HEADER_TIMESTAMP'
    assert JointPath(trajectory((0.0, 0.1)), 10.0, [0.0, 0.0, 0.0]).at(10.0) == [0.1, 0.0, 0.0]


@pytest.mark.parametrize(
    ('message', 'code', 'words'),
    [
        (trajectory((1.0, 0.1), joint='beta'), 'INVALID_JOINTS', "joint_names = ['beta']: expected ['alpha']"),
        (trajectory((1.0, 0.1), (1.0, 0.2)), 'INVALID_GOAL', 'point 2: time_from_start = 1 s'),
        (trajectory((1.0, 0.1, 0.0), (2.0, 0.2)), 'INVALID_GOAL', 'point 2: expected a position'),
        (trajectory((1.0,)), 'INVALID_GOAL', 'point 1: expected a position'),
        (trajectory((1.0, math.nan)), 'INVALID_GOAL', 'point 1: [nan]: expected finite'),
        (trajectory((1.0, 4.0)), 'INVALID_GOAL', '-3.142 to 3.142'),
    ],
)
def test_what_cannot_be_followed_is_refused(message, code, words):
    with pytest.raises(RefusedError) as refused:
        check(message, 'alpha', -math.pi, math.pi)
    assert refused.value.args[0] == code and words in refused.value.args[1]


class Followed(ros_client.Simulation):
    """A module and the follower."""

    def __init__(self, *words, speed=4.0):
        topics = ((JointState, 'joint_states'), (Float64, 'J_eq'), (JointTrajectoryPoint, f'{NODE}/desired'))
        super().__init__('-p', f'node.real_time_factor:={speed}', topics=topics)
        command = [sys.executable, str(EXAMPLE), '--ros-args', *words]
        self.control = subprocess.Popen(
            command, env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self.trajectories = self.node.create_publisher(JointTrajectory, f'{NODE}/joint_trajectory', 10)
        self.until(lambda: self.seen['J_eq'] and self.seen['joint_states'], ros_client.FIRST_MESSAGE)
        self.until(lambda: self.trajectories.get_subscription_count() == 1)

    @property
    def alpha(self):
        return self.seen['joint_states'][-1].position[ALPHA]

    @property
    def now(self):
        return seconds(self.seen['joint_states'][-1].header.stamp)

    def wait(self, time):
        """Let simulated time [s] pass."""
        end = self.now + time
        self.until(lambda: self.now >= end)

    def near(self, angle):
        self.until(lambda: abs(self.alpha - angle) < 2e-3)

    def last_desired(self):
        return self.seen[f'{NODE}/desired'][-1]

    def target(self):
        return self.ask(GetParameters, f'{NODE}/get_parameters', GetParameters.Request(names=['alpha_target'])).values[0]

    def result(self, future):
        self.until(future.done)
        return future.result()

    def __exit__(self, *words):
        if self.control.poll() is None:
            self.control.kill()
        self.control.wait()
        self.control.stdout.close()
        super().__exit__(*words)


NODE = 'alpha_trajectory_controller'


def test_a_trajectory_on_the_topic_is_followed_replaced_and_held():
    with Followed() as robot:
        robot.trajectories.publish(trajectory((4.0, 0.05), (8.0, -0.03)))
        robot.until(lambda: robot.seen[f'{NODE}/desired'] and robot.last_desired().velocities[0] < 0.0)
        robot.trajectories.publish(trajectory((6.0, 0.06)))
        robot.until(lambda: robot.last_desired().velocities[0] > 0.0)
        desired = [message.positions[0] for message in robot.seen[f'{NODE}/desired']]
        assert max(abs(b - a) for a, b in zip(desired, desired[1:], strict=False)) < 5e-3  # starts where the other was
        robot.near(0.06)
        robot.wait(2.0)
        assert robot.target().double_value == 0.06  # the parameter shows what is held
        robot.trajectories.publish(trajectory((5.0, 0.0), joint='beta'))
        robot.trajectories.publish(trajectory((20.0, -0.05)))
        robot.until(lambda: robot.last_desired().positions[0] < 0.05)
        robot.trajectories.publish(trajectory())
        count = len(robot.seen[f'{NODE}/desired'])
        robot.wait(2.0)
        assert 0.0 < robot.target().double_value < 0.05 and len(robot.seen[f'{NODE}/desired']) < count + 50
        robot.control.send_signal(signal.SIGINT)
        log, _ = robot.control.communicate(timeout=60)
        assert robot.control.returncode == 0 and 'joint_trajectory refused: joint_names' in log and 'Traceback' not in log


def test_the_hardware_of_ros2_control_sets_the_target():
    with Followed() as robot:
        commands = robot.publisher(JointState, 'joint_commands')
        commands.publish(JointState(name=['alpha'], position=[math.nan]))  # not commanded yet
        commands.publish(JointState(name=['alpha'], position=[0.04]))
        robot.near(0.04)


class Goals(Followed):
    """With a client of the action."""

    def __init__(self, *words):
        super().__init__(*words)
        from rclpy.action import ActionClient

        self.action = control_msgs.FollowJointTrajectory
        self.client = ActionClient(self.node, self.action, f'{NODE}/follow_joint_trajectory')
        self.until(self.client.server_is_ready)
        self.feedback = []

    def send(self, message, **settings):
        """The goal's handle."""
        goal = self.action.Goal(trajectory=message, **settings)
        return self.result(self.client.send_goal_async(goal, lambda feedback: self.feedback.append(feedback.feedback)))

    def outcome(self, handle):
        """Status and error code of a goal's end."""
        answer = self.result(handle.get_result_async())
        return answer.status, answer.result.error_code


SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
control_msgs = None


@pytest.fixture
def goals():
    global control_msgs
    control_msgs = pytest.importorskip('control_msgs.action', reason='control_msgs is not installed', exc_type=ImportError)
    with Goals() as robot:
        yield robot


def test_goals_succeed_fail_are_replaced_and_canceled(goals):
    from control_msgs.msg import JointTolerance

    Result = goals.action.Result
    handle = goals.send(trajectory((6.0, 0.05)))
    assert handle.accepted and goals.outcome(handle) == (SUCCEEDED, Result.SUCCESSFUL)
    assert abs(goals.alpha - 0.05) < 0.011 and goals.feedback
    for message in goals.feedback:
        assert message.joint_names == ['alpha']
        error = message.desired.positions[0] - message.actual.positions[0]
        assert message.error.positions[0] == pytest.approx(error, abs=1e-12)

    assert not goals.send(trajectory((1.0, 0.1), joint='beta')).accepted
    impossible = goals.send(trajectory((0.5, -0.1)), path_tolerance=[JointTolerance(name='alpha', position=0.01)])
    assert goals.outcome(impossible) == (ABORTED, Result.PATH_TOLERANCE_VIOLATED)
    late = goals.send(
        trajectory((0.1, 0.1)),
        goal_tolerance=[JointTolerance(name='alpha', position=1e-4)],
        goal_time_tolerance=duration(0.2),
    )
    assert goals.outcome(late) == (ABORTED, Result.GOAL_TOLERANCE_VIOLATED)

    first = goals.send(trajectory((30.0, 0.05)))
    second = goals.send(trajectory((30.0, -0.05)))
    assert goals.outcome(first) == (ABORTED, Result.INVALID_GOAL)
    goals.wait(1.0)
    goals.result(second.cancel_goal_async())
    assert goals.outcome(second)[0] == CANCELED
    third = goals.send(trajectory((30.0, 0.05)))
    assert goals.ask(Trigger, 'sma_module_sim/reset', Trigger.Request()).success
    assert goals.outcome(third)[0] in (ABORTED, SUCCEEDED)
