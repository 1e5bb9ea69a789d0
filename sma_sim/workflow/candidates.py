"""What each effect would do to the error if it were switched on: by channel, and as a trace in every residual.

An effect is switched on with the values that explain most while all other parameters stay as they are: within what is
realistic of it, or the bounds where nothing is said of that, and with its priors. What would be left once the others were
fitted again is said to first order. The trace is what an effect adds to the model at these values, without what the fitted
parameters could do as well (`sma_sim.evidence.model_selection.score_tests`): a residual (measured - model) of the same shape
asks for the effect, or for one that is alike. It says little of a model that is not calibrated. How probable an effect is,
among the models with one of these effects or none, is what the score of a diagnosis says to first order
(`sma_sim.evidence.search.score`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from sma_sim.evidence.data.recording import Dataset, in_order
from sma_sim.evidence.estimation.calibrate import SEARCH_SAMPLES, Calibration, FitOptions, calibrate, problem_for
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import FreeParameter, free_parameter
from sma_sim.evidence.estimation.held_out_prediction import point_with
from sma_sim.evidence.estimation.levenberg_marquardt import bounded_step, secant_minimum
from sma_sim.evidence.estimation.problem import (
    DELAY,
    LinearizedRun,
    Problem,
    cost_at,
    linearize,
    own_derivatives,
    quadratic_model,
    residuals_at,
)
from sma_sim.evidence.estimation.projection import Projection
from sma_sim.evidence.estimation.residuals import fit_data
from sma_sim.evidence.estimation.search_context import SearchContext, Stop, silent_iteration
from sma_sim.evidence.estimation.stop_criteria import ADDED_EFFECT, SKETCH_DECREASE
from sma_sim.evidence.model_selection.candidates import candidates_for, with_effect
from sma_sim.evidence.model_selection.score_tests import ScreeningResult, screen
from sma_sim.evidence.residual_analysis.compare import run_beside_model
from sma_sim.evidence.residual_analysis.metrics import channel_scores, total_error
from sma_sim.evidence.search.components import Catalogue, Component
from sma_sim.evidence.search.score import Evidence, evidence_at, probabilities
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.parameters import Parameter
from sma_sim.solver.simulate import SimulationError
from sma_sim.words.probabilities import probability_words

OnCandidate = Callable[[Mapping[str, Any]], None]
FRACTIONS = (1.0, 0.3, 0.1)  # of the way to what the score test says, from which the least error is looked for
NORMAL_95 = 1.96  # standard deviations on each side of a 95 % interval
AT_END = 1e-6  # of a coordinate from its bound


@dataclass(frozen=True)
class EffectValue:
    """A parameter of an effect with its 95 % interval, as wide as the other parameters leave it, SI units.

    `at_end`: whether the value is at an end of what is realistic; `determined`: whether the interval leaves any of that out.
    """

    value: float
    low: float
    high: float
    at_end: bool
    determined: bool


@dataclass(frozen=True)
class CandidateEffect:
    """One effect, switched on at `parameters`.

    `errors` by channel and `error`: over noise, all other parameters as they are. `expected_error`: with these fitted again,
    to first order. `evidence`: of the model with it. `traces`: by run, an array (channels, k) over noise, in the order of
    the run's channels and at its thinned times. `probability`: among all effects that were tried and none; None until
    these are known.
    """

    name: str
    parameters: Mapping[str, EffectValue]
    errors: Mapping[str, float]
    error: float
    expected_error: float
    evidence: Evidence
    traces: Mapping[str, Vector]
    probability: float | None = None

    @property
    def values(self) -> dict[str, float]:
        """The values of the effect's parameters by their short names, SI units."""
        return {name: parameter.value for name, parameter in self.parameters.items()}

    def as_data(self) -> dict[str, Any]:
        """All but the traces and what the score is made of, for JSON."""
        shown = {name: value for name, value in vars(self).items() if name not in ('traces', 'evidence')}
        said = '' if self.probability is None else probability_words(self.probability)
        parameters = {name: vars(one) for name, one in self.parameters.items()}
        return shown | {'values': self.values, 'parameters': parameters, 'probability_words': said}


