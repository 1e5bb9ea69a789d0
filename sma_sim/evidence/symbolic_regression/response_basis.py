"""Which terms at a location are simulated, and how the responses of the others follow from theirs.

To first order the channels respond to a term as to the function of time that it is along the runs. Functions of few slow
variables are nearly combinations of each other, so that the responses to some of them tell those to all (interpolative
decomposition: Cheng, Gimbutas, Martinsson and Rokhlin, SIAM J. Sci. Comput. 26, 2005). A sensor without a memory of its own
shows at once what is added to it, so that one response tells all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from sma_sim.evidence.symbolic_regression.terms import Term
from sma_sim.model.arrays import Matrix, Vector

Responses = list[NDArray[np.float64] | None]
TOLERANCE = 0.3  # of the root mean square of a term along the runs, by which a combination may miss it


def follows_slow_states(term: Term) -> bool:
    """Whether the samples of a run tell what a term is in between: not of rates, nor of a memory."""
    return not term.rate and not any(name.startswith('d') for name in term.variables)


@dataclass(frozen=True)
class Basis:
    """Numbers of the columns that make up all of them, with `weights` (basis, columns)."""

    numbers: NDArray[np.int64]
    weights: Matrix


def basis_of(columns: Matrix) -> Basis:
    """A basis of columns (k, columns), none of which is zero, made of some of them: by a QR decomposition with pivoting.

    Small ones, of what a wire hardly visits, may be missed by more of their own size: their responses tell little of others.
    """
    sizes = np.linalg.norm(columns, axis=0)
    sizes = np.maximum(sizes, TOLERANCE * sizes.max())
    triangle, order = qr(columns / sizes, mode='r', pivoting=True)
    rank = int(np.count_nonzero(np.abs(np.diag(triangle)) > TOLERANCE))  # what is left of the column that has most left
    weights = np.zeros((rank, len(order)))
    weights[:, order] = solve_triangular(triangle[:rank, :rank], triangle[:rank])
    return Basis(order[:rank], weights * sizes / sizes[order[:rank], None])


def by_combination(simulate: Callable[[list[int]], Responses], columns: Sequence[Vector | None]) -> Responses:
    """The responses to trials, of which `simulate` gives those with some numbers.

    `columns`: each trial along the runs; None where that does not tell its response. All are simulated if one of the basis
    cannot be.
    """
    known = {k: column for k, column in enumerate(columns) if column is not None and column.any()}
    rest, found = [k for k in range(len(columns)) if k not in known], Responses([None] * len(columns))
    if known:
        basis = basis_of(np.column_stack(list(known.values())))
        chosen = [list(known)[k] for k in basis.numbers]
        responses = [response for response in simulate(chosen) if response is not None]
        if len(responses) < len(chosen):
            return simulate(list(range(len(columns))))
        for k, response in zip(known, basis.weights.T @ np.array(responses), strict=True):
            found[k] = response
    for k, response in zip(rest, simulate(rest), strict=True):
        found[k] = response
    return found


def by_product(
    simulate: Callable[[list[int]], Responses], columns: Sequence[Vector | None], added: Sequence[Vector | None]
) -> Responses:
    """The responses to trials that are added to what a sensor shows: that to a constant times each of them.

    `added`: each trial at the samples of all residuals; None where these do not tell its response. By combination
    (`columns`) where the trial that varies most shows that the sensor does not show all at once, or its zero is unknown.
    """
    known = {k: column for k, column in enumerate(added) if column is not None and column.any()}
    constant = next((k for k, column in known.items() if np.ptp(column) == 0.0), None)
    if constant is None:
        return by_combination(simulate, columns)
    varying = max(known, key=lambda k: float(np.linalg.norm(np.diff(known[k])) / np.linalg.norm(known[k])))
    unit, checked = simulate([constant, varying])
    if unit is None or checked is None:
        return by_combination(simulate, columns)
    unit = unit / known[constant]
    if np.linalg.norm(unit * known[varying] - checked) > TOLERANCE * np.linalg.norm(checked):
        return by_combination(simulate, columns)
    rest, found = [k for k in range(len(added)) if k not in known], Responses([None] * len(added))
    for k, column in known.items():
        found[k] = unit * column
    for k, response in zip(rest, simulate(rest), strict=True):
        found[k] = response
    return found
