"""`sma-sim diagnose`: which physical effect the model lacks."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sma_sim.cli.common.commands import add_command
from sma_sim.cli.common.config_options import add_config_options, announce_first_compilation, folders_beside
from sma_sim.cli.common.recording_options import (
    EXIT_INTERRUPTED,
    add_data_options,
    add_limit_option,
    add_search_options,
    chosen_executor,
    model_and_recordings,
    print_curves,
    print_progress,
    print_written,
    provenance_of,
    write_json,
)
from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.diagnosis.diagnose import Diagnosis, diagnose
from sma_sim.evidence.diagnosis.review import reviewed
from sma_sim.evidence.estimation.calibrate import FitOptions, limits_from
from sma_sim.evidence.estimation.interruption import stoppable
from sma_sim.evidence.model_selection.nominal_fit import NOMINAL_STARTS, DiagnosisRequest
from sma_sim.model.config import Config
from sma_sim.model.given import effect_folders_of
from sma_sim.report.html.diagnosis_page import write_diagnosis_page
from sma_sim.words.diagnosis_data import as_data
from sma_sim.words.diagnosis_text import as_text
from sma_sim.workflow.diagnosis import command_between, confounded, write_improved


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'diagnose')
    add_data_options(parser)
    add_search_options(parser, 'seed of the significance tests')
    add_limit_option(parser)
    parser.add_argument(
        '-o', '--out', type=Path, metavar='FILE.yaml', help='parameter file of the improved model, for the node and --config'
    )
    parser.add_argument(
        '--no-equation', action='store_true', help='do not search for an equation where no known effect explains the error'
    )
    parser.add_argument(
        '--no-variants',
        action='store_true',
        help='do not try effects in one wire, coordinate or channel only, or shared by the wires, where they leave much',
    )
    add_config_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Diagnose, and write what was asked for."""
    given, training, held_out = model_and_recordings(arguments, arguments.out)
    print_curves(training)
    folders = tuple(effect_folders_of(arguments.config, arguments.words))
    announce_first_compilation()
    options = FitOptions(starts=NOMINAL_STARTS, limits=limits_from(arguments.limits), material=arguments.material)
    request = DiagnosisRequest(
        arguments.model, folders, arguments.seed, options, not arguments.no_equation, not arguments.no_variants
    )
    with stoppable():  # also while files are written: the steps so far are to be in all of them
        with chosen_executor(arguments) as executor:
            found = diagnose(training, given, held_out, request, executor, print_progress)
        print(*as_text(found), sep='\n', flush=True)  # first: a disk may be full
        written = write_outputs(arguments, found, given, training, held_out)
    print_written(arguments.out, written, arguments.report, arguments.json)
    return EXIT_INTERRUPTED if found.interrupted else 0


def write_outputs(
    arguments: argparse.Namespace, found: Diagnosis, given: Config, training: Dataset, held_out: Dataset | None
) -> Path | None:
    """Write the files that were asked for; returns that of a proposed effect. `given`: the model. Raises UserError."""
    written = None
    if arguments.out:
        written = write_improved(arguments.out, found, folders_beside(arguments, arguments.out))
    rivals = confounded(found)
    command = next_command(arguments, rivals, found) if rivals else ''
    if arguments.json:
        offered = {'next': {'between': list(rivals), 'command': command}} if rivals else {}
        write_json(arguments.json, as_data(found, written) | offered)
    if arguments.report:
        made = provenance_of(arguments, (arguments.config, given))
        write_diagnosis_page(arguments.report, reviewed(found, training, held_out, given), command, made)
    if command:
        print(f'To design the experiment that separates {" and ".join(rivals)}: {command}')
    return written


def next_command(arguments: argparse.Namespace, rivals: Sequence[str], found: Diagnosis) -> str:
    """The command that designs an experiment between these explanations, on the same data and model."""
    given = [*(['--config', str(arguments.config)] if arguments.config else [])]
    given += [*(['--map', str(arguments.map)] if arguments.map else [])]
    given += [*(['--system', arguments.system] if arguments.system else [])]
    for option, values in (('--set', arguments.words), ('--effect', arguments.effects), ('--noise', arguments.noise)):
        given += [word for value in values for word in (option, value)]
    return command_between(rivals, arguments.data, given, found)
