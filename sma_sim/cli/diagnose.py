"""`sma-sim diagnose`: which physical effect the model lacks."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sma_sim.cli.common.commands import add_command
from sma_sim.cli.common.data import (
    EXIT_INTERRUPTED,
    add_data_options,
    add_search_options,
    check_outputs,
    chosen_executor,
    from_curves,
    print_progress,
    print_written,
    read_data,
    system_words,
    write_json,
)
from sma_sim.cli.common.options import add_config_options, announce_first_compilation, config_from, folders_beside
from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.tables import write_whole
from sma_sim.evidence.data.train_test_split import hold_out_last
from sma_sim.evidence.diagnosis.diagnose import Diagnosis, diagnose
from sma_sim.evidence.diagnosis.follow_up import confounded
from sma_sim.evidence.diagnosis.proposed_equation import effect_values
from sma_sim.evidence.diagnosis.review import reviewed
from sma_sim.evidence.diagnosis.verdict import as_data
from sma_sim.evidence.diagnosis.verdict_text import as_text
from sma_sim.evidence.estimation.interruption import stoppable
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.model.given import effect_folders_of
from sma_sim.model.parameter_file import parameter_file
from sma_sim.report.html.diagnosis_page import write_diagnosis_page


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'diagnose', 'find the physical effect that the model lacks')
    add_data_options(parser)
    add_search_options(parser, 'seed of the significance tests')
    parser.add_argument(
        '-o', '--out', type=Path, metavar='FILE.yaml', help='parameter file of the improved model, for the node and --config'
    )
    parser.add_argument(
        '--no-equation', action='store_true', help='do not search for an equation where no known effect explains the error'
    )
    parser.add_argument(
        '--no-variants', action='store_true',
        help='do not try effects in one wire, coordinate or channel only, or shared by the wires, where they leave much',
    )  # fmt: skip
    add_config_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Diagnose, and write what was asked for."""
    check_outputs(arguments, arguments.out)
    config = config_from(arguments, *system_words(arguments))
    training, held_out = read_data(arguments, config)
    (config,) = from_curves(training, config)
    folders = tuple(effect_folders_of(arguments.config, arguments.words))
    announce_first_compilation()
    request = DiagnosisRequest(
        arguments.model, folders, arguments.seed, equation=not arguments.no_equation, variants=not arguments.no_variants
    )
    with stoppable():  # also while files are written: the steps so far are to be in all of them
        with chosen_executor(arguments) as executor:
            found = diagnose(training, config, held_out, request, executor, print_progress)
        print(*as_text(found), sep='\n', flush=True)  # first: a disk may be full
        written = write_outputs(arguments, found, *hold_out_last(training, held_out))
    print_written(arguments.out, written, arguments.report, arguments.json)
    return EXIT_INTERRUPTED if found.interrupted else 0


def write_outputs(
    arguments: argparse.Namespace, found: Diagnosis, training: Dataset, held_out: Dataset | None
) -> Path | None:
    """Write the files that were asked for; returns that of a proposed effect. Raises UserError."""
    written = write_improved(arguments, found) if arguments.out else None
    rivals = confounded(found)
    command = next_command(arguments, rivals) if rivals else ''
    if arguments.json:
        offered = {'next': {'between': list(rivals), 'command': command}} if rivals else {}
        write_json(arguments.json, as_data(found, written) | offered)
    if arguments.report:
        write_diagnosis_page(arguments.report, reviewed(found, training, held_out), command)
    if command:
        print(f'To design the experiment that separates {" and ".join(rivals)}: {command}')
    return written


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


def write_improved(arguments: argparse.Namespace, found: Diagnosis) -> Path | None:
    """Write the parameter file of the last step, with a line on where it comes from.

    A proposed effect is written to a folder beside it, which it names; returns that file.
    """
    folders, names, written = folders_beside(arguments, arguments.out), list(found.effects), None
    source = f'sma-sim diagnose from {", ".join(found.training)}'
    if found.proposal:
        folder = arguments.out.with_name(f'{arguments.out.stem}_effects')
        note = f'proposed by {source}: a formula that fits, no known law'
        written = found.proposal.write(folder, effect_values(found), note)
        folders, names = [*folders, folder.name], list(found.stages[-1].effects)
    origin = f'# Diagnosed by {source}: {" and ".join(names) or "no effect"} added.\n'
    text = origin + parameter_file(found.calibration.config, folders)
    write_whole(arguments.out, lambda file: file.write(text))
    return written
