"""How far long work is: a line that is written over, where somebody sees it, on a terminal or in a notebook."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

QUIET_TIME = 2.0  # [s] before progress is shown
BAR = 20  # characters


def is_seen() -> bool:
    """Whether stderr is a terminal, or the output of a notebook."""
    return sys.stderr.isatty() or hasattr(shell(), 'kernel')


def shell() -> Any:
    """The IPython shell that runs this, None for none."""
    module = sys.modules.get('IPython')
    return module.get_ipython() if module else None


class ProgressLine:
    """A line on stderr that shows how much is done, once the work takes longer than a moment."""

    def __init__(self, what: str) -> None:
        self._what, self._start, self._shown = what, time.monotonic(), False

    def __call__(self, part: float) -> None:
        """Show that `part` (0 to 1) is done."""
        self.show(f'[{"#" * round(BAR * part):<{BAR}}] {100.0 * part:3.0f} %')

    def show(self, state: str) -> None:
        """Show how far the work is, in words."""
        passed = time.monotonic() - self._start
        if passed > QUIET_TIME and is_seen():
            text = f'{self._what}: {state} after {passed:.0f} s'
            print(f'\r{text:<79}', end='', file=sys.stderr, flush=True)
            self._shown = True

    def note(self, words: str) -> None:
        """Say what a user should know meanwhile, on a line of its own that everybody sees."""
        self.close()
        self._shown = False
        print(f'{self._what}: {words}', file=sys.stderr, flush=True)

    def close(self) -> None:
        """End the line."""
        if self._shown:
            print(file=sys.stderr)


@contextmanager
def progress_line(what: str) -> Iterator[ProgressLine]:
    """A line that ends with the work."""
    line = ProgressLine(what)
    try:
        yield line
    finally:
        line.close()


@contextmanager
def progress_in_words(what: str, given: Callable[[str], None] | None) -> Iterator[Callable[[str], None]]:
    """What hears of every stage of the work: as `given`, else a line."""
    with progress_line(what) as line:
        yield line.show if given is None else given
