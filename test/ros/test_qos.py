"""Quality of service that users override with ROS parameters, as others see it in the graph and in the node's bag."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from sma_sim import read_config

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from rcl_interfaces.srv import DescribeParameters, GetParameters  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402
from rosbags.rosbag2 import Reader  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402

from sma_sim.model.config import ConfigError  # noqa: E402
from sma_sim.ros.qos import check_override  # noqa: E402

OVERRIDES = {
    '/left/joint_states': {'publisher': {'reliability': 'best_effort', 'depth': 3}},
    '/left/wire_states': {'publisher': {'durability': 'transient_local', 'depth': 20}},
    '/left/J_eq': {'subscription': {'durability': 'transient_local', 'depth': 1}},
    '/right/joint_states': {'publisher': {'depth': 3}},
}


def ask(one, kind, service, **request):
    """What a service of the node answers."""
    return one.ask(kind, f'/left/sma_module_sim/{service}', kind.Request(**request))


def published(one, topic):
    """The profile of a topic's publisher in the graph."""
    one.until(lambda: one.node.get_publishers_info_by_topic(topic), ros_client.FIRST_MESSAGE)
    return one.node.get_publishers_info_by_topic(topic)[0].qos_profile


def test_overrides_reach_the_graph_the_bag_and_the_parameters(tmp_path):
    file = tmp_path / 'robot.yaml'
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': {'model': 'mas', 'qos_overrides': OVERRIDES}}}))
    assert read_config(file).simulated_kinetics == 'mas'  # the offline commands read the same file
    words = ('--params-file', str(file), '-p', f'node.record:={tmp_path / "bag"}', '-r', '__ns:=/left')
    with ros_client.Simulation(*words, namespace='/left') as one:
        joints, wires = published(one, '/left/joint_states'), published(one, '/left/wire_states')
        plain = published(one, '/left/wire_forces')
        assert (joints.reliability, joints.durability) == (ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE)
        assert (wires.reliability, wires.durability) == (ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)
        assert (plain.reliability, plain.durability) == (ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)
        one.until(lambda: one.node.get_subscriptions_info_by_topic('/left/J_eq'))
        command = one.node.get_subscriptions_info_by_topic('/left/J_eq')[0].qos_profile
        assert command.durability == DurabilityPolicy.TRANSIENT_LOCAL
        late = []
        kept = QoSProfile(depth=20, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        applied = []
        one.node.create_subscription(Float64, 'J_eq_applied', applied.append, kept)
        one.node.create_publisher(Float64, 'J_eq', kept).publish(Float64(data=7.0))  # before it has met the node
        one.until(lambda: applied and applied[-1].data == 7.0)
        one.node.create_subscription(JointState, 'wire_states', late.append, kept)
        one.until(lambda: len(late) > 25)  # twenty of them from before
        name = 'qos_overrides./left/joint_states.publisher.depth'
        assert ask(one, GetParameters, 'get_parameters', names=[name]).values[0].integer_value == 3
        described = ask(one, DescribeParameters, 'describe_parameters', names=[name]).descriptors[0]
        assert described.read_only and 'joint_states' in described.description
        code, log = one.stop()
    assert code == 0 and 'qos_overrides./right/joint_states.publisher.depth is not used' in log, log
    with Reader(tmp_path / 'bag') as reader:
        offered = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
    assert (offered['/left/joint_states'].depth, offered['/left/joint_states'].reliability.name) == (3, 'BEST_EFFORT')
    assert (offered['/left/wire_states'].depth, offered['/left/wire_states'].durability.name) == (20, 'TRANSIENT_LOCAL')
    assert (offered['/left/wire_forces'].depth, offered['/left/wire_forces'].durability.name) == (10, 'VOLATILE')


@pytest.mark.parametrize(
    ('name', 'value', 'message'),
    [
        ('/joint_states.publisher.dept', 3, 'POLICY is one of history, depth, reliability, durability'),
        ('/joint_states.depth', 3, 'POLICY is one of'),
        ('/joint_states.publisher.depth', 0, '= 0 .in robot.yaml.: expected a whole number of messages, 1 to'),
        ('/joint_states.publisher.depth', 3.0, 'expected a whole number'),
        ('/joint_states.publisher.reliability', 'reliabel', "= 'reliabel' .*: expected reliable or best_effort"),
        ('/joint_states.publisher.durability', 1, '= 1 .*: expected volatile or transient_local'),
    ],
)
def test_wrong_overrides_are_refused(name, value, message):
    with pytest.raises(ConfigError, match=message):
        check_override(f'qos_overrides.{name}', value, 'in robot.yaml')


def test_a_wrong_override_stops_the_node():
    words = ['-p', 'qos_overrides./joint_states.publisher.reliability:=reliabel']
    command = [sys.executable, '-m', 'sma_sim.ros.main', '--ros-args', *words]
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2 and 'expected reliable or best_effort' in done.stderr, done.stderr
    assert 'Traceback' not in done.stderr
