"""The evidence of all hypotheses, and with which probability it is one of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from scipy.special import expit

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
from sma_sim.evidence.search.prior import SPARSITY, UNLISTED
from sma_sim.evidence.search.score import log_sum
from sma_sim.model.arrays import Matrix, Vector

JobResult = TypeVar('JobResult')


@dataclass(frozen=True)
class HypothesisEvidence:
    """A hypothesis with the prior of its inputs that the data prefer.

    `design`: the model around which it was evaluated. `log_evidence`: comparable between designs.
    """

    hypothesis: InputHypothesis
    design: DesignMatrix
    prior: Prior
    log_evidence: float


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


def evidence_of(
    design: DesignMatrix, hypothesis: InputHypothesis, inflation: float = 1.0, mixed: bool = True
) -> HypothesisEvidence:
    """The prior that the data prefer for one hypothesis: a mixture of two covariances if `mixed`, else one."""
    knots = design.knot_states(hypothesis)
    data = design.statistics(hypothesis, inflation)
    m = len(data.score) - len(design.z)
    gram, elimination = schur_complement(data, m)
    score = elimination @ data.score[m:] - data.score[:m]
    prior = best_prior(gram, score, prior_covariances(hypothesis.hook, knots), mixed)
    return HypothesisEvidence(hypothesis, design, prior, prior.log_evidence + null_log_evidence(data, design.z))


def probability_missing(log_evidences: Sequence[float], hypotheses: int) -> float:
    """That one of several `hypotheses` is true, by the log evidences of the best of them over nothing missing.

    Each has the prior of what no list has (`sma_sim.evidence.search.score`), shared by all of them.
    """
    log_odds = log_sum(log_evidences) - SPARSITY - UNLISTED - float(np.log(hypotheses))
    return float(expit(log_odds))


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
    score = evidence.design.score(evidence.hypothesis, kinetics_difference) / inflation
    m = len(evidence.prior.root)
    response = SufficientStatistics(data.gram, score, 0.0, data.count)
    return posterior(response, joint_root(evidence.prior, len(score) - m))[0][:m]


def error_from_squares(design: DesignMatrix, squares: float, inflation: float = 1.0) -> float:
    """Normalized RMSE of all samples from a sum of squares over the bins."""
    samples = sum(run.samples for run in design.runs)
    return float(np.sqrt(max(sum(run.excess for run in design.runs) + inflation * squares, 0.0) / samples))


def errors_in_gaps(evidence: HypothesisEvidence, inflation: float) -> tuple[float, float]:
    """Normalized RMSE in gaps that are left out in turn: without the hypothesis and with it."""
    design, hypothesis = evidence.design, evidence.hypothesis
    gaps = [design.statistics(hypothesis, inflation, fold) for fold in range(GAP_FOLDS)]
    before, after = squares_in_gaps(design.statistics(hypothesis, inflation), gaps, evidence.prior)
    return error_from_squares(design, before, inflation), error_from_squares(design, after, inflation)


def rank_hypotheses(
    design: DesignMatrix, hypotheses: Sequence[InputHypothesis], context: SearchContext
) -> list[HypothesisEvidence]:
    """All hypotheses, that of most evidence first. Raises Stopped."""
    jobs = [partial(evidence_of, design, hypothesis, mixed=False) for hypothesis in hypotheses]
    return sorted(results_of(jobs, context.pool, context.stop), key=lambda evidence: -evidence.log_evidence)
