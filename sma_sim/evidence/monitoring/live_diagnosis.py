"""What has changed while a robot runs, since when, and how probable it is: the score of a diagnosis over the last minutes.

The parameters of the model are known as a fit has left them, else as the observer takes them to be known
(`state_estimation.uncertain`): z ~ N(0, C). While z and white noise explain the first minutes, the z that explain most are
taken for those of the robot; what is not known of them then makes residuals correlated, with the covariance 1 + T C T' of
the tangents T, and all that follows is in rows in which they are white. Without this a model that is some per cent off, as
all are, would differ from its robot from the first minute on.

Each cause (`causes`) begins at an instant t, from the state that the model has then, with amounts a of its d parameters, in
steps: a_i ~ N(0, A^2), t anywhere, with one change in MEAN_TIME. With the residuals r of the model, the response f(a, t) to
the cause and the derivatives J of f in both (all over noise), the score is that of `sma_sim.evidence.search.score` where the
cause explains most,

    log p = -|r - f|^2/(2 k^2) - |a|^2/(2 A^2) - log det(J^T J/k^2 + P)/2 - d log A + log(2 pi)/2 - log MEAN_TIME
            + log prior,

with the inverse variances P of the priors and the overdispersion k of what the best cause leaves after it began: where no
law is quite that of the robot, what is left is correlated and larger than noise, and its squares say less. A cause whose
instant and amounts must be just so is discounted for it. Linear responses say where to start; the causes that lead are
fitted by Levenberg and Marquardt's method, since a change that is large beside the noise is told by how its response bends.
The prior of a change is shared by all causes.
Something that is not listed is smooth functions of time in channels, instead of a cause or beside one. Where it is probable
beside a cause, whose law is then not that of the robot, it has the part of its probability by which the deviation is left.
Against nothing a change counts with all that explains it, undiscounted.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np
from scipy.special import expit

from sma_sim.evidence.monitoring.causes import LOST_WIRES, ROOM, Cause, one_way_each
from sma_sim.evidence.monitoring.deciding_command import ChangedModel, DecidingCommand, deciding_command
from sma_sim.evidence.monitoring.live_criteria import (
    AMOUNT,
    BIN,
    CALIBRATIONS,
    CHANGE,
    DAMPED,
    DAMPING,
    DECREASE,
    EARLIER,
    FEW_INSTANTS,
    INSTANTS,
    MAX_AMOUNT,
    MAX_DAMPING,
    MEAN_TIME,
    MOVED,
    ONSET_STD,
    PARAMETER_STEP,
    PROBED,
    REFINED,
    REFINEMENTS,
    SHORTEST,
    SKETCHED,
    SKETCHES,
    STEP,
    UNSEEN,
)
from sma_sim.evidence.monitoring.live_model import ComparedSample
from sma_sim.evidence.monitoring.past import Past, Prior, Track, Window
from sma_sim.evidence.search.prior import SPARSITY, UNLISTED
from sma_sim.evidence.search.refine import TIE
from sma_sim.evidence.state_estimation.uncertain import configured, prior_correlation, uncertain_parameters
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.config import Config
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import SimulationError

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
    def is_explained(self) -> bool:
        """Whether nothing is left beside the model with other values of what is not known of its parameters."""
        return self.log_odds == -math.inf

    @property
    def is_of_robot(self) -> bool:
        """Whether the robot has changed, and not only the room that it is in."""
        return self.has_changed and self.findings[0].name != ROOM

    def as_data(self) -> dict[str, Any]:
        """As plain data: stamps in seconds."""
        return {
            'stamp': self.stamp / 1e9,
            'since': None if self.since is None else self.since / 1e9,
            'changed': self.has_changed,
            'log_odds': self.log_odds,
            'error': self.error,
            'left': self.left,
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


@dataclass(frozen=True)
class Comparison:
    """A part of the past beside the model whose parameters what was before has told, as far as it has.

    `base` (N,): what the model shows; `residuals` (N,): what it leaves. What is not known of the parameters makes the
    residuals correlated, with the covariance 1 + T' T of rank P; `directions` (N, P) and `shrinks` (P,) make them white.
    """

    window: Window
    base: Vector
    residuals: Vector
    directions: Matrix
    shrinks: Vector

    @staticmethod
    def of(window: Window, base: Vector, precision: Matrix) -> Comparison:
        """A part of the past; `precision` (P, P) of the parameters before it."""
        spread = np.linalg.solve(np.linalg.cholesky(precision), window.tangents)
        directions, sizes, _ = np.linalg.svd(spread.T, full_matrices=False)
        white = Comparison(window, base, np.zeros(0), directions, 1.0 - 1.0 / np.sqrt(1.0 + sizes**2))
        return replace(white, residuals=white.whitened(window.residuals))

    def whitened(self, rows: Vector) -> Vector:
        """Rows (N,) as white noise is."""
        return rows - self.directions @ (self.shrinks * (self.directions.T @ rows))

    def response(self, model: Model, nominal: Model, noise: Vector, warmer: float, onset: float) -> Vector | None:
        """By how much more a model shows that takes the place of the nominal one; None where it cannot be run."""
        shown = self.window.shown(model, nominal, noise, warmer, onset)
        return None if shown is None else self.whitened(shown - self.base)

    def overdispersion(self, one: FittedCause) -> float:
        """By how much less than white noise what a cause leaves says, after it began (`estimation.overdispersion`)."""
        return self.window.overdispersion(one.left, self.window.begin + one.onset)

    def share_left(self, one: FittedCause) -> float:
        """Which part of the deviation (root mean square beyond noise) a cause leaves."""
        squares, left, noise = float(self.residuals @ self.residuals), float(one.left @ one.left), len(one.left)
        return math.sqrt(max(left - noise, 0.0) / max(squares - noise, left - noise, 1.0))


@dataclass(frozen=True)
class FittedCause:
    """A cause at the amounts, in steps, at which it explains most; residuals `left` (N,), `responses` (d + 1, N): their
    derivatives in the amounts and the instant; `onset` [s] after the beginning of what is looked at."""

    cause: Cause
    steps: Mapping[str, float]
    amounts: Vector
    left: Vector
    responses: Matrix
    onset: float

    def with_shapes(self) -> FittedCause:
        """The same, with the shapes of its law among what is fitted, in the middle of what is realistic if they were not."""
        new = {name: step for name, step in self.cause.shapes.items() if name not in self.steps}
        none = np.zeros((len(new), len(self.left)))
        responses = np.concatenate([self.responses[:-1], none, self.responses[-1:]])  # of the instant last
        amounts = np.concatenate([self.amounts, np.zeros(len(new))])
        return replace(self, steps={**self.steps, **new}, amounts=amounts, responses=responses)

    def within(self, amounts: Vector) -> Vector:
        """Amounts as far as they may go: strengths one way, shapes either."""
        return np.clip(amounts, [-MAX_AMOUNT if name in self.cause.shapes else 0.0 for name in self.steps], MAX_AMOUNT)

    @property
    def cost(self) -> float:
        """Minus the log posterior of amounts and instant."""
        return 0.5 * (float(self.left @ self.left) + float(self.amounts @ self.amounts) / AMOUNT**2)

    def precision(self, weight: float = 1.0) -> Matrix:
        """Inverse covariance of amounts and instant; `weight` of squares."""
        prior = np.diag([*np.full(len(self.amounts), AMOUNT**-2), ONSET_STD**-2])
        return weight * self.responses @ self.responses.T + prior

    def score(self, weight: float = 1.0) -> float:
        """The log posterior, but for the prior of the cause; `weight` of squares."""
        occam = float(np.linalg.slogdet(self.precision(weight))[1]) + 2.0 * len(self.amounts) * math.log(AMOUNT)
        discounted = 0.5 * (1.0 - weight) * float(self.left @ self.left)
        return discounted - self.cost - 0.5 * (occam - math.log(2.0 * math.pi)) - math.log(MEAN_TIME)

    @property
    def by_parameter(self) -> dict[str, float]:
        """The amounts (SI, from neutral)."""
        return scaled(self.steps, self.amounts)


class LiveDiagnosis:
    """The causes beside a robot: `add` takes comparisons as they come, `evaluate`, in a thread of its own, judges them.

    `noise` (channels,): standard deviations in SI units.
    """

    def __init__(self, config: Config, causes: Sequence[Cause], noise: Vector) -> None:
        self._nominal, self._causes, self._noise = config, tuple(causes), noise
        self._free = uncertain_parameters(config)
        self._precision: Matrix = np.asarray(np.linalg.inv(prior_correlation(config, self._free)), dtype=np.float64)
        self._lock = threading.Lock()
        self.start(0, ())

    def start(self, begin: int, first: Sequence[float]) -> None:
        """Forget all: the model starts from rest at `begin` [ns] under its `first` input."""
        with self._lock:
            self._begin, self._past = begin, Past(first, len(self._noise))
            self._leading: tuple[Comparison, tuple[FittedCause, ...]] | None = None
            self._follow(np.zeros(len(self._free)))

    def _follow(self, z: Vector, track: Track | None = None) -> None:
        """Take the parameters at coordinates z (P,) for those of the robot from now on."""
        self._z: Vector = z
        self._config = configured(self._nominal, self._free, z)
        self._track = self._tracked(z) if track is None else track
        self._model, self._probes = self._track.base, dict[tuple[str, str, float], Model]()

    def _tracked(self, z: Vector) -> Track:
        """A track of the model with the parameters at coordinates z (P,), not started yet."""
        points = [z, *(z + PARAMETER_STEP * np.eye(len(z)))]
        base, *moved = (Model(configured(self._nominal, self._free, one)) for one in points)
        return Track(base, Model(self._nominal), moved, PARAMETER_STEP, self._noise)

    def add(self, sample: ComparedSample, predicted: Vector, judged: bool) -> None:
        """Take a measurement beside its prediction (channels,); one that is not `judged` counts for the input alone."""
        changes = [((change.stamp - self._begin) / 1e9, change.column, change.value) for change in sample.changes]
        ratio = (sample.measured - predicted) / self._noise if judged else np.full(len(self._noise), np.nan)
        with self._lock:
            self._past.add((sample.stamp - self._begin) / 1e9, changes, ratio)

    def evaluate(self, is_stopped: Callable[[], bool] = lambda: False) -> LiveFinding | None:
        """What the past says; None while there is too little of it, when the model cannot be run, or once it is stopped."""
        with self._lock:
            past, begin, heard = self._past, self._begin, self._past.window()
        if heard is None:
            return None
        try:
            window = self._beside_calibrated(past, heard)
        except SimulationError:
            return None
        with self._lock:
            past.trim(self._track.trim())
        now = begin + round(1e9 * window.end)
        prior = Prior(self._precision, self._z)
        if window.explained(prior).smooth_evidence() <= 0.0:
            self._leading = None
            return LiveFinding(now, None, (self._named(None, NOTHING, 1.0),), -math.inf, window.error, window.error)
        shows, onset = window.onset(prior), window.onset(prior, UNLISTED - CHANGE)
        if window.end < onset + STEP + BIN * SHORTEST:
            return None
        found, start = None, shows - EARLIER
        if leading := self._leading:
            start = min(start, leading[0].window.begin)
        while not is_stopped():
            first, state = self._track.state_at(max(window.begin, start))
            z, precision = window.before(first).told(prior)
            part = window.since(first, state).without(shows, shows + STEP).moved(z)
            base = part.shown(self._model, self._model, self._noise)
            if base is None:
                return None
            beside = Comparison.of(part, base, precision)
            found = self._compared(beside, onset - first, now, begin + round(1e9 * first), is_stopped)
            if first <= window.begin or not self._begins_at_limit():
                break
            start -= shows - start
        return found

    def _begins_at_limit(self) -> bool:
        """Whether the most probable cause starts with the samples of the last evaluation: it may have started before."""
        _, fitted = self._leading or ((), ())
        return any(one.onset <= 0.0 for one in fitted[:1])

    def _beside_calibrated(self, past: Past, heard: Window) -> Window:
        """What is left beside the model with the parameters that the first minutes tell, where these and noise explain
        everything; else beside the model as before. Raises SimulationError."""
        window, z = self._track.advance(heard), self._z
        found = window
        for _ in range(CALIBRATIONS if heard.begin == 0.0 else 0):
            told: Vector = z + found.told(Prior(self._precision, z))[0]
            told = np.clip(told, [one.low for one in self._free], [one.high for one in self._free])
            moved, z = float(np.abs(told - z).max(initial=0.0)), told
            if moved < PARAMETER_STEP:
                return window
            track = self._tracked(z)
            found = track.advance(heard)
            if found.explained(Prior(self._precision, z)).smooth_evidence() <= 0.0:
                with self._lock:
                    if past is self._past:
                        self._follow(z, track)
                return found
        return window

    def _compared(
        self, part: Comparison, onset: float, now: int, begin: int, is_stopped: Callable[[], bool]
    ) -> LiveFinding | None:
        """The causes that begin up to `onset` s after a part of the past does, at `begin` [ns], by probability."""
        fitted, again = list[FittedCause](), self._fitted_before(part, onset + STEP)
        for cause in self._causes:
            if is_stopped():
                return None
            fitted += self._started(part, cause, onset)
        for kept, instants in ((len(fitted), FEW_INSTANTS), (SKETCHED, INSTANTS)):
            fitted = [self._from_best_instant(part, one, instants) for one in fitted[:kept]]
            fitted.sort(key=lambda one: -one.score())
        starts, latest = [*fitted[:SKETCHED], *again], onset + STEP
        fitted = best_of_each([self._converged(part, one, latest, SKETCHES) for one in starts if not is_stopped()])
        starts = [one.with_shapes() for one in fitted[:REFINED]]
        fitted = best_of_each([self._converged(part, one, latest, REFINEMENTS) for one in starts if not is_stopped()])
        if is_stopped():
            return None
        k = part.overdispersion(max(fitted, key=FittedCause.score)) if fitted else 1.0
        fitted.sort(key=lambda one: -one.score(k**-2))
        self._leading = part, tuple(fitted)
        probabilities, log_odds = self._probabilities(part, fitted, k)
        names = [NOTHING, NOT_LISTED, *(one.cause.name for one in fitted)]
        findings = [
            self._named(one, name, probability)
            for one, name, probability in zip([None, None, *fitted], names, probabilities.tolist(), strict=True)
        ]
        findings.sort(key=lambda one: -one.probability)
        best = fitted[0] if fitted else None
        return LiveFinding(
            now,
            begin + round(1e9 * (onset if best is None else best.onset)),
            tuple(findings),
            log_odds,
            part.window.error_of(part.residuals),
            part.window.error_of(part.residuals if best is None else best.left),
        )

    def _fitted_before(self, part: Comparison, latest: float) -> list[FittedCause]:
        """The causes of the last evaluation from where they lay then, which begin until `latest` [s]: when there was less to
        explain, the way into the right valley may have been shorter."""
        before, fitted = self._leading or (part, ())
        later = before.window.begin - part.window.begin
        moved = [(one, min(max(one.onset + later, 0.0), latest)) for one in fitted]
        found = [self._linear(part, self._at(part, one, one.amounts, onset), latest) for one, onset in moved]
        return [one for one in found if one is not None]

    def _probabilities(self, part: Comparison, fitted: Sequence[FittedCause], k: float) -> tuple[Vector, float]:
        """Probabilities of nothing, of what is not listed, and of every cause (2 + c,) under an overdispersion k; log odds
        of a change."""
        smooth, prior = part.window.smooth_evidence, -math.log(len(self._causes))
        nothing = -0.5 * float(part.residuals @ part.residuals)
        alone = np.array([one.score() for one in fitted]) + prior
        beside = np.array([smooth(one.left) for one in fitted]) - UNLISTED - SPARSITY
        any_cause = np.logaddexp.reduce(np.logaddexp(alone, alone + beside))
        scores = np.array([nothing, nothing + smooth(part.residuals) + CHANGE - UNLISTED, any_cause])
        weights = np.exp(scores - scores.max()) / np.exp(scores - scores.max()).sum()
        discounted = np.array([one.score(k**-2) for one in fitted])
        by_cause = weights[2] * np.exp(discounted - np.logaddexp.reduce(discounted))
        unlisted = by_cause * expit(beside) * np.array([part.share_left(one) for one in fitted])
        found = np.array([weights[0], weights[1] + unlisted.sum(), *(by_cause - unlisted)])
        return found, float(np.logaddexp.reduce(scores[1:])) - nothing

    def deciding_command(self, most: Sequence[float]) -> DecidingCommand | None:
        """The shortest command that tells the two leading causes of the last evaluation apart; None where there are not two.

        `most`: the largest power of each command [W]; negative ones too, where commands have a sign.
        """
        if self._leading is None or len(self._leading[1]) < 2:
            return None
        part, (first, second, *_) = self._leading
        causes = self._changed(first), self._changed(second)
        return deciding_command(part.window, self._model, causes, self._noise, most)

    def _changed(self, one: FittedCause) -> ChangedModel:
        values = one.by_parameter
        return ChangedModel(
            one.cause.name, Model(one.cause.in_config(self._config, values)), one.cause.ambient(values), one.onset
        )

    def _started(self, part: Comparison, cause: Cause, onset: float) -> list[FittedCause]:
        """A cause where it explains most of some amounts of each parameter, and of those to which linear responses point;
        none where no channel sees it. Wires have hysteresis: a small change may show nothing of a large one."""
        linear, found = dict[str, dict[float, Vector]](), list[FittedCause]()
        for name, steps in cause.steps.items():
            for step, amount in product(steps, PROBED):
                probe, warmer = self._probe(cause, name, amount * step), cause.ambient({name: amount * step})
                response = part.response(probe, self._model, self._noise, warmer, onset)
                if response is None or float(response @ response) <= UNSEEN:
                    continue
                linear.setdefault(name, {}).setdefault(step, response / amount)
                row = np.vstack([response / amount, np.zeros(len(response))])
                found.append(FittedCause(cause, {name: step}, np.array([amount]), part.residuals - response, row, onset))
        for chosen in one_way_each({name: tuple(by_step) for name, by_step in linear.items()}):
            s = np.array([linear[name][step] for name, step in chosen.items()])
            amounts = np.linalg.solve(s @ s.T + np.eye(len(s)) / AMOUNT**2, s @ part.residuals)
            if (amounts > 0.0).all():
                rows = np.vstack([s, np.zeros(s.shape[1])])
                start = FittedCause(cause, chosen, amounts, part.residuals, rows, onset)
                pointed = self._at(part, start, np.minimum(amounts, MAX_AMOUNT), onset)
                found += [] if pointed is None else [pointed]
        return sorted(found, key=lambda one: -one.score())[:1]

    def _named(self, one: FittedCause | None, name: str, probability: float) -> CauseFinding:
        """A cause, nothing, or what is not listed, with its probability."""
        if one is None:
            return CauseFinding(name, 'nothing' if name == NOTHING else 'something that is not listed', probability)
        values = one.cause.values(self._config, one.by_parameter)
        return CauseFinding(name, one.cause.words, probability, values, bool(values) and name != LOST_WIRES.name)

    def _probe(self, cause: Cause, name: str, step: float) -> Model:
        """The model with a cause at one step; kept, since every evaluation needs it."""
        key = cause.name, name, step
        if key not in self._probes:
            self._probes[key] = Model(cause.in_config(self._config, {name: step}))
        return self._probes[key]

    def _from_best_instant(self, part: Comparison, start: FittedCause, instants: int) -> FittedCause:
        """A cause from that of some instants, not later than where it is, from which so many times its amounts explain most.

        The cost has a valley between any two commands, so that instants close to each other have to be looked at.
        """
        best, scale, least = start.onset, 1.0, start.cost
        weight = float(start.amounts @ start.amounts) / AMOUNT**2
        for onset in np.linspace(0.0, start.onset, instants).tolist():
            tried = self._at(part, start, start.amounts, onset)
            if tried is None:
                continue
            response = part.residuals - tried.left
            along = float(response @ part.residuals) / (float(response @ response) + weight)
            left = part.residuals - along * response
            cost = 0.5 * (float(left @ left) + along**2 * weight)
            if along > 0.0 and cost < least:
                best, scale, least = tried.onset, along, cost
        amounts = np.clip(scale * start.amounts, 0.0, MAX_AMOUNT)
        found = self._at(part, start, amounts, best)
        return start if found is None or found.cost > start.cost else found

    def _converged(self, part: Comparison, start: FittedCause, latest: float, steps: int) -> FittedCause:
        """A cause that begins until `latest` [s], fitted in at most so many steps; itself where it cannot be run."""
        best = self._linear(part, self._at(part, start, start.amounts, start.onset), latest)
        damping = DAMPING
        for _ in range(steps if best is not None else 0):
            assert best is not None
            gradient = best.responses @ best.left - np.append(best.amounts / AMOUNT**2, 0.0)
            precision = best.precision()
            while damping <= MAX_DAMPING:
                step = np.linalg.solve(precision + damping * np.diag(np.diag(precision)), gradient)
                amounts = best.within(best.amounts + step[:-1])
                onset = min(max(best.onset + float(step[-1]), 0.0), latest)
                tried = self._at(part, best, amounts, onset)
                if tried is not None and tried.cost < best.cost:
                    break
                damping *= DAMPED
            else:
                break
            decrease, damping = best.cost - tried.cost, damping / DAMPED
            best = self._linear(part, tried, latest)
            if decrease < DECREASE:
                break
        return start if best is None else best

    def _at(self, part: Comparison, one: FittedCause, amounts: Vector, onset: float) -> FittedCause | None:
        """A cause at other amounts and another instant, with the responses that it had; None where it cannot be run."""
        values = scaled(one.steps, amounts)
        model = Model(one.cause.in_config(self._config, values))
        response = part.response(model, self._model, self._noise, one.cause.ambient(values), onset)
        return None if response is None else replace(one, amounts=amounts, left=part.residuals - response, onset=onset)

    def _linear(self, part: Comparison, one: FittedCause | None, latest: float) -> FittedCause | None:
        """A cause with the derivatives of its response where it is."""
        if one is None:
            return None
        rows = np.zeros((len(one.amounts) + 1, len(one.left)))
        later = BIN if one.onset + BIN <= latest else -BIN
        for j, moved in enumerate([*np.full(len(one.amounts), MOVED), later]):
            amounts, is_onset = one.amounts.copy(), j == len(one.amounts)
            if not is_onset:
                amounts[j] += moved
            beside = self._at(part, one, amounts, one.onset + moved * is_onset)
            if beside is not None:
                rows[j] = (one.left - beside.left) / moved
        return replace(one, responses=rows)


def best_of_each(fitted: Sequence[FittedCause]) -> list[FittedCause]:
    """Of several fits of each cause the best, by score."""
    found = dict[str, FittedCause]()
    for one in sorted(fitted, key=lambda one: -one.score()):
        found.setdefault(one.cause.name, one)
    return [*found.values()]


def scaled(steps: Mapping[str, float], amounts: Vector) -> dict[str, float]:
    """Amounts in steps by parameter, in SI units."""
    return {name: float(amount) * step for (name, step), amount in zip(steps.items(), amounts, strict=True)}
