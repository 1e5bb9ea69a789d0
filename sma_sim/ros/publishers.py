"""The node's topics: every message is serialized once, published, and recorded with its simulated time.

In the bag that time is the stamp too, so that a bag has one time base. The published stamps are those of the computer's
clock again after a pause or an overrun, in which simulated time stands still.
"""

from __future__ import annotations

from collections.abc import Sequence
from struct import Struct
from typing import Any

from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64, Float64MultiArray, Header, UInt8MultiArray
from visualization_msgs.msg import MarkerArray

from sma_sim.evidence.data.rosbag.interface import APPLIED, PAIR_COMMAND, interface_of
from sma_sim.model.config import Config
from sma_sim.model.structures.structure import Structure
from sma_sim.ros.graph_check import type_name
from sma_sim.ros.markers import picture_of
from sma_sim.ros.messages import Messages, stamp_of
from sma_sim.ros.qos import LAST_FEW, LATEST, as_metadata, make_publisher
from sma_sim.ros.recorder import RecordedTopic, Recorder
from sma_sim.ros.robot_frames import frame_prefix
from sma_sim.ros.stamped import SUFFIX, variants_of

CDR_HEAD, STAMP = 4, Struct('<iI')  # a message serialized by ROS: bytes before the first field; a time
TRUE_POSE = 'true_joint_states'  # beside joint_states while a sensing effect is active


def sample_topics(made: Messages) -> dict[str, Any]:
    """Message types of what is published with every sample, by topic."""
    return {
        **({'joint_states': JointState} if made.joint_names else {}),
        'wire_states': JointState,
        **dict.fromkeys(made.measured_topics, Float64MultiArray),
        'wire_modes': UInt8MultiArray,
        **{f'{wire}/temperature': Temperature for wire in made.wire_names},
        'phase_fractions': Float64MultiArray,
        'markers': MarkerArray,
    }


def change_topics(structure: Structure) -> dict[str, Any]:
    """Message types of what is published when it changes."""
    topic = interface_of(structure).heating_topic
    heating = {f'{topic}{APPLIED}': Float64 if topic == PAIR_COMMAND else Float64MultiArray}
    return heating | {f'{drive.name}{APPLIED}': Float64 for drive in structure.drives} | {'T_E_applied': Float64}


def restamped(cdr: bytes, stamp: int) -> bytes:
    """A serialized message that begins with a header, with another stamp [ns]: its seconds and nanoseconds come first."""
    return cdr[:CDR_HEAD] + STAMP.pack(*divmod(stamp, 10**9)) + cdr[CDR_HEAD + STAMP.size :]


class Publishers:
    """Publishers of all topics and, while there is one, the recorder."""

    def __init__(self, node: Node, config: Config, clock: bool, messages: Messages) -> None:
        structure = config.structure
        resistances = bool(config.settings['node.publish_resistances'])
        self._messages = messages
        self._frame_prefix = frame_prefix(node.get_namespace())
        self._picture = picture_of(config, self._frame_prefix, messages)
        self._joint_prefix = str(config.settings['node.joint_prefix'])
        senses = any(active.effect.port == 'sensing' for active in config.effects)
        true_pose = {TRUE_POSE: JointState} if senses and structure.coordinates else {}
        changes = change_topics(structure)
        kinds = {**sample_topics(messages), **true_pose, **changes}
        self._stamps = bool(config.settings['node.stamped_topics'])
        self._variants = variants_of(structure, resistances)
        kinds |= {name + SUFFIX: variant.kind for name, variant in self._variants.items() if self._stamps}
        self._publishers = {
            name: make_publisher(node, kind, name, LATEST if name.removesuffix(SUFFIX) in changes else LAST_FEW)
            for name, kind in kinds.items()
        }
        self._numbers = {name: number for number, name in enumerate(kinds)}
        self.recorded = [
            RecordedTopic(publisher.topic_name, type_name(kinds[name]), as_metadata(publisher.qos_profile))
            for name, publisher in self._publishers.items()
        ]
        self._clock = make_publisher(node, Clock, '/clock', LAST_FEW) if clock else None
        self.recorder: Recorder | None = None

    def send(self, name: str, log_time: int, message: Any) -> None:
        """Publish a message and record it with its simulated time [ns]."""
        cdr = serialize_message(message)
        self._publishers[name].publish(cdr)
        if self.recorder is not None:
            recorded = cdr if getattr(message, 'header', None) is None else restamped(cdr, log_time)
            self.recorder.write(self._numbers[name], log_time, recorded)

    def send_with_variant(self, name: str, stamp: int, log_time: int, message: Any) -> None:
        """Send a message that has no header and, where they are asked for, its variant with a stamp [ns]."""
        self.send(name, log_time, message)
        if self._stamps:
            header = Header(stamp=stamp_of(stamp))
            self.send(name + SUFFIX, log_time, self._variants[name].make(header, message))

    def record(self, name: str, log_time: int, message: Any) -> None:
        """Record a message without publishing it."""
        if self.recorder is not None:
            self.recorder.write(self._numbers[name], log_time, serialize_message(message))

    def send_clock(self, stamp: int) -> None:
        """Publish the time [ns], if the node is its source."""
        if self._clock is not None:
            self._clock.publish(Clock(clock=stamp_of(stamp)))

    def send_sample(self, stamp: int, log_time: int, row: NDArray[Any], modes: Sequence[int]) -> None:
        """Publish a row of samples; all stamped messages get the same stamp [ns]."""
        time = stamp_of(stamp)
        made = self._messages
        if made.joint_names:
            self.send('joint_states', log_time, made.joint_state(time, row, True, self._joint_prefix))
        if TRUE_POSE in self._publishers:
            self.send(TRUE_POSE, log_time, made.joint_state(time, row, False, self._joint_prefix))
        self.send('wire_states', log_time, made.wire_state(time, row))
        for topic, message in made.measured(row):
            self.send_with_variant(topic, stamp, log_time, message)
        for wire, name in enumerate(made.wire_names):
            self.send(f'{name}/temperature', log_time, made.temperature(time, row, wire, self._frame_prefix))
        self.send_with_variant('phase_fractions', stamp, log_time, made.phase_fractions(row))
        self.send_with_variant('wire_modes', stamp, log_time, made.wire_modes(modes))

    def send_markers(self, stamp: int, log_time: int, row: NDArray[Any], modes: Sequence[int]) -> None:
        """Publish the picture of a row, if anyone looks at it or it is recorded."""
        if self.recorder is None and self._publishers['markers'].get_subscription_count() == 0:
            return
        picture = self._picture(stamp_of(stamp), row, modes)
        self._publishers['markers'].publish(picture)
        for marker in picture.markers:
            marker.header.stamp = stamp_of(log_time)
        self.record('markers', log_time, picture)
