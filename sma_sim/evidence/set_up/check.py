"""The set-up before the physics: signs, exchanged columns and units that the nominal model contradicts, found and corrected.

A model at the middle of its priors knows which way a robot bends and how far, well enough to see that a column counts the
other way. What a fault promises is told as a component's is: by the squares that would be left, to first order in the
parameters. What promises something is fitted, with the fault and without, and competes with one listed effect beside the
recordings as they are; the score is that of the search. Only odds beyond Occam's window correct a recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from math import inf

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.calibrate import SEARCH_SAMPLES, FitOptions, full_problem, problem_for
from sma_sim.evidence.estimation.executors import run_in_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import accumulated, bounded_step, normal_equations, start_point
from sma_sim.evidence.estimation.problem import LinearizedRun, Problem, linearize, residuals_at
from sma_sim.evidence.estimation.recording_differences import with_differences
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.estimation.run_subset import chosen_runs
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import NOMINAL_MODEL, WEAKLY_DAMPED
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.evidence.model_selection.refit import refit
from sma_sim.evidence.search import propose
from sma_sim.evidence.search.components import catalogue_for
from sma_sim.evidence.search.refine import SKETCHED, WINDOW, Model, extended, model_of
from sma_sim.evidence.search.score import SPARSITY, overdispersion_of
from sma_sim.evidence.set_up.faults import Fault, corrected, faults_of, log_share
from sma_sim.evidence.set_up.mistaken_runs import are_unexplained, copied_commands, exchanged_commands
from sma_sim.evidence.set_up.samples import outliers, wrong_noise
from sma_sim.evidence.set_up.symmetry import as_columns, in_mirror, symmetries, told_apart
from sma_sim.model.config import Config
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
Rows = NDArray[np.float64]
MOST_FAULTS = 6  # of one set-up: more are another robot, and each costs a fit
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
        return self.after.fit.error <= CRITERIA.noise_only


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
    found = wrong_columns(dataset, config, options, context)
    if is_uncertain(found) or context.stop.is_set():
        return found
    dataset = corrected(dataset, found)
    problem = problem_for(dataset, config, options, 1, step_limited=False)
    return (*found, *wrong_samples(problem, start_point(problem), dataset, False, context))


def faults_after_fit(dataset: Dataset, fit: FitResult, options: FitOptions, context: SearchContext) -> tuple[Fault, ...]:
    """What shows beside a fitted model only: outliers that motion hid, and a noise that is stated too large."""
    dataset = with_differences(dataset, fit.problem.differences)
    whole = full_problem(dataset, fit, options)
    z, shared = start_point(whole), len(whole.shared)
    z[:shared] = fit.z[:shared]
    own = {run.name: fit.z[at][shared:] for run, at in zip(fit.problem.runs, fit.problem.indices(), strict=True)}
    for run, at in zip(whole.runs, whole.indices(), strict=True):
        z[at[shared:]] = own.get(run.name, z[at[shared:]])
    return wrong_samples(whole, z, dataset, True, context)


def wrong_samples(
    problem: Problem, z: Vector, dataset: Dataset, is_fitted: bool, context: SearchContext
) -> tuple[Fault, ...]:
    """Outliers, and a noise that is stated wrong."""
    shown = residuals_at(problem, z, context.pool)
    rows = [-run.measured * run.weight if left is None else left for run, left in zip(problem.runs, shown, strict=True)]
    far = outliers(problem, rows)
    if far:
        problem = reduce(without_fault, far, problem)
        rows = [row * (run.weight > 0.0) for row, run in zip(rows, problem.runs, strict=True)]
    return (*far, *wrong_noise(problem, rows, dataset, is_fitted))


def is_uncertain(faults: Sequence[Fault]) -> bool:
    """Whether something is wrong of which it is not known what."""
    return any(not fault.corrected for fault in faults)


def wrong_columns(dataset: Dataset, config: Config, options: FitOptions, context: SearchContext) -> tuple[Fault, ...]:
    """The faults of signs, columns and units, one after the other; the last one is not `corrected` where others explain it.

    None of quasi-static tests: what is not known of a specimen before its curves are fitted would pass for a fault.
    """
    if config.structure.structure.is_quasi_static:
        return ()
    copied = copied_commands(thinned(dataset, config, options), context)
    steps = list[Step]()
    while len(steps) < MOST_FAULTS and not context.stop.is_set():
        problem = thinned(corrected(dataset, [step.fault for step in steps]), config, options)
        proposals = proposed(problem, start_point(problem), context)
        step = best_step(problem, proposals, context) if proposals else None
        if step is None:
            break
        steps.append(step)
        if not step.fault.corrected or step.leaves_noise:
            break
    while steps and not steps[-1].leaves_noise and may_be_an_effect(steps[-1], context):
        steps.pop()
    found = [step.fault for step in steps]
    if copied:
        unexplained = are_unexplained(thinned(corrected(dataset, found), config, options), context)
        if still := tuple(fault for fault in copied if unexplained[fault.recordings[0]]):
            return still
    return told_apart(found, symmetries(thinned(corrected(dataset, found), config, options))) if found else ()


def thinned(dataset: Dataset, config: Config, options: FitOptions) -> Problem:
    """The problem of all recordings on thinned samples."""
    longest = max(len(recording.time) for recording in dataset.recordings)
    return problem_for(dataset, config, options, max(1, longest // SEARCH_SAMPLES))


def without_fault(problem: Problem, fault: Fault) -> Problem:
    """The problem of the recordings without a fault."""
    return replace(problem, runs=fault.in_runs(problem.runs))


def proposed(problem: Problem, z: Vector, context: SearchContext) -> list[Proposal]:
    """The faults without which the recordings lie nearer to the model, at z and to first order about it, the best first.

    Each is proposed for those recordings that lie nearer without it.
    """
    before = residuals_at(problem, z, context.pool)
    squares = [inf if rows is None else float(np.vdot(rows, rows)) for rows in before]
    channels = dict.fromkeys(name for run in problem.runs for name in run.channels)
    faults = [*faults_of(problem.config.structure.structure, tuple(channels)), *exchanged_commands(problem, before)]
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
    weight = run.weight.max(axis=1)
    units: Rows = rows / np.where(weight > 0.0, weight, 1.0)[:, None]
    return units


def as_if_right(run: FitData, fault: Fault, residuals: Rows) -> Rows:
    """The residuals (channels, k) of a run without a fault of its channels: what the model shows stays."""
    right = fault.in_run(run)
    found: Rows = (in_units(run, residuals) + run.measured - right.measured) * right.weight * (run.weight > 0.0)
    return found


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
        if model is not None and model.fit.error <= CRITERIA.noise_only:
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


def may_be_an_effect(step: Step, context: SearchContext) -> bool:
    """Whether one listed effect, or one difference between recordings, explains the recordings as they are as well.

    It is not asked where the nominal model of the recordings without the fault leaves noise only: no effect takes the place
    of a sign to the last digit.
    """
    if step.before is None:
        return False
    context.on_progress(f'the set-up: may an effect look as if {step.fault.words}?')
    base = step.before.fit
    listed = propose.listed(base, catalogue_for(base, context), (), context)[:SKETCHED]
    components = [one.component for one in (*listed, *propose.differing(base, (), context))]
    rivals = extended(step.before, components, context, restarts=False) if components else []
    k = min(model.evidence.overdispersion for model in (*rivals, step.after))
    return any(rival.score(k) + WINDOW >= step.after.score(k) + step.log_prior for rival in rivals)


def same_recordings(fault: Fault, other: Fault, problem: Problem) -> bool:
    """Whether two faults leave the same recordings of this robot, which is symmetric."""
    if fault.recordings != other.recordings or {fault.kind, other.kind} - {'sign', 'swap'}:
        return False
    own, there = as_columns([fault]), as_columns([other])
    return any(in_mirror(symmetry, own) == there for symmetry in symmetries(problem))
