"""The search for the best sequence: random ones of all shapes, then changes of the best, with a fixed budget."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.experiment_design.forecast import Foretold, Limits, Points, foretell, with_command
from sma_sim.evidence.experiment_design.sequences import Grid, changed, default_sequence, some_sequence, tidy

Vector = NDArray[np.float64]
Worth = Callable[[Sequence[Foretold]], float]
BATCH = 8  # sequences that are tried at once: fixed, so that the result does not depend on the number of cores
DEFAULTS = 8  # default sequences that the design is compared with
RANDOM_PART = 0.35  # of the budget
PARENTS = 8
WEAKER = 0.8  # by which a sequence shrinks that exceeds a limit
TRIES = 12  # of shrinking


@dataclass(frozen=True)
class Bench:
    """On what sequences are tried."""

    points: tuple[Points, ...]
    run: FitData
    grid: Grid
    limits: Limits
    worth: Worth
    pool: Executor


@dataclass(frozen=True)
class EvaluatedSequence:
    """A sequence of levels [W], what it is worth, and what was foretold (kept for the default ones only)."""

    levels: Vector
    worth: float
    predicted: tuple[Foretold, ...] | None = None


@dataclass(frozen=True)
class SearchResult:
    """The best sequences, the best first, the default ones, how many were tried, and whether Ctrl-C ended the search."""

    parents: tuple[EvaluatedSequence, ...]
    defaults: tuple[EvaluatedSequence, ...]
    count: int
    interrupted: bool


def judged(bench: Bench, batch: Sequence[Vector], keep: bool = False) -> list[EvaluatedSequence | None]:
    """Sequences tried; None for those that exceed a limit, or that a hypothesis cannot run."""
    runs = [with_command(bench.run, levels, bench.grid) for levels in batch]
    found: list[EvaluatedSequence | None] = []
    for levels, row in zip(batch, foretell(bench.points, runs, bench.pool), strict=True):
        whole = [one for one in row if one is not None and one.within(bench.limits)]
        good = len(whole) == len(row)
        found.append(EvaluatedSequence(levels, bench.worth(whole), tuple(whole) if keep else None) if good else None)
    return found


def within_limits(bench: Bench, batch: Sequence[Vector], keep: bool = False) -> list[EvaluatedSequence]:
    """Sequences tried, those that exceed a limit made weaker until they do not."""
    done: list[EvaluatedSequence | None] = [None] * len(batch)
    rest = [tidy(levels, bench.grid) for levels in batch]
    for _ in range(TRIES):
        open_ = [k for k, one in enumerate(done) if one is None]
        if not open_:
            break
        for k, one in zip(open_, judged(bench, [rest[k] for k in open_], keep), strict=True):
            done[k] = one
            rest[k] = tidy(WEAKER * rest[k], bench.grid)
    return [one for one in done if one is not None]


def seek(bench: Bench, budget: int, seed: int, on_progress: Callable[[str], None]) -> SearchResult | None:
    """The best of about `budget` sequences; None where not even a weak one keeps the limits. Ctrl-C: the best so far."""
    random = np.random.default_rng(seed)
    on_progress('trying default sequences')
    defaults = within_limits(bench, [default_sequence(bench.grid, random) for _ in range(DEFAULTS)], keep=True)
    if not defaults:
        return None
    best = sorted((EvaluatedSequence(one.levels, one.worth) for one in defaults), key=lambda one: -one.worth)
    count = DEFAULTS
    try:
        while count < budget:
            if count < RANDOM_PART * budget:
                fresh = within_limits(bench, [some_sequence(bench.grid, random) for _ in range(BATCH)])
            else:
                parents = [one.levels for one in best]
                children = [changed(parents, bench.grid, random) for _ in range(BATCH)]
                fresh = [one for one in judged(bench, children) if one is not None]
            count += BATCH
            best = sorted([*best, *fresh], key=lambda one: -one.worth)[:PARENTS]
            on_progress(f'{count} of {budget} sequences tried, worth {best[0].worth:.2f} (default {defaults[0].worth:.2f})')
    except KeyboardInterrupt:
        return SearchResult(tuple(best), tuple(defaults), count, True)
    return SearchResult(tuple(best), tuple(defaults), count, False)
