"""Responses that follow from others: combinations where samples tell them, runs of the simulator else."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import block_diag

from sma_sim.evidence.estimation.problem import LinearizedRun
from sma_sim.evidence.estimation.projection import Projection
from sma_sim.evidence.symbolic_regression.response_basis import TOLERANCE, by_combination, by_product


def test_few_responses_tell_those_to_all_functions_of_one_variable():
    x, mixing = np.linspace(0.0, 1.0, 200), np.random.default_rng(0).normal(size=(50, 200))
    columns = [x, x**2, x**3, *(np.maximum(0.0, x - at) for at in np.linspace(0.1, 0.8, 30)), np.zeros(200), None]
    exact, simulated = [np.zeros(200) if column is None else column for column in columns], list[int]()

    def simulate(chosen: list[int]) -> list[np.ndarray | None]:
        simulated.extend(chosen)
        return [mixing @ exact[k] for k in chosen]

    found = by_combination(simulate, columns)
    assert len(simulated) < 12
    assert {len(columns) - 2, len(columns) - 1} <= set(simulated)  # nothing follows for zeros, nor for what is not known
    largest = max(np.linalg.norm(column) for column in exact)
    for response, column in zip(found, exact, strict=True):
        missed = np.linalg.norm(response - mixing @ column)
        size = max(np.linalg.norm(column), TOLERANCE * largest)
        assert missed <= TOLERANCE * size * np.linalg.norm(mixing, 2)


def test_what_hardly_acts_tells_nothing_of_others():
    """Its response is noise of the solver, which must not be scaled up to the size of the others."""
    x, random = np.linspace(0.0, 1.0, 200), np.random.default_rng(0)
    columns = [1e-4 * np.exp(-(((x - at) / 0.02) ** 2)) for at in (0.2, 0.5, 0.8)] + [x, x**2, x**3, np.ones(200)]
    mixing = random.normal(size=(50, 200)) / np.sqrt(200.0)
    exact = [mixing @ column for column in columns]
    noisy = [response + 1e-2 * random.normal(size=50) for response in exact]
    found = by_combination(lambda chosen: [noisy[k] for k in chosen], columns)
    for response, expected in zip(found[3:], exact[3:], strict=True):
        assert np.linalg.norm(response - expected) < TOLERANCE * np.linalg.norm(expected)


def test_all_are_simulated_where_one_of_the_basis_cannot_be():
    columns = [np.ones(9), np.arange(9.0), np.arange(9.0) + 1.0]

    def simulate(chosen: list[int]) -> list[np.ndarray | None]:
        return [None if k == 0 else columns[k] for k in chosen]

    found = by_combination(simulate, columns)
    assert found[0] is None
    assert found[1] is columns[1] and found[2] is columns[2]


def sensed(columns: list[np.ndarray | None], simulated: list[int], lag: int = 0):
    """What a sensor that lags by some samples shows more, on the first of two channels."""

    def simulate(chosen: list[int]) -> list[np.ndarray | None]:
        simulated.extend(chosen)
        weight = np.concatenate([np.linspace(1.0, 2.0, 100), np.zeros(100)])
        zeros = np.zeros(200)
        return [weight * np.roll(zeros if columns[k] is None else columns[k], lag) for k in chosen]

    return simulate


def of_a_sensor() -> list[np.ndarray | None]:
    """A constant, waves and steps at the samples of two channels; zeros, and what samples do not tell."""
    t = np.linspace(0.0, 1.0, 100)
    shapes = [np.full(100, 2.0), *(np.sin(20.0 * k * t) for k in (1, 2, 3)), *((t > at) * 1.0 for at in (0.2, 0.5)), 0.0 * t]
    return [*(np.tile(shape, 2) for shape in shapes), None]


def test_a_sensor_without_memory_shows_what_is_added_to_it():
    columns, simulated = of_a_sensor(), list[int]()
    found = by_product(sensed(columns, simulated), columns, columns)
    assert sorted(simulated) == [0, 3, 6, 7]  # the constant, what varies most, and those that nothing tells
    for response, exact in zip(found, sensed(columns, [])(list(range(len(columns)))), strict=True):
        np.testing.assert_allclose(response, exact, atol=1e-12)


def test_of_a_sensor_that_lags_responses_are_simulated():
    columns, simulated = of_a_sensor(), list[int]()
    found = by_product(sensed(columns, simulated, lag=10), columns, columns)
    assert len(set(simulated)) > 4
    for response, exact in zip(found[:6], sensed(columns, [], lag=10)(list(range(6))), strict=True):
        assert np.linalg.norm(response - exact) <= 2.0 * TOLERANCE * np.linalg.norm(exact)


@pytest.mark.parametrize('tempering', [1.0, 3.0])
def test_products_of_many_responses_are_those_of_what_is_left_of_each(tempering):
    """Of two runs with unknowns of their own; a response that an unknown absorbs whole, and none, are not seen."""
    random = np.random.default_rng(1)
    linear = [
        LinearizedRun(np.array([0, 1, 2 + k]), random.normal(size=(2, 30)), 10.0 * random.normal(size=(3, 2, 30)))
        for k in (0, 1)
    ]
    for run in linear:
        run.jacobian[0] *= 1e4
    absorbed = np.concatenate([run.jacobian[0].ravel() for run in linear])
    responses, vector = np.vstack([random.normal(size=(5, 120)), absorbed, np.zeros(120)]), random.normal(size=120)
    project = Projection(linear, 4, tempering)
    products, squares = project.products(responses, vector)
    for response, product, square in zip(responses, products, squares, strict=True):
        left = project.visible(response)
        assert np.isnan(product) == np.isnan(square) == (left is None)
        if left is not None:
            assert (product, square) == pytest.approx((left @ vector, left @ left), rel=1e-9)
    assert np.isnan(products).tolist() == [False] * 5 + [True] * 2
    own = [random.normal(size=(2, 60)), random.normal(size=(1, 60))]
    left = np.array([project(column) for column in block_diag(*own)])
    squares, products = project.products_of_runs(own)
    assert squares == pytest.approx(left @ left.T, rel=1e-9, abs=1e-9)
    assert products == pytest.approx(left @ project.residuals, rel=1e-9)
