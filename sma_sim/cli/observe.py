"""`sma-sim observe`: temperatures, fractions and stresses of the wires of a recorded robot, with their uncertainty."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sma_sim.cli.common.commands import add_command, print_notes
from sma_sim.cli.common.config_options import add_config_options, announce_first_compilation, config_from
from sma_sim.cli.common.recording_options import add_reading_options, noise_from, print_written, system_words
from sma_sim.evidence.data.tables import check_writable, write_columns
from sma_sim.evidence.state_estimation.offline import observe_recording
from sma_sim.model.errors import UserError
from sma_sim.report.run_figure import draw_observed
from sma_sim.report.style import save
from sma_sim.solver.first_start import SIMULATION, TANGENTS
from sma_sim.words.repair_notes import grouped_notes
from sma_sim.workflow.data_request import DataRequest


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'observe')
    parser.add_argument('data', type=Path, metavar='BAG', help='a bag, or a CSV file')
    add_reading_options(parser)
    parser.add_argument(
        '--without',
        action='append',
        default=[],
        metavar='CHANNEL',
        help='a channel that the observer is not told of, as T_1',
    )
    parser.add_argument('--out', type=Path, metavar='FILE.csv', help='estimates (default: BAG with _estimated.csv)')
    parser.add_argument('--figure', type=Path, metavar='PICTURE', help='PNG, SVG or PDF (default: that of --out with .png)')
    add_config_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Observe, and write estimates and their figure."""
    data = arguments.data.absolute()
    out = arguments.out or data.with_name(f'{data.stem}_estimated.csv')
    picture = arguments.figure or out.with_suffix('.png')
    for path in (out, picture):
        check_writable(path, [arguments.data])
    config = config_from(arguments, *system_words(arguments))
    request = DataRequest((arguments.data,), (), arguments.map, noise_from(arguments.noise), arguments.namespace)
    dataset = request.read(config)
    print_notes(grouped_notes([dataset]))
    if len(dataset.recordings) != 1:
        raise UserError(f'{arguments.data} has {len(dataset.recordings)} recordings; expected one')
    announce_first_compilation((*SIMULATION, *TANGENTS))
    (recording,) = dataset.recordings
    known = {f'check.noise_{name}': std for name, std in dataset.noise_std.items()}
    columns = observe_recording(recording, config.variant(known), arguments.without)
    write_columns(out, columns)
    save(draw_observed(columns, recording, arguments.data.name), picture)
    print_written(out, picture)
    return 0
