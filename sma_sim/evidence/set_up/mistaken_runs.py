"""Recordings that are mistaken for each other: two have the command of each other, or one has that of another.

What the model shows under a command hardly depends on which recording has it: one run of the model for each says which
command each recording had.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from sma_sim.evidence.estimation.levenberg_marquardt import start_point
from sma_sim.evidence.estimation.problem import Problem, residuals_at
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.set_up.faults import Fault
from sma_sim.solver.inputs import Input, inputs_at

Rows = NDArray[np.float64]
HALF = 0.5  # of what a recording shows: a model that explains less has another command in view


def exchanged_commands(problem: Problem, residuals: Sequence[Rows | None]) -> Iterator[Fault]:
    """The recordings that lie nearer to what the model shows under the commands of others, each of its own one."""
    known = [(run, rows) for run, rows in zip(problem.runs, residuals, strict=True) if rows is not None]
    gains = np.array([[gain(run, rows, *other) for other in known] for run, rows in known])
    if len(known) < 2:
        return
    holder = dict(zip(*(at.tolist() for at in linear_sum_assignment(-gains)), strict=True))
    whose = {other: k for k, other in holder.items()}
    for at in range(len(known)):
        cycle = list[int]()
        while at in whose:
            cycle.append(at)
            at = whose.pop(at)
        if len(cycle) > 1 and all(gains[k, holder[k]] > 0.0 for k in cycle):
            names = tuple(known[k][0].name for k in cycle)
            yield Fault('exchanged_commands', problem.config.structure.structure.commands, recordings=names)


def gain(run: FitData, rows: Rows, other: FitData, of_other: Rows) -> float:
    """By how much the squares of a run fall if the model shows what it does in another one; 0 beside one of other inputs."""
    if run is other or run.source.columns != other.source.columns:
        return 0.0
    found = 0.0
    for k, name in enumerate(run.channels):
        if name not in other.channels:
            continue
        at = other.channels.index(name)
        known = other.weight[at] > 0.0
        shown = other.measured[at][known] + of_other[at][known] / other.weight[at][known]
        there = run.weight[k] * (np.interp(run.time, other.time[known], shown) - run.measured[k])
        found += float(np.vdot(rows[k], rows[k]) - np.vdot(there, there))
    return found


def copied_commands(problem: Problem, context: SearchContext) -> list[Fault]:
    """The recordings whose command another one has too, which the model explains by it, whereas it does not explain them."""
    pairs = [(a, b) for a, b in permutations(problem.runs, 2) if has_same_command(a.source, b.source)]
    if not pairs:
        return []
    unexplained = are_unexplained(problem, context)
    whose = {a.name: b.name for a, b in pairs if unexplained[a.name] and not unexplained[b.name]}
    commands = problem.config.structure.structure.commands
    return [Fault('copied_command', commands, recordings=pair, corrected=False) for pair in whose.items()]


def has_same_command(source: Input, other: Input) -> bool:
    """Whether two inputs have the same command, and any power."""
    if source.columns != other.columns:
        return False
    times = np.union1d(source.times, other.times)
    times = times[(times >= max(source.times[0], other.times[0])) & (times <= min(source.times[-1], other.times[-1]))]
    own, there = inputs_at(source, times), inputs_at(other, times)
    return all(np.array_equal(own[name], there[name]) for name in source.columns[:-1]) and any(
        own[name].any() for name in source.columns[:-1]
    )


def are_unexplained(problem: Problem, context: SearchContext) -> dict[str, bool]:
    """By run, whether the model explains less than half of what moves in it, also if a wire got no power."""
    z, left = start_point(problem), dict.fromkeys((run.name for run in problem.runs), np.inf)
    for side in (0, 1, -1):
        runs = tuple(replace(run, unpowered_side=side) if side else run for run in problem.runs)
        for run, rows in zip(runs, residuals_at(replace(problem, runs=runs), z, context.pool), strict=True):
            if rows is not None:
                left[run.name] = min(left[run.name], moving(run, rows))
    return {run.name: left[run.name] > HALF * moving(run, run.measured * run.weight) for run in problem.runs}


def moving(run: FitData, rows: Rows) -> float:
    """The squares of weighted rows (channels, k) about the mean of each."""
    known = [row[weight > 0.0] for row, weight in zip(rows, run.weight, strict=True)]
    return sum(float(np.sum((row - row.mean()) ** 2)) for row in known if len(row))
