"""Messages while the equations are compiled: how long it takes on this machine, and the progress."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from sma_sim.compiler.compile import is_compiled, reachable
from sma_sim.compiler.fragments import ENTRY, FRAGMENT, on_compiled
from sma_sim.compiler.pinned_systems import pin_system
from sma_sim.solver.equilibrium import start
from sma_sim.solver.integrate import integrate, integrate_held
from sma_sim.solver.tangents import follow

SIMULATION = (start, integrate)  # what Python calls to simulate an input
FIXED_RATE = (start, integrate_held)  # and what it calls to step at a fixed rate
TANGENTS = (follow, pin_system)  # and what fits call beside SIMULATION, for derivatives
MEASURED = 10  # work after which its speed is known
STARTING = 'compiling the equations, once on this machine ...'


class Compilation:
    """Follows the compilation of some functions that Python calls, from the first on; `say` takes a line of text."""

    def __init__(self, say: Callable[[str], object], entries: Sequence[Callable[..., Any]] = SIMULATION) -> None:
        self._say, self._start = say, time.monotonic()
        self._total = FRAGMENT * len(reachable(*entries)) + ENTRY * len(entries)
        self._done, self._next = 0, float(MEASURED)

    def __call__(self, work: int) -> None:
        """More work has been done."""
        first, self._done = self._done < MEASURED, self._done + work
        if self._done >= self._total:
            self._say(f'compiled in {time.monotonic() - self._start:.0f} s')
            on_compiled.remove(self)
        elif self._done >= self._next:
            self._say(self._progress(first))
            self._next = self._done + 0.25 * self._total

    def _progress(self, first: bool) -> str:
        rest = (time.monotonic() - self._start) * (self._total / self._done - 1.0)
        if first:
            return f'compiling the equations: about {rest:.0f} s on this machine'
        return f'compiling the equations: {100 * self._done / self._total:.0f} % done, about {rest:.0f} s left'


def announce_compilation(say: Callable[[str], object], entries: Sequence[Callable[..., Any]] = SIMULATION) -> None:
    """Say that, how long and how far the equations are compiled, where they are not yet; `say` takes a line of text."""
    if not is_compiled() and not any(isinstance(call, Compilation) for call in on_compiled):
        say(STARTING)
        on_compiled.append(Compilation(say, entries))
