"""`sma-sim simulate`: run the model under an input file."""

from __future__ import annotations

import argparse
import os
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

from sma_sim.cli.common.commands import add_command, add_kinetics, print_notes
from sma_sim.cli.common.config_options import add_config_options, add_namespace_option, announce_first_compilation
from sma_sim.cli.common.input_files import read_input_file
from sma_sim.cli.common.recorded_parameters import config_for_replay
from sma_sim.evidence.data.rosbag.bag_files import is_bag
from sma_sim.evidence.data.tables import check_writable, write_columns, write_rows
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import PhysicsWarning, UserError
from sma_sim.model.progress import ProgressLine
from sma_sim.solver.fixed_rate import simulate_fixed_rate, steps_per_sample
from sma_sim.solver.inputs import Input, inputs_at, regular_times
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import Trajectory, simulate, uninterrupted

MAX_RUN_SAMPLES = 50_000_000
JUMP_COLUMNS = ('t', 'j', 'wire', 'guard', 'from', 'to')


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'simulate')
    parser.add_argument(
        '--input',
        type=Path,
        required=True,
        help='CSV file with time_s and the input of the system (such as J_eq_W), or a bag',
    )
    parser.add_argument(
        '--out', type=Path, required=True, help='CSV file to write, or an mcap file where the name ends in .mcap'
    )
    parser.add_argument('--rate', type=float, default=100.0, help='samples per second (default 100)')
    add_kinetics(parser, ('hybrid', 'mas'), 'those of the configuration, else hybrid')
    parser.add_argument('--system', metavar='NAME', help='structure to simulate; sma-sim systems lists them')
    parser.add_argument(
        '--interpolation',
        choices=('hold', 'linear'),
        default='hold',
        help='how J_eq or J_W goes from row to row (default hold)',
    )
    parser.add_argument('--integration-rate', type=float, metavar='HZ', help='integrate in fixed steps, as the node does')
    parser.add_argument(
        '--jumps', type=Path, metavar='FILE', help='CSV file to write with the mode changes of the hybrid model'
    )
    parser.add_argument('--resistance', action='store_true', help='also write the electrical resistance of every wire [ohm]')
    add_namespace_option(parser)
    add_config_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Simulate and write the samples."""
    chosen = [f'{name}={getattr(arguments, name)}' for name in ('model', 'system') if getattr(arguments, name)]
    config = config_for_replay(arguments, arguments.input, *chosen)
    check_rates(arguments, config)
    check_writable(arguments.out, [arguments.input])
    if arguments.jumps:
        check_writable(arguments.jumps, [arguments.input])
        if os.path.abspath(arguments.jumps) == os.path.abspath(arguments.out):
            raise UserError(f'--out and --jumps are both {arguments.out}: give two files')
    source = read_input_file(arguments.input, config, arguments.interpolation == 'linear', arguments.namespace)
    announce_first_compilation()
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', PhysicsWarning)  # it is among the notes
        trajectory = run_model(Model(config), source, arguments)
    print_notes(trajectory.notes)
    imposed = inputs_at(source, trajectory.time)  # a temperature that is imposed stays what it is, to the last bit
    columns = imposed | {name: values for name, values in trajectory.columns.items() if name not in imposed}
    if arguments.resistance:
        columns |= trajectory.resistances
    if arguments.out.suffix == '.mcap':
        from sma_sim.evidence.data.rosbag.run_writer import write_mcap  # only here: it takes long to import

        write_mcap(arguments.out, columns, config.structure)
    else:
        write_columns(arguments.out, columns)
    if arguments.jumps:
        rows = [(repr(jump.t), jump.j, jump.wire, jump.guard, jump.source, jump.target) for jump in trajectory.jumps]
        write_rows(arguments.jumps, JUMP_COLUMNS, rows)
    print(
        f'Simulated {trajectory.end:g} s in {trajectory.steps} steps with {len(trajectory.jumps)} mode changes; '
        f'{len(trajectory.time)} samples are in {arguments.out}.'
    )
    if not uninterrupted(trajectory).completed:
        raise UserError(f'the run ended at {trajectory.end:g} s: {trajectory.reason}')
    return 0


def check_rates(arguments: argparse.Namespace, config: Config) -> None:
    """Raise UserError for rates that make no sense, alone or together."""
    rate, steps = arguments.rate, arguments.integration_rate
    if not 0.0 < rate <= 1e6:
        raise UserError(f'--rate {rate:g}: expected more than 0 and at most 1e6 samples per second')
    if steps is None:
        return
    if not 1.0 <= steps <= 1e5:
        raise UserError(f'--integration-rate {steps:g}: expected 1 to 1e5 steps per second')
    if arguments.interpolation == 'linear':
        raise UserError('--integration-rate needs --interpolation hold: the node holds its command')
    drives = config.structure.drives
    if drives and not is_bag(arguments.input):
        raise UserError(
            f'--integration-rate with a CSV file: {drives[0].name} is linear between the rows of a file, but the node takes '
            f'set points; expected a bag, got {arguments.input}'
        )
    steps_per_sample(steps, rate)


def run_model(model: Model, source: Input, arguments: argparse.Namespace) -> Trajectory:
    """The adaptive run, or the one in fixed steps."""
    progress = ProgressLine('simulating')
    try:
        if arguments.integration_rate is None:
            return simulate(model, source, sample_times(source, arguments.rate), progress=progress)
        source = replace(source, linear=(False,) * len(source.linear))
        return simulate_fixed_rate(model, source, arguments.integration_rate, arguments.rate, progress)
    finally:
        progress.close()


def sample_times(source: Input, rate: float) -> Vector:
    """Times at `rate` from the first to the last of the input."""
    duration = source.times[-1] - source.times[0]
    count = duration * rate
    if count > MAX_RUN_SAMPLES:
        raise UserError(
            f'--rate {rate:g} over {duration:g} s makes {count:.3g} samples; '
            f'expected at most {MAX_RUN_SAMPLES:.0e}: lower --rate'
        )
    return regular_times(source, rate)
