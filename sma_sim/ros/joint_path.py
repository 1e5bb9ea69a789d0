"""Trajectories of one joint, as trajectory_msgs/JointTrajectory gives them and ros2_control reads them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import BPoly

from sma_sim.model.arrays import Vector

INVALID_GOAL, INVALID_JOINTS, OLD_HEADER_TIMESTAMP = 'INVALID_GOAL', 'INVALID_JOINTS', 'OLD_HEADER_TIMESTAMP'


class RefusedError(Exception):
    """A trajectory that cannot be followed: the name of the action's error code, and why."""


def seconds(duration: Any) -> float:
    """A message's duration or time in seconds."""
    return float(duration.sec + 1e-9 * (duration.nanosec))


def values_of(point: Any) -> list[float]:
    """Angle [rad] and, where given, rate [rad/s] and acceleration [rad/s^2] of a point."""
    return [*point.positions, *point.velocities, *point.accelerations]


def check(trajectory: Any, joint: str, low: float, high: float) -> None:
    """Raise RefusedError for a trajectory of `joint` that cannot be followed between `low` and `high` [rad or m]."""
    if list(trajectory.joint_names) != [joint]:
        raise RefusedError(INVALID_JOINTS, f'joint_names = {list(trajectory.joint_names)}: expected {[joint]}')
    last, count = -1.0, 0
    for number, point in enumerate(trajectory.points, 1):
        values, time = values_of(point), seconds(point.time_from_start)
        lengths = [len(point.positions), len(point.velocities), len(point.accelerations)]
        if lengths not in ([1, 0, 0], [1, 1, 0], [1, 1, 1]) or count not in (0, len(values)):
            words = (
                'expected a position, a velocity too if all points have one, and an acceleration too if all points have both'
            )
            raise RefusedError(INVALID_GOAL, f'point {number}: {words}')
        if not all(map(math.isfinite, values)) or not low <= values[0] <= high:
            raise RefusedError(INVALID_GOAL, f'point {number}: {values}: expected finite, {low:.4g} to {high:.4g}')
        if time <= last:
            raise RefusedError(INVALID_GOAL, f'point {number}: time_from_start = {time:g} s: expected increasing times')
        last, count = time, len(values)


@dataclass(frozen=True)
class Held:
    """A position that is held [rad or m]."""

    position: float

    def at(self, now: float) -> list[float]:
        """Position, rate and acceleration at a time [s]."""
        return [self.position, 0.0, 0.0]

    def __call__(self, times: Vector) -> Vector:
        """Positions at times (k,) [s]."""
        return np.full(len(times), self.position)


class JointPath:
    """The desired position over time, from now on through the points of a trajectory.

    Points with positions are joined by straight lines, with velocities too by cubic and with accelerations too by quintic
    polynomials. It starts `now` [s], from where the motion is then: position, rate, acceleration. The stamp of its header is
    by a clock that is `ahead` [s] of that of `now`. Raises RefusedError for a trajectory that has passed.
    """

    def __init__(self, trajectory: Any, now: float, start: Sequence[float], ahead: float = 0.0) -> None:
        stamp = seconds(trajectory.header.stamp)
        t_start = stamp - ahead if stamp else now
        points = [(t_start + seconds(point.time_from_start), values_of(point)) for point in trajectory.points]
        points = [(time, values) for time, values in points if time >= now]
        if not points:
            words = f'it has ended before the last joint_states, which are of {now + ahead:.3f} s'
            raise RefusedError(OLD_HEADER_TIMESTAMP, words)
        if points[0][0] > now:
            points.insert(0, (now, list(start[: len(points[0][1])])))
        self.now, (self.end, (self.last, *_)) = now, points[-1]
        times, values = zip(*points, strict=True)
        self.curve = BPoly.from_derivatives([time - now for time in times], values) if len(points) > 1 else None

    def at(self, now: float) -> list[float]:
        """Position [rad or m], rate and acceleration at a time [s]."""
        if self.curve is None or now >= self.end:
            return [self.last, 0.0, 0.0]
        return [float(self.curve(now - self.now, nu=order)) for order in range(3)]

    def __call__(self, times: Vector) -> Vector:
        """Positions at times (k,) [s]."""
        return np.array([self.at(time)[0] for time in times.tolist()])
