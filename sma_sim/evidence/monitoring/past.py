"""The last minutes of a robot beside its model: what was commanded, what was left, and the state of the model on the way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.overdispersion import overdispersion_of_rows
from sma_sim.evidence.monitoring.live_criteria import BIN, CHECKPOINT, SHORTEST, SPAN, STEP
from sma_sim.evidence.search.score import unlisted_evidence
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.solver.effect_table import layout, state_scales
from sma_sim.solver.inputs import Input
from sma_sim.solver.integrate import C_TIME, Run
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import SimulationError, channels_of_all, copy_of_run, move_clock, new_run, new_work

MAX_STEPS = 10_000_000  # of a run: no usual one comes near
Change = tuple[float, int, float]  # from when on [s], which column of the input, its value


class Prior(NamedTuple):
    """What is known of parameters beforehand: their precision (P, P), and how far those of the model are from the mean."""

    precision: Matrix
    away: Vector


@dataclass(frozen=True)
class Window:
    """A part of the past. Times [s] are those since the model started.

    `times` (k,): mean of those in every bin; `means` (k, channels): mean of the residuals of a bin over its standard error,
    0 where nothing was measured; `root` (k, channels): of the number of measurements; `first` input and `changes` since
    `begin`; `state`: of the model at the beginning, if it is known; `slopes` (k, P, channels): derivatives of what the model
    shows in its parameters, over the standard errors of the bins.
    """

    begin: float
    times: Vector
    means: Matrix
    root: Matrix
    first: tuple[float, ...]
    changes: tuple[Change, ...]
    slopes: NDArray[np.float64]
    state: Run | None = None

    @property
    def end(self) -> float:
        """The middle of the last bin [s]."""
        return float(self.times[-1])

    @property
    def residuals(self) -> Vector:
        """Of all bins and channels where something was measured, over the noise of their means, (N,)."""
        return self.means[self.root > 0.0]

    @property
    def error(self) -> float:
        """Root mean square of the residuals over their noise."""
        return self.error_of(self.residuals)

    def error_of(self, residuals: Vector) -> float:
        """The same of others (N,)."""
        return math.sqrt(float(residuals @ residuals) / max(1, len(residuals)))

    @property
    def tangents(self) -> Matrix:
        """Derivatives of `residuals` in the parameters, with another sign (P, N)."""
        return np.moveaxis(self.slopes, 1, 0)[:, self.root > 0.0]

    def told(self, prior: Prior) -> tuple[Vector, Matrix]:
        """By how much other parameters (P,) explain most, and their precision (P, P) then."""
        tangents = self.tangents
        precision = prior.precision + tangents @ tangents.T
        away = tangents @ self.residuals - prior.precision @ prior.away
        return np.asarray(np.linalg.solve(precision, away), dtype=np.float64), precision

    def moved(self, z: Vector) -> Window:
        """What is left beside the model at other parameters (P,), to first order."""
        return replace(self, means=self.means - np.einsum('kpc,p->kc', self.slopes, z))

    def explained(self, prior: Prior) -> Window:
        """What is left beside the model at the parameters that explain most."""
        return self.moved(self.told(prior)[0])

    def smooth_evidence(self, residuals: Vector | None = None) -> float:
        """The log Bayes factor of smooth functions of time in some channels beside white noise; of others than `residuals`.

        Each channel has one with probability 1/2.
        """
        rows = self._rows(self.residuals if residuals is None else residuals)
        found = [unlisted_evidence([row[None, :]]) for row in rows.T if row.any()]
        return float(np.sum(np.logaddexp(0.0, found) - math.log(2.0)))

    def overdispersion(self, residuals: Vector, since: float) -> float:
        """k of what is left (N,) after an instant [s] (`estimation.overdispersion`)."""
        later = self.times > since
        rows = [row for row in self._rows(residuals)[later].T if row.any()]
        return overdispersion_of_rows(rows, int(np.count_nonzero(self.root[later])))

    def _rows(self, residuals: Vector) -> Matrix:
        """Residuals (N,) by bin and channel (k, channels), 0 where nothing was measured."""
        rows = np.zeros_like(self.means)
        rows[self.root > 0.0] = residuals
        return rows

    def onset(self, prior: Prior, evidence: float = 0.0) -> float:
        """The last instant, to STEP [s], up to which there is no more `evidence` against parameters and white noise.

        At some instant before it there may have been more, by chance, since there are many: what came then has shown it.
        """
        found, end = self.begin, self.end
        for step in (CHECKPOINT, STEP):
            later = np.arange(found + step, end, step)[::-1].tolist()
            found = next((instant for instant in later if self.is_white_before(instant, prior, evidence)), found)
            end = min(self.end, found + step)
        return found

    def is_white_before(self, instant: float, prior: Prior, evidence: float = 0.0) -> bool:
        """Whether no more `evidence` is against parameters and white noise until an instant [s]; also of too few bins."""
        before = self.before(instant)
        return len(before.times) < SHORTEST or before.explained(prior).smooth_evidence() <= evidence

    def before(self, instant: float) -> Window:
        """What is earlier than an instant [s]."""
        kept = self.times < instant
        return replace(self, times=self.times[kept], means=self.means[kept], root=self.root[kept], slopes=self.slopes[kept])

    def without(self, begin: float, end: float) -> Window:
        """The same but for what was measured in between: a sensor that jumps within a bin shows what it never showed."""
        between = (self.times > begin - BIN) & (self.times < end + BIN)
        root, means, slopes = self.root.copy(), self.means.copy(), self.slopes.copy()
        root[between], means[between], slopes[between] = 0.0, 0.0, 0.0
        return replace(self, root=root, means=means, slopes=slopes)

    def since(self, begin: float, state: Run | None) -> Window:
        """What comes later, with the `state` of the model there."""
        kept, first = self.times > begin, list(self.first)
        for t, column, value in self.changes:
            if t <= begin:
                first[column] = value
        changes = tuple(change for change in self.changes if change[0] > begin)
        return Window(
            begin, self.times[kept], self.means[kept], self.root[kept], tuple(first), changes, self.slopes[kept], state
        )

    def input(self, model: Model, until: float, warmer: float = 0.0) -> Input:
        """The input from the beginning on, which is its time 0; `warmer`: by how much T_E is another one [K]."""
        rows: dict[float, list[float]] = {0.0: list(self.first)}
        now = list(self.first)
        for t, column, value in self.changes:
            if t < until:
                now[column] = value
                rows[max(0.0, t - self.begin)] = list(now)
        rows[until - self.begin] = list(now)
        values = np.array(list(rows.values()))
        values[:, -1] += warmer
        columns = model.structure.input_columns
        return Input(np.array(list(rows)), values, (False,) * len(columns), columns)

    def shown(self, model: Model, base: Model, noise: Vector, warmer: float = 0.0, onset: float = 0.0) -> Vector | None:
        """What a model shows that takes the place of `base` `onset` s after the beginning, over noise, as `residuals` are.

        None where it cannot be run.
        """
        try:
            onset = self.begin + onset - self.begin  # as the input has it, to rounding
            if onset > 0.0:
                early = self.times[self.times - self.begin <= onset] - self.begin
                values, state = sampled(base, self.input(base, self.begin + onset), np.union1d(early, onset), self.state)
                later = self.since(self.begin + onset, shifted(state, onset))
                rest = later.shown(model, base, noise, warmer) if len(later.times) else np.zeros(0)
                return None if rest is None else np.concatenate([self._over_noise(values[: len(early)], noise), rest])
            source = self.input(model, self.end + BIN, warmer)
            start = None if self.state is None else continued(model, base, self.state, np.array(source.values[0]))
            values, _ = sampled(model, source, self.times - self.begin, start)
        except SimulationError:
            return None
        return self._over_noise(values, noise)

    def _over_noise(self, values: Matrix, noise: Vector) -> Vector:
        """What sensors show (k, channels) in the first k bins, over noise, as `residuals`."""
        root = self.root[: len(values)]
        return (values / noise * root)[root > 0.0]


class Past:
    """What is known since a model started, of the last SPAN seconds; not for several threads at once."""

    def __init__(self, first: Sequence[float], channels: int) -> None:
        self._first, self._begin = list(first), 0.0
        self._changes: list[Change] = []
        self._sums: dict[int, Vector] = {}
        self._counts: dict[int, Vector] = {}
        self._moments: dict[int, list[float]] = {}  # sum of the times of a bin, and how many
        self._channels = channels

    def add(self, t: float, changes: Sequence[Change], ratio: Vector) -> None:
        """Take residuals over noise (channels,) at time t [s], NaN where nothing was measured, and what changed before."""
        self._changes += changes
        number, known = int(t / BIN), ~np.isnan(ratio)
        if known.any():
            zero = np.zeros(self._channels)
            moment = self._moments.setdefault(number, [0.0, 0])
            moment[0] += t
            moment[1] += 1
            self._sums[number] = self._sums.get(number, zero) + np.where(known, ratio, 0.0)
            self._counts[number] = self._counts.get(number, zero) + known

    def window(self) -> Window | None:
        """All of it; None where that says nothing."""
        numbers = sorted(self._sums)[:-1]  # the last one is being filled
        if len(numbers) < SHORTEST:
            return None
        counts = np.array([self._counts[number] for number in numbers])
        root = np.sqrt(counts)
        means = np.array([self._sums[number] for number in numbers]) / np.maximum(root, 1.0)
        times = np.array([self._moments[number][0] / self._moments[number][1] for number in numbers])
        none = np.zeros((len(numbers), 0, self._channels))
        return Window(self._begin, times, means, root, tuple(self._first), tuple(sorted(self._changes)), none)

    def trim(self, begin: float) -> None:
        """Forget what is older than an instant [s]."""
        self._begin = begin
        for t, column, value in sorted(self._changes):
            if t <= begin:
                self._first[column] = value
        self._changes = [change for change in self._changes if change[0] > begin]
        for number in [number for number in self._sums if (number + 1) * BIN <= begin]:
            del self._sums[number], self._counts[number], self._moments[number]


class Track:
    """A model on its way along a past, and the models with each parameter moved by `step` in its unit.

    `nominal` is the model that measurements were compared with; `noise` (channels,) in SI units.
    """

    def __init__(self, base: Model, nominal: Model, moved: Sequence[Model], step: float, noise: Vector) -> None:
        self.base, self._nominal, self._moved, self._step, self._noise = base, nominal, tuple(moved), step, noise
        self._states: list[tuple[float, Run | None]] = [(0.0, None)]
        self._beside: list[Run | None] = [None] * (1 + len(self._moved))  # of the nominal and the moved ones, at the last
        self._shown: dict[int, Matrix] = {}  # by bin (1 + P, channels) over noise: more than the nominal, derivatives

    def trim(self) -> float:
        """Forget what is older than SPAN; since when the rest is [s]."""
        begin = next(t for t, _ in self._states if t >= self._states[-1][0] - SPAN)
        self._states = [one for one in self._states if one[0] >= begin]
        self._shown = {number: rows for number, rows in self._shown.items() if (number + 1) * BIN > begin}
        return begin

    def advance(self, window: Window) -> Window:
        """Keep the states of the models on the way to the end of a window, which is returned as it is beside the model
        and with derivatives in the parameters. Raises SimulationError."""
        while self._states[-1][0] + CHECKPOINT <= window.end:
            begin, state = self._states[-1]
            rows, base, self._beside = self._stretch(window, begin + CHECKPOINT)
            self._shown |= rows
            self._states.append((begin + CHECKPOINT, base))
        rows, _, _ = self._stretch(window, window.end + BIN)
        known, none = self._shown | rows, np.zeros((1 + len(self._moved), len(self._noise)))  # none: of a late measurement
        shown = np.array([known.get(number, none) for number in (window.times / BIN).astype(int).tolist()])
        shown = np.where(window.root[:, None, :] > 0.0, shown * window.root[:, None, :], 0.0)
        return replace(window, means=window.means - shown[:, 0], slopes=shown[:, 1:])

    def _stretch(self, window: Window, end: float) -> tuple[dict[int, Matrix], Run, list[Run | None]]:
        """What models show until `end` [s] by bin, and the states of the base and of those beside it then."""
        begin, state = self._states[-1]
        inside = (window.times >= begin) & (window.times < end)
        times, later = window.times[inside] - begin, window.since(begin, state)
        asked = np.union1d(times, end - begin)
        found, states = [], []
        for model, before in zip((self.base, self._nominal, *self._moved), (state, *self._beside), strict=True):
            values, after = sampled(model, later.input(model, end), asked, before)
            found.append(values[: len(times)] / self._noise)
            states.append(shifted(after, end - begin))
        base, nominal, *moved = found
        rows = np.array([base - nominal, *((one - base) / self._step for one in moved)])
        numbers = (window.times[inside] / BIN).astype(int).tolist()
        return dict(zip(numbers, np.moveaxis(rows, 0, 1), strict=True)), states[0], [*states[1:]]

    def state_at(self, instant: float) -> tuple[float, Run | None]:
        """The last instant up to a given one at which the state of the model is known, and that state; None at the start."""
        return next(known for known in reversed(self._states) if known[0] <= instant + 1e-6)


def sampled(model: Model, source: Input, times: Vector, state: Run | None) -> tuple[Matrix, Run]:
    """What the channels of a model show under an input at some times (k,) [s], from a state, (k, channels), and the state
    in which that ends. Raises SimulationError."""
    work = new_work(model)
    run = new_run(model, source.values[0], work) if state is None else copy_of_run(model, state)
    return channels_of_all([model], source, times, model.structure.channels, MAX_STEPS, run, work)[0], run


def shifted(run: Run, by: float) -> Run:
    """A state whose time begins anew, `by` seconds later."""
    control = run.control.copy()
    move_clock(control, control[C_TIME] - by)
    return run._replace(control=control)


def continued(model: Model, base: Model, state: Run, u: Vector) -> Run:
    """The state of `base` as that of a model with further effects, whose own states are as at rest under an input `u`."""
    if model is base:
        return state
    fresh = new_run(model, u, new_work(model))
    y, (place, size), (before, _) = fresh.state.y, places_of_states(model), places_of_states(base)
    first = min([len(state.state.y), *before.values()])
    y[:first] = state.state.y[:first]
    for name, at in before.items():
        y[place[name] : place[name] + size[name]] = state.state.y[at : at + size[name]]
    same = fresh.state._replace(y=y, mode=state.state.mode.copy(), x_frozen=state.state.x_frozen.copy())
    return fresh._replace(state=same)


def places_of_states(model: Model) -> tuple[dict[str, int], dict[str, int]]:
    """By effect of a model that has states of its own, where these begin, and how many they are."""
    active, structure = model.config.effects, model.structure
    first = len(model.scales) - len(model.effects[1])
    order = layout(tuple(one.effect for one in active), model.config.structure, first)
    names = [active[k].effect for k in order.order]
    sizes = {effect.name: len(state_scales(effect, structure)) for effect in names}
    starts = {effect.name: int(at) for effect, at in zip(names, order.fields['state_start'], strict=True)}
    return {name: at for name, at in starts.items() if sizes[name]}, sizes
