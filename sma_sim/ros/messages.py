"""Messages of the node, from one row of a run's samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout, UInt8MultiArray

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.data.rosbag.interface import RESISTANCES, SINGLE_CHANNELS
from sma_sim.model.structures.structure import Structure
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.integrate import PER_WIRE, WIRE_COLUMNS

CHANNEL_LABELS = {'stress': 'stress of wire_1 [Pa]', 'strain': 'strain of wire_1 [-]'}  # of a wire on a test bench


def stamp_of(nanoseconds: int) -> Time:
    """A stamp from nanoseconds since the epoch of the node's clock."""
    return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def seconds_of(stamp: Time) -> float:
    """A stamp in seconds."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def array_layout(label: str, size: int) -> MultiArrayLayout:
    """`size` numbers (one per wire), labelled with what they are."""
    return MultiArrayLayout(dim=[MultiArrayDimension(label=label, size=size, stride=size)])


def number_array(label: str, numbers: Sequence[float]) -> Float64MultiArray:
    """Numbers with a label that says what they are."""
    return Float64MultiArray(layout=array_layout(label, len(numbers)), data=list(numbers))


class Messages:
    """The messages of one structure."""

    def __init__(self, structure: Structure, resistances: bool = False) -> None:
        self.where = sample_columns(structure)
        self.joint_names = structure.coordinate_names
        self.wire_names = tuple(f'wire_{i + 1}' for i in range(structure.wires))
        self._of_wires = f'of {", ".join(self.wire_names)}'
        first, joints = self.where.sensed.start, len(self.joint_names)
        self._sensed_pose = slice(first, first + joints)
        channels = {name: first + k for k, name in enumerate(structure.channels)}
        true = self.where.wires.start + WIRE_COLUMNS.index('T')  # where no sensor shows what is imposed
        suffixes = structure.wire_suffixes
        self._temperatures = [channels.get(f'T{suffix}', true + PER_WIRE * i) for i, suffix in enumerate(suffixes)]
        self._measured = {  # label and columns of what is measured of the wires, by topic
            SINGLE_CHANNELS[name]: (CHANNEL_LABELS[name], slice(channels[name], channels[name] + 1))
            for name in SINGLE_CHANNELS
            if name in channels and not joints
        }
        if joints:
            at = slice(channels[f'F{suffixes[0]}'], channels[f'F{suffixes[0]}'] + structure.wires)
            self._measured['wire_forces'] = (f'force {self._of_wires} [N]', at)
        if resistances:
            at = slice(channels[f'R{suffixes[0]}'], channels[f'R{suffixes[0]}'] + structure.wires)
            self._measured[RESISTANCES] = (f'resistance {self._of_wires} [ohm]', at)
        of_pairs = ', '.join(structure.commands)
        self._heating = f'{of_pairs} [W]' if structure.antagonistic else f'J {self._of_wires} [W]'

    @property
    def measured_topics(self) -> tuple[str, ...]:
        """Topics of what is measured of the wires beside their temperatures."""
        return tuple(self._measured)

    def wire_values(self, row: NDArray[Any], column: str) -> list[float]:
        """One quantity of every wire."""
        at = WIRE_COLUMNS.index(column)
        values: list[float] = row[self.where.wires][at::PER_WIRE].tolist()
        return values

    def modes(self, row: NDArray[Any]) -> list[int]:
        """The active mode of every wire, 1 to 5."""
        return [int(mode) for mode in self.wire_values(row, 'mode')]

    def coordinates(self, row: NDArray[Any]) -> dict[str, float]:
        """The true pose by name [m or rad]."""
        return dict(zip(self.joint_names, row[self.where.pose].tolist(), strict=True))

    def joint_state(self, stamp: Time, row: NDArray[Any], sensed: bool, prefix: str = '') -> JointState:
        """Pose [m or rad] as the sensors show it or as it is, its rates, and tau = -J^T F [N or N m].

        `prefix` stands before the names.
        """
        return JointState(
            header=Header(stamp=stamp),
            name=[prefix + name for name in self.joint_names],
            position=row[self._sensed_pose if sensed else self.where.pose].tolist(),
            velocity=row[self.where.rates].tolist(),
            effort=row[self.where.tau].tolist(),
        )

    def wire_state(self, stamp: Time, row: NDArray[Any]) -> JointState:
        """Length [m], its rate [m/s] and the bundle's force [N]."""
        return JointState(
            header=Header(stamp=stamp),
            name=self.wire_names,
            position=self.wire_values(row, 'length'),
            velocity=self.wire_values(row, 'v'),
            effort=self.wire_values(row, 'F'),
        )

    def temperature(self, stamp: Time, row: NDArray[Any], wire: int, frame_prefix: str) -> Temperature:
        """Temperature of a wire (REP 103: in deg C), in the frame of its fixed end."""
        header = Header(stamp=stamp, frame_id=frame_prefix + self.wire_names[wire])
        return Temperature(header=header, temperature=float(row[self._temperatures[wire]]) - ZERO_CELSIUS)

    def measured(self, row: NDArray[Any]) -> Iterator[tuple[str, Float64MultiArray]]:
        """Topic and message of what is measured of the wires beside their temperatures, such as their forces [N]."""
        for topic, (label, at) in self._measured.items():
            yield topic, number_array(label, row[at].tolist())

    def phase_fractions(self, row: NDArray[Any]) -> Float64MultiArray:
        """Martensite fractions x_M."""
        return number_array(f'x_M {self._of_wires} [-]', self.wire_values(row, 'x_M'))

    def wire_modes(self, modes: Sequence[int]) -> UInt8MultiArray:
        """Active hybrid modes, 1 to 5."""
        return UInt8MultiArray(layout=array_layout(f'mode {self._of_wires} (1 to 5)', len(modes)), data=list(modes))

    def heating(self, J: Sequence[float]) -> Float64MultiArray:
        """The heating of every wire, or pair of them [W]."""
        return number_array(self._heating, J)
