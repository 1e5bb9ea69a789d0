"""`sma-sim diagnose`: which physical effect the model lacks."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sma_sim.cli.data import add_data_options, check_outputs, chosen_executor, read_data, system_words, write_json
from sma_sim.cli.fit import STOPPED
from sma_sim.cli.options import add_config_options, announce_compilation, config_from, folders_beside
from sma_sim.evidence.design.offer import confounded
from sma_sim.evidence.diagnose import Diagnosis, Request, diagnose, some_held_out
from sma_sim.evidence.tables import write_whole
from sma_sim.evidence.verdict import as_data, as_text
from sma_sim.model.config import effect_folders_of
from sma_sim.model.parameter_file import parameter_file
from sma_sim.report.html.diagnosis_page import write_diagnosis_page


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser: argparse.ArgumentParser = verbs.add_parser('diagnose', help='find the physical effect that the model lacks')
    add_data_options(parser)
    parser.add_argument('--model', choices=('hybrid', 'mas', 'auto'), default='auto', help='auto: the better of both')
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='of the tests by chance')
    parser.add_argument(
        '-o', '--out', type=Path, metavar='FILE.yaml', help='parameter file of the improved model, for the node and --config'
    )
    add_config_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Diagnose, and write what was asked for."""
    check_outputs(arguments, arguments.out)
    config = config_from(arguments, *system_words(arguments))
    training, held = read_data(arguments, config)
    folders = tuple(effect_folders_of(arguments.config, arguments.words))
    announce_compilation()
    with chosen_executor(arguments) as executor:
        request = Request(arguments.model, folders, arguments.seed)
        found = diagnose(training, config, held, request, executor, tell)
    if arguments.out:
        write_improved(arguments, found)
    rivals = confounded(found)
    command = next_command(arguments, rivals) if rivals else ''
    if arguments.json:
        offered = {'next': {'between': list(rivals), 'command': command}} if rivals else {}
        write_json(arguments.json, as_data(found) | offered)
    if arguments.report:
        write_diagnosis_page(arguments.report, found, *some_held_out(training, held), command)
    print(*as_text(found), sep='\n')
    if command:
        print(f'to find the experiment that tells {" from ".join(rivals)}: {command}')
    for path in (arguments.out, arguments.report, arguments.json):
        if path:
            print(path)
    return STOPPED if found.interrupted else 0


def tell(words: str) -> None:
    """Say what is being done."""
    print(f'  {words}', file=sys.stderr, flush=True)


def next_command(arguments: argparse.Namespace, rivals: Sequence[str]) -> str:
    """The command that designs an experiment between these explanations, on the same data and model."""
    words = ['sma-sim', 'next', *map(str, arguments.data)]
    for option, values in (
        ('--between', rivals), ('--config', arguments.config), ('--map', arguments.map), ('--system', arguments.system),
    ):  # fmt: skip
        if values:
            words += [option, *([str(values)] if isinstance(values, str | Path) else values)]
    for option, given in (('--set', arguments.words), ('--effect', arguments.effects), ('--noise', arguments.noise)):
        words += [word for value in given for word in (option, value)]
    return shlex.join([*words, '-o', 'next.csv'])


def write_improved(arguments: argparse.Namespace, found: Diagnosis) -> None:
    """Write the parameter file of the last step, with a line on where it comes from."""
    effects = ' and '.join(found.effects) or 'no effect'
    origin = f'# Diagnosed by sma-sim diagnose from {", ".join(found.training)}: {found.verdict}, {effects} added.\n'
    text = origin + parameter_file(found.calibration.config, folders_beside(arguments, arguments.out))
    write_whole(arguments.out, lambda file: file.write(text))
