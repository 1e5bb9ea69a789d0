"""How stable a choice among formulas is: how often each of them is chosen from random halves of the data.

Stability selection (Meinshausen and Buehlmann, J. R. Stat. Soc. B 72, 2010; in complementary pairs: Shah and Samworth,
ibid. 75, 2013), with what is costly left out: the formulas are not fitted again to each half, but the squares that each
leaves at its own fit are summed anew (as phylogenetics resamples likelihoods: Kishino, Miyata and Hasegawa, J. Mol. Evol.
31, 1990). Halves are made of segments of time, since residuals are correlated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor

import numpy as np

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.problem import Problem, residuals_at
from sma_sim.model.arrays import Vector

SEGMENTS_PER_RUN = 25  # each longer than residuals correlate
COMPLEMENTARY_PAIRS = 200  # of halves: shares are then known to within 3 %
TIE_TOLERANCE = 1e-9  # of the squares: rounding


def stabilities(fits: Sequence[FitResult], pool: Executor, seed: int = 0) -> Vector:
    """The share of random halves of the data in which each of several fits to the same runs is the best, (fits,).

    Best: least squares over noise plus log N for each parameter, as in the Bayesian information criterion. A tie is shared.
    """
    squares = np.array([squares_by_segment(fit.problem, fit.z, pool) for fit in fits])
    samples = fits[0].problem.samples / 2.0
    penalties = np.log(samples) * np.array([len(fit.problem.free) for fit in fits], dtype=float)
    random, count = np.random.default_rng(seed), squares.shape[1]
    wins = np.zeros(len(fits))
    for _ in range(COMPLEMENTARY_PAIRS):
        order = random.permutation(count)
        for half in (order[: count // 2], order[count // 2 :]):
            bic = squares[:, half].sum(axis=1) + penalties
            best = bic <= bic.min() + TIE_TOLERANCE * samples
            wins += best / best.sum()
    return wins / (2 * COMPLEMENTARY_PAIRS)


def squares_by_segment(problem: Problem, z: Vector, pool: Executor) -> Vector:
    """Sums of squared residuals over noise, all channels, (runs SEGMENTS_PER_RUN,); inf where a run cannot be simulated."""
    squares = []
    for residuals in residuals_at(problem, z, pool):
        if residuals is None:
            squares += [np.inf] * SEGMENTS_PER_RUN
        else:
            squares += [float(np.vdot(part, part)) for part in np.array_split(residuals, SEGMENTS_PER_RUN, axis=1)]
    return np.array(squares)


def stability_by_variable(variables: Sequence[Sequence[str]], shares: Sequence[float]) -> Mapping[str, float]:
    """For each variable the share of halves in which the chosen formula depends on it, the largest first."""
    totals: dict[str, float] = {}
    for names, share in zip(variables, shares, strict=True):
        for name in names:
            totals[name] = totals.get(name, 0.0) + float(share)
    return dict(sorted(totals.items(), key=lambda item: -item[1]))
