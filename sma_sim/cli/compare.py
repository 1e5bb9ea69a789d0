"""`sma-sim compare`: put the model, as it is, beside recordings."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sma_sim.cli.common.commands import add_command, add_kinetics
from sma_sim.cli.common.config_options import add_overriding_options, announce_first_compilation, noted
from sma_sim.cli.common.recording_options import (
    add_beginning_option,
    add_data_options,
    check_outputs,
    chosen_executor,
    from_curves,
    print_written,
    provenance_of,
    read_data,
    system_words,
    write_json,
)
from sma_sim.evidence.residual_analysis.compare import compare
from sma_sim.evidence.residual_analysis.metrics import total_error
from sma_sim.evidence.residual_analysis.paired_comparison import ErrorChange, error_changes
from sma_sim.evidence.residual_analysis.summary import Summary, summarize
from sma_sim.model.config import Config, read_config
from sma_sim.model.errors import UserError
from sma_sim.model.shown import text_table
from sma_sim.report.html.comparison_page import write_compare_page
from sma_sim.words.comparison import SCORE_HEADER, channel_row, comparison_result, score_groups, spread_sentence

PAPER_LABEL, DEFAULT_LABEL = "the paper's values", 'the default values'
OF_THE_PAPER = ('module', 'wire')
MAX_LINES = 8  # of findings on the terminal; the report has all
COLUMNS = 6  # of the scores that the terminal has room for


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'compare')
    add_data_options(parser)
    add_beginning_option(parser)
    parser.add_argument(
        '--config',
        action='append',
        type=Path,
        default=[],
        metavar='FILE',
        dest='configs',
        help='YAML parameter file (default: the paper\'s values); give it twice to compare two models',
    )
    add_kinetics(parser, ('hybrid', 'mas'), 'those of the configuration')
    parser.add_argument('--no-nuisance', action='store_true', help='estimate neither the delay nor the initial states')
    add_overriding_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Compare, print, write what was asked for."""
    check_outputs(arguments)
    if len(arguments.configs) > 2:
        raise UserError(f'--config was given {len(arguments.configs)} times: expected one file, or two to put side by side')
    named = configurations(arguments)
    systems = {config.system for _, config in named}
    if len(systems) > 1:
        first, second = sorted(systems)
        raise UserError(f'one configuration is of system {first}, the other of {second}: expected two of the same system')
    fitted, held_out = read_data(arguments, named[0][1])
    labels, configs = zip(*named, strict=True)
    made = provenance_of(arguments, *zip(arguments.configs or [None], configs, strict=True))
    named = list(zip(labels, from_curves(fitted, *configs, is_fitted=False), strict=True))
    announce_first_compilation()
    with chosen_executor(arguments) as executor:
        found = [compare(fitted, config, held_out, label, not arguments.no_nuisance, executor) for label, config in named]
    summaries = [summarize(comparison) for comparison in found]
    pairs = error_changes(found[0], found[1]) if len(found) == 2 else ()
    print(compare_text(summaries, pairs))
    if arguments.json:
        write_json(arguments.json, comparison_result(summaries, pairs, fitted.noise_std))
    if arguments.report:
        write_compare_page(arguments.report, summaries, pairs, (fitted, held_out), made)
    print_written(arguments.report, arguments.json)
    return 0


def configurations(arguments: argparse.Namespace) -> list[tuple[str, Config]]:
    """The configurations with their names. Raises UserError."""
    words = [*arguments.words, *system_words(arguments), *([f'model={arguments.model}'] if arguments.model else [])]
    paths: list[Path | None] = [*arguments.configs] or [None]
    configs = [noted(read_config(path, words, arguments.effects)) for path in paths]
    labels = [PAPER_LABEL if config.system in OF_THE_PAPER else DEFAULT_LABEL for config in configs]
    return [(str(path or label), config) for path, label, config in zip(paths, labels, configs, strict=True)]


def compare_text(summaries: Sequence[Summary], pairs: Sequence[ErrorChange]) -> str:
    """The result for the terminal."""
    lines = []
    for summary in summaries:
        comparison = summary.comparison
        name, delay = f'{comparison.label} ({comparison.config.simulated_kinetics} model)', 1e3 * comparison.delay
        lines += [
            f'Compared {name} with the recordings; delay {delay:.3g} ms.',
            '',
            text_table(SCORE_HEADER[:COLUMNS], channel_rows(summary)),
            '',
            *finding_lines(summary),
            '',
        ]
    return '\n'.join([*lines, *(change.text for change in pairs)]).rstrip()


def channel_rows(summary: Summary) -> list[tuple[str, ...]]:
    """A row per channel and kind of run, the totals last."""
    rows = []
    for kind, part in score_groups(summary):
        rows += [channel_row(kind, score)[:COLUMNS] for score in part]
        rows.append(('all', kind, '', '', f'{total_error(part):.3f}', ''))
    return rows


def finding_lines(summary: Summary) -> list[str]:
    """Where the error is, in words."""
    remarks = summary.remarks[:MAX_LINES]
    if not remarks:
        return [spread_sentence(summary)]
    return ['Where the error is:', *(f'{k:2}. {remark.text}' for k, remark in enumerate(remarks, 1))]
