"""When the next step is due: simulated against wall time, without bursts."""

from __future__ import annotations

import time

LATENESS_TO_MAKE_UP = 0.1  # [s]; beyond it the schedule moves, so that an overrun is not answered with a burst


class Schedule:
    """Due times of the steps at `rate` steps per simulated second and `factor` simulated seconds per second.

    A factor of 0 means as fast as possible.
    """

    def __init__(self, rate: float, factor: float) -> None:
        self._period = 1.0 / (rate * factor) if factor > 0.0 else 0.0
        self.overruns = 0
        self.restart()

    def restart(self) -> None:
        """The next step is due one period from now."""
        self._due = time.monotonic() + self._period

    def wait(self) -> float:
        """Sleep until the next step is due; by how much the schedule had to be moved [s], mostly 0."""
        late = time.monotonic() - self._due
        self._due += self._period
        if self._period == 0.0:
            return 0.0
        if late < 0.0:
            time.sleep(-late)
        elif late > LATENESS_TO_MAKE_UP:
            self.overruns += 1
            self._due += late
            return late
        return 0.0


class Speed:
    """Simulated seconds per second over a window of wall time."""

    def __init__(self) -> None:
        self._wall, self._simulated = time.monotonic(), 0.0

    def since_last(self, simulated: float) -> float:
        """The factor since this was last asked (since the start, at first); `simulated` is the simulated time [s]."""
        now = time.monotonic()
        factor = (simulated - self._simulated) / max(now - self._wall, 1e-9)
        self._wall, self._simulated = now, simulated
        return factor
