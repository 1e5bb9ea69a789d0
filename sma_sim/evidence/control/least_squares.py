"""Linear least squares under linear inequalities, by the method of Lawson and Hanson."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from sma_sim.model.arrays import Matrix, Vector

SMALLEST_ROW = 1e-12  # of a constraint, relative to the largest one, on which no unknown acts
INFEASIBLE = 1e-10  # residual of the dual problem below which no point keeps all constraints


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
