"""Bounded Levenberg-Marquardt, with derivatives of each iteration or with those of the first, which its steps correct."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from math import inf

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.problem import (
    LinearizedRun,
    Problem,
    QuadraticModel,
    accumulated,
    better_steps,
    cost_at,
    cost_of,
    linearized_in_turn,
    measured_steps,
    near,
    normal_equations,
    normal_parts,
    quadratic_model,
    residuals_at,
    robust_weights,
)
from sma_sim.evidence.estimation.search_context import SearchContext, Stop
from sma_sim.evidence.estimation.stop_criteria import ADDED_EFFECT, StopCriteria
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.solver.simulate import SimulationError

MAX_DAMPING, DAMPING_INCREASE = 1e12, 3.0  # the factor after a step that did not gain: finer ones find longer steps
CENTRAL_BELOW = 0.1  # relative gain of a step below which differences become central
WARM_UP = 3  # iterations before early stopping may end a minimisation
MAX_SECANT_STEPS = 12  # without a linearisation, which costs more than all of them
SECANT_WARM_UP, PACE_STEPS = 5, 3  # steps before one that is too slow may be given up, and those that tell how fast it is
SECANT_DAMPING, SECANT_DAMPING_FLOOR = 10.0, 1e-3  # factor after a step that gained little, or much; least at a start
MAX_KEPT = 2**26  # [bytes] of derivatives that are kept to bend steps and for those without a linearisation: of 17 runs of
# 100 s at 50 Hz
MAX_BEND = 0.75  # twice the length of a bend over that of its step: where it is more, the second order does not hold
MAX_EXCHANGES = 10  # of unknowns at bounds with free ones, for each unknown: few are made
COST_FLOOR = 1e-9  # per sample; below it only the solver's error is fitted


class EarlyStopping:
    """Follows the cost of one minimisation, and ends it as soon as `is_lost` says so of the costs so far."""

    def __init__(self, stop: Stop, is_lost: Callable[[Sequence[float]], bool]) -> None:
        self._stop, self._is_lost, self._costs = stop, is_lost, list[float]()

    def on_iteration(self, label: str, iteration: int, cost: float) -> None:
        """Called after each linearisation."""
        self._costs.append(cost)

    def is_set(self) -> bool:
        """Whether to end. The first steps are damped, wherever they lead, so that they say nothing."""
        return self._stop.is_set() or (len(self._costs) > WARM_UP and self._is_lost(self._costs))

    def set(self) -> None:
        """Ask everything that shares the stop to end."""
        self._stop.set()


def with_early_stopping(context: SearchContext, is_lost: Callable[[Sequence[float]], bool]) -> SearchContext:
    """The context of one minimisation that ends as soon as `is_lost` says so of its costs so far."""
    watch = EarlyStopping(context.stop, is_lost)
    return replace(context, stop=watch, on_iteration=watch.on_iteration)


def bounded_step(gradient: Vector, hessian: Matrix, damping: float, low: Vector, high: Vector) -> Vector:
    """The step that minimises the damped quadratic model within bounds (low <= 0 <= high).

    An active-set method (Nocedal and Wright, Numerical Optimization, 16.5): unknowns are held at their bounds, and one after
    the other is freed from where the slope leads inward, the steepest first. Raises LinAlgError where there is no minimum.
    """
    damped = hessian + damping * np.eye(len(gradient))
    step: Vector = -cho_solve((cholesky(damped, lower=False), False), gradient)
    if np.all((step >= low) & (step <= high)):
        return step
    step, free, most = np.zeros_like(step), low < high, 1.0
    for _ in range(MAX_EXCHANGES * len(step)):
        wanted = step.copy()
        wanted[free] = np.linalg.solve(damped[np.ix_(free, free)], -(gradient + damped[:, ~free] @ step[~free])[free])
        ends = np.clip(wanted, low, high)
        beyond = ends != wanted
        if beyond.any():  # first all of them are held, later the one that is met first
            parts = np.divide(ends - step, wanted - step, out=np.ones_like(step), where=beyond)
            part = max(most, float(parts.min()))
            beyond &= parts <= part
            step = np.where(beyond, ends, step + part * (wanted - step))
            free &= ~beyond
            continue
        step, slope = wanted, gradient + damped @ wanted
        inward = np.where(free | (low == high), 0.0, np.where(step >= high, slope, -slope))
        if inward.max() <= 0.0:
            break
        free[inward.argmax()], most = True, 0.0
    return step


def minimize(problem: Problem, z: Vector, criteria: StopCriteria, context: SearchContext, label: str = '') -> FitResult:
    """Minimise the cost from z. Raises SimulationError when the model cannot be run at the start.

    Damping is absolute: what data hardly see stays near its prior until the rest is right. Differences become central when
    a step gains little, because valleys are narrow; they are bent too, and steps with them (`damped_step`), as long as the
    derivatives fit into the memory. Corrections of runs under smoothed commands are made anew after each step, row by row,
    but for one that gains no more than one after which that hardly changed the cost. `label` names the minimisation in
    `on_iteration`.
    """
    half = 0.5 * problem.samples
    is_kept = problem.derivative_bytes <= MAX_KEPT
    secant = criteria.secant and is_kept
    central, damping = criteria.central or problem.has_tangents, criteria.damping
    steps = measured_steps(problem, z, context.pool) if central else None
    nearby, trusted, gained, cost = problem, -inf, 0.0, inf
    for iteration in range(criteria.max_iterations):
        at, reached = nearby if gained <= trusted else problem, cost - gained
        linear = list(linearized_in_turn(at, z, context.pool, steps, central)) if is_kept else []
        parts = [normal_equations(run, problem.robust) for run in linear] or list(
            normal_parts(at, z, context.pool, steps, central)
        )
        model = accumulated(parts, z, problem.tempering)
        cost = model[0]
        context.on_iteration(label, iteration, cost)
        if context.stop.is_set():
            return FitResult(problem, z, cost, iteration, False)
        min_decrease = criteria.min_decrease * max(cost / half, COST_FLOOR)
        if abs(cost - reached) <= min_decrease:
            trusted = max(trusted, gained)
        nearby = near(problem, [part.correction for part in parts])
        if secant:
            found = secant_minimum(problem, z, linear, (damping, min_decrease), context)
            z, gained, damping = found.z, cost - found.cost, max(damping / SECANT_DAMPING, SECANT_DAMPING_FLOOR)
            converged = True
            ended = gained <= max(min_decrease, criteria.relative_decrease * cost)
        else:
            step, gained, damping = damped_step(nearby, z, model, damping, min_decrease, context.pool, linear)
            z, converged = z + step, damping <= MAX_DAMPING
            ended = gained <= criteria.relative_decrease * cost and (central or converged)
            central = central or gained < CENTRAL_BELOW * cost
        if ended:
            return FitResult(problem, z, cost - gained, iteration, converged)
        steps = better_steps(problem, model[2], central)
    return FitResult(problem, z, cost - gained, criteria.max_iterations, False)


def secant_minimum(
    problem: Problem,
    z: Vector,
    linear: Sequence[LinearizedRun],
    limits: tuple[float, float],
    context: SearchContext,
    target: float = np.inf,
) -> FitResult:
    """Where minimisation from z leads without another linearisation: `linear` is one at z, or near it.

    Each step corrects the derivatives (Broyden, Math. Comp. 19, 1965) and costs one run of the model, where a linearisation
    costs one by unknown. It ends near the optimum, seldom on it. `limits`: the damping of the first step, and the predicted
    decrease of the cost below which none is made. It is given up where the cost falls too slowly to come down to `target`.
    """
    (damping, min_decrease), (low, high) = limits, problem.limits()
    cost, gradient, hessian = quadratic_model(problem, linear, z)
    nearby = near(problem, [run.correction for run in linear])
    costs = list[float]()
    for iteration in range(MAX_SECANT_STEPS):
        try:
            step = bounded_step(gradient, hessian, damping, low - z, high - z)
        except LinAlgError:
            damping *= DAMPING_INCREASE
            continue
        expected = -float(gradient @ step + 0.5 * step @ hessian @ step)
        costs.append(cost)
        if expected <= min_decrease or context.stop.is_set() or is_too_slow(costs, target):
            return FitResult(problem, z, cost, iteration)
        shown = residuals_at(nearby, z + step, context.pool)
        gained = cost - cost_of(problem, shown, z + step)
        if np.isfinite(gained):
            linear = [
                secant_update(run, step, r, gained > 0.0) for run, r in zip(linear, shown, strict=True) if r is not None
            ]
        if gained > 0.0:
            z = z + step
        damping *= SECANT_DAMPING if gained < 0.25 * expected else 1.0 / SECANT_DAMPING if gained > 0.5 * expected else 1.0
        cost, gradient, hessian = quadratic_model(problem, linear, z)
    return FitResult(problem, z, cost, MAX_SECANT_STEPS, False)


def is_too_slow(costs: Sequence[float], target: float) -> bool:
    """Whether a cost that falls as in the last steps cannot come down to `target` in the steps that are left."""
    if len(costs) <= SECANT_WARM_UP:
        return False
    left = (MAX_SECANT_STEPS - len(costs) + 1) / PACE_STEPS
    return costs[-1] - target > left * (costs[-1 - PACE_STEPS] - costs[-1])


def secant_update(run: LinearizedRun, step: Vector, shown: Matrix, taken: bool) -> LinearizedRun:
    """A run's derivatives with the least change by which they agree with a step; its residuals after it, if it is taken."""
    own = step[run.indices]
    size = max(float(own @ own), 1e-300)
    missed = shown - run.residuals - np.tensordot(own, run.jacobian, 1)
    jacobian = run.jacobian + np.multiply.outer(own / size, missed)
    return LinearizedRun(run.indices, shown if taken else run.residuals, jacobian)


