"""The node with every structure, over real DDS: started by its name, commanded, recorded, replayed bit for bit, drawn."""

import importlib
import math
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from std_msgs.msg import Float64, Float64MultiArray, String  # noqa: E402
from visualization_msgs.msg import MarkerArray  # noqa: E402

from sma_sim import find_structures  # noqa: E402
from sma_sim.cli.main import main  # noqa: E402
from sma_sim.evidence.data.rosbag.reader import read_bag  # noqa: E402
from sma_sim.evidence.data.tables import read_columns  # noqa: E402
from sma_sim.model.structures.discovery import package_structures  # noqa: E402

EXAMPLE = Path(__file__).resolve().parents[2] / 'examples' / 'own_structure'
# One that imposes the temperatures of several wires stands for all.
STRUCTURES = {
    name: found
    for name, found in package_structures().items()
    if name != 'module' and (found.has_own_columns or name == 'lever_at_T')
}
SET_POINTS = {
    'strain': (0.01, 0.03, 9e99, 0.02),
    'stress': (1e7, 3e7, 9e99, 2e7),
    'crosshead': (1e-3, -1e-3, math.nan, 0.0),
    **dict.fromkeys(('T', 'T_1', 'T_2'), (310.0, 345.0, 9e99, 340.0)),
}
STRUCTURES['rocker'] = find_structures([EXAMPLE])['rocker']
TOPICS = (
    (JointState, 'joint_states'),
    (JointState, 'wire_states'),
    (MarkerArray, 'markers'),
    (DiagnosticArray, '/diagnostics'),
)


def values_of(one):
    """What the last diagnosis said, by key."""
    return (
        {value.key: value.value for value in one.seen['/diagnostics'][-1].status[0].values}
        if one.seen['/diagnostics']
        else {}
    )


def some_time(one, steps=15):
    """Wait for some more samples."""
    count = len(one.seen['wire_states'])
    one.until(lambda: len(one.seen['wire_states']) > count + steps)


def heat(one, structure):
    """Commands at either side, or for each wire another one."""
    levels = (1.5, -1.2, 0.3) if structure.antagonistic else (1.5, 0.0, 0.7)
    if structure.commands == ('J_eq',):
        publisher = one.publisher(Float64, 'J_eq')
        commands = [Float64(data=J) for J in levels]
    else:
        publisher, numbers = one.publisher(Float64MultiArray, 'J'), range(len(structure.commands))
        commands = [Float64MultiArray(data=[J + 0.1 * i for i in numbers]) for J in levels]
    for command in commands:
        publisher.publish(command)
        some_time(one)
    last = ', '.join(f'{number:g}' for number in np.atleast_1d(commands[-1].data))
    one.until(lambda: values_of(one).get(f'{publisher.topic_name.split("/")[-1]} applied [W]') == last)
    return publisher


def impose(one, structure):
    """Set points of what is imposed beside heating; one of them cannot be."""
    for drive in structure.drives:
        publisher = one.publisher(Float64, drive.name)
        values = SET_POINTS[drive.name]
        for value in values:
            publisher.publish(Float64(data=value))
            some_time(one, 3)
        one.until(lambda name=drive.name, last=f'{values[-1]:g}': values_of(one).get(f'{name} applied') == last)
        assert f'{drive.name} = {values[2]:g}' in values_of(one)['last refused command']


def refuse(one, publisher, structure):
    """Commands that cannot be meant: the one before stays in force, and the status tells of the last of them."""
    count = len(structure.commands)
    before = values_of(one)['J applied [W]']
    last, words = ([], 'got 0') if structure.antagonistic else ([1.0] * (count - 1) + [-1e-9], 'no negative number')
    wrong = ([1.0] * (count + 1), [1.0] * (count - 1) + [math.nan], last)
    refused = int(values_of(one)['rejected commands'])
    for data in wrong:
        publisher.publish(Float64MultiArray(data=data))
    one.until(lambda: int(values_of(one)['rejected commands']) == refused + len(wrong))
    assert words in values_of(one)['last refused command'] and values_of(one)['J applied [W]'] == before
    publisher.publish(Float64MultiArray(data=[99.0] * count))
    one.until(lambda: values_of(one)['J applied [W]'] == ', '.join(['2'] * count))
    assert values_of(one)['clipped commands'] == '1'


def check_description(text, structure):
    """The URDF has a joint for every coordinate and both ends of every wire."""
    robot = ElementTree.fromstring(text)
    joints = {joint.get('name'): joint.get('type') for joint in robot.findall('joint')}
    moving = {name: kind for name, kind in joints.items() if kind in ('prismatic', 'revolute')}
    kinds = {'m': 'prismatic', '-': 'prismatic', 'rad': 'revolute'}
    assert moving == {coordinate.name: kinds[coordinate.unit] for coordinate in structure.coordinates}
    links = {link.get('name') for link in robot.findall('link')}
    assert {f'wire_{i + 1}{end}' for i in range(structure.wires) for end in ('', '_end')} <= links
    children = [joint.find('child').get('link') for joint in robot.findall('joint')]
    assert sorted([*children, 'base']) == sorted(links)  # a tree


