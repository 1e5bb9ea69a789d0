"""The L-stable Rosenbrock method as data.

A step solves, for each stage i, with W = I/(h gamma) - J,
``W u_i = f(t + c_i h, y + sum_j a_ij u_j) + sum_j (C_ij/h) u_j + h d_i f_t``.
It is stiffly accurate with six stages: y_5 = y + sum_j a_5j u_j, y_6 = y_5 + u_5, the result is
y_6 + u_6 and u_6 is the error estimate. Dense output over theta in [0, 1]:
``y(theta) = (1-theta) y_0 + theta (y_1 + (1-theta) (k_1 + theta k_2))`` with ``k_m = sum_j H_mj u_j``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class RosenbrockMethod:
    """Coefficients in transformed form (Hairer and Wanner, Solving ODEs II, section IV.7)."""

    name: str
    source: str
    order: int
    gamma: float
    a: NDArray[np.float64]
    C: NDArray[np.float64]
    c: NDArray[np.float64]
    d: NDArray[np.float64]
    H: NDArray[np.float64]


@dataclass(frozen=True)
class WMethod:
    """Coefficients of a method whose order does not depend on the matrix J that its steps solve equations with.

    As `RosenbrockMethod`, but for the last stage of the result, y + sum_j a_sj u_j + u_s; `error` are the weights of the
    stages in the error estimate.
    """

    name: str
    source: str
    order: int
    gamma: float
    a: NDArray[np.float64]
    C: NDArray[np.float64]
    error: NDArray[np.float64]


def _lower(rows: list[list[float]]) -> NDArray[np.float64]:
    matrix = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        matrix[i, : len(row)] = row
    return matrix


RODAS4P2 = RosenbrockMethod(
    name='RODAS4P2',
    source='Steinebach, Improvement of Rosenbrock-Wanner method RODASP, Progress in DAEs II, Springer 2020',
    order=4,
    gamma=0.25,
    a=_lower(
        [
            [],
            [3.0],
            [0.906377755268814, -0.189707390391685],
            [3.758617027739064, 1.161741776019525, -0.849258085312803],
            [7.089566927282776, 4.573591406461604, -8.423496976860259, -0.959280113459775],
            [7.089566927282776, 4.573591406461604, -8.423496976860259, -0.959280113459775, 1.0],
        ]
    ),
    C=_lower(
        [
            [],
            [-12.0],
            [-6.354581592719008, 0.338972550544623],
            [-8.575016317114033, -7.606483992117508, 12.22499765012482],
            [-5.888975457523102, -8.157396617841821, 24.805546872612922, 12.790401512796979],
            [-4.408651676063871, -6.692003137674639, 24.625568527593117, 16.627521966636085, -5.714285714285718],
        ]
    ),
    c=np.array([0.0, 0.75, 0.321448134013046, 0.519745732277726, 1.0, 1.0]),
    d=np.array([0.25, -0.5, -0.189532918363016, 0.085612108792769, 0.0, 0.0]),
    H=np.array(
        [
            [-5.323528268423303, -10.042123754867493, 17.175254928256965, -5.079931171878093, -0.016185991706112, 0.0],
            [6.984505741529879, 6.914061169603662, -0.849178943070653, 18.104410789349338, -3.516963011559032, 0.0],
        ]
    ),
)


def _w_method(
    name: str, source: str, order: int, alpha: NDArray[np.float64], Gamma: NDArray[np.float64], embedded: list[float]
) -> WMethod:
    """A stiffly accurate method in transformed form, from its textbook form and the weights of the embedded method."""
    inverse = np.linalg.inv(Gamma)
    weights = alpha[-1] + Gamma[-1]
    return WMethod(
        name,
        source,
        order,
        float(Gamma[0, 0]),
        np.tril(alpha @ inverse, -1),
        -np.tril(inverse, -1),
        (weights - np.array(embedded)) @ inverse,
    )


_GAMMA = 0.435866521508459

ROS34PW2 = _w_method(
    'ROS34PW2',
    'Rang and Angermann, New Rosenbrock W-methods of order 3 for partial differential algebraic equations of index 1, BIT '
    'Numerical Mathematics 45 (2005) 761',
    3,
    _lower([[], [0.871733043016918], [0.844570600153694, -0.112990642364842], [0.0, 0.0, 1.0]]),
    _lower(
        [
            [_GAMMA],
            [-0.871733043016918, _GAMMA],
            [-0.903380570130441, 0.0541806723880953, _GAMMA],
            [0.242123807060953, -1.22325058390451, 0.545260255335102, _GAMMA],
        ]
    ),
    [0.378109031458194, -0.0960422922124232, 0.5, 0.217933260754229],
)
