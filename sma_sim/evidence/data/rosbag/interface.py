"""The topics of a structure: what each of them carries, and the columns of the file contract that it fills."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import numpy as np

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.data.recording import FIRST
from sma_sim.evidence.data.rosbag.commands import commanded_positions, refusal
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.model.structures.discovery import known_structures
from sma_sim.model.structures.structure import MAX_WIRES, Structure

JOINT_STATE, TEMPERATURE = 'sensor_msgs/msg/JointState', 'sensor_msgs/msg/Temperature'
FLOAT64, FLOAT64_ARRAY = 'std_msgs/msg/Float64', 'std_msgs/msg/Float64MultiArray'
UINT8_ARRAY = 'std_msgs/msg/UInt8MultiArray'
INTERFACE = 'interface'  # of a bag, in what it says of itself
APPLIED = '_applied'  # after the name of a command: what is in force
STAMPED = '_stamped'  # the same with a header
PAIR_COMMAND, WIRE_COMMAND = 'J_eq', 'J'  # topics of the heating: of an antagonistic pair, of every wire
SINGLE_CHANNELS = {'stress': 'wire_stresses', 'strain': 'wire_strains'}  # topics of what is measured on a test bench
RESISTANCES, AMBIENT = 'wire_resistances', 'ambient_temperature'

# The columns, (k,) each, of k messages that agree in all but numbers, as `cdr` gives them.
Decode = Callable[[Any], Mapping[str, Vector]]
Decoders = Mapping[str, tuple[str, Decode]]  # message type and decoder by topic


@dataclass(frozen=True)
class Interface:
    """What the topics of a structure are about.

    Attributes
    ----------
    system : str
        The structure's name.
    joints, drives, channels : mapping
        Columns of the coordinates, of what is imposed, and of what a test bench measures of its wire, by name.
    commands : tuple of str
        Names of the heating commands.
    wires : int
        Bundles of wires.
    """

    system: str
    joints: Mapping[str, str]
    commands: tuple[str, ...]
    wires: int
    drives: Mapping[str, str]
    channels: Mapping[str, str]

    @property
    def signed(self) -> bool:
        """Whether one command heats either of two wires."""
        return len(self.commands) < self.wires or self.commands == (PAIR_COMMAND,)

    @property
    def heating_topic(self) -> str:
        """The topic of the heating."""
        return PAIR_COMMAND if self.commands == (PAIR_COMMAND,) else WIRE_COMMAND

    @property
    def heating_columns(self) -> tuple[str, ...]:
        """The columns of the heating [W]."""
        return tuple(f'{name}_W' for name in self.commands)

    def wire_columns(self, quantity: str, suffix: str = '') -> tuple[str, ...]:
        """The columns of one quantity of every wire; without a number where there is one."""
        if self.wires == 1:
            return (f'{quantity}{suffix}',)
        return tuple(f'{quantity}_{i + 1}{suffix}' for i in range(self.wires))

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns, in the order of files."""
        forces = self.wire_columns('F', '_N') if self.joints else tuple(self.channels.values())
        measured = (*self.joints.values(), *forces, *self.wire_columns('T', '_K'), *self.wire_columns('R', '_ohm'))
        hidden = (*self.wire_columns('x_M'), *self.wire_columns('mode'))
        return ('time_s', *self.drives.values(), *self.heating_columns, 'T_E_K', *measured, *hidden)

    def as_json(self) -> str:
        """As a bag keeps it."""
        return json.dumps(asdict(self))


def interface_of(structure: Structure) -> Interface:
    """The interface of a structure."""
    channels = dict(zip(structure.channels, structure.channel_columns, strict=True))
    return Interface(
        structure.name,
        {coordinate.name: coordinate.column for coordinate in structure.coordinates},
        structure.commands,
        structure.wires,
        {drive.name: drive.column for drive in structure.drives},
        {name: channels[name] for name in SINGLE_CHANNELS if name in channels and not structure.coordinates},
    )


def known_interfaces(commands: int) -> list[Interface]:
    """The interfaces of all structures, usual ones first; of those whose size is a parameter also with so many commands."""
    known = {name: structure for name, structure in known_structures().items() if structure.has_own_columns}
    found = {name: known[name] for name in (*FIRST, *(name for name in known if name not in FIRST))}
    for structure in list(found.values()):
        if structure.of_size is not None:
            low, high = structure.declared[structure.size_name].bounds
            sized = structure.of_size(commands) if low <= commands <= high else structure
            found.setdefault(sized.name, sized)
    return [interface_of(structure) for structure in found.values()]


def interface_from(text: str, where: str) -> Interface:
    """The interface that a bag tells. Raises UserError."""
    try:
        entries = json.loads(text)
        names = (entries['joints'], entries['drives'], entries['channels'])
        wires, commands = entries['wires'], tuple(entries['commands'])
        good = isinstance(wires, int) and 1 <= wires <= MAX_WIRES and all(isinstance(word, str) for word in commands)
        good = good and len(commands) in (wires, wires / 2)
        good = good and all(isinstance(word, str) for mapping in names for pair in mapping.items() for word in pair)
        if not good:
            raise ValueError
        return Interface(str(entries['system']), names[0], commands, wires, names[1], names[2])
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise UserError(f'{where}: what is recorded there of its topics cannot be read') from error