def damped_step(
    problem: Problem,
    z: Vector,
    model: QuadraticModel,
    damping: float,
    min_decrease: float,
    executor: Executor,
    linear: Sequence[LinearizedRun] = (),
) -> tuple[Vector, float, float]:
    """The first step that lowers the cost, with more damping after each that does not: step, decrease, next damping.

    No step and no decrease when it is predicted to gain at most `min_decrease`, or (beyond MAX_DAMPING) when none gains.
    With the derivatives at hand (`linear`) a step is bent where that promises to gain more than `min_decrease`. Residuals
    r(z + v) after a step v are beyond r + J v by half of their second derivative along v, and b, which minimises the damped
    model of what is beyond, takes back as much of it as any parameters can: v + b is geodesic acceleration (Transtrum and
    Sethna, arXiv:1201.5885) with a difference over the whole step, which was simulated anyway. In a bent valley b leads back
    to its floor.
    """
    low, high = problem.limits()
    cost, gradient, hessian = model
    while damping <= MAX_DAMPING:
        try:
            step = bounded_step(gradient, hessian, damping, low - z, high - z)
        except LinAlgError:
            damping *= DAMPING_INCREASE
            continue
        expected = -float(gradient @ step + 0.5 * step @ hessian @ step)
        if expected <= min_decrease:
            break
        shown = residuals_at(problem, z + step, executor) if linear else ()
        gained = cost - (cost_of(problem, shown, z + step) if linear else cost_at(problem, z + step, executor))
        if linear and np.isfinite(gained):
            pull = second_order_pull(linear, shown, step, problem.robust)
            bend = bounded_step(pull, hessian, damping, low - z - step, high - z - step)
            promised = -float((gradient + hessian @ step + pull) @ bend + 0.5 * bend @ hessian @ bend)
            if promised > min_decrease and 2.0 * float(np.linalg.norm(bend)) <= MAX_BEND * float(np.linalg.norm(step)):
                more = cost - cost_at(problem, z + step + bend, executor)
                if more > gained:
                    step, gained = step + bend, more
        if gained > 0.1 * expected:
            return step, gained, damping / 10.0 if gained > 0.5 * expected else damping
        damping *= DAMPING_INCREASE
    return np.zeros_like(z), 0.0, damping


