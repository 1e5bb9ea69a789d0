"""What a step is made of: the solution of its equations, its Jacobian, and the guards within it."""

import numpy as np
import pytest
from flows import MODES, Point, active, make_model

from sma_sim.model.automaton import EDGES
from sma_sim.model.layout import Evaluation, InputPoint, SystemState
from sma_sim.model.system import EVERYTHING, guard, update_flow, update_guards
from sma_sim.solver.effect_table import own_scratch
from sma_sim.solver.linear import eliminate, elimination, invert, invert_shifted, multiply, solve_shifted
from sma_sim.solver.model import new_findings
from sma_sim.solver.simulate import new_work
from sma_sim.solver.stepper import Segment, linearize_flow

CASES = [('hybrid', mode, ()) for mode in MODES] + [
    ('mas', 3, ()),
    ('hybrid', 4, ('natural_convection', 'beam_creep')),
    ('hybrid', 3, ('polycrystal', 'driver_lag')),
    ('mas', 3, ('gravity', 'sensor_lag')),
]


def of_motion(random, n, coordinates):
    """A Jacobian whose first states change by the next alone."""
    jacobian = random.normal(size=(n, n)) * 10.0 ** random.uniform(-2, 4, (n, 1))
    jacobian[:coordinates] = 0.0
    jacobian[np.arange(coordinates), coordinates + np.arange(coordinates)] = 1.0
    return jacobian


@pytest.mark.parametrize(('n', 'coordinates'), [(8, 3), (10, 3), (4, 1), (2, 0), (1, 0), (15, 6)])
def test_solution_of_a_step(n, coordinates):
    random = np.random.default_rng(n)
    for shift in (1e-1, 1e2, 1e7):
        jacobian, b, x = of_motion(random, n, coordinates), random.normal(size=n), np.zeros(n)
        A, pivot = np.empty((n, n)), np.zeros(n, dtype=np.int64)
        assert invert_shifted(jacobian, shift, coordinates, A, pivot)
        solve_shifted(A, b, x, coordinates)
        whole = shift * np.eye(n) - jacobian
        exact = np.linalg.solve(whole, b)
        scale = np.abs(np.linalg.inv(whole)) @ np.abs(whole) @ np.abs(exact)  # what rounding of the entries alone does
        assert (np.abs(x - exact) <= 1e-13 * scale + 1e-300).all()


def test_inverse_needs_rows_exchanged():
    A, pivot, x = np.array([[0.0, 2.0, 0.0], [0.0, 0.0, 4.0], [8.0, 0.0, 0.0]]), np.zeros(3, dtype=np.int64), np.zeros(3)
    assert invert(A, pivot, 0)
    multiply(A, np.array([2.0, 4.0, 8.0]), x, 0)
    assert x.tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize('row', [[1.0, 2.0], [np.nan, 0.0], [np.inf, 1.0]])
def test_no_inverse(row):
    assert not invert(np.array([[2.0, 4.0], row]), np.zeros(2, dtype=np.int64), 0)


@pytest.mark.parametrize('diagonal', [0.0, np.nan, np.inf])
def test_no_elimination(diagonal):
    """A pivot that is nothing, or no number; neither is caught by the other's check."""
    sparse = elimination(np.eye(2, dtype=bool), np.array([0, 1]), np.zeros(2, dtype=bool))
    assert eliminate(np.diag([0.5, 0.5]), 1.0, np.zeros((2, 2)), sparse)
    assert not eliminate(np.diag([0.5, 1.0 - diagonal]), 1.0, np.zeros((2, 2)), sparse)


def at_a_point(kind, mode, names):
    """A state of the module with its model, its system, and an input."""
    point = Point(make_model('module', kind, [active(name) for name in names]), np.random.default_rng(mode), mode)
    return point, own_scratch(point.p), SystemState(point.y, point.mode, point.x), InputPoint(point.u, point.du)


@pytest.mark.parametrize(('kind', 'mode', 'names'), CASES)
def test_jacobian_is_that_of_whole_evaluations(kind, mode, names):
    """Columns evaluate only what depends on their state; to the last bit they are differences of the whole flow."""
    point, p, state, given = at_a_point(kind, mode, names)
    w, n = new_work(point.model), len(point.y)
    linearize_flow(0.0, state, Segment(0.0, 1.0, given.u, given.du, False), p, w, False)
    here, moved = (Evaluation(np.zeros(n), new_findings(p)) for _ in range(2))
    update_flow(0.0, state, given, p, here, EVERYTHING)
    for j in range(n):
        y = point.y.copy()
        y[j] += w.increment[j]
        update_flow(0.0, SystemState(y, point.mode, point.x), given, p, moved, EVERYTHING)
        assert (w.jacobian[:, j] == (moved.dy - here.dy) * (1.0 / (y[j] - point.y[j]))).all(), j


@pytest.mark.parametrize(('kind', 'mode', 'names'), [case for case in CASES if case[0] == 'hybrid'])
def test_guards_are_those_of_the_flow(kind, mode, names):
    point, p, state, given = at_a_point(kind, mode, names)
    whole, part = (Evaluation(np.zeros(len(point.y)), new_findings(p)) for _ in range(2))
    for other in MODES:
        point.mode[1] = other
        update_flow(0.0, state, given, p, whole, EVERYTHING)
        update_guards(0.0, state, given, p, part)
        for i in range(p.wires):
            for edge in EDGES:
                if edge.source == point.mode[i]:
                    assert guard(edge.guard, i, p, part.obs) == guard(edge.guard, i, p, whole.obs), (i, edge)
