"""What an experiment is worth: evidence between hypotheses after each is refitted, or knowledge of parameters.

All in whitened unknowns u (posterior of the recordings: mean 0, covariance 1). With G the derivatives of the channels over
noise by u, a hypothesis expects the channels to scatter with S = 1 + G^T G, and S^-1 = 1 - G^T M^-1 G, M = 1 + G G^T:
S^-1 takes out what it can follow by refitting, at the price of leaving what the recordings say.
docs/explanation/experiment-design.md derives it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.experiment_design.forecast import Foretold

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
DRAWS = 8  # from the posterior of what is taken for true, in opposite pairs


@dataclass(frozen=True)
class Ratio:
    """Expected log evidence ratio (natural) for `true` against `rival`, one for each draw of the true one's posterior."""

    true: int
    rival: int
    draws: tuple[float, ...]

    @property
    def mean(self) -> float:
        """Averaged over the posterior."""
        return float(np.mean(self.draws))


@dataclass(frozen=True)
class Follower:
    """A hypothesis as one that is refitted: G (m, N), M^-1 (m, m) and its log determinant, at its best fit."""

    centre: Vector
    G: Matrix
    inverse: Matrix
    log_det: float

    def left(self, differences: Matrix) -> Vector:
        """Squares (d,) of differences (d, N) that the best refit leaves, the price of leaving the recordings included."""
        pull = differences @ self.G.T
        squares = np.einsum('dn,dn->d', differences, differences)
        rest: Vector = squares - np.einsum('di,ij,dj->d', pull, self.inverse, pull)
        return np.maximum(rest, 0.0)

    @property
    def freedom(self) -> float:
        """Squares of pure noise that refitting takes away."""
        return len(self.inverse) - float(np.trace(self.inverse))

    def residual(self, difference: Vector) -> Vector:
        """What is left of one difference (N,), as the best refit shows it."""
        return difference - (self.inverse @ (self.G @ difference)) @ self.G


def follower(one: Foretold) -> Follower:
    """A hypothesis at its best fit."""
    G = one.jacobians[0]
    M = np.eye(len(G)) + G @ G.T
    return Follower(one.centres[0], G, np.linalg.inv(M), float(np.linalg.slogdet(M)[1]))


def ratios(predicted: Sequence[Foretold], pairs: Sequence[tuple[int, int]]) -> list[Ratio]:
    """log p(y | true)/p(y | rival) of pairs (true, rival), expected over the noise, at draws from the true one's posterior.

    The draws are those of the linearised model, the same for every command and in opposite pairs: their mean is the fit.
    """
    followers = {k: follower(predicted[k]) for pair in pairs for k in pair}
    found = []
    for a, b in pairs:
        true, rival = followers[a], followers[b]
        half = np.random.default_rng(a).normal(size=(DRAWS // 2, len(true.G)))
        left = rival.left(true.centre - rival.centre + np.concatenate([half, -half]) @ true.G)
        found.append(Ratio(a, b, tuple((0.5 * (left - rival.freedom + rival.log_det - true.log_det)).tolist())))
    return found


def when_refitted(predicted: Sequence[Foretold], pairs: Sequence[tuple[int, int]], left: Matrix) -> list[Ratio]:
    """The same, given half the squares that a refitted rival leaves, `left` (pairs, draws)."""
    followers = {k: follower(predicted[k]) for pair in pairs for k in pair}
    gained = [0.5 * (followers[b].log_det - followers[a].log_det - followers[b].freedom) for a, b in pairs]
    return [Ratio(a, b, tuple((own + more).tolist())) for (a, b), own, more in zip(pairs, left, gained, strict=True)]


def worth_of_ratios(found: Sequence[Ratio]) -> float:
    """Mean of log(1 + ratio) over pairs and draws: no direction and no draw is bought with another's loss."""
    return float(np.mean(np.log1p(np.maximum(np.array([one.draws for one in found]), 0.0))))


@dataclass(frozen=True)
class Known:
    """Standard deviations (k,) of combinations of the shared unknowns, and the log determinant of their covariance."""

    std: Vector
    log_det: float


def known(weights: Matrix, root: Matrix, predicted: Foretold | None = None, centre: int = 0) -> Known:
    """How well `weights` (k, n) of the shared unknowns are known: by the recordings, and by the trial too if given."""
    n, rows = len(root), weights @ root
    inner = np.eye(n)
    if predicted is not None:
        G = predicted.jacobians[centre]
        inner = np.linalg.inv(np.eye(len(G)) + G @ G.T)[:n, :n]
    covariance = rows @ inner @ rows.T
    return Known(np.sqrt(np.diag(covariance)), float(np.linalg.slogdet(covariance)[1]))


def gain(weights: Matrix, root: Matrix, predicted: Foretold) -> float:
    """Information [nat] on the combinations, averaged over the places at which the derivatives were taken."""
    before = known(weights, root).log_det
    centres = range(len(predicted.centres))
    return float(np.mean([0.5 * (before - known(weights, root, predicted, c).log_det) for c in centres]))


def weak_directions(covariance: Matrix, weak: float, fewest: int) -> Matrix:
    """Combinations (k, n), of unit length, whose standard deviation exceeds `weak`; at least the `fewest` weakest."""
    size, vectors = np.linalg.eigh(covariance)
    count = max(int(np.sum(size > weak**2)), min(fewest, len(size)))
    chosen: Matrix = vectors[:, len(size) - count :].T
    return chosen
