"""Messages of the node, from one row of a run's samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout, UInt8MultiArray

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.model.structures.module import STRUCTURE
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.integrate import PER_WIRE, WIRE_COLUMNS

WHERE = sample_columns(STRUCTURE)
JOINT_NAMES = STRUCTURE.coordinate_names
WIRE_NAMES = ('wire_1', 'wire_2')
SENSED_POSE = slice(WHERE.sensed.start, WHERE.sensed.start + 3)
SENSED_FORCE, SENSED_TEMPERATURE = WHERE.sensed.start + 3, WHERE.sensed.start + 5


def stamp_of(nanoseconds: int) -> Time:
    """A stamp from nanoseconds since the epoch of the node's clock."""
    return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def wire_values(row: NDArray[Any], column: str) -> list[float]:
    """One quantity of both wires."""
    at = WIRE_COLUMNS.index(column)
    return [float(row[WHERE.wires.start + i * PER_WIRE + at]) for i in range(2)]


def coordinates(row: NDArray[Any]) -> dict[str, float]:
    """The true pose by name [m, m, rad]."""
    return dict(zip(JOINT_NAMES, row[WHERE.pose].tolist(), strict=True))


def joint_state(stamp: Time, row: NDArray[Any], sensed: bool, prefix: str = '') -> JointState:
    """Pose [m, m, rad] as the sensors show it or as it is, its rates, and tau = -J^T F [N, N, N m].

    `prefix` stands before the names.
    """
    return JointState(
        header=Header(stamp=stamp),
        name=[prefix + name for name in JOINT_NAMES],
        position=row[SENSED_POSE if sensed else WHERE.pose].tolist(),
        velocity=row[WHERE.rates].tolist(),
        effort=row[WHERE.tau].tolist(),
    )


def wire_state(stamp: Time, row: NDArray[Any]) -> JointState:
    """Length [m], its rate [m/s] and the bundle's force [N]."""
    return JointState(
        header=Header(stamp=stamp),
        name=WIRE_NAMES,
        position=wire_values(row, 'length'),
        velocity=wire_values(row, 'v'),
        effort=wire_values(row, 'F'),
    )


def temperature_message(stamp: Time, row: NDArray[Any], wire: int, frame_prefix: str) -> Temperature:
    """Temperature of a wire (REP 103: in deg C), in the frame of its end at the clamp."""
    header = Header(stamp=stamp, frame_id=frame_prefix + WIRE_NAMES[wire])
    return Temperature(header=header, temperature=float(row[SENSED_TEMPERATURE + wire]) - ZERO_CELSIUS)


def array_layout(label: str, size: int = 2) -> MultiArrayLayout:
    """`size` numbers (one per wire), labelled with what they are."""
    return MultiArrayLayout(dim=[MultiArrayDimension(label=label, size=size, stride=size)])


def wire_forces(row: NDArray[Any]) -> Float64MultiArray:
    """Forces of the bundles [N]."""
    data = row[SENSED_FORCE : SENSED_FORCE + 2].tolist()
    return Float64MultiArray(layout=array_layout('force of wire_1, wire_2 [N]'), data=data)


def phase_fractions(row: NDArray[Any]) -> Float64MultiArray:
    """Martensite fractions x_M."""
    return Float64MultiArray(layout=array_layout('x_M of wire_1, wire_2 [-]'), data=wire_values(row, 'x_M'))


def wire_modes(modes: Sequence[int]) -> UInt8MultiArray:
    """Active hybrid modes, 1 to 5."""
    return UInt8MultiArray(layout=array_layout('mode of wire_1, wire_2 (1 to 5)'), data=list(modes))
