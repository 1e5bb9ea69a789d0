"""Minimisation against SciPy's on problems in closed form, without any simulation: residuals are functions of z."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear
from scipy.optimize import minimize as scipy_minimize

from sma_sim.evidence.estimation import levenberg_marquardt, plausibility
from sma_sim.evidence.estimation import problem as problem_module
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import (
    DAMPING_INCREASE,
    MAX_DAMPING,
    MAX_KEPT,
    EarlyStopping,
    bounded_step,
    damped_step,
    minimize,
)
from sma_sim.evidence.estimation.plausibility import approximate_covariance
from sma_sim.evidence.estimation.problem import (
    CURVATURE,
    MAX_RUN_STEP,
    MAX_STEP,
    MIN_STEP,
    SOLVER_ERROR,
    SWITCH,
    LinearizedRun,
    better_steps,
    cost_of,
    feasible,
    measured_steps,
    normal_equations,
    quadratic_model,
    start_point,
)
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import StopCriteria
from sma_sim.solver.simulate import SimulationError

TIMES = np.linspace(0.0, 4.0, 40)
TO_THE_END = StopCriteria(max_iterations=60, damping=1.0, min_decrease=1e-9, relative_decrease=0.0, central=True)


@dataclass(frozen=True)
class Curves:
    """A Problem: two runs of exp(-a t) + b t + c beside data; a and b are shared, c is each run's own."""

    data: np.ndarray
    low: float = -3.0
    high: float = 3.0
    robust: bool = False
    tempering: float = 1.0
    has_tangents: bool = True
    shared: tuple = ('a', 'b')
    free: tuple = ('a', 'b')
    unknowns: tuple = (SWITCH,) * 4  # with a prior about 0, as all but the warmth of wires
    config: object = field(default_factory=lambda: SimpleNamespace(parameters={'solver.rtol': 1e-6}))
    edge: float = np.inf  # of b, beyond which nothing can be run
    derivative_bytes: int = 0

    @property
    def samples(self):
        return self.data.size

    def limits(self):
        return np.full(4, self.low), np.full(4, self.high)

    def run(self, z, k):
        if z[1] > self.edge:
            return None
        return ((np.exp(-z[0] * TIMES) + z[1] * TIMES + z[2 + k] - self.data[k]) / 0.1)[None]

    def stacked(self, z):
        """What least_squares minimises: all residuals, and the prior."""
        return np.concatenate([self.run(z, 0)[0], self.run(z, 1)[0], self.tempering * z])


def residuals_at(problem, z, _):
    return [problem.run(z, k) for k in (0, 1)]


def linearize(problem, z, *_):
    found = []
    for k in (0, 1):
        if problem.run(z, k) is None:
            raise SimulationError('beyond the edge')
        slopes = np.array([-TIMES * np.exp(-z[0] * TIMES), TIMES, np.ones_like(TIMES)])[:, None, :] / 0.1
        found.append(LinearizedRun(np.array([0, 1, 2 + k]), problem.run(z, k), slopes))
    return found


def cost_at(problem, z, executor=None):
    return cost_of(problem, residuals_at(problem, z, executor), z)


def normal_parts(problem, z, *_):
    return [normal_equations(run, problem.robust) for run in linearize(problem, z)]


@pytest.fixture
def curves(monkeypatch):
    """Data with noise; the module under test sees these residuals in place of simulations."""
    for module in (levenberg_marquardt, problem_module):
        monkeypatch.setattr(module, 'residuals_at', residuals_at)
        monkeypatch.setattr(module, 'linearized_in_turn', linearize)
        monkeypatch.setattr(module, 'cost_at', cost_at)
        monkeypatch.setattr(module, 'normal_parts', normal_parts)
    random = np.random.default_rng(2)
    truth = np.array([[np.exp(-1.3 * TIMES) + 0.4 * TIMES + c] for c in (0.2, -0.7)])[:, 0]
    return Curves(truth + 0.1 * random.normal(size=(2, len(TIMES))))


def context(stop=None, **more):
    return SearchContext(None, stop or Event(), **more)


