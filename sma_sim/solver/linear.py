"""Linear algebra of a step: dense LU with partial pivoting, in place; elimination in a fixed order for sparse equations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
Vector = NDArray[np.float64]
Integers = NDArray[np.int64]
ONE = np.uint64(1)  # unsigned indices spare the compiler the check for negative ones: a third of the time


def factorise(A: Matrix, pivot: NDArray[np.int64]) -> bool:
    """Replace A (n, n) by its LU factors, pivots inverted; False when it is singular or not finite."""
    n = np.uint64(A.shape[0])
    for k in range(n):
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
        A[k, k] = inverse  # a division costs ten products, and every solution would need it
        for i in range(k + ONE, n):
            factor = A[i, k] * inverse
            A[i, k] = factor
            if factor != 0.0:
                for j in range(k + ONE, n):
                    A[i, j] -= factor * A[k, j]
    return True


def solve_factorised(A: Matrix, pivot: NDArray[np.int64], b: NDArray[np.float64]) -> None:
    """Replace b (n,) by the solution of the system whose factors `factorise` left in A."""
    n = np.uint64(A.shape[0])
    for k in range(n):
        other = np.uint64(pivot[k])
        b[k], b[other] = b[other], b[k]
    for k in range(n):
        rest = b[k]
        for j in range(k):
            rest -= A[k, j] * b[j]
        b[k] = rest
    for done in range(n):
        row = n - ONE - done
        rest = b[row]
        for j in range(row + ONE, n):
            rest -= A[row, j] * b[j]
        b[row] = rest * A[row, row]


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
