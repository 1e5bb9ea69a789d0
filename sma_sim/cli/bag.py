"""`sma-sim bag`: what is in a bag, a whole bag from a broken one, CSV from a bag and back."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from sma_sim.cli.common.commands import add_command
from sma_sim.cli.common.config_options import add_namespace_option
from sma_sim.cli.common.recorded_parameters import recorded_parameters
from sma_sim.evidence.data.rosbag.bag_files import is_bag
from sma_sim.evidence.data.rosbag.reader import read_bag
from sma_sim.evidence.data.rosbag.run_writer import interface_of_columns, write_mcap
from sma_sim.evidence.data.rosbag.salvage import open_bag, repair
from sma_sim.evidence.data.tables import check_writable, read_columns, read_header, write_columns
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError


def add_parser(verbs: Any) -> None:
    """Declare the verb and its own verbs."""
    parser = add_command(verbs, 'bag')
    own = parser.add_subparsers(dest='bag_verb', required=True)
    info = add_command(own, 'info', 'print topics, counts, duration and parameters')
    info.add_argument('bag', type=Path, metavar='BAG')
    info.set_defaults(run=show_info)
    repairing = add_command(
        own, 'repair', 'write the readable messages of a damaged bag (killed recorder, full disk) to a new one'
    )
    repairing.add_argument('bag', type=Path, metavar='BAG')
    repairing.add_argument('--out', type=Path, metavar='NEW', help='folder of the new bag (default: BAG_repaired)')
    repairing.set_defaults(run=repair_bag)
    convert = add_command(own, 'convert', 'convert a bag to CSV, or a CSV file to mcap')
    convert.add_argument('source', type=Path, metavar='FROM', help='bag, or CSV file of a run')
    convert.add_argument('target', type=Path, metavar='TO', help='file to write; its name ends in .csv or .mcap')
    add_namespace_option(convert)
    convert.set_defaults(run=convert_bag)


def show_info(arguments: argparse.Namespace) -> int:
    """Print what is in a bag."""
    bag = open_bag(arguments.bag)
    topics = bag.topics()
    first, last = None, 0
    for message in bag.messages():
        first = message.log_time if first is None else min(first, message.log_time)
        last = max(last, message.log_time)
    duration = (last - first) / 1e9 if first is not None else 0.0
    state = 'whole' if bag.whole else f'damaged; `sma-sim bag repair {arguments.bag}` writes what is readable to a new bag'
    print(f'{arguments.bag}: {sum(count for _, count in topics.values())} messages, {duration:.3f} s, {state}')
    for name, (kind, count) in sorted(topics.items()):
        print(f'  {name:<28} {kind:<36} {count}')
    parameters = recorded_parameters(bag)
    if parameters is not None:
        effects = ', '.join(map(str, parameters.get('effects.active') or ['none']))
        system = parameters.get('system', 'module')
        of = '' if system == 'module' else f' of system {system}'
        rate = bag.about.get('integration_rate', 'unknown').removesuffix('.0')
        print(f'recorded by sma_module_sim: {parameters.get("model")} model{of}, effects {effects}, {rate} steps/s')
    return 0


def repair_bag(arguments: argparse.Namespace) -> int:
    """Write what can be read as a new bag."""
    path = arguments.bag
    out = arguments.out or path.with_name(f'{path.stem if path.is_file() else path.name}_repaired')
    count = repair(path, out)
    print(f'Wrote {count} messages to {out}.')
    return 0


def read_run(source: Path) -> dict[str, Vector]:
    """The columns of a CSV file that a bag can hold. Raises UserError."""
    header = read_header(source)
    of = interface_of_columns(header)
    needed = ('time_s', *(of.drives.values() or of.heating_columns))
    others = [name for name in of.columns if name in header and name not in (*needed, 'T_E_K')]
    return read_columns(source, needed, ('T_E_K',), others)


def convert_bag(arguments: argparse.Namespace) -> int:
    """Write a run in another format."""
    source, target = arguments.source, arguments.target
    check_writable(target)
    if target.suffix == '.csv':
        notes: list[str] = []
        write_columns(target, read_bag(source, arguments.namespace, notes=notes, one_run=False))
        for note in notes:
            print(f'note: {source}: {note}', file=sys.stderr)
    elif target.suffix == '.mcap':
        if is_bag(source):
            raise UserError(
                f'{source} is a bag: expected a CSV file to write {target}; `sma-sim bag repair {source}` writes another '
                'bag, and a name that ends in .csv its columns'
            )
        write_mcap(target, read_run(source))
    else:
        raise UserError(f'{target}: expected a name that ends in .csv or .mcap')
    print(target)
    return 0
