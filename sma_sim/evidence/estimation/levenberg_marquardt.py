"""Bounded Levenberg-Marquardt over normal equations that are summed run by run.

A Jacobian of thirty runs does not fit where a whole one must be kept: each run's part is folded into the normal
equations as it arrives. The prior, one in every coordinate, keeps them well conditioned.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cholesky
from scipy.optimize import lsq_linear

from sma_sim.evidence.estimation.problem import ROBUST, LinearizedRun, Problem, better_steps, linearize, residuals_at
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
MOST_DAMPING, MORE_DAMPING = 1e12, 3.0  # the factor after a step that did not gain: finer ones find longer steps
NEAR = 0.1  # relative gain of a step below which differences become central
UNJUDGED = 3  # iterations of a descent before a watch may end it
LEAST_COST = 1e-9  # per sample; below it only the solver's error is fitted


@dataclass(frozen=True)
class NormalEquations:
    """One run's share of the normal equations: cost (half the sum of squares), gradient, Gauss-Newton Hessian."""

    place: NDArray[np.int64]
    cost: float
    gradient: Vector
    hessian: Matrix


@dataclass(frozen=True)
class MinimizerResult:
    """Where a descent ended: z, cost with the prior, and why it ended."""

    z: Vector
    cost: float
    iterations: int
    converged: bool


@dataclass(frozen=True)
class StopCriteria:
    """How a descent goes: `most` iterations; `damping` of the first step; when it ends.

    It ends when the next step is foretold to lower the cost by at most `enough` times the square of the error over
    noise (0.01 moves no estimate by more than 0.14 of its standard deviation), or when the last one gained less than
    the part `gain` of the cost. `near`: differences are central from the beginning.
    """

    most: int
    damping: float
    enough: float
    gain: float
    near: bool


FIRST = StopCriteria(most=20, damping=1e4, enough=0.3, gain=3e-4, near=False)  # from afar, on thinned samples
LIGHTER = replace(FIRST, damping=1e2)  # a second one from afar: either may pass by a valley that holds the other
REFIT = StopCriteria(most=3, damping=1.0, enough=0.3, gain=3e-4, near=True)  # without some of the runs
LAST = StopCriteria(most=12, damping=1.0, enough=0.01, gain=0.0, near=True)  # on all samples


class Stop(Protocol):
    """What ends a descent early: an event, or a race that is lost."""

    def is_set(self) -> bool:
        """Whether to end now."""


Progress = Callable[[str, int, float], None]  # what is being done, iteration, cost


class EarlyStopping:
    """Watches the progress of one descent, and ends it as soon as `over` says so of the costs so far."""

    def __init__(self, stop: Stop, over: Callable[[Sequence[float]], bool]) -> None:
        self._stop, self._over, self._costs = stop, over, list[float]()

    def progress(self, label: str, iteration: int, cost: float) -> None:
        """What the descent tells after each linearisation."""
        self._costs.append(cost)

    def is_set(self) -> bool:
        """Whether to end. The first steps are damped, whatever they lead to, so that they say nothing."""
        return self._stop.is_set() or (len(self._costs) > UNJUDGED and self._over(self._costs))


def robust_cost(residuals: Matrix, robust: bool) -> float:
    """Half the sum of squares, or of Huber's function with its corner at ROBUST."""
    if not robust:
        return 0.5 * float(np.vdot(residuals, residuals))
    size = np.abs(residuals)
    return float(np.where(size <= ROBUST, 0.5 * size**2, ROBUST * (size - 0.5 * ROBUST)).sum())


def robust_weights(residuals: Matrix) -> Matrix:
    """Square roots of the weights that make Huber's function a weighted sum of squares."""
    weights: Matrix = np.sqrt(np.minimum(1.0, ROBUST / np.maximum(np.abs(residuals), 1e-300)))
    return weights


def normal_equations(linear: LinearizedRun, robust: bool) -> NormalEquations:
    """The normal equations of one run."""
    jacobian = linear.jacobian.reshape(len(linear.place), -1)
    residuals = linear.residuals.ravel()
    cost = robust_cost(residuals, robust)
    if robust:
        weights = robust_weights(residuals)
        jacobian, residuals = jacobian * weights, residuals * weights
    return NormalEquations(linear.place, cost, jacobian @ residuals, jacobian @ jacobian.T)


