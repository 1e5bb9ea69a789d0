"""The URDF, the frames and the picture of a module agree, and RViz's configuration asks for what the node publishes."""

import importlib
import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from sma_sim import default_parameters
from sma_sim.model.parameters import beam_constants
from sma_sim.model.structures.beam import wire_length
from sma_sim.model.structures.beam_links import beam_links
from sma_sim.model.structures.geometry import shape_of
from sma_sim.model.structures.links import fixed_transforms, moving_transforms

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from std_msgs.msg import String  # noqa: E402

from sma_sim.evidence.data.rosbag.interface import prefix_of  # noqa: E402
from sma_sim.evidence.data.rosbag.reader import read_bag  # noqa: E402
from sma_sim.model.structures.module import STRUCTURE as MODULE  # noqa: E402
from sma_sim.ros.messages import Messages  # noqa: E402
from sma_sim.ros.publishers import sample_topics  # noqa: E402
from sma_sim.ros.urdf import TopicControl, urdf_of  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
JOINT_NAMES = MODULE.coordinate_names
VALUES = default_parameters() | {'beam.L': 0.101, 'plate.W': 0.017}
POSES = [(0.0, 0.0, 0.0), (-1e-3, 4e-3, 0.15), (2e-4, -2e-3, -0.7)]


def tf_messages():
    try:
        return importlib.import_module('tf2_msgs.msg')
    except ImportError:
        return None


def numbers(text):
    return np.array([float(word) for word in text.split()])


def joints_of(text):
    return ElementTree.fromstring(text).findall('joint')


def positions_by_urdf(text, q):
    """Origins of all links in the root, from the URDF alone: homogeneous matrices along the chain."""
    frames = {'base': np.eye(4)}
    for joint in joints_of(text):  # parents come before their children
        matrix = np.eye(4)
        matrix[:3, 3] = numbers(joint.find('origin').get('xyz'))
        value, kind = q.get(joint.get('name'), 0.0), joint.get('type')
        if kind == 'prismatic':
            matrix[:3, 3] += value * numbers(joint.find('axis').get('xyz'))
        elif kind == 'revolute':
            x, y, z = numbers(joint.find('axis').get('xyz'))
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            matrix[:3, :3] = np.eye(3) + math.sin(value) * cross + (1.0 - math.cos(value)) * cross @ cross
        frames[joint.find('child').get('link')] = frames[joint.find('parent').get('link')] @ matrix
    return frames


