"""What an experiment is worth: evidence between hypotheses after each is refitted, or knowledge of parameters.

All in whitened unknowns u (posterior of the recordings: mean 0, covariance 1). With G the derivatives of the channels over
noise by u, a hypothesis expects the channels to scatter with S = 1 + G^T G, and S^-1 = 1 - G^T M^-1 G, M = 1 + G G^T:
S^-1 takes out what it can follow by refitting, at the price of leaving what the recordings say. docs/next.md derives it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.design.trial import Foretold

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


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

    def refitted(self, difference: Vector) -> Vector:
        """The unknowns (m,) that follow a difference (N,) best, at the price of leaving what the recordings say."""
        return np.asarray(self.inverse @ (self.G @ difference))

    @property
    def freedom(self) -> float:
        """Squares of pure noise that refitting takes away."""
        return len(self.inverse) - float(np.trace(self.inverse))

    def residual(self, difference: Vector) -> Vector:
        """What is left of one difference (N,), as the best refit shows it."""
        return difference - self.refitted(difference) @ self.G


def follower(one: Foretold) -> Follower:
    """A hypothesis at its best fit."""
    G = one.jacobians[0]
    M = np.eye(len(G)) + G @ G.T
    return Follower(one.centres[0], G, np.linalg.inv(M), float(np.linalg.slogdet(M)[1]))


def ratios(misfits: Mapping[tuple[int, int], Vector], followers: Sequence[Follower]) -> list[Ratio]:
    """Every ordered pair (true, rival), from the squares (d,) that the refitted rival leaves of each draw.

    log p(y | true)/p(y | rival), expected over the noise.
    """
    return [
        Ratio(a, b, tuple((0.5 * (left - followers[b].freedom + followers[b].log_det - followers[a].log_det)).tolist()))
        for (a, b), left in misfits.items()
    ]


def worth_of_ratios(found: Sequence[Ratio], counted: Sequence[tuple[int, int]]) -> float:
    """Mean of log(1 + ratio) over the pairs and draws: no direction and no draw is bought with another's loss."""
    values = [one.draws for one in found if (one.true, one.rival) in counted]
    return float(np.mean(np.log1p(np.maximum(np.array(values), 0.0))))


@dataclass(frozen=True)
class Known:
    """Standard deviations (k,) of combinations of the shared unknowns, and the log determinant of their covariance."""

    std: Vector
    log_det: float


def known(weights: Matrix, root: Matrix, foretold: Foretold | None = None, centre: int = 0) -> Known:
    """How well `weights` (k, n) of the shared unknowns are known: by the recordings, and by the trial too if given."""
    n, rows = len(root), weights @ root
    inner = np.eye(n)
    if foretold is not None:
        G = foretold.jacobians[centre]
        inner = np.linalg.inv(np.eye(len(G)) + G @ G.T)[:n, :n]
    covariance = rows @ inner @ rows.T
    return Known(np.sqrt(np.diag(covariance)), float(np.linalg.slogdet(covariance)[1]))


def gain(weights: Matrix, root: Matrix, foretold: Foretold) -> float:
    """Information [nat] on the combinations, averaged over the places at which the derivatives were taken."""
    before = known(weights, root).log_det
    centres = range(len(foretold.centres))
    return float(np.mean([0.5 * (before - known(weights, root, foretold, c).log_det) for c in centres]))


def weak_directions(covariance: Matrix, weak: float, fewest: int) -> Matrix:
    """Combinations (k, n), of unit length, whose standard deviation exceeds `weak`; at least the `fewest` weakest."""
    size, vectors = np.linalg.eigh(covariance)
    count = max(int(np.sum(size > weak**2)), min(fewest, len(size)))
    chosen: Matrix = vectors[:, len(size) - count :].T
    return chosen
