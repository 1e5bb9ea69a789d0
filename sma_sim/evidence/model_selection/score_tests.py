"""Score tests: what each candidate could explain of the residuals that the fitted parameters cannot.

With residuals r, derivatives J of everything that is fitted and the response s to a probe of a candidate (all over noise),
s' = s - J^T (J J^T + 1)^-1 J s is the part of s that no fitted unknown can absorb. The sum of squares falls, to first
order, by the largest of -2 a s'r - a^2 s's' over a >= 0. What residuals as correlated as these would give by chance is
found by flipping the signs of whole stretches of r (wild bootstrap over blocks; Cameron, Gelbach and Miller 2008).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from sma_sim.evidence.estimation.executors import PickledConfig
from sma_sim.evidence.estimation.problem import Evaluation, LinearizedRun, Problem, evaluate, linearize
from sma_sim.evidence.estimation.uncertainty import correlation_times
from sma_sim.evidence.model_selection.candidates import Candidate, Probe, with_effect

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
DRAWS = 999
LEAST_BLOCKS, MOST_BLOCKS = 8, 40  # per run
FAINT = 1e-6  # part of a response that is left when all that is fitted has absorbed what it can: below it, nothing


@dataclass(frozen=True)
class Screened:
    """What a candidate could explain: `gain` (fall of the sum of squares) at `values` of its parameters.

    `family_p`: how often, by chance, the best of all candidates gains as much.
    """

    candidate: Candidate
    gain: float
    values: Mapping[str, float]
    family_p: float


@dataclass(frozen=True)
class Direction:
    """The response to a probe that is left after projection: with itself, with the residuals, by blocks of time."""

    probe: Probe
    left: Matrix  # (N,) over all runs
    with_blocks: NDArray[Any]  # (blocks,) of the inner product with r


def screen(
    problem: Problem, z: Vector, candidates: Sequence[Candidate], pool: Executor, seed: int = 0
) -> tuple[Screened, ...]:
    """The candidates by gain, the largest first; those that the channels cannot see are left out."""
    linear = linearize(problem, z, pool)
    residuals = np.concatenate([one.residuals.ravel() for one in linear])
    blocks = block_numbers(problem, linear)
    responses = probe_all(problem, z, candidates, linear, pool)
    project = projection(linear, len(z))
    random = np.random.default_rng(seed)
    signs = random.choice([-1.0, 1.0], size=(DRAWS, int(blocks.max()) + 1))
    chance = np.zeros(DRAWS)
    found = []
    for candidate in candidates:
        best: tuple[float, Mapping[str, float]] = (0.0, {})
        for family in candidate.families:
            directions = [
                direction(probe, response, project, residuals, blocks)
                for probe in family if (response := responses.get(id(probe))) is not None
            ]  # fmt: skip
            seen = [one for one in directions if one is not None]
            if seen:
                gain, amounts, by_chance = explained(seen, signs)
                chance = np.maximum(chance, by_chance)
                if gain > best[0]:
                    best = gain, values_at(seen, amounts)
        if best[0] > 0.0:
            found.append(Screened(candidate, best[0], best[1], 1.0))
    found.sort(key=lambda one: -one.gain)
    return tuple(replace(one, family_p=(1 + int(np.sum(chance >= one.gain))) / (DRAWS + 1)) for one in found)


def probe_all(
    problem: Problem, z: Vector, candidates: Sequence[Candidate], linear: Sequence[LinearizedRun], pool: Executor
) -> dict[int, Vector]:
    """The change of all residuals by every probe, (N,) by the probe's id; without those that cannot be run."""
    config, places = problem.fitted(z), problem.places()
    probes = [(candidate, probe) for candidate in candidates for family in candidate.families for probe in family]
    futures = []
    for candidate, probe in probes:
        values = {**probe.shape, probe.parameter: probe.neutral + probe.step}
        parcel = PickledConfig(with_effect(config, candidate.found, values))
        tasks = [Evaluation(run, ((parcel, problem.nuisance(z[p])),)) for run, p in zip(problem.runs, places, strict=True)]
        futures.append([pool.submit(evaluate, task) for task in tasks])
    found = {}
    for (_, probe), runs in zip(probes, futures, strict=True):
        shown = [future.result()[0] for future in runs]
        if all(one is not None for one in shown):
            changes = [one - base.residuals for one, base in zip(shown, linear, strict=True) if one is not None]
            found[id(probe)] = np.concatenate([change.ravel() for change in changes])
    return found


