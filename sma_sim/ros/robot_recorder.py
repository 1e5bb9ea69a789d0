"""Records what a robot publishes, as it comes, to a bag: for whoever looks at a robot and wants to keep what he sees."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from threading import Lock
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from sensor_msgs.msg import JointState

from sma_sim.evidence.data.rosbag.interface import APPLIED, INTERFACE, STAMPED, interface_of
from sma_sim.model.errors import UserError
from sma_sim.model.structures.structure import Structure
from sma_sim.ros.graph_check import type_name
from sma_sim.ros.qos import LATEST, as_metadata
from sma_sim.ros.recorder import RecordedTopic, Recorder
from sma_sim.ros.robot_subscriptions import SENSOR_QOS, robot_topics


class RobotRecorder:
    """Subscribes to the topics of a robot when it begins a bag; at most one bag at a time. Any thread may ask."""

    def __init__(self, node: Node, structure: Structure, limits: tuple[float, float]) -> None:
        """`limits`: of a file of the bag, megabytes and seconds."""
        self._node, self._structure, self._limits = node, structure, limits
        self._lock = Lock()
        self._recorder: Recorder | None = None
        self._last: dict[int, tuple[Any, bytes]] = {}
        self._subscriptions: list[Any] = []

    @property
    def state(self) -> dict[str, Any]:
        """What is being recorded, for JSON: ``path`` (empty: nothing), ``messages``, ``failed``."""
        recorder = self._recorder
        if recorder is None:
            return {'path': '', 'messages': 0, 'failed': ''}
        return {'path': str(recorder.path), 'messages': recorder.count, 'failed': recorder.failed}

    def start(self, path: Path) -> None:
        """Begin a bag. Raises UserError where one is being written, and where it cannot be made."""
        with self._lock:
            if self._recorder is not None:
                raise UserError(f'{self._recorder.path} is being recorded: stop it first')
            command = f'{interface_of(self._structure).heating_topic}{STAMPED}'  # which a robot takes as well
            topics = {**robot_topics(self._structure), command: JointState}
            about = {INTERFACE: interface_of(self._structure).as_json()}
            recorded = [
                RecordedTopic(self._node.resolve_topic_name(name), type_name(kind), as_metadata(quality_of(name)[0]))
                for name, kind in topics.items()
            ]
            log = self._node.get_logger().error
            self._recorder, self._last = Recorder(path, recorded, about, *self._limits, log), {}
            for number, (name, kind) in enumerate(topics.items()):
                self._subscribe(number, name, kind)

    def stop(self) -> None:
        """End the bag, if one is being written."""
        with self._lock:
            for subscription in self._subscriptions:
                self._node.destroy_subscription(subscription)
            recorder, self._recorder, self._subscriptions = self._recorder, None, []
        if recorder is not None:
            recorder.close()

    def _subscribe(self, number: int, name: str, kind: Any) -> None:
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        for quality in quality_of(name):
            self._subscriptions.append(
                self._node.create_subscription(kind, name, self._receiver(number), quality, event_callbacks=quiet, raw=True)
            )

    def _receiver(self, number: int) -> Callable[[bytes, Mapping[str, Any]], None]:
        def receive(cdr: bytes, info: Mapping[str, Any]) -> None:
            recorder, sent = self._recorder, (info['source_timestamp'], bytes(cdr))
            if recorder is not None and self._last.get(number) != sent:  # heard by both qualities
                self._last[number] = sent
                recorder.write(number, time.time_ns(), sent[1])

        return receive


def quality_of(topic: str) -> list[Any]:
    """How a topic is subscribed to: no one quality hears both what was kept for late subscribers and what was not."""
    return [LATEST, SENSOR_QOS] if topic.endswith(APPLIED) else [SENSOR_QOS]
