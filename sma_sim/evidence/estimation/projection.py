"""What is left of a response once the unknowns of a fit have absorbed of it what they can.

With J the derivatives of all residuals (over noise) in the unknowns, whose priors are N(0, 1), of a response s there is left

    s' = s - J^T (J J^T + 1)^-1 J s
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from sma_sim.evidence.estimation.problem import LinearizedRun, accumulated, normal_equations
from sma_sim.model.arrays import Matrix, Vector

MIN_UNABSORBED = 1e-6  # of a response: where less is left it is rounding error, and the data cannot see it


class Projection:
    """Takes from a response what the fitted unknowns can absorb; their priors hold them back as in the fit.

    `residuals` (N,): of all runs, one behind the other, as responses are.
    """

    def __init__(self, linear: Sequence[LinearizedRun], n: int, tempering: float = 1.0) -> None:
        self.residuals: Vector = np.concatenate([run.residuals.ravel() for run in linear])
        parts = (normal_equations(run, robust=False) for run in linear)
        self._linear, self._prior = linear, tempering**2
        self._inverse = np.linalg.inv(accumulated(parts, np.zeros(n), tempering)[2])

    def __call__(self, response: Vector) -> Vector:
        """The part that is left, (N,)."""
        absorbed = self._inverse @ self._scores(response)
        rest = [
            part - absorbed[run.indices] @ run.jacobian.reshape(len(run.indices), -1)
            for run, part in zip(self._linear, self.by_run(response), strict=True)
        ]
        return np.concatenate(rest)

    def by_run(self, responses: Vector | Matrix) -> list[NDArray[np.float64]]:
        """The part of every run of responses (..., N)."""
        return np.split(responses, np.cumsum([run.residuals.size for run in self._linear])[:-1], axis=-1)

    def _scores(self, responses: Vector | Matrix) -> NDArray[np.float64]:
        """Products of responses (..., N) with all derivatives, (..., n)."""
        scores = np.zeros((*responses.shape[:-1], len(self._inverse)))
        for run, part in zip(self._linear, self.by_run(responses), strict=True):
            scores[..., run.indices] += part @ run.jacobian.reshape(len(run.indices), -1).T
        return scores

    def products(self, responses: Matrix, with_what: Vector) -> tuple[Vector, Vector]:
        """What is left of responses (m, N) times a vector (N,), and its squares, (m,) each, by half the work that what is
        left itself takes. NaN of those that are not `visible`."""
        scores = self._scores(responses)
        absorbed = scores @ self._inverse
        before = np.einsum('ij,ij->i', responses, responses)
        squares = before - np.sum(absorbed * scores, axis=1) - self._prior * np.sum(absorbed**2, axis=1)
        seen = (before > 0.0) & (squares >= MIN_UNABSORBED * before)
        left = responses @ with_what - absorbed @ self._scores(with_what)
        return np.where(seen, left, np.nan), np.where(seen, squares, np.nan)

    def products_of_runs(self, responses: Sequence[Matrix]) -> tuple[Matrix, Vector]:
        """What is left of responses (m, values) that each run has alone: its products with itself, (all of them, all), and
        with the residuals, (all,). What is left itself would take as much memory as all runs for each of them."""
        scores, shown, first = np.zeros((sum(map(len, responses)), len(self._inverse))), list[Vector](), 0
        for run, own in zip(self._linear, responses, strict=True):
            scores[first : first + len(own), run.indices] = own @ run.jacobian.reshape(len(run.indices), -1).T
            shown.append(own @ run.residuals.ravel())
            first += len(own)
        absorbed = scores @ self._inverse
        before = block_diag(*(own @ own.T for own in responses))
        squares = before - absorbed @ scores.T - self._prior * absorbed @ absorbed.T
        return squares, np.concatenate(shown) - absorbed @ self._scores(self.residuals)

    def visible(self, response: Vector) -> Vector | None:
        """The part that is left; None where the channels do not see the response, or all of it can be absorbed."""
        rest, size = self(response), float(response @ response)
        return None if size == 0.0 or float(rest @ rest) < MIN_UNABSORBED * size else rest
