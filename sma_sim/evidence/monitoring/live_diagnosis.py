"""What has changed while a robot runs, since when, and how probable it is: the score of a diagnosis over the last minutes.

The model runs from what it knows of the robot. Each cause (`causes`) begins at an instant, from the state that the model has
then. With the residuals r of the model since the instant, and the responses s_i to steps of the cause (all over noise),

    log p = -|r - sum a_i s_i|^2/2 - sum a_i^2/(2 A^2) - log det(1 + A^2 s s^T)/2 + log prior

is the score of `sma_sim.evidence.search.score` for amounts a_i ~ N(0, A^2). The causes that lead are simulated at their
amounts, so that the response need not be linear. The prior of a change is that of one in MEAN_TIME, shared by all causes.
Something that is not listed is smooth functions of time in channels; it may be there instead of a cause, or beside one whose
law is not quite that of the robot.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.monitoring.causes import ROOM, Cause, one_way_each
from sma_sim.evidence.monitoring.deciding_command import ChangedModel, DecidingCommand, deciding_command
from sma_sim.evidence.monitoring.live_model import ComparedSample
from sma_sim.evidence.monitoring.past import BIN, CHECKPOINT, SHORTEST, STEP, Past, Window
from sma_sim.evidence.search.posterior import TIE
from sma_sim.evidence.search.score import SPARSITY, UNLISTED
from sma_sim.model.config import Config
from sma_sim.model.effects.discovery import package_effects
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

MEAN_TIME = 86_400.0  # [s] between two changes of a robot, beforehand
AMOUNT = 2.0  # standard deviation of an amount, in steps: these are a third of what is realistic
REFINED = 4  # causes that are simulated at their amounts
REFINEMENTS = 2  # times that they are
EARLIER = (-STEP, 0.0, STEP, 2.0 * STEP, 4.0 * STEP, 8.0 * STEP)  # [s] than it shows, that a change may begin
FINEST = 0.1  # [s] to which the instant of a cause is found
UNSEEN = 0.01  # sum of the squares of a response to a step below which it tells nothing, in units of the noise
NOTHING, NOT_LISTED = 'nothing', 'not listed'


@dataclass(frozen=True)
class CauseFinding:
    """A cause with its probability, and `values` of the parameters by full name at which it explains most (SI).

    `is_listed`: whether it is an effect or a parameter that a configuration can have.
    """

    name: str
    words: str
    probability: float
    values: Mapping[str, float] = field(default_factory=dict)
    is_listed: bool = False


@dataclass(frozen=True)
class LiveFinding:
    """What is known at `stamp` [ns].

    `since` [ns]: when the change began; None where nothing has changed. `findings`: the most probable first;
    `log_odds` of a change against none; `error`: of the model since then over noise, and `left` by the best cause.
    """

    stamp: int
    since: int | None
    findings: tuple[CauseFinding, ...]
    log_odds: float
    error: float
    left: float

    @property
    def has_changed(self) -> bool:
        """Whether that something has changed is beyond what ties (`TIE`)."""
        return self.log_odds > TIE

    @property
    def is_of_robot(self) -> bool:
        """Whether the robot has changed, and not only the room that it is in."""
        return self.has_changed and self.findings[0].name != ROOM

    def as_data(self) -> dict[str, Any]:
        """For JSON: stamps in seconds."""
        return {
            'stamp': self.stamp / 1e9,
            'since': None if self.since is None else self.since / 1e9,
            'changed': self.has_changed,
            'log_odds': self.log_odds,
            'error': finite_or_none(self.error),
            'left': finite_or_none(self.left),
            'probabilities': {one.name: one.probability for one in self.findings},
            'causes': [asdict(one) for one in self.findings],
        }

    def __str__(self) -> str:
        first = self.findings[0]
        if not self.has_changed or self.since is None:
            return 'nothing has changed that shows'
        likely = [one for one in self.findings if one.probability > math.exp(-TIE) * first.probability]
        said = ' or '.join(f'{one.words} ({100.0 * one.probability:.0f} %)' for one in likely if one.name != NOTHING)
        ago = (self.stamp - self.since) / 1e9
        errors = f'normalized RMSE of {BIN:g} s means {self.error:.2f}, {self.left:.2f} with it'
        return f'changed since about {ago:.0f} s: {said}; {errors}'


def finite_or_none(value: float) -> float | None:
    """A number for JSON."""
    return value if math.isfinite(value) else None


@dataclass(frozen=True)
class FittedCause:
    """A cause at the amounts, in steps, at which it explains most; residuals `left` (N,), `gram` of its
    responses; `onset` [s] after the beginning of what is looked at."""

    cause: Cause
    steps: Mapping[str, float]
    amounts: Vector
    left: Vector
    gram: Matrix
    onset: float

    def score(self) -> float:
        """The log posterior, but for the prior of the cause."""
        occam = float(np.linalg.slogdet(np.eye(len(self.gram)) + AMOUNT**2 * self.gram)[1])
        return -0.5 * (float(self.left @ self.left) + float(self.amounts @ self.amounts) / AMOUNT**2 + occam)

    @property
    def by_parameter(self) -> dict[str, float]:
        """The amounts (SI, from neutral)."""
        return scaled(self.steps, self.amounts)


class LiveDiagnosis:
    """The causes beside a robot: `add` takes comparisons as they come, `evaluate`, in a thread of its own, judges them.

    `noise` (channels,): standard deviations in SI units.
    """

    def __init__(self, config: Config, causes: Sequence[Cause], noise: Vector) -> None:
        self._config, self._causes, self._noise = config, tuple(causes), noise
        self._model, self._probes = Model(config), dict[tuple[str, str, float], Model]()
        self._lock = threading.Lock()
        self._leading: tuple[Window, tuple[FittedCause, ...]] | None = None
        self.start(0, ())

    def start(self, begin: int, first: Sequence[float]) -> None:
        """Forget all: the model starts from rest at `begin` [ns] under its `first` input."""
        with self._lock:
            self._begin, self._past, self._leading = begin, Past(first, len(self._noise)), None

    def add(self, sample: ComparedSample, predicted: Vector, judged: bool) -> None:
        """Take a measurement beside its prediction (channels,); one that is not `judged` counts for the input alone."""
        changes = [((change.stamp - self._begin) / 1e9, change.column, change.value) for change in sample.changes]
        ratio = (sample.measured - predicted) / self._noise if judged else np.full(len(self._noise), np.nan)
        with self._lock:
            self._past.add((sample.stamp - self._begin) / 1e9, changes, ratio)

    def evaluate(self, is_stopped: Callable[[], bool] = lambda: False) -> LiveFinding | None:
        """What the past says; None while there is too little of it, when the model cannot be run, or once it is stopped."""
        with self._lock:
            past, begin, window = self._past, self._begin, self._past.window()
        if window is None:
            return None
        try:
            past.advance(window, self._model)
        except SimulationError:
            return None
        with self._lock:
            past.trim()
        now = begin + round(1e9 * window.end)
        if window.smooth_evidence() <= 0.0:
            return LiveFinding(now, None, (self._named(None, NOTHING, 1.0),), -math.inf, window.error, window.error)
        onset = window.onset()
        if window.end < onset + STEP + BIN * SHORTEST:
            return None
        first, state = past.state_at(max(window.begin, onset - EARLIER[-1]))
        part = window.since(first, state).without(onset, onset + STEP)
        return self._compared(part, onset - first, now, begin + round(1e9 * first), is_stopped)

    def _compared(
        self, part: Window, onset: float, now: int, begin: int, is_stopped: Callable[[], bool]
    ) -> LiveFinding | None:
        """The causes that begin about `onset` s after a part of the past does, at `begin` [ns], by probability."""
        base = part.shown(self._model, self._model, self._noise)
        if base is None:
            return None
        fitted = list[FittedCause]()
        for cause in self._causes:
            if is_stopped():
                return None
            fitted += self._first_order(part, base, cause, max(0.0, onset - STEP))
        fitted.sort(key=lambda one: -one.score())
        fitted = [self._from_its_instant(part, base, one, onset) for one in fitted[:REFINED]]
        fitted.sort(key=lambda one: -one.score())
        self._leading = part, tuple(fitted)
        change = math.log(CHECKPOINT / MEAN_TIME)
        nothing = -0.5 * float(part.residuals @ part.residuals)
        scores = [nothing, nothing + part.smooth_evidence() + change - UNLISTED]
        for one in fitted:  # alone, or with what its law does not have
            beside = np.logaddexp(0.0, part.smooth_evidence(one.left) - UNLISTED - SPARSITY)
            scores.append(one.score() + change - math.log(len(self._causes)) + float(beside))
        weights = np.exp(np.array(scores) - max(scores))
        names = [NOTHING, NOT_LISTED, *(one.cause.name for one in fitted)]
        findings = [
            self._named(one, name, float(weight))
            for one, name, weight in zip([None, None, *fitted], names, weights / weights.sum(), strict=True)
        ]
        findings.sort(key=lambda one: -one.probability)
        best = fitted[0] if fitted else None
        return LiveFinding(
            now,
            begin + round(1e9 * (onset if best is None else best.onset)),
            tuple(findings),
            float(np.logaddexp.reduce(scores[1:])) - nothing,
            part.error,
            part.error if best is None else part.error_of(best.left),
        )

    def deciding_command(self, most: Sequence[float]) -> DecidingCommand | None:
        """The shortest command that tells the two leading causes of the last evaluation apart; None where there are not two.

        `most`: the largest power of each command [W]; negative ones too, where commands have a sign.
        """
        if self._leading is None or len(self._leading[1]) < 2:
            return None
        part, (first, second, *_) = self._leading
        causes = self._changed(first), self._changed(second)
        return deciding_command(part, self._model, causes, self._noise, most)

    def _changed(self, one: FittedCause) -> ChangedModel:
        values = one.by_parameter
        return ChangedModel(
            one.cause.name, Model(one.cause.in_config(self._config, values)), one.cause.ambient(values), one.onset
        )

    def _first_order(self, part: Window, base: Vector, cause: Cause, onset: float) -> list[FittedCause]:
        """A cause where it explains most to first order, one step of each parameter; none where no channel sees it."""
        responses: dict[str, dict[float, Vector]] = {}
        for name, steps in cause.steps.items():
            for step in steps:
                probe, warmer = self._probe(cause, name, step), cause.ambient({name: step})
                shown = part.shown(probe, self._model, self._noise, warmer, onset)
                if shown is not None and float(np.sum((shown - base) ** 2)) > UNSEEN:
                    responses.setdefault(name, {})[step] = shown - base
        found = list[FittedCause]()
        for chosen in one_way_each({name: tuple(by_step) for name, by_step in responses.items()}):
            s = np.array([responses[name][step] for name, step in chosen.items()])
            gram = s @ s.T
            amounts = np.linalg.solve(gram + np.eye(len(s)) / AMOUNT**2, s @ part.residuals)
            if (amounts > 0.0).all():
                found.append(FittedCause(cause, chosen, amounts, part.residuals - amounts @ s, gram, onset))
        return sorted(found, key=lambda one: -one.score())[:1]

    def _named(self, one: FittedCause | None, name: str, probability: float) -> CauseFinding:
        """A cause, nothing, or what is not listed, with its probability."""
        if one is None:
            return CauseFinding(name, 'nothing' if name == NOTHING else 'something that is not listed', probability)
        values = one.cause.values(self._config, one.by_parameter)
        is_listed = name in package_effects() or one.cause.candidate is None and bool(values)
        return CauseFinding(name, one.cause.words, probability, values, is_listed)

    def _probe(self, cause: Cause, name: str, step: float) -> Model:
        """The model with a cause at one step; kept, since every evaluation needs it."""
        key = cause.name, name, step
        if key not in self._probes:
            self._probes[key] = Model(cause.in_config(self._config, {name: step}))
        return self._probes[key]

    def _from_its_instant(self, part: Window, base: Vector, one: FittedCause, onset: float) -> FittedCause:
        """A cause from the instant about `onset` from which it explains most."""
        tried = [self._refined(part, base, one, max(0.0, onset - earlier)) for earlier in EARLIER]
        best = max(tried, key=lambda other: other.score())
        step = 0.5 * STEP
        while step >= FINEST:
            near = [self._refined(part, base, best, max(0.0, best.onset + way)) for way in (-step, step)]
            best = max([best, *near], key=lambda other: other.score())
            step *= 0.5
        return best

    def _refined(self, part: Window, base: Vector, one: FittedCause, onset: float) -> FittedCause:
        """A cause that begins at `onset`, simulated at its amounts and at those to which that points; the better of both."""
        best: FittedCause | None = None
        amounts = one.amounts
        for _ in range(REFINEMENTS):
            values = scaled(one.steps, amounts)
            model = Model(one.cause.in_config(self._config, values))
            shown = part.shown(model, self._model, self._noise, one.cause.ambient(values), onset)
            if shown is None:
                break
            response, left = shown - base, part.residuals - (shown - base)
            size = float(response @ response)
            new = replace(one, amounts=amounts, left=left, onset=onset)
            if best is None or new.score() > best.score():
                best = new
            if size <= UNSEEN or float(response @ part.residuals) <= 0.0:
                break
            amounts = amounts * float(response @ part.residuals) / size
        return one if best is None else best


def scaled(steps: Mapping[str, float], amounts: Vector) -> dict[str, float]:
    """Amounts in steps by parameter, in SI units."""
    return {name: float(amount) * step for (name, step), amount in zip(steps.items(), amounts, strict=True)}
