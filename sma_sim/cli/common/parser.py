"""The parser of the command line: messages of argparse with the nearest name, and where an option took too much."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from sma_sim.model.nearest import suggestion

TOO_MUCH = '--hold-out'  # takes every name after it


class CommandParser(argparse.ArgumentParser):
    """One that says what may have been meant."""

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
        if 'required: DATA' in message and TOO_MUCH in self._words:
            return f'; {TOO_MUCH} takes all names after it: give DATA before it'
        return ''