@pytest.mark.parametrize(('secant', 'size'), [(False, 0), (True, 0), (True, MAX_KEPT + 1)])
@pytest.mark.parametrize(('tempering', 'high'), [(1.0, 3.0), (30.0, 3.0), (1.0, 0.3)])
def test_the_minimum_is_that_of_another_optimizer(curves, secant, size, tempering, high):
    """With the prior, however strong, and on bounds; also where derivatives are too large to be kept."""
    problem = replace(curves, tempering=tempering, high=high, derivative_bytes=size)
    found = minimize(problem, np.zeros(4), replace(TO_THE_END, secant=secant), context())
    expected = least_squares(problem.stacked, np.zeros(4), bounds=problem.limits(), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert found.z == pytest.approx(expected.x, abs=1e-4) and (found.z <= high).all()
    assert found.cost == pytest.approx(expected.cost, rel=1e-8) and found.cost == pytest.approx(
        cost_at(problem, found.z, None)
    )
    assert found.converged and 1 < found.iterations < 40


@pytest.mark.parametrize('secant', [False, True])
def test_hubers_minimum_bears_outliers(curves, secant):
    spoilt = curves.data.copy()
    spoilt[:, ::9] += 5.0
    problem = replace(curves, data=spoilt, robust=True)
    found = minimize(problem, np.zeros(4), replace(TO_THE_END, secant=secant), context())
    expected = scipy_minimize(lambda z: cost_at(problem, z, None), found.z, method='Nelder-Mead', options={'xatol': 1e-6})
    assert found.cost == pytest.approx(expected.fun, rel=1e-6) and found.z == pytest.approx(expected.x, abs=1e-3)
    squares = minimize(replace(problem, robust=False), np.zeros(4), TO_THE_END, context())
    clean = minimize(curves, np.zeros(4), TO_THE_END, context())
    assert np.abs(found.z - clean.z).max() < 0.2 * np.abs(squares.z - clean.z).max()


def test_the_first_step_is_that_of_the_damped_model_and_what_it_gains_is_measured(curves):
    """Halved squares before less after; the next damping follows how much of the prediction came true."""
    z = np.array([1.0, 0.3, 0.0, 0.0])
    model = quadratic_model(curves, linearize(curves, z), z)
    A = np.vstack([run.jacobian[:, 0].T @ np.eye(4)[run.indices] for run in linearize(curves, z)] + [np.eye(4)])
    assert model[0] == pytest.approx(cost_at(curves, z, None)) == pytest.approx(0.5 * (curves.stacked(z) ** 2).sum())
    assert model[1] == pytest.approx(A.T @ curves.stacked(z)) and model[2] == pytest.approx(A.T @ A)
    step, gained, damping = damped_step(curves, z, model, 2.0, 0.0, None)
    assert step == pytest.approx(-np.linalg.solve(model[2] + 2.0 * np.eye(4), model[1]))
    assert gained == pytest.approx(model[0] - cost_at(curves, z + step, None)) and damping == pytest.approx(0.2)
    expected = 0.5 * (curves.stacked(z) @ curves.stacked(z) - np.sum((curves.stacked(z) + A @ step) ** 2))
    for least, made in ((0.99 * expected, True), (1.01 * expected, False)):
        step, gained, damping = damped_step(curves, z, model, 2.0, least, None)
        assert step.any() == made and (gained > 0.0) == made and damping == (0.2 if made else 2.0)


@pytest.mark.parametrize(
    ('share', 'said'), [(1.0, (1.0, 0.1)), (0.51, (0.51, 0.1)), (0.49, (0.49, 1.0)), (0.11, (0.11, 1.0)), (0.09, None)]
)
def test_how_much_of_a_prediction_must_come_true(curves, monkeypatch, share, said):
    """A tenth, or the step is shortened; from a half on, damping decreases."""
    z = np.array([1.0, 0.3, 0.0, 0.0])
    model = quadratic_model(curves, linearize(curves, z), z)
    first = bounded_step(model[1], model[2], 1.0, *(limit - z for limit in curves.limits()))
    expected = -float(model[1] @ first + 0.5 * first @ model[2] @ first)

    def shown(_, at, __):
        return model[0] - share * expected if np.allclose(at, z + first) else 0.0

    monkeypatch.setattr(levenberg_marquardt, 'cost_at', shown)
    step, gained, damping = damped_step(curves, z, model, 1.0, 0.0, None)
    if said is None:
        assert np.linalg.norm(step) < np.linalg.norm(first) and damping == pytest.approx(DAMPING_INCREASE / 10.0)
    else:
        assert (gained / expected, damping) == pytest.approx(said) and step == pytest.approx(first)


@dataclass(frozen=True)
class Canyon(Curves):
    """Two runs of a valley along z_1 = sin(3 z_0)/2 that is 1e-4 wide, and falls towards z_0 = 2; z_2 and z_3 are at 1."""

    width: float = 1e-4

    def run(self, z, k):
        return np.array([[(z[1] - 0.5 * np.sin(3.0 * z[0])) / self.width, 4.0 * (z[0] - 2.0), 10.0 * (z[2 + k] - 1.0)]])

    def linearized(self, z):
        slopes = np.zeros((3, 1, 3))
        slopes[:2, 0, 0] = np.array([-1.5 * np.cos(3.0 * z[0]), 1.0]) / self.width
        slopes[0, 0, 1], slopes[2, 0, 2] = 4.0, 10.0
        return [LinearizedRun(np.array([0, 1, 2 + k]), self.run(z, k), slopes) for k in (0, 1)]


@pytest.fixture
def simulated(monkeypatch):
    """The points at which residuals of a canyon were asked for."""
    points = []

    def seen(problem, z, _):
        points.append(z)
        return residuals_at(problem, z, _)

    for module in (levenberg_marquardt, problem_module):
        monkeypatch.setattr(module, 'residuals_at', seen)
        monkeypatch.setattr(module, 'linearized_in_turn', lambda problem, z, *_: problem.linearized(z))
        monkeypatch.setattr(module, 'cost_at', lambda problem, z, _: cost_of(problem, seen(problem, z, _), z))
        monkeypatch.setattr(
            module, 'normal_parts', lambda at, z, *_: [normal_equations(run, at.robust) for run in at.linearized(z)]
        )
    return points


IN_THE_CANYON = np.array([-0.5, 0.5 * np.sin(-1.5), 0.0, 0.0])


@pytest.mark.parametrize(('high', 'robust'), [(3.0, False), (3.0, True), (0.4, False)])
def test_steps_bend_along_a_narrow_valley(simulated, high, robust):
    """With the derivatives at hand a fit follows it to its end, a bound or not, in a part of the steps and of the runs."""
    canyon, found = Canyon(np.zeros((2, 3)), high=high, robust=robust), []
    for size in (0, MAX_KEPT + 1):
        simulated.clear()
        problem = replace(canyon, derivative_bytes=size)
        found.append((minimize(problem, IN_THE_CANYON, TO_THE_END, context()), len(simulated)))
    (bent, runs), (straight, more) = found
    assert bent.converged and bent.cost <= straight.cost + 1e-6 and (bent.z <= high).all()
    assert 2 * bent.iterations < straight.iterations and runs < more
    if not robust:
        expected = least_squares(canyon.stacked, bent.z, bounds=canyon.limits(), xtol=1e-14, ftol=1e-14, gtol=1e-14)
        assert bent.cost == pytest.approx(expected.cost, rel=1e-5)


def test_a_bend_that_is_long_beside_its_step_is_not_tried(simulated, monkeypatch):
    """Nor one that promises no more than counts; without it a step is as it would be straight."""
    canyon, z = Canyon(np.zeros((2, 3))), IN_THE_CANYON
    linear = canyon.linearized(z)
    model = quadratic_model(canyon, linear, z)
    straight = damped_step(canyon, z, model, 1.0, 0.0, None)
    count = len(simulated)
    bent = damped_step(canyon, z, model, 1.0, 0.0, None, linear)
    assert bent[1] > 2.0 * straight[1] and len(simulated) < 2 * count
    simulated.clear()
    monkeypatch.setattr(levenberg_marquardt, 'MAX_BEND', 0.0)
    again = damped_step(canyon, z, model, 1.0, 0.0, None, linear)
    assert (again[0] == straight[0]).all() and again[1:] == straight[1:] and len(simulated) == count


def test_a_step_that_nothing_shortens_enough_is_none(curves, monkeypatch):
    z = np.array([1.0, 0.3, 0.0, 0.0])
    model = quadratic_model(curves, linearize(curves, z), z)
    for name in ('cost_of', 'cost_at'):
        monkeypatch.setattr(levenberg_marquardt, name, lambda *_: np.inf)
    step, gained, damping = damped_step(curves, z, model, 1.0, -1.0, None)
    assert not step.any() and gained == 0.0 and MAX_DAMPING < damping <= MAX_DAMPING * DAMPING_INCREASE
    assert not minimize(curves, z, TO_THE_END, context()).converged


def test_a_minimisation_keeps_to_where_runs_can_be_made(curves):
    """The optimum is beyond an edge: steps end before it, and nothing starts there."""
    problem, z = replace(curves, edge=0.3), np.array([1.0, 0.1, 0.0, 0.0])
    for secant in (False, True):
        found = minimize(problem, z, replace(TO_THE_END, secant=secant), context())
        assert 0.1 < found.z[1] <= 0.3 and found.cost < 0.5 * cost_at(problem, z, None)
    beyond = np.array([0.0, 0.4, 0.0, 0.0])
    assert cost_at(problem, beyond, None) == np.inf and not feasible(problem, beyond, None)
    assert feasible(problem, np.zeros(4), None)
    with pytest.raises(SimulationError):
        minimize(problem, beyond, TO_THE_END, context())


def test_every_iteration_is_told_and_lowers_the_cost_until_it_is_stopped(curves):
    told, stop = [], Event()

    def hear(label, iteration, cost):
        told.append((label, iteration, cost))
        if iteration == 2:
            stop.set()

    found = minimize(curves, np.zeros(4), TO_THE_END, context(stop, on_iteration=hear), 'some')
    assert [one[:2] for one in told] == [('some', 0), ('some', 1), ('some', 2)] and not found.converged
    costs = [one[2] for one in told]
    assert costs == sorted(costs, reverse=True) and (found.cost, found.iterations) == (costs[2], 2)
    few = minimize(curves, np.zeros(4), replace(TO_THE_END, max_iterations=1), context())
    assert not few.converged and few.cost == pytest.approx(cost_at(curves, few.z, None)) and few.iterations == 1
    rough = minimize(curves, np.zeros(4), replace(TO_THE_END, relative_decrease=0.5), context())
    assert rough.converged and rough.iterations < 8


def test_a_predicted_decrease_counts_beside_the_error_over_noise(curves):
    """Where the error is ten times the noise, a hundred times as much may be left."""
    z = minimize(curves, np.zeros(4), TO_THE_END, context()).z + np.array([0.0, 0.0, 0.05, 0.0])
    model = quadratic_model(curves, linearize(curves, z), z)
    step = bounded_step(model[1], model[2], 1.0, *(limit - z for limit in curves.limits()))
    share = -float(model[1] @ step + 0.5 * step @ model[2] @ step) / (model[0] / (0.5 * curves.samples))
    for factor, moved in ((0.95, True), (1.05, False)):
        found = minimize(curves, z, replace(TO_THE_END, min_decrease=factor * share, max_iterations=1), context())
        assert (found.z != z).any() == moved


def test_early_stopping_waits_for_the_damped_steps():
    stop, seen = Event(), []
    watch = EarlyStopping(stop, lambda costs: seen.append(len(costs)) or costs[-1] > 5.0)
    ended = []
    for k, cost in enumerate((9.0, 8.0, 7.0, 4.0, 6.0)):
        watch.on_iteration('', k, cost)
        ended.append(watch.is_set())
    assert ended == [False, False, False, False, True] and seen == [4, 5]
    watch.set()
    assert stop.is_set()


def test_a_step_stays_within_bounds_and_is_the_best_there():
    random = np.random.default_rng(3)
    for _ in range(20):
        A = random.normal(size=(6, 4))
        H, g, damping = A.T @ A, random.normal(size=4) * 3.0, random.uniform(0.1, 2.0)
        low, high = -random.uniform(0.05, 1.0, 4), random.uniform(0.05, 1.0, 4)
        low[0] = high[0] = 0.0
        step = bounded_step(g, H, damping, low, high)
        slope = g + (H + damping * np.eye(4)) @ step
        assert (step >= low).all() and (step <= high).all()
        for j in range(1, 4):
            inside = low[j] + 1e-9 < step[j] < high[j] - 1e-9
            assert abs(slope[j]) < 1e-8 if inside else slope[j] * np.sign(step[j]) <= 1e-8


def test_a_step_with_many_unknowns_at_bounds_is_that_of_another_method():
    for seed in range(50):
        random = np.random.default_rng(seed)
        A = random.normal(size=(40, 20)) * 10.0 ** random.uniform(-2.0, 2.0, 20)
        b, (low, high) = random.normal(size=40), np.sort(random.normal(size=(2, 20)), axis=0)
        low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
        step = bounded_step(A.T @ b, A.T @ A, 0.0, low, high)
        other = lsq_linear(A, -b, (low - 1e-12, high + 1e-12), method='bvls').x
        assert (step >= low).all() and (step <= high).all()
        assert np.linalg.norm(A @ step + b) <= np.linalg.norm(A @ other + b) * (1.0 + 1e-9)


def test_a_start_is_the_middle_or_the_guess_within_bounds(curves):
    problem = replace(curves, low=0.5, high=1.0)
    assert start_point(problem).tolist() == [0.5] * 4
    assert start_point(problem, np.array([0.0, 0.7, 2.0, 1.0])).tolist() == [0.5, 0.7, 1.0, 1.0]


def test_steps_of_differences_are_where_their_error_is_least(curves):
    """Solver's error over the step, and curvature times the step (its square, if central), as better_steps has it."""
    sensitivity = np.array([0.05, 0.5, 3.0, 20.0])
    hessian = np.diag(curves.samples * sensitivity**2)
    error = SOLVER_ERROR * 1e-6
    for central in (False, True):
        found = better_steps(curves, hessian, central)
        for j, h in enumerate(found):
            s, most = sensitivity[j], MAX_STEP if j < 2 else MAX_RUN_STEP
            sizes = np.geomspace(MIN_STEP, most, 2000)
            curved = s * CURVATURE**2 * sizes**2 / 6.0 if central else s * CURVATURE * sizes / 2.0
            assert h == pytest.approx(sizes[np.argmin(error / sizes + curved)], rel=0.02)
    assert (better_steps(curves, np.zeros((4, 4)), True) == [MAX_STEP, MAX_STEP, MAX_RUN_STEP, MAX_RUN_STEP]).all()
    assert measured_steps(curves, np.zeros(4), None) is None
    z = np.zeros(4)
    expected = better_steps(curves, quadratic_model(curves, linearize(curves, z), z)[2], True)
    assert measured_steps(replace(curves, has_tangents=False), z, None) == pytest.approx(expected)


def test_a_fits_error_leaves_out_the_prior(curves):
    problem = replace(curves, tempering=3.0)
    z = np.array([1.0, 0.3, 0.1, -0.6])
    fit = FitResult(problem, z, cost_at(problem, z, None))
    rows = np.concatenate([problem.run(z, 0), problem.run(z, 1)])
    assert fit.squares == pytest.approx((rows**2).sum()) and fit.error == pytest.approx(np.sqrt((rows**2).mean()))


def test_a_covariance_without_intervals_is_that_of_linear_least_squares(curves, monkeypatch):
    """Under weak priors of the parameters and those of each run's own unknowns; wider by an error beyond the noise."""
    z = np.array([1.0, 0.3, 0.1, -0.6])
    monkeypatch.setattr(
        plausibility, 'normal_parts', lambda p, at, _: [normal_equations(r, False) for r in linearize(p, at)]
    )
    rows = np.vstack([run.jacobian[:, 0].T @ np.eye(4)[run.indices] for run in linearize(curves, z)])
    known = np.linalg.inv(rows.T @ rows + np.diag([1 / 25, 1 / 25, 1.0, 1.0]))[:2, :2]
    for size in (0.5, 2.0):
        fit = SimpleNamespace(problem=curves, z=z, error=size)
        with ThreadPoolExecutor(1) as pool:
            found = approximate_covariance(fit, SearchContext(pool, Event()))
        assert found == pytest.approx(max(1.0, size) ** 2 * known)
