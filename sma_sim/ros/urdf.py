"""A tree of links as URDF, the text that RViz, robot_state_publisher and others expect on `robot_description`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from xml.etree import ElementTree

from sma_sim.model.structures.links import Box, Joint, Link, LinkTree

HARDWARE = 'joint_state_topic_hardware_interface/JointStateTopicSystem'


@dataclass(frozen=True)
class TopicControl:
    """What the topic-based hardware of ros2_control needs: a joint to position, two topics of sensor_msgs/JointState."""

    joint: str
    commands: str
    states: str


def urdf_of(tree: LinkTree, frame_prefix: str = '', joint_prefix: str = '', control: TopicControl | None = None) -> str:
    """The URDF; `frame_prefix` stands before the names of links, `joint_prefix` before those of joints that move.

    With `control`, it has a `<ros2_control>` element, from which a controller manager makes its hardware.
    """
    robot = ElementTree.Element('robot', name=tree.name)
    for link in tree.links:
        add_link(robot, link, frame_prefix)
    for joint in tree.joints:
        add_joint(robot, joint, frame_prefix, joint_prefix)
    if control is not None:
        add_topic_control(robot, control, tree, joint_prefix)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding='unicode', xml_declaration=True) + '\n'


def text_of(numbers: Iterable[float]) -> str:
    """Numbers as they can be read back without a loss."""
    return ' '.join(repr(float(number)) for number in numbers)


def add_link(robot: ElementTree.Element, link: Link, prefix: str) -> None:
    """One link with its inertia and its picture."""
    element = ElementTree.SubElement(robot, 'link', name=prefix + link.name)
    if link.mass > 0.0:
        inertial = ElementTree.SubElement(element, 'inertial')
        ElementTree.SubElement(inertial, 'mass', value=repr(link.mass))
        ixx, iyy, izz = map(repr, link.inertia)
        ElementTree.SubElement(inertial, 'inertia', ixx=ixx, ixy='0', ixz='0', iyy=iyy, iyz='0', izz=izz)
    if link.box is not None:
        add_visual(element, link.box, f'{link.name}_material')


def add_visual(element: ElementTree.Element, box: Box, material: str) -> None:
    """One box in its colour."""
    visual = ElementTree.SubElement(element, 'visual')
    ElementTree.SubElement(visual, 'origin', xyz=text_of(box.centre), rpy='0 0 0')
    ElementTree.SubElement(ElementTree.SubElement(visual, 'geometry'), 'box', size=text_of(box.size))
    rgba = [*(int(box.colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)), 1.0]
    ElementTree.SubElement(ElementTree.SubElement(visual, 'material', name=material), 'color', rgba=text_of(rgba))


def add_joint(robot: ElementTree.Element, joint: Joint, frame_prefix: str, joint_prefix: str) -> None:
    """One joint; one without a coordinate is named after its child."""
    motion = joint.motion
    kind = 'floating' if joint.free else 'fixed' if motion is None else 'revolute' if motion.revolute else 'prismatic'
    name = f'{joint.child}_{kind}' if motion is None else joint_prefix + motion.coordinate
    element = ElementTree.SubElement(robot, 'joint', name=name, type=kind)
    ElementTree.SubElement(element, 'parent', link=frame_prefix + joint.parent)
    ElementTree.SubElement(element, 'child', link=frame_prefix + joint.child)
    ElementTree.SubElement(element, 'origin', xyz=text_of(joint.origin), rpy='0 0 0')
    if motion is not None:
        limits = {name: repr(float(getattr(motion, name))) for name in ('lower', 'upper', 'effort', 'velocity')}
        ElementTree.SubElement(element, 'axis', xyz=text_of(motion.axis))
        ElementTree.SubElement(element, 'limit', limits)
        ElementTree.SubElement(element, 'dynamics', damping=repr(motion.damping))


def add_topic_control(robot: ElementTree.Element, control: TopicControl, tree: LinkTree, joint_prefix: str) -> None:
    """Position and velocity of every joint that moves, and a command of the position of one."""
    element = ElementTree.SubElement(robot, 'ros2_control', name=tree.name, type='system')
    hardware = ElementTree.SubElement(element, 'hardware')
    ElementTree.SubElement(hardware, 'plugin').text = HARDWARE
    for name, topic in (('joint_commands_topic', control.commands), ('joint_states_topic', control.states)):
        ElementTree.SubElement(hardware, 'param', name=name).text = topic
    for joint in tree.joints:
        if joint.motion is not None:
            coordinate = joint.motion.coordinate
            child = ElementTree.SubElement(element, 'joint', name=joint_prefix + coordinate)
            if coordinate == control.joint:
                ElementTree.SubElement(child, 'command_interface', name='position')
            for interface in ('position', 'velocity'):
                ElementTree.SubElement(child, 'state_interface', name=interface)
