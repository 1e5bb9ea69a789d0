"""Which terms at a location are simulated, and how the responses of the others follow from theirs.

To first order the channels respond to a term as to the function of time that it is along the runs. Functions of few slow
variables are nearly combinations of each other, so that the responses to some of them tell those to all (interpolative
decomposition: Cheng, Gimbutas, Martinsson and Rokhlin, SIAM J. Sci. Comput. 26, 2005). A sensor without a memory of its own
shows at once what is added to it, so that one response tells all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from sma_sim.evidence.symbolic_regression.terms import Term
from sma_sim.model.arrays import Matrix, Vector

Responses = list[NDArray[np.float64] | None]
Simulate = Callable[[list[int]], Responses]
TOLERANCE = 0.3  # of the root mean square of a term along the runs, by which a combination may miss it


def follows_slow_states(term: Term) -> bool:
    """Whether the samples of a run tell what a term is in between: not of rates, nor of a memory."""
    return not term.rate and not any(name.startswith('d') for name in term.variables)


def basis_of(columns: Matrix) -> tuple[list[int], Matrix]:
    """A basis of columns (k, columns), none of which is zero, made of some of them: by a QR decomposition with pivoting.

    Returns the numbers of those that make up all, and their weights (basis, columns). Small ones, of what a wire hardly
    visits, may be missed by more of their own size: their responses tell little of others.
    """
    sizes = np.linalg.norm(columns, axis=0)
    sizes = np.maximum(sizes, TOLERANCE * sizes.max())
    triangle, order = qr(columns / sizes, mode='r', pivoting=True)
    rank = int(np.count_nonzero(np.abs(np.diag(triangle)) > TOLERANCE))  # what is left of the column that has most left
    weights = np.zeros((rank, len(order)))
    weights[:, order] = solve_triangular(triangle[:rank, :rank], triangle[:rank])
    return order[:rank].tolist(), weights * sizes / sizes[order[:rank], None]


def telling(columns: Sequence[Vector | None]) -> dict[int, Vector]:
    """By number the columns that tell of others."""
    return {k: column for k, column in enumerate(columns) if column is not None and column.any()}


def with_simulated(simulate: Simulate, known: Mapping[int, Vector], count: int) -> Responses:
    """All `count` responses, those that are not known simulated."""
    rest = [k for k in range(count) if k not in known]
    found: dict[int, NDArray[np.float64] | None] = {**dict(zip(rest, simulate(rest), strict=True)), **known}
    return [found[k] for k in range(count)]


def by_combination(simulate: Simulate, columns: Sequence[Vector | None]) -> Responses:
    """The responses to trials, of which `simulate` gives those with some numbers.

    `columns`: each trial along the runs; None where that does not tell its response. All are simulated if one of the basis
    cannot be.
    """
    known = telling(columns)
    if not known:
        return simulate(list(range(len(columns))))
    numbers, weights = basis_of(np.column_stack(list(known.values())))
    responses = [one for one in simulate([list(known)[k] for k in numbers]) if one is not None]
    if len(responses) < len(numbers):
        return simulate(list(range(len(columns))))
    return with_simulated(simulate, dict(zip(known, weights.T @ np.array(responses), strict=True)), len(columns))


def by_product(simulate: Simulate, columns: Sequence[Vector | None], added: Sequence[Vector | None]) -> Responses:
    """The responses to trials that are added to what a sensor shows: that to a constant times each of them.

    `added`: each trial at the samples of all residuals; None where these do not tell its response. By combination
    (`columns`) where the trial that varies most shows that the sensor does not show all at once, or its zero is unknown.
    """
    known = telling(added)
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
    return with_simulated(simulate, {k: unit * column for k, column in known.items()}, len(added))
