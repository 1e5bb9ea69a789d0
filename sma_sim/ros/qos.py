"""Quality of service of the nodes' topics: as a user overrides it with ROS parameters, and as a bag keeps it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from copy import copy
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from sma_sim.model.parameter_yaml import POLICIES, QOS_OVERRIDES, check_override

LAST_FEW = QoSProfile(depth=10)
LATEST = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # kept for late subscribers
GIVEN = 'given to the node'  # not in a file
OVERRIDABLE = QoSOverridingOptions([QoSPolicyKind[policy.upper()] for policy in POLICIES])
INFINITE = {'sec': 9223372036, 'nsec': 854775807}  # a duration, as rosbag2 writes it


def make_publisher(node: Node, kind: Any, topic: str, profile: QoSProfile) -> Any:
    """A publisher whose profile parameters of the node override: ``qos_overrides.TOPIC.publisher.POLICY``."""
    return node.create_publisher(kind, topic, copy(profile), qos_overriding_options=OVERRIDABLE)  # rclpy writes into it


def make_subscription(node: Node, kind: Any, topic: str, receive: Callable[..., None], profile: QoSProfile) -> Any:
    """A subscription whose profile parameters of the node override: ``qos_overrides.TOPIC.subscription.POLICY``."""
    return node.create_subscription(kind, topic, receive, copy(profile), qos_overriding_options=OVERRIDABLE)


def take_overrides(node: Node) -> list[str]:
    """Names of the overrides that were given to a node, undeclared, so that its topics can declare them.

    Raises ConfigError for a wrong policy or value; those in a file were checked when it was read.
    """
    names = [name for name in node.get_parameters_by_prefix('') if name.startswith(QOS_OVERRIDES)]
    for name in names:
        check_override(name, node.get_parameter(name).value, GIVEN)
        node.undeclare_parameter(name)
    return names


def warn_of_unused(node: Node, names: Iterable[str]) -> None:
    """Log overrides of topics that a node does not have (a file for several nodes may hold them)."""
    declared = [name for name in node.get_parameters_by_prefix('') if name.startswith(QOS_OVERRIDES)]
    for name in names:
        if name not in declared:
            topics = sorted({known.removeprefix(QOS_OVERRIDES).rsplit('.', 1)[0] for known in declared})
            node.get_logger().warning(f'{name} is not used: this node has {", ".join(topics)}')


def as_metadata(profile: QoSProfile) -> dict[str, Any]:
    """A profile as rosbag2's metadata have it; durations that are not given are infinite."""
    durations = {name: getattr(profile, name).nanoseconds for name in ('deadline', 'lifespan', 'liveliness_lease_duration')}
    written = {
        name: dict(zip(('sec', 'nsec'), divmod(value, 10**9), strict=True)) if value else dict(INFINITE)
        for name, value in durations.items()
    }
    return {
        'history': profile.history.name.lower(),
        'depth': profile.depth,
        'reliability': profile.reliability.name.lower(),
        'durability': profile.durability.name.lower(),
        'deadline': written['deadline'],
        'lifespan': written['lifespan'],
        'liveliness': profile.liveliness.name.lower(),
        'liveliness_lease_duration': written['liveliness_lease_duration'],
        'avoid_ros_namespace_conventions': profile.avoid_ros_namespace_conventions,
    }
