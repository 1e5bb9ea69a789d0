"""The heating by which a model follows a target: constrained nonlinear least squares over a horizon.

The model is inverted by its own equations. Going back from the target, a pose and its rate need forces of the wires

    K q + D dq/dt = -J(q)' F,      sigma = F/(n pi r0^2),

a wire that contracts has sigma = sigma_M(T), which says how hot it is, and eps = l(q)/l0 - 1 with sigma(eps, x_M) = sigma
says how much martensite is left; its heat balance then says the power (MAS3, MAS8, MAS9):

    J/n = (Om rho c_V - L_T) dT/dt - L_x dx_M/dt + lambda A_s (T - T_E).

That chain has no solution where it asks for J < 0 (no wire cools faster than lambda A_s (T - T_E) allows, so that it has to
be left to cool before the target turns), and another form in each mode and with every effect. So the levels of the heating
over a horizon are found that bring the compiled model, effects and all, nearest to the target,

    min  sum_k w_k (q(t_k) + b - target(t_k))^2 + smoothness^2 sum_j (J_j - J_(j-1))^2/J_full^2
    for  |J_j| <= J_max,   T_i(t_k) <= T_max,   sigma_i(t_k) <= stress_max,

with J_full = n lambda A_s (T_max - T_E), by steps of Gauss and Newton with the tangents of the run, each a linear problem
with inequalities. They begin from the plan before. Where they leave an error, they begin once more from the best constant
level: a wire between its transformations answers to no small change of its heating, so that derivatives alone do not show
the way.

A command stays in force until the next one comes, and a busy computer may make that late: more than J_full would burn a wire
meanwhile. So where no guard is behind the controller, |J_j| <= J_full as well, with the least n lambda A_s that is probable.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from sma_sim.evidence.state_estimation.estimate import RobotState
from sma_sim.evidence.state_estimation.uncertain import least_cooling
from sma_sim.model.argument_checks import as_array
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.expected_units import mismatch_of
from sma_sim.model.nearest import suggestion
from sma_sim.model.parameters import wire_constants
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.integrate import PER_WIRE, WIRE_COLUMNS
from sma_sim.solver.model import Model
from sma_sim.solver.prediction import Prediction
from sma_sim.solver.propagation import run_at_rest
from sma_sim.solver.simulate import SimulationError

Target = Callable[[Vector], Vector]  # from times (k,) [s] to wanted values of a coordinate (k,)
EDGES = (0.0, 0.04, 0.12, 0.28, 0.56, 1.0)  # of the levels, in parts of the horizon
TIMES = (0.04, 0.08, 0.12, 0.2, 0.28, 0.37, 0.46, 0.56, 0.7, 0.85, 1.0)  # at which the target is compared
BISECTIONS = 6  # of a constant level, from which a step of Gauss and Newton goes on
LARGE_ERROR = 5e-3  # as a part of the usual change, of a plan that another one may be better than
PENALTY = 10.0  # of a limit that is passed by its scale, against an error of a usual change
ENOUGH = 0.99  # of its cost that a step leaves, after which no other one is made
PARTS = (1.0, 0.3, 0.1)  # parts of a step that are tried
TOLERANCE = 1e-3  # of the steps of a prediction, relative to usual changes
T_SCALE, STRESS_SCALE = 30.0, 1e8  # [K], [Pa] of the limits
SMALLEST_ROW = 1e-12  # of a constraint, relative to the largest one, on which no unknown acts
INFEASIBLE = 1e-10  # residual of the dual problem below which no point keeps all constraints


class Plan(NamedTuple):
    """Levels of the heating (levels,) [W], and their cost: the sum of squares, and what passes limits."""

    levels: Vector
    cost: float


@dataclass(frozen=True)
class Problem:
    """The least-squares problem of one plan.

    Attributes
    ----------
    prediction, start : Prediction, RobotState
        What the model does, from where.
    number : int
        The coordinate that follows the target.
    wanted : array (k,)
        Where the model's coordinate should be.
    weights : array (k,)
        Of its errors, over its usual change.
    smoothness : float
        Weight of changes between levels [1/W], the first one from `before` [W].
    bounds : tuple of float
        Of the levels [W].
    limited : array of int
        Where samples have what is limited: temperatures of all wires, then stresses.
    limits : array
        (2 wires,): how large they may be.
    """

    prediction: Prediction
    start: RobotState
    number: int
    wanted: Vector
    weights: Vector
    smoothness: float
    before: float
    bounds: tuple[float, float]
    limited: NDArray[np.int64]
    limits: Vector

    def plan_with(self, levels: Vector) -> Plan:
        """These levels and what they cost; infinite where the model cannot run on under them."""
        start = self.start
        try:
            samples = self.prediction.samples(start.time, start.run, levels, start.gains, start.T_E)
        except SimulationError:
            return Plan(levels, np.inf)
        over = np.maximum(samples[:, self.limited] - self.limits, 0.0) / self._units
        return Plan(levels, float(np.sum(self._residuals(samples, levels) ** 2) + PENALTY * np.sum(over)))

    def improved(self, plan: Plan) -> Plan:
        """What a step of Gauss and Newton makes of a plan; the plan itself where that is no better."""
        levels, start, (low, high) = plan.levels, self.start, self.bounds
        try:
            samples, slopes = self.prediction.with_derivatives(start.time, start.run, levels, start.gains, start.T_E)
        except SimulationError:
            return plan
        unit = np.eye(len(levels))
        A = np.vstack([self.weights[:, None] * slopes[:, self.number], self.smoothness * self._changes])
        by_levels = slopes[:, self.limited] / self._units[:, None]
        room = (self.limits - samples[:, self.limited]) / self._units
        G = np.vstack([by_levels.reshape(-1, len(levels)), unit, -unit])
        h = np.concatenate([room.ravel(), high - levels, levels - low])
        step = constrained_least_squares(A, -self._residuals(samples, levels), G, h)
        if step is None:  # a wire is beyond a limit already, and stays so whatever is done
            step = -levels
        for part in PARTS:
            tried = self.plan_with(np.clip(levels + part * step, low, high))
            if tried.cost < plan.cost:
                return tried
        return plan

    def under_constant(self, level: float) -> tuple[float, bool]:
        """The weighted mean of the errors under a constant level [W], and whether a limit is passed or the run ends."""
        levels, start = np.full(self.prediction.levels, level), self.start
        try:
            samples = self.prediction.samples(start.time, start.run, levels, start.gains, start.T_E)
        except SimulationError:
            return 0.0, True
        mean = float(np.sum(self.weights**2 * (samples[:, self.number] - self.wanted)))
        return mean, bool((samples[:, self.limited] > self.limits).any())

    def _residuals(self, samples: Matrix, levels: Vector) -> Vector:
        errors = self.weights * (samples[:, self.number] - self.wanted)
        changes = self._changes @ levels
        changes[0] -= self.before
        return np.concatenate([errors, self.smoothness * changes])

    @cached_property
    def _changes(self) -> Matrix:
        """What makes of levels (levels,) their changes, the first one from 0."""
        count = self.prediction.levels
        return np.eye(count) - np.eye(count, k=-1)

    @cached_property
    def _units(self) -> Vector:
        return np.repeat([T_SCALE, STRESS_SCALE], len(self.limited) // 2)


class Planner:
    """Plans the heating of a structure that follows a target.

    `levels` (levels,) [W] are those of the last plan, `coordinate` is the name of what follows, `period` [s] that of plans.

    Parameters
    ----------
    config : Config
        The parameters ``control.*``, the limits ``guard.*`` and ``node.J_max``.
    iterations : int
        Steps of Gauss and Newton for each plan.

    Raises
    ------
    UserError
        For a structure that more than one heating command moves, and a coordinate that it does not have.
    SimulationError
        If the model has no start at rest.
    """

    def __init__(self, config: Config, iterations: int) -> None:
        structure, given = config.structure, config.parameters
        edges, times = ([given['control.horizon'] * part for part in parts] for parts in (EDGES, TIMES))
        self._prediction = Prediction(Model(config), edges, times, TOLERANCE)
        known = structure.coordinate_names
        self.coordinate = str(config.settings['control.coordinate']) or known[-1]
        if self.coordinate not in known:
            raise UserError(
                f'control.coordinate = {self.coordinate!r} is none of system {structure.name}'
                f'{suggestion(self.coordinate, known)}; expected one of {", ".join(known)}'
            )
        self._column = structure.coordinates[known.index(self.coordinate)].column
        self._number, self._given, self._iterations = known.index(self.coordinate), given, iterations
        self.period = 1.0 / given['control.rate']
        scale = structure.coordinates[self._number].size(structure.constants_of(given))
        self._weights = np.sqrt(np.diff(TIMES, prepend=0.0)) / scale
        J_max = given['node.J_max']
        if not J_max > 0.0:
            raise UserError(f'node.J_max = {J_max:g} W: nothing can be moved; expected more than 0')
        self._antagonistic = structure.antagonistic
        self._is_guarded, self._cooling = bool(config.settings['control.behind_guard']), least_cooling(config)
        w = wire_constants(given)
        hot = w.n * w.lambda_ * w.surface * (given['guard.T_max'] - given['environment.T_E'])
        self._full = min(hot, J_max) if hot > 0.0 else J_max
        first = sample_columns(structure).wires.start + PER_WIRE * np.arange(structure.wires)
        self._limited = np.concatenate([first + WIRE_COLUMNS.index(name) for name in ('T', 'sigma')])
        self.restart()
        self._load(given['environment.T_E'])

    def restart(self) -> None:
        """Forget the plan before."""
        self.levels = np.zeros(len(EDGES) - 1)

    def plan(self, start: RobotState, target: Target) -> float:
        """The command [W] to give now, so that the coordinate follows the target [rad or m].

        Raises SimulationError where the model cannot run on from here under any command.
        """
        given = self._given
        if self._prediction.model is not start.model:
            self._prediction.follow(start.model)
        margins = given['guard.margin'] * np.concatenate([start.T_std, start.stress_std])
        problem = Problem(
            prediction=self._prediction,
            start=start,
            number=self._number,
            wanted=self._wanted(target, start.time + self._prediction.times) - start.offsets[self._number],
            weights=self._weights,
            smoothness=given['control.smoothness'] / self._full,
            before=float(self.levels[0]),
            bounds=self.bounds(start.T_E),
            limited=self._limited,
            limits=np.repeat([given['guard.T_max'], given['guard.stress_max']], len(start.T_std)) - margins,
        )
        best = problem.plan_with(self._shifted(self.levels))
        for _ in range(self._iterations if self.levels.any() else 0):  # without a plan before it is of no use
            before, best = best, problem.improved(best)
            if not best.cost < ENOUGH * before.cost:
                break
        if not best.cost < LARGE_ERROR**2:
            best = min(best, problem.improved(problem.plan_with(self._constant_level(problem))), key=lambda one: one.cost)
        if not np.isfinite(best.cost):
            raise SimulationError(f'system = {start.model.structure.name}: the model cannot run on under any command')
        self.levels = best.levels
        return float(best.levels[0])

    def bounds(self, T_E: float) -> tuple[float, float]:
        """Least and largest command [W]: without a guard behind it, one that may stay in force for ever."""
        most = self._given['node.J_max']
        if not self._is_guarded:
            most = min(max(self._cooling * (self._given['guard.T_max'] - T_E), 0.0), most)
        return (-most if self._antagonistic else 0.0), most

    def _wanted(self, target: Target, times: Vector) -> Vector:
        """What a target says at times (k,) [s]: values of the coordinate (k,), or one for all."""
        values = as_array('target', target(times), '[rad or m]')
        if values.shape not in ((), times.shape) or not np.isfinite(values).all():
            raise UserError(
                f'target: expected a finite value of the coordinate for each of {len(times)} times, got an array of shape '
                f'{values.shape}'
            )
        if mismatch := mismatch_of(self._column, np.atleast_1d(values)):
            raise UserError(f'target of {self.coordinate}: {mismatch.words}')
        return np.broadcast_to(values, times.shape)

    def _load(self, T_E: float) -> None:
        """Load compiled code, which takes longer than a plan may."""
        model = self._prediction.model
        rest, gains = run_at_rest(model, T_E), np.ones(model.wires)
        self._prediction.samples(0.0, rest, self.levels, gains, T_E)
        self._prediction.with_derivatives(0.0, rest, self.levels, gains, T_E)

    def _constant_level(self, problem: Problem) -> Vector:
        """The constant level that keeps all limits and whose mean error is nearest to nil, by bisection.

        The coordinate is monotone in it, and the more a wire is heated, the hotter it gets and the more it is stressed.
        """
        low, high = np.clip(problem.bounds, -self._full, self._full).tolist()
        rises = problem.under_constant(high)[0] > problem.under_constant(low)[0]
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            error, is_over = problem.under_constant(middle)
            if middle > 0.0 if is_over else (error > 0.0) == rises:
                high = middle
            else:
                low = middle
        return np.full(len(self.levels), low if low > 0.0 else high if high < 0.0 else 0.0)

    def _shifted(self, levels: Vector) -> Vector:
        """Levels a period later: means over each stretch of what was planned for it."""
        edges = self._prediction.edges
        sums = np.concatenate([[0.0], np.cumsum(levels * np.diff(edges))])
        ends = edges + self.period
        moved = np.interp(ends, edges, sums) + levels[-1] * np.maximum(ends - edges[-1], 0.0)
        found: Vector = np.diff(moved) / np.diff(edges)
        return found


def constrained_least_squares(A: Matrix, b: Vector, G: Matrix, h: Vector) -> Vector | None:
    """The x (n,) with the smallest |A x - b| for which G x <= h; None where none is found that keeps all of these.

    A (m, n) has full column rank, G is (c, n). With A = Q R and z = R x - Q'b the problem is one of least distance, min |z|
    under inequalities, whose dual is one of least squares with x >= 0 (Lawson and Hanson, Solving Least Squares Problems,
    1974, chapter 23). Constraints on which no unknown acts are left out.
    """
    Q, R = np.linalg.qr(A)
    projected = Q.T @ b
    sizes = np.linalg.norm(G, axis=1)
    acting = sizes > SMALLEST_ROW * max(float(sizes.max(initial=0.0)), np.finfo(float).tiny)
    G, h = G[acting] / sizes[acting, None], h[acting] / sizes[acting]
    if not len(G):
        return np.asarray(np.linalg.solve(R, projected))
    rows = np.linalg.solve(R.T, G.T).T  # G R^-1
    room = h - rows @ projected
    if (room >= 0.0).all():  # the least squares without constraints keep them
        return np.asarray(np.linalg.solve(R, projected))
    lengths = np.linalg.norm(rows, axis=1)
    dual = np.vstack([-rows.T / lengths, -room / lengths])
    goal = np.zeros(len(dual))
    goal[-1] = 1.0
    try:
        weights, _ = nnls(dual, goal)
    except RuntimeError:  # it goes round in circles
        return None
    residual = dual @ weights - goal
    if np.linalg.norm(residual) < INFEASIBLE:
        return None
    return np.asarray(np.linalg.solve(R, projected - residual[:-1] / residual[-1]))