def check_frames(one, structure):
    """TF moves all links that are not fixed to the base."""
    try:
        kind = importlib.import_module('tf2_msgs.msg').TFMessage
    except ImportError:
        return
    seen = []
    one.node.create_subscription(kind, '/tf', seen.append, 100)
    one.until(lambda: seen)
    ends = {f'wire_{i + 1}_end' for i in range(structure.wires)}
    children = [transform.child_frame_id for transform in seen[-1].transforms]
    assert ends <= set(children) and len(children) == len(structure.coordinates) + structure.wires


# A pair of wires, one with a drive of its own, and a folder of a user's own stand for the others, which run at night.
QUICK = ('lever', 'wire', 'rocker')


@pytest.mark.parametrize('name', [pytest.param(n, marks=() if n in QUICK else pytest.mark.slow) for n in STRUCTURES])
def test_started_commanded_recorded_and_replayed(tmp_path, name, capsys):
    structure, bag = STRUCTURES[name], tmp_path / 'bag'
    words = ['-p', f'system:={name}', '-p', f'node.record:={bag}', '-p', 'node.J_max:=2.0']
    if name == 'rocker':
        words += ['-p', f'structures.paths:=["{EXAMPLE}"]']
    late, kept = [], QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    with ros_client.Simulation(*words, topics=TOPICS) as one:
        one.until(lambda: one.seen['wire_states'] and one.seen['markers'], ros_client.FIRST_MESSAGE)
        one.node.create_subscription(String, 'robot_description', late.append, kept)
        one.publisher(Temperature, 'ambient_temperature').publish(Temperature(temperature=31.7))
        impose(one, structure)
        publisher = heat(one, structure)
        one.until(lambda: late)
        if structure.commands != ('J_eq',):
            refuse(one, publisher, structure)
        check_description(late[0].data, structure)
        check_frames(one, structure)
        some_time(one)
        code, log = one.stop()
    assert code == 0 and 'recorded' in log and 'Traceback' not in log, log
    names = [coordinate.name for coordinate in structure.coordinates]
    assert [list(message.name) for message in one.seen['joint_states'][:1]] == ([names] if names else [])
    drawn = {marker.ns for marker in one.seen['markers'][-1].markers}
    assert {f'wire_{i + 1}' for i in range(structure.wires)} <= drawn
    out = tmp_path / 'again.csv'
    words = ['--set', f'structures.paths={EXAMPLE}'] if name == 'rocker' else []
    assert main(['simulate', '--input', str(bag), '--out', str(out), '--integration-rate', '1000', *words]) == 0, capsys
    recorded = read_bag(bag)
    measured = [column for column in structure.channel_columns if column in recorded]
    published = [column for column in structure.channel_columns if column not in structure.resistance_columns]
    assert measured == published and len(set(recorded['T_E_K'])) == 2
    whole = np.isfinite(recorded[measured[0]])
    again = read_columns(out, tuple(recorded))
    for column, values in recorded.items():
        if not column.startswith('mode'):
            assert np.array_equal(values[whole], again[column]), column
        changes = len(set(values[whole]))
        assert changes > 1 or column.startswith(('mode', 'x_M')) or column in structure.channel_columns, column


@pytest.mark.slow
def test_recorded_commands_are_played_to_a_node(tmp_path):
    """What is linear in a file is sent as set points; a bag plays what it holds."""
    (tmp_path / 'c.csv').write_text('time_s,strain,J_W\n5,0.0,0\n5.5,0.01,0.4\n6,0.01,0.4\n')
    topics = (*TOPICS, (Float64, 'strain_applied'), (Float64MultiArray, 'J_applied'))
    words = ('-p', 'system:=wire', '-p', f'node.record:={tmp_path / "bag"}')
    with ros_client.Simulation(*words, topics=topics) as one:
        one.until(lambda: one.seen['strain_applied'] and one.seen['J_applied'], ros_client.FIRST_MESSAGE)
        played(one, tmp_path, 'c.csv')
        one.until(lambda: [list(message.data) for message in one.seen['J_applied']] == [[0.0], [0.4], [0.0]])
        one.until(lambda: one.seen['strain_applied'][-1].data == 0.01)
        assert one.stop()[0] == 0
    strains = read_bag(tmp_path / 'bag')['strain']
    assert len(set(strains)) > 5 and (np.diff(strains) >= 0.0).all() and strains[-1] == 0.01
    with ros_client.Simulation('-p', 'system:=wire', topics=topics) as one:
        one.until(lambda: one.seen['strain_applied'], ros_client.FIRST_MESSAGE)
        played(one, tmp_path, 'bag', '--speed', '4')
        one.until(lambda: [list(message.data) for message in one.seen['J_applied']] == [[0.0], [0.4], [0.0]])
        one.until(lambda: one.seen['strain_applied'][-1].data == 0.01)
        assert one.stop()[0] == 0


def played(one, folder, *words):
    """`sma-sim play` in the domain of a node."""
    command = [sys.executable, '-m', 'sma_sim.cli.main', 'play', *words]
    environment = one.environment | {'PYTHONPATH': str(EXAMPLE.parents[1])}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and 'heating off' in done.stdout, done.stderr
