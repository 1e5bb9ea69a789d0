"""Score tests: what each candidate could explain of the residuals that the fitted parameters cannot.

With residuals r, derivatives J of everything that is fitted and the response s to a probe of a candidate (all over noise),
s' = s - J^T (J J^T + 1)^-1 J s is the part of s that no fitted unknown can absorb. To first order the sum of squares
decreases by the largest of -2 a s'r - a^2 s's' over a >= 0. What residuals as correlated as these would give by chance is
found by flipping the signs of whole blocks of r (wild bootstrap over blocks; Cameron, Gelbach and Miller 2008).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.executors import PickledConfig
from sma_sim.evidence.estimation.problem import EvaluationTask, LinearizedRun, Problem, evaluate, linearize
from sma_sim.evidence.estimation.uncertainty import correlation_times
from sma_sim.evidence.model_selection.candidates import Candidate, Probe, at_instants, instants_of, with_effect
from sma_sim.evidence.model_selection.criteria import CRITERIA

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class ScreeningResult:
    """What a candidate could explain: `gain` (decrease of the sum of squares) at `values` of its parameters.

    `family_p`: how often, by chance, the best of all candidates gains as much.
    """

    candidate: Candidate
    gain: float
    values: Mapping[str, float]
    family_p: float


@dataclass(frozen=True)
class ProjectedResponse:
    """The response to a probe that no fitted unknown can absorb, and its scores.

    `response` (N,) over all runs; `block_scores` (blocks,): its inner product with the residuals, by blocks of time.
    """

    probe: Probe
    response: Vector
    block_scores: NDArray[Any]


def screen(
    problem: Problem, z: Vector, candidates: Sequence[Candidate], pool: Executor, seed: int = 0
) -> tuple[ScreeningResult, ...]:
    """The candidates by gain, the largest first; those that the channels cannot see are left out."""
    linear = linearize(problem, z, pool)
    residuals = np.concatenate([run.residuals.ravel() for run in linear])
    blocks = block_numbers(problem, linear)
    if any(instants_of(candidate.found) for candidate in candidates):
        instants = change_points(problem, linear)
        candidates = [at_instants(candidate, instants) for candidate in candidates]
    responses = probe_all(problem, z, candidates, linear, pool)
    project = Projection(linear, len(z), problem.tempering)
    random = np.random.default_rng(seed)
    signs = random.choice([-1.0, 1.0], size=(CRITERIA.bootstrap_draws, int(blocks.max()) + 1))
    largest_by_chance = np.zeros(len(signs))
    found = []
    for candidate in candidates:
        best: tuple[float, Mapping[str, float]] = (0.0, {})
        for family in candidate.families:
            projected = [
                projected_response(probe, response, project, residuals, blocks)
                for probe in family if (response := responses.get(id(probe))) is not None
            ]  # fmt: skip
            visible = [response for response in projected if response is not None]
            if visible:
                gain, amounts, by_chance = explained(visible, signs)
                largest_by_chance = np.maximum(largest_by_chance, by_chance)
                if gain > best[0]:
                    best = gain, values_at(visible, amounts)
        if best[0] > 0.0:
            found.append(ScreeningResult(candidate, best[0], best[1], 1.0))
    found.sort(key=lambda result: -result.gain)
    draws = len(signs)
    return tuple(
        replace(result, family_p=(1 + int(np.sum(largest_by_chance >= result.gain))) / (draws + 1)) for result in found
    )


def change_points(problem: Problem, linear: Sequence[LinearizedRun]) -> list[float]:
    """The instants [s] from which on the residuals of a channel have another mean, the plainest channel first.

    They maximise the cumulative sum of what residuals are above their mean, over all runs (Page's test; Basseville and
    Nikiforov, Detection of Abrupt Changes, 2.6): its square over n f (1 - f), with n samples and a part f of them before.
    """
    times = np.unique(np.concatenate([run.time for run in problem.runs]))
    times = times[:: -(-len(times) // CRITERIA.most_instants)]
    evidence: dict[str, Vector] = {}
    for run, found in zip(problem.runs, linear, strict=True):
        for name, residuals, weight in zip(run.channels, found.residuals, run.weight, strict=True):
            known = weight > 0.0
            if known.sum() > 1:
                before = np.searchsorted(run.time[known], times)
                sums = np.concatenate([[0.0], np.cumsum(residuals[known] - residuals[known].mean())])[before]
                part = before / known.sum()
                among = np.where((part > 0.0) & (part < 1.0), part * (1.0 - part), np.inf) * known.sum()
                evidence[name] = evidence.get(name, np.zeros(len(times))) + sums**2 / among
    ordered = sorted(evidence.values(), key=lambda shown: -float(shown.max()))
    return list(dict.fromkeys(float(times[np.argmax(shown)]) for shown in ordered[: CRITERIA.tried_instants]))


def probe_all(
    problem: Problem, z: Vector, candidates: Sequence[Candidate], linear: Sequence[LinearizedRun], pool: Executor
) -> dict[int, Vector]:
    """The change of all residuals by every probe, (N,) by the probe's id; without those that cannot be run."""
    config, indices = problem.fitted(z), problem.indices()
    measured = {channel for run in problem.runs for channel in run.channels}
    probes = [
        (candidate, probe) for candidate in candidates for family in candidate.families for probe in family
        if candidate.found.effect.is_seen(probe.parameter, measured)
    ]  # fmt: skip
    futures = []
    for candidate, probe in probes:
        values = {**probe.shape, probe.parameter: probe.neutral + probe.step}
        probed = PickledConfig(with_effect(config, candidate.found, values))
        tasks = [
            EvaluationTask(run, ((probed, problem.nuisance(run, z[k])),))
            for run, k in zip(problem.runs, indices, strict=True)
        ]
        futures.append([pool.submit(evaluate, task) for task in tasks])
    found = {}
    for (_, probe), runs in zip(probes, futures, strict=True):
        shown = [future.result()[0] for future in runs]
        if all(residuals is not None for residuals in shown):
            pairs = zip(shown, linear, strict=True)
            changes = [residuals - base.residuals for residuals, base in pairs if residuals is not None]
            found[id(probe)] = np.concatenate([change.ravel() for change in changes])
    return found


