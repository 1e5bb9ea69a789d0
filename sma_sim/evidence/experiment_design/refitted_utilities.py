"""Designs beyond the linear: every rival is refitted, by simulation, to recordings and experiment together.

The forecasts of `criteria` are right where recordings tell the parameters well. After few, gentle ones a posterior is wide
and bent, and a rival follows an experiment much further than its derivatives say (docs/explanation/experiment-design.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import Campaign
from sma_sim.evidence.estimation.calibrate import Options, problem_for
from sma_sim.evidence.estimation.executors import run_in_threads
from sma_sim.evidence.estimation.levenberg_marquardt import minimize, with_early_stopping
from sma_sim.evidence.estimation.problem import Problem, residuals_at
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS, WEAKLY_DAMPED, StopCriteria
from sma_sim.evidence.experiment_design.forecast import with_command
from sma_sim.evidence.experiment_design.rival_fits import Hypothesis
from sma_sim.evidence.experiment_design.sequence_search import Bench, EvaluatedSequence, SearchResult, judged
from sma_sim.evidence.experiment_design.sequences import changed
from sma_sim.evidence.experiment_design.utilities import Ratio, ratios, when_refitted, worth_of_ratios
from sma_sim.evidence.model_selection.refit import refit
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Pair = tuple[int, int]
Judged = tuple[EvaluatedSequence, tuple[Ratio, ...]]  # a sequence, and what is expected of it by pair
SAMPLES, RTOL = 500, 1e-4  # of a recording, and of its simulation
FOLLOW = replace(WEAKLY_DAMPED, max_iterations=12, min_decrease=1.0, relative_decrease=1e-3)
SLOWLY = replace(FOLLOW, damping=FROM_PRIORS.damping)
ROUGH = 0.03  # of a log evidence ratio: what a step must gain to be followed by another
TRUTHS = 2  # the fit and draws: a rival that cannot follow the one may follow the other
SHARE, FEWEST = 0.05, 8  # sequences that rivals are refitted to: this part of the budget, but not fewer
MOST_PAIRS = 6  # the least told apart, where many explanations are open
PARENTS, DEFAULTS, AT_ONCE = 4, 2, 4


@dataclass(frozen=True)
class Rival:
    """A hypothesis on fewer samples: its problem, its optimum z there, the cost, and the mean start (wires,) in z.

    `truths` (TRUTHS, shared unknowns): its fit, and draws from its posterior.
    """

    problem: Problem
    z: Vector
    cost: float
    starts: Vector
    truths: Matrix


@dataclass(frozen=True)
class Refits:
    """What is refitted: all rivals, the ordered pairs (true, rival) that are looked at, and those that count."""

    rivals: tuple[Rival, ...]
    pairs: tuple[Pair, ...]
    counted: frozenset[Pair]
    place: SearchContext

    def worth(self, found: Sequence[Ratio]) -> float:
        """Of what is expected of a sequence."""
        return worth_of_ratios([one for one in found if (one.true, one.rival) in self.counted])


@dataclass(frozen=True)
class RefitResult:
    """The best sequence when rivals are refitted, default ones, how many were tried, and whether Ctrl-C ended it."""

    best: EvaluatedSequence
    expected: tuple[Ratio, ...]
    defaults: tuple[tuple[Ratio, ...], ...]
    count: int
    interrupted: bool


def rivals_of(training: Campaign, found: Sequence[Hypothesis], place: SearchContext) -> tuple[Rival, ...]:
    """The hypotheses on fewer samples, each at its optimum there."""
    every = max(1, max(len(one.time) for one in training.recordings) // SAMPLES)
    rivals = []
    for one in found:
        full = problem_for(training, one.fitted.problem.config, Options(), every)
        problem = replace(full, free=one.fitted.problem.free).at_tolerance(RTOL).weighted(np.sqrt(every) / one.factor)
        fitted = refit(problem, one.fitted.z, place, FOLLOW)
        assert fitted is not None  # it was fitted to these recordings
        truths = np.vstack([fitted.z[: one.shared], one.draws])[:TRUTHS]
        rivals.append(Rival(problem, fitted.z, fitted.cost, one.starts, truths))
    return tuple(rivals)


def refits_for(
    training: Campaign, found: Sequence[Hypothesis], best: EvaluatedSequence, counted: Sequence[Pair], place: SearchContext
) -> Refits:
    """All ordered pairs, or those of them that the linearly best sequence tells apart the least."""
    assert best.predicted is not None
    pairs = [(a, b) for a in range(len(found)) for b in range(len(found)) if a != b]
    linear = {(one.true, one.rival): one.mean for one in ratios(best.predicted, pairs)}
    pairs.sort(key=lambda pair: (pair not in counted, linear[pair]))
    return Refits(rivals_of(training, found, place), tuple(pairs[:MOST_PAIRS]), frozenset(counted), place)


def shown_by(true: Rival, truth: Vector, run: FitData, place: SearchContext) -> FitData | None:
    """The run as a hypothesis foretells it at one of its truths, without noise; None where it cannot be run."""
    blank = replace(run, measured=np.zeros_like(run.measured))
    there = np.concatenate([truth, true.starts])
    (shown,) = residuals_at(replace(true.problem, runs=(blank,)), there, place.pool)
    return None if shown is None else replace(run, measured=shown / run.weight)


def told_enough(base: float, costs: Sequence[float]) -> bool:
    """Whether the last step took less than a few per cent of what is left above `base`: a ratio is told no finer."""
    before, last = costs[-2:]
    return before - last < ROUGH * (last - base)


def left_by(rival: Rival, true: Rival, truth: Vector, run: FitData, effort: StopCriteria, place: SearchContext) -> float:
    """Half the squares by which a run that `true` foretells raises the cost of a refitted rival; NaN: cannot be run."""
    on_progress = shown_by(true, truth, run, place)
    if on_progress is None:
        return float('nan')
    problem = replace(rival.problem, runs=(*rival.problem.runs, on_progress))
    watched, z = with_early_stopping(place, partial(told_enough, rival.cost)), np.append(rival.z, rival.starts)
    try:
        cost = minimize(problem, z, effort, watched).cost
    except SimulationError:
        return float('nan')
    return max(cost - rival.cost - 0.5 * float(true.starts @ true.starts), 0.0)


def refitted(refits: Refits, bench: Bench, tried: Sequence[EvaluatedSequence], effort: StopCriteria) -> list[Judged]:
    """What is expected of sequences when rivals are refitted, of those that can be run; nothing after Ctrl-C."""
    runs = [with_command(bench.run, one.levels, bench.grid) for one in tried]
    jobs = [
        partial(left_by, refits.rivals[b], refits.rivals[a], truth, run, effort, refits.place)
        for run in runs for a, b in refits.pairs for truth in refits.rivals[a].truths
    ]  # fmt: skip
    left = np.reshape(run_in_threads(jobs, refits.place.stop) if jobs else [], (len(tried), len(refits.pairs), TRUTHS))
    if refits.place.stop.is_set():
        return []  # refits that were stopped have not come down
    return [
        (one, tuple(when_refitted(one.predicted, refits.pairs, own)))
        for one, own in zip(tried, left, strict=True) if one.predicted is not None and np.isfinite(own).all()
    ]  # fmt: skip


def with_best_confirmed(
    refits: Refits, bench: Bench, known: Sequence[Judged], sure: list[EvaluatedSequence]
) -> list[Judged]:
    """Sorted by worth; the best has had its rivals refitted on a second way, and is in `sure`.

    A refit that is held by a valley promises too much, and the best of many is the one that promises most.
    """
    found = sorted(known, key=lambda pair: -refits.worth(pair[1]))
    while found and not any(found[0][0] is one for one in sure) and not refits.place.stop.is_set():
        best, expected = found[0]
        sure.append(best)
        for _, again in refitted(refits, bench, [best], SLOWLY):
            found[0] = best, tuple(map(lower, expected, again))
        found.sort(key=lambda pair: -refits.worth(pair[1]))
    return found


def lower(one: Ratio, other: Ratio) -> Ratio:
    """The smaller at each draw."""
    return replace(one, draws=tuple(map(min, one.draws, other.draws)))


def settle(
    refits: Refits, bench: Bench, sought: SearchResult, budget: int, seed: int, on_progress: Callable[[str], None]
) -> RefitResult | None:
    """Go on from the linear search with rivals refitted; None where Ctrl-C ended it before anything was judged."""
    random, count = np.random.default_rng([seed, 1]), max(FEWEST, round(SHARE * budget))
    on_progress(f'refitting rivals to {count} sequences')
    defaults, sure = sought.defaults[:DEFAULTS], list[EvaluatedSequence]()
    known = refitted(refits, bench, defaults, FOLLOW)
    levels, tried = [one.levels for one in sought.parents[:PARENTS]], len(defaults)
    while levels and not refits.place.stop.is_set():
        try:
            batch = [one for one in judged(bench, levels, keep=True) if one is not None]
        except KeyboardInterrupt:
            refits.place.stop.set()
            break
        tried += len(levels)  # those that exceed a limit too: the search ends
        known = with_best_confirmed(refits, bench, [*known, *refitted(refits, bench, batch, FOLLOW)], sure)
        on_progress(f'{tried} of {count} tried with rivals refitted')
        parents = [one.levels for one, _ in known[:PARENTS]]
        levels = [changed(parents, bench.grid, random) for _ in range(AT_ONCE)] if parents and tried < count else []
    usual = tuple(expected for one, expected in known if any(one is default for default in defaults))
    return RefitResult(*known[0], usual, tried, refits.place.stop.is_set()) if known else None