def second_order_pull(linear: Sequence[LinearizedRun], shown: Sequence[Matrix | None], step: Vector, robust: bool) -> Vector:
    """The gradient (n,) of what the residuals `shown` after a step are beyond its linearisation."""
    pull = np.zeros_like(step)
    for run, there in zip(linear, shown, strict=True):
        if there is not None:
            beyond = there - run.residuals - np.tensordot(step[run.indices], run.jacobian, 1)
            if robust:
                beyond *= robust_weights(run.residuals) ** 2
            pull[run.indices] += np.tensordot(run.jacobian, beyond, 2)
    return pull


def cannot_reach(target: float, max_iterations: int, costs: Sequence[float]) -> bool:
    """Whether a cost that falls as slowly as in the last of at most `max_iterations` cannot come down to `target`."""
    before, last = costs[-2:]
    return (before - last) * (max_iterations - len(costs) + 1) < last - target


def refit(
    problem: Problem, z: Vector, context: SearchContext, criteria: StopCriteria = ADDED_EFFECT, target: float = inf
) -> FitResult | None:
    """The optimum near z, or where the cost fell too slowly to reach `target`; None where the model cannot be run there."""
    lost = partial(cannot_reach, target, criteria.max_iterations)
    try:
        return minimize(problem, z, criteria, with_early_stopping(context, lost))
    except SimulationError:
        return None
