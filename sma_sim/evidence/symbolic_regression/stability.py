"""How firmly a choice among formulas stands: how often each of them is chosen from random halves of the data.

Stability selection (Meinshausen and Buehlmann, J. R. Stat. Soc. B 72, 2010; in complementary pairs: Shah and Samworth,
ibid. 75, 2013), with what is costly left out: the formulas are not fitted again to each half, but the squares that each
leaves at its own fit are summed anew (as phylogenetics resamples likelihoods: Kishino, Miyata and Hasegawa, J. Mol. Evol.
31, 1990). Halves are made of stretches of time, since residuals hang together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.problem import Problem, residuals_at
from sma_sim.evidence.model_selection.refit import FitResult

Vector = NDArray[np.float64]
STRETCHES = 25  # of each run
PAIRS = 200  # of halves


def stabilities(fits: Sequence[FitResult], pool: Executor, seed: int = 0) -> Vector:
    """The share of random halves of the data in which each of several fits to the same runs is the best, (fits,).

    Best: least squares over noise plus log N for each parameter, as in the Bayesian information criterion. A tie is shared.
    """
    squares = np.array([squares_by_stretch(one.problem, one.z, pool) for one in fits])
    samples = fits[0].problem.samples / 2.0
    price = np.log(samples) * np.array([len(one.problem.free) for one in fits], dtype=float)
    random, count = np.random.default_rng(seed), squares.shape[1]
    wins = np.zeros(len(fits))
    for _ in range(PAIRS):
        order = random.permutation(count)
        for half in (order[: count // 2], order[count // 2 :]):
            worth = squares[:, half].sum(axis=1) + price
            best = worth <= worth.min() + 1e-9 * samples
            wins += best / best.sum()
    return wins / (2 * PAIRS)


def squares_by_stretch(problem: Problem, z: Vector, pool: Executor) -> Vector:
    """Sums of squared residuals over noise, over all channels, (runs STRETCHES,); inf where a run cannot be made."""
    found = []
    for one in residuals_at(problem, z, pool):
        if one is None:
            found += [np.inf] * STRETCHES
        else:
            found += [float(np.vdot(part, part)) for part in np.array_split(one, STRETCHES, axis=1)]
    return np.array(found)


def by_variable(variables: Sequence[Sequence[str]], shares: Sequence[float]) -> Mapping[str, float]:
    """For each variable the share of halves in which the chosen formula depends on it, the largest first."""
    found: dict[str, float] = {}
    for names, share in zip(variables, shares, strict=True):
        for name in names:
            found[name] = found.get(name, 0.0) + float(share)
    return dict(sorted(found.items(), key=lambda item: -item[1]))
