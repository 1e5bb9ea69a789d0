"""The model beside a robot that runs: its prediction at the robot's stamps, and whether it has left the measurement."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sma_sim.model.arrays import Vector
from sma_sim.solver.fixed_rate import FixedRateRun, first_steps
from sma_sim.solver.model import Model

INITIAL_CAPACITY = 64


class InputChange(NamedTuple):
    """From `stamp` [ns] on, a column of the input (of a module J_EQ [W] or T_E [K]) has the value."""

    stamp: int
    column: int
    value: float


class LiveModel:
    """The model from rest at `begin` [ns] on, in fixed steps of 1/rate, under the `first` input (J_eq [W], T_E [K]).

    The input of another structure is what is imposed, its commands and T_E.

    Raises SimulationError when there is no start.
    """

    def __init__(self, model: Model, rate: float, begin: int, first: Sequence[float]) -> None:
        self.begin, self.first, self._rate = begin, tuple(first), rate
        self._u = np.array(first, dtype=float)
        at_rest = self._u.copy()
        at_rest[len(model.structure.drives) : -1] = 0.0
        self._run = FixedRateRun(model, rate, at_rest)
        self._row = self._run.sample[None, :].copy()

    def advance(self, stamp: int, changes: Sequence[InputChange]) -> Vector:
        """Go on to the step nearest to `stamp` [ns] under `changes` in their order; the prediction there (SAMPLE_SIZE,).

        A change takes effect at the first step that begins with it or later; one that comes late, now.
        Raises SimulationError when a step cannot be made.
        """
        done = self._run.k
        inputs = np.tile(self._u, (max(0, round((stamp - self.begin) * self._rate / 1e9) - done), 1))
        first = first_steps(np.array([change.stamp - self.begin for change in changes]) / 1e9, self._rate) - done
        for change, begin in zip(changes, np.maximum(first, 0), strict=True):
            inputs[begin:, change.column] = change.value
            self._u[change.column] = change.value
        if len(inputs):
            self._run.advance(inputs, done + len(inputs), self._row)
            self._run.take_jumps()
        row: Vector = self._row[0]
        return row


class ComparedSample(NamedTuple):
    """A measurement at `stamp` [ns], (n,) in SI units, and what changed of the input since the one before it."""

    stamp: int
    changes: Sequence[InputChange]
    measured: Vector


class LiveHistory:
    """What a live model was compared with in the last `span` seconds, so that another one can be put beside the same.

    Call `start` where a model starts from rest under its `first` input, then `add` with every measurement.
    """

    def __init__(self, span: float) -> None:
        self._span = round(span * 1e9)
        self.start(0, ())

    def start(self, begin: int, first: Sequence[float]) -> None:
        """Forget all: a model starts at `begin` [ns]."""
        self._begin, self._first = begin, list(first)
        self._samples: deque[ComparedSample] = deque()

    def add(self, sample: ComparedSample) -> None:
        """Take a measurement; what is older than the span is forgotten."""
        self._samples.append(sample)
        while sample.stamp - self._samples[0].stamp > self._span:
            oldest = self._samples.popleft()
            self._begin = oldest.stamp
            for change in oldest.changes:
                self._first[change.column] = change.value

    def set_first(self, column: int, value: float) -> None:
        """Another first value of a column of the input."""
        if self._first:
            self._first[column] = value

    def beside(self, model: Model, rate: float) -> tuple[LiveModel, list[tuple[ComparedSample, Vector]]]:
        """Another model from rest at the beginning of what is known until now; the samples with its predictions there.

        Raises SimulationError where it cannot be run.
        """
        live = LiveModel(model, rate, self._begin, self._first)
        return live, [(sample, live.advance(sample.stamp, sample.changes).copy()) for sample in self._samples]


class RunningError:
    """Root mean square of residual/noise, channel by channel, over the last `window` seconds."""

    def __init__(self, window: float, channels: int) -> None:
        self._window = window
        self._rows = np.empty((INITIAL_CAPACITY, 1 + channels))
        self._first = self._last = 0

    def clear(self) -> None:
        """Forget all."""
        self._first = self._last = 0

    def add(self, t: float, ratio: Vector) -> Vector:
        """Take residual/noise (n,), NaN where nothing was measured, at time t [s], which increases; the error (n,)."""
        if self._last == len(self._rows):
            kept = self._rows[self._first : self._last]
            rows = np.empty((2 * len(kept) + INITIAL_CAPACITY, self._rows.shape[1]))
            rows[: len(kept)] = kept
            self._rows, self._first, self._last = rows, 0, len(kept)
        self._rows[self._last, 0] = t
        with np.errstate(over='ignore'):
            self._rows[self._last, 1:] = ratio**2
        self._last += 1
        while self._rows[self._first, 0] <= t - self._window:
            self._first += 1
        squares = self._rows[self._first : self._last, 1:]
        there = ~np.isnan(squares)
        sums, counts = np.where(there, squares, 0.0).sum(axis=0), there.sum(axis=0)
        error: Vector = np.sqrt(np.where(counts > 0, sums, np.nan) / np.maximum(counts, 1))
        return error


class Announcements:
    """What is worth a line in a log: that the model follows, has left (once in `period` seconds), and is back.

    Channels may leave one after another, or leave and come back all the time: no line is sooner than a period after the last
    one of its kind.
    """

    def __init__(self, period: float) -> None:
        self._period, self._said, self._not_before = period, '', -math.inf

    def restart(self) -> None:
        """The model restarts: that it follows is worth a line again."""
        self._said = ''

    def due(self, now: float, has_left: bool, follows: bool) -> str:
        """``'left'``, ``'follows'``, ``'back'``, or nothing that is due at `now` [s]."""
        if has_left and now >= self._not_before:
            self._said, self._not_before = 'left', now + self._period
            return 'left'
        if has_left or not follows or self._said == 'follows':
            return ''
        before, self._said = self._said, 'follows'
        return 'back' if before == 'left' else 'follows'


class DepartureDetector:
    """The channels that the model has left: their running error was above `threshold` for more than `window` seconds.

    A single outlier raises the running error for one window at the most, and so never tells that the model has left. A
    channel that is not measured any more stays as it was: nothing tells that the model is back.
    """

    def __init__(self, threshold: float, window: float, channels: int) -> None:
        self._threshold, self._window = threshold, window
        self._since = np.full(channels, np.nan)
        self.left = np.zeros(channels, dtype=bool)

    def update(self, t: float, error: Vector) -> None:
        """Take the running error (n,) at time t [s]; a channel is back once it is not above the threshold."""
        above, unknown = error > self._threshold, np.isnan(error)
        since = np.where(above, np.where(np.isnan(self._since), t, self._since), np.nan)
        self._since = np.where(unknown & self.left, self._since, since)
        self.left = np.where(unknown, self.left, above & (t - since > self._window))
