"""`sma-sim play`: send recorded commands to a node or a robot."""

from __future__ import annotations

import argparse
import sys
from contextlib import suppress
from pathlib import Path
from signal import Signals
from typing import Any

import numpy as np

from sma_sim.cli.common.commands import add_command
from sma_sim.cli.common.config_options import add_config_options, add_namespace_option, config_from
from sma_sim.cli.common.input_files import read_input
from sma_sim.evidence.data.rosbag.bag_files import is_bag
from sma_sim.evidence.data.rosbag.interface import PAIR_COMMAND, Interface, interface_of
from sma_sim.evidence.data.rosbag.reader import interface_of_robot, read_bag
from sma_sim.evidence.data.rosbag.run_writer import interface_of_columns
from sma_sim.evidence.data.tables import read_header
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.model.program_parameters import DEFAULTS
from sma_sim.model.progress import ProgressLine
from sma_sim.model.structures.structure import Structure
from sma_sim.ros.entry import NO_ROS
from sma_sim.solver.inputs import Input, inputs_at

SET_POINT_RATE = 50.0  # [1/s] of set points that are linear between the rows of a file


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'play')
    parser.add_argument(
        'file', type=Path, metavar='FILE', help='CSV file with time_s and J_eq_W (J_W, J_1_W, ...), or a bag'
    )
    parser.add_argument('--topic', help='topic to publish the heating on (default: J_eq or J)')
    parser.add_argument('--speed', type=float, default=1.0, help='factor of time: 2 plays twice as fast (default 1)')
    parser.add_argument('--use-sim-time', action='store_true', help='follow /clock in place of the clock of this computer')
    parser.add_argument('--system', metavar='NAME', help='structure that is commanded (default: as the file tells)')
    add_namespace_option(parser)
    add_config_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Read the commands and send them."""
    if not 0.0 < arguments.speed <= 1000.0:
        raise UserError(f'--speed {arguments.speed:g}: expected more than 0 and at most 1000')
    structure = structure_for(arguments)
    interface = interface_of(structure) if structure is not None else interface_in(arguments)
    bag = read_bag(arguments.file, arguments.namespace, structure) if is_bag(arguments.file) else None
    source = read_input(arguments.file, interface, DEFAULTS['environment.T_E'].default, False, bag)
    heating = arguments.topic or interface.heating_topic
    times, commands = commands_of(source, interface, heating, is_bag(arguments.file))
    try:
        from sma_sim.ros.player import play
    except ImportError as error:
        raise UserError(NO_ROS.format(reason=error)) from error
    progress = ProgressLine(f'playing {arguments.file.name}')
    namespace, follows_clock = arguments.namespace or '', arguments.use_sim_time
    try:
        played = play(times, heating, commands, namespace, arguments.speed, follows_clock, progress)
    finally:
        progress.close()
    if played.stopped_by is None:
        print(f'{arguments.file}: {played.seconds:g} s played, {played.rounds} messages; heating off')
        return 0
    with suppress(OSError):  # the terminal may be closed
        print(
            f'{arguments.file}: stopped by {Signals(played.stopped_by).name} after {played.seconds:.1f} of '
            f'{times[-1] - times[0]:g} s; heating off',
            file=sys.stderr,
        )
    return 128 + played.stopped_by  # as a shell says of a program that a signal ended


def structure_for(arguments: argparse.Namespace) -> Structure | None:
    """The structure that is named."""
    if not (arguments.system or arguments.config or arguments.words):
        return None
    words = [f'system={arguments.system}'] if arguments.system else []
    return config_from(arguments, *words).structure


def interface_in(arguments: argparse.Namespace) -> Interface:
    """The topics of what is commanded, as the file tells."""
    if is_bag(arguments.file):
        return interface_of_robot(arguments.file, arguments.namespace)
    return interface_of_columns(read_header(arguments.file))


def commands_of(source: Input, of: Interface, heating: str, held: bool) -> tuple[Vector, dict[str, Vector]]:
    """Times (k,) [s] at which something changes, and what is sent from each on, by topic; `held`: set points are."""
    times = np.asarray(source.times, float)
    if of.drives and not held:
        times = np.union1d(times, np.arange(times[0], times[-1], 1.0 / SET_POINT_RATE))
    columns = inputs_at(source, times)
    commands = {drive: columns[column] for drive, column in of.drives.items()}
    powers = [columns[name] for name in of.heating_columns]
    commands[heating] = powers[0] if of.heating_topic == PAIR_COMMAND else np.column_stack(powers)
    changes = np.any([np.diff(values.reshape(len(times), -1), axis=0).any(axis=1) for values in commands.values()], axis=0)
    keep = np.unique([0, *(np.flatnonzero(changes) + 1), len(times) - 1])
    return times[keep], {topic: values[keep] for topic, values in commands.items()}
