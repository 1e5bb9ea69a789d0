"""`sma-sim fit`: calibrate the model on recordings."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sma_sim.cli.common.commands import add_command
from sma_sim.cli.common.config_options import add_config_options, announce_first_compilation, folders_beside
from sma_sim.cli.common.recording_options import (
    EXIT_INTERRUPTED,
    add_beginning_option,
    add_data_options,
    add_limit_option,
    add_search_options,
    chosen_executor,
    from_curves,
    model_and_recordings,
    print_written,
    provenance_of,
    write_json,
)
from sma_sim.evidence.estimation.calibrate import Calibration, FitOptions, calibrate, limits_from
from sma_sim.evidence.estimation.held_out_prediction import RunFit
from sma_sim.evidence.estimation.recording_differences import BY_NAME, RecordingDifference, with_differences
from sma_sim.evidence.estimation.search_context import iteration_words
from sma_sim.model.errors import UserError
from sma_sim.model.nearest import suggestion
from sma_sim.model.progress import ProgressLine
from sma_sim.model.shown import text_table
from sma_sim.words.fit_remarks import remarks_on
from sma_sim.workflow.fit import reviewed_fit, write_fitted
from sma_sim.workflow.parameter_sheet import check_sheet, write_sheet


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'fit')
    add_data_options(parser)
    add_beginning_option(parser)
    parser.add_argument(
        '--free',
        action='append',
        metavar='NAMES',
        help='parameters to fit, separated by commas (default: those that such data determine, and all of active effects)',
    )
    parser.add_argument(
        '--differ',
        action='append',
        metavar='WHAT',
        help=f'what is another one in each recording, separated by commas: {", ".join(BY_NAME)} (default: nothing)',
    )
    parser.add_argument(
        '--starts', type=int, default=2, metavar='N', help='number of starting points of the optimization (default 2)'
    )
    parser.add_argument('--robust', action='store_true', help="reduce the weight of outliers (Huber's loss)")
    add_search_options(parser, 'seed of the further starting points')
    add_limit_option(parser)
    parser.add_argument(
        '-o', '--out', type=Path, metavar='FILE.yaml', help='parameter file to write, for the node and --config'
    )
    parser.add_argument(
        '--sheet', type=Path, metavar='FILE', help='parameter sheet to write: value, interval, unit (.yaml, .csv or .md)'
    )
    add_config_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fit, predict what was held out, write what was asked for."""
    check_sheet(arguments.sheet)
    differences = [difference_named(name) for name in split_names(arguments.differ) or ()]
    config, fitted, held_out = model_and_recordings(arguments, arguments.out, arguments.sheet)
    fitted, held_out = with_differences(fitted, differences), held_out and with_differences(held_out, differences)
    made = provenance_of(arguments, (arguments.config, config))
    (config,) = from_curves(fitted, config)
    options = FitOptions(
        split_names(arguments.free),
        arguments.model,
        arguments.starts,
        arguments.robust,
        arguments.seed,
        limits=limits_from(arguments.limits),
        material=arguments.material,
    )
    announce_first_compilation()
    progress = ProgressLine('fitting')
    with chosen_executor(arguments) as executor:
        try:
            found = calibrate(fitted, config, options, executor, lambda *state: progress.show(iteration_words(*state)))
        finally:
            progress.close()
        if arguments.out:
            write_fitted(arguments.out, found, folders_beside(arguments, arguments.out))
        if arguments.sheet:
            write_sheet(arguments.sheet, found)
        review = reviewed_fit(found, config, fitted, held_out, executor)
    print(fit_text(found, review.predicted))
    if review.runs:
        print('', *review.runs.sentences, sep='\n')
    if arguments.json:
        write_json(arguments.json, review.as_data())
    if arguments.report:
        review.write_page(arguments.report, made)
    print_written(arguments.out, arguments.report, arguments.json, arguments.sheet)
    return EXIT_INTERRUPTED if found.interrupted else 0


def difference_named(name: str) -> RecordingDifference:
    """What each recording has its own of. Raises UserError for what recordings do not differ in."""
    if name not in BY_NAME:
        raise UserError(f'--differ {name}: expected {", ".join(BY_NAME)}{suggestion(name, BY_NAME)}')
    return BY_NAME[name]


def split_names(words: Sequence[str] | None) -> tuple[str, ...] | None:
    """Names that are joined by commas."""
    if words is None:
        return None
    return tuple(name.strip() for word in words for name in word.split(',') if name.strip())


def fit_text(found: Calibration, predicted: Sequence[RunFit]) -> str:
    """The result for the terminal."""
    lines = [
        f'Fitted the {found.config.simulated_kinetics} model in {found.iterations} iterations ({found.seconds:.1f} s)'
        + ('' if found.converged else ', not converged')
        + (', stopped: the best so far' if found.interrupted else '')
        + '.',
        '',
        found.table(),
        '',
        text_table(('normalized RMSE', *found.channel_errors, 'all'), error_rows(found, predicted)),
    ]
    remarks = remarks_on(found)
    return '\n'.join([*lines, *([''] if remarks else []), *remarks])


def error_rows(found: Calibration, predicted: Sequence[RunFit]) -> list[tuple[str, ...]]:
    """Errors of every run by channel, those held out last."""

    def row(name: str, channels: Mapping[str, float], error: float) -> tuple[str, ...]:
        return (name, *(f'{channels[c]:.3f}' if c in channels else '' for c in found.channel_errors), f'{error:.3f}')

    rows = [row(fit.name, fit.channel_errors, fit.error) for fit in found.runs]
    rows.append(row('fitted runs', found.channel_errors, found.error))
    return rows + [row(f'{fit.name} (held out)', fit.channel_errors, fit.error) for fit in predicted]