class projection:  # noqa: N801 - used as a function
    """Takes from a response what the fitted unknowns can absorb; their priors hold them back as in the fit."""

    def __init__(self, linear: Sequence[LinearizedRun], n: int) -> None:
        self._linear, hessian = linear, np.eye(n)
        for one in linear:
            flat = one.jacobian.reshape(len(one.place), -1)
            hessian[np.ix_(one.place, one.place)] += flat @ flat.T
        self._inverse = np.linalg.inv(hessian)

    def __call__(self, response: Vector) -> Vector:
        """The part that is left, (N,)."""
        ends = np.cumsum([one.residuals.size for one in self._linear])
        parts = np.split(response, ends[:-1])
        pull = np.zeros(len(self._inverse))
        for one, part in zip(self._linear, parts, strict=True):
            pull[one.place] += one.jacobian.reshape(len(one.place), -1) @ part
        moves = self._inverse @ pull
        left = [
            part - moves[one.place] @ one.jacobian.reshape(len(one.place), -1)
            for one, part in zip(self._linear, parts, strict=True)
        ]
        return np.concatenate(left)


def block_numbers(problem: Problem, linear: Sequence[LinearizedRun]) -> NDArray[np.int64]:
    """The stretch of time, over all runs, to which each entry of the residuals belongs, (N,)."""
    longest = max(correlation_times(problem, linear).values())
    numbers, first = [], 0
    for one in linear:
        channels, k = one.residuals.shape
        count = int(np.clip(k / (4.0 * longest), LEAST_BLOCKS, MOST_BLOCKS))
        numbers.append(np.tile(first + np.arange(k) * count // k, channels))
        first += count
    return np.concatenate(numbers)


def direction(
    probe: Probe, response: Vector, project: projection, residuals: Vector, blocks: NDArray[np.int64]
) -> Direction | None:
    """What is left of a response; None where the channels do not see it, or all of it can be absorbed."""
    left = project(response)
    size = float(response @ response)
    if size == 0.0 or float(left @ left) < FAINT * size:
        return None
    return Direction(probe, left, np.bincount(blocks, weights=left * residuals))


def explained(directions: Sequence[Direction], signs: Matrix) -> tuple[float, Vector, Vector]:
    """Gain and amounts (>= 0) of the directions together, and the gains (draws,) under flipped signs."""
    gram = np.array([[one.left @ other.left for other in directions] for one in directions])
    scale = 1.0 / np.sqrt(np.diag(gram))
    root = np.linalg.cholesky(gram * np.outer(scale, scale) + 1e-9 * np.eye(len(scale))).T

    def best(pulls: Vector) -> tuple[float, Vector]:
        target = np.linalg.solve(root.T, -scale * pulls)
        amounts, rest = nnls(root, target)
        return float(target @ target - rest**2), scale * amounts

    blocks = np.array([one.with_blocks for one in directions])
    gain, amounts = best(blocks.sum(axis=1))
    return gain, amounts, np.array([best(pulls)[0] for pulls in signs @ blocks.T])


def values_at(directions: Sequence[Direction], amounts: Vector) -> dict[str, float]:
    """The parameters at the best amounts of all probes of a family."""
    values = dict(directions[0].probe.shape)
    for one, amount in zip(directions, amounts, strict=True):
        before = values.get(one.probe.parameter, one.probe.neutral)
        values[one.probe.parameter] = before + float(amount) * one.probe.step
    return values
