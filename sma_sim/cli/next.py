"""`sma-sim next`: the command sequence that best tells rival explanations, or parameters, apart."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Iterator
from pathlib import Path
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
    write_json,
)
from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.data.tables import write_columns
from sma_sim.evidence.experiment_design.curves import hypothesis_curves
from sma_sim.evidence.experiment_design.design import next_experiment
from sma_sim.evidence.experiment_design.plan import DesignRequest, Plan
from sma_sim.evidence.experiment_design.sequence_search import BATCH, DEFAULT_SEQUENCES
from sma_sim.evidence.experiment_design.sequences import as_rows
from sma_sim.model.errors import UserError
from sma_sim.model.given import effect_folders_of
from sma_sim.model.shown import text_table
from sma_sim.report.html.design_page import write_design_page
from sma_sim.words.experiment_design import (
    BEGINS_IN_MOTION,
    channels_sentence,
    indistinguishable_sentences,
    limits_table,
    plan_data,
    precision_table,
    ratio_table,
)


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'next')
    add_data_options(parser)
    add_beginning_option(parser)
    parser.add_argument(
        '--between',
        nargs='+',
        default=[],
        metavar='EFFECT',
        help='explanations to separate: effects, a+b for two together, `nothing` (default: those that rival the best)',
    )
    parser.add_argument(
        '--parameters', nargs='+', default=[], metavar='NAME', help='parameters to determine better, instead of --between'
    )
    parser.add_argument(
        '--length', type=float, default=DesignRequest.length, metavar='S', help='duration of the experiment (default 100 s)'
    )
    parser.add_argument(
        '--hold', type=float, default=DesignRequest.hold, metavar='S', help='shortest duration of a level (default 0.5 s)'
    )
    parser.add_argument(
        '--max-power', type=float, metavar='W', help='largest command (default: the largest in the recordings)'
    )
    parser.add_argument(
        '--max-temperature', type=float, metavar='K', help='limit of the wires (default: 10 %% above the recordings)'
    )
    parser.add_argument(
        '--max-stress', type=float, metavar='PA', help='limit of the wires (default: 10 %% above the recordings)'
    )
    parser.add_argument(
        '--tries',
        type=int,
        default=DesignRequest.budget,
        metavar='N',
        help=f'sequences that the search may evaluate, {BATCH} at once beside the first {DEFAULT_SEQUENCES} (default 120)',
    )
    add_search_options(parser, 'seed of the search')
    parser.add_argument('-o', '--out', type=Path, metavar='FILE.csv', help='command sequence to write, for `sma-sim play`')
    add_config_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Design, and write what was asked for."""
    if arguments.tries < 1:
        raise UserError(f'--tries {arguments.tries}: expected 1 or more')
    config, training, _ = model_and_recordings(arguments, arguments.out)
    announce_first_compilation()
    with chosen_executor(arguments) as executor:
        plan = next_experiment(training, config, request_from(arguments), executor, print_progress)
    if arguments.out:
        times, levels = as_rows(plan.levels, plan.grid)
        write_columns(arguments.out, {'time_s': times, plan.grid.columns[0]: levels})
    if arguments.json:
        write_json(arguments.json, plan_data(plan))
    if arguments.report:
        made = provenance_of(arguments, (arguments.config, config))
        write_design_page(arguments.report, plan, hypothesis_curves(plan), made)
    print(*plan_text(plan, arguments.parameters), sep='\n')
    print_written(arguments.out, arguments.report, arguments.json)
    return EXIT_INTERRUPTED if plan.interrupted else 0


def request_from(arguments: argparse.Namespace) -> DesignRequest:
    """The options."""
    return DesignRequest(
        tuple(arguments.between),
        tuple(arguments.parameters),
        arguments.length,
        arguments.hold,
        arguments.max_power,
        arguments.max_temperature,
        arguments.max_stress,
        arguments.model,
        arguments.tries,
        arguments.seed,
        tuple(effect_folders_of(arguments.config, arguments.words)),
    )


def plan_text(plan: Plan, asked: Collection[str]) -> Iterator[str]:
    """The result for the terminal, by names of the parameters that were asked for."""
    if plan.in_motion:
        yield BEGINS_IN_MOTION
    rows = len(as_rows(plan.levels, plan.grid)[0]) - 1
    yield (
        f'Designed a sequence of {rows} levels in {plan.grid.length:g} s, each held for {plan.grid.hold:g} s or longer: '
        f'the best of {plan.evaluated}.'
    )
    yield ''
    if plan.discriminates:
        yield from rival_text(plan)
    else:
        yield from precision_text(plan, asked)
    yield ''
    yield text_table(*limits_table(plan))
    yield 'time above limits: none'
    yield from channels_text(plan)
    if plan.interrupted:
        yield 'stopped early: the best so far'


def channels_text(plan: Plan) -> Iterator[str]:
    """What one sensor more would tell along the recordings."""
    if not plan.further_channels:
        return
    tells = 'expected log evidence ratio, at least' if plan.discriminates else 'information [nat]'
    yield ''
    yield text_table(
        ('one sensor more in the recordings', 'noise', tells),
        [
            (
                channel.words,
                in_display_unit(channel.channel, channel.noise_std),
                f'{channel.least if plan.discriminates else channel.information:.3g}',
            )
            for channel in plan.further_channels
        ],
    )
    yield channels_sentence(plan.further_channels)


def rival_text(plan: Plan) -> Iterator[str]:
    """What the recordings say of the rivals, and what the experiment is expected to say."""
    best = max(hypothesis.log_evidence for hypothesis in plan.hypotheses)
    yield text_table(
        ('explanation', 'kinetics', 'normalized RMSE', 'log evidence behind the best'),
        [
            (
                hypothesis.name,
                hypothesis.fitted.problem.config.simulated_kinetics,
                f'{hypothesis.fitted.error * hypothesis.noise_factor:.3f}',
                f'{best - hypothesis.log_evidence:.1f}',
            )
            for hypothesis in plan.hypotheses
        ],
    )
    yield ''
    yield text_table(*ratio_table(plan))
    yield from indistinguishable_sentences(plan)


def precision_text(plan: Plan, asked: Collection[str]) -> Iterator[str]:
    """How well parameters will be known; those `asked` for that a default sequence would tell better, and why."""
    yield text_table(*precision_table(plan))
    yield f'information on what was asked for: {plan.gain.designed:.2f} nat, {plan.gain.default:.2f} by a default sequence'
    worse = [p.name for p in plan.precision if p.name in asked and p.designed > p.default]
    if worse:
        yield (
            f'A default sequence would tell {", ".join(worse)} better: the design tells most of all that was asked for '
            'together. For one parameter alone, ask for it alone.'
        )
