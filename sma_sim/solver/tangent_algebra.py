"""Linear algebra of tangents: all unknowns at once, in the innermost loops, which the compiler vectorises."""

from __future__ import annotations

from typing import Any

import numpy as np

from sma_sim.model.arrays import Matrix, Vector


def add_product(c: float, x: Vector, y: Vector) -> None:
    """y += c x (P,)."""
    if c != 0.0:
        for j in range(np.uint64(y.shape[0])):
            y[j] += c * x[j]


def copy_matrix(target: Matrix, source: Matrix) -> None:
    """Copy `source` (m, P) into `target`."""
    for i in range(np.uint64(target.shape[0])):
        for j in range(np.uint64(target.shape[1])):
            target[i, j] = source[i, j]


def interpolation(theta: float) -> tuple[float, float, float]:
    """Weights of values at the beginning, the middle and the end of a step, at its fraction `theta`."""
    return (1.0 - theta) * (1.0 - 2.0 * theta), 4.0 * theta * (1.0 - theta), theta * (2.0 * theta - 1.0)


def interpolate(weights: tuple[float, float, float], nodes: Any, rows: int, y: Matrix) -> None:
    """The first `rows` of three matrices (3, m, m'), summed with `weights`, into y (m, m')."""
    for i in range(np.uint64(rows)):
        for k in range(np.uint64(nodes.shape[2])):
            y[i, k] = weights[0] * nodes[0, i, k] + weights[1] * nodes[1, i, k] + weights[2] * nodes[2, i, k]


def add_row(by_state: Vector, s: Matrix, r: Matrix, y: Vector) -> None:
    """y (P,) += f_y s + f_x r, of one row of derivatives."""
    n = s.shape[0]
    for k in range(n):
        add_product(by_state[k], s[k], y)
    for k in range(r.shape[0]):
        add_product(by_state[n + k], r[k], y)


def clear(y: Matrix) -> None:
    """y = 0 (m, P)."""
    for i in range(np.uint64(y.shape[0])):
        for j in range(np.uint64(y.shape[1])):
            y[i, j] = 0.0


def add_flow(by_state: Matrix, s: Matrix, r: Matrix, y: Matrix) -> None:
    """y (n, P) += f_y s + f_x r."""
    for i in range(y.shape[0]):
        add_row(by_state[i], s, r, y[i])


def add_combination(factor: float, table: Matrix, row: int, count: int, stages: Any, y: Matrix) -> None:
    """y += factor times the sum of the first `count` stages (6, n, P), weighted with a row of a table of coefficients."""
    for m in range(count):
        for i in range(y.shape[0]):
            add_product(factor * table[row, m], stages[m, i], y[i])


def subtract_product(by_state: Matrix, s: Matrix, r: Matrix, y: Matrix) -> None:
    """y (m, P) less f_y s + f_x r."""
    n = s.shape[0]
    for i in range(y.shape[0]):
        for k in range(n):
            add_product(-by_state[i, k], s[k], y[i])
        for k in range(r.shape[0]):
            add_product(-by_state[i, n + k], r[k], y[i])


def solve_for_all(A: Matrix, b: Matrix, x: Matrix, coordinates: int) -> None:
    """The solutions x (n, P) of the equations that `solver.linear.invert_shifted` left in A."""
    n, m, count = np.uint64(A.shape[0]), np.uint64(coordinates), np.uint64(b.shape[1])
    for i in range(m, n):
        for j in range(count):
            x[i, j] = 0.0
        for k in range(n):
            add_product(A[i, k], b[k], x[i])
    for i in range(m):
        for j in range(count):
            x[i, j] = (b[i, j] + x[m + i, j]) * A[i, i]