def rotation_of(x, y, z, w):
    """The matrix of a unit quaternion."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def frames_by_transforms(tree, q):
    frames = {'base': np.eye(4)}
    for parent, child, translation, rotation in [*moving_transforms(tree, q), *fixed_transforms(tree)]:
        matrix = np.eye(4)
        matrix[:3, 3], matrix[:3, :3] = translation, rotation_of(*rotation)
        frames[child] = frames[parent] @ matrix
    return frames


def test_urdf_is_a_tree_with_the_joints_of_joint_states():
    robot = ElementTree.fromstring(urdf_of(beam_links(VALUES), 'left/', 'left_'))
    links = [link.get('name') for link in robot.findall('link')]
    children = [joint.find('child').get('link') for joint in robot.findall('joint')]
    parents = {joint.find('parent').get('link') for joint in robot.findall('joint')}
    assert len(set(links)) == len(links) and len(set(children)) == len(children)
    assert set(links) - set(children) == {'left/base'} and parents | set(children) == set(links)
    moving = [joint for joint in robot.findall('joint') if joint.get('type') != 'fixed']
    assert [joint.get('name') for joint in moving] == [f'left_{name}' for name in JOINT_NAMES]
    for joint in moving:
        limit = {name: float(value) for name, value in joint.find('limit').items()}
        assert limit['lower'] < 0.0 < limit['upper'] and limit['effort'] > 0.0 and limit['velocity'] > 0.0


@pytest.mark.parametrize('pose', POSES)
def test_frames_are_those_of_the_urdf_of_the_markers_and_of_the_equations(pose):
    tree, q, b = beam_links(VALUES), dict(zip(JOINT_NAMES, pose, strict=True)), beam_constants(VALUES)
    frames, expected = frames_by_transforms(tree, q), positions_by_urdf(urdf_of(tree), q)
    assert set(frames) == set(expected) == {link.name for link in tree.links}
    for name, frame in frames.items():
        np.testing.assert_allclose(frame, expected[name], atol=1e-12)
    shape = shape_of(*pose, b)
    np.testing.assert_allclose(frames['plate'][:2, 3], shape.beam[-1], atol=1e-12)
    for side, name, line in zip((-1.0, 1.0), ('wire_1', 'wire_2'), shape.wires, strict=True):
        start, end = frames[name][:3, 3], frames[f'{name}_plate'][:3, 3]
        np.testing.assert_allclose([start[:2], end[:2]], line, atol=1e-12)
        assert np.linalg.norm(end - start) == pytest.approx(wire_length(*pose, side, b)[0], abs=1e-12)


@pytest.mark.parametrize(
    ('names', 'prefix'),
    [
        (['left_U_x', 'left_U_y', 'left_alpha', 'wrist'], 'left_'),
        (['U_x', 'left_U_x', 'left_U_y', 'left_alpha'], ''),  # the plain name is there
        (['left_U_x', 'right_U_y', 'left_alpha'], ''),  # not one module
        (['left_alpha'], ''),  # perhaps another robot's
        ([f'{side}_{name}' for side in ('left', 'right') for name in JOINT_NAMES], ''),  # which of two?
    ],
)
def test_a_prefix_is_recognized_only_where_it_is_clear(names, prefix):
    assert prefix_of(names, JOINT_NAMES) == prefix


def test_the_hardware_of_ros2_control_finds_its_topics_and_joints():
    control = TopicControl('alpha', '/left/joint_commands', '/left/joint_states')
    description = ElementTree.fromstring(urdf_of(beam_links(VALUES), 'left/', 'arm_', control))
    element = description.find('ros2_control')
    assert element.get('type') == 'system' and element.findtext('hardware/plugin').endswith('/JointStateTopicSystem')
    topics = {param.get('name'): param.text for param in element.findall('hardware/param')}
    assert topics == {'joint_commands_topic': '/left/joint_commands', 'joint_states_topic': '/left/joint_states'}
    joints = {
        joint.get('name'): [kind.get('name') for kind in joint.findall('command_interface')]
        for joint in element.findall('joint')
    }
    assert joints == {'arm_U_x': [], 'arm_U_y': [], 'arm_alpha': ['position']}
    assert set(joints) == {joint.get('name') for joint in description.findall('joint') if joint.get('type') != 'fixed'}
    assert 'ros2_control' not in urdf_of(beam_links(VALUES))


def test_rviz_shows_topics_of_the_node_in_its_frame():
    manager = yaml.safe_load((ROOT / 'rviz' / 'sma_module.rviz').read_text())['Visualization Manager']
    displays = {display['Name']: display for display in manager['Displays']}
    assert manager['Global Options']['Fixed Frame'] == beam_links(VALUES).links[0].name
    assert displays['MarkerArray']['Topic']['Value'] in sample_topics(Messages(MODULE))
    assert displays['RobotModel']['Description Topic']['Value'] == 'robot_description'
    assert displays['RobotModel']['Description Topic']['Durability Policy'] == 'Transient Local'


def test_a_late_subscriber_gets_the_description_and_the_frames(tmp_path):
    tf = tf_messages()
    topics = [] if tf is None else [(tf.TFMessage, '/tf')]
    words = (
        '-r',
        '__ns:=/left',
        '-p',
        'beam.L:=0.101',
        '-p',
        'plate.W:=0.017',
        '-p',
        'node.joint_prefix:=left_',
        '-p',
        'node.ros2_control:=true',
        '-p',
        f'node.record:={tmp_path / "bag"}',
    )
    topics += [(JointState, 'joint_states'), (Temperature, 'wire_2/temperature')]
    with ros_client.Simulation(*words, topics=topics, namespace='/left') as one:
        one.until(lambda: one.node.count_publishers('/left/robot_description') == 1, ros_client.FIRST_MESSAGE)
        late = []
        kept = ros_client.QoSProfile(depth=1, durability=ros_client.DurabilityPolicy.TRANSIENT_LOCAL)
        one.node.create_subscription(String, 'robot_description', late.append, kept)
        if tf is not None:
            fixed = []
            one.node.create_subscription(tf.TFMessage, '/tf_static', fixed.append, kept)
            one.until(lambda: fixed and one.seen['/tf'])
            children = {transform.child_frame_id for transform in one.seen['/tf'][-1].transforms + fixed[0].transforms}
            assert children == {f'left/{link.name}' for link in beam_links(VALUES).links[1:]}
        one.until(lambda: late and len(one.seen['joint_states']) > 5 and one.seen['wire_2/temperature'])  # and commands
        code, log = one.stop()
    assert code == 0 and late[0].data == urdf_of(
        beam_links(VALUES), 'left/', 'left_', TopicControl('alpha', '/left/joint_commands', '/left/joint_states')
    )
    moving = [joint.get('name') for joint in joints_of(late[0].data) if joint.get('type') != 'fixed']
    assert list(one.seen['joint_states'][0].name) == moving == ['left_U_x', 'left_U_y', 'left_alpha']
    links = {link.get('name') for link in ElementTree.fromstring(late[0].data).findall('link')}
    assert one.seen['wire_2/temperature'][0].header.frame_id == 'left/wire_2' and 'left/wire_2' in links
    assert np.isfinite(read_bag(tmp_path / 'bag')['alpha_rad']).any()  # our bags are read with any prefix
    assert ('no /tf: the package tf2_msgs is not installed' in log) == (tf is None)