def command_decoders(of: Interface) -> Decoders:
    """What is imposed. Where two topics give the same column the first that was recorded counts."""
    topic = of.heating_topic
    if topic == PAIR_COMMAND:
        heating: tuple[str, Decode] = (FLOAT64, number_decoder(of.heating_columns[0]))
    else:
        heating = (FLOAT64_ARRAY, array_decoder(of.heating_columns))
    found = {f'{topic}{APPLIED}': heating, topic: (heating[0], heating_decoder(of))}
    found[f'{topic}{STAMPED}'] = (JOINT_STATE, stamped_decoder(of))
    for name, column in of.drives.items():
        found[f'{name}{APPLIED}'] = found[name] = (FLOAT64, number_decoder(column))
    found['T_E_applied'] = (FLOAT64, number_decoder('T_E_K'))
    found[AMBIENT] = (TEMPERATURE, temperature_decoder('T_E_K'))
    return found


def measured_decoders(of: Interface) -> Decoders:
    """What is measured, and what the model shows of the wires."""
    names = [f'wire_{i + 1}' for i in range(of.wires)]
    found: dict[str, tuple[str, Decode]] = {}
    if of.joints:
        found['joint_states'] = (JOINT_STATE, joints_decoder(of.joints, 'position'))
        forces = of.wire_columns('F', '_N')
        found['wire_forces'] = (FLOAT64_ARRAY, array_decoder(forces))
        found['wire_states'] = (JOINT_STATE, joints_decoder(dict(zip(names, forces, strict=True)), 'effort'))
    for channel, column in of.channels.items():
        found[SINGLE_CHANNELS[channel]] = (FLOAT64_ARRAY, array_decoder((column,)))
    temperatures = [column for column in of.wire_columns('T', '_K') if column not in of.drives.values()]
    for name, column in zip(names, temperatures, strict=False):
        found[f'{name}/temperature'] = (TEMPERATURE, temperature_decoder(column))
    found[RESISTANCES] = (FLOAT64_ARRAY, array_decoder(of.wire_columns('R', '_ohm')))
    found['phase_fractions'] = (FLOAT64_ARRAY, array_decoder(of.wire_columns('x_M')))
    found['wire_modes'] = (UINT8_ARRAY, array_decoder(of.wire_columns('mode')))
    return found


def joints_decoder(columns: Mapping[str, str], values: str) -> Decode:
    """Values of a JointState by the names in it, which may all have one prefix (node.joint_prefix)."""

    @cache
    def prefixed(names: tuple[str, ...]) -> dict[str, str]:
        prefix = prefix_of(names, tuple(columns))
        return {prefix + name: column for name, column in columns.items()}

    def decode(message: Any) -> dict[str, Vector]:
        by_name = prefixed(tuple(message.name))
        read = zip(message.name, getattr(message, values), strict=False)
        return {by_name[name]: value for name, value in read if name in by_name}

    return decode


def prefix_of(names: Collection[str], expected: Sequence[str]) -> str:
    """What stands before all expected names in `names`; nothing where some have none, or where it could be several."""
    if not expected or set(expected) & set(names):
        return ''
    found = {name.removesuffix(expected[0]) for name in names if name.endswith(expected[0])}
    whole = [prefix for prefix in found if all(prefix + name in names for name in expected)]
    return whole[0] if len(whole) == 1 else ''


def array_decoder(columns: Sequence[str]) -> Decode:
    """Some numbers, one per wire."""

    def decode(message: Any) -> dict[str, Vector]:
        return dict(zip(columns, message.data, strict=False))

    return decode


def heating_decoder(of: Interface) -> Decode:
    """The heating that is asked for; NaN in a message that a robot refuses as a whole."""
    columns, count, signed = of.heating_columns, len(of.commands), of.signed

    def decode(message: Any) -> dict[str, Vector]:
        layouts: list[tuple[list[int], int]]
        if of.heating_topic == PAIR_COMMAND:
            J, layouts = message.data[:, None], [([], 0)] * len(message.data)
        else:
            J, offsets = message.data.T, message.layout.data_offset
            sizes = np.array([dimension.size for dimension in message.layout.dim]).reshape(-1, len(J))
            layouts = list(zip(sizes.T.tolist(), offsets.tolist(), strict=True))
        pairs = zip(J.tolist(), layouts, strict=True)
        refused = [bool(refusal(command, count, signed, *layout)) for command, layout in pairs]
        return {name: np.where(refused, np.nan, J[:, i] if i < J.shape[1] else np.nan) for i, name in enumerate(columns)}

    return decode


def stamped_decoder(of: Interface) -> Decode:
    """The same of a JointState with the efforts of the commands."""
    names = of.heating_columns

    def decode(message: Any) -> dict[str, Vector]:
        positions = commanded_positions(message.name, len(message.effort), of.commands)
        if positions is None:
            return dict.fromkeys(names, np.full(np.shape(message.header.stamp.sec), np.nan))
        J = message.effort[positions]
        refused = [bool(refusal(command, len(of.commands), of.signed)) for command in J.T.tolist()]
        return {name: np.where(refused, np.nan, values) for name, values in zip(names, J, strict=True)}

    return decode


def number_decoder(column: str) -> Decode:
    """One number."""
    return lambda message: {column: message.data}


def temperature_decoder(column: str) -> Decode:
    """A temperature, in deg C in the message (REP 103)."""
    return lambda message: {column: message.temperature + ZERO_CELSIUS}
