"""Where the parts of the robot are: its URDF on `robot_description` and, where tf2_msgs is installed, /tf and /tf_static."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Header, String

from sma_sim.model.errors import UserError
from sma_sim.model.structures.links import NOWHERE, LinkTree, Transform, fixed_transforms, moving_transforms
from sma_sim.model.structures.links import Vector3 as Point
from sma_sim.ros.qos import LATEST, make_publisher
from sma_sim.ros.urdf import TopicControl, urdf_of

CONTROLLED = 'alpha'  # the joint that ros2_control moves
MOVING = QoSProfile(depth=100)  # as tf2 has it
NO_TF = (
    'no /tf: the package tf2_msgs is not installed (apt install ros-$ROS_DISTRO-tf2-msgs); '
    'robot_state_publisher can make it from robot_description and joint_states'
)


def frame_prefix(namespace: str) -> str:
    """What stands before the frames of a node: modules in several namespaces are told apart."""
    return f'{namespace.strip("/")}/'.lstrip('/')


def stamped(transform: Transform, prefix: str, stamp: Time) -> TransformStamped:
    """One transform as a message."""
    message = TransformStamped(header=Header(stamp=stamp, frame_id=prefix + transform.parent))
    message.child_frame_id = prefix + transform.child
    x, y, z = transform.translation
    message.transform.translation = Vector3(x=x, y=y, z=z)
    x, y, z, w = transform.rotation
    message.transform.rotation = Quaternion(x=x, y=y, z=z, w=w)
    return message


def topic_control(node: Node, tree: LinkTree, settings: Mapping[str, str | bool]) -> TopicControl | None:
    """The topics by which ros2_control reaches the module and its controller, where that was asked for."""
    if not settings['node.ros2_control']:
        return None
    if not any(joint.motion is not None and joint.motion.coordinate == CONTROLLED for joint in tree.joints):
        raise UserError(
            f'node.ros2_control: {tree.name} has no joint {CONTROLLED}, which the controller of the module moves'
        )
    return TopicControl(CONTROLLED, *map(node.resolve_topic_name, ('joint_commands', 'joint_states')))


class RobotFrames:
    """Publishes what a structure says of its links and joints; `settings` are the parameters of the node."""

    def __init__(self, node: Node, tree: LinkTree, settings: Mapping[str, str | bool]) -> None:
        self._tree, self._prefix = tree, frame_prefix(node.get_namespace())
        description = make_publisher(node, String, 'robot_description', LATEST)
        urdf = urdf_of(tree, self._prefix, str(settings['node.joint_prefix']), topic_control(node, tree, settings))
        description.publish(String(data=urdf))
        self._kind: Any = None
        try:
            self._kind = import_module('tf2_msgs.msg').TFMessage
        except ImportError:
            node.get_logger().info(NO_TF)
            return
        self._moving = make_publisher(node, self._kind, '/tf', MOVING)
        self._fixed = make_publisher(node, self._kind, '/tf_static', LATEST)
        self._fixed.publish(self._message(fixed_transforms(tree), node.get_clock().now().to_msg()))

    def send(self, stamp: Time, coordinates: Mapping[str, float], places: Mapping[str, Point] = NOWHERE) -> None:
        """Publish where the links are at the coordinates by name [m or rad], free ones at their `places` [m]."""
        if self._kind is not None:
            self._moving.publish(self._message(moving_transforms(self._tree, coordinates, places), stamp))

    def _message(self, transforms: Iterable[Transform], stamp: Time) -> Any:
        return self._kind(transforms=[stamped(transform, self._prefix, stamp) for transform in transforms])
