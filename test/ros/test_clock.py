"""Clocks, several modules, markers and `sma-sim play` over real DDS."""

import math
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float32, Float64  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402
from visualization_msgs.msg import MarkerArray  # noqa: E402

from sma_sim.evidence.data.rosbag.reader import read_bag  # noqa: E402
from sma_sim.ros.markers import MODE_RGBA  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
JOINTS = (JointState, 'joint_states')


def seconds(time):
    return time.sec + 1e-9 * time.nanosec


def stamps(messages):
    return np.array([seconds(message.header.stamp) for message in messages])


def smallest_lag(one, count=100):
    """By how much the stamps are behind the computer's clock on arrival [s], at best of some messages."""
    seen = one.seen['joint_states']
    seen.clear()
    lags = []

    def enough():
        if seen:
            lags.append(time.time() - seconds(seen[-1].header.stamp))
            seen.clear()
        return len(lags) >= count

    one.until(enough)
    return min(lags)


def pause_for_a_second(one):
    paused = one.node.create_client(SetBool, '/sma_module_sim/pause')
    one.until(paused.service_is_ready)
    for data in (True, False):
        future = paused.call_async(SetBool.Request(data=data))
        one.until(future.done)
        end = time.monotonic() + 1.0
        one.until(lambda end=end: time.monotonic() > end)


def test_stamps_are_those_of_the_computers_clock(tmp_path):
    """From the start, also while a bag is being made; after a pause; after a reset. The bag keeps simulated time."""
    with ros_client.Simulation('-p', f'node.record:={tmp_path / "bag"}', topics=(JOINTS,)) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        assert abs(smallest_lag(one)) < 0.015
        pause_for_a_second(one)
        assert abs(smallest_lag(one)) < 0.015
        reset = one.node.create_client(Trigger, '/sma_module_sim/reset')
        future = reset.call_async(Trigger.Request())
        one.until(future.done)
        assert abs(smallest_lag(one)) < 0.015
        assert one.stop()[0] == 0
    assert np.diff(read_bag(tmp_path / 'bag')['time_s']).max() < 0.011


def test_stamps_that_count_simulated_time():
    with ros_client.Simulation('-p', 'node.stamps_follow_clock:=false', topics=(JOINTS,)) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        pause_for_a_second(one)
        assert smallest_lag(one) > 0.9
        assert one.stop()[0] == 0


def test_the_node_is_the_clock():
    with ros_client.Simulation('-p', 'node.publish_clock:=true', topics=(JOINTS, (Clock, '/clock'))) as one:
        seen, clock = one.seen['joint_states'], one.seen['/clock']
        one.until(lambda: len(seen) > 30 and len(clock) > 30, ros_client.FIRST_MESSAGE)
        assert stamps(seen)[0] < 60.0 and np.diff([seconds(c.clock) for c in clock]) == pytest.approx(0.01, abs=0.02)
        reset = one.node.create_client(Trigger, '/sma_module_sim/reset')
        one.until(reset.service_is_ready)
        one.until(lambda: stamps(seen)[-1] > 1.0)
        future = reset.call_async(Trigger.Request())
        one.until(future.done)
        one.until(lambda: stamps(seen)[-1] < 0.5)
        assert one.stop()[0] == 0


def test_another_clock_sets_the_pace_and_the_stamps():
    """Twice as fast as the wall, then back to the start."""
    with ros_client.Simulation('-p', 'use_sim_time:=true', topics=(JOINTS,)) as one:
        clock = one.publisher(Clock, '/clock')
        seen, time = one.seen['joint_states'], 100.0

        def tick():
            nonlocal time
            time += 0.02
            now = Clock()
            now.clock.sec, now.clock.nanosec = int(time), int(1e9 * (time % 1.0))
            clock.publish(now)
            one.executor.spin_once(timeout_sec=0.01)

        def tick_until(condition):
            def ticked():
                tick()
                return condition()

            one.until(ticked)

        tick_until(lambda: len(seen) > 100)
        assert stamps(seen)[-1] == pytest.approx(time, abs=0.5)
        assert np.diff(stamps(seen)[-50:]) == pytest.approx(0.01, abs=1e-6)
        time = 7.0
        count = len(seen)
        tick_until(lambda: len(seen) > count + 20 and stamps(seen)[-1] < 50.0)
        assert stamps(seen)[-1] == pytest.approx(time, abs=0.5)
        code, log = one.stop()
        assert code == 0 and re.search(r'/clock went back by 9\d\.\d\d s, to 7\.\d\d s: .* keeps its state', log), log


def test_waiting_for_a_clock_ends_with_ctrl_c():
    with ros_client.Simulation('-p', 'use_sim_time:=true') as one:
        one.until(lambda: 'sma_module_sim' in one.node.get_node_names(), ros_client.FIRST_MESSAGE)
        code, log = one.stop()
        assert code == 0 and 'Traceback' not in log, log


