"""Robots that are stepped side by side by the compiled stepper, each with a target of its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sma_sim.gym.task import AHEAD, EFFORT, LARGEST, Task, nominal_model
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.side_by_side import SideBySide


class Robots:
    """Several episodes of one task, the arrays of all (robots, ...) beside each other.

    `restart` begins one of them; `step` gives all a command, and returns who has failed: a robot whose equations have no
    solution any more stays where it was.
    """

    def __init__(self, task: Task, count: int) -> None:
        self.task, self.count = task, count
        where = sample_columns(task.config.structure)
        self._channels = where.sensed.start + task.channel_numbers
        self._robots = SideBySide(nominal_model(task), task.rate, count)
        self._T_E = task.config.parameters['environment.T_E']
        self._input = np.full((count, task.commands + 1), self._T_E)
        self._ahead = round(AHEAD * task.rate)
        self._seen, self._before = np.zeros((count, len(self._channels))), np.zeros(count)
        self._action = np.zeros((count, task.commands))
        self._targets = np.zeros((count, task.steps + 1 + self._ahead))
        self.k = np.zeros(count, dtype=np.int64)  # actions since each began

    def restart(self, i: int, random: np.random.Generator) -> None:
        """Robot `i` begins an episode at rest. Raises SimulationError where a robot that was drawn has no rest."""
        task = self.task
        at_rest = np.array([*np.zeros(task.commands), self._T_E])
        self._robots.put(i, task.model(random), at_rest)
        self._targets[i] = task.target(random)
        self.k[i], self._action[i] = 0, 0.0 if task.signed else -1.0
        self._seen[i] = self._robots.samples[i, self._channels]
        self._before[i] = self._seen[i, 0]

    def step(self, action: Matrix, which: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Give the robots `which` their actions (robots, commands); whether each of all failed."""
        self._input[:, :-1] = self.task.heating(action)
        self._before[which], self._action[which] = self._seen[which, 0], action[which]
        failed = self._robots.step(self._input, which)
        self._seen[which] = self._robots.samples[np.ix_(which, self._channels)]
        self.k[which] += 1
        return failed

    @property
    def position(self) -> Vector:
        """Where the coordinates are, from -1 to 1 of their range."""
        middle, half = self.task.span
        return (self._seen[:, 0] - middle) / half

    @property
    def target(self) -> Vector:
        """Where they should be."""
        return self._targets[np.arange(self.count), self.k]

    @property
    def observation(self) -> NDArray[np.float32]:
        """Position, its rate [1/s], target, target AHEAD, last action, further channels; (robots, size)."""
        middle, half = self.task.span
        rate = (self._seen[:, 0] - self._before) * (self.task.rate / half)
        ahead = self._targets[np.arange(self.count), self.k + self._ahead]
        first, sizes = self.task.scales
        further = (self._seen[:, 1:] - first) / sizes
        columns = np.column_stack([self.position, rate, self.target, ahead, self._action, further])
        return np.clip(columns, -LARGEST, LARGEST).astype(np.float32)

    @property
    def reward(self) -> Vector:
        """-|error| of the position, and a little for heating."""
        used = np.abs(self._action) if self.task.signed else 0.5 * (self._action + 1.0)
        found: Vector = -np.abs(self.position - self.target) - EFFORT * np.clip(used, 0.0, 1.0).mean(axis=1)
        return found

    @property
    def ended(self) -> NDArray[np.bool_]:
        """Whose time is over."""
        return self.k >= self.task.steps
