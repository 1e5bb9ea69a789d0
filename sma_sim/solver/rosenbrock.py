"""L-stable Rosenbrock methods as data.

A step solves, for each stage i, with W = I/(h gamma) - J,
``W u_i = f(t + c_i h, y + sum_j a_ij u_j) + sum_j (C_ij/h) u_j + h d_i f_t``.
All methods here are stiffly accurate with six stages: y_5 = y + sum_j a_5j u_j, y_6 = y_5 + u_5, the result is
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


def _lower(rows: list[list[float]]) -> NDArray[np.float64]:
    matrix = np.zeros((6, 6))
    for i, row in enumerate(rows):
        matrix[i, : len(row)] = row
    return matrix


RODAS4 = RosenbrockMethod(
    name='RODAS4',
    source='Hairer and Wanner, Solving Ordinary Differential Equations II, 2nd ed. 1996',
    order=4,
    gamma=0.25,
    a=_lower(
        [
            [],
            [1.544],
            [0.9466785280815826, 0.2557011698983284],
            [3.314825187068521, 2.896124015972201, 0.9986419139977817],
            [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895],
            [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 1.0],
        ]
    ),
    C=_lower(
        [
            [],
            [-5.6688],
            [-2.430093356833875, -0.2063599157091915],
            [-0.1073529058151375, -9.594562251023355, -20.47028614809616],
            [7.496443313967647, -10.24680431464352, -33.99990352819905, 11.7089089320616],
            [8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054],
        ]
    ),
    c=np.array([0.0, 0.386, 0.21, 0.63, 1.0, 1.0]),
    d=np.array([0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0]),
    H=np.array(
        [
            [10.12623508344586, -7.487995877610167, -34.80091861555747, -7.992771707568823, 1.025137723295662, 0.0],
            [-0.6762803392801253, 6.087714651680015, 16.43084320892478, 24.76722511418386, -6.594389125716872, 0.0],
        ]
    ),
)

RODAS4P = RosenbrockMethod(
    name='RODAS4P',
    source='Steinebach, Order-reduction of ROW methods for DAEs, Preprint 1741, TH Darmstadt 1995',
    order=4,
    gamma=0.25,
    a=_lower(
        [
            [],
            [3.0],
            [1.831036793486759, 0.4955183967433795],
            [2.304376582692669, -0.05249275245743001, -1.176798761832782],
            [-7.170454962423024, -4.741636671481785, -16.31002631330971, -1.062004044111401],
            [-7.170454962423024, -4.741636671481785, -16.31002631330971, -1.062004044111401, 1.0],
        ]
    ),
    C=_lower(
        [
            [],
            [-12.0],
            [-8.791795173947035, -2.207865586973518],
            [10.81793056857153, 6.780270611428266, 19.5348594464241],
            [34.19095006749676, 15.49671153725963, 54.7476087596413, 14.16005392148534],
            [34.62605830930532, 15.30084976114473, 56.99955578662667, 18.40807009793095, -5.714285714285717],
        ]
    ),
    c=np.array([0.0, 0.75, 0.21, 0.63, 1.0, 1.0]),
    d=np.array([0.25, -0.5, -0.023504, -0.0362, 0.0, 0.0]),
    H=np.array(
        [
            [25.09876703708589, 11.62013104361867, 28.49148307714626, -5.664021568594133, 0.0, 0.0],
            [1.638054557396973, -0.7373619806678748, 8.47791821923899, 15.9925314877952, -1.882352941176471, 0.0],
        ]
    ),
)
