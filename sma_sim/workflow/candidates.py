"""What each effect would do to the error if it were switched on: by channel, and as a trace in every residual.

The trace of an effect is what it adds to the model where it explains most, without what the fitted parameters could do as
well (`sma_sim.evidence.model_selection.score_tests`): a residual (measured - model) of the same shape asks for the effect,
or for one that is alike. All of it is to first order: it says little of a model that is not calibrated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.calibrate import SEARCH_SAMPLES, Calibration, FitOptions, calibrate, problem_for
from sma_sim.evidence.estimation.cross_validation import own_unknowns
from sma_sim.evidence.estimation.problem import DELAY, LinearizedRun, Problem, linearize, residuals_at
from sma_sim.evidence.model_selection.candidates import candidates_for, with_effect
from sma_sim.evidence.model_selection.score_tests import Projection, ScreeningResult, screen
from sma_sim.evidence.residual_analysis.compare import compare
from sma_sim.evidence.residual_analysis.metrics import channel_scores, total_error
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError

Vector = NDArray[np.float64]
OnCandidate = Callable[[Mapping[str, Any]], None]


@dataclass(frozen=True)
class CandidateEffect:
    """One effect, switched on at `values` of its parameters, SI units.

    `errors` by channel and `error`: over noise, all other parameters as they are. `expected_error`: with these fitted again,
    to first order. `family_p`: how often, by chance, the best of all effects explains as much. `traces`: by run, an
    array (channels, k) over noise, in the order of the run's channels and at its thinned times; empty where the model cannot
    be run.
    """

    name: str
    values: Mapping[str, float]
    errors: Mapping[str, float]
    error: float
    expected_error: float
    family_p: float
    traces: Mapping[str, Vector]

    def as_data(self) -> dict[str, Any]:
        """All but the traces, for JSON."""
        return {name: value for name, value in vars(self).items() if name != 'traces'}


@dataclass(frozen=True)
class CandidateEffects:
    """The effects by what they would explain, the most first; `errors` and `error` over noise without any of them.

    `expected_error`: without any, the parameters fitted again, to first order. `times` and `channels` by run: those of
    the traces.
    """

    errors: Mapping[str, float]
    error: float
    expected_error: float
    effects: tuple[CandidateEffect, ...]
    times: Mapping[str, Vector]
    channels: Mapping[str, tuple[str, ...]]

    def as_data(self) -> dict[str, Any]:
        """All but the traces, for JSON."""
        effects = [effect.as_data() for effect in self.effects]
        without = {'errors': dict(self.errors), 'error': self.error, 'expected_error': self.expected_error}
        return without | {'effects': effects}


def candidate_effects(
    fitted: Dataset, config: Config, folders: Sequence[Path], executor: Executor,
    callbacks: tuple[Callable[[str], None], OnCandidate], names: Sequence[str] | None = None,
) -> CandidateEffects:  # fmt: skip
    """Switch listed effects on, one at a time, and see what becomes of the errors: `names` of effects, or all.

    `callbacks`: the first gets what is being done, the second every effect as it is known. Raises UserError.
    """
    on_progress, on_candidate = callbacks
    options = FitOptions(free=(), kinetics=config.simulated_kinetics, starts=1, intervals=False)
    found = calibrate(fitted, config, options, executor)
    problem, z = problem_at(fitted, config, found)
    candidates = [candidate for candidate in candidates_for(config, folders) if names is None or candidate.name in names]
    on_progress(f'screening {len(candidates)} effects')
    screened = screen(problem, z, candidates, executor)
    linear = linearize(problem, z, executor)
    project = Projection(linear, len(z))
    squares = float(np.sum(project(np.concatenate([run.residuals.ravel() for run in linear])) ** 2))
    effects = []
    for result in screened:
        on_progress(f'switching {result.candidate.name} on')
        changed = with_effect(config, result.candidate.found, result.values)
        try:
            errors, error = errors_of(fitted, changed, executor)
        except UserError:
            continue  # the model cannot be run with it
        expected = float(np.sqrt(max(squares - result.gain, 0.0) / problem.samples))
        traces = traces_of(problem, z, (linear, project), result, executor)
        effect = CandidateEffect(
            result.candidate.name, dict(result.values), errors, error, expected, result.family_p, traces
        )  # fmt: skip
        on_candidate(effect.as_data())
        effects.append(effect)
    return CandidateEffects(
        *errors_of(fitted, config, executor), float(np.sqrt(squares / problem.samples)), tuple(effects),
        {run.name: np.asarray(run.time) for run in problem.runs}, {run.name: tuple(run.channels) for run in problem.runs},
    )  # fmt: skip


def errors_of(fitted: Dataset, config: Config, executor: Executor) -> tuple[dict[str, float], float]:
    """Errors over noise by channel and in all, as ``sma-sim compare`` has them. Raises UserError."""
    comparison = compare(fitted, config, executor=executor)
    scores = channel_scores(comparison.runs, comparison.channels)
    return {name: score.over_noise for name, score in scores.items()}, total_error(list(scores.values()))


def problem_at(fitted: Dataset, config: Config, found: Calibration) -> tuple[Problem, Vector]:
    """The problem of a calibration on thinned samples, and its point at a model whose delay and starts are known."""
    longest = max(len(recording.time) for recording in fitted.recordings)
    problem = problem_for(
        fitted, config, FitOptions(kinetics=config.simulated_kinetics), max(1, longest // SEARCH_SAMPLES), False
    )
    free = [parameter.coordinate(config.parameters[parameter.name]) for parameter in problem.free]
    delay = [] if problem.delay is not None else [DELAY.coordinate(found.delay)]
    own = [z for fit in found.runs for z in own_unknowns(fit)]
    low, high = problem.limits()
    return problem, np.clip(np.array([*free, *delay, *own]), low, high)


def traces_of(
    problem: Problem,
    z: Vector,
    base: tuple[Sequence[LinearizedRun], Projection],
    result: ScreeningResult,
    executor: Executor,
) -> dict[str, Vector]:
    """By run, what an effect takes from the residuals over noise, (channels, k), as far as nothing else can."""
    linear, project = base
    config = with_effect(problem.config, result.candidate.found, result.values)
    shown = residuals_at(replace(problem, config=config), z, executor)
    if any(residuals is None for residuals in shown):
        return {}
    changes = [found - run.residuals for run, found in zip(linear, shown, strict=True) if found is not None]
    rest = project(np.concatenate([change.ravel() for change in changes]))
    ends = np.cumsum([change.size for change in changes])
    parts = np.split(rest, ends[:-1])
    return {run.name: part.reshape(change.shape) for run, part, change in zip(problem.runs, parts, changes, strict=True)}
