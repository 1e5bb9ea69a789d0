"""How a command joins `sma-sim`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from typing import Any

KINETICS_HELP = (
    'Kinetics (--kinetics, --model): hybrid switches a wire between five modes, in which it transforms at once and in '
    'proportion (Mandolino et al. 2021), and is fast; mas lets it transform at a rate, by thermal activation (Mueller, '
    'Achenbach, Seelecke), which rounds corners and depends on speed.'
)
MAX_NOTES = 5
EXAMPLES = {  # a command that each of them takes
    'tour': 'sma-sim tour --out tour',
    'init': 'sma-sim init --beam-length 98mm --wires 8 --out robot.yaml',
    'simulate': 'sma-sim simulate --input command.csv --out run.csv --effect gravity:g_y=-9.81',
    'explore': 'sma-sim explore run1.csv run2.csv --config robot.yaml',
    'fit': 'sma-sim fit runs --hold-out run3 --free beam.E,wire.lambda -o fitted.yaml',
    'compare': 'sma-sim compare runs --config fitted.yaml --report fitted.html',
    'diagnose': 'sma-sim diagnose runs --hold-out run3 --report why.html -o better.yaml',
    'latent': 'sma-sim latent runs --config fitted.yaml --no-fit --report latent.html',
    'add': 'sma-sim add gravity --config robot.yaml --out better.yaml',
    'next': 'sma-sim next runs --between gravity beam_creep -o next.csv',
    'play': 'sma-sim play next.csv',
    'observe': 'sma-sim observe run1.mcap --config calibrated.yaml --without T_1 --out estimated.csv',
    'plot': 'sma-sim plot run.csv --out run.png',
    'bag': 'sma-sim bag info run.mcap',
    'effects': 'sma-sim effects gravity',
    'systems': 'sma-sim systems slider',
    'challenge': 'sma-sim challenge new --seed 1 --out case',
    'paper': 'sma-sim paper --out figures',
    'compile': 'sma-sim compile',
}


def add_command(verbs: Any, name: str, purpose: str) -> argparse.ArgumentParser:
    """The parser of a command; `purpose` is its line in `sma-sim --help`, and the first sentence of its own help."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        name, help=purpose, description=f'{purpose[0].upper()}{purpose[1:]}.'.replace('%', '%%'), epilog=example_of(name)
    )
    return parser


def example_of(name: str) -> str | None:
    """The last line of a command's help."""
    return f'Example: {EXAMPLES[name]}' if name in EXAMPLES else None


def add_kinetics(parser: argparse.ArgumentParser, choices: tuple[str, ...], default: str) -> None:
    """``--kinetics``, also called ``--model``."""
    words = 'kinetics: hybrid (modes, fast), mas (rates, thermal activation)'
    more = ', auto (the more probable of both)' if 'auto' in choices else ''
    parser.add_argument('--model', '--kinetics', dest='model', choices=choices, help=f'{words}{more}; default: {default}')


def print_notes(notes: Iterable[str]) -> None:
    """Print notes on stderr, a line each, no more than MAX_NOTES lines."""
    every = list(notes)
    more = len(every) - MAX_NOTES + 1
    kept = every if more <= 1 else [*every[: MAX_NOTES - 1], f'and {more} more notes']
    for note in kept:
        print(f'note: {note}', file=sys.stderr)
