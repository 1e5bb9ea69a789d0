"""Responses that follow from others: combinations where samples tell them, runs of the simulator else."""

from __future__ import annotations

import numpy as np

from sma_sim.evidence.symbolic_regression.response_basis import TOLERANCE, by_combination


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
    for response, column in zip(found, exact, strict=True):
        missed = np.linalg.norm(response - mixing @ column)
        assert missed <= TOLERANCE * np.linalg.norm(column) * np.linalg.norm(mixing, 2)


def test_all_are_simulated_where_one_of_the_basis_cannot_be():
    columns = [np.ones(9), np.arange(9.0), np.arange(9.0) + 1.0]

    def simulate(chosen: list[int]) -> list[np.ndarray | None]:
        return [None if k == 0 else columns[k] for k in chosen]

    found = by_combination(simulate, columns)
    assert found[0] is None
    assert found[1] is columns[1] and found[2] is columns[2]
