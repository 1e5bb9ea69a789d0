"""Ctrl-C that asks long work to come to an end, wherever it is."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event
from types import FrameType


class FirstInterrupt:
    """Handler of Ctrl-C: the first one sets `stop`, the next one does what was usual `before`."""

    def __init__(self, before: signal._HANDLER) -> None:
        self.stop, self._before = Event(), before

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Called with the first Ctrl-C."""
        signal.signal(signal.SIGINT, self._before)
        self.stop.set()


@contextmanager
def stoppable() -> Iterator[Event]:
    """Within it the first Ctrl-C sets the event; the next one interrupts as usual. Nested ones share one event.

    Where somebody ignores Ctrl-C (a job in the background of a shell) that stays so. Signals reach the main thread only:
    in another one the event is never set by itself.
    """
    before = signal.getsignal(signal.SIGINT)
    if isinstance(before, FirstInterrupt):
        yield before.stop
    elif threading.current_thread() is not threading.main_thread() or before in (signal.SIG_IGN, None):
        yield Event()
    else:
        handler = FirstInterrupt(before)
        signal.signal(signal.SIGINT, handler)
        try:
            yield handler.stop
        finally:
            signal.signal(signal.SIGINT, before)
