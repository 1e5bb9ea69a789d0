"""`sma-sim play`: send a recorded command to a node or a robot."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from sma_sim.cli.common.commands import add_command
from sma_sim.cli.common.input_files import read_input_file
from sma_sim.cli.common.options import ProgressLine, add_namespace_option
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.ros.entry import NO_ROS


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'play', 'send the commands of a CSV file or a bag to J_eq, in time')
    parser.add_argument('file', type=Path, metavar='FILE', help='CSV file with time_s and J_eq_W, or a bag')
    parser.add_argument('--topic', default='J_eq', help='topic to publish on (default J_eq)')
    parser.add_argument('--speed', type=float, default=1.0, help='factor of time: 2 plays twice as fast (default 1)')
    add_namespace_option(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Read the command and send it."""
    if not 0.0 < arguments.speed <= 1000.0:
        raise UserError(f'--speed {arguments.speed:g}: expected more than 0 and at most 1000')
    source = read_input_file(arguments.file, Config(), False, arguments.namespace)
    times, J_eq = source.times, source.values[:, 0]
    last = np.append(np.flatnonzero(np.diff(J_eq)) + 1, len(times) - 1)
    keep = np.unique(np.append(0, last))
    try:
        from sma_sim.ros.player import play
    except ImportError as error:
        raise UserError(NO_ROS.format(reason=error)) from error
    progress = ProgressLine(f'playing {arguments.file.name}')
    try:
        sent = play(times[keep], J_eq[keep], arguments.topic, arguments.namespace or '', arguments.speed, progress)
    finally:
        progress.close()
    print(f'{arguments.file}: {times[-1] - times[0]:g} s played, {sent} messages; heating off')
    return 0
