"""`sma-sim compare`: put the model, as it is, beside recordings."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sma_sim.cli.common.data import (
    add_data_options,
    check_outputs,
    chosen_executor,
    read_data,
    system_words,
    table_text,
    tell_written,
    write_json,
)
from sma_sim.cli.common.options import add_overriding_options, announce_compilation
from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.residual_analysis.compare import compare
from sma_sim.evidence.residual_analysis.metrics import ChannelScore, total_error
from sma_sim.evidence.residual_analysis.paired_comparison import ErrorChange, error_changes
from sma_sim.evidence.residual_analysis.summary import Summary, as_data, summarize
from sma_sim.model.config import Config, read_config
from sma_sim.model.errors import UserError
from sma_sim.report.html.comparison_page import write_compare_page

DEFAULTS = "the paper's values"
MOST_TOLD = 8  # findings on the terminal


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser: argparse.ArgumentParser = verbs.add_parser('compare', help='put the model beside recordings: where it fails')
    add_data_options(parser)
    parser.add_argument(
        '--config', action='append', type=Path, default=[], metavar='FILE', dest='configs',
        help='YAML parameter file; twice: two side by side (default: the paper\'s values)',
    )  # fmt: skip
    parser.add_argument('--model', choices=('hybrid', 'mas'), help='default: as the configuration says')
    parser.add_argument('--no-nuisance', action='store_true', help='estimate neither delay nor starts')
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
        raise UserError('one configuration is of a module, the other of a wire: expected two of the same system')
    fitted, held = read_data(arguments, named[0][1])
    announce_compilation()
    with chosen_executor(arguments) as executor:
        found = [compare(fitted, config, held, label, not arguments.no_nuisance, executor) for label, config in named]
    summaries = [summarize(one) for one in found]
    pairs = error_changes(found[0], found[1]) if len(found) == 2 else ()
    print(compare_text(summaries, pairs))
    if arguments.json:
        write_json(arguments.json, {
            'comparisons': [as_data(one) for one in summaries],
            'changes': [vars(one) for one in pairs], 'noise_std': fitted.noise_std,
        })  # fmt: skip
    if arguments.report:
        write_compare_page(arguments.report, summaries, pairs, (fitted, held))
    tell_written(arguments.report, arguments.json)
    return 0


def configurations(arguments: argparse.Namespace) -> list[tuple[str, Config]]:
    """The configurations with their names. Raises UserError."""
    words = [*arguments.words, *system_words(arguments), *([f'model={arguments.model}'] if arguments.model else [])]
    paths: list[Path | None] = [*arguments.configs] or [None]
    return [(str(path or DEFAULTS), read_config(path, words, arguments.effects)) for path in paths]


def compare_text(summaries: Sequence[Summary], pairs: Sequence[ErrorChange]) -> str:
    """The result for the terminal."""
    lines = []
    for one in summaries:
        comparison = one.comparison
        lines += [f'{comparison.label}, {comparison.config.model} model, delay {1e3 * comparison.delay:.3g} ms', '',
                  table_text(HEADER, score_rows(one)), '', *told(one), '']  # fmt: skip
    return '\n'.join([*lines, *(one.text for one in pairs)]).rstrip()


HEADER = ('channel', 'runs', 'RMSE', 'of range', 'over noise', 'whiteness p')


def score_rows(summary: Summary) -> list[tuple[str, ...]]:
    """A row per channel and kind of run, the totals last."""
    rows = []
    for kind, part in kinds(summary):
        rows += [score_row(kind, one) for one in part]
        rows.append(('all', kind, '', '', f'{total_error(part):.3f}', ''))
    return rows


def kinds(summary: Summary) -> list[tuple[str, list[ChannelScore]]]:
    """Scores of fitted runs and of those held out, where there are any."""
    held = list(summary.held_out.values())
    first = ('fitted' if held else 'all', list(summary.fitted.values()))
    return [first, ('held out', held)] if held else [first]


def score_row(kind: str, one: ChannelScore) -> tuple[str, ...]:
    """One channel."""
    return (
        one.channel, kind, in_display_unit(one.channel, one.rmse), f'{100.0 * one.share:.2f} %', f'{one.over_noise:.3f}',
        f'{one.whiteness.p:.2g}' if one.whiteness.p >= 1e-16 else '<1e-16',
    )  # fmt: skip


def told(summary: Summary) -> list[str]:
    """Where the error is, in words."""
    words = [*(one.text for one in summary.patterns), *(one.text for one in summary.findings)]
    if not words:
        return ['The error is spread evenly, or is no more than noise.']
    return ['Where the error is:', *(f'{k + 1:2}. {text}' for k, text in enumerate(words[:MOST_TOLD]))]
