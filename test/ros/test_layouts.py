"""Layouts of PlotJuggler and Foxglove name topics and fields that the running node has."""

import importlib
import json
import numbers
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from std_msgs.msg import Float64  # noqa: E402

LAYOUTS = Path(__file__).resolve().parents[2] / 'layouts'
COMMAND = '/J_eq_applied'


def plotjuggler():
    return ElementTree.parse(LAYOUTS / 'plotjuggler.xml').getroot()


def foxglove():
    return json.loads((LAYOUTS / 'foxglove.json').read_text())


def curves():
    """Series of PlotJuggler."""
    return [curve.get('name') for curve in plotjuggler().iter('curve')]


def paths():
    """Message paths of Foxglove."""
    return [path['value'] for panel in foxglove()['configById'].values() for path in panel.get('paths', [])]


def places(tree):
    """Panels that a split tree shows."""
    return [tree] if isinstance(tree, str) else [*places(tree['first']), *places(tree['second'])]


def test_foxglove_shows_every_panel_once():
    layout = foxglove()
    assert sorted(places(layout['layout'])) == sorted(layout['configById'])
    assert {name.partition('!')[0] for name in layout['configById']} == {'3D', 'Plot', 'StateTransitions'}
    assert layout['configById']['3D!module']['topics'] == {'/markers': {'visible': True}}


def test_plotjuggler_splits_add_up():
    assert plotjuggler().tag == 'root' and plotjuggler().find('tabbed_widget').get('parent') == 'main_window'
    for splitter in plotjuggler().iter('DockSplitter'):
        assert int(splitter.get('count')) == len(splitter) == len(splitter.get('sizes').split(';'))
        for plot in splitter.iter('plot'):
            assert plot.get('mode') == 'TimeSeries' and plot.findall('curve')


def topic_of(path, topics):
    """The topic that a path starts with; None when it is on none."""
    return max((name for name in topics if re.match(rf'{re.escape(name)}[./]', path)), key=len, default=None)


def split(path, topics):
    """The topic that a path starts with, and what follows."""
    topic = topic_of(path, topics)
    assert topic is not None, f'{path} is on no topic'
    return topic, path[len(topic) + 1 :]


def value_of(message, rest):
    """What a path leads to: `field`, `field[1]`, or PlotJuggler's `name/field` of a joint state."""
    if '/' in rest:
        name, field = rest.split('/')
        return getattr(message, field)[list(message.name).index(name)]
    field, place = re.fullmatch(r'(\w+)(?:\[(\d)\])?', rest).groups()
    value = getattr(message, field)
    return value if place is None else value[int(place)]


def class_of(kind):
    package, _, name = kind.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), name)


def test_paths_lead_to_numbers_of_the_running_node():
    wanted = [*curves(), *paths()]
    with ros_client.Simulation() as one:
        one.until(lambda: one.node.count_publishers(COMMAND) == 1, ros_client.FIRST_MESSAGE)

        def known():
            """What the node publishes; nobody else is here yet."""
            found = one.node.get_topic_names_and_types()
            return {name: kinds[0] for name, kinds in found if one.node.count_publishers(name)}

        shown = set(foxglove()['configById']['3D!module']['topics'])
        one.until(lambda: shown <= set(known()) and all(topic_of(path, known()) for path in wanted))
        topics = known()
        used = {split(path, topics)[0] for path in wanted}
        latest = {}
        for topic in used:
            one.node.create_subscription(
                class_of(topics[topic]), topic, lambda message, topic=topic: latest.update({topic: message}), 10
            )
        command = one.node.create_publisher(Float64, '/J_eq', 10)

        def everything_came():
            command.publish(Float64(data=3.0))
            return set(latest) == used

        one.until(everything_came)
        for path in wanted:
            topic, rest = split(path, topics)
            assert isinstance(value_of(latest[topic], rest), numbers.Real), path