@dataclass(frozen=True)
class CandidateEffects:
    """The effects by what they would leave, the least first; `errors` and `error` over noise without any of them.

    `expected_error`: without any, the parameters fitted again, to first order. `none`: the probability that it is none of
    them. `times` and `channels` by run: those of the traces.
    """

    errors: Mapping[str, float]
    error: float
    expected_error: float
    none: float
    effects: tuple[CandidateEffect, ...]
    times: Mapping[str, Vector]
    channels: Mapping[str, tuple[str, ...]]

    def as_data(self) -> dict[str, Any]:
        """All but the traces, for JSON."""
        effects = [effect.as_data() for effect in self.effects]
        without = {'errors': dict(self.errors), 'error': self.error, 'expected_error': self.expected_error}
        without |= {'probability': self.none, 'probability_words': probability_words(self.none)}
        return without | {'effects': effects}


@dataclass(frozen=True)
class LinearModel:
    """A model on thinned samples: its problem, a point z (n,), and the linearisation there."""

    problem: Problem
    z: Vector
    linear: tuple[LinearizedRun, ...]

    @cached_property
    def with_fixed_parameters(self) -> LinearModel:
        """The same where only what is unknown about the recordings is free."""
        first, problem = len(self.problem.free), replace(self.problem, free=())
        runs = zip(problem.indices(), self.linear, strict=True)
        linear = (LinearizedRun(indices, run.residuals, run.jacobian[first:]) for indices, run in runs)
        return LinearModel(problem, self.z[first:], tuple(linear))

    @cached_property
    def projection(self) -> Projection:
        """Takes from a response what the unknowns can absorb."""
        return Projection(self.linear, len(self.z), self.problem.tempering)

    @cached_property
    def expected(self) -> LinearModel:
        """With all unknowns at their optimum within the bounds, to first order."""
        low, high = self.problem.limits()
        _, gradient, hessian = quadratic_model(self.problem, self.linear, self.z)
        step = bounded_step(gradient, hessian, 0.0, low - self.z, high - self.z)
        linear = (
            replace(run, residuals=run.residuals + np.tensordot(step[run.indices], run.jacobian, 1)) for run in self.linear
        )
        return LinearModel(self.problem, self.z + step, tuple(linear))

    def expected_error(self) -> float:
        """Normalized RMSE there."""
        there = self.expected
        return FitResult(there.problem, there.z, quadratic_model(there.problem, there.linear, there.z)[0]).error

    def evidence(self, log_prior: float) -> Evidence:
        """The evidence there."""
        return evidence_at(self.problem, self.expected.z, self.expected.linear, log_prior)

    def standard_errors(self) -> Vector:
        """Standard deviations of the unknowns (n,), widened by the error that is left."""
        cost, _, hessian = quadratic_model(self.problem, self.linear, self.z)
        left = max(1.0, FitResult(self.problem, self.z, cost).error)
        return left * np.sqrt(np.diag(np.linalg.inv(hessian)))


