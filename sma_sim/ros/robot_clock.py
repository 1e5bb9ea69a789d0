"""The clock of a robot's stamps, which may go at another pace than that of this computer, and may be set."""

from __future__ import annotations

from collections import deque

WINDOW = 1.0  # [s] over which the pace is measured
MIN_SPAN = 0.1  # [s] from which on it is: a late message counts for a tenth of it at the most
INTERRUPTION = 0.1  # [s] between two samples from which on a robot has stopped, or was cut off: the pace is measured anew
AHEAD = 0.05  # [s] by which a stamp may be ahead of what is expected, at a pace of 1
FIRST_AHEAD = 0.5  # [s] by which it may while the pace is not measured, in the robot's time

FILLED_IN = 'is header.stamp filled in?'  # what to look at where stamps do not move on

Reading = tuple[float, float]  # a stamp [s], and when it arrived by the clock of this computer [s]


def stamp_fault(step: float) -> str:
    """What is wrong with joint_states whose stamp is `step` [s] beyond that of those before; empty where nothing is.

    They are no new sample: a robot whose clock stands still says nothing of how it is now, however often.
    """
    if step > 0.0:
        return ''
    return f'joint_states whose stamp {"repeats" if step == 0.0 else "is older than the one before"}'


class RobotClock:
    """Reads the clock of a robot between its samples, and tells when it was set.

    A simulator with a real-time factor of 3 makes three seconds of its time in one, and a wire heats up three times as far
    in it; a robot that is slower than a clock is taken for one that is not, so that no command stays in force for longer.
    No sample arrives before it is made, so the clock is that of the sample that was on its way for the shortest time. One
    that is ahead of it shows that the clock was set, if it is so much ahead of the sample before as well: a simulator may
    make much of its time at once, but makes samples all along.
    """

    def __init__(self) -> None:
        self._readings: deque[Reading] = deque()
        self._soonest = (0.0, 0.0)  # the reading that was on its way for the shortest time
        self._cut_off = 0.0  # [s] of the last interruption, whose samples may still come
        self.pace = 1.0  # [s/s] of the robot's time, at least 1

    def hear(self, stamp: float, arrival: float) -> float:
        """Take the stamp [s] of a sample that arrives [s]; by how much the clock was set since the one before [s]."""
        readings, jump = self._readings, 0.0
        if readings:
            (last, heard), ahead = readings[-1], stamp - self.at(arrival)
            between = stamp - last - self.pace * (arrival - heard)
            usual = AHEAD * self.pace if heard - readings[0][1] >= MIN_SPAN else FIRST_AHEAD
            if stamp < last or min(ahead, between) > usual + self._cut_off:
                jump = ahead
            if arrival - heard > INTERRUPTION:
                self._cut_off = arrival - heard
            if jump or arrival - heard > INTERRUPTION:
                readings.clear()
        readings.append((stamp, arrival))
        while len(readings) > 1 and arrival - readings[1][1] >= WINDOW:
            readings.popleft()
            self._cut_off = 0.0
        since, begin = readings[0]
        if arrival - begin >= MIN_SPAN:
            self.pace = max((stamp - since) / (arrival - begin), 1.0)
        if len(readings) == 1 or stamp >= self.at(arrival):
            self._soonest = (stamp, arrival)
        elif self._soonest[1] < begin:
            self._soonest = max(readings, key=lambda one: one[0] - self.pace * one[1])
        return jump

    def at(self, now: float) -> float:
        """The robot's time [s] at `now` [s] of this computer's clock; before the first sample it counts from zero."""
        stamp, arrival = self._soonest
        return stamp + self.pace * (now - arrival)
