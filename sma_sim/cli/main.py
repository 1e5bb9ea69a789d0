"""The command `sma-sim`."""

from __future__ import annotations

import argparse
import errno
import os
import re
import shlex
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any, NoReturn

from sma_sim.cli.common.commands import COMMANDS, KINETICS_HELP, add_command
from sma_sim.model.errors import PhysicsWarning, UserError
from sma_sim.model.nearest import suggestion
from sma_sim.model.optional import missing

PACKAGE = 'sma_sim'
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # what a disk says that takes no more
BROKEN_PIPE = 141  # as a shell says of a program that SIGPIPE ended
TOO_MUCH = '--hold-out'  # takes every name after it


class CommandParser(argparse.ArgumentParser):
    """A parser whose messages have the nearest name, and say where an option took too much."""

    _words: Sequence[str] = ()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse does; the words are kept for messages about them."""
        self._words = sys.argv[1:] if args is None else list(args)
        return super().parse_known_args(args, namespace)

    def options(self) -> list[str]:
        """All options, those of its commands too."""
        own = [option for option in self._option_string_actions if option.startswith('--')]
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                own += [option for one in action.choices.values() for option in one.options()]
        return own

    def error(self, message: str) -> NoReturn:
        """End the program with exit code 2 and the message with its cure."""
        super().error(f'{message}{self.cure(message)}')

    def cure(self, message: str) -> str:
        """What to do about a message, '' for nothing."""
        if found := re.search(r"invalid choice: '?([^']*?)'? \(choose from (.*)\)", message):
            return suggestion(found[1], re.findall(r'[\w-]+', found[2]))
        if found := re.search(r'unrecognized arguments: .*?(--[\w-]+)', message):
            return suggestion(found[1], self.options())
        if 'unrecognized arguments' in message and '--out' in self.options():
            return '; the file that is written is named by --out FILE'
        if 'required: DATA' in message and TOO_MUCH in self._words:
            return f'; {TOO_MUCH} takes all names after it: give DATA before it'
        return ''


def main(arguments: list[str] | None = None) -> int:
    """Run one verb; exit code 0 when done, 2 for a user's mistake, 1 for our fault."""
    words, started = sys.argv[1:] if arguments is None else arguments, time.monotonic()
    name = 'sma-sim'
    try:
        chosen = parser_for(words).parse_args(words)
        name = f'sma-sim {chosen.verb}'
        chosen.command, chosen.started = shlex.join(['sma-sim', *words]), started
        with physics_in_notes():
            code = int(chosen.run(chosen))
        flush_output()
        if arguments is None:  # a command whose work is done says so, also where Ctrl-C comes while Python goes away
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        return code
    except UserError as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 2
    except BrokenPipeError:  # whoever read our output has seen enough
        drop_output()
        return BROKEN_PIPE
    except KeyboardInterrupt:
        print(f'{name}: stopped', file=sys.stderr)
        return 130
    except OSError as error:
        if error.errno not in FULL:
            return report_fault(name)
        drop_output()
        print(f'{name}: cannot write {error.filename or "the output"}: {error.strerror}', file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        if not isinstance(missing(error, name), UserError):
            return report_fault(name)
        print(missing(error, name), file=sys.stderr)
        return 2
    except Exception:
        return report_fault(name)


@contextmanager
def physics_in_notes() -> Iterator[None]:
    """While it lasts, a warning about physics is a note, without a line of Python, for people who wrote none."""
    with warnings.catch_warnings():
        show = warnings.showwarning

        def note(message: Warning | str, category: type[Warning], *rest: Any, **named: Any) -> None:
            if issubclass(category, PhysicsWarning):
                print(f'note: {message}', file=sys.stderr)
            else:
                show(message, category, *rest, **named)

        warnings.showwarning = note
        yield


def flush_output() -> None:
    """Write what was printed; a program may be started without an output (``>&-``)."""
    if sys.stdout is not None:
        sys.stdout.flush()


def drop_output() -> None:
    """Print no more: what the interpreter writes at its end would fail again."""
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def report_fault(name: str) -> int:
    """Print the exception that is being handled as a fault of ours; the exit code."""
    traceback.print_exc()
    print(f'{name}: this is a fault of sma_sim, please report it', file=sys.stderr)
    return 1


def parser_for(words: list[str]) -> argparse.ArgumentParser:
    """The parser: whole for the verb that is asked for, of the others the purpose alone, since each imports much."""
    parser = CommandParser(
        prog='sma-sim', description='Simulate soft robots driven by shape-memory-alloy wires.', epilog=KINETICS_HELP
    )
    parser.add_argument('--version', action='version', version=f'sma-sim {sys.modules[PACKAGE].__version__}')
    verbs = parser.add_subparsers(dest='verb', required=True)
    asked = next((word for word in words if word in COMMANDS), '')
    for name in COMMANDS:
        if name == asked:
            import_module(f'sma_sim.cli.{name}').add_parser(verbs)
        else:
            add_command(verbs, name)
    return parser


if __name__ == '__main__':
    sys.exit(main())
