"""The signals that ask a program to stop, and how it hears of them."""

from __future__ import annotations

import atexit
import signal
from collections.abc import Callable, Mapping
from typing import Any

STOP_SIGNALS = tuple(
    getattr(signal, name) for name in ('SIGINT', 'SIGTERM', 'SIGHUP', 'SIGQUIT') if hasattr(signal, name)
)  # a closed terminal sends the third, Ctrl-\ the fourth

Handlers = Mapping[int, Any]


def take_stop_signals(note: Callable[[int], object]) -> Handlers:
    """Let `note` hear of every signal that asks to stop, however often they come; the handlers that were there before.

    `note` runs between any two instructions of the main thread, also within another call of itself. SIGHUP stays ignored
    where it was, as under nohup.
    """
    before = {number: signal.getsignal(number) for number in STOP_SIGNALS}
    if hasattr(signal, 'SIGHUP') and before[signal.SIGHUP] == signal.SIG_IGN:
        del before[signal.SIGHUP]
    for number in before:
        signal.signal(number, lambda given, _: note(given))
    return before


def give_back(handlers: Handlers) -> None:
    """Install handlers as `take_stop_signals` found them."""
    for number, handler in handlers.items():
        signal.signal(number, signal.SIG_DFL if handler is None else handler)


def ignore_at_exit(handlers: Handlers) -> None:
    """Ignore the signals while the interpreter ends: launch repeats Ctrl-C, which must not kill what is ending."""
    for number in handlers:
        atexit.register(signal.signal, number, signal.SIG_IGN)
