"""The command `sma-sim`."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
import time
import traceback
from importlib import import_module

from sma_sim.cli.common.commands import KINETICS_HELP
from sma_sim.cli.common.parser import CommandParser
from sma_sim.model.errors import UserError
from sma_sim.model.optional import missing

VERBS = (
    'tour', 'init', 'simulate', 'explore', 'fit', 'compare', 'diagnose', 'latent', 'add', 'next', 'observe', 'play', 'plot',
    'bag', 'effects', 'systems', 'challenge', 'paper', 'compile',
)  # fmt: skip
PACKAGE = 'sma_sim'
BROKEN_PIPE = 141  # as a shell says of a program that SIGPIPE ended


def main(arguments: list[str] | None = None) -> int:
    """Run one verb; exit code 0 when done, 2 for a user's mistake, 1 for our fault."""
    words, started = sys.argv[1:] if arguments is None else arguments, time.monotonic()
    name = 'sma-sim'
    try:
        chosen = parser_for(words).parse_args(words)
        name = f'sma-sim {chosen.verb}'
        chosen.command, chosen.started = shlex.join(['sma-sim', *words]), started
        code = int(chosen.run(chosen))
        sys.stdout.flush()
        return code
    except UserError as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 2
    except BrokenPipeError:  # whoever read our output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except KeyboardInterrupt:
        print(f'{name}: stopped', file=sys.stderr)
        return 130
    except ModuleNotFoundError as error:
        if not isinstance(missing(error, name), UserError):
            return report_fault(name)
        print(missing(error, name), file=sys.stderr)
        return 2
    except Exception:
        return report_fault(name)


def report_fault(name: str) -> int:
    """Print the exception that is being handled as a fault of ours; the exit code."""
    traceback.print_exc()
    print(f'{name}: this is a fault of sma_sim, please report it', file=sys.stderr)
    return 1


def parser_for(words: list[str]) -> argparse.ArgumentParser:
    """The parser, with the verb that is asked for alone if it is one: others need not be imported."""
    parser = CommandParser(
        prog='sma-sim', description='Simulate soft robots driven by shape-memory-alloy wires.', epilog=KINETICS_HELP
    )
    parser.add_argument('--version', action='version', version=f'sma-sim {sys.modules[PACKAGE].__version__}')
    verbs = parser.add_subparsers(dest='verb', required=True)
    for verb in [words[0]] if words and words[0] in VERBS else VERBS:
        import_module(f'sma_sim.cli.{verb}').add_parser(verbs)
    return parser


if __name__ == '__main__':
    sys.exit(main())
