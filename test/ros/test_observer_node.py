"""The node `sma_observer` beside a simulated robot, over real DDS."""

import subprocess
import sys
import time

import numpy as np
import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from builtin_interfaces.msg import Time  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: E402
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from std_msgs.msg import Float64, Float64MultiArray, UInt8MultiArray  # noqa: E402

from sma_sim import Config, Model  # noqa: E402
from sma_sim.solver.fixed_rate import FixedRateRun  # noqa: E402

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

            def estimates_and_truths():
                """The observer skips samples where the computer is busy: those that have both."""
                estimates = {stamp(message): message for message in one.seen['estimated/wire_1/temperature']}
                truths = {stamp(message): message.temperature for message in one.seen['true_temperature']}
                return [(estimates[at], truths[at]) for at in sorted(estimates.keys() & truths.keys())]

            one.until(lambda: len(estimates_and_truths()) > 10)
            last, truth = estimates_and_truths()[-1]
            assert abs(last.temperature - truth) < 4.0 * last.variance**0.5 + 3.0
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


@pytest.mark.parametrize('jump', [-500.0, -5.0, 0.3, 500.0])
def test_what_is_known_of_the_wires_stays_where_a_clock_is_set(jump):
    """A wire is as hot as before. An observer that took the robot to be at rest let a guard heat it by 50 K too far."""
    with ros_client.Simulation(topics=TOPICS, module='sma_sim.ros.observer_main') as one:
        joints, heating = one.publisher(JointState, 'joint_states'), one.publisher(Float64, 'J_eq')
        run = FixedRateRun(Model(Config()), 1000.0, np.array([0.0, 298.0]))
        truths, began = {}, time.monotonic()
        estimates = one.seen['estimated/wire_1/temperature']

        def follow(until, ahead):
            """The robot in time, 50 samples a second, heated with 9 W from 0.5 s on."""
            while run.time < until:
                J = 9.0 if run.time >= 0.5 else 0.0
                heating.publish(Float64(data=J))
                run.step(np.array([J, 298.0]), 20, 20)
                message = JointState(name=['U_x', 'U_y', 'alpha'], position=[run.shown(n) for n in ('U_x', 'U_y', 'alpha')])
                at = round(1e9 * (1000.0 + run.time + ahead))
                message.header.stamp = Time(sec=at // 10**9, nanosec=at % 10**9)
                joints.publish(message)
                truths[at] = run.shown('T_1')
                while time.monotonic() < began + run.time:
                    one.executor.spin_once(timeout_sec=0.002)

        follow(3.0, 0.0)
        one.until(lambda: estimates and estimates[-1].temperature > 55.0)
        follow(3.5, jump)
        one.until(lambda: stamp(estimates[-1]) in truths and abs(stamp(estimates[-1]) - 1e9 * (1003.5 + jump)) < 2e8)
        after = [m for m in estimates if abs(stamp(m) - 1e9 * (1003.25 + jump)) < 3e8]
        assert len(after) > 5
        assert max(abs(m.temperature + 273.15 - truths[stamp(m)]) for m in after) < 5.0
        code, log = one.stop()
        assert code == 0 and 'stamps of joint_states that jump: by' in log, log


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
