"""Conflicts with other nodes on our topics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible


def type_name(kind: Any) -> str:
    """The name of a message class, such as std_msgs/msg/Float64."""
    return f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'


class GraphCheck:
    """Looks for others that publish topics of `owned`, for two publishers of `commands`, and for other types on `inputs`.

    It also tells of publishers that do not offer the quality of service for which `subscriptions` ask, as an executor does
    for those whose events it takes.
    """

    def __init__(
        self,
        node: Node,
        owned: Sequence[str],
        inputs: Mapping[str, Any],
        commands: Sequence[str] = (),
        subscriptions: Sequence[Any] = (),
    ) -> None:
        self._node, self._owned, self._inputs, self._commands = node, owned, inputs, commands
        self._subscriptions = subscriptions
        self._logged: set[str] = set()

    def problems(self) -> list[str]:
        """What is wrong now, in words; each is logged when it is seen first."""
        found = [
            f'another node publishes {topic} too: give one of them a namespace, such as -r __ns:=/left'
            for topic in self._owned
            if self.publishers(topic) > 1
        ]
        heard = [topic for topic in self._commands if self.publishers(topic)]
        if sum(map(self.publishers, heard)) > 1:
            found.append(f'the command has several publishers, on {" and ".join(heard)}: the last message is in force')
        for topic, expected in self._inputs.items():
            kinds = {info.topic_type for info in self._node.get_publishers_info_by_topic(topic)} - {type_name(expected)}
            found += [f'{kind} is published on {topic}: expected {type_name(expected)}' for kind in sorted(kinds)]
        found += self._mismatches()
        for words in set(found) - self._logged:
            self._node.get_logger().warning(words)
        self._logged |= set(found)
        return found

    def _mismatches(self) -> Iterator[str]:
        """Publishers from which nothing arrives."""
        for subscription in self._subscriptions:
            topic = subscription.topic_name
            for info in self._node.get_publishers_info_by_topic(topic):
                match, reason = qos_check_compatible(info.qos_profile, subscription.qos_profile)
                if match == QoSCompatibility.ERROR:
                    why = reason.removeprefix('ERROR: ').rstrip(';')
                    yield f'nothing arrives on {topic} from {info.node_name}: {why}; see qos_overrides'

    def publishers(self, topic: str) -> int:
        """How many there are, also for a topic that was given another name (count_publishers knows no remapping)."""
        return len(self._node.get_publishers_info_by_topic(topic))
