"""Weighs all hypotheses against one another, and against chance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from threading import Event
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.uncertainty import autocorrelation_time
from sma_sim.evidence.latent_input.covariances import covariances
from sma_sim.evidence.latent_input.design_matrix import FOLDS, Design, Stopped
from sma_sim.evidence.latent_input.hypotheses import Hypothesis
from sma_sim.evidence.latent_input.inference import (
    Estimate,
    Prior,
    Products,
    best_prior,
    estimated,
    predicted,
    projected,
    solved,
    with_shifts,
    without,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Answer = TypeVar('Answer')
DRAWS = 299


@dataclass(frozen=True)
class Weighed:
    """A hypothesis with the prior that the data prefer, and the best evidence of each draw of chance, (DRAWS,).

    `design`: the model around which it was weighed. `evidence`: logarithm, comparable between designs. `single`: of the
    best covariance by itself over nothing, which is what chance is compared with.
    """

    hypothesis: Hypothesis
    design: Design
    prior: Prior
    evidence: float
    single: float
    by_chance: Vector


def dealt(jobs: Sequence[Callable[[], Answer]], pool: Executor, stop: Event) -> list[Answer]:
    """The answers of jobs, in order. Raises Stopped."""
    futures = [pool.submit(job) for job in jobs]
    found = []
    for future in futures:
        if stop.is_set():
            for later in futures:
                later.cancel()
            raise Stopped
        found.append(future.result())
    return found


def chance(design: Design, gap: Sequence[Matrix], seed: int) -> list[Matrix]:
    """Residuals by chance, (channels bins, DRAWS) by run: white noise, and the difference of the kinetics at random size."""
    random = np.random.default_rng(seed)
    sizes = random.standard_normal(DRAWS)
    return [
        random.standard_normal((run.residuals.size, DRAWS)) + one.ravel()[:, None] * sizes
        for run, one in zip(design.runs, gap, strict=True)
    ]


def weigh(
    design: Design, one: Hypothesis, T_E: float, noise: Sequence[Matrix] = (), widened: float = 1.0, mixed: bool = True
) -> Weighed:
    """The prior that the data prefer for one hypothesis: a mixture if `mixed`, a single covariance while chance is tried."""
    points = design.points(one, T_E)
    whole = design.products(one, widened)
    m = len(whole.pull) - len(design.z)
    gram, share = projected(whole, m)
    pulls = np.column_stack([whole.pull, design.pulls(one, noise)]) if noise else whole.pull[:, None]
    prior, scores = best_prior(gram, share @ pulls[m:] - pulls[:m], covariances(one.hook, points), mixed and not noise)
    evidence = prior.evidence + without(whole, design.z)
    return Weighed(one, design, prior, evidence, float(scores[0]), scores[1:])


def p_value(weighed: Sequence[Weighed]) -> float:
    """How often the best of all hypotheses is as credible by chance as the best is."""
    best = max(one.single for one in weighed)
    by_chance = np.max([one.by_chance for one in weighed], axis=0)
    return float((1 + np.sum(by_chance >= best)) / (len(by_chance) + 1))


def estimate_of(one: Weighed, widened: float) -> Estimate:
    """The time courses of one hypothesis."""
    return estimated(one.design.products(one.hypothesis, widened), one.prior)


def widening(one: Weighed, widened: float) -> float:
    """By how much the variance of noise is to be multiplied because of what is left: its size times its correlation time."""
    found = estimate_of(one, widened)
    return widened_for(one.design.left(one.hypothesis, np.concatenate([found.u, found.z])))


def widened_for(left: Sequence[Matrix]) -> float:
    """The factor for residuals (channels, bins) by run."""
    total = sum(float(row @ row) * autocorrelation_time(row) for residuals in left for row in residuals)
    return max(1.0, total / sum(residuals.size for residuals in left))


def floor_of(one: Weighed, gap: Sequence[Matrix], widened: float) -> Vector:
    """The course (m,) that the difference of the kinetics would be taken for."""
    whole = one.design.products(one.hypothesis, widened)
    pull = one.design.pulls(one.hypothesis, [part.reshape(-1, 1) for part in gap])[:, 0] / widened
    m = len(one.prior.root)
    data = Products(whole.gram, pull, 0.0, whole.count)
    return solved(data, with_shifts(one.prior, len(pull) - m))[0][:m]


def error_of(design: Design, squares: float, widened: float = 1.0) -> float:
    """Error over noise of all samples from a sum of squares over the bins."""
    samples = sum(run.samples for run in design.runs)
    return float(np.sqrt(max(sum(run.excess for run in design.runs) + widened * squares, 0.0) / samples))


def errors_in_gaps(one: Weighed, widened: float) -> tuple[float, float]:
    """Error over noise in gaps that are left out in turn: without the hypothesis and with it."""
    whole = one.design.products(one.hypothesis, widened)
    gaps = [one.design.products(one.hypothesis, widened, fold) for fold in range(FOLDS)]
    before, after = predicted(whole, gaps, one.prior)
    return error_of(one.design, before, widened), error_of(one.design, after, widened)


def weigh_all(
    design: Design, hypotheses: Sequence[Hypothesis], T_E: float, gap: Sequence[Matrix], seed: int, pool: Executor,
    stop: Event,
) -> list[Weighed]:  # fmt: skip
    """All hypotheses, the most credible first. Raises Stopped."""
    noise = chance(design, gap, seed)
    jobs = [partial(weigh, design, one, T_E, noise) for one in hypotheses]
    return sorted(dealt(jobs, pool, stop), key=lambda one: -one.evidence)