def test_two_modules_in_one_domain():
    """Each hears its own command only; their frames differ."""
    topics = ((JointState, '/left/joint_states'), (JointState, '/right/joint_states'), (MarkerArray, '/left/markers'))
    with ros_client.Simulation('-r', '__ns:=/left', topics=topics) as one:
        one.until(lambda: one.seen['/left/joint_states'], ros_client.FIRST_MESSAGE)
        words = [sys.executable, '-m', 'sma_sim.ros.main', '--ros-args', '-r', '__ns:=/right']
        piped = {'stdout': subprocess.PIPE, 'stderr': subprocess.STDOUT, 'text': True}
        other = subprocess.Popen(words, cwd=ROOT, env=one.environment, **piped)
        try:
            one.until(lambda: one.seen['/right/joint_states'], ros_client.FIRST_MESSAGE)
            command = one.publisher(Float64, '/right/J_eq')
            command.publish(Float64(data=-12.0))
            one.until(lambda: one.seen['/right/joint_states'][-1].position[2] < -math.radians(0.5))
            assert abs(one.seen['/left/joint_states'][-1].position[2]) < 1e-6
            one.until(lambda: one.seen['/left/markers'])
            assert one.seen['/left/markers'][-1].markers[0].header.frame_id == 'left/base'
        finally:
            other.terminate()
            log, _ = other.communicate(timeout=60)
        assert other.returncode == 0, log
        assert one.stop()[0] == 0


def test_markers_show_the_pose_and_the_modes():
    with ros_client.Simulation(topics=((MarkerArray, 'markers'), JOINTS)) as one:
        one.until(lambda: one.seen['markers'] and one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        command = one.publisher(Float64, 'J_eq')
        command.publish(Float64(data=12.0))
        one.until(lambda: one.seen['joint_states'][-1].position[2] > math.radians(1.0))
        count = len(one.seen['markers'])
        one.until(lambda: len(one.seen['markers']) > count)
        shown = one.seen['markers'][-1]  # its joint state may come after it
        one.until(lambda: seconds(shown.markers[0].header.stamp) in stamps(one.seen['joint_states']))
        assert one.stop()[0] == 0
    beam, plate, wire_1, wire_2 = shown.markers
    stamped = dict(zip(stamps(one.seen['joint_states']), one.seen['joint_states'], strict=True))
    pose = stamped[seconds(beam.header.stamp)].position
    assert [m.ns for m in (beam, plate, wire_1, wire_2)] == ['beam', 'plate', 'wire_1', 'wire_2']
    assert (beam.points[-1].x, beam.points[-1].y) == pytest.approx((0.1 + pose[0], pose[1]))
    lean = math.atan2(plate.points[0].x - plate.points[1].x, plate.points[1].y - plate.points[0].y)
    assert lean == pytest.approx(pose[2]) and wire_1.color != wire_2.color
    assert (wire_1.color.r, wire_1.color.g) == pytest.approx((MODE_RGBA[5].r, MODE_RGBA[5].g), abs=1e-3)


@pytest.mark.slow
def test_two_nodes_with_one_name_and_a_command_of_another_type():
    """Both go on and say what is wrong."""
    topics = (JOINTS, (DiagnosticArray, '/diagnostics'))
    with ros_client.Simulation(topics=topics) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        one.node.create_publisher(Float32, 'J_eq', 10)
        # The other's diagnosis goes elsewhere, so that what is seen is what the first node found.
        words = [sys.executable, '-m', 'sma_sim.ros.main', '--ros-args', '-r', '/diagnostics:=/elsewhere']
        other = subprocess.Popen(words, cwd=ROOT, env=one.environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            told = one.seen['/diagnostics']
            for words in ('another node publishes joint_states', 'std_msgs/msg/Float32 is published on J_eq'):
                one.until(lambda words=words: any(words in m.status[0].message for m in told), ros_client.FIRST_MESSAGE)
        finally:
            other.terminate()
            assert other.wait(timeout=60) == 0
        code, log = one.stop()
        assert code == 0 and 'give one of them a namespace' in log, log


def play(one, folder, *words):
    command = [sys.executable, '-m', 'sma_sim.cli.main', 'play', *words]
    return subprocess.run(
        command, cwd=folder, env=one.environment | {'PYTHONPATH': str(ROOT)}, capture_output=True, text=True, timeout=60
    )


def test_play_sends_a_file_in_time(tmp_path):
    (tmp_path / 'c.csv').write_text('time_s,J_eq_W\n5,3\n6,-4\n7,-4\n8,9\n9,9\n')
    with ros_client.Simulation('-r', '__ns:=/left', topics=((Float64, '/left/J_eq_applied'),)) as one:
        one.until(lambda: one.seen['/left/J_eq_applied'], ros_client.FIRST_MESSAGE)
        done = play(one, tmp_path, 'c.csv', '--namespace', 'left', '--speed', '2')
        assert done.returncode == 0 and '4 s played' in done.stdout and 'heating off' in done.stdout, done.stderr
        one.until(lambda: [m.data for m in one.seen['/left/J_eq_applied']] == [0.0, 3.0, -4.0, 9.0, 0.0])
        assert one.stop()[0] == 0


def test_play_without_a_listener_says_so(tmp_path):
    (tmp_path / 'c.csv').write_text('time_s,J_eq_W\n0,3\n1,0\n')
    environment = os.environ | {'ROS_DOMAIN_ID': '101', 'PYTHONPATH': str(ROOT)}
    words = [sys.executable, '-m', 'sma_sim.cli.main', 'play', 'c.csv']
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and 'nobody listens to /J_eq' in done.stderr and 'Traceback' not in done.stderr