class Projection:
    """Takes from a response what the fitted unknowns can absorb; their priors hold them back as in the fit."""

    def __init__(self, linear: Sequence[LinearizedRun], n: int, tempering: float = 1.0) -> None:
        self._linear, hessian = linear, tempering**2 * np.eye(n)
        for run in linear:
            flat = run.jacobian.reshape(len(run.indices), -1)
            hessian[np.ix_(run.indices, run.indices)] += flat @ flat.T
        self._inverse = np.linalg.inv(hessian)

    def __call__(self, response: Vector) -> Vector:
        """The part that is left, (N,)."""
        ends = np.cumsum([run.residuals.size for run in self._linear])
        parts = np.split(response, ends[:-1])
        score = np.zeros(len(self._inverse))
        for run, part in zip(self._linear, parts, strict=True):
            score[run.indices] += run.jacobian.reshape(len(run.indices), -1) @ part
        absorbed = self._inverse @ score
        rest = [
            part - absorbed[run.indices] @ run.jacobian.reshape(len(run.indices), -1)
            for run, part in zip(self._linear, parts, strict=True)
        ]
        return np.concatenate(rest)


def block_numbers(problem: Problem, linear: Sequence[LinearizedRun]) -> NDArray[np.int64]:
    """The block of time, over all runs, to which each entry of the residuals belongs, (N,)."""
    longest = max(correlation_times(problem, linear).values())
    numbers, first = [], 0
    for run in linear:
        channels, k = run.residuals.shape
        count = int(np.clip(k / (CRITERIA.block_correlations * longest), CRITERIA.min_blocks, CRITERIA.max_blocks))
        numbers.append(np.tile(first + np.arange(k) * count // k, channels))
        first += count
    return np.concatenate(numbers)


def projected_response(
    probe: Probe, response: Vector, project: Projection, residuals: Vector, blocks: NDArray[np.int64]
) -> ProjectedResponse | None:
    """What is left of a response; None where the channels do not see it, or all of it can be absorbed."""
    rest = project(response)
    size = float(response @ response)
    if size == 0.0 or float(rest @ rest) < CRITERIA.min_unabsorbed * size:
        return None
    return ProjectedResponse(probe, rest, np.bincount(blocks, weights=rest * residuals))


def explained(responses: Sequence[ProjectedResponse], signs: Matrix) -> tuple[float, Vector, Vector]:
    """Gain and amounts (>= 0) of the responses together, and the gains (draws,) under flipped signs."""
    gram = np.array([[first.response @ second.response for second in responses] for first in responses])
    scale = 1.0 / np.sqrt(np.diag(gram))
    gram = gram * np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
    blocks = scale[:, None] * np.array([response.block_scores for response in responses])
    targets = -np.vstack([blocks.sum(axis=1), signs @ blocks.T])
    gains, amounts = np.zeros(len(targets)), np.zeros(targets.shape)
    for active in one_side_each([response.probe.parameter for response in responses]):
        found = np.linalg.solve(gram[np.ix_(active, active)], targets[:, active].T).T
        gained = np.where((found > 0.0).all(axis=1), np.sum(found * targets[:, active], axis=1), 0.0)
        better = gained > gains
        gains[better], amounts[better] = gained[better], 0.0
        amounts[np.ix_(better, active)] = found[better]
    return float(gains[0]), scale * amounts[0], gains[1:]


def one_side_each(parameters: Sequence[str]) -> Iterator[NDArray[np.int64]]:
    """Sets of probes that may act together, the best of which has positive amounts: of each parameter one, up or down."""
    sides = [[-1, *(k for k, other in enumerate(parameters) if other == name)] for name in dict.fromkeys(parameters)]
    for chosen in product(*sides):
        if any(k >= 0 for k in chosen):
            yield np.array([k for k in chosen if k >= 0])


def values_at(responses: Sequence[ProjectedResponse], amounts: Vector) -> dict[str, float]:
    """The parameters at the best amounts of all probes of a family."""
    values = dict(responses[0].probe.shape)
    for probe, amount in zip([response.probe for response in responses], amounts, strict=True):
        before = values.get(probe.parameter, probe.neutral)
        values[probe.parameter] = before + float(amount) * probe.step
    return values
