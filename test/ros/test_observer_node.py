"""The node `sma_observer` beside a simulated robot, over real DDS."""

import subprocess
import sys
import time

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from builtin_interfaces.msg import Time  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: E402
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from std_msgs.msg import Float64, Float64MultiArray, UInt8MultiArray  # noqa: E402

TOPICS = (
    (JointState, 'joint_states'),
    (Temperature, 'wire_1/temperature'),
    (Temperature, 'estimated/wire_1/temperature'),
    (Temperature, 'estimated/wire_2/temperature'),
    (Float64MultiArray, 'estimated/phase_fractions'),
    (Float64MultiArray, 'estimated/wire_stresses'),
    (UInt8MultiArray, 'estimated/wire_modes'),
    (DiagnosticArray, '/diagnostics'),
)


def stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def status(one):
    """The last that sma_observer said of itself."""
    found = [s for m in one.seen['/diagnostics'] for s in m.status if s.name.endswith('sma_observer')]
    return found[-1] if found else DiagnosticStatus()


def test_estimates_follow_a_robot_that_is_heated():
    """Its own temperatures go by other names, so that the observer does not hear them."""
    robot = ('-r', 'wire_1/temperature:=true_temperature', '-r', 'wire_2/temperature:=other_temperature')
    topics = (*TOPICS, (Temperature, 'true_temperature'))
    with ros_client.Simulation(*robot, '-p', 'node.publish_rate:=50.0', topics=topics) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        words = [sys.executable, '-m', 'sma_sim.ros.observer_main', '--ros-args', '-p', 'wire.lambda:=470.0']
        observer = subprocess.Popen(
            words, cwd=ros_client.ROOT, env=one.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        try:
            one.until(lambda: one.seen['estimated/wire_1/temperature'], ros_client.FIRST_MESSAGE)
            command = one.publisher(Float64, 'J_eq')
            command.publish(Float64(data=10.0))
            one.until(lambda: one.seen['estimated/wire_1/temperature'][-1].temperature > 55.0)
            estimates = {stamp(message): message for message in one.seen['estimated/wire_1/temperature']}
            truths = {stamp(message): message.temperature for message in one.seen['true_temperature']}
            both = sorted(estimates.keys() & truths.keys())
            assert len(both) > 10
            last = estimates[both[-1]]
            assert abs(last.temperature - truths[both[-1]]) < 4.0 * last.variance**0.5 + 3.0
            assert 0.01 < last.variance < 400.0 and last.header.frame_id == 'wire_1'
            assert max(message.temperature for message in one.seen['estimated/wire_2/temperature']) < 30.0
            fractions, stresses = (one.seen[f'estimated/{name}'][-1] for name in ('phase_fractions', 'wire_stresses'))
            assert [dim.size for dim in fractions.layout.dim] == [2, 2] and len(fractions.data) == len(stresses.data) == 4
            assert fractions.data[0] < fractions.data[1] <= 1.0 and stresses.data[0] > stresses.data[1] > 1e7
            assert 'stress [Pa]: values, then standard deviations' in stresses.layout.dim[0].label
            assert list(one.seen['estimated/wire_modes'][-1].data)[0] in range(1, 6)
            one.until(lambda: status(one).message.startswith('observing'))
            observer.send_signal(2)
            log = observer.communicate(timeout=60)[0]
            assert observer.returncode == 0 and 'Traceback' not in log, log
        finally:
            observer.kill()
            observer.communicate()
        code, log = one.stop()
        assert code == 0, log


def test_samples_are_skipped_where_they_come_too_fast():
    """Else the estimate is of a time that is over, and a guard behind it knows nothing of now."""
    with ros_client.Simulation(topics=TOPICS, module='sma_sim.ros.observer_main') as one:
        joints = one.publisher(JointState, 'joint_states')
        one.until(lambda: status(one).message, ros_client.FIRST_MESSAGE)
        for k in range(1, 2001):
            message = JointState(name=['U_x', 'U_y', 'alpha'], position=[-5.6e-5, 0.0, 0.0])
            message.header.stamp = Time(nanosec=100_000 * k)
            joints.publish(message)
            time.sleep(1e-4)
        one.until(lambda: any(stamp(m) == 200_000_000 for m in one.seen['estimated/wire_1/temperature']))
        one.until(lambda: {v.key: v.value for v in status(one).values}.get('samples skipped', '0') != '0')
        assert len(one.seen['estimated/wire_1/temperature']) < 2000
        code, log = one.stop()
        assert code == 0 and 'Traceback' not in log, log


def test_silence_and_foreign_joints_are_said():
    with ros_client.Simulation(topics=TOPICS, module='sma_sim.ros.observer_main') as one:
        one.until(lambda: 'no joint_states for' in status(one).message, ros_client.FIRST_MESSAGE)
        assert status(one).level == DiagnosticStatus.WARN
        joints = one.publisher(JointState, 'joint_states')
        joints.publish(JointState(name=['elbow'], position=[0.1]))
        one.until(
            lambda: (
                {v.key: v.value for v in status(one).values}.get('joint_states without the joints that are expected') == '1'
            )
        )
        assert not one.seen['estimated/wire_1/temperature']
        code, log = one.stop()
        assert code == 0 and 'Traceback' not in log, log
