"""Designs beyond the linear: every rival is refitted, by simulation, to recordings and experiment together.

The predictions of `forecast` are right where recordings determine the parameters well. After few recordings of low power a
posterior is wide and curved, and a rival follows an experiment much further than its derivatives say
(docs/explanation/experiment-design.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.calibrate import FitOptions, problem_for
from sma_sim.evidence.estimation.executors import run_in_threads
from sma_sim.evidence.estimation.levenberg_marquardt import minimize, refit, with_early_stopping
from sma_sim.evidence.estimation.problem import Problem, residuals_at
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS, WEAKLY_DAMPED, StopCriteria
from sma_sim.evidence.experiment_design.forecast import with_command
from sma_sim.evidence.experiment_design.rival_fits import ModelHypothesis
from sma_sim.evidence.experiment_design.sequence_search import (
    DesignProblem,
    EvaluatedSequence,
    SequenceSearchResult,
    evaluate_sequences,
)
from sma_sim.evidence.experiment_design.sequences import mutated
from sma_sim.evidence.experiment_design.utilities import (
    EvidenceRatio,
    RivalPair,
    discrimination_utility,
    evidence_ratios,
    refitted_evidence_ratios,
)
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.solver.simulate import SimulationError

REFIT_SAMPLES, REFIT_RTOL = 500, 1e-4  # of a recording, and of its simulation: every sequence costs many refits
FAST_REFIT = replace(WEAKLY_DAMPED, max_iterations=12, min_decrease=1.0, relative_decrease=1e-3)
DAMPED_REFIT = replace(FAST_REFIT, damping=FROM_PRIORS.damping)  # another way down, with short steps first
# Sequences to which rivals are refitted: this share of the budget, since one costs a hundred times as much as a linear one,
# but not fewer than two batches of them.
REFIT_SHARE, MIN_REFITTED = 0.05, 8
MAX_REFITTED_PAIRS = 6  # the least discriminated ones: their number grows with the square of the rivals, and three have six
REFITTED_PARENTS = REFITTED_BATCH = 4  # half of those of the linear search
REFITTED_DEFAULTS = 2  # a quarter of its default sequences
RATIO_ACCURACY = 0.03  # fraction of a log evidence ratio that a step must gain to be followed by another
TRUE_VALUES = 2  # the fit and a draw: a rival that cannot follow the one may follow the other


@dataclass(frozen=True)
class ThinnedRival:
    """A hypothesis on fewer samples: its problem, its optimum z there, the cost, and the mean start (wires,) in z.

    `true_values` (TRUE_VALUES, shared unknowns): its fit, and draws from its posterior.
    """

    problem: Problem
    z: Vector
    cost: float
    starts: Vector
    true_values: Matrix


@dataclass(frozen=True)
class RefitProblem:
    """What is refitted: all rivals, the pairs that are considered, and those that count in the utility."""

    rivals: tuple[ThinnedRival, ...]
    pairs: tuple[RivalPair, ...]
    counted: frozenset[RivalPair]
    context: SearchContext

    def utility(self, ratios: Sequence[EvidenceRatio]) -> float:
        """Of a sequence with these expected ratios."""
        return discrimination_utility([ratio for ratio in ratios if ratio.pair in self.counted])


@dataclass(frozen=True)
class RefittedSequence:
    """A sequence, and the log evidence ratios expected of it by pair when rivals are refitted."""

    sequence: EvaluatedSequence
    ratios: tuple[EvidenceRatio, ...]


@dataclass(frozen=True)
class RefitSearchResult:
    """The best sequence when rivals are refitted, the default ones, how many were evaluated, and whether Ctrl-C ended it."""

    best: RefittedSequence
    defaults: tuple[RefittedSequence, ...]
    count: int
    interrupted: bool


def thinned_rivals(
    training: Dataset, hypotheses: Sequence[ModelHypothesis], context: SearchContext
) -> tuple[ThinnedRival, ...]:
    """The hypotheses on fewer samples, each at its optimum there."""
    every = max(1, max(len(recording.time) for recording in training.recordings) // REFIT_SAMPLES)
    rivals = []
    for hypothesis in hypotheses:
        full = problem_for(training, hypothesis.fitted.problem.config, FitOptions(), every)
        free, weight = hypothesis.fitted.problem.free, np.sqrt(every) / hypothesis.noise_factor
        problem = replace(full, free=free).at_tolerance(REFIT_RTOL).weighted(weight)
        fitted = refit(problem, hypothesis.fitted.z, context, FAST_REFIT)
        assert fitted is not None  # it was fitted to these recordings
        true_values = np.vstack([fitted.z[: hypothesis.shared], hypothesis.draws])[:TRUE_VALUES]
        rivals.append(ThinnedRival(problem, fitted.z, fitted.cost, hypothesis.starts, true_values))
    return tuple(rivals)


def refit_problem(
    training: Dataset,
    hypotheses: Sequence[ModelHypothesis],
    best: EvaluatedSequence,
    counted: Sequence[RivalPair],
    context: SearchContext,
) -> RefitProblem:
    """All pairs, or those of them that the linearly best sequence discriminates the least."""
    assert best.predictions is not None
    pairs = all_pairs(len(hypotheses))
    linear = {ratio.pair: ratio.mean for ratio in evidence_ratios(best.predictions, pairs)}
    pairs.sort(key=lambda pair: (pair not in counted, linear[pair]))
    considered = tuple(pairs[:MAX_REFITTED_PAIRS])
    return RefitProblem(thinned_rivals(training, hypotheses, context), considered, frozenset(counted), context)


def all_pairs(count: int) -> list[RivalPair]:
    """Every ordered pair of so many hypotheses."""
    return [RivalPair(true, rival) for true in range(count) for rival in range(count) if true != rival]


def predicted_run(true: ThinnedRival, values: Vector, run: FitData, context: SearchContext) -> FitData | None:
    """The run as a hypothesis predicts it at some values, without noise; None where it cannot be simulated."""
    blank = replace(run, measured=np.zeros_like(run.measured))
    z = np.concatenate([values, true.starts])
    (residuals,) = residuals_at(replace(true.problem, runs=(blank,)), z, context.pool)
    return None if residuals is None else replace(run, measured=residuals / run.weight)


def is_ratio_accurate(base: float, costs: Sequence[float]) -> bool:
    """Whether the last step removed less than a few per cent of what is left above `base`: a ratio needs no more."""
    before, last = costs[-2:]
    return before - last < RATIO_ACCURACY * (last - base)


def squares_left_by(
    rival: ThinnedRival,
    true: ThinnedRival,
    values: Vector,
    run: FitData,
    stop_criteria: StopCriteria,
    context: SearchContext,
) -> float:
    """Half the squares by which a run that `true` predicts raises the cost of a refitted rival; NaN: cannot be simulated."""
    experiment = predicted_run(true, values, run, context)
    if experiment is None:
        return float('nan')
    problem = replace(rival.problem, runs=(*rival.problem.runs, experiment))
    early, z = with_early_stopping(context, partial(is_ratio_accurate, rival.cost)), np.append(rival.z, rival.starts)
    try:
        cost = minimize(problem, z, stop_criteria, early).cost
    except SimulationError:
        return float('nan')
    return max(cost - rival.cost - 0.5 * float(true.starts @ true.starts), 0.0)


def refit_to_sequences(
    refits: RefitProblem, problem: DesignProblem, sequences: Sequence[EvaluatedSequence], stop_criteria: StopCriteria
) -> list[RefittedSequence]:
    """The sequences that can be simulated, with rivals refitted; nothing after Ctrl-C."""
    context = refits.context
    runs = [with_command(problem.run, sequence.levels, problem.grid) for sequence in sequences]
    jobs = [
        partial(squares_left_by, refits.rivals[pair.rival], refits.rivals[pair.true], values, run, stop_criteria, context)
        for run in runs
        for pair in refits.pairs
        for values in refits.rivals[pair.true].true_values
    ]
    shape = len(sequences), len(refits.pairs), TRUE_VALUES
    left = np.reshape(run_in_threads(jobs, context.stop) if jobs else [], shape)
    if context.stop.is_set():
        return []  # refits that were stopped have not converged
    return [
        RefittedSequence(sequence, tuple(refitted_evidence_ratios(sequence.predictions, refits.pairs, of_sequence)))
        for sequence, of_sequence in zip(sequences, left, strict=True)
        if sequence.predictions is not None and np.isfinite(of_sequence).all()
    ]


def with_best_confirmed(
    refits: RefitProblem, problem: DesignProblem, known: Sequence[RefittedSequence], confirmed: list[EvaluatedSequence]
) -> list[RefittedSequence]:
    """Sorted by utility; the best has had its rivals refitted in a second way, and is in `confirmed`.

    A refit that ends in a side valley promises too much, and the best of many is the one that promises most.
    """
    ranking = by_refitted_utility(refits, known)
    while ranking and not refits.context.stop.is_set():
        best = ranking[0]
        if any(best.sequence is sequence for sequence in confirmed):
            break
        confirmed.append(best.sequence)
        for again in refit_to_sequences(refits, problem, [best.sequence], DAMPED_REFIT):
            pairs = zip(best.ratios, again.ratios, strict=True)
            lower = (replace(one, draws=tuple(map(min, one.draws, other.draws))) for one, other in pairs)
            ranking[0] = replace(best, ratios=tuple(lower))
        ranking = by_refitted_utility(refits, ranking)
    return ranking


def by_refitted_utility(refits: RefitProblem, sequences: Sequence[RefittedSequence]) -> list[RefittedSequence]:
    """The best first."""
    return sorted(sequences, key=lambda refitted: -refits.utility(refitted.ratios))


def search_with_refits(
    refits: RefitProblem,
    problem: DesignProblem,
    linear: SequenceSearchResult,
    budget: int,
    on_progress: Callable[[str], None],
) -> RefitSearchResult | None:
    """Go on from the linear search with rivals refitted; None where Ctrl-C ended it before anything was evaluated."""
    stop, random = refits.context.stop, np.random.default_rng([refits.context.seed, 1])
    most = max(MIN_REFITTED, round(REFIT_SHARE * budget))
    on_progress(f'refitting rivals to {most} sequences')
    defaults, confirmed = linear.defaults[:REFITTED_DEFAULTS], list[EvaluatedSequence]()
    known = refit_to_sequences(refits, problem, defaults, FAST_REFIT)
    levels, count = [sequence.levels for sequence in linear.best[:REFITTED_PARENTS]], len(defaults)
    while levels and not stop.is_set():
        try:
            evaluated = evaluate_sequences(problem, levels, keep_predictions=True)
        except KeyboardInterrupt:
            stop.set()
            break
        batch = [sequence for sequence in evaluated if sequence is not None]
        count += len(levels)  # those that exceed a limit too: the search ends
        new = refit_to_sequences(refits, problem, batch, FAST_REFIT)
        known = with_best_confirmed(refits, problem, [*known, *new], confirmed)
        on_progress(f'{count} of {max(count, most)} evaluated with rivals refitted')
        parents = [refitted.sequence.levels for refitted in known[:REFITTED_PARENTS]]
        more = bool(parents) and count < most
        levels = [mutated(parents, problem.grid, random) for _ in range(REFITTED_BATCH)] if more else []
    usual = tuple(refitted for refitted in known if any(refitted.sequence is default for default in defaults))
    return RefitSearchResult(known[0], usual, count, stop.is_set()) if known else None
