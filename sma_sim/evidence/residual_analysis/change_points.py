"""The instants at which something happens in residuals: their mean changes for good, or their squares burst."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sma_sim.evidence.estimation.problem import LinearizedRun, Problem
from sma_sim.model.arrays import Vector

MOST_INSTANTS = 2000  # at which residuals may change: a budget of time
PLAINEST = 3  # channels of which an instant is named: a budget of time, as effects are probed at each


def change_points(problem: Problem, linear: Sequence[LinearizedRun]) -> list[float]:
    """The instants [s] at which something happens: from which on the residuals of a channel have another mean, the plainest
    channel first, and the one at which their squares burst.

    The former maximise the cumulative sum of what residuals are above their mean, over all runs (Page's test; Basseville and
    Nikiforov, Detection of Abrupt Changes, 2.6): its square over n f (1 - f), with n samples and a part f of them before.
    Where the fit has bent its parameters to a lasting change, only the transient at its beginning is left: the latter begins
    the window, of any length, whose squares are above their mean by the most standard deviations (a scan statistic).
    """
    times = np.unique(np.concatenate([run.time for run in problem.runs]))
    times = times[:: -(-len(times) // MOST_INSTANTS)]
    evidence: dict[str, Vector] = {}
    squares, count = np.zeros(len(times)), np.zeros(len(times))
    for run, found in zip(problem.runs, linear, strict=True):
        for name, residuals, weight in zip(run.channels, found.residuals, run.weight, strict=True):
            known = weight > 0.0
            if known.sum() > 1:
                before = np.searchsorted(run.time[known], times)
                sums = np.concatenate([[0.0], np.cumsum(residuals[known] - residuals[known].mean())])[before]
                part = before / known.sum()
                among = np.where((part > 0.0) & (part < 1.0), part * (1.0 - part), np.inf) * known.sum()
                evidence[name] = evidence.get(name, np.zeros(len(times))) + sums**2 / among
                squares += np.concatenate([[0.0], np.cumsum(residuals[known] ** 2)])[before]
                count += before
    ordered = sorted(evidence.values(), key=lambda shown: -float(shown.max()))
    means = [float(times[np.argmax(shown)]) for shown in ordered[:PLAINEST]]
    return list(dict.fromkeys([*means, *burst(times, squares, count)]))


def burst(times: Vector, squares: Vector, count: Vector) -> list[float]:
    """The instant (of times (k,)) that begins the window in which squares are most above their mean; none without any.

    `squares`, `count` (k,): sums before each instant. That of n white residuals varies by sqrt(2 n).
    """
    if len(times) < 2 or squares[-1] <= squares[0]:
        return []
    excess = squares - squares[0] - (squares[-1] - squares[0]) / (count[-1] - count[0]) * (count - count[0])
    best = (0.0, float(times[0]))
    for width in 2 ** np.arange(int(np.log2(len(times)))):
        n = count[width:] - count[:-width]
        above = (excess[width:] - excess[:-width]) / np.sqrt(np.maximum(n, 1.0))
        best = max(best, (float(above.max()), float(times[np.argmax(above)])))
    return [best[1]]
