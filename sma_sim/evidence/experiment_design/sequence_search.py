"""The search for the best sequence: random ones of all shapes, then mutations of the best, with a fixed budget."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.experiment_design.forecast import (
    EvaluationPoints,
    OperatingLimits,
    RunPrediction,
    predict_hypotheses,
    with_command,
)
from sma_sim.evidence.experiment_design.sequences import CommandGrid, default_sequence, mutated, quantized, random_sequence
from sma_sim.model.arrays import Vector

Utility = Callable[[Sequence[RunPrediction]], float]
RANDOM_SHARE = 0.35  # of the budget, spent on random sequences before mutations: each shape is tried about three times
BATCH = 8  # sequences that are evaluated at once: fixed, so that the result does not depend on the number of cores
PARENTS = 8  # sequences that are kept for mutation: as many as a batch has
DEFAULT_SEQUENCES = 8  # their mean is what a recording without a design brings, to a third of what single ones scatter
# Factor by which a sequence shrinks that exceeds a limit, so that it ends within a fifth of it, and how often: what exceeds
# it still at 7 % of its power is given up.
SCALE_DOWN, MAX_SCALE_DOWNS = 0.8, 12


@dataclass(frozen=True)
class DesignProblem:
    """What a sequence is evaluated on: the hypotheses' points, the experiment's samples, limits, and the utility."""

    points: tuple[EvaluationPoints, ...]
    run: FitData
    grid: CommandGrid
    limits: OperatingLimits
    utility: Utility
    pool: Executor


@dataclass(frozen=True)
class EvaluatedSequence:
    """A sequence of levels [W], its utility, and the prediction of each hypothesis (kept where it is needed later)."""

    levels: Vector
    utility: float
    predictions: tuple[RunPrediction, ...] | None = None


@dataclass(frozen=True)
class SequenceSearchResult:
    """The best sequences, the best first, the default ones, how many were evaluated, and whether Ctrl-C ended the search."""

    best: tuple[EvaluatedSequence, ...]
    defaults: tuple[EvaluatedSequence, ...]
    count: int
    interrupted: bool


def evaluate_sequences(
    problem: DesignProblem, sequences: Sequence[Vector], keep_predictions: bool = False
) -> list[EvaluatedSequence | None]:
    """Sequences evaluated; None for those that exceed a limit, or that a hypothesis cannot simulate."""
    runs = [with_command(problem.run, levels, problem.grid) for levels in sequences]
    evaluated: list[EvaluatedSequence | None] = []
    for levels, by_hypothesis in zip(sequences, predict_hypotheses(problem.points, runs, problem.pool), strict=True):
        allowed = [
            prediction for prediction in by_hypothesis if prediction is not None and prediction.is_within(problem.limits)
        ]
        if len(allowed) < len(by_hypothesis):
            evaluated.append(None)
            continue
        kept = tuple(allowed) if keep_predictions else None
        evaluated.append(EvaluatedSequence(levels, problem.utility(allowed), kept))
    return evaluated


def evaluate_scaled_down(
    problem: DesignProblem, sequences: Sequence[Vector], keep_predictions: bool = False
) -> list[EvaluatedSequence]:
    """Sequences evaluated, those that exceed a limit scaled down until they do not."""
    done: list[EvaluatedSequence | None] = [None] * len(sequences)
    levels = [quantized(sequence, problem.grid) for sequence in sequences]
    for _ in range(MAX_SCALE_DOWNS):
        missing = [k for k, evaluated in enumerate(done) if evaluated is None]
        if not missing:
            break
        again = evaluate_sequences(problem, [levels[k] for k in missing], keep_predictions)
        for k, evaluated in zip(missing, again, strict=True):
            done[k] = evaluated
            levels[k] = quantized(SCALE_DOWN * levels[k], problem.grid)
    return [evaluated for evaluated in done if evaluated is not None]


def search_sequences(
    problem: DesignProblem, budget: int, seed: int, on_progress: Callable[[str], None]
) -> SequenceSearchResult | None:
    """The best of about `budget` sequences; None where not even a weak one keeps the limits. Ctrl-C: the best so far."""
    random = np.random.default_rng(seed)
    on_progress('evaluating default sequences')
    first = [default_sequence(problem.grid, random) for _ in range(DEFAULT_SEQUENCES)]
    defaults = evaluate_scaled_down(problem, first, keep_predictions=True)
    if not defaults:
        return None
    best = by_utility([EvaluatedSequence(default.levels, default.utility) for default in defaults])
    count, interrupted = DEFAULT_SEQUENCES, False
    try:
        while count < budget:
            new = new_sequences(problem, best, random, count < RANDOM_SHARE * budget)
            count += BATCH
            best = by_utility([*best, *new])[:PARENTS]
            on_progress(
                f'{count} of {budget} sequences evaluated, utility {best[0].utility:.2f} (default {defaults[0].utility:.2f})'
            )
    except KeyboardInterrupt:
        interrupted = True
    return SequenceSearchResult(tuple(best), tuple(defaults), count, interrupted)


def new_sequences(
    problem: DesignProblem, best: Sequence[EvaluatedSequence], random: np.random.Generator, explore: bool
) -> list[EvaluatedSequence]:
    """A batch of random sequences (`explore`), or of mutations of the best, evaluated."""
    batch = range(BATCH)
    if explore:
        return evaluate_scaled_down(problem, [random_sequence(problem.grid, random) for _ in batch])
    parents = [sequence.levels for sequence in best]
    children = evaluate_sequences(problem, [mutated(parents, problem.grid, random) for _ in batch])
    return [child for child in children if child is not None]


def by_utility(sequences: Sequence[EvaluatedSequence]) -> list[EvaluatedSequence]:
    """The best first."""
    return sorted(sequences, key=lambda sequence: -sequence.utility)