def candidate_effects(
    fitted: Dataset,
    config: Config,
    folders: Sequence[Path],
    executor: Executor,
    callbacks: tuple[Callable[[str], None], OnCandidate],
    names: Sequence[str] | None = None,
    stop: Stop | None = None,
) -> CandidateEffects:
    """Switch listed effects on, one at a time, and see what becomes of the errors: `names` of effects, or all.

    `callbacks`: the first gets what is being done, the second every effect as it is known, with how many are `done` of how
    many in `total`. Once `stop` is set, those so far are returned. Raises UserError.
    """
    (on_progress, on_candidate), rtol = callbacks, config.parameters['solver.rtol']
    options = FitOptions(free=(), kinetics=config.simulated_kinetics, starts=1, intervals=False)
    found = calibrate(fitted, config, options, executor, silent_iteration)
    base = model_at(fitted, config, found, executor)
    catalogue = Catalogue(candidates_for(config, folders), ())
    candidates = [candidate for candidate in catalogue.effects if names is None or candidate.name in names]
    on_progress(f'screening {len(candidates)} effects')
    screened = screen(base.problem, base.z, candidates, executor)
    effects = list[CandidateEffect]()
    for done, result in enumerate(screened, 1):
        if stop is not None and stop.is_set():
            break
        on_progress(f'switching {result.candidate.name} on ({done} of {len(screened)})')
        try:
            effect = switched_on(fitted, base, catalogue.component(result), rtol, executor)
        except (UserError, SimulationError):
            continue  # the model cannot be run with it
        on_candidate(effect.as_data() | {'done': done, 'total': len(screened)})
        effects.append(effect)
    runs = base.problem.runs
    none, *weights = probabilities([base.evidence(0.0), *(effect.evidence for effect in effects)])
    effects = [replace(effect, probability=weight) for effect, weight in zip(effects, weights, strict=True)]
    return CandidateEffects(
        *errors_at(fitted, base, rtol, executor),
        base.expected_error(),
        none,
        tuple(sorted(effects, key=lambda effect: effect.expected_error)),
        {run.name: np.asarray(run.time) for run in runs},
        {run.name: tuple(run.channels) for run in runs},
    )


def errors_at(fitted: Dataset, model: LinearModel, rtol: float, executor: Executor) -> tuple[dict[str, float], float]:
    """Normalized RMSE on all samples, by channel and in all; `rtol` of the solver. Raises SimulationError."""
    config = model.problem.at_tolerance(rtol).fitted(model.z)
    futures = []
    for recording, run, indices in zip(fitted.recordings, model.problem.runs, model.problem.indices(), strict=True):
        prepared = recording, fit_data(recording, fitted.noise_std, floor=rtol)
        nuisance = model.problem.nuisance(run, model.z[indices])
        futures.append(executor.submit(run_beside_model, config, prepared, nuisance, fitted.noise_std, False))
    runs = [future.result() for future in futures]
    scores = channel_scores(runs, in_order(fitted.channels, config.structure.name))
    return {name: score.over_noise for name, score in scores.items()}, total_error(list(scores.values()))


