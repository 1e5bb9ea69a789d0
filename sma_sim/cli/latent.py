"""`sma-sim latent`: which unknown force, heat, strain or offset would make the model meet the measurement."""

from __future__ import annotations

import argparse
from typing import Any

from sma_sim.cli.common.commands import add_command
from sma_sim.cli.common.config_options import add_config_options, announce_first_compilation
from sma_sim.cli.common.recording_options import (
    EXIT_INTERRUPTED,
    add_beginning_option,
    add_data_options,
    add_search_options,
    chosen_executor,
    model_and_recordings,
    print_progress,
    print_written,
    provenance_of,
    report_path,
    write_json,
)
from sma_sim.evidence.data.train_test_split import hold_out_last
from sma_sim.evidence.latent_input.latent_search import LatentRequest, estimate_latent_inputs
from sma_sim.model.errors import UserError
from sma_sim.model.shown import text_table
from sma_sim.report.html.latent_page import write_latent_page
from sma_sim.words.latent_input import RANKING_HEADER, latent_data, ranking_rows, verdict_sentences


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'latent')
    add_data_options(parser)
    add_beginning_option(parser)
    parser.add_argument('-o', dest='page', metavar='FILE.html', help='the same as --report', type=report_path)
    parser.add_argument(
        '--no-fit', action='store_true', help='take --config as calibrated: only the initial states and the delay are fitted'
    )
    add_search_options(parser, 'seed of the significance tests')
    add_config_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Estimate, and write what was asked for."""
    if arguments.page and arguments.report:
        raise UserError(f'-o {arguments.page} and --report {arguments.report} are the same page: expected one of them')
    arguments.report = arguments.report or arguments.page
    config, training, held_out = model_and_recordings(arguments)
    announce_first_compilation()
    with chosen_executor(arguments) as executor:
        request = LatentRequest(arguments.model, not arguments.no_fit, arguments.seed)
        found = estimate_latent_inputs(training, config, held_out, request, executor, print_progress)
    if arguments.json:
        write_json(arguments.json, latent_data(found))
    if arguments.report:
        made = provenance_of(arguments, (arguments.config, config))
        write_latent_page(arguments.report, found, *hold_out_last(training, held_out), made)
    print(*verdict_sentences(found), sep='\n')
    if found.findings:
        print(text_table(RANKING_HEADER, ranking_rows(found)))
    print_written(arguments.report, arguments.json)
    return EXIT_INTERRUPTED if found.interrupted else 0
