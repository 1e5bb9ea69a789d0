"""The integral of a posterior density that is normal between bounds: what Laplace's method needs where bounds cut it off.

By expectation propagation (Minka 2001): the bounds of every unknown are replaced by a normal factor that leaves it the mean
and the variance which it has between them while all others are normal. For boxes it is exact where no two unknowns are
correlated, and good to some hundredths of a nat else (Cunningham, Hennig and Lacoste-Julien 2011). All is kept as slopes and
precisions about the highest point within the bounds: where data pull far beyond these, the normal density without them has
neither a mean nor a height that a number could hold, and rounds that begin elsewhere swing.
"""

from __future__ import annotations

from math import inf

import numpy as np
from scipy.linalg import LinAlgError, eigh

from sma_sim.evidence.estimation.levenberg_marquardt import bounded_step
from sma_sim.model.arrays import Matrix, Vector

NODES, WEIGHTS = np.polynomial.legendre.leggauss(48)  # to 1e-9 of densities that fall by DEPTH
DEPTH = 40.0  # nats below the largest density beyond which nothing is left
EVEN = 12.0  # squares of its width over the variance of an even density, with which the rounds begin
KEPT = 0.3  # of the factors from the last round, which keeps rounds from swinging
ROUNDS, EXACT = 60, 1e-3  # rounds at most, and nats between two of them that end it
ROUNDING = 1e-15  # of a precision, by unknown: without it one of unknowns that data hardly tell apart may not be positive
SMALLEST = 1e-12  # of a precision, below which the difference of two is rounding error


def log_bounded_integral(slope: Vector, precision: Matrix, low: Vector, high: Vector) -> float:
    """log of (2 pi)^(-n/2) times the integral of exp(-slope x - x' precision x/2) over x (n,) between low and high (n,).

    The precision (n, n) is positive definite, and 0 lies between the bounds, which may be infinite. -inf where data pull so
    hard that no number holds the heights.
    """
    with np.errstate(over='ignore', invalid='ignore', divide='ignore'):
        size = 1.0 / np.sqrt(np.diag(precision))  # units in which rounding errors are small, however steep a model is
        slope, low, high = size * slope, low / size, high / size
        precision = np.outer(size, size) * precision + ROUNDING * len(low) * np.eye(len(low))
        try:
            top = bounded_step(slope, precision, 0.0, low, high)
            about = _by_expectation_propagation(slope + precision @ top, precision, low - top, high - top)
        except (LinAlgError, ValueError):  # of numbers that are none
            return -inf
        height = -float(slope @ top + 0.5 * top @ precision @ top)
        total = height + about + float(np.log(size).sum())
    return total if np.isfinite(total) else -inf


def _by_expectation_propagation(slope: Vector, precision: Matrix, low: Vector, high: Vector) -> float:
    """The same about the highest point, with a precision of diagonal 1; or not a number.

    Factors begin as those of densities that are even, or fall from a bound as this one does.
    """
    width, held = high - low, (low == 0.0) | (high == 0.0)
    even, falling = EVEN / width**2, np.where(held, slope**2, 0.0)
    factor = np.maximum(even, falling)
    pull = np.where(falling > even, 2.0 * slope, 0.5 * even * np.where(np.isfinite(width), low + high, 0.0))
    total, before, rounds = inf, -inf, 0
    while abs(total - before) > EXACT and rounds < ROUNDS:
        precisions, axes = eigh(precision + np.diag(factor))
        precisions = np.maximum(precisions, ROUNDING)
        covariance = (axes / precisions) @ axes.T
        mean, variance = covariance @ (pull - slope), np.diag(covariance)
        others = np.maximum(1.0 / variance - factor, SMALLEST / variance)
        towards = mean / variance - pull
        inside, means, variances = between_bounds(towards, others, low, high)
        normal = 0.5 * (mean**2 / variance + np.log(variance))
        before = total
        total = float(np.sum(inside - normal)) + 0.5 * float((pull - slope) @ mean - np.log(precisions).sum())
        needed = np.maximum(1.0 / variances - others, 0.0)
        pull = KEPT * pull + (1.0 - KEPT) * (means * (needed + others) - towards)
        factor = KEPT * factor + (1.0 - KEPT) * needed
        rounds += 1
    return min(total, -0.5 * float(np.linalg.slogdet(precision)[1]))  # no bounds leave more


def between_bounds(slope: Vector, precision: Vector, low: Vector, high: Vector) -> tuple[Vector, Vector, Vector]:
    """For every unknown alone: log of (2 pi)^(-1/2) times the integral of exp(slope x - precision x^2/2) between its bounds,
    and the mean and the variance of this density, all (n,); by Gauss-Legendre quadrature about its highest point."""
    top = np.clip(slope / precision, low, high)
    rise = np.where((top > low) & (top < high), 0.0, slope - precision * top)
    reach = 2.0 * DEPTH / (np.abs(rise) + np.sqrt(rise**2 + 2.0 * DEPTH * precision))
    first, last = np.maximum(low - top, -reach), np.minimum(high - top, reach)
    half = 0.5 * (last - first)
    x = first[:, None] + half[:, None] * (1.0 + NODES)
    density = WEIGHTS * np.exp(rise[:, None] * x - 0.5 * precision[:, None] * x**2)
    mass = density.sum(axis=1)
    mean = (density * x).sum(axis=1) / mass
    variance = (density * (x - mean[:, None]) ** 2).sum(axis=1) / mass
    height = slope * top - 0.5 * precision * top**2
    return height + np.log(half * mass / np.sqrt(2.0 * np.pi)), top + mean, variance
