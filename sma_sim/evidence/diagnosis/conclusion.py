"""What is made of the models that a search has found: their stages, each with what it leaves of the error, and the verdict.

The held-out runs are read here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isnan, sqrt
from typing import Literal

import numpy as np

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.train_test_split import pooled
from sma_sim.evidence.estimation.calibrate import (
    SAME_OPTIMUM,
    Calibration,
    FitOptions,
    calibration_of,
    final_calibration,
    full_problem,
    multistart_search,
    problem_for,
)
from sma_sim.evidence.estimation.curve_features import curve_features
from sma_sim.evidence.estimation.fit_result import FitResult, OtherStart
from sma_sim.evidence.estimation.free_parameters import declared_parameters, free_parameter
from sma_sim.evidence.estimation.held_out_prediction import RunFit, point_with, pooled_error, predict_recordings, run_fits
from sma_sim.evidence.estimation.levenberg_marquardt import refit
from sma_sim.evidence.estimation.overdispersion import overdispersion
from sma_sim.evidence.estimation.prepared_fit import PreparedFit
from sma_sim.evidence.estimation.problem import Problem, at_defaults, cost_at, linearize, with_difference, with_values
from sma_sim.evidence.estimation.recording_differences import AMBIENT, RecordingDifference, with_differences, zeros_of
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS
from sma_sim.evidence.estimation.uncertainty import AmbientDifference, known_ambient
from sma_sim.evidence.search.beam import Book
from sma_sim.evidence.search.criteria import ADEQUATE_PART, UNEXPLAINED
from sma_sim.evidence.search.equations import has_terms
from sma_sim.evidence.search.posterior import EVEN, Posterior
from sma_sim.evidence.search.refine import TIE
from sma_sim.evidence.search.score import evidence_at, evidence_of, unlisted_probability
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.solver.simulate import SimulationError


@dataclass(frozen=True)
class Conclusion:
    """The verdict, the last model, and what the held-out runs have said of it."""

    verdict: str
    last: FitResult
    stages: tuple[ModelStage, ...]
    pooled_errors: PooledErrors | None


@dataclass(frozen=True)
class HeldOutVerdict:
    """What a diagnosis with this run held out would say, and the normalized RMSE with which it is predicted."""

    verdict: str
    effects: tuple[str, ...]
    error: float = field(default=float('nan'))


def conclusion(
    path: Sequence[FitResult], is_formula: bool, posterior: Posterior, data: StageData, context: SearchContext
) -> Conclusion:
    """Read the held-out runs once: they confirm the last model, or speak for an earlier one.

    `path`: the models from the nominal one to the last; whether what this one adds `is_formula`.

    Fitted runs may leave open what a model predicts. One that explains all runs when it is fitted to them, and else predicts
    those held out worse than an earlier one, is judged by what all runs say of both.
    """
    last, together, k = as_fitted(path[-1], context), None, posterior.overdispersion
    fits = [estimated(earlier, data, context) for earlier in path[:-1]]
    stages = [provisional_stage(data, 'added' if k else 'nominal', one, context) for k, one in enumerate(fits)]
    known = data.under(last, context)
    stages.append(final_stage(known, 'formula' if is_formula else 'added' if stages else 'nominal', last, context))
    fitted_explained = stages[-1].train <= data.limit and not is_unlisted(posterior.unlisted, data.limit)
    if fitted_explained and stages[-1].held_out > data.limit:
        together = pooled_refit(known, last, stages[-1].predicted, k, context)
    pooled = None if together is None else together[1]
    explained = pooled is not None and pooled.explained(data.limit)
    is_worse, best = False, len(stages) - 1
    if stages[-1].held_out > data.limit and len(stages) > 1:
        own_rooms = pooled is not None and bool(pooled.ambient)
        if pooled is not None and own_rooms and known.held_out is not None:
            context.on_progress('predicting the held-out runs, each with an ambient temperature of its own')
            pooled = replace(pooled, in_own_rooms=errors_in_own_rooms(stages, known.held_out, context))
        pairs = zip(stages, [*fits, last], strict=True)
        densities = [log_predictive(stage, fit, data, (k, own_rooms), context) for stage, fit in pairs]
        best = max(range(len(stages)), key=lambda one: (densities[one], one))
        is_worse = densities[best] > densities[-1] + TIE
    if is_worse and not explained:
        context.on_progress('the held-out runs are more probable with fewer components')
        last = as_fitted(path[best], context)
        stages.append(final_stage(data.under(last, context), 'retracted', last, context))
        return Conclusion('unknown_effect', last, tuple(stages), None)
    if is_worse and together is not None:
        context.on_progress('fitting all runs with fewer components')
        earlier = fits[best]
        fewer = pooled_refit(known, earlier, stages[best].predicted, k, context)
        more = sum(one.log_prior for one in posterior.best.components if one.effect and one.effect not in earlier.effects)
        without = inf if fewer is None else evidence_score(fewer[0], -more, k, context)
        is_worse = without > evidence_score(together[0], 0.0, k, context) + TIE
    verdict = 'unknown_effect' if is_worse else verdict_of(stages[-1], pooled, posterior, data.limit)
    return Conclusion(verdict, last, tuple(stages), pooled)


def evidence_score(fit: FitResult, log_prior: float, k: float, context: SearchContext) -> float:
    """The score of a fit under an overdispersion k; -inf where it cannot be run."""
    try:
        return evidence_of(fit, log_prior, context).score(k)
    except SimulationError:
        return -inf


def errors_in_own_rooms(stages: Sequence[ModelStage], held_out: Dataset, context: SearchContext) -> tuple[float, ...]:
    """By stage, the normalized RMSE of held-out runs whose ambient temperatures are estimated as their initial states are:
    where these differ from those of the fitted runs, errors without that compare rooms, not models."""
    runs = with_differences(held_out, (AMBIENT,))
    predicted = (predict_recordings(one.config, runs, one.calibration.delay, context.pool, one.train) for one in stages)
    return tuple(pooled_error(fits)[0] for fits in predicted)


def log_predictive(
    stage: ModelStage, fit: FitResult, data: StageData, how: tuple[float, bool], context: SearchContext
) -> float:
    """The log density of the held-out runs under a model as the others have told it, -inf where it cannot be run: a
    prediction that is uncertain is less wrong where it errs. `how`: the overdispersion, and whether each run has an ambient
    temperature of its own."""
    k, own_rooms = how
    data = data.under(fit, context)
    problem, z = with_held_out(stage.calibration, fit, data, stage.predicted)
    if own_rooms:
        problem, z = with_difference(problem, z, AMBIENT)
    try:
        evidence = evidence_at(problem, z, linearize(problem, z, context.pool), 0.0)
    except SimulationError:
        return -inf
    return evidence.log_predictive(k, range(len(data.training.recordings), len(problem.runs)))


def with_held_out(
    found: Calibration, fit: FitResult, data: StageData, predicted: Sequence[RunFit]
) -> tuple[Problem, Vector]:
    """The problem of all runs, those held out behind the others, and where a calibration on the others has put it."""
    problem = full_problem(pooled(data.training, data.held_out), fit, data.options)
    values = [*(found.values[free.name] for free in problem.free), *[found.delay][: len(problem.shared) - len(problem.free)]]
    shared = [unknown.coordinate(value) for unknown, value in zip(problem.shared, values, strict=True)]
    return problem, point_with(problem, shared, (*found.runs, *predicted))


def verdict_of(last: ModelStage, pooled: PooledErrors | None, posterior: Posterior, limit: float) -> str:
    """`none`, `missing_effect`, or `unknown_effect` where much is left, or where no listed effect is what is missing.

    Without a held-out run the error of the fitted ones counts. A held-out run that the model explains when it is fitted to
    all runs (`pooled`) only goes further than the fitted ones.
    """
    error = last.train if isnan(last.held_out) else last.held_out
    explained = error <= limit or (pooled is not None and pooled.explained(limit))
    lacks_unlisted = is_unlisted(posterior.unlisted, limit)
    return verdict_from(explained and not has_terms(posterior.best), last.effects, lacks_unlisted)


def is_unlisted(probability: float, limit: float) -> bool:
    """Whether something that no list has is probably missing; not of a test that no model follows to its noise."""
    return limit <= UNEXPLAINED and probability > EVEN


def verdict_from(is_explained: bool, effects: Sequence[str], lacks_unlisted: bool) -> str:
    """The verdict, by whether listed effects explain all, which they are, and whether something else is probably missing."""
    if is_explained and effects:
        return 'missing_effect'
    return 'none' if is_explained and not lacks_unlisted else 'unknown_effect'


def verdicts_by_run(book: Book, posterior: Posterior, data: StageData, last: Conclusion) -> Mapping[str, HeldOutVerdict]:
    """By recording, the verdict if it were held out: the best model by the evidence of the others, which then predicts it.

    Evidence and prediction follow from the derivatives of each fit, to second order; no search is repeated. With a run that
    no fit has seen the verdict is as it is. Empty for a single fitted run.
    """
    problem, k = book.best.fit.problem, posterior.overdispersion
    if len(problem.runs) < 2:
        return {}
    found = {}
    for number, run in enumerate(problem.runs):
        best = max(book.models.values(), key=lambda model: model.score(k, number))
        error = sqrt(best.evidence.squares_without(k, number) / max(1, run.samples))
        effects = tuple(one.name for one in best.components if not (one.is_difference or one.is_formula))
        verdict = verdict_from(error <= data.limit and not has_terms(best), effects, best.lacks_unlisted)
        found[run.name] = HeldOutVerdict(verdict, effects, error)
    for fit in last.stages[-1].predicted:
        effects = tuple(name for name in last.last.effects if name in posterior.effects)
        found[fit.name] = HeldOutVerdict(last.verdict, effects, fit.error)
    return found


StageKind = Literal['nominal', 'added', 'retracted', 'formula']


@dataclass(frozen=True)
class ModelStage:
    """A model of a diagnosis: its fit, and the held-out runs as it predicts them (none where no run is held out).

    `kind`, compared with the stage before: `nominal` is the first; an effect was `added`, or `retracted` because held-out
    runs are predicted better without it; a `formula` was added for what no known effect explains. `differences`: in what
    its recordings differ.
    """

    kind: StageKind
    effects: tuple[str, ...]
    calibration: Calibration
    predicted: tuple[RunFit, ...]
    differences: tuple[str, ...] = ()

    @property
    def kinetics(self) -> str:
        """`hybrid` or `mas`."""
        return self.config.simulated_kinetics

    @property
    def config(self) -> Config:
        """The configuration with the fitted parameters."""
        return self.calibration.config

    @property
    def train(self) -> float:
        """Normalized RMSE of the training runs."""
        return self.calibration.error

    @property
    def channel_errors(self) -> Mapping[str, float]:
        """Normalized RMSE of the training runs, by channel."""
        return self.calibration.channel_errors

    @property
    def held_out(self) -> float:
        """Normalized RMSE of the held-out runs, NaN without any."""
        return pooled_error(self.predicted)[0]

    @property
    def held_out_channel_errors(self) -> Mapping[str, float]:
        """Normalized RMSE of the held-out runs, by channel."""
        return pooled_error(self.predicted)[1]


@dataclass(frozen=True)
class StageData:
    """What all stages are fitted to, what they predict, and how they are fitted."""

    training: Dataset
    held_out: Dataset | None
    options: FitOptions

    @property
    def limit(self) -> float:
        """The normalized RMSE above which something is missing that no accepted effect explains: of isobaric tests, whose
        noise is far less than a model of one homogeneous wire can follow, at least a part of what strain spans."""
        recordings, noise = self.training.recordings, self.training.noise_std.get('strain')
        if noise is None or not all(one.structure.is_quasi_static for one in recordings):
            return UNEXPLAINED
        strains = [one.channels['strain'] for one in recordings if 'strain' in one.channels]
        span = max(float(np.nanmax(strain) - np.nanmin(strain)) for strain in strains)
        return max(UNEXPLAINED, ADEQUATE_PART * (span / noise))

    def predicted(self, fit: FitResult | Calibration, context: SearchContext) -> tuple[RunFit, ...]:
        """The held-out runs, as they are here, under a model."""
        return predict_recordings(fit.config, self.held_out, fit.delay, context.pool, fit.error) if self.held_out else ()

    def under(self, fit: FitResult, context: SearchContext) -> StageData:
        """The same with what differs between the recordings in a model; of held-out runs that is what predicts them best."""
        differences = fit.problem.differences
        if not differences:
            return self
        training = with_differences(self.training, differences)
        held_out = self.held_out and with_differences(self.held_out, differences)
        for side in {difference.unpowered_side for difference in differences} - {0}:
            held_out = held_out and with_lost_power(held_out, side, fit, context)
        return replace(self, training=training, held_out=held_out)

    def differences(self, fit: FitResult, context: SearchContext) -> tuple[RecordingDifference, ...]:
        """What differs between the recordings in a model, the held-out ones among them; zeros one by one."""
        data = self.under(fit, context)
        recordings = pooled(data.training, data.held_out).recordings
        sides = {one.name: one.unpowered_side for one in recordings if one.unpowered_side}
        return tuple(
            replace(one, recordings=tuple(name for name, side in sides.items() if side == one.unpowered_side))
            for difference in fit.problem.differences
            for one in ([zeros_of({name: std}, difference.drifting) for name, std in difference.zeros] or [difference])
        )


def with_lost_power(dataset: Dataset, side: int, fit: FitResult, context: SearchContext) -> Dataset:
    """Held-out runs, without the power of commands of one sign where a model predicts them better so."""
    without = replace(dataset, recordings=tuple(replace(one, unpowered_side=side) for one in dataset.recordings))
    errors = [
        [run.error for run in predict_recordings(fit.config, runs, fit.delay, context.pool)] for runs in (dataset, without)
    ]
    pairs = zip(dataset.recordings, without.recordings, *errors, strict=True)
    return replace(dataset, recordings=tuple(lost if less < error else one for one, lost, error, less in pairs))


def estimated(fit: FitResult, data: StageData, context: SearchContext) -> FitResult:
    """A model that is to predict held-out runs, under the priors of a fit as the last one is; as it is without any."""
    if data.held_out is None or not fit.effects:
        return fit
    fit = as_fitted(fit, context)
    return refit(fit.problem, fit.z, context) or fit


def provisional_stage(data: StageData, kind: StageKind, fit: FitResult, context: SearchContext) -> ModelStage:
    """A model as it was fitted in the search; its errors are those of all samples."""
    data = data.under(fit, context)
    whole = replace(fit, problem=full_problem(data.training, fit, data.options))
    found = calibration_of(whole, context)
    return ModelStage(kind, fit.effects, found, data.predicted(fit, context), fit.differences)


def final_stage(data: StageData, kind: StageKind, fit: FitResult, context: SearchContext) -> ModelStage:
    """A model fitted on all samples of recordings `under` it, with intervals; `fit` is under the priors of a fit
    (`as_fitted`)."""
    context.on_progress('the last fit, on all samples')
    fit = fit if kind == 'formula' else from_defaults_too(fit, context)
    options = replace(data.options, free=tuple(p.name for p in fit.problem.free))
    found = final_calibration(data.training, fit, options, context)
    predicted = data.predicted(found, context)
    found = with_ambient_of_held_out(found, fit, data, predicted, context)
    return ModelStage(kind, fit.effects, found, predicted, fit.differences)


def with_ambient_of_held_out(
    found: Calibration, fit: FitResult, data: StageData, predicted: Sequence[RunFit], context: SearchContext
) -> Calibration:
    """A calibration that knows the ambient temperatures of held-out runs too, by what all runs say of them together."""
    known = found.uncertainty
    if known is None or not known.ambient or data.held_out is None or context.stop.is_set():
        return found
    problem, z = with_held_out(found, fit, data, predicted)
    try:
        ambient = known_ambient(problem, z, context.pool)
    except SimulationError:
        return found
    return replace(found, uncertainty=replace(known, ambient={**ambient, **known.ambient}))


def from_defaults_too(fit: FitResult, context: SearchContext) -> FitResult:
    """A model with effects as it is fitted from the nominal values with these at their defaults, unless that ends in a worse
    minimum.

    A search comes to its last model from those with fewer effects, a fit that asks for all of them does not: both are to
    give the same answer. Minima that the recordings hold alike, to a nat, or to two of the score, which is rougher, where no
    model follows them, differ in values which they leave open: of those the one counts that is more probable before them.
    The minimum that is not taken is kept as another start.
    """
    if not fit.effects or context.stop.is_set():
        return fit
    context.on_progress('the same model from its nominal values')
    other = refit(fit.problem, at_defaults(fit.problem), context, FROM_PRIORS)
    if other is None:
        return fit
    k = overdispersion(fit.problem, fit.z, context.pool)
    priors = [0.5 * (fit.problem.tempering * float(np.linalg.norm(one.z))) ** 2 for one in (fit, other)]
    squares = [one.cost - prior for one, prior in zip((fit, other), priors, strict=True)]
    tolerance = SAME_OPTIMUM * (k**2 if fit.problem.tempering > 1.0 else 0.5)
    are_alike = abs(squares[1] - squares[0]) < tolerance
    is_better = priors[1] < priors[0] if are_alike else other.cost < fit.cost - SAME_OPTIMUM
    best, worse = (other, fit) if is_better else (fit, other)
    more = worse.cost - best.cost
    start = OtherStart(more, worse.values, abs(more) < SAME_OPTIMUM, more / k**2)
    return replace(fit, z=best.z, cost=best.cost, other_starts=(*fit.other_starts, start))


def as_fitted(fit: FitResult, context: SearchContext) -> FitResult:
    """A fit of a search under the priors of a fit that asks for its effects: about their defaults, not about no effect.

    A search compares models by priors about neutral values. Where data leave values open, these would be the least that
    explains the fitted runs, which is no estimate of an effect that is there. A noise that was tempered has the size of what
    the fit leaves: in the end no candidates are compared by their priors.
    """
    problem, declared = fit.problem, declared_parameters(fit.problem.config)
    added = tuple(f'effects.{name}.' for name in fit.effects)
    free = tuple(
        free_parameter(one.name, declared[one.name].default, declared[one.name]) if one.name.startswith(added) else one
        for one in problem.free
    )
    tempering = max(1.0, fit.error) if problem.tempering > 1.0 else problem.tempering
    problem = replace(problem, free=free, tempering=tempering)
    z = with_values(problem, fit.z, fit.values)
    return replace(fit, problem=problem, z=z, cost=cost_at(problem, z, context.pool))


@dataclass(frozen=True)
class PooledErrors:
    """Normalized RMSE of the training and the held-out runs when one model is fitted to all of them, and how probable it is
    that something which no list has is left in them (`unlisted`).

    A held-out run that goes further than the fitted ones needs parameters that these hardly tell: its error is large, and
    nothing is missing. Then one set of parameters explains all, with an ambient temperature for each run where nobody
    measured it.

    `ambient`: by recording, how far its ambient temperature is from that of its input [K], where that had to differ;
    `above_first`: and from that of the first recording; `in_own_rooms`: by stage, how well the held-out runs are then
    predicted, where they are predicted worse as they are.
    """

    train: float
    held_out: float
    ambient: Mapping[str, float] = field(default_factory=dict)
    above_first: Mapping[str, AmbientDifference] = field(default_factory=dict)
    in_own_rooms: tuple[float, ...] = ()
    unlisted: float = 0.0

    def explained(self, limit: float = UNEXPLAINED) -> bool:
        """Whether nothing is left in either; `limit`: the error above which something is missing."""
        return max(self.train, self.held_out) <= limit and not is_unlisted(self.unlisted, limit)


def pooled_refit(
    data: StageData, last: FitResult, predicted: Sequence[RunFit], k: float, context: SearchContext
) -> tuple[FitResult, PooledErrors] | None:
    """A model fitted to the training and the held-out runs, from where it is and where they are `predicted` to start.

    The most probable of several fits under an overdispersion k, of those that leave nothing if there are any. That rooms
    differ from day to day costs no prior: held-out runs are of another day. None where it cannot be run, or was stopped.
    """
    found = list[tuple[bool, float, FitResult, PooledErrors]]()
    for number, fit in enumerate(refits(data, last, predicted, context)):
        if context.stop.is_set():
            return None
        if fit is not None:
            errors = errors_of(fit, data.training, context)
            found.append((errors.explained(data.limit), evidence_score(fit, 0.0, k, context), fit, errors))
        if number and any(explained for explained, *_ in found):
            break  # from all starts only where nothing explains all runs
    return max(found, key=lambda one: one[:2])[2:] if found else None


def refits(
    data: StageData, last: FitResult, predicted: Sequence[RunFit], context: SearchContext
) -> Iterator[FitResult | None]:
    """Fits of the last model to all runs, one after the other as they are asked for; None for one that cannot be made.

    From where it is and where the held-out runs are `predicted` to start; with an ambient temperature for each run, where
    these have none yet and their wires have a balance of heat; from all starts of a fit.
    """
    both = pooled(data.training, data.held_out)
    problem = replace(problem_for(both, last.problem.config, data.options, 1), free=last.problem.free)
    context.on_progress('fitting the held-out runs too')
    found, rooms = refit(problem, point_with(problem, last.z.tolist(), predicted), context, FROM_PRIORS), None
    yield found
    if found is not None and all(run.ambient_std == 0.0 and run.starts for run in problem.runs):
        context.on_progress('fitting all runs, each with an ambient temperature of its own')
        rooms = refit(*with_difference(problem, found.z, AMBIENT), context, FROM_PRIORS)
    yield rooms
    context.on_progress('fitting all runs from the start')
    names = tuple(parameter.name for parameter in last.problem.free)
    try:
        start = PreparedFit(both, last.problem.config, curve_features(both), context.kinetics)
        yield multistart_search(start, replace(data.options, free=names), context, FROM_PRIORS)
    except SimulationError:
        yield None


def errors_of(fit: FitResult, training: Dataset, context: SearchContext) -> PooledErrors:
    """The errors of a fit to the training runs and those held out, in this order."""
    fits, count = run_fits(fit.problem, fit.z, context.pool), len(training.recordings)
    ambient = {run.name: run.ambient for run in fits if run.ambient_std > 0.0}
    known = known_ambient(fit.problem, fit.z, context.pool) if ambient else {}
    left = unlisted_probability(evidence_of(fit, 0.0, context))
    return PooledErrors(pooled_error(fits[:count])[0], pooled_error(fits[count:])[0], ambient, known, unlisted=left)