def model_at(fitted: Dataset, config: Config, found: Calibration, executor: Executor) -> LinearModel:
    """A model as it is, whose delay and starts are known, with the parameters free that a fit would change."""
    longest = max(len(recording.time) for recording in fitted.recordings)
    problem = problem_for(
        fitted, config, FitOptions(kinetics=config.simulated_kinetics), max(1, longest // SEARCH_SAMPLES), False
    )
    free = [parameter.coordinate(config.parameters[parameter.name]) for parameter in problem.free]
    delay = [] if problem.delay is not None else [DELAY.coordinate(found.delay)]
    z = point_with(problem, [*free, *delay], found.runs)
    return LinearModel(problem, z, tuple(linearize(problem, z, executor)))


def switched_on(
    fitted: Dataset, base: LinearModel, component: Component, rtol: float, executor: Executor
) -> CandidateEffect:
    """One effect where it explains most. Raises UserError or SimulationError where the model cannot be run with it."""
    assert isinstance(component.start, ScreeningResult)
    alone = fitted_alone(base.with_fixed_parameters, component.start, executor)
    both, own = joined(base, alone), alone.problem.free
    parameters = {}
    for free, z, std in zip(own, alone.z, both.standard_errors()[len(base.problem.free) :], strict=False):
        z, reach = float(z), NORMAL_95 * float(std)
        low, high = max(z - reach, free.low), min(z + reach, free.high)
        parameters[free.name.rpartition('.')[2]] = EffectValue(
            free.value(z),
            free.value(low),
            free.value(high),
            at_end=min(z - free.low, free.high - z) < AT_END,
            determined=low > free.low or high < free.high,
        )
    errors, error = errors_at(fitted, alone, rtol, executor)
    evidence = both.evidence(component.log_prior)
    return CandidateEffect(component.name, parameters, errors, error, both.expected_error(), evidence, traces(base, alone))


def fitted_alone(base: LinearModel, result: ScreeningResult, executor: Executor) -> LinearModel:
    """A model with one effect more where that explains most, from what the score test says of it, or nearer to nothing."""
    found = result.candidate.effect
    config = with_effect(base.problem.config, found, {})
    values = config.effects[-1].by_short_name
    free = [
        realistic(f'effects.{found.name}.{p.name}', values[p.name], p) for p in found.parameters if p.name in result.values
    ]
    problem = replace(base.problem, config=config, free=tuple(free))
    said = np.array([one.coordinate(result.values[one.name.rpartition('.')[2]]) for one in free])
    low, high = problem.limits()
    points = [np.clip(np.concatenate([part * said, base.z]), low, high) for part in FRACTIONS]
    z = min(points, key=lambda point: cost_at(problem, point, executor))
    linear = with_own_derivatives(problem, z, base.linear, executor)
    least = SKETCH_DECREASE * min(cost_at(base.problem, base.z, executor), float(problem.samples))
    fit = secant_minimum(problem, z, linear, (ADDED_EFFECT.damping, least), SearchContext(executor, Event()))
    return LinearModel(problem, fit.z, with_own_derivatives(problem, fit.z, base.linear, executor))


def realistic(name: str, value: float, declared: Parameter) -> FreeParameter:
    """A parameter of an effect with its prior, bounded by what is realistic of it where that is known."""
    free = free_parameter(name, value, declared)
    if declared.realistic is None:
        return free
    low, high = (free.coordinate(end) if end > 0.0 or not free.log else free.low for end in declared.realistic)
    return replace(free, low=min(max(low, free.low), 0.0), high=max(min(high, free.high), 0.0))


def with_own_derivatives(
    problem: Problem, z: Vector, linear: Sequence[LinearizedRun], executor: Executor
) -> tuple[LinearizedRun, ...]:
    """The linearisation at z of a problem whose free parameters are an effect's; `linear` is one without them, near it.

    Raises SimulationError where the model cannot be run at z.
    """
    base = residuals_at(problem, z, executor)
    derivatives = own_derivatives(problem, z, range(len(problem.free)), base, executor)
    found = []
    for run, data, indices, here, rows in zip(linear, problem.runs, problem.indices(), base, derivatives, strict=True):
        if here is None or rows is None:
            raise SimulationError(f'{data.name}: the model cannot be run with these parameters')
        found.append(LinearizedRun(indices, here, np.concatenate([rows, run.jacobian])))
    return tuple(found)


def joined(base: LinearModel, alone: LinearModel) -> LinearModel:
    """A model with an effect, at the parameters that both have: those of the model and of the effect free."""
    first = len(base.problem.free)
    problem = replace(alone.problem, free=(*base.problem.free, *alone.problem.free))
    runs = zip(problem.indices(), base.linear, alone.linear, strict=True)
    linear = (
        LinearizedRun(indices, run.residuals, np.concatenate([without.jacobian[:first], run.jacobian]))
        for indices, without, run in runs
    )
    return LinearModel(problem, np.concatenate([base.z[:first], alone.z]), tuple(linear))


def traces(base: LinearModel, alone: LinearModel) -> dict[str, Matrix]:
    """By run, what an effect takes from the residuals over noise, (channels, k), as far as nothing else can: as much of it
    as explains most, to first order."""
    changes = [run.residuals - without.residuals for run, without in zip(alone.linear, base.linear, strict=True)]
    rest = base.projection(np.concatenate([change.ravel() for change in changes]))
    amount = max(-float(rest @ base.projection.residuals) / max(float(rest @ rest), 1e-300), 0.0)
    runs = zip(base.problem.runs, base.projection.by_run(amount * rest), changes, strict=True)
    return {run.name: part.reshape(change.shape) for run, part, change in runs}
