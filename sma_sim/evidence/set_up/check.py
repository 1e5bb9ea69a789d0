"""The set-up before the physics: signs, exchanged columns and units that the nominal model contradicts, found and corrected.

A model at the middle of its priors knows which way a robot bends and how far, well enough to see that a column counts the
other way. What a fault promises is told as a component's is: by the squares that would be left, to first order in the
parameters. What promises something is fitted, with the fault and without, and competes with one listed effect beside the
recordings as they are; the score is that of the search. Only odds beyond Occam's window correct a recording.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import combinations, permutations
from math import inf, log, sqrt

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from sma_sim.evidence.data.noise import DIFFERENCE_ORDER, difference_scale
from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.recordings import NEGLIGIBLE_FRACTION, value_range
from sma_sim.evidence.estimation.calibrate import SEARCH_SAMPLES, FitOptions, full_problem, problem_for
from sma_sim.evidence.estimation.executors import run_in_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import bounded_step, refit
from sma_sim.evidence.estimation.noise_at_rest import noise_at_rest, with_noise_of
from sma_sim.evidence.estimation.overdispersion import overdispersion_of
from sma_sim.evidence.estimation.problem import (
    LinearizedRun,
    Problem,
    accumulated,
    linearize,
    normal_equations,
    residuals_at,
    start_point,
)
from sma_sim.evidence.estimation.recording_differences import with_differences
from sma_sim.evidence.estimation.residuals import FitData, simulated
from sma_sim.evidence.estimation.run_subset import chosen_runs, on_all_runs
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import NOMINAL_MODEL, WEAKLY_DAMPED
from sma_sim.evidence.model_selection.score_tests import ScoreTests
from sma_sim.evidence.search import propose
from sma_sim.evidence.search.components import catalogue_for
from sma_sim.evidence.search.criteria import NOISE_ONLY
from sma_sim.evidence.search.prior import SPARSITY, UNLISTED
from sma_sim.evidence.search.refine import SKETCHED, WINDOW, Model, extended, model_of
from sma_sim.evidence.search.score import unlisted_evidence
from sma_sim.evidence.set_up.faults import Fault, corrected, faults_of, is_uncertain, log_share, unit_of
from sma_sim.model.arrays import Mask, Vector
from sma_sim.model.config import Config
from sma_sim.solver.inputs import Input, inputs_at
from sma_sim.solver.simulate import SimulationError

Rows = NDArray[np.float64]
MAX_FAULTS = 6  # of one set-up: more are another robot, and each costs a fit
FITTED = 3  # proposals that are fitted
HOPELESS = 100.0  # times the least squares without a fault: parameters do not make up for a factor of ten
FEW_STEPS = 6  # of a fit that hardly moves: a sign cannot be made up for, and far from the truth runs are slow


@dataclass(frozen=True)
class Proposal:
    """A fault, and the log prior probability of it."""

    fault: Fault
    log_prior: float


@dataclass(frozen=True)
class Step:
    """A fault, the log of its prior probability, and the nominal model of the recordings with it and without."""

    fault: Fault
    log_prior: float
    before: Model | None
    after: Model

    @property
    def leaves_noise(self) -> bool:
        """Whether nothing but noise is left without the fault."""
        return self.after.fit.error <= NOISE_ONLY


@dataclass(frozen=True)
class Approximation:
    """What a fit would leave, to first order: its squares, those of the unknowns, log det(I + J'J/k^2) by its k^2 J'J, and
    the overdispersion of what is left."""

    squares: float
    prior: float
    information: Rows
    overdispersion: float

    def score(self, k: float) -> float:
        """The log posterior under an overdispersion k."""
        volume = np.linalg.slogdet(np.eye(len(self.information)) + self.information / k**2)[1]
        return -0.5 * (self.squares / k**2 + self.prior + float(volume))


def faults_before_fits(dataset: Dataset, config: Config, options: FitOptions, context: SearchContext) -> tuple[Fault, ...]:
    """What is wrong with recordings, as far as a model at the middle of its priors shows it. Columns first: what they hold
    decides what scatters."""
    as_they_are = thinned(dataset, config, options)
    still = motionless(as_they_are, context)
    if still is not None:
        return (still,)
    found = wrong_columns(as_they_are, dataset, config, options, context)
    if is_uncertain(found) or context.stop.is_set():
        return found
    dataset = corrected(dataset, found)
    problem = problem_for(dataset, config, options, 1, step_limited=False)
    return (*found, *wrong_samples(problem, start_point(problem), dataset, found, context))


def motionless(problem: Problem, context: SearchContext) -> Fault | None:
    """That nothing moves, where a model at the middle of its priors does: no channel is anything but a constant and noise.

    What keeps a robot still (no power, a wire that is slack or overstretched, a dead sensor) cannot be told from that.
    """
    if problem.config.structure.is_quasi_static:
        return None
    shown = residuals_at(problem, start_point(problem), context.pool)
    measured = [run.measured * run.weight for run in problem.runs]
    if smooth_evidence(problem, measured, scattering=True) > SPARSITY + UNLISTED or any(rows is None for rows in shown):
        return None
    predicted = [rows + of_run for rows, of_run in zip(shown, measured, strict=True) if rows is not None]
    if smooth_evidence(problem, predicted) < WINDOW:
        return None
    channels = dict.fromkeys(name for run in problem.runs for name in run.channels)
    return Fault('motionless', tuple(channels), corrected=False)


def smooth_evidence(problem: Problem, rows: Sequence[Rows], scattering: bool = False) -> float:
    """The log Bayes factor of smooth functions of time beside white noise in rows (channels, k) of every run, without their
    means. The noise of rows that are `scattering` is what they scatter by, where less than is stated."""
    varying = [np.zeros_like(of_run) for of_run in rows]
    for run, of_run, found in zip(problem.runs, rows, varying, strict=True):
        for k, known in enumerate(run.weight > 0.0):
            if known.any():
                own = of_run[k, known]
                scale = (difference_scale(run.time[known], own) if scattering else 0.0) or 1.0
                found[k, known] = (own - np.mean(own)) / min(1.0, scale)
    return unlisted_evidence(varying)


def faults_after_fit(
    dataset: Dataset, fit: FitResult, options: FitOptions, faults: Sequence[Fault], context: SearchContext
) -> tuple[Fault, ...]:
    """What shows beside a fitted model only: outliers that motion hid, and a noise that is stated too large. `faults`: those
    that are known, without which the recordings are."""
    dataset = with_differences(dataset, fit.problem.differences)
    whole = full_problem(dataset, fit, options)
    return wrong_samples(whole, on_all_runs(fit, whole, start_point(whole)), dataset, faults, context, is_fitted=True)


def noise_after_search(
    best: FitResult, dataset: Dataset, options: FitOptions, faults: Sequence[Fault], context: SearchContext
) -> tuple[Fault, ...]:
    """A noise that is stated too large, of channels of which that is not known yet: the best model leaves less, where what
    the nominal one lacked hid that."""
    if best.error * NOISE_ONLY >= 1.0:
        return ()
    known = {name for fault in faults if fault.kind == 'noise' for name in fault.quantities}
    names = {run.name for run in best.problem.runs}
    seen = tuple(recording for recording in dataset.recordings if recording.name in names)
    found = faults_after_fit(replace(dataset, recordings=seen), best, options, faults, context)
    return tuple(fault for fault in found if fault.kind == 'noise' and not known & {*fault.quantities})


def with_noise_at_rest(
    nominal: Sequence[FitResult], dataset: Dataset, options: FitOptions, context: SearchContext
) -> list[FitResult]:
    """The nominal fits with what all samples, beside the best of them, tell of noise that is correlated."""
    best = min(nominal, key=lambda fit: fit.cost)
    whole = full_problem(dataset, best, options)
    left = residuals_at(whole, on_all_runs(best, whole, start_point(whole)), context.pool)
    if any(rows is None for rows in left):
        return list(nominal)
    processes = noise_at_rest(whole, [rows for rows in left if rows is not None])
    return [replace(fit, problem=with_noise_of(fit.problem, processes)) for fit in nominal]


def wrong_samples(
    problem: Problem, z: Vector, dataset: Dataset, faults: Sequence[Fault], context: SearchContext, is_fitted: bool = False
) -> tuple[Fault, ...]:
    """Outliers, and a noise that is stated wrong."""
    shown = residuals_at(problem, z, context.pool)
    rows = [-run.measured * run.weight if left is None else left for run, left in zip(problem.runs, shown, strict=True)]
    far = outliers(problem, rows, {name for fault in faults if fault.kind == 'outliers' for name in fault.quantities})
    if far:
        problem = reduce(without_fault, far, problem)
        rows = [row * (run.weight > 0.0) for row, run in zip(rows, problem.runs, strict=True)]
    return (*far, *wrong_noise(problem, rows, dataset, is_fitted))


def wrong_columns(
    as_they_are: Problem, dataset: Dataset, config: Config, options: FitOptions, context: SearchContext
) -> tuple[Fault, ...]:
    """The faults of signs, columns and units, one after the other; the last one is not `corrected` where others explain it.

    `as_they_are`: the problem of the recordings with whatever is wrong with them.

    None of quasi-static tests: what is not known of a specimen before its curves are fitted would pass for a fault.
    """
    if config.structure.is_quasi_static:
        return ()
    steps, problem = list[Step](), as_they_are
    while len(steps) < MAX_FAULTS and not context.stop.is_set():
        proposals = proposed(problem, start_point(problem), context)
        step = best_step(problem, proposals, context) if proposals else None
        if step is None:
            break
        steps.append(step)
        if not step.fault.corrected or step.leaves_noise:
            break
        problem = thinned(dataset, config, options, [step.fault for step in steps])
    if steps and not steps[-1].leaves_noise and is_robot(as_they_are, steps, context):
        steps.clear()
    while steps and not steps[-1].leaves_noise and may_be_an_effect(steps[-1], context):
        steps.pop()
    lost = None if steps and steps[-1].leaves_noise else lost_command(as_they_are, context)
    if lost is not None and not (steps and explain_as_well([steps[-1].after], lost.after, lost.log_prior)):
        return (lost.fault,)
    found = [step.fault for step in steps]
    problem = thinned(dataset, config, options, found)
    lost = lost_command(problem, context) if steps else None
    if lost is not None:
        return (lost.fault,)
    return told_apart(found, symmetries(problem)) if found else ()


def thinned(dataset: Dataset, config: Config, options: FitOptions, faults: Sequence[Fault] = ()) -> Problem:
    """The problem of all recordings without some faults, on thinned samples."""
    longest = max(len(recording.time) for recording in dataset.recordings)
    return problem_for(corrected(dataset, faults), config, options, max(1, longest // SEARCH_SAMPLES))


def without_fault(problem: Problem, fault: Fault) -> Problem:
    """The problem of the recordings without a fault."""
    return replace(problem, runs=fault.in_runs(problem.runs))


def proposed(problem: Problem, z: Vector, context: SearchContext) -> list[Proposal]:
    """The faults without which the recordings lie nearer to the model, at z and to first order about it, the best first.

    Each is proposed for those recordings that lie nearer without it, and for all, which is the more probable cause: at the
    middle of the priors one of them may lie nearer with it by chance.
    """
    before = residuals_at(problem, z, context.pool)
    squares = [inf if rows is None else float(np.vdot(rows, rows)) for rows in before]
    channels = dict.fromkeys(name for run in problem.runs for name in run.channels)
    faults = [*faults_of(problem.config.structure, tuple(channels)), *exchanged_commands(problem, before)]
    found = list[tuple[Fault, float]]()
    for fault in faults:
        if context.stop.is_set():
            return []
        if fault.is_of_channels:
            pairs = zip(problem.runs, before, strict=True)
            after = [None if rows is None else as_if_right(run, fault, rows) for run, rows in pairs]
        else:
            after = residuals_at(without_fault(problem, fault), z, context.pool)
        left = [inf if rows is None else float(np.vdot(rows, rows)) for rows in after]
        nearer = [is_left < was for is_left, was in zip(left, squares, strict=True)]
        names = tuple(run.name for run, is_nearer in zip(problem.runs, nearer, strict=True) if is_nearer)
        total = sum(min(pair) for pair in zip(left, squares, strict=True))
        if fault.is_of_runs:
            found += [(fault, total)] if {*fault.recordings} <= {*names} else []
        elif names:
            found.append((replace(fault, recordings=() if all(nearer) else names), total))
            if not all(nearer):
                found.append((fault, sum(left)))
    least = min((total for _, total in found), default=inf)
    near = [fault for fault, total in found if total <= HOPELESS * least]
    proposals = [Proposal(fault, log_share(fault, len(faults), len(problem.runs)) - SPARSITY) for fault in near]
    return ranked(problem, z, proposals, context) if proposals else []


def ranked(problem: Problem, z: Vector, proposals: Sequence[Proposal], context: SearchContext) -> list[Proposal]:
    """Those that promise a better score than the recordings as they are, to first order about z, the best first."""
    try:
        linear: list[LinearizedRun] | None = linearize(problem, z, context.pool)
    except SimulationError:
        linear = None
    base = None if linear is None else approximation(problem, linear, z)
    found = []
    for one in proposals:
        right = without_fault(problem, one.fault)
        try:
            if linear is not None and one.fault.is_of_channels:
                pairs = zip(problem.runs, linear, strict=True)
                without = [linear_as_if_right(run, one.fault, there) for run, there in pairs]
            else:
                without = linearize(right, z, context.pool)
        except SimulationError:
            continue
        found.append((one, approximation(right, without, z)))
    if not found:
        return []
    k = min(there.overdispersion for there in (*(there for _, there in found), *([base] if base else ())))
    least = -inf if base is None else base.score(k)
    scores = [(there.score(k) + one.log_prior, one) for one, there in found]
    return [one for score, one in sorted(scores, key=lambda pair: -pair[0]) if score > least]


def in_units(run: FitData, rows: Rows) -> Rows:
    """Weighted rows (..., channels, k) in the units of their channels."""
    return rows / np.where(run.weight > 0.0, run.weight, 1.0)


def as_if_right(run: FitData, fault: Fault, residuals: Rows) -> Rows:
    """The residuals (channels, k) of a run without a fault of its channels: what the model shows stays."""
    right = fault.in_run(run)
    return (in_units(run, residuals) + run.measured - right.measured) * right.weight * (run.weight > 0.0)


def linear_as_if_right(run: FitData, fault: Fault, linear: LinearizedRun) -> LinearizedRun:
    """The same of a run that was linearised."""
    jacobian = in_units(run, linear.jacobian) * fault.in_run(run).weight
    return LinearizedRun(linear.indices, as_if_right(run, fault, linear.residuals), jacobian)


def approximation(problem: Problem, linear: Sequence[LinearizedRun], z: Vector) -> Approximation:
    """What a fit would leave, to first order about z, its unknowns within their bounds."""
    k = overdispersion_of(problem, [run.residuals for run in linear])
    _, gradient, hessian = accumulated([normal_equations(run, False) for run in linear], z, k)
    low, high = problem.limits()
    step = bounded_step(gradient, hessian, 0.0, low - z, high - z)
    left = [run.residuals + np.tensordot(step[run.indices], run.jacobian, 1) for run in linear]
    squares = sum(float(np.vdot(rows, rows)) for rows in left)
    end = z + step
    return Approximation(squares, float(end @ end), hessian - k**2 * np.eye(len(z)), overdispersion_of(problem, left))


def best_step(problem: Problem, proposals: Sequence[Proposal], context: SearchContext) -> Step | None:
    """The fault that the recordings have, by fits with it and without; None where these leave it open.

    Not `corrected` where another fault, which does not leave the same recordings, explains as much.
    """
    chosen = proposals[:FITTED]
    context.on_progress(f'the set-up: is it that {" or that ".join(one.fault.words for one in chosen)}?')
    suspected = {name for one in chosen for name in one.fault.recordings}
    kept = {*chosen_runs(problem).tolist(), *(k for k, run in enumerate(problem.runs) if run.name in suspected)}
    problem = replace(problem, runs=tuple(problem.runs[k] for k in sorted(kept)))
    known, target = list[tuple[Proposal, Model]](), inf
    for one in chosen:
        model = fitted(without_fault(problem, one.fault), context, target)
        known += [] if model is None else [(one, model)]
        target = min((other.fit.cost + WINDOW * other.evidence.overdispersion**2 for _, other in known), default=inf)
        if model is not None and model.fit.error <= NOISE_ONLY:
            break  # no other one leaves less
    if not known or context.stop.is_set():
        return None
    before = fitted_as_it_is(problem, context, target, min(model.fit.squares for _, model in known))
    k = min(model.evidence.overdispersion for model in (*(model for _, model in known), *([before] if before else ())))
    known.sort(key=lambda pair: -(pair[1].score(k) + pair[0].log_prior))
    best, after = known[0]
    score = after.score(k) + best.log_prior
    if before is not None and score <= before.score(k) + WINDOW:
        return None
    near = [one.fault for one, other in known[1:] if other.score(k) + one.log_prior > score - WINDOW]
    others = [fault for fault in near if not same_recordings(best.fault, fault, problem)]
    fault = replace(best.fault, corrected=not others, alternatives=tuple((fault,) for fault in others))
    return Step(fault, best.log_prior, before, after)


def fitted(problem: Problem, context: SearchContext, target: float = inf) -> Model | None:
    """The nominal model, fitted with little damping and with much; None where it cannot be run.

    Given up where the cost falls too slowly to come down to `target`.
    """
    weak, z = replace(NOMINAL_MODEL, damping=WEAKLY_DAMPED.damping), start_point(problem)
    jobs = [partial(refit, problem, z, context, criteria, target) for criteria in (NOMINAL_MODEL, weak)]
    return model_of((), run_in_threads(jobs, context.stop), context)


def fitted_as_it_is(problem: Problem, context: SearchContext, target: float, least: float) -> Model | None:
    """The nominal model of recordings that seem to have a fault: few steps show whether it comes down to `target` too.

    None where it does not promise, to first order, to come near the `least` squares that a fault leaves: from there a fit
    goes to the bounds of all parameters, where a run takes ten times as long.
    """
    z = start_point(problem)
    try:
        if approximation(problem, linearize(problem, z, context.pool), z).squares > HOPELESS * least:
            return None
    except SimulationError:
        return None
    few = replace(NOMINAL_MODEL, damping=WEAKLY_DAMPED.damping, max_iterations=FEW_STEPS)
    fit = refit(problem, z, context, few, target)
    if fit is not None and fit.cost < target:
        return fitted(problem, context)
    return model_of((), [fit], context)


def is_robot(problem: Problem, steps: Sequence[Step], context: SearchContext) -> bool:
    """Whether the recordings as they are, fitted in earnest, are explained as well as without all that was found.

    Asked where that leaves more than noise: far from the middle of its priors a robot looks as if several things were wrong,
    and first order does not show where a fit ends.
    """
    after = steps[-1].after
    names = {run.name for run in after.fit.problem.runs}
    problem = replace(problem, runs=tuple(run for run in problem.runs if run.name in names))
    context.on_progress('the set-up: do the recordings as they are look like another robot?')
    as_it_is = fitted(problem, context, after.reach(after.evidence.overdispersion))
    return as_it_is is not None and explain_as_well([as_it_is], after, sum(step.log_prior for step in steps))


def may_be_an_effect(step: Step, context: SearchContext) -> bool:
    """Whether one listed effect, or one difference between recordings, explains the recordings as they are as well.

    It is not asked where the nominal model of the recordings without the fault leaves noise only: no effect takes the place
    of a sign to the last digit. Where one does as well, since something is hidden beside the fault, one more on either side
    tells them apart.
    """
    if step.before is None:
        return False
    context.on_progress(f'the set-up: may an effect look as if {step.fault.words}?')
    rivals = with_one_more(step.before, context)
    if not explain_as_well(rivals, step.after, step.log_prior):
        return False
    after = with_one_more(step.after, context)
    return not after or explain_as_well([*rivals, *with_one_more(rivals[0], context)], after[0], step.log_prior)


def with_one_more(model: Model, context: SearchContext) -> list[Model]:
    """A model with one more listed effect, or difference between recordings: those that promise most, the best first."""
    base = model.fit
    listed = propose.listed(ScoreTests(base.problem, base.z, context.pool), catalogue_for(base, context), ())[:SKETCHED]
    components = [one.component for one in (*listed, *propose.differing(base, (), context))]
    return extended(model, components, context) if components else []


def explain_as_well(models: Sequence[Model], after: Model, log_prior: float) -> bool:
    """Whether one of some models is as probable as one without faults of a prior probability."""
    k = min(model.evidence.overdispersion for model in (*models, after))
    return any(model.score(k) + WINDOW >= after.score(k) + log_prior for model in models)


def same_recordings(fault: Fault, other: Fault, problem: Problem) -> bool:
    """Whether two faults leave the same recordings of this robot, which is symmetric."""
    if fault.recordings != other.recordings or {fault.kind, other.kind} - {'sign', 'swap'}:
        return False
    own, there = as_columns([fault]), as_columns([other])
    return any(in_mirror(symmetry, own) == there for symmetry in symmetries(problem))


# Recordings that are mistaken for each other: two have the command of each other, or one has that of another.
#
# What the model shows under a command hardly depends on which recording has it: one run of the model for each says which
# command each recording had.
HALF = 0.5  # of what a recording shows: a model that explains less has another command in view


def exchanged_commands(problem: Problem, residuals: Sequence[Rows | None]) -> Iterator[Fault]:
    """The recordings that lie nearer to what the model shows under the commands of others, each of its own one."""
    known = [(run, rows) for run, rows in zip(problem.runs, residuals, strict=True) if rows is not None]
    gains = np.array([[gain(run, rows, *other) for other in known] for run, rows in known])
    if len(known) < 2:
        return
    from scipy.optimize import linear_sum_assignment  # only here: it takes long to import

    holder = dict(zip(*(at.tolist() for at in linear_sum_assignment(-gains)), strict=True))
    whose = {other: k for k, other in holder.items()}
    for at in range(len(known)):
        cycle = list[int]()
        while at in whose:
            cycle.append(at)
            at = whose.pop(at)
        if len(cycle) > 1 and all(gains[k, holder[k]] > 0.0 for k in cycle):
            names = tuple(known[k][0].name for k in cycle)
            yield Fault('exchanged_commands', problem.config.structure.commands, recordings=names)


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


def lost_command(problem: Problem, context: SearchContext) -> Step | None:
    """That a recording has the command of another one, its own being lost: without it the model explains the rest, in place
    of which each of its channels shows something of its own. Not of those that repeat the other one.

    None where a wire that gets no power there, an effect or another difference between recordings explain as much.
    """
    pairs = [(a, b) for a, b in permutations(problem.runs, 2) if has_same_command(a.source, b.source) and not repeats(a, b)]
    others, found = {wrong.name: other.name for wrong, other in reversed(pairs)}, list[tuple[FitData, Step]]()
    for wrong in (run for run in problem.runs if run.name in others):
        commands, log_prior = problem.config.structure.commands, -SPARSITY - log(len(others))
        fault = Fault('copied_command', commands, recordings=(wrong.name, others[wrong.name]), corrected=False)
        context.on_progress(f'the set-up: is it that {fault.words}?')
        after = fitted(replace(problem, runs=tuple(run for run in problem.runs if run is not wrong)), context)
        if after is None:
            continue
        k = after.evidence.overdispersion
        target = after.fit.cost - k**2 * (log_density_of_unknown(wrong, k) + log_prior)
        before = fitted_as_it_is(with_least_power(problem, wrong, context), context, target, inf)  # an effect may make it up
        found.append((wrong, Step(fault, log_prior, before, after)))
    if not found or context.stop.is_set():
        return None
    models = [model for _, step in found for model in (step.before, step.after) if model is not None]
    k = min(model.evidence.overdispersion for model in models)
    steps = [replace(step, log_prior=step.log_prior + log_density_of_unknown(wrong, k)) for wrong, step in found]
    best = max(steps, key=lambda step: step.after.score(k) + step.log_prior)
    as_they_are = [step.before for step in steps if step.before is not None]
    is_clear = not (as_they_are and explain_as_well(as_they_are, best.after, best.log_prior))
    return best if is_clear and not may_be_an_effect(best, context) else None


def with_least_power(problem: Problem, run: FitData, context: SearchContext) -> Problem:
    """The problem in which a run has that power, of both wires or of one alone, beside which the model explains most."""
    sides = (run, *(replace(run, unpowered_side=side) for side in (1, -1)))
    tried = replace(problem, runs=sides)
    shown = residuals_at(tried, start_point(tried), context.pool)
    best = sides[int(np.argmin([inf if rows is None else float(np.vdot(rows, rows)) for rows in shown]))]
    return replace(problem, runs=tuple(best if one is run else one for one in problem.runs))


def log_density_of_unknown(run: FitData, k: float) -> float:
    """The log density of a run of which no model is known, under an overdispersion k and up to the constant of scores: of a
    smooth function of time in each of its channels."""
    known = [row[weight > 0.0] for row, weight in zip(run.measured * run.weight / k, run.weight, strict=True)]
    rows = [row - row.mean() for row in known if len(row)]
    return sum(unlisted_evidence([row[None, :]]) - 0.5 * float(row @ row) for row in rows)


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


def repeats(run: FitData, other: FitData) -> bool:
    """Whether a run shows what another one does, but for less than half of what moves in it."""
    rows = np.zeros_like(run.measured)
    for k, name in enumerate(run.channels):
        if name in other.channels:
            at = other.channels.index(name)
            known = other.weight[at] > 0.0
            rows[k] = run.weight[k] * (run.measured[k] - np.interp(run.time, other.time[known], other.measured[at][known]))
        else:
            rows[k] = run.weight[k] * run.measured[k]
    return moving(run, rows) < HALF * moving(run, run.measured * run.weight)


def moving(run: FitData, rows: Rows) -> float:
    """The squares of weighted rows (channels, k) about the mean of each."""
    known = [row[weight > 0.0] for row, weight in zip(rows, run.weight, strict=True)]
    return sum(float(np.sum((row - row.mean()) ** 2)) for row in known if len(row))


# Single samples that are far off, and a noise that is stated wrong: what the scatter of residuals about themselves says.
#
# A model that lacks something, or whose parameters are not fitted yet, leaves residuals that are smooth from sample to
# sample: differences of a high order leave their noise alone, and a median of neighbours their course.
ORDERS = (3, 4, 5)  # of differences: white noise has the same size by all of them, what moves has not
SCATTER = 2.0  # times 1/samples: the variance of the log of a scale by differences of these orders
MAX_STDS = 3.0  # by which two estimates of one number differ
NEIGHBOURS = 8  # of a sample, half of them on either side, that tell where it should be
STANDS_OUT = 2.0  # times its size: what a single sample adds to differences of third order (1, 3, 3, 1), noise against it
MAD = 1.4826  # standard deviation of normal noise over its median absolute deviation
LONGEST = 3  # samples next to each other: what lasts longer moves
MOST = 0.1  # of the samples of a run: more are no outliers


def outliers(problem: Problem, residuals: Sequence[Rows], scattered: Collection[str] = ()) -> list[Fault]:
    """By channel, the samples that are far from where their neighbours in the residuals say: by so much that chance among
    all samples, and any motion that neighbours share, is out of the question by the odds of Occam's window.

    Just after a change of the command a model may be far off for a sample. That counts where what was measured stands out by
    itself; of a sensor that has such outliers, here or already known (`scattered`), also where nothing else is off.
    """
    found = []
    for channel in dict.fromkeys(name for run in problem.runs for name in run.channels):
        far, certain, samples = dict[str, NDArray[np.int64]](), channel in scattered, 0
        for run, left in zip(problem.runs, residuals, strict=True):
            if channel in run.channels:
                k = run.channels.index(channel)
                known = np.flatnonzero(run.weight[k])
                samples += len(known)
                own = isolated(run.time[known], left[k][known])
                by_itself = own & stands_out(run, known, run.measured[k] * run.weight[k], own)
                certain = certain or bool(by_itself.any())
                far[run.name] = known[own & (by_itself | is_alone(run, left, k, known))]
        wrong = {name: tuple(rows.tolist()) for name, rows in far.items() if len(rows)}
        if certain and wrong:
            share = sum(map(len, wrong.values())) / samples
            found.append(Fault('outliers', (channel,), recordings=tuple(wrong), rows=wrong, share=share))
    return found


def is_alone(run: FitData, left: Rows, k: int, known: NDArray[np.int64]) -> Mask:
    """At which of the `known` samples of the k-th channel nothing else is off by more than chance: neither the sample before
    or after it, nor any other channel, of which there is one. What a model gets wrong lasts, and shows in several."""
    others = [j for j in range(len(left)) if j != k]
    if run.is_quasi_static or not others:
        return np.zeros(len(known), dtype=bool)
    limit = chance_limit(len(known))
    off = np.pad(np.abs(left[k][known]) > limit, 1)
    seen = run.weight[others][:, known] > 0.0
    beside = (np.abs(left[others][:, known]) > limit) & seen
    alone: Mask = seen.any(axis=0) & ~beside.any(axis=0) & ~off[:-2] & ~off[2:]
    return alone


def isolated(time: Vector, values: Vector) -> Mask:
    """Which of the values (k,), in units of the stated noise, are outliers."""
    none, half = np.zeros(len(values), dtype=bool), NEIGHBOURS // 2
    scale = difference_scale(time, values)
    if scale is None or len(values) <= NEIGHBOURS:
        return none
    limit = chance_limit(len(values))
    if np.abs(np.diff(values, n=DIFFERENCE_ORDER)).max() < STANDS_OUT * limit * max(1.0, scale):
        return none  # no sample stands out of its neighbours
    windows = sliding_window_view(np.pad(values, half, mode='reflect'), NEIGHBOURS + 1)
    around = np.delete(windows, half, axis=1)
    middle = np.median(around, axis=1)
    spread = np.maximum(MAD * np.median(np.abs(around - middle[:, None]), axis=1), max(1.0, scale))
    found = np.abs(values - middle) > limit * spread
    starts = np.flatnonzero(np.diff(found.astype(int), prepend=0) == 1)
    ends = np.flatnonzero(np.diff(found.astype(int), append=0) == -1)
    for first, last in zip(starts, ends, strict=True):
        found[first : last + 1] &= last - first < LONGEST
    return found if found.mean() <= MOST else none


def stands_out(run: FitData, known: NDArray[np.int64], values: Vector, wrong: Mask) -> Mask:
    """Which of the `known` samples (k,) that are far off are no answer to a change of the command.

    Just after one, at the start too, a model may be far off for a sample: it bends at the change, and a sample whose
    neighbours reach back to there is not where they say. So it may at any sample of a quasi-static test, from each of which
    to the next a wire may transform. It counts only where what was measured (`values`, in units of the noise) stands out by
    itself: from those before and after it, on the same side.
    """
    time, right = run.time[known], np.flatnonzero(~wrong)
    found = np.ones(len(known), dtype=bool)
    since = np.searchsorted(run.source.times, time, side='right')
    before = np.searchsorted(run.source.times, time[np.maximum(np.arange(len(time)) - NEIGHBOURS // 2, 0)], side='left')
    for k in np.flatnonzero(wrong & ((since > before) | run.is_quasi_static)):
        at = np.searchsorted(right, k)
        if at == 0 or at == len(right):
            found[k] = False
            continue
        low, high = sorted(values[known[right[at - 1 : at + 1]]].tolist())
        found[k] = max(values[known[k]] - high, low - values[known[k]]) > chance_limit(len(known))
    return found


def chance_limit(samples: int) -> float:
    """How far, in standard deviations, one of so many normal samples cannot be, by the odds of Occam's window."""
    return sqrt(2.0 * (log(samples) + SPARSITY + WINDOW))


def scales(problem: Problem, rows: Sequence[Rows], order: int) -> dict[str, tuple[float, int]]:
    """By channel, the size of white noise in rows (channels, k) of every run, in units of the stated noise, and the samples
    behind it."""
    squares: dict[str, float] = {}
    counts: dict[str, int] = {}
    for run, row in zip(problem.runs, rows, strict=True):
        for k, name in enumerate(run.channels):
            known = run.weight[k] > 0.0
            scale = difference_scale(run.time[known], row[k][known], order)
            if scale is not None:
                count = int(known.sum())
                squares[name] = squares.get(name, 0.0) + count * scale**2
                counts[name] = counts.get(name, 0) + count
    return {name: (sqrt(squares[name] / counts[name]), counts[name]) for name in squares}


def wrong_noise(problem: Problem, residuals: Sequence[Rows], dataset: Dataset, is_fitted: bool) -> list[Fault]:
    """The channels whose noise is stated too small, or too large, where differences of all orders agree on it.

    Too small: the samples themselves scatter as much, not only what a model leaves of them; or they do at rest, where noise
    that a filter has smoothed shows (`noise_at_rest`). Too large: a fit (`is_fitted`) leaves as little; a noise that is slow
    may hide from differences. Not where a resolution or repeated experiments say what noise is, nor where none is visible.
    """
    if dataset.floor or problem.config.structure.is_quasi_static:
        return []
    by_order, at_rest = [scales(problem, residuals, order) for order in ORDERS], noise_at_rest(problem, residuals)
    raw = scales(problem, [run.measured * run.weight for run in problem.runs], ORDERS[0])
    sizes = dict[str, tuple[float, int]]()
    for name, (_, count) in by_order[0].items():
        if name in dataset.resolution:
            continue
        found = [scale[name][0] for scale in by_order if name in scale]
        least = float(np.exp(sqrt(2.0 * SCATTER * (WINDOW + SPARSITY) / count)))
        limit = max(NOISE_ONLY, least)
        if name in at_rest and at_rest[name].std > limit:
            sizes[name] = at_rest[name].std, count
            continue
        if len(found) < len(ORDERS) or min(found) <= 0.0 or max(found) > limit * min(found):
            continue
        size = found[0]
        if size > limit and raw[name][0] < limit * size:
            sizes[name] = size, count
        elif size < 1.0 / limit and is_fitted and all_of(problem, residuals, name) < limit * size:
            spans = [value_range(one.channels[name]) for one in dataset.recordings if name in one.channels]
            visible = NEGLIGIBLE_FRACTION * max(spans)
            if size * dataset.noise_std[name] > visible:
                sizes[name] = size, count
    return grouped(sizes)


def all_of(problem: Problem, residuals: Sequence[Rows], channel: str) -> float:
    """Root mean square of a channel."""
    squares = count = 0.0
    for run, rows in zip(problem.runs, residuals, strict=True):
        if channel in run.channels:
            k = run.channels.index(channel)
            squares, count = squares + float(np.vdot(rows[k], rows[k])), count + np.count_nonzero(run.weight[k])
    return sqrt(squares / max(1.0, count))


def grouped(sizes: Mapping[str, tuple[float, int]]) -> list[Fault]:
    """One fault for channels that are off by the same, as far as their samples tell."""
    found = list[tuple[list[str], float, int]]()
    for name, (size, count) in sizes.items():
        for k, (names, other, behind) in enumerate(found):
            if abs(log(size / other)) < MAX_STDS * sqrt(SCATTER * (1.0 / count + 1.0 / behind)):
                mean = (count * size + behind * other) / (count + behind)
                found[k] = ([*names, name], mean, count + behind)
                break
        else:
            found.append(([name], size, count))
    return [Fault('noise', tuple(names), size) for names, size, _ in found]


# Faults that nobody can tell apart: those that turn the recordings of a robot into those of the same robot in a mirror.
#
# A planar module with the other sign of J_eq bends the other way: its U_y and alpha have the other sign, its wires exchange
# their parts. If J_eq has the opposite sign in a file, the recordings are therefore those of a robot with U_y and alpha of
# the opposite sign and wires that are exchanged. Which exchanges a structure allows is asked of its model.
Channels = Mapping[str, NDArray[np.float64]]
Columns = Mapping[str, tuple[float, str]]
"""By channel and command: the sign with which which column holds it."""
SAME = 1e-3  # of what a channel spans, within which two runs are the same: far above the solver's error


def as_columns(faults: Sequence[Fault]) -> Columns:
    """Where the right values are, of signs and exchanged columns."""
    found: dict[str, tuple[float, str]] = {}
    for fault in faults:
        if fault.kind == 'sign':
            for name in fault.quantities:
                sign, source = found.get(name, (1.0, name))
                found[name] = (-sign, source)
        else:
            first, second = fault.quantities
            found[first], found[second] = found.get(second, (1.0, second)), found.get(first, (1.0, first))
    return {name: column for name, column in found.items() if column != (1.0, name)}


def as_faults(columns: Columns, recordings: tuple[str, ...]) -> tuple[Fault, ...]:
    """The faults that put the right values there: exchanges first, then signs."""
    where = {name: name for name in columns}
    found = []
    for name, (_, source) in columns.items():
        if where[name] != source:
            other = next(key for key, at in where.items() if at == source)
            where[name], where[other] = source, where[name]
            found.append(Fault('swap', tuple(sorted((name, other))), recordings=recordings))
    signs = (Fault('sign', (name,), recordings=recordings) for name, (sign, _) in columns.items() if sign < 0.0)
    return (*found, *signs)


def in_mirror(symmetry: Columns, columns: Columns) -> Columns:
    """Where the right values of the mirrored robot are."""
    found = {}
    for name in dict.fromkeys((*symmetry, *columns)):
        sign, source = symmetry.get(name, (1.0, name))
        other, column = columns.get(source, (1.0, source))
        found[name] = (sign * other, column)
    return {name: column for name, column in found.items() if column != (1.0, name)}


def symmetries(problem: Problem) -> list[Columns]:
    """The exchanges of commands that only exchange the channels of the nominal model, or their signs."""
    structure, z = problem.config.structure, start_point(problem)
    run = max(problem.runs, key=lambda one: float(np.abs(one.source.values[:, 0]).max()))
    own = z[problem.indices()[problem.runs.index(run)]]
    config, nuisance = problem.fitted(z), problem.nuisance(run, own)

    def shown(source: FitData) -> Channels:
        _, trajectory, index = simulated(config, source, nuisance, source.channels)
        return {name: trajectory[source.columns[name]][index] for name in source.channels}

    faults = [Fault('swap', pair) for pair in combinations(structure.commands, 2)]
    if structure.antagonistic:
        each = [(name,) for name in structure.commands]
        faults += [Fault('sign', names) for names in dict.fromkeys((structure.commands, *each))]
    found = list[Columns]()
    try:
        straight = shown(run)
        for fault in faults:
            mirrored = shown(fault.in_run(run))
            channels = dict(exchanged(straight, mirrored))
            if len(channels) == len(straight):
                found.append({**as_columns([fault]), **{a: b for a, b in channels.items() if b != (1.0, a)}})
    except SimulationError:
        return []
    return found


def exchanged(straight: Channels, mirrored: Channels) -> Iterator[tuple[str, tuple[float, str]]]:
    """By channel of one run, which channel of the other one is the same, and with which sign."""
    for name, values in straight.items():
        within = SAME * float(np.abs(values).max())
        alike = (
            (sign, other)
            for other, there in mirrored.items()
            if unit_of(other) == unit_of(name)
            for sign in (1.0, -1.0)
            if np.abs(values - sign * there).max() <= within
        )
        if (first := next(alike, None)) is not None:
            yield name, first


def told_apart(found: Sequence[Fault], known: Sequence[Columns]) -> tuple[Fault, ...]:
    """The faults with what leaves the same recordings, unless that takes far more; of these the fewest are taken."""
    exchanges = [fault for fault in found if fault.kind in ('sign', 'swap') and fault.corrected]
    others = [fault for fault in found if fault not in exchanges]
    chosen: list[Fault] = []
    for recordings in dict.fromkeys(fault.recordings for fault in exchanges):
        own = as_columns([fault for fault in exchanges if fault.recordings == recordings])
        touched = [own, *(in_mirror(one, own) for one in known if one.keys() & own.keys())]
        options = [as_faults(columns, recordings) for columns in touched]
        options = sorted((option for option in dict.fromkeys(options) if option), key=len)
        if options:
            first, *rest = options[0]
            near = tuple(other for other in options[1:] if causes(other) <= causes(options[0]) + 1)
            chosen += [replace(first, alternatives=near), *rest]
    return (*chosen, *others)


def causes(faults: Sequence[Fault]) -> int:
    """How many things went wrong: an axis that counts the other way turns several signs."""
    return sum(fault.kind == 'swap' for fault in faults) + any(fault.kind == 'sign' for fault in faults)
