"""Gaussian inference of time courses: evidence, estimate, effective number of parameters, and what is foretold of gaps.

Residuals over noise change by S u + J z with the values u at the knots, prior covariance C, and shifts z of all that was
fitted, prior 1. Everything follows from the products of the rows of (S, J) with one another and with the residuals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
SIZES = np.logspace(-3.0, 3.0, 25)  # of u, in probes
RANK = 1e-8  # of a covariance: smaller parts of it are left out
MIXED = 0.3  # share of a second covariance beside the first


@dataclass(frozen=True)
class Products:
    """Of the rows D (m + n, N) of (S, J): `gram` D D', `pull` D r, `squares` r r, and N. They add up over parts of data."""

    gram: Matrix
    pull: Vector
    squares: float
    count: int

    def less(self, part: Products) -> Products:
        """Without a part of the data."""
        return Products(self.gram - part.gram, self.pull - part.pull, self.squares - part.squares, self.count - part.count)


def added(parts: Sequence[Products]) -> Products:
    """The sum of parts of the data."""
    return Products(
        np.sum([p.gram for p in parts], axis=0), np.sum([p.pull for p in parts], axis=0),
        sum(p.squares for p in parts), sum(p.count for p in parts),
    )  # fmt: skip


@dataclass(frozen=True)
class Prior:
    """A covariance of u: in words, its root L (m, k) with C = L L', and the log evidence over that of no u at all."""

    words: str
    root: Matrix
    evidence: float
    dof: float


def root_of(covariance: Matrix) -> Matrix:
    """L with C = L L', small parts left out."""
    size, vectors = np.linalg.eigh(covariance)
    keep = size > RANK * size[-1]
    root: Matrix = vectors[:, keep] * np.sqrt(size[keep])
    return root


def projected(whole: Products, m: int) -> tuple[Matrix, Matrix]:
    """Gram (m, m) of u with z eliminated, and the matrix (m, n) that takes z's share from a pull."""
    n = len(whole.pull) - m
    share: Matrix = np.asarray(np.linalg.solve(whole.gram[m:, m:] + np.eye(n), whole.gram[m:, :m]).T, float)
    return whole.gram[:m, :m] - share @ whole.gram[m:, :m], share


def without(whole: Products, z: Vector) -> float:
    """Log evidence of the data without any u, but for what does not depend on the model; z is where it was linearised."""
    n = len(z)
    hessian, pull = whole.gram[-n:, -n:] + np.eye(n), whole.pull[-n:]
    misfit = whole.squares + float(z @ z) - float(pull @ np.linalg.solve(hessian, pull))
    return -0.5 * misfit - 0.5 * float(np.linalg.slogdet(hessian)[1])


def weighted(gram: Matrix, pulls: Matrix, words: str, covariance: Matrix) -> tuple[Prior, Vector]:
    """A covariance at its best size, and the best log evidence (draws,) for each column of the pulls (m, draws).

    The first column is that of the measurement: its size is the one taken.
    """
    root = root_of(covariance)
    known, vectors = np.linalg.eigh(root.T @ gram @ root)
    known = np.maximum(known, 0.0)[:, None]
    seen = (vectors.T @ (root.T @ pulls)) ** 2
    scores = np.array([
        0.5 * np.sum(size**2 * seen / (1.0 + size**2 * known) - np.log1p(size**2 * known), axis=0) for size in SIZES
    ])  # fmt: skip
    best = int(np.argmax(scores[:, 0]))
    size = SIZES[best]
    dof = float(np.sum(size**2 * known / (1.0 + size**2 * known)))
    return Prior(words, size * root, float(scores[best, 0]), dof), scores.max(axis=0)


def best_prior(gram: Matrix, pulls: Matrix, covariances: Mapping[str, Matrix], mixed: bool) -> tuple[Prior, Vector]:
    """The most credible of the covariances, or (`mixed`) of its mixtures; and the best evidence of single ones by column."""
    found = {words: weighted(gram, pulls, words, one) for words, one in covariances.items()}
    by_chance = np.max([scores for _, scores in found.values()], axis=0)
    first = max((prior for prior, _ in found.values()), key=lambda prior: prior.evidence)
    size = float(np.mean(np.sum(first.root**2, axis=1)))
    mixtures = [
        weighted(gram, pulls[:, :1], f'{first.words}; {words}', first.root @ first.root.T + MIXED * size * one)[0]
        for words, one in covariances.items() if mixed and words != first.words
    ]  # fmt: skip
    return max([first, *mixtures], key=lambda prior: prior.evidence), by_chance


@dataclass(frozen=True)
class Estimate:
    """u (m,) with its standard deviation, the shifts z (n,) of what was fitted, and the sum of squares that is left."""

    u: Vector
    std: Vector
    z: Vector
    squares: float


def with_shifts(prior: Prior, n: int) -> Matrix:
    """The root of the prior of (u, z)."""
    m, k = prior.root.shape
    root = np.zeros((m + n, k + n))
    root[:m, :k], root[m:, k:] = prior.root, np.eye(n)
    return root


def solved(data: Products, root: Matrix) -> tuple[Vector, Matrix]:
    """Mean of (u, z), and the root's share of the posterior: covariance root inverse root'."""
    inverse: Matrix = np.asarray(np.linalg.inv(root.T @ data.gram @ root + np.eye(root.shape[1])), float)
    mean: Vector = -root @ (inverse @ (root.T @ data.pull))
    return mean, inverse


def squares_at(data: Products, x: Vector) -> float:
    """Sum of the squared residuals after a change x of (u, z)."""
    return float(data.squares + 2.0 * x @ data.pull + x @ data.gram @ x)


def estimated(data: Products, prior: Prior) -> Estimate:
    """The posterior of u."""
    m = len(prior.root)
    root = with_shifts(prior, len(data.pull) - m)
    x, inverse = solved(data, root)
    std = np.sqrt(np.sum((root[:m] @ inverse) * root[:m], axis=1))
    return Estimate(x[:m], std, x[m:], squares_at(data, x))


def predicted(whole: Products, gaps: Sequence[Products], prior: Prior) -> tuple[float, float]:
    """Sums of squares in gaps of the data that are left out in turn: without u and with it."""
    m = len(prior.root)
    n = len(whole.pull) - m
    root, bare = with_shifts(prior, n), np.vstack([np.zeros((m, n)), np.eye(n)])
    without = sum(squares_at(gap, solved(whole.less(gap), bare)[0]) for gap in gaps)
    return without, sum(squares_at(gap, solved(whole.less(gap), root)[0]) for gap in gaps)
