"""The evidence of all hypotheses, compared with one another and with chance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.overdispersion import autocorrelation_time
from sma_sim.evidence.estimation.search_context import SearchContext, Stop
from sma_sim.evidence.latent_input.covariances import prior_covariances
from sma_sim.evidence.latent_input.design_matrix import GAP_FOLDS, DesignMatrix, Stopped
from sma_sim.evidence.latent_input.hypotheses import InputHypothesis
from sma_sim.evidence.latent_input.inference import (
    Estimate,
    Prior,
    SufficientStatistics,
    best_prior,
    joint_root,
    null_log_evidence,
    posterior,
    posterior_estimate,
    schur_complement,
    squares_in_gaps,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
JobResult = TypeVar('JobResult')
NULL_DRAWS = 299  # so that the smallest p-value, 1/300, lies well below the significance that is asked for


@dataclass(frozen=True)
class HypothesisEvidence:
    """A hypothesis with the prior that the data prefer, and the best evidence of each draw of chance, (NULL_DRAWS,).

    `design`: the model around which it was evaluated. `log_evidence`: comparable between designs. `single`: log evidence of
    the best covariance by itself over u = 0, with which chance is compared.
    """

    hypothesis: InputHypothesis
    design: DesignMatrix
    prior: Prior
    log_evidence: float
    single: float
    null_draws: Vector


def results_of(jobs: Sequence[Callable[[], JobResult]], pool: Executor, stop: Stop) -> list[JobResult]:
    """The results of jobs, in order. Raises Stopped."""
    futures = [pool.submit(job) for job in jobs]
    results = []
    for future in futures:
        if stop.is_set():
            for pending in futures:
                pending.cancel()
            raise Stopped
        results.append(future.result())
    return results


def null_residuals(design: DesignMatrix, kinetics_difference: Sequence[Matrix], seed: int) -> list[Matrix]:
    """Residuals where nothing is missing, (channels bins, NULL_DRAWS) by run.

    White noise, and the difference of the kinetics (channels, bins) at a random size.
    """
    random = np.random.default_rng(seed)
    sizes = random.standard_normal(NULL_DRAWS)
    return [
        random.standard_normal((run.residuals.size, NULL_DRAWS)) + difference.ravel()[:, None] * sizes
        for run, difference in zip(design.runs, kinetics_difference, strict=True)
    ]


def evidence_of(
    design: DesignMatrix, hypothesis: InputHypothesis, null: Sequence[Matrix] = (), inflation: float = 1.0,
    mixed: bool = True,
) -> HypothesisEvidence:  # fmt: skip
    """The prior that the data prefer for one hypothesis: a mixture if `mixed`, a single covariance where `null` is given."""
    knots = design.knot_states(hypothesis)
    data = design.statistics(hypothesis, inflation)
    m = len(data.score) - len(design.z)
    gram, elimination = schur_complement(data, m)
    scores = np.column_stack([data.score, design.scores(hypothesis, null)]) if null else data.score[:, None]
    prior, log_evidences = best_prior(
        gram, elimination @ scores[m:] - scores[:m], prior_covariances(hypothesis.hook, knots), mixed and not null
    )
    log_evidence = prior.log_evidence + null_log_evidence(data, design.z)
    return HypothesisEvidence(hypothesis, design, prior, log_evidence, float(log_evidences[0]), log_evidences[1:])


def family_p_value(evidences: Sequence[HypothesisEvidence]) -> float:
    """How often the best of all hypotheses has as much evidence by chance as the best has here."""
    best = max(evidence.single for evidence in evidences)
    by_chance = np.max([evidence.null_draws for evidence in evidences], axis=0)
    return float((1 + np.sum(by_chance >= best)) / (len(by_chance) + 1))


def estimate_of(evidence: HypothesisEvidence, inflation: float) -> Estimate:
    """The inputs of one hypothesis."""
    return posterior_estimate(evidence.design.statistics(evidence.hypothesis, inflation), evidence.prior)


def noise_inflation(evidence: HypothesisEvidence, inflation: float) -> float:
    """The factor on the noise variance that the residuals call for: their size times their correlation time."""
    estimate = estimate_of(evidence, inflation)
    x = np.concatenate([estimate.u, estimate.z])
    return inflation_from(evidence.design.residuals_after(evidence.hypothesis, x))


def inflation_from(residuals: Sequence[Matrix]) -> float:
    """The factor for residuals (channels, bins) by run; at least 1."""
    total = sum(float(row @ row) * autocorrelation_time(row) for run in residuals for row in run)
    return max(1.0, total / sum(run.size for run in residuals))


def kinetics_bias(evidence: HypothesisEvidence, kinetics_difference: Sequence[Matrix], inflation: float) -> Vector:
    """The input (m,) for which the difference of the kinetics (channels, bins) would be taken."""
    data = evidence.design.statistics(evidence.hypothesis, inflation)
    columns = [difference.reshape(-1, 1) for difference in kinetics_difference]
    score = evidence.design.scores(evidence.hypothesis, columns)[:, 0] / inflation
    m = len(evidence.prior.root)
    response = SufficientStatistics(data.gram, score, 0.0, data.count)
    return posterior(response, joint_root(evidence.prior, len(score) - m))[0][:m]


def error_from_squares(design: DesignMatrix, squares: float, inflation: float = 1.0) -> float:
    """Error over noise of all samples from a sum of squares over the bins."""
    samples = sum(run.samples for run in design.runs)
    return float(np.sqrt(max(sum(run.excess for run in design.runs) + inflation * squares, 0.0) / samples))


def errors_in_gaps(evidence: HypothesisEvidence, inflation: float) -> tuple[float, float]:
    """Error over noise in gaps that are left out in turn: without the hypothesis and with it."""
    design, hypothesis = evidence.design, evidence.hypothesis
    gaps = [design.statistics(hypothesis, inflation, fold) for fold in range(GAP_FOLDS)]
    before, after = squares_in_gaps(design.statistics(hypothesis, inflation), gaps, evidence.prior)
    return error_from_squares(design, before, inflation), error_from_squares(design, after, inflation)


def rank_hypotheses(
    design: DesignMatrix,
    hypotheses: Sequence[InputHypothesis],
    kinetics_difference: Sequence[Matrix],
    context: SearchContext,
) -> list[HypothesisEvidence]:
    """All hypotheses, that of most evidence first. Raises Stopped."""
    null = null_residuals(design, kinetics_difference, context.seed)
    jobs = [partial(evidence_of, design, hypothesis, null) for hypothesis in hypotheses]
    return sorted(results_of(jobs, context.pool, context.stop), key=lambda evidence: -evidence.log_evidence)
