"""When the next steps are due, without bursts: by the computer's clock, or by the clock of ROS."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple, Protocol

LATENESS_TO_MAKE_UP = 0.1  # [s]; beyond it the schedule moves, so that an overrun is not answered with a burst
CLOCK_STEP_TO_FOLLOW = 0.5  # [s] that another clock may move at once before it counts as an overrun
SHORTEST_SLEEP = 1e-3  # [s]; steps that are due within it are made together
AT_ONCE, TRIES = 1e-4, 10  # [s] within which two clocks are read, and how often that is tried on a busy computer
MAX_WAIT = 0.05  # [s] after which a wait returns with nothing due
MAX_STANDSTILL = 0.01  # [s] after which a clock that stands still is looked at again


class Due(NamedTuple):
    """Steps to make now; by how much simulated time was left behind the clock [s]; by how much the clock went back [s]."""

    steps: int
    moved: float = 0.0
    back: float = 0.0


def clock_warning(due: Due, followed: bool, now: int) -> str:
    """What a clock did that simulated time doesn't follow; `followed`: /clock is, now [ns] is its time."""
    if due.back > 0.0:
        return (
            f'/clock went back by {due.back:.2f} s, to {now / 1e9:.2f} s: its source was restarted, or a bag plays from its '
            'start. The module keeps its state and goes on from there, with stamps of /clock; ~/reset starts it anew'
        )
    if due.moved > 0.0 and followed:
        return (
            f'/clock is {due.moved:.2f} s ahead, at {now / 1e9:.2f} s: it jumped, or this computer is too slow for it. That '
            'time is not simulated; the module keeps its state and goes on from there'
        )
    return f'{due.moved:.2f} s behind the clock: simulated time stands still for as long' if due.moved > 0.0 else ''


class Schedule(Protocol):
    """What says when steps are due."""

    overruns: int
    lost: float  # [s] by which simulated time was left behind, in all
    anchor: int  # time [ns] of the followed clock since which steps are counted

    def restart(self) -> None:
        """The next step is due one period from now."""

    def wait(self) -> Due:
        """Sleep until steps are due, but not for long."""


class WallSchedule:
    """`rate` steps per simulated second, `factor` simulated seconds per second; 0: as fast as possible.

    `now` tells the time [ns] that stamps follow; without it they follow none, and `anchor` stays 0.
    """

    def __init__(self, rate: float, factor: float, now: Callable[[], int] | None = None) -> None:
        self._now = now
        pace = rate * factor
        self._steps = max(1, round(pace * SHORTEST_SLEEP)) if factor > 0.0 else max(1, round(rate * SHORTEST_SLEEP))
        self._period = self._steps / pace if factor > 0.0 else 0.0
        self.overruns, self.lost, self.anchor = 0, 0.0, 0
        self.restart()

    def restart(self) -> None:
        """The next step is due one period from now."""
        moment, now = self._read_clocks()
        self._due = moment + self._period
        if self._now is not None:
            self.anchor = now

    def wait(self) -> Due:
        """Sleep until the next steps are due; nothing is due yet when that takes long."""
        if self._period == 0.0:
            return Due(self._steps)
        late = time.monotonic() - self._due
        if late < -MAX_WAIT:
            time.sleep(MAX_WAIT)
            return Due(0)
        self._due += self._period
        if late < 0.0:
            time.sleep(-late)
        elif late > LATENESS_TO_MAKE_UP:
            self.overruns += 1
            self.lost += late
            moment, now = self._read_clocks()
            self._due = moment + self._period
            if self._now is not None:
                self.anchor = now - round(self._period * 1e9)
            return Due(self._steps, moved=late)
        return Due(self._steps)

    def _read_clocks(self) -> tuple[float, int]:
        """The computer's steady clock [s] and the one that stamps follow [ns], at one moment, else stamps would be off."""
        for _ in range(TRIES):
            moment = time.monotonic()
            now = self._now() if self._now is not None else 0
            if time.monotonic() - moment < AT_ONCE:
                break
        return moment, now


class ClockSchedule:
    """`rate` steps per second of another clock.

    `now` tells its time [ns], 0 before it was heard of; `wait` returns when it may have moved, after so many seconds at the
    latest.
    """

    def __init__(self, rate: float, now: Callable[[], int], wait: Callable[[float], None]) -> None:
        self._rate, self._now, self._wait = rate, now, wait
        self.overruns, self.lost, self.anchor = 0, 0.0, 0
        self.restart()

    def restart(self) -> None:
        """The next step is due one period from now."""
        self.anchor = self._last = self._now()
        self._made = 0

    def wait(self) -> Due:
        """Look at the clock; sleep a moment when nothing is due."""
        now = self._now()
        if self.anchor == 0 or now < self._last:
            back = (self._last - now) / 1e9 if self.anchor else 0.0
            self.restart()
            self._wait(MAX_STANDSTILL)
            return Due(0, back=back)
        self._last = now
        steps = int((now - self.anchor) * self._rate / 1e9 + 1e-6) - self._made
        if steps <= 0:
            self._wait(MAX_STANDSTILL)
            return Due(0)
        if steps > max(1.0, CLOCK_STEP_TO_FOLLOW * self._rate):
            moved = steps / self._rate
            self.overruns += 1
            self.lost += moved
            self.restart()
            return Due(0, moved=moved)
        self._made += steps
        return Due(steps)


class RecentCount:
    """How much a total has grown over the last `window` seconds of wall time, as far as it was asked for."""

    def __init__(self, window: float) -> None:
        self._window, self._total = window, 0
        self._increases: deque[tuple[float, int]] = deque()

    def __call__(self, total: int) -> int:
        """The growth; `total` is the count in all."""
        now = time.monotonic()
        if total > self._total:
            self._increases.append((now, total - self._total))
            self._total = total
        while self._increases and now - self._increases[0][0] > self._window:
            self._increases.popleft()
        return sum(increase for _, increase in self._increases)


class Speed:
    """Simulated seconds per second over a window of wall time, which begins at a simulated time [s]."""

    def __init__(self, simulated: float) -> None:
        self._wall, self._simulated = time.monotonic(), simulated

    def since_last(self, simulated: float) -> float:
        """The factor since this was last asked (since the beginning, at first); `simulated` is the simulated time [s]."""
        now = time.monotonic()
        factor = (simulated - self._simulated) / max(now - self._wall, 1e-9)
        self._wall, self._simulated = now, simulated
        return factor
