"""`sma-sim challenge`: recordings of a robot with something hidden in it, and what it was."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sma_sim.challenge.answer import Answer
from sma_sim.challenge.files import NOMINAL_FILE, WRITERS, check_new, open_answer, write_challenge
from sma_sim.challenge.make import DEFAULT_DURATION, DEFAULT_RATE, MIN_RUNS, RecordingPlan, make_challenge
from sma_sim.challenge.score import VerdictScore, read_verdict, score_verdict
from sma_sim.cli.common.commands import add_command
from sma_sim.cli.common.config_options import announce_first_compilation


def add_parser(verbs: Any) -> None:
    """Declare the verb and its own verbs."""
    parser = add_command(verbs, 'challenge')
    own = parser.add_subparsers(dest='challenge_verb', required=True)
    new = add_command(own, 'new', 'write recordings of a robot that differs from its model, and seal the answer')
    new.add_argument('--seed', type=int, required=True, metavar='N', help='seed; the same seed makes the same files')
    new.add_argument('--out', type=Path, required=True, metavar='DIR', help='folder to write; it must not exist')
    new.add_argument('--effects', type=int, choices=(0, 1, 2), help='number of hidden effects (default: drawn)')
    new.add_argument(
        '--outside',
        action=argparse.BooleanOptionalAction,
        default=None,
        help='hide only effects outside the library, or only effects of it (default: drawn)',
    )
    new.add_argument('--kind', action='append', default=[], metavar='NAME', help='hide this effect (up to twice)')
    new.add_argument('--forces', action='store_true', help='record the forces of the wires too')
    new.add_argument('--runs', type=int, default=MIN_RUNS, help=f'number of recordings (default and minimum {MIN_RUNS})')
    new.add_argument(
        '--duration',
        type=float,
        default=DEFAULT_DURATION,
        metavar='S',
        help=f'duration of each recording (default {DEFAULT_DURATION:g} s)',
    )
    new.add_argument(
        '--rate', type=float, default=DEFAULT_RATE, metavar='HZ', help=f'samples per second (default {DEFAULT_RATE:g})'
    )
    new.add_argument('--format', choices=tuple(WRITERS), default='mcap', help='format of the recordings (default mcap)')
    new.set_defaults(run=write_new)
    reveal = add_command(own, 'reveal', 'open the answer, and score a verdict of `sma-sim diagnose`')
    reveal.add_argument('folder', type=Path, metavar='DIR')
    reveal.add_argument('verdict', type=Path, nargs='?', metavar='VERDICT.json')
    reveal.add_argument('--json', action='store_true', help='print JSON, for programs')
    reveal.set_defaults(run=reveal_answer)


def write_new(arguments: argparse.Namespace) -> int:
    """Make a challenge and write it."""
    check_new(arguments.out)
    announce_first_compilation()
    challenge = make_challenge(
        arguments.seed,
        arguments.effects,
        arguments.outside,
        arguments.kind,
        arguments.forces,
        RecordingPlan(arguments.runs, arguments.duration, arguments.rate),
    )
    write_challenge(challenge, arguments.out, arguments.format)
    first = challenge.dataset.recordings[0]
    print(
        f'Wrote {arguments.runs} recordings of {first.source.times[-1]:g} s to {arguments.out}, with the channels '
        f'{", ".join(first.channels)}; the model to start from is {arguments.out / NOMINAL_FILE}.'
    )
    return 0


def reveal_answer(arguments: argparse.Namespace) -> int:
    """Print the answer, and the score of a verdict."""
    answer = open_answer(arguments.folder)
    score = score_verdict(answer, read_verdict(arguments.verdict)) if arguments.verdict else None
    if arguments.json:
        truth = answer.as_data() | {'verdict': answer.verdict}
        print(
            json.dumps(
                {'truth': truth, 'score': asdict(score) | {'bare_error': score.nominal_error} if score else None}, indent=2
            )
        )
    else:
        print('\n'.join(answer_text(answer) + (score_text(score) if score else [])))
    return 0


def answer_text(answer: Answer) -> list[str]:
    """The answer as lines of text."""
    count = len(answer.effects)
    hidden = f'{count} effect{"s" if count > 1 else ""} hidden' if count else 'nothing hidden'
    lines = [f'The robot of seed {answer.seed} has {hidden}.']
    for effect in answer.effects:
        lines.append(f'  {effect.library or effect.name} ({effect.port}{"" if effect.library else ", not in the library"})')
        lines += [f'    {name:<12} {value:.4g} {unit}' for name, (value, unit) in effect.parameters.items()]
        if effect.listed:
            values = ', '.join(f'{name} = {value:.4g} {unit}' for name, (value, unit) in effect.listed.items())
            lines.append(f'    as {effect.library} of the library: {values}')
        influence = ', '.join(f'{name} {size:.2g}' for name, size in effect.influence.items())
        lines.append(f'    changes, over the noise: {influence}')
    lines.append('Parameters of the robot, and how far they are from those of the model:')
    for name, (nominal, true) in answer.parameters.items():
        lines.append(f'  {name:<14} {true:<12.5g} {100.0 * (true / nominal - 1.0):+.2f} %')
    return lines


def score_text(score: VerdictScore) -> list[str]:
    """The score as lines of text."""
    lines = [f'The verdict {score.verdict} is {score.outcome}: {score.why}']
    if score.verdict != score.expected_verdict:
        lines.append(f'  expected {score.expected_verdict}')
    lines += [f'  {name}: {f"rank {rank}" if rank else "not ranked"}' for name, rank in score.ranks.items()]
    for model, error in (('nominal model', score.nominal_error), ('last model', score.final_error)):
        if error is not None:
            lines.append(f'  held-out normalized RMSE, {model}: {error:.3g}')
    return lines
