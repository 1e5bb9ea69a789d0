"""Gaussian inference of unknown inputs: evidence, estimate, effective number of parameters, prediction of gaps.

Residuals over noise change by S u + J z with the values u at the knots, prior covariance C, and shifts z of all fitted
parameters, prior 1. Everything follows from the products of the rows of (S, J) with one another and with the residuals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from sma_sim.model.arrays import Matrix, Vector

AMPLITUDES = np.logspace(-3.0, 3.0, 25)  # of u, in probes
RANK_TOLERANCE = 1e-8  # eigenvalues of a covariance below this fraction of the largest are dropped
MIXTURE_WEIGHT = 0.3  # of the second covariance of a mixture, relative to the first


@dataclass(frozen=True)
class SufficientStatistics:
    """Of the rows D (m + n, N) of (S, J): `gram` D D', `score` D r, `squares` r r, and N. They add up over parts of data."""

    gram: Matrix
    score: Vector
    squares: float
    count: int

    def without(self, part: SufficientStatistics) -> SufficientStatistics:
        """Those of the data without a part."""
        return SufficientStatistics(
            self.gram - part.gram, self.score - part.score, self.squares - part.squares, self.count - part.count
        )


def sum_of_statistics(parts: Sequence[SufficientStatistics]) -> SufficientStatistics:
    """Those of several parts of the data together."""
    return SufficientStatistics(
        np.sum([part.gram for part in parts], axis=0),
        np.sum([part.score for part in parts], axis=0),
        sum(part.squares for part in parts),
        sum(part.count for part in parts),
    )


@dataclass(frozen=True)
class Prior:
    """A covariance of u: its description, its root L (m, k) with C = L L', and the log evidence over that of u = 0.

    `dof`: the effective number of values of u that the data determine.
    """

    description: str
    root: Matrix
    log_evidence: float
    dof: float


def covariance_root(covariance: Matrix) -> Matrix:
    """L with C = L L', its smallest eigenvalues dropped."""
    eigenvalues, vectors = eigh(covariance)
    keep = eigenvalues > RANK_TOLERANCE * eigenvalues[-1]
    root: Matrix = vectors[:, keep] * np.sqrt(eigenvalues[keep])
    return root


def schur_complement(data: SufficientStatistics, m: int) -> tuple[Matrix, Matrix]:
    """Gram (m, m) of u with z eliminated, and the matrix (m, n) that subtracts the share of z from a score."""
    n = len(data.score) - m
    elimination: Matrix = np.asarray(np.linalg.solve(data.gram[m:, m:] + np.eye(n), data.gram[m:, :m]).T, float)
    return data.gram[:m, :m] - elimination @ data.gram[m:, :m], elimination


def null_log_evidence(data: SufficientStatistics, z: Vector) -> float:
    """Log evidence of the data with u = 0, up to a constant that no model changes; z is where it was linearized."""
    n = len(z)
    hessian, score = data.gram[-n:, -n:] + np.eye(n), data.score[-n:]
    misfit = data.squares + float(z @ z) - float(score @ np.linalg.solve(hessian, score))
    return -0.5 * misfit - 0.5 * float(np.linalg.slogdet(hessian)[1])


def best_amplitude(gram: Matrix, score: Vector, description: str, covariance: Matrix) -> Prior:
    """A covariance at its best amplitude, for a score (m,)."""
    root = covariance_root(covariance)
    information, vectors = eigh(root.T @ gram @ root)
    squared_score = (vectors.T @ (root.T @ score)) ** 2
    seen = AMPLITUDES[:, None] ** 2 * np.maximum(information, 0.0)
    log_evidences = 0.5 * np.sum(AMPLITUDES[:, None] ** 2 * squared_score / (1.0 + seen) - np.log1p(seen), axis=1)
    best = int(np.argmax(log_evidences))
    dof = float(np.sum(seen[best] / (1.0 + seen[best])))
    return Prior(description, AMPLITUDES[best] * root, float(log_evidences[best]), dof)


def best_prior(gram: Matrix, score: Vector, covariances: Mapping[str, Matrix], mixed: bool) -> Prior:
    """The covariance of largest evidence, or (`mixed`) the best mixture of two, for a score (m,)."""
    singles = [best_amplitude(gram, score, name, covariance) for name, covariance in covariances.items()]
    first = max(singles, key=lambda prior: prior.log_evidence)
    size = float(np.mean(np.sum(first.root**2, axis=1)))
    mixtures = [
        best_amplitude(
            gram, score, f'{first.description}; {name}', first.root @ first.root.T + MIXTURE_WEIGHT * size * covariance
        )
        for name, covariance in covariances.items()
        if mixed and name != first.description
    ]
    return max([first, *mixtures], key=lambda prior: prior.log_evidence)


@dataclass(frozen=True)
class Estimate:
    """u (m,) with its standard deviation, shifts z (n,) of the fitted parameters, and the squares that are left."""

    u: Vector
    std: Vector
    z: Vector
    squares: float


def joint_root(prior: Prior, n: int) -> Matrix:
    """The root of the prior of (u, z), (m + n, k + n)."""
    m, k = prior.root.shape
    root = np.zeros((m + n, k + n))
    root[:m, :k], root[m:, k:] = prior.root, np.eye(n)
    return root


def posterior(data: SufficientStatistics, root: Matrix) -> tuple[Vector, Matrix]:
    """Mean of (u, z), and the inner matrix of the posterior covariance: covariance = root inverse root'."""
    inverse: Matrix = np.asarray(np.linalg.inv(root.T @ data.gram @ root + np.eye(root.shape[1])), float)
    mean: Vector = -root @ (inverse @ (root.T @ data.score))
    return mean, inverse


def squares_at(data: SufficientStatistics, x: Vector) -> float:
    """Sum of the squared residuals after a change x of (u, z)."""
    return float(data.squares + 2.0 * x @ data.score + x @ data.gram @ x)


def posterior_estimate(data: SufficientStatistics, prior: Prior) -> Estimate:
    """Mean and standard deviation of u."""
    m = len(prior.root)
    root = joint_root(prior, len(data.score) - m)
    x, inverse = posterior(data, root)
    std = np.sqrt(np.sum((root[:m] @ inverse) * root[:m], axis=1))
    return Estimate(x[:m], std, x[m:], squares_at(data, x))


def squares_in_gaps(data: SufficientStatistics, gaps: Sequence[SufficientStatistics], prior: Prior) -> tuple[float, float]:
    """Sums of squares in gaps of the data that are left out in turn: with u = 0, and with u estimated from the rest."""
    m = len(prior.root)
    n = len(data.score) - m
    with_input, without_input = joint_root(prior, n), np.vstack([np.zeros((m, n)), np.eye(n)])
    before = sum(squares_at(gap, posterior(data.without(gap), without_input)[0]) for gap in gaps)
    return before, sum(squares_at(gap, posterior(data.without(gap), with_input)[0]) for gap in gaps)