def accumulated(parts: Sequence[NormalEquations], z: Vector, prior: float = 1.0) -> tuple[float, Vector, Matrix]:
    """Cost, gradient and Hessian of all runs and of the prior."""
    cost, gradient = 0.5 * prior * float(z @ z), prior * z
    hessian = prior * np.eye(len(z))
    for part in parts:
        cost += part.cost
        gradient[part.place] += part.gradient
        hessian[np.ix_(part.place, part.place)] += part.hessian
    return cost, gradient, hessian


def bounded_step(gradient: Vector, hessian: Matrix, damping: float, low: Vector, high: Vector) -> Vector:
    """The step that minimises the damped quadratic model within bounds (low < 0 < high, or equal)."""
    damped = hessian + damping * np.eye(len(gradient))
    factor = cholesky(damped, lower=False)
    target = -np.linalg.solve(factor.T, gradient)
    step: Vector = lsq_linear(factor, target, (np.minimum(low, -1e-12), np.maximum(high, 1e-12)), method='bvls').x
    return np.clip(step, low, high)


def cost_at(problem: Problem, z: Vector, executor: Executor) -> float:
    """The cost with the prior; inf where the model cannot be run."""
    total = 0.5 * float(z @ z)
    for residuals in residuals_at(problem, z, executor):
        if residuals is None:
            return np.inf
        total += robust_cost(residuals, problem.robust)
    return total


def normal_parts(
    problem: Problem, z: Vector, executor: Executor, steps: Vector | None = None, central: bool = False
) -> list[NormalEquations]:
    """The normal equations of every run at z."""
    return [normal_equations(linear, problem.robust) for linear in linearize(problem, z, executor, steps, central)]


def minimize(
    problem: Problem, z: Vector, executor: Executor, effort: StopCriteria, stop: Stop, progress: Progress | None = None,
    label: str = '',
) -> MinimizerResult:  # fmt: skip
    """Go down from z with an effort. Raises SimulationError when the model cannot be run at the start.

    Damping is absolute: what data hardly see stays near its prior until the rest is right. Differences become
    central when a step gains little, because valleys are narrow.
    """
    half = 0.5 * problem.samples
    central, damping = effort.near, effort.damping
    steps = measured_steps(problem, z, executor) if effort.near else None
    for iteration in range(effort.most):
        parts = normal_parts(problem, z, executor, steps, central)
        cost, gradient, hessian = accumulated(parts, z)
        if progress is not None:
            progress(label, iteration, cost)
        if stop.is_set():
            return MinimizerResult(z, cost, iteration, False)
        least = effort.enough * max(cost / half, LEAST_COST)
        step, gained, damping = accepted(problem, z, executor, (cost, gradient, hessian), damping, least)
        z = z + step
        if gained <= effort.gain * cost and (central or damping <= MOST_DAMPING):
            return MinimizerResult(z, cost - gained, iteration, damping <= MOST_DAMPING)
        central = central or gained < NEAR * cost
        steps = better_steps(problem, hessian, central)
    return MinimizerResult(z, cost - gained, effort.most, False)


def measured_steps(problem: Problem, z: Vector, executor: Executor) -> Vector:
    """Steps of central differences that suit the neighbourhood of z, from one-sided differences."""
    return better_steps(problem, accumulated(normal_parts(problem, z, executor), z)[2], central=True)


def accepted(
    problem: Problem, z: Vector, executor: Executor, model: tuple[float, Vector, Matrix], damping: float, least: float
) -> tuple[Vector, float, float]:
    """The first step that gains, damped more after each that does not: step, gain, damping for the next.

    No step and no gain when one is foretold to gain no more than `least`, or (beyond MOST_DAMPING) when none does.
    """
    low, high = problem.limits()
    cost, gradient, hessian = model
    while damping <= MOST_DAMPING:
        try:
            step = bounded_step(gradient, hessian, damping, low - z, high - z)
        except LinAlgError:
            damping *= MORE_DAMPING
            continue
        expected = -float(gradient @ step + 0.5 * step @ hessian @ step)
        if expected <= least:
            break
        gained = cost - cost_at(problem, z + step, executor)
        if gained > 0.1 * expected:
            return step, gained, damping / 10.0 if gained > 0.5 * expected else damping
        damping *= MORE_DAMPING
    return np.zeros_like(z), 0.0, damping


def start_point(problem: Problem, guess: Vector | None = None) -> Vector:
    """A point at the middle of the priors, within the bounds."""
    low, high = problem.limits()
    return np.clip(np.zeros(len(low)) if guess is None else guess, low, high)


def feasible(problem: Problem, z: Vector, executor: Executor) -> bool:
    """Whether every run can be made at z."""
    try:
        return bool(np.isfinite(cost_at(problem, z, executor)))
    except SimulationError:
        return False
