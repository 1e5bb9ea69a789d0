"""The utility of an experiment: evidence between hypotheses after each is refitted, or information on parameters.

All in whitened unknowns u (posterior of the recordings: mean 0, covariance 1). With G the derivatives of the channels over
noise by u, a hypothesis expects the channels to scatter with S = 1 + G^T G, and S^-1 = 1 - G^T M^-1 G, M = 1 + G G^T:
S^-1 removes what it can follow by refitting, at the price of leaving what the recordings say.
docs/explanation/experiment-design.md derives it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from sma_sim.evidence.experiment_design.forecast import RunPrediction
from sma_sim.model.arrays import Matrix, Vector

POSTERIOR_DRAWS = 8  # of the hypothesis taken for true, in opposite pairs


class RivalPair(NamedTuple):
    """Indices of two hypotheses: the one taken for true, and the one refitted against it."""

    true: int
    rival: int


@dataclass(frozen=True)
class EvidenceRatio:
    """Expected log evidence ratio (natural) of a pair, one for each draw of the true one's posterior."""

    pair: RivalPair
    draws: tuple[float, ...]

    @property
    def mean(self) -> float:
        """Averaged over the posterior."""
        return float(np.mean(self.draws))


@dataclass(frozen=True)
class LinearizedRival:
    """A hypothesis that is refitted, linearized: G (m, N), M^-1 (m, m) and the log determinant of M, at its best fit."""

    centre: Vector
    G: Matrix
    inverse: Matrix
    log_det: float

    def squares_left(self, differences: Matrix) -> Vector:
        """Squares (d,) of differences (d, N) that the best refit leaves, the price of leaving the recordings included."""
        score = differences @ self.G.T
        squares = np.einsum('dn,dn->d', differences, differences)
        left: Vector = squares - np.einsum('di,ij,dj->d', score, self.inverse, score)
        return np.maximum(left, 0.0)

    @property
    def dof(self) -> float:
        """Squares of pure noise that refitting removes."""
        return len(self.inverse) - float(np.trace(self.inverse))

    def residual(self, difference: Vector) -> Vector:
        """What the best refit leaves of one difference (N,)."""
        return difference - (self.inverse @ (self.G @ difference)) @ self.G


def linearized_rival(prediction: RunPrediction) -> LinearizedRival:
    """A hypothesis at its best fit."""
    G = prediction.jacobians[0]
    M = np.eye(len(G)) + G @ G.T
    return LinearizedRival(prediction.centres[0], G, np.linalg.inv(M), float(np.linalg.slogdet(M)[1]))


def linearized_rivals(predictions: Sequence[RunPrediction], pairs: Sequence[RivalPair]) -> dict[int, LinearizedRival]:
    """The hypotheses of some pairs, by their index."""
    return {k: linearized_rival(predictions[k]) for pair in pairs for k in pair}


def evidence_ratios(predictions: Sequence[RunPrediction], pairs: Sequence[RivalPair]) -> list[EvidenceRatio]:
    """log p(y | true)/p(y | rival) of pairs, expected over the noise, at draws from the true one's posterior.

    The draws are those of the linearized model, the same for every command and in opposite pairs: their mean is the fit.
    """
    rivals = linearized_rivals(predictions, pairs)
    ratios = []
    for pair in pairs:
        true, rival = rivals[pair.true], rivals[pair.rival]
        half = np.random.default_rng(pair.true).normal(size=(POSTERIOR_DRAWS // 2, len(true.G)))
        left = rival.squares_left(true.centre - rival.centre + np.concatenate([half, -half]) @ true.G)
        ratios.append(EvidenceRatio(pair, tuple((0.5 * (left - rival.dof + rival.log_det - true.log_det)).tolist())))
    return ratios


def refitted_evidence_ratios(
    predictions: Sequence[RunPrediction], pairs: Sequence[RivalPair], left: Matrix
) -> list[EvidenceRatio]:
    """The same, given half the squares that a refitted rival leaves, `left` (pairs, draws)."""
    rivals = linearized_rivals(predictions, pairs)
    volumes = [0.5 * (rivals[p.rival].log_det - rivals[p.true].log_det - rivals[p.rival].dof) for p in pairs]
    return [
        EvidenceRatio(pair, tuple((draws + volume).tolist()))
        for pair, draws, volume in zip(pairs, left, volumes, strict=True)
    ]


def discrimination_utility(ratios: Sequence[EvidenceRatio]) -> float:
    """Mean of log(1 + ratio) over pairs and draws: no direction and no draw is bought with another's loss."""
    return float(np.mean(np.log1p(np.maximum(np.array([ratio.draws for ratio in ratios]), 0.0))))


@dataclass(frozen=True)
class CombinationPrecision:
    """Standard deviations (k,) of combinations of the shared unknowns, and the log determinant of their covariance."""

    std: Vector
    log_det: float


def combination_precision(
    combinations: Matrix, root: Matrix, prediction: RunPrediction | None = None, centre: int = 0
) -> CombinationPrecision:
    """How well `combinations` (k, n) of the shared unknowns are known: by the recordings, and by an experiment too if given.

    `root` (n, n): of the posterior covariance; `centre`: at which the derivatives were taken.
    """
    n, rows = len(root), combinations @ root
    inner = np.eye(n)
    if prediction is not None:
        G = prediction.jacobians[centre]
        inner = np.linalg.inv(np.eye(len(G)) + G @ G.T)[:n, :n]
    covariance = rows @ inner @ rows.T
    return CombinationPrecision(np.sqrt(np.diag(covariance)), float(np.linalg.slogdet(covariance)[1]))


def information_gain(combinations: Matrix, root: Matrix, prediction: RunPrediction) -> float:
    """Information [nat] on the combinations, averaged over the centres at which the derivatives were taken."""
    before = combination_precision(combinations, root).log_det
    centres = range(len(prediction.centres))
    after = [combination_precision(combinations, root, prediction, c).log_det for c in centres]
    return float(np.mean([0.5 * (before - log_det) for log_det in after]))


def weak_directions(covariance: Matrix, weak_std: float, fewest: int) -> Matrix:
    """Combinations (k, n), of unit length, whose standard deviation exceeds `weak_std`; at least the `fewest` weakest."""
    variances, vectors = eigh(covariance)
    count = max(int(np.sum(variances > weak_std**2)), min(fewest, len(variances)))
    weak: Matrix = vectors[:, len(variances) - count :].T
    return weak
