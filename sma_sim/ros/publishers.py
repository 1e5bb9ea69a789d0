"""The node's topics: every message is serialized once, published, and recorded with its simulated time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64, Float64MultiArray, Header, UInt8MultiArray
from visualization_msgs.msg import MarkerArray

from sma_sim.model.config import Config
from sma_sim.model.parameters import beam_constants
from sma_sim.ros import messages
from sma_sim.ros.graph_check import type_name
from sma_sim.ros.markers import frame_of, markers
from sma_sim.ros.qos import LAST_FEW, LATEST, as_metadata, make_publisher
from sma_sim.ros.recorder import RecordedTopic, Recorder
from sma_sim.ros.robot_frames import frame_prefix
from sma_sim.ros.stamped import SUFFIX, VARIANTS

SAMPLE_TOPICS: Mapping[str, Any] = {
    'joint_states': JointState,
    'wire_states': JointState,
    'wire_forces': Float64MultiArray,
    'wire_modes': UInt8MultiArray,
    'wire_1/temperature': Temperature,
    'wire_2/temperature': Temperature,
    'phase_fractions': Float64MultiArray,
    'markers': MarkerArray,
}
CHANGE_TOPICS: Mapping[str, Any] = {'J_eq_applied': Float64, 'T_E_applied': Float64}  # published when they change
TRUE_POSE = 'true_joint_states'  # beside joint_states while a sensing effect is active


def recorded_topic(publisher: Any, kind: Any) -> RecordedTopic:
    """What a bag says of a topic that is published."""
    return RecordedTopic(publisher.topic_name, type_name(kind), as_metadata(publisher.qos_profile))


class Publishers:
    """Publishers of all topics and, while there is one, the recorder."""

    def __init__(self, node: Node, config: Config, clock: bool) -> None:
        self._beam, self._h = beam_constants(config.parameters), config.parameters['beam.h']
        self._frame, self._frame_prefix = frame_of(node.get_namespace()), frame_prefix(node.get_namespace())
        self._joint_prefix = str(config.settings['node.joint_prefix'])
        senses = any(active.found.effect.port == 'sensing' for active in config.effects)
        kinds = {**SAMPLE_TOPICS, **({TRUE_POSE: JointState} if senses else {}), **CHANGE_TOPICS}
        self._stamps = bool(config.settings['node.stamped_topics'])
        kinds |= {name + SUFFIX: variant.kind for name, variant in VARIANTS.items() if self._stamps}
        self._publishers = {
            name: make_publisher(node, kind, name, LATEST if name.removesuffix(SUFFIX) in CHANGE_TOPICS else LAST_FEW)
            for name, kind in kinds.items()
        }
        self._numbers = {name: number for number, name in enumerate(kinds)}
        self.recorded = [recorded_topic(self._publishers[name], kind) for name, kind in kinds.items()]
        self._clock = make_publisher(node, Clock, '/clock', LAST_FEW) if clock else None
        self.recorder: Recorder | None = None

    def send(self, name: str, log_time: int, message: Any) -> None:
        """Publish a message and record it with its simulated time [ns]."""
        cdr = serialize_message(message)
        self._publishers[name].publish(cdr)
        if self.recorder is not None:
            self.recorder.write(self._numbers[name], log_time, cdr)

    def send_with_variant(self, name: str, stamp: int, log_time: int, message: Any) -> None:
        """Send a message that has no header and, where they are asked for, its variant with a stamp [ns]."""
        self.send(name, log_time, message)
        if self._stamps:
            header = Header(stamp=messages.stamp_of(stamp))
            self.send(name + SUFFIX, log_time, VARIANTS[name].make(header, message))

    def record(self, name: str, log_time: int, message: Any) -> None:
        """Record a message without publishing it."""
        if self.recorder is not None:
            self.recorder.write(self._numbers[name], log_time, serialize_message(message))

    def send_clock(self, stamp: int) -> None:
        """Publish the time [ns], if the node is its source."""
        if self._clock is not None:
            self._clock.publish(Clock(clock=messages.stamp_of(stamp)))

    def send_sample(self, stamp: int, log_time: int, row: NDArray[Any], modes: Sequence[int]) -> None:
        """Publish a row of samples; all stamped messages get the same stamp [ns]."""
        time = messages.stamp_of(stamp)
        self.send('joint_states', log_time, messages.joint_state(time, row, True, self._joint_prefix))
        if TRUE_POSE in self._publishers:
            self.send(TRUE_POSE, log_time, messages.joint_state(time, row, False, self._joint_prefix))
        self.send('wire_states', log_time, messages.wire_state(time, row))
        self.send_with_variant('wire_forces', stamp, log_time, messages.wire_forces(row))
        for wire, name in enumerate(messages.WIRE_NAMES):
            temperature = messages.temperature_message(time, row, wire, self._frame_prefix)
            self.send(f'{name}/temperature', log_time, temperature)
        self.send_with_variant('phase_fractions', stamp, log_time, messages.phase_fractions(row))
        self.send_with_variant('wire_modes', stamp, log_time, messages.wire_modes(modes))

    def send_markers(self, stamp: int, log_time: int, row: NDArray[Any], modes: Sequence[int]) -> None:
        """Publish the picture of a row, if anyone looks at it or it is recorded."""
        if self.recorder is not None or self._publishers['markers'].get_subscription_count() > 0:
            picture = markers(messages.stamp_of(stamp), self._frame, row, modes, self._beam, self._h)
            self.send('markers', log_time, picture)
