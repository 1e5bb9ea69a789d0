"""Variants with a header of topics that have none, and the command with a stamp, over real DDS."""

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from std_msgs.msg import Float64, Float64MultiArray, Header, UInt8MultiArray  # noqa: E402

from sma_sim.evidence.data.rosbag.reader import read_bag  # noqa: E402
from sma_sim.model.structures.module import STRUCTURE as MODULE  # noqa: E402
from sma_sim.model.structures.spatial import STRUCTURE as SPATIAL  # noqa: E402
from sma_sim.ros.stamped import SUFFIX, commanded_efforts, variants_of  # noqa: E402

DIAGNOSTICS = (DiagnosticArray, '/diagnostics')
TOPICS = (
    (JointState, 'joint_states'),
    (Float64MultiArray, 'wire_forces'),
    (UInt8MultiArray, 'wire_modes'),
    (JointState, 'wire_forces_stamped'),
    (JointState, 'wire_modes_stamped'),
    (JointState, 'phase_fractions_stamped'),
    (Float64, 'J_eq_applied'),
    DIAGNOSTICS,
)
DELAY = 'delay of the last stamped command [s]'


def nanoseconds(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def values_of(one):
    """What the last diagnosis said, by key."""
    return {value.key: value.value for value in one.seen['/diagnostics'][-1].status[0].values}


def test_variants_and_a_late_command(tmp_path):
    words = ('-p', 'node.stamped_topics:=true', '-p', 'node.publish_rate:=10.0', '-p', f'node.record:={tmp_path / "bag"}')
    with ros_client.Simulation(*words, topics=TOPICS) as one:
        seen, kept = one.seen, QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        applied, ambient = [], []
        one.node.create_subscription(JointState, 'J_eq_applied_stamped', applied.append, kept)
        one.node.create_subscription(Temperature, 'T_E_applied_stamped', ambient.append, kept)
        command = one.publisher(JointState, 'J_eq_stamped')
        one.until(lambda: seen['joint_states'] and applied and ambient and seen['/diagnostics'], ros_client.FIRST_MESSAGE)
        assert values_of(one)[DELAY] == 'none'
        half_a_second_ago = one.node.get_clock().now() - ros_client.rclpy.duration.Duration(seconds=0.5)
        header = Header(stamp=half_a_second_ago.to_msg())
        command.publish(JointState(header=header, name=['J_eq'], effort=[12.0]))
        one.until(lambda: applied[-1].effort[0] == 12.0 and seen['J_eq_applied'][-1].data == 12.0)
        one.until(lambda: values_of(one)[DELAY] != 'none')
        assert 0.5 <= float(values_of(one)[DELAY]) < 60.0
        command.publish(JointState(header=header, effort=[1.0, 2.0]))
        one.until(lambda: values_of(one)['rejected commands'] == '1')
        samples = set(map(nanoseconds, seen['joint_states']))
        one.until(lambda: set(map(nanoseconds, seen['wire_modes_stamped'])) - set(map(nanoseconds, seen['joint_states'])))
        code, log = one.stop()
    assert code == 0 and 'J_eq_stamped refused: expected one effort [W] of J_eq, got the names [] and 2 efforts' in log, log
    assert list(applied[-1].name) == ['J_eq'] and min(samples) < nanoseconds(applied[-1])
    assert ambient[0].temperature == pytest.approx(298.0 - 273.15)
    plain = {tuple(message.data) for message in seen['wire_forces']}
    stamped = {tuple(message.effort) for message in seen['wire_forces_stamped']}
    assert len(plain & stamped) > 5  # the first may have come on one of both only
    assert len(samples & set(map(nanoseconds, seen['wire_forces_stamped']))) > 5
    assert list(seen['wire_modes_stamped'][-1].name) == ['mode_1', 'mode_2']
    assert tuple(seen['wire_modes_stamped'][-1].position) in {tuple(message.data) for message in seen['wire_modes']}
    assert 0.0 < seen['phase_fractions_stamped'][-1].position[0] < 1.0
    assert set(read_bag(tmp_path / 'bag')['J_eq_W']) == {0.0, 12.0}


def test_only_when_asked_and_by_the_clock_of_the_node():
    with ros_client.Simulation('-p', 'node.publish_clock:=true', topics=(TOPICS[0], DIAGNOSTICS)) as one:
        command = one.publisher(JointState, 'J_eq_stamped')
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        one.until(lambda: nanoseconds(one.seen['joint_states'][-1]) > 0)  # the first of all has the stamp 0, which is none
        names = {name.strip('/') for name, _ in one.node.get_topic_names_and_types()}
        assert 'wire_forces' in names and not {name + SUFFIX for name in variants_of(MODULE)} & names
        command.publish(JointState(header=one.seen['joint_states'][-1].header, effort=[3.0]))
        one.until(lambda: one.seen['/diagnostics'] and values_of(one)[DELAY] != 'none')
        assert 0.0 <= float(values_of(one)[DELAY]) < 60.0  # by the computer's clock it would be decades
        assert one.stop()[0] == 0


@pytest.mark.parametrize(
    ('names', 'efforts', 'command'),
    [
        (['J_eq'], [3.0], 3.0),
        ([], [3.0], 3.0),
        (['x', 'J_eq'], [1.0, 2.0], 2.0),
        (['alpha'], [3.0], None),
        ([], [], None),
        ([], [1.0, 2.0], None),
        (['J_eq'], [], None),
    ],
)
def test_the_command_in_a_joint_state(names, efforts, command):
    found = commanded_efforts(names, efforts, MODULE.commands)
    assert found == (None if command is None else [command])


@pytest.mark.parametrize(
    ('names', 'efforts', 'command'),
    [
        (['J_3', 'J_1', 'J_2'], [3.0, 1.0, 2.0], [1.0, 2.0, 3.0]),
        ([], [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
        (['J_1', 'J_2'], [1.0, 2.0], None),
        ([], [1.0], None),
        (['J_1', 'J_2', 'J_3'], [1.0, 2.0], None),
    ],
)
def test_the_command_of_several_wires_in_a_joint_state(names, efforts, command):
    assert commanded_efforts(names, efforts, SPATIAL.commands) == command
