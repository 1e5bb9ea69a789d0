"""The planar beam with its plate, and how the wires pull on it (paper, EB-Ba to EB-B2a)."""

from __future__ import annotations

import math

from sma_sim.model.parameters import BeamConstants


def wire_length(U_x: float, U_y: float, alpha: float, side: float, b: BeamConstants) -> tuple[float, float, float, float]:
    """Length of a wire and its gradient (l, dl/dU_x, dl/dU_y, dl/dalpha) (EB-B2a, EB-B3).

    `side` is -1 for wire 1 and +1 for wire 2.
    """
    half = 0.5 * side * b.W
    sine, cosine = math.sin(alpha), math.cos(alpha)
    across = U_y + half * (1.0 - cosine)
    along = b.L + U_x + half * sine
    length = math.sqrt(across * across + along * along)
    return length, along / length, across / length, half * (across * sine + along * cosine) / length


def beam_forces(
    U_x: float, U_y: float, alpha: float, dU_x: float, dU_y: float, dalpha: float, b: BeamConstants
) -> tuple[float, float, float]:
    """Elastic and viscous generalised forces of the beam on (U_x, U_y, alpha) [N, N, N m]."""
    return (
        -b.k_x * U_x - b.b_x * dU_x,
        -b.k_y * U_y + b.k_ya * alpha - b.b_y * dU_y,
        b.k_ya * U_y - b.k_a * alpha - b.b_alpha * dalpha,
    )
