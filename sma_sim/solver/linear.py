"""Linear algebra of a step: the inverse for dense equations; elimination in a fixed order for sparse ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.arrays import Integers, Matrix, Vector

ONE = np.uint64(1)  # unsigned indices spare the compiler the check for negative ones: a third of the time


def invert(A: Matrix, pivot: Integers, first: int) -> bool:
    """Replace the block of A (n, n) from row and column `first` on by its inverse; False when it is singular or not finite.

    What the rows have before column `first` is multiplied by this inverse. Gauss-Jordan with partial pivoting: the loops of
    products with an inverse are all of one length, which processors foresee; those of triangular solutions are not.
    """
    n, begin = np.uint64(A.shape[0]), np.uint64(first)
    for k in range(begin, n):
        best = k
        for i in range(k + ONE, n):
            if abs(A[i, k]) > abs(A[best, k]):
                best = i
        pivot[k] = best
        if not abs(A[best, k]) > 0.0 or not np.isfinite(A[best, k]):
            return False
        if best != k:
            for j in range(n):
                A[k, j], A[best, j] = A[best, j], A[k, j]
        inverse = 1.0 / A[k, k]
        A[k, k] = 1.0
        for j in range(n):
            A[k, j] *= inverse
        for i in range(begin, n):
            factor = A[i, k]
            if i != k and factor != 0.0:
                A[i, k] = 0.0
                for j in range(n):
                    A[i, j] -= factor * A[k, j]
    for done in range(n - begin):
        column = n - ONE - done
        other = np.uint64(pivot[column])
        if other != column:
            for i in range(begin, n):
                A[i, column], A[i, other] = A[i, other], A[i, column]
    return True


def multiply(A: Matrix, b: Vector, x: Vector, first: int) -> None:
    """x = A b (n,), from row `first` on."""
    n = np.uint64(A.shape[0])
    for i in range(np.uint64(first), n):
        total = 0.0
        for j in range(n):
            total += A[i, j] * b[j]
        x[i] = total


def invert_shifted(jacobian: Matrix, shift: float, coordinates: int, A: Matrix, pivot: Integers) -> bool:
    """Leave in A (n, n) what solves (shift I - J) x = b in `solve_shifted`; False when that is singular or not finite.

    The first states are `coordinates`, the next their rates. A coordinate changes by its rate alone, which eliminates it.
    """
    n, m = np.uint64(A.shape[0]), np.uint64(coordinates)
    inverse = 1.0 / shift
    for i in range(m, n):
        for j in range(n):
            A[i, j] = -jacobian[i, j]
        A[i, i] += shift
        for j in range(m):
            part = jacobian[i, j] * inverse
            A[i, j] = part
            A[i, m + j] -= part
    for j in range(m):
        A[j, j] = inverse
    return invert(A, pivot, coordinates)


def solve_shifted(A: Matrix, b: Vector, x: Vector, coordinates: int) -> None:
    """The solution x (n,) of the equations that `invert_shifted` left in A."""
    multiply(A, b, x, coordinates)
    m = np.uint64(coordinates)
    for j in range(m):
        x[j] = (b[j] + x[m + j]) * A[j, j]


class Elimination(NamedTuple):
    """In which order unknowns are eliminated, and where the factors are not zero, fill included.

    When ``order[k]`` is eliminated, the rows ``rows[first_row[k] : first_row[k + 1]]`` below it and the columns to the right
    likewise have entries; `entries` (m, 2) are all places of the matrix. `reach` is 1 for the rates of a segment (own,) that
    accelerate all segments beyond it.
    """

    order: Integers
    first_row: Integers
    rows: Integers
    first_column: Integers
    columns: Integers
    entries: Integers
    reach: Integers


NONE = np.zeros(0, dtype=np.int64)
DENSE = Elimination(NONE, NONE, NONE, NONE, NONE, np.zeros((0, 2), dtype=np.int64), NONE)


def elimination(pattern: NDArray[np.bool_], order: Integers, reach: NDArray[np.bool_]) -> Elimination:
    """The elimination of equations with a `pattern` (n, n) of entries in this order, without pivoting."""
    filled = pattern[np.ix_(order, order)].copy()
    rows, columns = [], []
    for k in range(len(order)):
        below, right = k + 1 + np.flatnonzero(filled[k + 1 :, k]), k + 1 + np.flatnonzero(filled[k, k + 1 :])
        filled[np.ix_(below, right)] = True
        rows.append(order[below])
        columns.append(order[right])
    firsts = [np.concatenate([[0], np.cumsum([len(part) for part in parts])]) for parts in (rows, columns)]
    entries = np.argwhere(filled)
    whole = (order, firsts[0], np.concatenate(rows), firsts[1], np.concatenate(columns), order[entries], reach)
    return Elimination(*(np.ascontiguousarray(part, dtype=np.int64) for part in whole))


def eliminate(jacobian: Matrix, shift: float, A: Matrix, e: Elimination) -> bool:
    """Leave the factors of shift I - J in A (n, n), pivots inverted; False when it is singular or not finite."""
    for m in range(np.uint64(e.entries.shape[0])):
        A[e.entries[m, 0], e.entries[m, 1]] = -jacobian[e.entries[m, 0], e.entries[m, 1]]
    for k in range(np.uint64(e.order.shape[0])):
        A[e.order[k], e.order[k]] += shift
    for k in range(np.uint64(e.order.shape[0])):
        pivot = np.uint64(e.order[k])
        if not abs(A[pivot, pivot]) > 0.0 or not np.isfinite(A[pivot, pivot]):
            return False
        inverse = 1.0 / A[pivot, pivot]
        A[pivot, pivot] = inverse
        for r in range(np.uint64(e.first_row[k]), np.uint64(e.first_row[k + ONE])):
            row = np.uint64(e.rows[r])
            factor = A[row, pivot] * inverse
            A[row, pivot] = factor
            if factor != 0.0:
                for c in range(np.uint64(e.first_column[k]), np.uint64(e.first_column[k + ONE])):
                    column = np.uint64(e.columns[c])
                    A[row, column] -= factor * A[pivot, column]
    return True


def solve_eliminated(A: Matrix, e: Elimination, b: Vector) -> None:
    """Replace b (n,) by the solution of the system whose factors `eliminate` left in A."""
    n = np.uint64(e.order.shape[0])
    for k in range(n):
        pivot = np.uint64(e.order[k])
        for r in range(np.uint64(e.first_row[k]), np.uint64(e.first_row[k + ONE])):
            row = np.uint64(e.rows[r])
            b[row] -= A[row, pivot] * b[pivot]
    for done in range(n):
        last = n - ONE - done
        pivot = np.uint64(e.order[last])
        rest = b[pivot]
        for c in range(np.uint64(e.first_column[last]), np.uint64(e.first_column[last + ONE])):
            column = np.uint64(e.columns[c])
            rest -= A[pivot, column] * b[column]
        b[pivot] = rest * A[pivot, pivot]
