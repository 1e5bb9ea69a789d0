"""The planar beam with its plate, and how the wires pull on it (paper, EB-Ba to EB-B2a)."""

from __future__ import annotations

import math

from sma_sim.model.parameters import BeamConstants


def wire_length(U_x: float, U_y: float, alpha: float, side: float, b: BeamConstants) -> tuple[float, float, float, float]:
    """Length of a wire and its gradient (l, dl/dU_x, dl/dU_y, dl/dalpha) (EB-B2a, EB-B3).

    `side` is -1 for wire 1 and +1 for wire 2.
    """
    return inclined_wire_length(U_x, U_y, math.sin(alpha), math.cos(alpha), side, b)


def inclined_wire_length(
    U_x: float, U_y: float, sine: float, cosine: float, side: float, b: BeamConstants
) -> tuple[float, float, float, float]:
    """As `wire_length`, from the sine and cosine of alpha, which both wires share."""
    half = 0.5 * side * b.W
    across = U_y + half * (1.0 - cosine)
    along = b.L + U_x + half * sine
    length = math.sqrt(across * across + along * along)
    return length, along / length, across / length, half * (across * sine + along * cosine) / length


def stiffness_forces(
    U_x: float, U_y: float, alpha: float, b: BeamConstants, part: float = 1.0
) -> tuple[float, float, float]:
    """K q [N, N, N m] for q = (U_x, U_y, alpha), of a beam that has a `part` of the stiffness K."""
    return (
        part * b.k_x * U_x,
        part * (b.k_y * U_y - b.k_ya * alpha),
        part * (b.k_a * alpha - b.k_ya * U_y),
    )
