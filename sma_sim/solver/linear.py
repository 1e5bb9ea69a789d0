"""Dense linear algebra for the few states of a step: LU with partial pivoting, in place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
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
