"""`sma-sim plot`: draw a run."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sma_sim.cli.common.commands import add_command
from sma_sim.cli.common.config_options import add_namespace_option
from sma_sim.evidence.data.rosbag.bag_files import is_bag
from sma_sim.evidence.data.tables import check_writable, read_columns, read_header
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.report.run_figure import draw_run
from sma_sim.report.run_panels import is_drawn, is_held
from sma_sim.report.style import save


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'plot')
    parser.add_argument('file', type=Path, metavar='FILE', help='CSV of a run, or a bag')
    add_namespace_option(parser)
    parser.add_argument('--out', type=Path, metavar='PICTURE', help='PNG, SVG or PDF to write (default: FILE with .png)')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Draw the columns that are known."""
    if is_bag(arguments.file):
        from sma_sim.evidence.data.rosbag.reader import read_bag  # only here: tables need no library of bags

        columns = read_bag(arguments.file, arguments.namespace)
    else:
        columns = read_table(arguments.file)
    out = arguments.out or arguments.file.absolute().with_suffix('.png')
    check_writable(out)
    try:
        figure = draw_run(columns, arguments.file.name)
    except UserError as error:
        raise UserError(f'{arguments.file}: {error}') from error
    save(figure, out)
    print(out)
    return 0


def read_table(path: Path) -> dict[str, Vector]:
    """The columns of a CSV file that can be drawn."""
    header = read_header(path)
    known = [name for name in dict.fromkeys(header) if is_drawn(name)]
    measured = [name for name in known if not is_held(name)]
    return read_columns(path, ('time_s',), [name for name in known if is_held(name)], measured)
