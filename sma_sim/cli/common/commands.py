"""How a command joins `sma-sim`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from typing import Any, NamedTuple

KINETICS_HELP = (
    'Kinetics (--kinetics, --model): hybrid switches a wire between five modes, in which it transforms at once and in '
    'proportion (Mandolino et al. 2021), and is fast; mas lets it transform at a rate, by thermal activation (Mueller, '
    'Achenbach, Seelecke), which rounds corners and depends on speed.'
)
MAX_NOTES = 5


class Command(NamedTuple):
    """Its line in `sma-sim --help`, which begins its own help, and a command line that it takes."""

    purpose: str
    example: str = ''


COMMANDS = {
    'tour': Command('demonstrate the package in two minutes, on recordings that come with it', 'sma-sim tour --out tour'),
    'init': Command('write the parameter file of your robot', 'sma-sim init --beam-length 98mm --wires 8 --out robot.yaml'),
    'simulate': Command(
        'simulate the response of the model to an input file',
        'sma-sim simulate --input command.csv --out run.csv --effect gravity:g_y=-9.81',
    ),
    'explore': Command(
        'see the model in the browser, beside recordings or a robot, and improve it',
        'sma-sim explore run1.csv run2.csv --config robot.yaml',
    ),
    'fit': Command(
        'estimate parameters of the model from recordings',
        'sma-sim fit runs --hold-out run3 --free beam.E,wire.lambda -o fitted.yaml',
    ),
    'compare': Command(
        'compare the model with recordings, and say where the error is',
        'sma-sim compare runs --config fitted.yaml --report fitted.html',
    ),
    'diagnose': Command(
        'find the physical effect that the model lacks',
        'sma-sim diagnose runs --hold-out run3 --report why.html -o better.yaml',
    ),
    'latent': Command(
        'estimate the missing force, heat or other input over time, and where it acts',
        'sma-sim latent runs --config fitted.yaml --no-fit --report latent.html',
    ),
    'add': Command('switch effects on in a parameter file', 'sma-sim add gravity --config robot.yaml --out better.yaml'),
    'next': Command(
        'design the experiment that separates explanations, or determines parameters better',
        'sma-sim next runs --between gravity beam_creep -o next.csv',
    ),
    'observe': Command(
        'estimate temperatures, fractions and stresses of the wires of a recorded robot',
        'sma-sim observe run1.mcap --config calibrated.yaml --without T_1 --out estimated.csv',
    ),
    'play': Command(
        'send the commands of a CSV file or a bag to J_eq (or J, and set points), in time', 'sma-sim play next.csv'
    ),
    'plot': Command('draw a run: pose, temperatures, forces, modes', 'sma-sim plot run.csv --out run.png'),
    'bag': Command('inspect, repair and convert bags', 'sma-sim bag info run.mcap'),
    'effects': Command('list the physical effects that can be switched on', 'sma-sim effects gravity'),
    'systems': Command('list the structures that can be simulated, fitted and diagnosed', 'sma-sim systems slider'),
    'challenge': Command(
        'make recordings of a robot with a hidden effect, and score a verdict about it',
        'sma-sim challenge new --seed 1 --out case',
    ),
    'paper': Command("reproduce the paper's figures and numbers", 'sma-sim paper --out figures'),
    'compile': Command(
        'compile the equations now instead of at the first start, for instance while a container is built', 'sma-sim compile'
    ),
}


def add_command(verbs: Any, name: str, purpose: str = '') -> argparse.ArgumentParser:
    """The parser of a command of COMMANDS, or of one within it with a `purpose` of its own."""
    command = Command(purpose) if purpose else COMMANDS[name]
    parser: argparse.ArgumentParser = verbs.add_parser(
        name,
        help=command.purpose,
        description=f'{command.purpose[0].upper()}{command.purpose[1:]}.'.replace('%', '%%'),
        epilog=f'Example: {command.example}' if command.example else None,
    )
    return parser


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
